#!/usr/bin/env python3
"""What pictures of levels cost, and what levels cost, on random volumes of growing size, beside a version before.

    python3 bench/level_costs.py --after build/release/bin --before old/bin --sizes 512,1024 --work /data/levels
    python3 bench/level_costs.py --after build/release/bin --sizes 2560 --type uint8 --wave-number 40 --exponent 3 \\
        --agents 4 --rows frame,cold,psnr --work /data/levels

For each size S a volume of S^3 samples is made by `isoscope generate random`, partitioned, and deleted; what one size
has left is deleted before the next one. --rows chooses what is measured:

    partition  `isoscope partition` without levels and with them: time, peak of resident memory, bytes on disk
    frame      following frames at --max-spacing 1.1 beside exact ones of a dataset of that level's size
    cold       the first frame at --max-spacing 2.2, the files not in memory, beside the first exact frame of a dataset
               of that level's size; bytes read
    psnr       differences to the exact picture with 16 samples a pixel: of the exact one with 1 sample, and of the one
               at --max-spacing 1.1
    exact      exact following frames of both versions, each of its own dataset

Frames are of 1024 x 1024 pixels from the default camera turned by --azimuth and --elevation, by a cluster of one
isoscope-agent for each shard and an isoscope-coordinator, started anew for each run; a run draws --frames frames
--orbit degrees apart. What is compared takes turns. Times are medians in milliseconds, by the clock of the client.
"Cold" asks the kernel to drop the dataset's pages (posix_fadvise): nothing else of the machine is flushed.

A goal is met or missed where its row has one; the exit status does not depend on it. Disk: 3.5 times the samples of the
largest size; with the row partition 1.7 times more, and with --before for partition or exact 1.7 times more. Needs
python3-numpy, -grpcio, -protobuf for psnr.
"""
import argparse
import contextlib
import json
import math
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

from cluster_frames import cluster

ROOT = pathlib.Path(__file__).resolve().parent.parent
ROWS = ('partition', 'frame', 'cold', 'psnr', 'exact')
MIDDLE = {'uint8': 128, 'uint16': 32768, 'float32': 0.5}  # of what `generate` writes
SAMPLE_BYTES = {'uint8': 1, 'uint16': 2, 'float32': 4}
NEAR_PX, COLD_PX = '1.1', '2.2'
SIDE = 1024  # of pictures, in pixels
# Of the ratios, by row; the goal of bytes is of sample types.
GOALS = {'frame': 1.15, 'cold': 1.2, 'partition': 1.25, 'exact': 1 / 0.98}
BYTES_GOALS = {'uint8': 1.35, 'uint16': 1.2}
COLD_READ_MIB = 120


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--after', type=pathlib.Path, default=ROOT / 'build/release/bin',
                        help='folder of the programs that know levels')
    parser.add_argument('--before', type=pathlib.Path,
                        help='folder of the programs of the version before, for partition and exact')
    parser.add_argument('--sizes', default='256,512', help='samples on each axis, several separated by commas')
    parser.add_argument('--type', choices=sorted(MIDDLE), default='uint16')
    parser.add_argument('--wave-number', default='24')
    parser.add_argument('--exponent', default='8')
    parser.add_argument('--isovalue', type=float, help='default: the middle of the type')
    parser.add_argument('--levels', default='auto', help='as isoscope partition takes it; auto makes none below 512')
    parser.add_argument('--rows', default=','.join(ROWS), help=f'several of {", ".join(ROWS)}')
    parser.add_argument('--agents', type=int, default=1, help='shards, one agent each')
    parser.add_argument('--agent-memory', default='256MiB', help='limit of each agent')
    parser.add_argument('--runs', type=int, default=5)
    parser.add_argument('--frames', type=int, default=6, help='of a run, the first one included')
    parser.add_argument('--azimuth', type=float, default=30, help='degrees')
    parser.add_argument('--elevation', type=float, default=20, help='degrees')
    parser.add_argument('--orbit', type=float, default=7, help='degrees from frame to frame')
    parser.add_argument('--settling', type=float, default=3, help='seconds before the first frame of a cluster')
    parser.add_argument('--work', type=pathlib.Path, help='folder for volumes; default: a temporary one')
    parser.add_argument('--json', type=pathlib.Path, help='where all figures go')
    arguments = parser.parse_args()
    arguments.sizes = [int(size) for size in arguments.sizes.split(',')]
    arguments.rows = arguments.rows.split(',')
    unknown = set(arguments.rows) - set(ROWS)
    if unknown:
        parser.error(f'--rows has {", ".join(sorted(unknown))}: must be of {", ".join(ROWS)}')
    if arguments.runs < 1 or arguments.frames < 2 or arguments.agents < 1:
        parser.error('--runs and --agents must be at least 1, --frames at least 2')
    if arguments.isovalue is None:
        arguments.isovalue = MIDDLE[arguments.type]
    for folder in filter(None, (arguments.after, arguments.before)):
        if not (folder / 'isoscope').exists():
            parser.error(f'{folder} has no program isoscope')
    arguments.after = arguments.after.resolve()
    arguments.before = arguments.before and arguments.before.resolve()
    return arguments


