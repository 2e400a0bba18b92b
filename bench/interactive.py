#!/usr/bin/env python3
"""Measures what people feel at a view that they move, as clients of a server see it.

    python3 bench/interactive.py drag head --isovalue 60
    python3 bench/interactive.py slider --server localhost:50051 --isovalue 50 --to 70
    python3 bench/interactive.py clients --server localhost:50051 --isovalue 60 --clients 4,64
    python3 bench/interactive.py cancel head.nii.gz --isovalue 60 --shards 4

drag     turns a view, 60 states a second, over InteractService: frames a second, time from state to frame, time from
         the last state to the exact frame, which is compared with that of RenderIsosurface. With --refine also the
         levels of the frames, the time to the first frame at rest and to each tile, and what a limit has deferred
slider   renders each of some isovalues, and then each once more: times; of a server of its own also kernel time and
         new memory
clients  repeatedly request the same picture, each on a connection of its own: throughput, times, refusals
cancel   cancels frames at random moments: time until the client's call has returned, and until all agents are idle

Without --server, drag and slider start `isoscope serve`. cancel starts one isoscope-agent for each shard and an
isoscope-coordinator, and restarts them regularly: the first frame afterwards is cold. All times are milliseconds by
the wall clock. $ISOSCOPE_TOKEN and $ISOSCOPE_TLS_CA hold as for the programs.

Needs python3-grpcio, python3-protobuf and python3-numpy.
"""
import argparse
import asyncio
import collections
import contextlib
import dataclasses
import datetime
import http.client
import json
import math
import os
import pathlib
import platform
import random
import re
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / 'clients/python/src'))

import isoscope  # noqa: E402
import isoscope.aio  # noqa: E402
from cluster_frames import cluster  # noqa: E402
from isoscope import _core, _retry  # noqa: E402
from isoscope._proto import interact_service_pb2  # noqa: E402

PATIENCE = 60  # seconds; far above what a frame takes


def now_ms():
    return 1e3 * time.perf_counter()


def percentile(values, share):
    """The smallest value that at least `share` of all values do not exceed; 0 of none."""
    return sorted(values)[max(math.ceil(share * len(values)), 1) - 1] if values else 0


def median(values):
    return statistics.median(values) if values else 0


# ------------------------------------------------------------------------------------------- the report


def value_in_file(path, key, separator):
    with contextlib.suppress(OSError):
        for line in pathlib.Path(path).read_text().splitlines():
            if line.startswith(key) and separator in line:
                return line.split(separator, 1)[1].strip(' \t"')
    return None


def describe_machine():
    processor = value_in_file('/proc/cpuinfo', 'model name', ':') or 'unknown processor'
    system = value_in_file('/etc/os-release', 'PRETTY_NAME', '=') or 'unknown system'
    cores = len(os.sched_getaffinity(0))
    gib = os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') / 2**30
    return (f'{processor}, {cores} core{"s" if cores > 1 else ""}, {gib:.1f} GiB, {system}, '
            f'{platform.system()} {platform.release()}')


def report(arguments, drawers, figures, text):
    """Prints machine, date, command and the text; writes the figures as JSON."""
    machine, date = describe_machine(), datetime.datetime.now(datetime.timezone.utc).strftime('%Y-%m-%d %H:%M UTC')
    head = {'machine': machine, 'date': date, 'command': sys.argv}
    where = {'server': arguments.server} if arguments.measure is clients else {'volume': volume_name(arguments)}
    frame = {'width': arguments.width, 'height': arguments.height, **drawers}
    if arguments.json:
        pathlib.Path(arguments.json).write_text(json.dumps({**head, **where, **frame, **figures}, indent=2) + '\n')
    agents = drawers.get('agents')
    print(f'{machine}; {date}\n{" ".join(sys.argv)}\n{arguments.width} x {arguments.height} pixels'
          + (f', {agents} agent{"s" if agents != 1 else ""}, {drawers["renderer"]}' if drawers else ''))
    print(f'\n{text}', end='')


def volume_name(arguments):
    return pathlib.Path(arguments.input).name if arguments.input else arguments.dataset


def drawers_of(agents):
    return {'agents': len(agents), 'renderer': agents[0].renderer if agents else ''}


# --------------------------------------------------------------------------------------------- servers


