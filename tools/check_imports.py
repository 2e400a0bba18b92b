#!/usr/bin/env python3
"""Checks that the modules of the clients import each other without a circle.

    tools/check_imports.py [ROOT]     checks the tree

Python: clients/python/src/isoscope, imports inside of functions and those for types, too. JavaScript: clients/web,
import, export ... from, and import(), but not in comments. Prints `file: a circle: ...`, once for all modules that reach
each other; exit code 1 if there is any.
"""

import ast
import pathlib
import re
import sys

PYTHON_PACKAGE = "clients/python/src/isoscope"
WEB_FOLDER = "clients/web"

JAVASCRIPT_COMMENT = re.compile(r"/\*.*?\*/|(?<![:'\"])//[^\n]*", re.DOTALL)
JAVASCRIPT_IMPORT = re.compile(r"""(?:\bfrom|\bimport|\bimport\s*\()\s*['"](\.{1,2}/[^'"]+)['"]""")


def imported_names(node):
    """Yields (level, dotted name) of each import at or below `node`."""
    for child in ast.walk(node):
        if isinstance(child, ast.Import):
            yield from ((0, alias.name) for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            base = child.module or ""
            yield child.level, base
            yield from ((child.level, f"{base}.{alias.name}".lstrip(".")) for alias in child.names)


def python_imports(root):
    """{file: files that it imports} of the package."""
    package = root / PYTHON_PACKAGE
    files = {
        ".".join(path.relative_to(package).with_suffix("").parts): path.relative_to(root).as_posix()
        for path in package.rglob("*.py")
    }
    graph = {}
    for file in files.values():
        graph[file] = set()
        for level, name in imported_names(ast.parse((root / file).read_text(encoding="utf-8"))):
            parts = name.split(".")
            if level == 0 and parts[0] == package.name:
                parts = parts[1:]
            elif level != 1:
                continue
            # A module of a folder, or of the package itself; what is imported of it does not matter.
            found = next((name for count in (2, 1) if (name := ".".join(parts[:count])) in files), None)
            if found is not None and files[found] != file:
                graph[file].add(files[found])
    return graph


def javascript_imports(root):
    """{file: files that it imports} of the page and its viewer."""
    graph = {}
    for path in (root / WEB_FOLDER).rglob("*.js"):
        text = JAVASCRIPT_COMMENT.sub("", path.read_text(encoding="utf-8"))
        imported = ((path.parent / name).resolve() for name in JAVASCRIPT_IMPORT.findall(text))
        graph[path.relative_to(root).as_posix()] = {
            other.relative_to(root.resolve()).as_posix() for other in imported if other.is_file()
        }
    return graph


def path_between(graph, start, end):
    """The shortest way from `start` to `end` of one step at least, with both; or None."""
    ways = [[start]]
    seen = set()
    for way in ways:
        for other in sorted(graph.get(way[-1], ())):
            if other == end:
                return [*way, other]
            if other not in seen:
                seen.add(other)
                ways.append([*way, other])
    return None


def find_circles(graph):
    """A circle of each set of modules that reach each other, the shortest from its first module."""
    circles = []
    known = set()
    for file in sorted(graph):
        circle = None if file in known else path_between(graph, file, file)
        if circle:
            circles.append(circle)
            known |= {other for other in graph if path_between(graph, file, other) and path_between(graph, other, file)}
    return circles


def check(root):
    """Returns all circles of the tree below `root` as complaints."""
    return [
        f"{circle[0]}: a circle: " + " -> ".join(pathlib.PurePosixPath(file).stem for file in circle)
        for graph in (python_imports(root), javascript_imports(root))
        for circle in find_circles(graph)
    ]


def main():
    default = pathlib.Path(__file__).resolve().parent.parent
    complaints = check(pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else default)
    for complaint in complaints:
        print(complaint)
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