def say(text):
    print(text, file=sys.stderr, flush=True)


# ---------------------------------------------------------------------------------------------- volumes


def generate(arguments, size, work):
    path = work / f'volume-{size}.nrrd'
    say(f'{size}^3: generating')
    subprocess.run([arguments.after / 'isoscope', 'generate', 'random', '--dims', f'{size},{size},{size}', '--type',
                    arguments.type, '--wave-number', arguments.wave_number, '--exponent', arguments.exponent,
                    '--quiet', '--output', path], check=True)
    return path


def bytes_of(folder):
    return sum(path.stat().st_size for path in folder.rglob('*') if path.is_file())


def partition(program, volume, folder, arguments, *flags):
    """Partitions anew; returns seconds, the peak in MiB, and the bytes on disk."""
    shutil.rmtree(folder, ignore_errors=True)
    command = [program / 'isoscope', 'partition', volume, '--output', folder, '--shards', str(arguments.agents), '--quiet',
               *flags]
    start = time.perf_counter()
    process = subprocess.Popen(command)
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f'{sys.argv[0]}: {" ".join(map(str, command))} ended with {process.returncode}')
    return {'seconds': seconds, 'peak_mib': usage.ru_maxrss / 1024, 'bytes': bytes_of(folder)}


def measure_partition(arguments, volume, size, work):
    """Leaves the dataset with levels, and that of the version before if it is asked for."""
    with_levels, plain, old = (work / f'{name}-{size}' for name in ('levels', 'plain', 'before'))
    cases = {'levels': (arguments.after, with_levels, '--levels', arguments.levels)}
    if 'partition' in arguments.rows:
        cases['plain'] = (arguments.after, plain, '--levels', 'none')
    if arguments.before and set(arguments.rows) & {'partition', 'exact'}:
        cases['before'] = (arguments.before, old)
    runs = {name: [] for name in cases}
    for run in range(arguments.runs if 'partition' in arguments.rows else 1):
        for name, (program, folder, *flags) in (list(cases.items()) if run % 2 == 0 else list(cases.items())[::-1]):
            say(f'{size}^3: partition {name}, run {run + 1}')
            runs[name].append(partition(program, volume, folder, arguments, *flags))
    shutil.rmtree(plain, ignore_errors=True)
    return {name: {figure: statistics.median(one[figure] for one in of) for figure in of[0]} for name, of in runs.items()}


# ----------------------------------------------------------------------------------------------- frames


def drop_pages(folder):
    for path in folder.rglob('*'):
        if path.is_file():
            with open(path, 'rb') as file:
                os.fdatasync(file.fileno())
                os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


@contextlib.contextmanager
def served(program, dataset, arguments):
    flags = ['--renderer', 'cpu', '--memory-limit', arguments.agent_memory]
    with cluster(program, dataset, flags, settling_seconds=arguments.settling) as (coordinator, _):
        yield coordinator


def frames(program, dataset, arguments, work, *, count, flags=(), is_cold=False):
    """The statistics of the frames of a new cluster."""
    stats = work / 'stats.json'
    if is_cold:
        drop_pages(dataset)
    with served(program, dataset, arguments) as coordinator:
        if is_cold:
            drop_pages(dataset)
        subprocess.run([program / 'isoscope', 'render', '--server', coordinator, '--isovalue', str(arguments.isovalue),
                        '--azimuth', str(arguments.azimuth), '--elevation', str(arguments.elevation), '--width', str(SIDE),
                        '--height', str(SIDE), '--repeat', str(count), '--orbit', str(arguments.orbit), '--timeout', '3600',
                        '--no-measures', *flags, '--output', '/dev/null', '--stats', stats],
                       check=True, stdout=subprocess.DEVNULL)
    return json.loads(stats.read_text())['frames']