@contextlib.contextmanager
def server(arguments):
    """The address of a server, and the number of its process if it is ours."""
    if arguments.server:
        yield arguments.server, None
        return
    command = [arguments.bin / 'isoscope', 'serve', arguments.input, '--listen', '127.0.0.1:0', '--renderer',
               arguments.renderer]
    with (tempfile.TemporaryFile('w+') as log,
          subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True) as process):
        try:
            address = process.stdout.readline().strip()
            if not address:
                log.seek(0)
                sys.exit(f'{sys.argv[0]}: isoscope serve has ended: {log.read()}')
            yield address, process.pid
        finally:
            process.terminate()


def camera_of(dataset, arguments, degrees=0):
    return dataset.camera('front', arguments.azimuth, arguments.elevation).azimuth(degrees)


def look_of(dataset, arguments, degrees=0):
    """What `render` gets; levels only if they are asked for, so that servers without them can be measured."""
    look = {'isovalue': arguments.isovalue, 'camera': camera_of(dataset, arguments, degrees),
            'size': (arguments.width, arguments.height), 'level': arguments.level, 'max_spacing': arguments.max_spacing}
    return {word: value for word, value in look.items() if value is not None}


# ------------------------------------------------------------------------------------------------ drag


@dataclasses.dataclass
class Drag:
    """The figures of a drag."""

    seconds: float = 0
    latencies_ms: list = dataclasses.field(default_factory=list)  # from a state to its frame
    heights_px: list = dataclasses.field(default_factory=list)
    frame_bytes: list = dataclasses.field(default_factory=list)  # picture and depth grid
    exact_ms: float = 0  # from the last state to the exact frame
    exact_is_that_of_render: bool = False
    levels: collections.Counter = dataclasses.field(default_factory=collections.Counter)  # of frames, where they are told
    coarse_ms: float | None = None  # from the last state to the first frame of its whole picture, if that is not exact
    coarse_level: int = 0
    tile_ms: list = dataclasses.field(default_factory=list)  # from the last state to each tile
    tile_pixels: int = 0
    deferred: dict | None = None  # what a limit has put off, in place of the exact frame

    @property
    def frames_per_second(self):
        return len(self.latencies_ms) / self.seconds if self.seconds else 0

    def text(self):
        return (f'{self.frames_per_second:.1f} frames a second ({len(self.latencies_ms)} in {self.seconds:.1f} s)\n'
                f'state to frame: {median(self.latencies_ms):.0f} ms median, {percentile(self.latencies_ms, 0.95):.0f} '
                f'ms p95\n{median(self.heights_px):.0f} pixels high and {median(self.frame_bytes) / 1024:.0f} KiB, '
                f'median\n{self.refinement_text()}{self.end_text()}')

    def refinement_text(self):
        text = ''
        if self.levels:
            parts = [f'{count} of level {level}' for level, count in sorted(self.levels.items())]
            text += f'moving frames: {", ".join(parts)}\n'
        if self.coarse_ms is not None:
            text += f'level {self.coarse_level} in full size {self.coarse_ms:.0f} ms after the last state\n'
        if self.tile_ms:
            text += (f'{len(self.tile_ms)} tiles, the first {self.tile_ms[0]:.0f} ms and the last {self.tile_ms[-1]:.0f} '
                     f'ms after the last state\n')
        return text

    def end_text(self):
        if self.deferred:
            return (f'exact frame deferred {self.deferred["ms"]:.0f} ms after the last state: {self.deferred["bytes"]} '
                    f'bytes and {self.deferred["seconds"]:.1f} s expected\n')
        return (f'exact {self.exact_ms:.0f} ms after the last state, '
                f'{"" if self.exact_is_that_of_render else "NOT "}the bytes of RenderIsosurface\n')

    def figures(self, arguments):
        return {'isovalue': arguments.isovalue, 'frames_per_second': self.frames_per_second,
                'latency_ms': {'median': median(self.latencies_ms), 'p95': percentile(self.latencies_ms, 0.95)},
                'median_height_px': median(self.heights_px), 'median_frame_bytes': median(self.frame_bytes),
                'exact_ms': self.exact_ms, 'exact_is_that_of_render': self.exact_is_that_of_render,
                'frames_by_level': {str(level): count for level, count in sorted(self.levels.items())},
                'coarse_ms': self.coarse_ms, 'coarse_level': self.coarse_level, 'tile_ms': self.tile_ms,
                'deferred': self.deferred}


