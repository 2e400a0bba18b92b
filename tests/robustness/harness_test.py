"""Tests of the harness where it could fool us: what it plants must be found, what it says must be so."""

import concurrent.futures
import contextlib
import os
import pathlib
import socket
import sys
import tempfile
import threading
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import robustness  # noqa: E402

try:
    from robustness import cluster, documented, faults, model, pool, quiet, report, schedule
    from robustness.load import Load
    from robustness.proxy import Corrupter
except ImportError as error:
    robustness.try_another_python(error)

import grpc_services  # noqa: E402


METHODS = {
    "RenderIsosurface", "RenderIsosurfaceStream", "Interact", "PickSurface", "ExportIsosurface", "GetHistogram",
}  # fmt: skip


class ScheduleTest(unittest.TestCase):
    TOPOLOGY = schedule.Topology(2, 2, 2)

    def test_is_a_function_of_the_seed(self):
        first = schedule.make_schedule(7, 300, self.TOPOLOGY)
        self.assertEqual(first, schedule.make_schedule(7, 300, self.TOPOLOGY))
        self.assertNotEqual(first, schedule.make_schedule(8, 300, self.TOPOLOGY))
        # More faults begin as fewer do.
        self.assertEqual(first[:100], schedule.make_schedule(7, 100, self.TOPOLOGY))

    def test_hits_a_target_only_when_it_is_well(self):
        for at_once in (1, 3, 8):
            ends, storm = {}, 0
            for fault in schedule.make_schedule(3, 1000, self.TOPOLOGY, at_once=at_once, rate=5):
                if fault.storm != storm:
                    ends, storm = {}, fault.storm
                self.assertGreaterEqual(fault.start_s + 0.001, ends.get(fault.target, 0), fault)
                self.assertLess(sum(end > fault.start_s + 0.001 for end in ends.values()), at_once, fault)
                ends[fault.target] = fault.start_s + fault.duration_s

    def test_has_every_kind_and_every_target(self):
        all_faults = schedule.make_schedule(1, 3000, self.TOPOLOGY)
        self.assertEqual({fault.kind for fault in all_faults}, set(schedule.KINDS))
        targets = schedule.targets_of(self.TOPOLOGY)
        self.assertEqual({fault.target for fault in all_faults}, set().union(*targets.values()))
        for fault in all_faults:
            self.assertIn(fault.target, targets[schedule.KINDS[fault.kind].target])

    def test_every_kind_has_an_action(self):
        for kind in schedule.KINDS:
            self.assertTrue(hasattr(faults.Injector, f"_{kind}") or hasattr(faults.Injector, "_" + kind.split("_")[0]))

    def test_refuses_what_is_no_kind(self):
        with self.assertRaisesRegex(ValueError, "no kind of fault: nonsense; there are"):
            schedule.make_schedule(1, 1, self.TOPOLOGY, ["nonsense"])


class DrawTest(unittest.TestCase):
    TOPOLOGY = schedule.Topology(3, 2, 1)

    def test_is_a_function_of_the_seed(self):
        draws = cluster.draw_agents(7, self.TOPOLOGY, 150)
        self.assertEqual(draws, cluster.draw_agents(7, self.TOPOLOGY, 150))
        self.assertNotEqual(draws, cluster.draw_agents(8, self.TOPOLOGY, 150))
        self.assertEqual(list(draws), self.TOPOLOGY.agents())

    def test_each_shard_has_an_agent_of_one_thread_and_one_of_many(self):
        draws = cluster.draw_agents(1, self.TOPOLOGY, 0)
        for shard in range(self.TOPOLOGY.shards):
            self.assertEqual({draws[f"a{shard}.{replica}"].threads for replica in range(2)}, {1, 8})

    def test_limits_are_tight_but_enough(self):
        for least in (0, 209, 10_000):
            limits = [d.limit_mib for seed in range(50) for d in cluster.draw_agents(seed, self.TOPOLOGY, least).values()]
            lowest = min(max(least, cluster.LEAST_AGENT_MIB), cluster.MEMORY_LIMIT_MIB)
            self.assertGreater(limits.count(lowest), len(limits) / 3)
            self.assertEqual(min(limits), lowest)
            self.assertLessEqual(max(limits), cluster.MEMORY_LIMIT_MIB)

    def test_least_limit_is_that_of_the_request_that_needs_most(self):
        frame = pool.pb.RenderIsosurfaceRequest(samples=4, max_layers=3)
        frame.viewport.width_px, frame.viewport.height_px = 256, 100
        requests = [pool.Request("r", "RenderIsosurface", frame, "r")]
        self.assertEqual(pool.least_agent_mib(requests), 20)  # 102400 * 32 * 32 / 5 bytes
        frame.surfaces.add().color.alpha = 0.5
        self.assertEqual(pool.least_agent_mib(requests), 80)
        stream = pool.pb.RenderIsosurfaceStreamRequest(request=frame)
        self.assertEqual(pool.least_agent_mib([pool.Request("s", "RenderIsosurfaceStream", stream, "s")]), 80)


