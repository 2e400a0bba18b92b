"""The browser's part of a view, as the text of one ES module.

A checkout has it in parts (`clients/web/isoscope-view.js` and the modules that it imports), and a notebook cell takes
one string. `assemble` puts the parts into the order of their imports. They keep two rules: top-level names differ,
and an import or a re-export is a statement of its own with a relative path. setup.py does this for the wheel.
"""

import functools
import pathlib
import re

NAME = "isoscope-view.js"
_IMPORT = re.compile(r"^import \{[^}]*\} from '(\./[^']+)';\n", re.MULTILINE)
_EXPORT_FROM = re.compile(r"^export \{([^}]*)\} from '(\./[^']+)';\n", re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async function|class|const|function|let) )", re.MULTILINE)


def assemble(entry: pathlib.Path) -> str:
    """Returns one module with the exports of `entry`, which only re-exports."""
    parts: dict[pathlib.Path, str] = {}

    def add(path: pathlib.Path) -> None:
        if path in parts:
            return
        text = path.read_text(encoding="utf-8")
        parts[path] = ""  # Circles end here.
        for imported in [*_IMPORT.findall(text), *(name for _, name in _EXPORT_FROM.findall(text))]:
            add((path.parent / imported).resolve())
        # Dictionaries keep the order of insertion: a part comes after its imports.
        del parts[path]
        parts[path] = _EXPORT.sub("", _IMPORT.sub("", text)) if path != entry else _EXPORT_FROM.sub("", text)

    entry = entry.resolve()
    add(entry)
    reexported = _EXPORT_FROM.findall(entry.read_text(encoding="utf-8"))
    names = [name.strip() for group, _ in reexported for name in group.split(",")]
    exports = ", ".join(name for name in names if name != "default")
    return "\n".join([parts.pop(entry), *parts.values(), f"export {{ {exports} }};\n"])


@functools.cache
def text() -> str | None:
    """Returns the module: of the wheel, or of the checkout; None if there is neither."""
    here = pathlib.Path(__file__).resolve().parent
    built = here / "_static" / NAME
    if built.is_file():
        return built.read_text(encoding="utf-8")
    parts = here.parents[2] / "web" / NAME
    return assemble(parts) if parts.is_file() else None