class Dragging:
    """A stream of view states, each a little further, and the frames that answer them.

    Frames of the first second do not count: meshes are extracted, and the server adapts its sizes.
    """

    WARM_UP_SECONDS = 1
    METHOD = '/isoscope.v1.InteractService/Interact'

    def __init__(self, client, dataset, arguments):
        self.client, self.dataset, self.arguments = client, dataset, arguments
        self.result = Drag()
        self.sent_ms = {}  # of each state
        self.counts = False
        self.last_state = None
        self.exact = None
        self.write_turn = asyncio.Lock()  # gRPC takes one message at a time

    def look(self, state):
        degrees = state * self.arguments.degrees / self.arguments.states
        return look_of(self.dataset, self.arguments, degrees)

    async def run(self):
        if self.arguments.refine and 'refinement' not in (await self.client.capabilities()).features:
            sys.exit(f'{sys.argv[0]}: the server has no refinement (GetCapabilities.features): leave --refine out')
        if not self.arguments.refine:  # a large volume would take long
            await self.dataset.render(**self.look(0))
        types = interact_service_pb2.InteractRequest, interact_service_pb2.InteractResponse
        interact = self.client._channel.get().stream_stream(
            self.METHOD, types[0].SerializeToString, types[1].FromString)
        self.stream = interact(timeout=self.arguments.seconds + self.arguments.patience + PATIENCE,
                               metadata=self.client._target.call_metadata())
        reader = asyncio.create_task(self.read())
        await self.drag()
        self.exact = await asyncio.wait_for(reader, self.arguments.patience)
        await self.stream.done_writing()
        if self.exact is not None:
            rendered = await self.dataset.render(**self.look(self.last_state), timeout=self.arguments.patience)
            self.result.exact_is_that_of_render = self.exact == rendered.png
        return self.result

    async def drag(self):
        start = time.perf_counter()
        seconds = self.WARM_UP_SECONDS + self.arguments.seconds
        for state in range(1, math.ceil(seconds * self.arguments.states) + 1):
            await asyncio.sleep(start + (state - 1) / self.arguments.states - time.perf_counter())
            await self.send(state)
            if not self.counts and time.perf_counter() - start >= self.WARM_UP_SECONDS:
                self.counts, counted_since = True, time.perf_counter()
        self.result.seconds = time.perf_counter() - counted_since
        self.counts, self.last_state = False, state

    async def send(self, state):
        request = interact_service_pb2.InteractRequest()
        view = request.view_state
        view.sequence_number = state
        view.frame.CopyFrom(_core.render(self.dataset, **self.look(state)).request.request)
        view.frame.with_notes = False
        view.target_frames_per_second = self.arguments.rate
        if self.arguments.refine:
            view.refinement.coarse_levels = view.refinement.tiles = True
            view.refinement.max_exact_bytes = self.arguments.max_exact_bytes
            if self.arguments.max_exact_seconds:
                view.refinement.max_exact_duration.FromNanoseconds(int(1e9 * self.arguments.max_exact_seconds))
        self.sent_ms[state] = now_ms()
        async with self.write_turn:
            await self.stream.write(request)

    async def acknowledge(self, response):
        """Says that a frame or a tile is shown, after it was decoded."""
        start_ms = now_ms()
        if self.arguments.decode:
            await asyncio.to_thread(decode, response)
        else:
            await asyncio.sleep(self.arguments.decode_ms / 1e3)
        decode_ms = now_ms() - start_ms if self.arguments.decode else self.arguments.decode_ms
        shown = interact_service_pb2.InteractRequest()
        shown.frame_shown.frame_number = response.frame_number
        shown.frame_shown.decode_duration.FromNanoseconds(int(decode_ms * 1e6))
        async with self.write_turn:
            await self.stream.write(shown)

    async def read(self):
        """Acknowledges frames and tiles; returns the exact picture of the last state, None if a limit has deferred it."""
        async for response in self.stream:
            if response.HasField('error'):
                sys.exit(f'{sys.argv[0]}: a frame has failed: {response.error.message}')
            if not response.HasField('exact_deferred'):
                await self.acknowledge(response)
            latency_ms = now_ms() - self.sent_ms[response.sequence_number]
            is_last = response.sequence_number == self.last_state
            if response.HasField('exact_deferred'):
                if is_last:
                    deferred = response.exact_deferred
                    self.result.deferred = {'bytes': deferred.expected_bytes, 'ms': latency_ms,
                                            'seconds': deferred.expected_duration.ToNanoseconds() / 1e9}
                    return None
            elif response.HasField('tile'):
                if is_last:
                    self.add_tile(response.tile, latency_ms)
            elif response.is_exact:
                if is_last:
                    self.result.exact_ms = latency_ms
                    self.check_tiles(response.frame)
                    return response.frame.png
            elif response.HasField('frame'):
                self.add_moving(response, latency_ms, is_last)
        sys.exit(f'{sys.argv[0]}: the stream has ended')

    def add_moving(self, response, latency_ms, is_last):
        frame, result = response.frame, self.result
        is_whole = frame.extent.width_px == self.arguments.width and frame.extent.height_px == self.arguments.height
        if is_last and is_whole and result.coarse_ms is None and frame.HasField('drawn_level'):
            result.coarse_ms, result.coarse_level = latency_ms, frame.drawn_level.level
        if self.counts:
            result.latencies_ms.append(latency_ms)
            result.heights_px.append(frame.extent.height_px)
            result.frame_bytes.append(len(frame.jpeg) + len(response.depth_grid.depths))
            if frame.HasField('drawn_level'):
                result.levels[frame.drawn_level.level] += 1

    def add_tile(self, tile, latency_ms):
        if tile.index != len(self.result.tile_ms):
            sys.exit(f'{sys.argv[0]}: tile {tile.index} came where {len(self.result.tile_ms)} was due')
        self.result.tile_ms.append(latency_ms)
        self.result.tile_pixels += tile.region.width_px * tile.region.height_px

    def check_tiles(self, frame):
        """Tiles that come once each and fill the picture have as many pixels as it."""
        pixels = frame.extent.width_px * frame.extent.height_px or self.arguments.width * self.arguments.height
        if self.result.tile_ms and self.result.tile_pixels != pixels:
            sys.exit(f'{sys.argv[0]}: the tiles have {self.result.tile_pixels} pixels, the picture has {pixels}')


