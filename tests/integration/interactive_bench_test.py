"""bench/interactive.py: its reports, and short measurements of real programs.

tests/clients/python/run_tests.py runs this with an interpreter that has gRPC.
"""

import json
import os
import pathlib
import re
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAMS = pathlib.Path(os.environ.get('ISOSCOPE_BIN', ROOT / 'build/release/bin'))
BENCH = ROOT / 'bench/interactive.py'
SMALL = ['--isovalue', '128', '--width', '128', '--height', '128']

sys.path.insert(0, str(BENCH.parent))
import cluster_frames  # noqa: E402
import interactive  # noqa: E402


# ------------------------------------------------------------------------------------------- reports


def figures(of, *arguments):
    """What a result has of a call with these arguments, as JSON has it."""
    return json.loads(json.dumps(of.figures(interactive.make_parser().parse_args([*arguments, '--isovalue', '60']))))


def test_a_percentile_is_the_smallest_value_that_its_share_does_not_exceed():
    assert interactive.percentile([], 0.99) == 0
    assert interactive.percentile([7], 0.01) == 7
    assert interactive.percentile([4, 1, 3, 2], 0.5) == 2
    assert interactive.percentile([4, 1, 3, 2], 0.51) == 3
    assert interactive.percentile([4, 1, 3, 2], 1) == 4
    assert interactive.percentile(range(1, 101), 0.99) == 99
    assert interactive.median([]) == 0


class Camera:
    def azimuth(self, degrees):
        return ('azimuth', degrees)


class Dataset:
    def camera(self, view, azimuth, elevation):
        return Camera()


@pytest.mark.parametrize('flags, words', [([], {}), (['--level', '0'], {'level': 0}), (['--level', '2'], {'level': 2}),
                                          (['--max-spacing', '1.1'], {'max_spacing': 1.1})])
def test_frames_ask_for_the_level_that_is_given_and_for_none_without(flags, words):
    arguments = interactive.make_parser().parse_args(['drag', 'head', '--isovalue', '60', *flags])
    assert interactive.look_of(Dataset(), arguments, 3) == {
        'isovalue': 60, 'camera': ('azimuth', 3), 'size': (1024, 1024), **words}


def test_a_level_and_a_spacing_exclude_each_other(capsys):
    with pytest.raises(SystemExit):
        interactive.make_parser().parse_args(['drag', 'head', '--isovalue', '60', '--level', '1', '--max-spacing', '2'])
    assert 'not allowed with' in capsys.readouterr().err


def dragged(is_exact=True):
    return interactive.Drag(seconds=2, latencies_ms=[10, 30, 20], heights_px=[512, 1024, 1024],
                            frame_bytes=[2048, 1024, 4096], exact_ms=150, exact_is_that_of_render=is_exact)


def test_the_text_of_a_drag_says_rate_latency_size_and_whether_the_exact_frame_is_exact():
    text = dragged().text()
    assert '1.5 frames a second (3 in 2.0 s)' in text
    assert '20 ms median, 30 ms p95' in text
    assert '1024 pixels high and 2 KiB' in text
    assert 'exact 150 ms after the last state, the bytes' in text
    assert 'NOT the bytes' in dragged(is_exact=False).text()
    assert '0.0 frames a second' in interactive.Drag().text()


def test_the_text_of_a_view_that_refines_says_levels_tiles_and_what_a_limit_deferred():
    refined = dragged()
    refined.levels.update([2, 3, 2])
    refined.coarse_ms, refined.coarse_level, refined.tile_ms = 80, 1, [200, 900]
    text = refined.text()
    assert 'moving frames: 2 of level 2, 1 of level 3' in text
    assert 'level 1 in full size 80 ms after' in text
    assert '2 tiles, the first 200 ms and the last 900 ms' in text
    assert 'level' not in dragged().text()
    refined.deferred = {'bytes': 5000, 'ms': 120, 'seconds': 2.5}
    assert 'deferred 120 ms after the last state: 5000 bytes and 2.5 s expected' in refined.text()
    assert figures(refined, 'drag', 'head')['frames_by_level'] == {'2': 2, '3': 1}


