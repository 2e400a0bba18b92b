"""Tests tools/check_imports.py (its path is the first argument): it finds circles, and only circles."""

import importlib.util
import pathlib
import sys
import tempfile
import unittest

SCRIPT = sys.argv.pop(1)
_spec = importlib.util.spec_from_file_location("check_imports", SCRIPT)
check_imports = importlib.util.module_from_spec(_spec)
sys.dont_write_bytecode = True
_spec.loader.exec_module(check_imports)


class CheckImportsTest(unittest.TestCase):
    def complaints_of(self, files):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for name, text in files.items():
                path = root / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text)
            return check_imports.check(root)

    def python(self, **modules):
        return self.complaints_of({f"{check_imports.PYTHON_PACKAGE}/{name}.py": text for name, text in modules.items()})

    def web(self, files):
        return self.complaints_of({f"{check_imports.WEB_FOLDER}/{name}": text for name, text in files.items()})

    def test_a_circle_of_python_is_found_however_it_imports(self):
        for back in [
            "from isoscope import a",
            "import isoscope.a",
            "from . import a",
            "from .a import x",
            "def f():\n    from isoscope.a import x",
            "if TYPE_CHECKING:\n    from isoscope.a import X",
        ]:
            complaints = self.python(a="from isoscope import b\n", b="from isoscope.c import y\n", c=back)
            self.assertEqual(complaints, [f"{check_imports.PYTHON_PACKAGE}/a.py: a circle: a -> b -> c -> a"], back)

    def test_other_packages_make_no_circle_of_python(self):
        for back in ["from numpy import a", "import other.a", "# import isoscope.a", ""]:
            self.assertEqual(self.python(a="from isoscope import b\n", b=back), [], back)

    def test_each_circle_is_told_once(self):
        complaints = self.python(
            a="from isoscope import b", b="from isoscope import a", c="from isoscope import d, a", d="from isoscope import c"
        )
        self.assertEqual(len(complaints), 2)

    def test_a_circle_of_javascript_is_found_however_it_imports(self):
        for back in [
            "import { x } from '../a.js';",
            'export * from "../a.js";',
            "import '../a.js';",
            "const a = await import('../a.js');",
            "import {\n  x,\n} from '../a.js';",
        ]:
            complaints = self.web({"a.js": "import { y } from './view/b.js';\n", "view/b.js": back})
            self.assertEqual(complaints, [f"{check_imports.WEB_FOLDER}/a.js: a circle: a -> b -> a"], back)

    def test_types_in_comments_make_no_circle_of_javascript(self):
        for back in ["/** @typedef {import('./a.js').T} T */", "// import './a.js';", "const x = 'a.js';"]:
            self.assertEqual(self.web({"a.js": "import { y } from './b.js';\n", "b.js": back}), [], back)


if __name__ == "__main__":
    unittest.main()