def decode(response):
    """Decodes a frame or a tile as a client would, with VTK's readers, which call libjpeg and libpng."""
    from vtkmodules.vtkIOImage import vtkJPEGReader, vtkPNGReader
    data = response.tile.png or response.frame.png or response.frame.jpeg
    reader = vtkJPEGReader() if data == response.frame.jpeg else vtkPNGReader()
    reader.SetMemoryBuffer(data)
    reader.SetMemoryBufferLength(len(data))
    reader.Update()
    width, height, _ = reader.GetOutput().GetDimensions()
    if not width * height:
        sys.exit(f'{sys.argv[0]}: VTK has not decoded a frame of {len(data)} bytes')


async def drag(arguments):
    with server(arguments) as (address, _):
        async with isoscope.aio.connect(address) as client:
            dataset = await client.dataset(arguments.dataset)
            result = await Dragging(client, dataset, arguments).run()
            report(arguments, drawers_of(await client.agents()), result.figures(arguments), result.text())


# ---------------------------------------------------------------------------------------------- slider


@dataclasses.dataclass
class SliderPass:
    """The figures of one pass over the isovalues, without the first two, which allocate images, plans and buffers."""

    times_ms: list = dataclasses.field(default_factory=list)
    grown_mib: list = dataclasses.field(default_factory=list)  # growth of the server's resident memory in each frame
    kernel_ms: float = 0  # of all threads of the server, in all frames: the kernel counts in steps of 10 ms

    def figures(self):
        return {'median_ms': median(self.times_ms), 'p95_ms': percentile(self.times_ms, 0.95),
                'mean_kernel_ms': self.kernel_ms / max(len(self.times_ms), 1),
                'median_grown_mib': median(self.grown_mib)}


def describe_slider(passes, is_own_server, is_repeatable):
    text = f'{"isovalue":<16} {"median":>10} {"p95":>10}'
    text += f' {"in kernel":>10} {"new memory":>14}\n' if is_own_server else '\n'
    for name, one in zip(('for the first time', 'once more'), passes):
        of = one.figures()
        text += f'{name:<18} {of["median_ms"]:7.1f} ms {of["p95_ms"]:7.1f} ms'
        text += f' {of["mean_kernel_ms"]:7.1f} ms {of["median_grown_mib"]:9.1f} MiB\n' if is_own_server else '\n'
    return text + f'{"" if is_repeatable else "NOT "}the same bytes both times\n'


def kernel_ms_of(pid):
    fields = pathlib.Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return 1e3 * int(fields[12]) / os.sysconf('SC_CLK_TCK')


def resident_mib_of(pid):
    return int(pathlib.Path(f'/proc/{pid}/statm').read_text().split()[1]) * os.sysconf('SC_PAGE_SIZE') / 2**20