def differing_bits(a, b):
    return sum((x ^ y).bit_count() for x, y in zip(a, b))


class CorrupterTest(unittest.TestCase):
    DATA = bytes(range(256)) * 400

    def test_flips_as_many_bits_as_it_says_wherever_the_data_are_cut(self):
        whole = Corrupter(500, seed=4)
        expected = whole(self.DATA)
        self.assertGreater(whole.flipped, 100)
        self.assertEqual(differing_bits(expected, self.DATA), whole.flipped)
        pieces = Corrupter(500, seed=4)
        self.assertEqual(b"".join(pieces(self.DATA[at : at + 77]) for at in range(0, len(self.DATA), 77)), expected)

    def test_flips_nothing_before_its_time(self):
        corrupter = Corrupter(1e12, seed=4)
        self.assertIs(corrupter(self.DATA), self.DATA)
        self.assertEqual(corrupter.flipped, 0)


class ProxyTest(unittest.TestCase):
    """The real process, between a client and an echo."""

    def setUp(self):
        self.server = socket.create_server(("127.0.0.1", 0))
        threading.Thread(target=self._echo, daemon=True).start()
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.proxy = cluster.ProxyClient()
        self.addCleanup(self.proxy.close)
        self.addCleanup(self.server.close)
        self.proxy("open", link="x", port=self.port, to=self.server.getsockname()[1])

    def _echo(self):
        def pass_back(connection):
            with contextlib.suppress(OSError), connection:
                while data := connection.recv(65536):
                    connection.sendall(data)

        with contextlib.suppress(OSError):
            while True:
                threading.Thread(target=pass_back, args=(self.server.accept()[0],), daemon=True).start()

    @staticmethod
    def _send_all(connection, data):
        with contextlib.suppress(OSError):
            connection.sendall(data)

    def _send(self, data, connection=None):
        with contextlib.ExitStack() as stack:
            if connection is None:
                connection = stack.enter_context(socket.create_connection(("127.0.0.1", self.port)))
            connection.settimeout(30)
            threading.Thread(target=self._send_all, args=(connection, data), daemon=True).start()
            back = b""
            while len(back) < len(data):
                piece = connection.recv(65536)
                if not piece:
                    raise ConnectionResetError
                back += piece
            return back

    def test_passes_bytes_on_as_they_are_also_slowly(self):
        data = os.urandom(300_000)
        self.assertEqual(self._send(data), data)
        self.proxy("set", link="x", delay_s=0.001, bytes_per_s=5e6)
        self.assertEqual(self._send(data), data)
        self.assertEqual(self.proxy("counts")["flipped"]["x"], 0)

    def test_corrupts_as_many_bits_as_it_says(self):
        data = bytes(500_000)
        self.proxy("set", link="x", flip_every=10_000, seed=3)
        back = self._send(data)
        flipped = self.proxy("counts")["flipped"]["x"]
        self.assertGreater(flipped, 10)
        self.assertEqual(differing_bits(back, data), flipped)
        self.proxy("set", link="x", flip_every=0)
        self.assertEqual(self._send(data), data)

    def test_moves_nothing_while_it_is_stalled_and_all_of_it_afterwards(self):
        connection = socket.create_connection(("127.0.0.1", self.port))
        self.addCleanup(connection.close)
        self.assertEqual(self._send(b"ping", connection), b"ping")
        self.proxy("set", link="x", stalled=True)
        connection.sendall(b"held")
        connection.settimeout(0.3)
        with self.assertRaises(TimeoutError):
            connection.recv(4)
        self.proxy("set", link="x", stalled=False)
        connection.settimeout(30)
        self.assertEqual(connection.recv(4), b"held")

    def test_cut_resets_connections_and_refuses_new_ones(self):
        connection = socket.create_connection(("127.0.0.1", self.port))
        self.addCleanup(connection.close)
        self.assertEqual(self._send(b"ping", connection), b"ping")
        self.proxy("set", link="x", refuse=True)
        self.proxy("cut", link="x")
        with self.assertRaises(ConnectionError):
            self._send(b"ping", connection)
        with self.assertRaises(ConnectionError):
            self._send(b"ping")
        self.proxy("set", link="x", refuse=False)
        self.assertEqual(self._send(b"ping"), b"ping")

    def test_says_which_command_it_does_not_know(self):
        with self.assertRaisesRegex(cluster.HarnessError, "no command: dance"):
            self.proxy("dance", link="x")


