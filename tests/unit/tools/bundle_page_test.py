"""Tests cmake/bundle_page.py (its path is the first argument): one module of the page's, which browsers may keep."""

import gzip
import hashlib
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

SCRIPT = pathlib.Path(sys.argv.pop(1))
WEB = SCRIPT.resolve().parents[1] / "clients" / "web"
sys.path.insert(0, str(SCRIPT.resolve().parents[1] / "tests" / "support"))
sys.dont_write_bytecode = True

from skips import skip  # noqa: E402

PAGE = ('<link rel="stylesheet" href="page.css">\n<script type="module" src="page.js"></script>\n'
        '<link rel="modulepreload" href="a.js">\n<img src="icon.svg"><a href="./">home</a>\n')
FILES = {"index.html": PAGE, "page.css": "a{}", "icon.svg": "<svg/>", "a.js": "export const one = 1;\n",
         "page.js": "// A page.\nimport { one } from './a.js';\n\nconsole.log(one);\n"}


def digest_of(content):
    return hashlib.sha256(content).hexdigest()[:32]


class BundlePageTest(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))

    def run_it(self, files):
        """The process, and the files that it made by name."""
        web, output = self.folder / "web", self.folder / "output"
        for name, text in files.items():
            (web / name).parent.mkdir(parents=True, exist_ok=True)
            (web / name).write_text(text)
        done = subprocess.run([sys.executable, SCRIPT, output, *(web / name for name in files)],
                              text=True, capture_output=True, check=False)
        return done, {path.relative_to(output).as_posix():
                      path.read_bytes() if path.suffix == ".gz" else path.read_text() for path in output.rglob("*.*")}

    def assert_refused(self, files, *words):
        done, made = self.run_it({**FILES, **files})
        self.assertEqual(done.returncode, 1, made)
        for word in words:
            self.assertIn(word, done.stderr)
        self.assertEqual(made, {})

    def test_modules_become_one_in_the_order_of_their_imports(self):
        done, made = self.run_it(FILES)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(made["bundle.js"], "// ---- a.js ----\nconst one = 1;\n\n"
                         "// ---- page.js ----\n// A page.\n\nconsole.log(one);\n")

    def test_single_modules_stay_as_they_are(self):
        _, made = self.run_it(FILES)
        self.assertEqual({name: made[name] for name in FILES if name != "index.html"},
                         {name: text for name, text in FILES.items() if name != "index.html"})

    def test_the_page_names_the_one_module_and_digests_of_files(self):
        _, made = self.run_it(FILES)
        css, js, svg = (digest_of(made[name].encode()) for name in ("page.css", "bundle.js", "icon.svg"))
        self.assertEqual(made["index.html"], f'<link rel="stylesheet" href="page.css?v={css}">\n'
                         f'<script type="module" src="bundle.js?v={js}"></script>\n'
                         f'<img src="icon.svg?v={svg}"><a href="./">home</a>\n')

    def test_what_is_compressed_is_the_file(self):
        _, made = self.run_it(FILES)
        for name in ("bundle.js", "page.css"):
            self.assertEqual(gzip.decompress(made[f"{name}.gz"]).decode(), made[name])

    def test_a_name_of_two_modules_is_refused_with_both(self):
        self.assert_refused({"page.js": FILES["page.js"] + "async function one() {}\n"}, "a.js", "page.js", "one")
        self.assert_refused({"page.js": FILES["page.js"] + "const { two, one } = window;\n"}, "a.js", "page.js", "one")

    def test_an_import_of_another_form_is_refused(self):
        for statement in ("import * as all from './a.js';", "import './a.js';", "import { one } from 'elsewhere';",
                          "export * from './a.js';"):
            self.assert_refused({"page.js": f"{statement}\n"}, "page.js", statement)

    def test_a_missing_module_and_a_file_that_is_not_there_are_refused(self):
        self.assert_refused({"page.js": "import { one } from './b.js';\n"}, "b.js")
        self.assert_refused({"index.html": PAGE.replace("icon.svg", "logo.svg")}, "index.html", "logo.svg")
        self.assert_refused({"index.html": PAGE.replace("page.js", "main.js")}, "index.html", 'src="page.js"')

    def test_the_real_page_is_a_module_without_imports(self):
        patterns = ("*.html", "*.js", "view/*.js", "*.css", "*.svg")
        paths = sorted(path for pattern in patterns for path in WEB.glob(pattern))
        done, made = self.run_it({path.relative_to(WEB).as_posix(): path.read_text() for path in paths})
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(re.findall(r"^(?:import|export \{|export \*).*", made["bundle.js"], re.MULTILINE), [])
        self.assertLess(made["bundle.js"].index("// ---- view/view.js"), made["bundle.js"].index("// ---- page.js"))
        if not shutil.which("node"):
            skip("node", "node is missing; Debian has it in nodejs")
        module = self.folder / "bundle.mjs"
        module.write_text(made["bundle.js"])
        checked = subprocess.run(["node", "--check", module], text=True, capture_output=True, check=False)
        self.assertEqual(checked.returncode, 0, checked.stderr)


if __name__ == "__main__":
    unittest.main()