def slide(dataset, arguments, pid):
    """One pass, and its pictures."""
    one, pictures = SliderPass(), []
    for step in range(arguments.steps):
        if step == 2 and pid:
            one.kernel_ms = -kernel_ms_of(pid)
        time.sleep(arguments.pause_ms / 1e3)
        isovalue = arguments.isovalue + (arguments.to - arguments.isovalue) * step / (arguments.steps - 1)
        resident_mib, start_ms = resident_mib_of(pid) if pid else 0, now_ms()
        pictures.append(dataset.render(**{**look_of(dataset, arguments), 'isovalue': isovalue}).png)
        if step >= 2:
            one.times_ms.append(now_ms() - start_ms)
            one.grown_mib.append(resident_mib_of(pid) - resident_mib if pid else 0)
    one.kernel_ms += kernel_ms_of(pid) if pid else 0
    return one, pictures


async def slider(arguments):
    with server(arguments) as (address, pid), isoscope.connect(address) as client:
        dataset = client.dataset(arguments.dataset)
        (first, pictures), (second, same) = (slide(dataset, arguments, pid) for _ in range(2))
        report(arguments, drawers_of(client.agents()),
               {'isovalues': [arguments.isovalue, arguments.to], 'new': first.figures(), 'again': second.figures()},
               describe_slider((first, second), pid is not None, pictures == same))


# --------------------------------------------------------------------------------------------- clients


class CountingClient(isoscope.aio.Client):
    """A client that counts its refusals, and those that it tries again."""

    def __init__(self, target):
        super().__init__(target)
        self.refusals = self.retries = 0

    def _delay_after(self, error, call, retries):
        self.refusals += _retry.told_delay(error) is not None
        delay = super()._delay_after(error, call, retries)
        self.retries += 1
        return delay


@dataclasses.dataclass
class Round:
    """A round with one number of clients. A frame's time is that from its first attempt to its answer."""

    clients: int = 0
    seconds: float = 0
    times_ms: list = dataclasses.field(default_factory=list)  # of each client
    refusals: int = 0  # includes the warm-up, as all that follow
    retries: int = 0
    wrong: int = 0  # pictures with other bytes than the first one
    failed: int = 0  # frames that ended with an error
    first_error: str = ''

    def figures(self):
        times = [ms for of_client in self.times_ms for ms in of_client]
        counts = [len(of_client) for of_client in self.times_ms]
        return {'clients': self.clients, 'frames': len(times), 'frames_per_second': len(times) / self.seconds,
                **{f'p{share}_ms': percentile(times, share / 100) for share in (50, 95, 99)},
                'max_ms': max(times, default=0), 'most_frames': max(counts), 'least_frames': min(counts),
                'refusals': self.refusals, 'retries': self.retries, 'wrong': self.wrong, 'failed': self.failed}


def describe_rounds(rounds):
    text = ''.join(f'{name:>{width}} ' for name, width in (
        ('clients', 7), ('frames/s', 9), ('p50 ms', 9), ('p95 ms', 9), ('p99 ms', 9), ('max ms', 9),
        ('a client got', 15), ('refusals', 9), ('retries', 9), ('wrong', 6), ('failed', 6)))[:-1] + '\n'
    for of in (one.figures() for one in rounds):
        got = f'{of["least_frames"]} to {of["most_frames"]}'
        text += (f'{of["clients"]:7d} {of["frames_per_second"]:9.1f} {of["p50_ms"]:9.0f} {of["p95_ms"]:9.0f} '
                 f'{of["p99_ms"]:9.0f} {of["max_ms"]:9.0f} {got:>15} {of["refusals"]:9d} {of["retries"]:9d} '
                 f'{of["wrong"]:6d} {of["failed"]:6d}\n')
    return text + ''.join(f'{one.clients} clients, first error: {one.first_error}\n' for one in rounds if one.first_error)


async def ask(client, look, picture, begin, end, result):
    """Requests frames until `end`. Those count that end after `begin`, and before `end`."""
    dataset = await client.dataset(look['dataset'])
    look = {name: value for name, value in look.items() if name != 'dataset'}
    times_ms = []
    result.times_ms.append(times_ms)
    while (start := time.perf_counter()) < end:
        try:
            frame = await dataset.render(**look)
        except isoscope.IsoscopeError as error:
            result.failed += 1
            result.first_error = result.first_error or str(error)
            await asyncio.sleep(0.1)  # limits the rate of immediate errors
            continue
        result.wrong += frame.png != picture
        if begin <= (done := time.perf_counter()) < end:
            times_ms.append(1e3 * (done - start))