def in_turns(arguments, cases, figure):
    """The median of each case's figure over the runs."""
    values = {name: [] for name in cases}
    for run in range(arguments.runs):
        for name, draw in (list(cases.items()) if run % 2 == 0 else list(cases.items())[::-1]):
            say(f'    {name}, run {run + 1} of {arguments.runs}')
            values[name].append(figure(draw()))
    return {name: statistics.median(of) for name, of in values.items()}


def following_ms(all_frames):
    return statistics.median(frame['wall_ms'] for frame in all_frames[1:])


def level_of(arguments, dataset, work, spacing):
    drawn = frames(arguments.after, dataset, arguments, work, count=2, flags=['--max-spacing', spacing])[0]
    return drawn.get('level', 0), drawn.get('max_spacing_px', 0)


def dataset_of_size(arguments, size, work):
    """A dataset without levels of a volume with so many samples on each axis."""
    folder = work / f'of-size-{size}'
    if not folder.exists():
        volume = generate(arguments, size, work)
        partition(arguments.after, volume, folder, arguments, '--levels', 'none')
        volume.unlink()
    return folder


def measure_frames(arguments, dataset, size, work, row):
    spacing = NEAR_PX if row == 'frame' else COLD_PX
    level, level_px = level_of(arguments, dataset, work, spacing)
    small_size = size >> level
    small = dataset_of_size(arguments, small_size, work)
    is_cold = row == 'cold'
    say(f'{size}^3: {row} at {spacing} px: level {level}, {small_size}^3')
    seen = []

    def draw(folder, flags):
        drawn = frames(arguments.after, folder, arguments, work, count=2 if is_cold else arguments.frames, flags=flags,
                       is_cold=is_cold)
        seen.append((flags, drawn[0]['read_bytes']))
        return drawn

    cases = {'level': lambda: draw(dataset, ['--max-spacing', spacing]), 'its_size': lambda: draw(small, [])}
    if not is_cold and level:
        cases['exact'] = lambda: draw(dataset, [])
    times = in_turns(arguments, cases, (lambda of: of[0]['wall_ms']) if is_cold else following_ms)
    return {'level': level, 'level_px': level_px, 'size_of_level': small_size,
            **{f'{name}_ms': value for name, value in times.items()}, 'ratio': times['level'] / times['its_size'],
            'first_read_mib': statistics.median(count for flags, count in seen if flags == ['--max-spacing', spacing]) / 2**20}


def measure_exact(arguments, size, work):
    cases = {'after': lambda: frames(arguments.after, work / f'levels-{size}', arguments, work, count=arguments.frames),
             'before': lambda: frames(arguments.before, work / f'before-{size}', arguments, work, count=arguments.frames)}
    say(f'{size}^3: exact frames of both versions')
    times = in_turns(arguments, cases, following_ms)
    return {**{f'{name}_ms': value for name, value in times.items()}, 'ratio': times['after'] / times['before']}


# ------------------------------------------------------------------------------------------------- psnr


def psnr(picture, reference):
    import numpy
    error = numpy.mean((picture.astype(numpy.float64) - reference.astype(numpy.float64)) ** 2)
    return math.inf if error == 0 else 10 * math.log10(255**2 / error)


def measure_psnr(arguments, dataset, size):
    sys.path.insert(0, str(ROOT / 'clients/python/src'))
    import isoscope
    say(f'{size}^3: psnr')
    with served(arguments.after, dataset, arguments) as coordinator, isoscope.connect(coordinator) as client:
        of = client.dataset()
        look = {'isovalue': arguments.isovalue, 'camera': of.camera('front', arguments.azimuth, arguments.elevation),
                'size': (SIDE, SIDE), 'timeout': 3600}
        reference = of.render(samples=16, **look).rgb
        level = of.render(max_spacing=float(NEAR_PX), **look)
        return {'exact_db': psnr(of.render(samples=1, **look).rgb, reference), 'level_db': psnr(level.rgb, reference)}


# ----------------------------------------------------------------------------------------------- report


def verdict(is_met):
    return 'met' if is_met else 'MISSED'


