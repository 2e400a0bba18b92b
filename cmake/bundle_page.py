#!/usr/bin/env python3
"""Makes of clients/web what the gateway serves: its files, and the page's modules as one besides.

    cmake/bundle_page.py OUTPUT FILE...     FILE: index.html of clients/web and all that the page has, by their paths

OUTPUT, a folder, gets the files and bundle.js: page.js and the modules that it imports, in the order of their imports.
Its index.html has that in their place, and names own files with the digest of their bytes (`bundle.js?v=...`), which
lets browsers keep them. bundle.js and page.css are there as gzip, too (`bundle.js.gz`). Ends with 1 and a sentence
where modules can't be put together.
"""

import gzip
import hashlib
import pathlib
import re
import runpy
import sys

VIEWER_MODULE = pathlib.Path(__file__).resolve().parents[1] / "clients/python/src/isoscope/_viewer_module.py"
PAGE, ENTRY, BUNDLE = "index.html", "page.js", "bundle.js"
ENTRY_ADDRESS = f'src="{ENTRY}"'
PRELOAD = re.compile(r'^<link rel="modulepreload" href="[^"]+">\n', re.MULTILINE)
OWN_ADDRESS = re.compile(r' (href|src)="([\w/-]+\.(?:css|js|svg))"')
COMPRESSED = (BUNDLE, "page.css")
DIGEST_DIGITS = 32  # as web-gateway/http/static_files.cc takes them


def bundled(page, files):
    """The text of index.html with one module for all, and digests of `files`, by name."""
    if page.count(ENTRY_ADDRESS) != 1:
        raise ValueError(f"{PAGE}: expected one element with {ENTRY_ADDRESS}, not {page.count(ENTRY_ADDRESS)}")

    def with_digest(match):
        attribute, name = match.groups()
        if name not in files:
            raise ValueError(f"{PAGE}: there is no {name}")
        return f' {attribute}="{name}?v={hashlib.sha256(files[name]).hexdigest()[:DIGEST_DIGITS]}"'

    return OWN_ADDRESS.sub(with_digest, PRELOAD.sub("", page).replace(ENTRY_ADDRESS, f'src="{BUNDLE}"'))


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__.split("\n\n")[1].strip())
    output, *paths = map(pathlib.Path, sys.argv[1:])
    page = next(path for path in paths if path.name == PAGE)
    files = {path.relative_to(page.parent).as_posix(): path.read_bytes() for path in paths}
    try:
        files[BUNDLE] = runpy.run_path(str(VIEWER_MODULE))["assemble"](page.parent / ENTRY).encode()
        files[PAGE] = bundled(files[PAGE].decode(), files).encode()
    except (OSError, ValueError) as error:
        sys.exit(f"bundle_page.py: {error}")
    files.update({f"{name}.gz": gzip.compress(files[name], mtime=0) for name in COMPRESSED if name in files})
    for name, content in files.items():
        path = output / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


if __name__ == "__main__":
    main()