async def run_round(count, address, look, picture, arguments):
    target, _ = _core.connection(address)
    result = Round(clients=count, seconds=arguments.seconds)
    crowd = [CountingClient(target) for _ in range(count)]
    begin = time.perf_counter() + arguments.warm_up
    await asyncio.gather(*(ask(one, look, picture, begin, begin + arguments.seconds, result) for one in crowd))
    for one in crowd:
        result.refusals += one.refusals
        result.retries += one.retries
        await one.close()
    return result


async def clients(arguments):
    with isoscope.connect(arguments.server) as client:
        dataset = client.dataset(arguments.dataset)
        look = look_of(dataset, arguments)
        picture = dataset.render(**look).png
    rounds = [await run_round(count, arguments.server, {**look, 'dataset': dataset.name}, picture, arguments)
              for count in arguments.clients]
    report(arguments, {}, {'isovalues': [arguments.isovalue], 'seconds': arguments.seconds,
                           'rounds': [one.figures() for one in rounds]}, describe_rounds(rounds))
    for one in rounds:
        if one.failed + one.wrong:
            sys.exit(f'with {one.clients} clients {one.failed} frames failed and {one.wrong} pictures had other bytes than '
                     'the first one: must be 0')


# ---------------------------------------------------------------------------------------------- cancel


@dataclasses.dataclass
class Cancels:
    """The figures of cancelled frames; those that were complete before their moment are only counted."""

    cold_ms: float = 0  # of whole frames
    following_ms: float = 0
    complete_count: int = 0
    frames: list = dataclasses.field(default_factory=list)  # dicts: cold, moment_ms, answer_ms, idle_ms

    def text(self):
        rows = [['frames', 'cancels', 'idle ms, median', 'p99', 'max', 'answer ms, median', 'p99', 'max']]
        for name, kinds in ('cold', (True,)), ('following', (False,)), ('all', (True, False)):
            chosen = [frame for frame in self.frames if frame['cold'] in kinds]
            rows.append([name, str(len(chosen))])
            for figure in 'idle_ms', 'answer_ms':
                values = [frame[figure] for frame in chosen]
                rows[-1] += [f'{value:.2f}' if values else '-'
                             for value in (median(values), percentile(values, 0.99), percentile(values, 1))]
        widths = [max(map(len, column)) for column in zip(*rows)]
        return ''.join(f'{row[0]:<{widths[0]}}  ' + '  '.join(map(str.rjust, row[1:], widths[1:])) + '\n' for row in rows)

    def figures(self, arguments):
        idle_ms = [frame['idle_ms'] for frame in self.frames]
        return {'isovalue': arguments.isovalue, 'seed': arguments.seed, 'cold_ms': self.cold_ms,
                'following_ms': self.following_ms, 'complete_count': self.complete_count,
                'idle_ms': {'median': median(idle_ms), 'p99': percentile(idle_ms, 0.99), 'max': max(idle_ms, default=0)},
                'frames': self.frames}


class Gauges:
    """The numbers of frames in work of some agents, by their metrics. A look takes some 2 ms an agent."""

    LINE = re.compile(rb'^isoscope_agent_frames_in_work(?:{[^}]*})? (\S+)', re.MULTILINE)
    # A cancelled frame may still be on its way from the coordinator to an agent.
    QUIET_MS = 5

    def __init__(self, addresses):
        self.connections = [http.client.HTTPConnection(address) for address in addresses]

    def frames_in_work(self):
        total = 0
        for connection in self.connections:
            connection.request('GET', '/metrics')
            total += float(self.LINE.search(connection.getresponse().read())[1])
        return total

    def await_idle(self, since_ms):
        """The time when no agent had a frame in work any more; `since_ms` if none had one all the time."""
        idle_ms, was_busy = since_ms, False
        while was_busy or now_ms() - idle_ms < self.QUIET_MS:
            is_busy = self.frames_in_work() > 0
            if was_busy and not is_busy:
                idle_ms = now_ms()
            was_busy = is_busy
            if is_busy and now_ms() - since_ms > 1e3 * PATIENCE:
                sys.exit(f'agents still had frames in work {PATIENCE} s after the frame was cancelled')
        return idle_ms


