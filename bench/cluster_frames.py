#!/usr/bin/env python3
"""Frames of a real cluster: coordinator and agents as processes, over gRPC, as a client sees them.

    python3 bench/cluster_frames.py VOLUME --isovalue V --bin build/release/bin --agents 1,4,16 --runs 5 \\
        --peer bench/peers/vtk.py --json out.json

For each number of agents, in each run and for each folder of programs in turn:

    partition    `isoscope partition VOLUME`, once for each number of agents
    cluster      one isoscope-agent for each shard and an isoscope-coordinator, all started anew;
                 `isoscope render --server` asks for the first frame and the following ones
    one process  `isoscope render DATASET`, the same frames without gRPC

and once a run: file to picture, which is `isoscope render VOLUME` from start to end without a cached
dataset, and the peer.
Two --bin folders compare two versions: they take turns, and the table has the ratio of their medians.
Times are milliseconds by the wall clock of the client; bytes are those between coordinator and agents.
"""
import argparse
import contextlib
import json
import os
import pathlib
import socket
import statistics
import subprocess
import sys
import tempfile
import time

SETTLING_SECONDS = 3  # agents take memory from the kernel once they are idle; the coordinator asks for all of them
CAMERA = ['--azimuth', '30', '--elevation', '20', '--width', '1024', '--height', '1024']


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('volume', help='a file that isoscope partition takes')
    parser.add_argument('--isovalue', required=True)
    parser.add_argument('--bin', action='append', required=True, help='folder of the programs; the first is the base')
    parser.add_argument('--agents', default='1,4,16')
    parser.add_argument('--runs', type=int, default=5)
    parser.add_argument('--frames', type=int, default=6)
    parser.add_argument('--peer', help='bench/peers/vtk.py: called on the samples of an .nrrd, inside of xvfb-run')
    parser.add_argument('--json', help='where all measurements go')
    return parser.parse_args()


def free_port():
    with socket.socket() as listener:
        listener.bind(('127.0.0.1', 0))
        return listener.getsockname()[1]


def timed(command, **environment):
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                   env={**os.environ, **environment})
    return 1e3 * (time.perf_counter() - start)


def await_ready(program, address):
    for _ in range(600):
        if subprocess.run([program, '--probe', f'ready,{address}'], stdout=subprocess.DEVNULL,
                          stderr=subprocess.DEVNULL).returncode == 0:
            return
        time.sleep(0.05)
    sys.exit(f'{program} at {address} is not ready after 30 s')


@contextlib.contextmanager
def cluster(folder, dataset, flags=('--renderer', 'cpu'), settling_seconds=SETTLING_SECONDS,
            coordinator_flags=()):
    """The address of a coordinator with one agent for each shard of the dataset, and those of the agents' metrics."""
    shards = sorted(path for path in dataset.iterdir() if path.is_dir())
    agents = [f'127.0.0.1:{free_port()}' for _ in shards]
    metrics = [f'127.0.0.1:{free_port()}' for _ in shards]
    coordinator = f'127.0.0.1:{free_port()}'
    quiet = {'stdout': subprocess.DEVNULL, 'stderr': subprocess.DEVNULL}
    processes = [subprocess.Popen([folder / 'isoscope-agent', *flags, '--listen', address, '--metrics-listen', page, shard],
                                  **quiet) for address, page, shard in zip(agents, metrics, shards)]
    dials = [word for address in agents for word in ('--agent', address)]
    try:
        for address in agents:
            await_ready(folder / 'isoscope-agent', address)
        processes.append(subprocess.Popen([folder / 'isoscope-coordinator', '--listen', coordinator, *dials,
                                           *coordinator_flags], **quiet))
        await_ready(folder / 'isoscope-coordinator', coordinator)
        time.sleep(settling_seconds)
        yield coordinator, metrics
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()


def frames(folder, target, arguments, scratch):
    """The statistics of each frame that one call of `render` drew."""
    stats = scratch / 'stats.json'
    subprocess.run([folder / 'isoscope', 'render', *target, '--isovalue', arguments.isovalue, *CAMERA,
                    '--repeat', str(arguments.frames), '--orbit', '7', '--output', scratch / 'frame.png',
                    '--stats', stats], check=True, stdout=subprocess.DEVNULL)
    return json.loads(stats.read_text())['frames']


def figures(all_frames):
    first, following = all_frames[0], all_frames[1:]
    return {'first_ms': first['wall_ms'], 'following_ms': statistics.median(frame['wall_ms'] for frame in following),
            'first_bytes': first['network_bytes'],
            'following_bytes': statistics.median(frame['network_bytes'] for frame in following),
            'triangles': first['triangle_count']}