class DocumentedTest(unittest.TestCase):
    def test_reads_bullets_and_follows_as(self):
        codes = documented.parse(
            "  // Draws.\n  //\n  // Errors:\n  // * NOT_FOUND: no such.\n  // * UNAVAILABLE: lost,\n  //   retry.\n"
            "  rpc Draw(A) returns (B);\n\n  // Picks. Errors: as Draw. Also DATA_LOSS.\n  rpc Pick(A) returns (B);\n"
        )
        self.assertEqual(codes["Draw"], {"NOT_FOUND", "UNAVAILABLE"})
        self.assertEqual(codes["Pick"], {"NOT_FOUND", "UNAVAILABLE", "DATA_LOSS"})

    def test_real_protos_promise_what_faults_need_and_no_bugs(self):
        codes = documented.load()
        needed = {"UNAVAILABLE", "DEADLINE_EXCEEDED", "DATA_LOSS", "FAILED_PRECONDITION"}
        for method in METHODS:
            self.assertLessEqual(needed, codes[method])
            self.assertFalse(codes[method] & {"INTERNAL", "UNKNOWN", "INVALID_ARGUMENT", "CANCELLED"}, method)


class JudgeTest(unittest.TestCase):
    def setUp(self):
        self.episodes = model.Episodes()
        references = {("r1", ()): "right", ("r1", (1,)): "right without 1"}
        codes = {"RenderIsosurface": {"UNAVAILABLE", "DATA_LOSS", "DEADLINE_EXCEEDED"}}
        self.tls = model.Judge(references, codes, self.episodes, is_plaintext=False)
        self.plaintext = model.Judge(references, codes, self.episodes, is_plaintext=True)

    def _verdict(self, judge=None, **values):
        values = {"begin": 100.0, "end": 100.5, "limit_s": 2.0, "code": "OK", "digest": "right", **values}
        return (judge or self.tls).judge(model.Answer("r1", "RenderIsosurface", "c0", **values))

    def _error(self, judge=None, code="UNAVAILABLE", message="agent 127.0.0.1:1 was lost", **values):
        return self._verdict(judge, code=code, message=message, digest="", **values)

    def test_exact_and_partial(self):
        self.assertEqual(self._verdict(), "exact")
        self.assertEqual(self._verdict(digest="right without 1", missing=(1,)), "partial")

    def test_planted_wrong_picture_is_wrong_whatever_went_wrong_besides(self):
        self.assertEqual(self._verdict(digest="other"), "wrong")
        self.assertEqual(self._verdict(digest="right without 1"), "wrong")
        self.assertEqual(self._verdict(digest="right", missing=(1,)), "wrong")
        self.assertEqual(self._verdict(digest="other", end=200.0), "wrong")
        for kind, target in (("corrupt_agent_link", "c0>a0.0"), ("flip_blocks", "a0.0"), ("kill_agent", "a0.0")):
            self.episodes.begin(kind, target, 99.0)
        self.assertEqual(self._verdict(digest="other"), "wrong")

    def test_only_flipped_bits_on_its_own_way_excuse_and_only_in_plaintext(self):
        self.episodes.begin("corrupt_agent_link", "c1>a0.0", 99.0)
        self.assertEqual(self._error(self.plaintext, code="INTERNAL"), "undocumented", "another coordinator's link")
        self.episodes.begin("corrupt_agent_link", "c0>a0.0", 99.0)
        self.assertEqual(self._verdict(self.plaintext, digest="other"), "wrong", "the messages have checksums")
        self.assertEqual(self._error(self.plaintext, code="INTERNAL"), "garbled")
        self.episodes.begin("corrupt_client_link", "client>c0", 99.0)
        self.assertEqual(self._verdict(self.plaintext, digest="other", is_direct=True), "wrong")
        self.assertEqual(self._verdict(self.plaintext, digest="other"), "altered")
        self.assertEqual(self._error(self.plaintext, code="INTERNAL"), "garbled")
        self.assertEqual(self._verdict(digest="other"), "wrong")
        self.assertEqual(self._error(code="INTERNAL"), "undocumented")

    def test_words_of_grpc_pass_only_where_the_connection_of_the_client_broke(self):
        self.episodes.begin("kill_agent", "a0.0", 97.0)
        for code, message in (("UNKNOWN", "Stream removed"), ("CANCELLED", "CANCELLED")):
            self.assertEqual(self._error(code=code, message=message), "undocumented")
        self.episodes.begin("drain_coordinator", "c0", 97.0)
        for code, message in (("UNKNOWN", "Stream removed"), ("CANCELLED", "CANCELLED")):
            self.assertEqual(self._error(code=code, message=message), "error")
            self.assertEqual(self._error(code=code, message="the operation was cancelled"), "undocumented")

    def test_planted_hang_is_hung_even_if_the_answer_is_right(self):
        self.assertEqual(self._verdict(end=102.9), "exact")
        self.assertEqual(self._verdict(end=103.1), "hung")
        self.episodes.begin("stop_agent", "a0.0", 99.0)
        self.assertEqual(self._error(code="DEADLINE_EXCEEDED", end=103.1), "hung")

    def test_stalls_of_the_machine_and_a_stopped_server_lengthen_the_deadline_by_their_time(self):
        self.episodes.stall(101.0, 101.5)
        self.assertEqual(self._verdict(end=103.4), "exact")
        self.assertEqual(self._verdict(end=103.6), "hung")
        stop = self.episodes.begin("stop_coordinator", "c0", 101.0)
        self.episodes.end(stop, 102.0)
        self.assertEqual(self._verdict(end=104.4), "hung")
        self.assertEqual(self._verdict(end=104.4, is_direct=True), "exact")
        self.assertEqual(self._verdict(end=104.6, is_direct=True), "hung")

    def test_error_needs_a_fault_a_documented_code_and_a_message(self):
        self.assertEqual(self._error(), "unexplained")
        kill = self.episodes.begin("kill_agent", "a0.0", 97.0)
        self.assertEqual(self._error(), "error")
        self.assertEqual(self._error(code="INTERNAL"), "undocumented")
        self.assertEqual(self._error(code="UNKNOWN", message="Stream removed"), "undocumented")
        self.assertEqual(self._error(code="CANCELLED", message="CANCELLED"), "undocumented")
        self.assertEqual(self._error(message=""), "undocumented")
        self.assertEqual(self._error(message="Unknown error"), "undocumented")
        self.assertEqual(self._error(code="DATA_LOSS", message="block 7 is damaged"), "undocumented")
        self.episodes.end(kill, 98.0)
        self.assertEqual(self._error(begin=98 + model.AFTERMATH_S + 1, end=98 + model.AFTERMATH_S + 1.1), "unexplained")
        self.episodes.begin("flip_blocks", "a0.0", 99.0)
        self.assertEqual(self._error(code="DATA_LOSS", message="block 7 is damaged"), "error")