def test_limits_of_the_exact_frame_need_refinement():
    assert 'are limits of --refine' in refusal('drag', 'head', *SMALL, '--max-exact-bytes', '5')


def test_the_json_of_a_drag_has_the_same_figures():
    of = figures(dragged(), 'drag', 'head')
    assert (of['frames_per_second'], of['latency_ms']) == (1.5, {'median': 20, 'p95': 30})
    assert (of['median_height_px'], of['isovalue']) == (1024, 60)


def slid():
    return (interactive.SliderPass([40, 20, 30], [2, 0, 1], 9), interactive.SliderPass([10, 12, 14], [0, 0, 0], 3))


def test_the_text_of_a_slider_has_a_row_for_each_pass():
    text = interactive.describe_slider(slid(), True, True)
    assert 'for the first time    30.0 ms    40.0 ms     3.0 ms       1.0 MiB' in text
    assert 'once more             12.0 ms    14.0 ms     1.0 ms       0.0 MiB' in text
    assert '\nthe same bytes both times' in text
    assert 'NOT the same bytes' in interactive.describe_slider(slid(), True, False)


def test_the_memory_of_a_remote_server_is_not_guessed():
    assert 'MiB' not in interactive.describe_slider(slid(), False, True)


def test_the_json_of_a_slider_has_the_same_figures():
    first, second = (one.figures() for one in slid())
    assert (first['median_ms'], first['median_grown_mib'], second['p95_ms']) == (30, 1, 14)


def rounds():
    few = interactive.Round(clients=4, seconds=15, times_ms=[[90.0] * 151, [90.0] * 149])
    many = interactive.Round(clients=64, seconds=15, times_ms=few.times_ms, refusals=77, retries=76)
    return [few, many]


def test_the_text_of_clients_has_a_row_for_each_round():
    text = interactive.describe_rounds(rounds())
    assert '      4      20.0        90        90        90' in text
    assert '149 to 151' in text
    assert '77        76      0      0\n' in text
    assert 'error' not in text


def test_the_first_error_of_a_round_is_said():
    failed = rounds()
    failed[1].failed, failed[1].first_error = 3, 'UNAVAILABLE: gone'
    assert '64 clients, first error: UNAVAILABLE: gone' in interactive.describe_rounds(failed)


def test_the_json_of_clients_has_the_same_figures():
    of = rounds()[1].figures()
    assert (of['clients'], of['refusals'], of['p99_ms'], of['frames']) == (64, 77, 90, 300)


def test_cold_and_following_cancelled_frames_are_apart():
    result = interactive.Cancels(frames=[
        {'cold': i % 2 == 0, 'moment_ms': 1, 'answer_ms': 0.5, 'idle_ms': float(i)} for i in range(1, 201)])
    lines = result.text().splitlines()
    assert re.match('cold +100 +101.00 +198.00 +200.00 .*', lines[1])
    assert re.match('following +100 +100.00 +197.00 +199.00 .*', lines[2])
    assert re.fullmatch('all +200 +100.50 +198.00 +200.00 +0.50 +0.50 +0.50', lines[3])
    of = figures(result, 'cancel', 'head')
    assert (of['isovalue'], of['idle_ms']['median'], of['idle_ms']['p99']) == (60, 100.5, 198)
    assert (len(of['frames']), of['frames'][1]['cold']) == (200, True)
    del result.frames[1:]
    assert re.match('cold +0 +- ', result.text().splitlines()[1])


# ------------------------------------------------------------------------------------------ programs


def bench(measure, *arguments):
    command = [sys.executable, BENCH, measure, *arguments, '--bin', PROGRAMS]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def measured(tmp_path, *arguments):
    """The text and the JSON of a measurement."""
    done = bench(*arguments, '--json', tmp_path / 'bench.json')
    assert done.returncode == 0, done.stderr
    assert re.match(r'.* cores?, .* UTC\n.*interactive.py ' + arguments[0], done.stdout)
    return done.stdout, json.loads((tmp_path / 'bench.json').read_text())


def refusal(*arguments):
    done = bench(*arguments)
    assert done.returncode == 2
    return done.stderr