class Cancelling:
    """Cancels frames of a cluster, which is restarted before every `frames_per_start`-th one.

    One whole frame warms the page cache. Then a new cluster renders a cold frame, and a few more, whose median is the
    time of a following one. A frame is cancelled at a random share of its kind's time.
    """

    ORBIT_DEGREES = 7
    FOLLOWING_FRAMES = 3
    MAX_ATTEMPTS_PER_CANCEL = 10

    def __init__(self, arguments, folder):
        self.arguments, self.folder = arguments, folder
        self.result = Cancels()
        self.random = random.Random(arguments.seed)
        self.frame_count = 0
        self.stack = contextlib.AsyncExitStack()

    async def start_cluster(self):
        await self.stack.aclose()
        flags = ['--renderer', self.arguments.renderer, '--threads', str(self.arguments.threads)]
        address, metrics = self.stack.enter_context(cluster(self.arguments.bin, self.folder, flags, settling_seconds=0))
        self.client = await self.stack.enter_async_context(isoscope.aio.connect(address))
        self.dataset = await self.client.dataset()
        self.gauges = Gauges(metrics)

    async def render(self):
        self.frame_count += 1
        look = look_of(self.dataset, self.arguments, self.frame_count * self.ORBIT_DEGREES)
        await self.dataset.render(**look, timeout=3600)

    async def time_of_frame(self):
        start_ms = now_ms()
        await self.render()
        return now_ms() - start_ms

    async def run(self):
        async with contextlib.AsyncExitStack() as at_end:
            at_end.push_async_callback(self.stack.aclose)
            await self.start_cluster()
            await self.render()
            await self.start_cluster()
            drawers = drawers_of(await self.client.agents())
            self.result.cold_ms = await self.time_of_frame()
            self.result.following_ms = median([await self.time_of_frame() for _ in range(self.FOLLOWING_FRAMES)])
            for attempt in range(self.arguments.cancels * self.MAX_ATTEMPTS_PER_CANCEL):
                is_cold = attempt % self.arguments.frames_per_start == 0
                if is_cold:
                    await self.start_cluster()
                await self.cancel_one(is_cold)
                if len(self.result.frames) == self.arguments.cancels:
                    return drawers, self.result
        sys.exit(f'only {len(self.result.frames)} frames were not complete before they were to be cancelled; take a '
                 'larger volume')

    async def cancel_one(self, is_cold):
        """Requests a frame, cancels it and waits until the agents are idle."""
        expected_ms = self.result.cold_ms if is_cold else self.result.following_ms
        start_ms = now_ms()
        call = asyncio.create_task(self.render())
        await asyncio.sleep(self.random.random() * expected_ms / 1e3)
        cancelled_ms = now_ms()
        call.cancel()
        answered_ms, idle_ms = await asyncio.gather(self.answered(call),
                                                    asyncio.to_thread(self.gauges.await_idle, cancelled_ms))
        if answered_ms is None:
            self.result.complete_count += 1
        else:
            self.result.frames.append({
                'cold': is_cold, 'moment_ms': cancelled_ms - start_ms, 'answer_ms': answered_ms - cancelled_ms,
                'idle_ms': idle_ms - cancelled_ms})

    @staticmethod
    async def answered(call):
        """The time when a cancelled call has returned; None if it was complete before."""
        try:
            await call
        except asyncio.CancelledError:
            return now_ms()
        return None


async def cancel(arguments):
    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(arguments.input)
        if not (folder / 'manifest.json').exists():
            folder = pathlib.Path(scratch) / 'dataset'
            subprocess.run([arguments.bin / 'isoscope', 'partition', arguments.input, '--output', folder, '--quiet',
                            '--shards', str(arguments.shards)], check=True)
        drawers, result = await Cancelling(arguments, folder).run()
        report(arguments, drawers, result.figures(arguments),
               f'a whole frame takes {result.cold_ms:.1f} ms cold, {result.following_ms:.1f} ms following\n\n{result.text()}')


# ------------------------------------------------------------------------------------------- arguments


def number_in(least, most, kind=float):
    def parse(text):
        if not least <= kind(text) <= most:
            raise argparse.ArgumentTypeError(f'is {text}: must lie in [{least}, {most}]')
        return kind(text)

    return parse


def list_of_counts(text):
    return [number_in(1, 1000, int)(part) for part in text.split(',')]