class FakeServer:
    """Answers as it is told: with a picture, late, or busy; to views with `answers`."""

    def __init__(self, test):
        self.png, self.late_s, self.working, self.answers = b"right", 0.0, 0, []
        server = pool.grpc.server(concurrent.futures.ThreadPoolExecutor(4))
        grpc_services.serve(self, server, pool.pb, pool.cluster_pb2, pool.interact_pb2)
        self.address = f"127.0.0.1:{server.add_insecure_port('127.0.0.1:0')}"
        server.start()
        test.addCleanup(lambda: server.stop(None).wait())

    def RenderIsosurface(self, request, context):
        time.sleep(self.late_s)
        response = pool.pb.RenderIsosurfaceResponse(png=self.png)
        response.statistics.read_bytes = int(time.monotonic() * 1e9)  # differs each time, and must not matter
        return response

    def Interact(self, requests, context):
        yield from self.answers

    def GetClusterStatus(self, request, context):
        status = pool.cluster_pb2.GetClusterStatusResponse()
        status.agents.add(address="a").load.working_frame_count = self.working
        return status


class PlantedFaultTest(unittest.TestCase):
    """A server that does wrong, through the real client, judge and report."""

    def setUp(self):
        self.server = FakeServer(self)
        self.client = pool.Client(self.server.address)
        self.addCleanup(self.client.close)
        self.request = pool.Request("r0", "RenderIsosurface", pool.pb.RenderIsosurfaceRequest(), "r0")
        references = {("r0", ()): pool.make_references(self.client, [self.request])["r0"]}
        self.judge = model.Judge(references, documented.load(), model.Episodes(), False)
        self.report = report.Report()
        self.load = Load(0, None, [], None, None, 1, max_frame_s=0.1)

    def _judged(self, deadline_s):
        answer = self.load.ask(self.client, self.request, "c0", deadline_s)
        self.judge.judge(answer)
        self.report.add(answer)
        return answer.verdict

    def test_right_picture_is_exact_and_no_finding(self):
        self.assertEqual(self._judged(20), "exact")
        self.assertEqual(self.report.totals()["findings"], 0)

    def test_one_wrong_byte_is_a_finding(self):
        self.server.png = b"riGht"
        self.assertEqual(self._judged(20), "wrong")
        self.assertEqual(self.report.totals()["findings"], 1)
        self.assertIn("wrong at", report.to_text(self.report.to_json(self._run(), [], {})))

    def test_server_that_forgets_its_own_limit_is_a_finding(self):
        self.server.late_s = 0.1 + model.GRACE_S + 0.5
        self.assertEqual(self._judged(None), "hung")
        self.assertEqual(self.report.totals()["findings"], 1)

    def test_view_counts_only_when_it_is_exact(self):
        view = pool.Request("v", "Interact", pool.pb.RenderIsosurfaceRequest(), "r0")
        answer_of = pool.interact_pb2.InteractResponse
        moving = answer_of(sequence_number=1, frame_number=1, frame={"jpeg": b"coarse"})
        early = answer_of(sequence_number=1, frame_number=2, is_exact=True, frame={"png": b"of the state before"})
        exact = answer_of(sequence_number=2, frame_number=3, is_exact=True, frame={"png": b"right"})
        failed = answer_of(sequence_number=2, frame_number=3, error={"code": 14, "message": "agent a was lost"})
        right = self.judge._references["r0", ()]
        for answers, code, digest in (
            ([moving, early, exact], "OK", right),
            ([moving, failed, exact], "UNAVAILABLE", ""),
            ([moving, early], "UNKNOWN", ""),
        ):
            self.server.answers = answers
            answer = self.load.ask(self.client, view, "c0", 20)
            self.assertEqual((answer.code, answer.digest), (code, digest), answer.message)

    def test_agent_that_stays_busy_is_a_finding(self):
        found = []
        checker = quiet.Quiet(None, [], self.load, self.judge, self.report, lambda *what: found.append(what))
        checker._await_idle(self.client, "c0")
        self.assertEqual(found, [])
        self.server.working = 2
        before, quiet.IDLE_AFTER_S = quiet.IDLE_AFTER_S, 0.3
        self.addCleanup(setattr, quiet, "IDLE_AFTER_S", before)
        checker._await_idle(self.client, "c0")
        self.assertEqual(found[0][0], "not idle")
        self.assertIn("a: 2", found[0][1])

    def test_process_that_outgrows_its_limit_is_a_finding(self):
        found = []
        checker = quiet.Quiet(None, [], self.load, self.judge, self.report, lambda *what: found.append(what))
        limit = cluster.MEMORY_LIMIT_MIB << 20
        within = {"resident_bytes": limit, "descriptors": quiet.MAX_DESCRIPTORS, "threads": 9}
        checker._check_size("a", within, cluster.MEMORY_LIMIT_MIB)
        checker._check_size("gone", {}, cluster.MEMORY_LIMIT_MIB)
        self.assertEqual(found, [])
        beyond = {"resident_bytes": limit + (1 << 20), "descriptors": quiet.MAX_DESCRIPTORS + 1}
        checker._check_size("a", beyond, cluster.MEMORY_LIMIT_MIB)
        self.assertEqual([kind for kind, _ in found], ["memory", "descriptors"])
        checker._check_size("tight", within, cluster.LEAST_AGENT_MIB)
        self.assertEqual([kind for kind, _ in found], ["memory", "descriptors", "memory"])

    def _run(self):
        return {"seed": 1, "tls": True, "clients": 1, "topology": "1 x 1"}