def describe(arguments, size, of):
    lines = []
    if 'partition' in of and 'plain' in of['partition']:
        base = of['partition'].get('before', of['partition']['plain'])
        levels = of['partition']['levels']
        time_ratio, bytes_ratio = (levels[name] / base[name] for name in ('seconds', 'bytes'))
        lines.append(f'partition  {base["seconds"]:.1f} s without, {levels["seconds"]:.1f} s with levels: {time_ratio:.2f}, goal '
                     f'{GOALS["partition"]} {verdict(time_ratio <= GOALS["partition"])}')
        goal = BYTES_GOALS.get(arguments.type)
        lines.append(f'           {base["bytes"] / 1e6:.1f} MB without, {levels["bytes"] / 1e6:.1f} MB with levels: '
                     f'{bytes_ratio:.3f}' + (f', goal {goal} {verdict(bytes_ratio <= goal)}' if goal else ''))
        lines.append(f'           peak {base["peak_mib"]:.0f} MiB without, {levels["peak_mib"]:.0f} MiB with levels')
    for row in 'frame', 'cold':
        if row in of:
            one = of[row]
            lines.append(f'{row:<10} level {one["level"]} (1 sample = {one["level_px"]:.2f} px) {one["level_ms"]:.1f} ms, '
                         f'{one["size_of_level"]}^3 exact {one["its_size_ms"]:.1f} ms: {one["ratio"]:.3f}, goal {GOALS[row]} '
                         f'{verdict(one["ratio"] <= GOALS[row])}')
            if 'exact_ms' in one:
                lines.append(f'           exact {one["exact_ms"]:.1f} ms')
            if row == 'cold':
                lines.append(f'           {one["first_read_mib"]:.1f} MiB read, goal {COLD_READ_MIB} '
                             f'{verdict(one["first_read_mib"] <= COLD_READ_MIB)}')
    if 'psnr' in of:
        one = of['psnr']
        lines.append(f'psnr       level {one["level_db"]:.2f} dB, exact with 1 sample {one["exact_db"]:.2f} dB: '
                     f'{verdict(one["level_db"] >= one["exact_db"])}')
    if 'exact' in of:
        one = of['exact']
        lines.append(f'exact      before {one["before_ms"]:.1f} ms, after {one["after_ms"]:.1f} ms: before / after '
                     f'{1 / one["ratio"]:.3f}, goal 0.98 {verdict(one["ratio"] <= GOALS["exact"])}')
    head = f'{size}^3 of {arguments.type}, {arguments.agents} agents of {arguments.agent_memory}'
    return head + '\n' + ''.join(f'  {line}\n' for line in lines)


def check_disk(arguments, work):
    # The volume, its dataset with levels, and scratch; each other dataset of these samples has 1.7 times their bytes.
    others = ('partition' in arguments.rows) + bool(arguments.before and set(arguments.rows) & {'partition', 'exact'})
    need = (3.5 + 1.7 * others) * max(arguments.sizes) ** 3 * SAMPLE_BYTES[arguments.type]
    free = shutil.disk_usage(work).free
    if free < need:
        sys.exit(f'{sys.argv[0]}: {work} has {free / 1e9:.1f} GB free; {max(arguments.sizes)}^3 of {arguments.type} takes up to '
                 f'{need / 1e9:.1f} GB: take smaller --sizes, or another --work')


def measure_size(arguments, size, work):
    volume = generate(arguments, size, work)
    of = {'size': size, 'partition': measure_partition(arguments, volume, size, work)}
    volume.unlink()
    dataset = work / f'levels-{size}'
    for row in 'frame', 'cold':
        if row in arguments.rows:
            of[row] = measure_frames(arguments, dataset, size, work, row)
    if 'psnr' in arguments.rows:
        of['psnr'] = measure_psnr(arguments, dataset, size)
    if 'exact' in arguments.rows and arguments.before:
        of['exact'] = measure_exact(arguments, size, work)
    return of


def main():
    arguments = parse_arguments()
    results = []
    with tempfile.TemporaryDirectory(prefix='isoscope-levels-', dir=arguments.work) as scratch:
        for size in arguments.sizes:
            work = pathlib.Path(scratch) / str(size)
            work.mkdir()
            check_disk(arguments, work)
            results.append(measure_size(arguments, size, work))
            shutil.rmtree(work)
            print(describe(arguments, size, results[-1]), flush=True)
            if arguments.json:
                arguments.json.write_text(json.dumps({'command': sys.argv, 'sizes': results}, indent=1) + '\n')


if __name__ == '__main__':
    main()
