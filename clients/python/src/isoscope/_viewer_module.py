"""Modules of `clients/web` as the text of one ES module.

A checkout has the view in parts (`isoscope-view.js` and the modules that it imports), and a notebook cell takes one
string; the gateway has its page as one, so that a browser asks once. `assemble` puts the parts into the order of their
imports. They keep two rules: top-level names differ, and an import or a re-export is a statement of its own with a
relative path. setup.py does this for the wheel, and cmake/bundle_page.py for the gateway.
"""

import functools
import pathlib
import re

NAME = "isoscope-view.js"
_IMPORT = re.compile(r"^import \{[^}]*\} from '(\./[^']+)';\n", re.MULTILINE)
_EXPORT_FROM = re.compile(r"^export \{([^}]*)\} from '(\./[^']+)';\n", re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async function|class|const|function|let) )", re.MULTILINE)
_OTHER_IMPORT = re.compile(r"^(?:import\b|export\b[^;'\"]*\bfrom\b).*", re.MULTILINE)
_DECLARED = re.compile(
    r"^(?:async function|class|const|function\*?|let|var) (\w+|\{[^}]*\}|\[[^\]]*\])", re.MULTILINE)


def _check(parts: dict[pathlib.Path, str]) -> None:
    """Raises ValueError where a part breaks a rule: else a browser would refuse all of the module."""
    owners: dict[str, pathlib.Path] = {}
    for path, text in parts.items():
        if statement := _OTHER_IMPORT.search(text):
            raise ValueError(f"{path}: expected an import of names with a relative path, ended by ';' and a new line, "
                             f"not: {statement[0]}")
        for declared in _DECLARED.findall(text):
            for name in re.findall(r"\w+", declared):
                if owners.setdefault(name, path) != path:
                    raise ValueError(f"{path}: {owners[name]} has a top-level {name}, too: rename one of them")


def assemble(entry: pathlib.Path) -> str:
    """Returns one module with what `entry` re-exports. Raises ValueError, with the file, where a rule is broken."""
    parts: dict[pathlib.Path, str] = {}
    reexported: list[str] = []

    def add(path: pathlib.Path) -> None:
        if path in parts:
            return
        text = path.read_text(encoding="utf-8")
        parts[path] = ""  # Circles end here.
        for imported in [*_IMPORT.findall(text), *(name for _, name in _EXPORT_FROM.findall(text))]:
            add((path.parent / imported).resolve())
        # Dictionaries keep the order of insertion: a part comes after its imports.
        del parts[path]
        if path == entry:
            reexported.extend(name.strip() for names, _ in _EXPORT_FROM.findall(text) for name in names.split(","))
        parts[path] = _EXPORT.sub("", _IMPORT.sub("", _EXPORT_FROM.sub("", text)))

    entry = entry.resolve()
    add(entry)
    _check(parts)
    exports = ", ".join(name for name in reexported if name != "default")
    named = [f"// ---- {path.relative_to(entry.parent).as_posix()} ----\n{text}" for path, text in parts.items()]
    return "\n".join([*named, *([f"export {{ {exports} }};\n"] if exports else [])])


@functools.cache
def text() -> str | None:
    """Returns the module: of the wheel, or of the checkout; None if there is neither."""
    here = pathlib.Path(__file__).resolve().parent
    built = here / "_static" / NAME
    if built.is_file():
        return built.read_text(encoding="utf-8")
    parts = here.parents[2] / "web" / NAME
    return assemble(parts) if parts.is_file() else None