def call_peer(arguments, scratch):
    text = pathlib.Path(arguments.volume).read_bytes()
    header, samples = text.split(b'\n\n', 1)
    fields = dict(line.split(': ', 1) for line in header.decode().splitlines() if ': ' in line)
    if fields['encoding'] != 'raw':
        sys.exit(f'{arguments.volume}: --peer takes raw NRRD, this one is {fields["encoding"]}')
    raw = scratch / 'samples.raw'
    raw.write_bytes(samples)
    kind = {'uchar': 'uint8', 'unsigned char': 'uint8', 'ushort': 'uint16', 'unsigned short': 'uint16'}
    command = ['xvfb-run', '-a', '-s', '-screen 0 1280x1024x24', '/usr/bin/python3', arguments.peer, raw,
               '--dims', ','.join(fields['sizes'].split()), '--type', kind.get(fields['type'], fields['type']),
               '--isovalue', arguments.isovalue, '--frames', str(arguments.frames)]
    start = time.perf_counter()
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return {**json.loads(output.splitlines()[-1]), 'process_ms': 1e3 * (time.perf_counter() - start)}


def measure(arguments, scratch):
    folders = [pathlib.Path(folder).resolve() for folder in arguments.bin]
    agent_counts = [int(count) for count in arguments.agents.split(',')]
    rows = []
    for run in range(arguments.runs):
        for count in agent_counts:
            for folder in folders if run % 2 == 0 else folders[::-1]:
                dataset = scratch / f'{folders.index(folder)}-{count}'
                row = {'run': run, 'agents': count, 'bin': folders.index(folder)}
                if not dataset.exists():
                    row['partition_ms'] = timed([folder / 'isoscope', 'partition', arguments.volume, '--output', dataset,
                                                 '--shards', str(count)])
                with cluster(folder, dataset) as (coordinator, _):
                    row['cluster'] = figures(frames(folder, ['--server', coordinator], arguments, scratch))
                row['one_process'] = figures(frames(folder, [dataset, '--renderer', 'cpu'], arguments, scratch))
                rows.append(row)
        row = {'run': run, 'file_to_picture_ms': [
            timed([folder / 'isoscope', 'render', arguments.volume, '--isovalue', arguments.isovalue, *CAMERA,
                   '--renderer', 'cpu', '--output', scratch / 'frame.png'],
                  XDG_CACHE_HOME=str(scratch / f'cache-{run}-{index}')) for index, folder in enumerate(folders)]}
        if arguments.peer:
            row['peer'] = call_peer(arguments, scratch)
        rows.append(row)
        print(f'run {run + 1} of {arguments.runs}', file=sys.stderr)
    return rows


def median_of(rows, *path):
    values = []
    for row in rows:
        for key in path:
            row = row.get(key) if isinstance(row, dict) else row[key]
            if row is None:
                break
        else:
            values.append(row)
    return statistics.median(values) if values else float('nan')


def print_tables(rows, arguments):
    print('agents  version  first ms  following ms  first kB  following kB  one process: first, following  partition ms')
    for count in arguments.agents.split(','):
        for version in range(len(arguments.bin)):
            mine = [row for row in rows if row.get('agents') == int(count) and row['bin'] == version]
            print(f'{count:>6}  {version:>7}  {median_of(mine, "cluster", "first_ms"):8.1f}'
                  f'  {median_of(mine, "cluster", "following_ms"):12.1f}'
                  f'  {median_of(mine, "cluster", "first_bytes") / 1e3:8.0f}'
                  f'  {median_of(mine, "cluster", "following_bytes") / 1e3:12.0f}'
                  f'  {median_of(mine, "one_process", "first_ms"):18.1f}, {median_of(mine, "one_process", "following_ms"):9.1f}'
                  f'  {median_of(mine, "partition_ms"):12.0f}')
    for version in range(len(arguments.bin)):
        print(f'file to picture, version {version}: {median_of(rows, "file_to_picture_ms", version):.0f} ms')
    if arguments.peer:
        for part in ('extract_ms', 'first_draw_ms', 'next_draw_ms', 'png_ms', 'cold_total', 'next_total', 'process_ms'):
            print(f'peer {part}: {median_of(rows, "peer", part):.1f}')


def main():
    arguments = parse_arguments()
    with tempfile.TemporaryDirectory(dir=os.environ.get('TMPDIR')) as scratch:
        rows = measure(arguments, pathlib.Path(scratch))
    if arguments.json:
        pathlib.Path(arguments.json).write_text(json.dumps({'command': sys.argv, 'rows': rows}, indent=1))
    print_tables(rows, arguments)


if __name__ == '__main__':
    main()