@pytest.fixture(scope='module')
def volume(tmp_path_factory):
    path = tmp_path_factory.mktemp('volume') / 'gyroid.nrrd'
    subprocess.run([PROGRAMS / 'isoscope', 'generate', 'gyroid', '--dims', '43,37,29', '--type', 'uint8', '--output', path,
                    '--quiet'], check=True)
    return path


@pytest.fixture(scope='module')
def dataset(volume):
    path = volume.parent / 'dataset'
    subprocess.run([PROGRAMS / 'isoscope', 'partition', volume, '--output', path, '--shards', '2', '--block-cells', '8',
                    '--quiet'], check=True)
    return path


def test_cancelled_frames_leave_agents_idle(volume, tmp_path):
    text, of = measured(tmp_path, 'cancel', volume, '--isovalue', '128', '--shards', '2', '--cancels', '7',
                        '--frames-per-start', '3', '--width', '256', '--height', '256', '--renderer', 'cpu')
    assert '2 agents' in text and 'idle ms, median' in text
    assert (len(of['frames']), of['agents']) == (7, 2)
    assert of['cold_ms'] > 0
    assert all(frame['moment_ms'] >= 0 and frame['answer_ms'] >= 0 for frame in of['frames'])
    last_idle_ms = max(frame['idle_ms'] for frame in of['frames'])
    assert of['idle_ms']['max'] == last_idle_ms
    assert last_idle_ms < 60_000, 'agents go on with frames that nobody waits for'
    assert '--isovalue' in refusal('cancel', volume, '--cancels', '7')


def test_a_dataset_that_is_not_there_is_an_error(tmp_path):
    done = bench('cancel', tmp_path / 'absent', '--isovalue', '128')
    assert done.returncode == 1
    assert 'NOT_FOUND' in done.stderr


def test_a_drag_ends_in_the_bytes_of_render_isosurface(dataset, tmp_path):
    text, of = measured(tmp_path, 'drag', dataset, *SMALL, '--seconds', '1', '--renderer', 'cpu')
    assert 'frames a second' in text
    assert ', the bytes of RenderIsosurface' in text
    assert of['frames_per_second'] > 0
    assert (of['agents'], of['volume']) == (2, 'dataset')
    assert 'is 0: must lie in [1, 120]' in refusal('drag', dataset, *SMALL, '--rate', '0')


def test_a_slider_gets_the_same_bytes_of_the_same_isovalues(dataset, tmp_path):
    text, of = measured(tmp_path, 'slider', dataset, *SMALL, '--to', '140', '--steps', '4', '--renderer', 'cpu')
    assert 'new memory' in text and '\nthe same bytes both times' in text
    assert of['new']['median_ms'] > 0
    assert of['isovalues'] == [128, 140]


def test_clients_that_retry_as_told_are_all_served_and_none_is_wrong(dataset, tmp_path):
    """More clients than the coordinator has places."""
    few_places = ['--max-concurrent-frames', '1', '--max-queued-frames', '2']
    with cluster_frames.cluster(PROGRAMS, dataset, settling_seconds=0, coordinator_flags=few_places) as (address, _):
        text, of = measured(tmp_path, 'clients', '--server', address, '--isovalue', '128', '--clients', '2,12',
                            '--seconds', '3', '--width', '256', '--height', '256')
    assert 'refusals' in text
    assert of['server'] == address
    assert len(of['rounds']) == 2
    for one in of['rounds']:
        assert one['frames'] > 0
        assert one['least_frames'] > 0, 'a client was starved'
        assert (one['failed'], one['wrong']) == (0, 0)
        assert one['refusals'] == one['retries'], 'each refusal is followed by another try'
    assert of['rounds'][0]['refusals'] == 0
    assert of['rounds'][1]['refusals'] > 0
    assert '--server' in refusal('clients', '--isovalue', '128')
    assert 'unrecognized arguments' in refusal('clients', dataset, '--server', address, '--isovalue', '128')


def test_a_file_that_can_not_be_written_is_found_before_anything_is_measured(dataset):
    done = bench('drag', dataset, *SMALL, '--seconds', '3600', '--json', '/no/such/folder/a.json')
    assert done.returncode == 1
    assert '/no/such/folder' in done.stderr
