#!/usr/bin/env python3
"""The installed C++ client: its headers, and the example built from it in an empty folder and run.

    client_package_test.py CMAKE COMPILER BUILD PROGRAM

BUILD is the build folder that is installed from, PROGRAM is isoscope, which serves.
"""

import os
import pathlib
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest

CMAKE, COMPILER = sys.argv[1:3]
BUILD = pathlib.Path(sys.argv[3]).resolve()
PROGRAM = pathlib.Path(sys.argv[4]).resolve()
ROOT = pathlib.Path(__file__).resolve().parents[3]
PATIENCE_S = 300

# Libraries that no public header may expose.
HIDDEN = ("CLI/", "boost/", "grpc/", "grpcpp/", "nlohmann/", "spdlog/", "tbb/")
INCLUDE = re.compile(r'^\s*#\s*include\s+(["<])([^">]+)[">]', re.MULTILINE)


def run(*argv, **options):
    done = subprocess.run([str(a) for a in argv], capture_output=True, text=True, timeout=PATIENCE_S, **options)
    return done


def must(*argv, **options):
    done = run(*argv, **options)
    assert done.returncode == 0, f"{argv}\n{done.stdout}\n{done.stderr}"
    return done.stdout


class ClientPackage(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.scratch.name)
        cls.prefix = cls.folder / "prefix"
        must(CMAKE, "--install", BUILD, "--component", "client", "--prefix", cls.prefix)
        cls.include = cls.prefix / "include" / "isoscope"
        source, build = cls.folder / "source", cls.folder / "build"
        shutil.copytree(ROOT / "clients" / "cpp" / "example", source)
        must(
            CMAKE, "-S", source, "-B", build, f"-DCMAKE_PREFIX_PATH={cls.prefix}", "-DCMAKE_BUILD_TYPE=Release",
            f"-DCMAKE_CXX_COMPILER={COMPILER}",
        )  # fmt: skip
        must(CMAKE, "--build", build)
        cls.example = build / "isoscope-example"
        cls.start_server()

    @classmethod
    def start_server(cls):
        volume, dataset, secrets = cls.folder / "shells.nrrd", cls.folder / "shells", cls.folder / "secrets"
        must(PROGRAM, "generate", "shells", "--dims", "48,40,32", "--type", "uint8", "--output", volume)
        must(PROGRAM, "partition", volume, "--output", dataset, "--shards", "2")
        must("bash", ROOT / "scripts" / "make_certificates.sh", secrets)
        cls.ca, cls.token = secrets / "ca.pem", secrets / "token"
        cls.server = subprocess.Popen(
            [
                PROGRAM, "serve", dataset, "--listen", "127.0.0.1:0", "--renderer", "cpu",
                "--tls-cert", secrets / "coordinator.pem", "--tls-key", secrets / "coordinator.key",
                "--tls-ca", cls.ca, "--tokens", secrets / "tokens.json",
            ],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        line = cls.server.stdout.readline()
        cls.address = re.search(r"127\.0\.0\.1:\d+", line).group()

    @classmethod
    def tearDownClass(cls):
        if hasattr(cls, "server"):
            cls.server.kill()
            cls.server.wait()
            cls.server.stdout.close()
        cls.scratch.cleanup()

    def setUp(self):
        self.work = tempfile.TemporaryDirectory(dir=self.folder)
        self.addCleanup(self.work.cleanup)

    def run_example(self, *arguments):
        return run(self.example, *arguments, cwd=self.work.name)

    def fails(self, code, *arguments):
        done = self.run_example(*arguments)
        self.assertEqual(done.returncode, 1, done.stdout)
        self.assertRegex(done.stderr, f"(?m)^{code}: .")  # gRPC may log lines of its own
        self.assertEqual(os.listdir(self.work.name), [])
        return done.stderr

    def test_headers_are_those_that_the_client_reaches(self):
        headers = sorted(self.include.rglob("*.h"))
        names = {str(h.relative_to(self.include)) for h in headers}
        self.assertIn("clients/cpp/connection/connect.h", names)
        reached = set()
        for header in headers:
            for quote, name in INCLUDE.findall(header.read_text()):
                where = f"{header}: {name}"
                self.assertFalse(name.startswith(HIDDEN), where)
                if name in names:
                    reached.add(name)
                else:
                    self.assertTrue(quote == "<" or name.startswith("absl/"), where)
        for name in names - reached:
            self.assertTrue(name.startswith(("clients/cpp/", "isoscope/v1/", "core/base/status_macros.h")), name)

    def test_each_header_compiles_and_shows_no_library_of_the_inside(self):
        source, dependencies = self.folder / "all.cc", self.folder / "all.d"
        headers = sorted(self.include.rglob("*.h"))
        source.write_text("".join(f'#include "{h.relative_to(self.include)}"\n' for h in headers))
        must(
            COMPILER, "-std=c++20", "-Wall", "-Wextra", "-Werror", "-isystem", self.include, "-fsyntax-only",
            "-MD", "-MF", dependencies, source,
        )  # fmt: skip
        seen = dependencies.read_text().split()
        self.assertTrue(any("/google/protobuf/message.h" in name for name in seen))
        for name in seen:
            for hidden in HIDDEN:
                self.assertNotIn(f"/usr/include/{hidden}", name)

    def test_package_has_one_version(self):
        source = self.folder / "other"
        source.mkdir()
        (source / "CMakeLists.txt").write_text(
            "cmake_minimum_required(VERSION 3.25)\nproject(other LANGUAGES CXX)\nfind_package(isoscope 99 REQUIRED)\n"
        )
        done = run(CMAKE, "-S", source, "-B", source / "build", f"-DCMAKE_PREFIX_PATH={self.prefix}")
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("99", done.stderr)

    def test_picture_plane_and_mesh(self):
        done = self.run_example(self.address, "60", "60", self.ca, self.token)
        self.assertEqual(done.returncode, 0, done.stderr)
        folder = pathlib.Path(self.work.name)
        self.assertEqual(sorted(os.listdir(folder)), ["depth.npy", "head.glb", "head.png"])

        png = (folder / "head.png").read_bytes()
        self.assertEqual(png[:8], b"\x89PNG\r\n\x1a\n")
        self.assertEqual(struct.unpack(">II", png[16:24]), (400, 300))
        self.assertRegex(done.stdout, r"(?m)^\w*triangle\w*: [1-9]")

        npy = (folder / "depth.npy").read_bytes()
        length = 10 + struct.unpack("<H", npy[8:10])[0]
        self.assertIn(b"'shape': (300, 400)", npy[:length])
        depths = struct.unpack(f"<{300 * 400}f", npy[length:])
        self.assertTrue(any(0 < d < 1e6 for d in depths))
        self.assertTrue(any(d == float("inf") for d in depths))

        glb = (folder / "head.glb").read_bytes()
        self.assertEqual(struct.unpack("<4sII", glb[:12]), (b"glTF", 2, len(glb)))
        triangles = int(re.search(r"head.glb: (\d+) triangles", done.stdout).group(1))
        self.assertGreater(triangles, 1000)

        # The command line asks for the same.
        flags = ["--server", self.address, "--tls-ca", self.ca, "--token-file", self.token, "--isovalue", "60"]
        mesh, picture = folder / "cli.glb", folder / "cli.png"
        must(PROGRAM, "export", *flags, "--output", mesh)
        self.assertEqual(mesh.read_bytes(), glb)
        must(
            PROGRAM, "render", *flags, "--width", "400", "--height", "300", "--azimuth", "30", "--no-metadata",
            "--output", picture,
        )  # fmt: skip
        self.assertEqual(picture.read_bytes(), png)

    def test_errors_have_code_and_message(self):
        wrong = self.folder / "wrong"
        wrong.write_text("0" * 64)
        self.assertIn("token", self.fails("UNAUTHENTICATED", self.address, "60", "60", self.ca, wrong))
        self.assertIn("127.0.0.1:1", self.fails("UNAVAILABLE", "127.0.0.1:1", "60", "60", self.ca, self.token))
        self.fails("UNAVAILABLE", self.address, "60", "60", "", "")  # plaintext to a server of TLS
        self.assertIn("/nowhere", self.fails("NOT_FOUND", self.address, "60", "60", self.ca, "/nowhere"))
        self.assertEqual(self.run_example(self.address).returncode, 2)

    def test_calls_end_with_their_deadline_and_with_ctrl_c(self):
        self.server.send_signal(signal.SIGSTOP)
        self.addCleanup(self.server.send_signal, signal.SIGCONT)
        self.fails("DEADLINE_EXCEEDED", self.address, "60", "1", self.ca, self.token)
        with subprocess.Popen(
            [self.example, self.address, "60", "200", self.ca, self.token],
            cwd=self.work.name, stderr=subprocess.PIPE, text=True,
        ) as example:  # fmt: skip
            time.sleep(1)
            example.send_signal(signal.SIGINT)
            self.assertEqual(example.wait(PATIENCE_S), 1)
            self.assertRegex(example.stderr.read(), "(?m)^CANCELLED: .")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