class PoolTest(unittest.TestCase):
    def test_is_a_function_of_the_seed(self):
        names = [(r.name, r.message.SerializeToString(deterministic=True)) for r in pool.make_pool(3, "d")]
        again = [(r.name, r.message.SerializeToString(deterministic=True)) for r in pool.make_pool(3, "d")]
        self.assertEqual(names, again)
        self.assertEqual({r.method for r in pool.make_pool(3, "d")}, METHODS)

    def test_parts_of_a_stream_make_the_whole(self):
        whole = pool.pb.RenderIsosurfaceResponse(png=b"abcdef", depth=b"1234")
        whole.extent.width_px = 3
        parts = [pool.pb.RenderIsosurfaceStreamResponse() for _ in range(3)]
        parts[0].part.png = b"abc"
        parts[1].part.png, parts[1].part.depth = b"def", b"12"
        parts[2].part.depth, parts[2].part.extent.width_px = b"34", 3
        self.assertEqual(pool.join_parts(parts), whole)


class ProcessTest(unittest.TestCase):
    LISTENER = "import socket, sys, time; s = socket.create_server(('127.0.0.1', int(sys.argv[1]))); time.sleep(100)"

    def setUp(self):
        folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        port = cluster.Ports(1).take()
        self.exits = []
        argv = [sys.executable, "-c", self.LISTENER, str(port)]
        self.process = cluster.Process("p", argv, port, folder, lambda *what: self.exits.append(what))
        self.addCleanup(self.process.kill)
        self.process.start()

    def test_reports_an_exit_that_nobody_asked_for_once_and_starts_again(self):
        self.process.check()
        self.assertEqual(self.exits, [])
        self.process.signal(cluster.signal.SIGABRT)
        self.process._process.wait()
        self.process.check()
        self.process.check()
        self.assertEqual([(name, code) for name, code, _ in self.exits], [("p", -6)])
        self.assertTrue(self.process.wait_until_up())

    def test_kill_and_drain_are_asked_for(self):
        self.process.kill()
        self.process.check()
        self.assertEqual(self.exits, [])
        self.process.start()
        # This one ends by the signal, not with 0 as a server must.
        self.assertIn("ended with -15", self.process.drain())
        self.assertEqual(self.exits, [])

    def test_damage_is_done_in_place_and_undone(self):
        path = self.process.log.with_name("blocks.bin")
        pristine = bytes(range(200))
        path.write_bytes(pristine)
        inode = path.stat().st_ino
        flipped = faults.flip_bits(path, pristine, 3, schedule.random.Random(1))
        self.assertEqual(sum(a != b for a, b in zip(path.read_bytes(), pristine)), flipped)
        self.assertGreater(flipped, 0)
        faults.overwrite(path, pristine)
        self.assertEqual((path.read_bytes(), path.stat().st_ino), (pristine, inode))


if __name__ == "__main__":
    unittest.main()