def make_parser():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measures = parser.add_subparsers(required=True, metavar='drag|slider|clients|cancel')

    def add(measure, azimuth=0, elevation=0):
        one = measures.add_parser(measure.__name__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
        one.set_defaults(measure=measure, input=None, server=None, dataset='')
        one.add_argument('--isovalue', type=float, required=True)
        one.add_argument('--azimuth', type=float, default=azimuth)
        one.add_argument('--elevation', type=float, default=elevation)
        one.add_argument('--width', type=number_in(1, 65536, int), default=1024)
        one.add_argument('--height', type=number_in(1, 65536, int), default=1024)
        level = one.add_mutually_exclusive_group()
        level.add_argument('--level', type=number_in(0, 23, int), help='of the dataset that is drawn')
        level.add_argument('--max-spacing', type=number_in(0, math.inf), metavar='PX',
                           help='the coarsest level whose samples are at most so many pixels apart')
        one.add_argument('--renderer', choices=['auto', 'egl', 'cpu'], default='auto', help='of agents that are started')
        one.add_argument('--bin', type=pathlib.Path, default=os.environ.get('ISOSCOPE_BIN', ROOT / 'build/release/bin'),
                         help='folder of the programs that are started')
        one.add_argument('--json', metavar='FILE', help='where the figures go')
        return one

    def add_server(one):
        one.add_argument('input', nargs='?', metavar='INPUT|DIR', help='what isoscope serve takes')
        one.add_argument('--server', metavar='HOST:PORT', help='a coordinator, instead')
        one.add_argument('--dataset', default='', help='its name, where the server has several')

    one = add(drag)
    add_server(one)
    one.add_argument('--seconds', type=number_in(1, 3600), default=10, help='how long to drag')
    one.add_argument('--rate', type=number_in(1, 120), default=30,
                     help='frames a second that the server aims for; 1 keeps the full size')
    one.add_argument('--states', type=number_in(1, 1000), default=60, help='views a second that the client sends')
    one.add_argument('--degrees', type=float, default=60, help='degrees a second')
    one.add_argument('--decode-ms', type=number_in(0, 1000), default=0, help='time that the client takes to decode a frame')
    one.add_argument('--decode', action='store_true', help='decode each frame in place of that, with VTK (python3-vtk9)')
    one.add_argument('--refine', action='store_true',
                     help='moving frames may be of coarser levels, and the frame at rest comes in tiles')
    one.add_argument('--max-exact-bytes', type=number_in(0, 2**62, int), default=0,
                     help='with --refine: a limit of what the exact frame reads; 0: none')
    one.add_argument('--max-exact-seconds', type=number_in(0, 1e6), default=0,
                     help='with --refine: a limit of the time that the exact frame is expected to take; 0: none')
    one.add_argument('--patience', type=number_in(1, 1e5), default=PATIENCE, help='seconds to wait for the exact frame')

    one = add(slider)
    add_server(one)
    one.add_argument('--to', type=float, required=True, help='isovalue where the slider ends; it begins at --isovalue')
    one.add_argument('--steps', type=number_in(4, 10000, int), default=20, help='number of isovalues')
    one.add_argument('--pause-ms', type=number_in(0, 10000), default=0, help='pause between frames')

    one = add(clients)
    one.add_argument('--server', metavar='HOST:PORT', required=True, help='the coordinator that the clients ask')
    one.add_argument('--dataset', default='', help='its name, where the server has several')
    one.add_argument('--clients', type=list_of_counts, default='4,16,64', help='numbers of clients, a round for each')
    one.add_argument('--seconds', type=number_in(1, 3600), default=15, help='of a round')
    one.add_argument('--warm-up', type=number_in(0, 3600), default=2, help='seconds before it, not counted')

    one = add(cancel, azimuth=30, elevation=20)
    one.add_argument('input', metavar='INPUT|DIR', help='what isoscope partition takes, or a dataset folder')
    one.add_argument('--shards', type=number_in(1, 65536, int), default=1, help='of a volume: one agent each')
    one.add_argument('--cancels', type=number_in(1, 1000000, int), default=500, help='frames to cancel')
    one.add_argument('--frames-per-start', type=number_in(1, 1000000, int), default=5,
                     help='frames before the cluster is started anew; the first of them is cold')
    one.add_argument('--seed', type=int, default=1, help='of the moments at which frames are cancelled')
    one.add_argument('--threads', type=number_in(0, 1024, int), default=0, help='threads of each agent; 0: one a core')
    return parser


def main():
    parser = make_parser()
    arguments = parser.parse_args()
    if arguments.measure in (drag, slider) and (arguments.input is None) == (arguments.server is None):
        parser.error('give a volume, a dataset folder or --server')
    if arguments.measure is drag and not arguments.refine and (arguments.max_exact_bytes or arguments.max_exact_seconds):
        parser.error('--max-exact-bytes and --max-exact-seconds are limits of --refine')
    if arguments.json:
        open(arguments.json, 'a', encoding='utf-8').close()  # fails before the measurement
    try:
        asyncio.run(arguments.measure(arguments))
    except isoscope.IsoscopeError as error:
        sys.exit(f'{sys.argv[0]}: {error}')
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == '__main__':
    main()
