#!/usr/bin/env python3
"""Packs clients/web's view as the npm package isoscope-view, with types of TypeScript.

    scripts/package_web.py [--output FOLDER]

Prints the path of the tarball, isoscope-view-VERSION.tgz; `npm install PATH` installs it. The version is that of
scripts/version.sh. Needs tsc, protoc and Python's protobuf (ISOSCOPE_WEB_PACKAGES of scripts/packages.sh), and fetches
nothing.

The package has the modules of the view as they are, declarations that tsc makes of their JSDoc, and json.d.ts: the
messages of proto/isoscope/v1 as the gateway's JSON has them, with the comments of the protos.
"""

import argparse
import gzip
import io
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import textwrap

ROOT = pathlib.Path(__file__).resolve().parents[1]
WEB = ROOT / "clients" / "web"
MODULE = "isoscope-view.js"
PROTOS = ("cluster_service", "dataset_service", "interact_service", "isosurface_service")
WIDTH = 110  # of lines of comments

HEAD = """\
// The messages of proto/isoscope/v1 as the gateway's JSON has them; scripts/package_web.py makes this file. A field with
// its default value is left out of answers, so every field may be absent.

/** A number of JSON, or one that JSON has no digits for. Number(value) gives the number. */
export type JsonNumber = number | 'NaN' | 'Infinity' | '-Infinity';
"""

# Members of a state may be null, which is as good as absent.
STATE_TYPES = {
    "FrameRequest": "{ [Name in Exclude<keyof import('../json.js').RenderIsosurfaceRequest, 'viewport' | 'output'>]?:"
    " import('../json.js').RenderIsosurfaceRequest[Name] | null }",
    "DatasetJson": "import('../json.js').Dataset",
}


def run(command, **options):
    """Runs a program; ends with its output where it fails."""
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, **options)
    if done.returncode != 0:
        sys.exit(f"package_web.py: {command[0]} failed:\n{done.stdout}{done.stderr}")
    return done.stdout


def check_tools():
    """Ends where a program or module is missing."""
    missing = [f"{program} ({package})" for program, package in
               (("tsc", "node-typescript"), ("protoc", "protobuf-compiler")) if shutil.which(program) is None]
    try:
        import google.protobuf.descriptor_pb2  # noqa: F401
    except ImportError:
        missing.append("Python's protobuf (python3-protobuf)")
    if missing:
        sys.exit(f"package_web.py: missing, with the Debian package that has it: {', '.join(missing)}")


# ------------------------------------------------------------------------------------- types of JSON


def descriptors(folder):
    """The protos that the JSON is of, with their comments, each after those that it imports."""
    from google.protobuf import descriptor_pb2

    path = folder / "protos.bin"
    names = [f"isoscope/v1/{name}.proto" for name in PROTOS]
    run(["protoc", f"--proto_path={ROOT / 'proto'}", "--include_imports", "--include_source_info",
         f"--descriptor_set_out={path}", *names])
    return [file for file in descriptor_pb2.FileDescriptorSet.FromString(path.read_bytes()).file
            if file.package == "isoscope.v1" and not file.name.endswith("options.proto")]


def comment_of(text, indent):
    """A comment of a proto as one of TypeScript; empty without one."""
    lines = [line.strip() for line in text.strip().replace("*/", "* /").splitlines()]
    if not lines:
        return ""
    if len(lines) == 1 and len(lines[0]) + len(indent) <= WIDTH:
        return f"{indent}/** {lines[0]} */\n"
    wrapped = [part for line in lines for part in textwrap.wrap(line, WIDTH - len(indent)) or [""]]
    return f"{indent}/**\n" + "".join(f"{indent} * {line}".rstrip() + "\n" for line in wrapped) + f"{indent} */\n"


def type_name(full_name):
    """".isoscope.v1.OutputOptions.ImageFormat" becomes "OutputOptionsImageFormat"."""
    return full_name.removeprefix(".isoscope.v1.").replace(".", "")


def type_of(field):
    """The type of one value of a field."""
    kinds = type(field)
    if field.type in (kinds.TYPE_DOUBLE, kinds.TYPE_FLOAT):
        return "JsonNumber"
    if field.type in (kinds.TYPE_INT32, kinds.TYPE_UINT32, kinds.TYPE_FIXED32, kinds.TYPE_SFIXED32, kinds.TYPE_SINT32):
        return "number"
    if field.type == kinds.TYPE_BOOL:
        return "boolean"
    if field.type in (kinds.TYPE_MESSAGE, kinds.TYPE_ENUM) and field.type_name != ".google.protobuf.Duration":
        return type_name(field.type_name)
    return "string"  # text, 64-bit integers, bytes in base64, durations such as "1.5s"


def make_enum(enum, name, comment):
    values = " | ".join(f"'{value.name}'" for value in enum.value)
    return f"{comment}export type {name} =\n" + "\n".join(
        textwrap.wrap(values, WIDTH, initial_indent="  ", subsequent_indent="  ")) + ";\n"


def make_types(files):
    """The text of json.d.ts."""
    parts = [HEAD]
    for file in files:
        comments = {tuple(place.path): place.leading_comments for place in file.source_code_info.location}

        def add_message(message, path, outer):
            name = outer + message.name
            lines = [f"{comment_of(comments.get(path, ''), '')}export interface {name} {{\n"]
            for index, field in enumerate(message.field):
                array = "[]" if field.label == field.LABEL_REPEATED else ""
                lines.append(comment_of(comments.get((*path, 2, index), ""), "  "))
                lines.append(f"  {field.json_name}?: {type_of(field)}{array};\n")
            parts.append("".join(lines) + "}\n")
            for index, enum in enumerate(message.enum_type):
                at = (*path, 4, index)
                parts.append(make_enum(enum, name + enum.name, comment_of(comments.get(at, ""), "")))
            for index, nested in enumerate(message.nested_type):
                add_message(nested, (*path, 3, index), name)

        for index, message in enumerate(file.message_type):
            add_message(message, (4, index), "")
        for index, enum in enumerate(file.enum_type):
            parts.append(make_enum(enum, enum.name, comment_of(comments.get((5, index), ""), "")))
    return "\n".join(parts)


# -------------------------------------------------------------------------------------- the package


def declare(folder):
    """Lets tsc write the declarations of the view into `folder`."""
    project = folder.with_suffix(".json")
    project.write_text(json.dumps({"files": [str(WEB / MODULE)], "compilerOptions": {
        "allowJs": True, "declaration": True, "emitDeclarationOnly": True, "target": "es2022", "module": "es2022",
        "moduleResolution": "node", "lib": ["es2022", "dom", "dom.iterable"], "types": [], "rootDir": str(WEB),
        "outDir": str(folder)}}))
    run(["tsc", "--project", project])
    types = folder / "view" / "types.d.ts"
    text = types.read_text(encoding="utf-8")
    for name, type_ in STATE_TYPES.items():
        text, count = re.subn(rf"(?m)^export type {name} = .*;$", lambda _: f"export type {name} = {type_};", text)
        if count != 1:
            sys.exit(f"package_web.py: tsc's view/types.d.ts declares {name} {count} times on one line; expected once")
    types.write_text(text, encoding="utf-8")


def manifest(version):
    """The package.json of the package."""
    package = json.loads((WEB / "package.json").read_text(encoding="utf-8"))
    package.pop("private", None)
    package["version"] = version
    package["license"] = "Apache-2.0"
    package["types"] = "./isoscope-view.d.ts"
    package["exports"] = {
        ".": {"types": "./isoscope-view.d.ts", "default": "./isoscope-view.js"},
        "./json": {"types": "./json.d.ts", "default": "./json.js"},
        "./package.json": "./package.json",
    }
    return json.dumps(package, indent=2) + "\n"


def contents(version, scratch):
    """Path in the package: bytes."""
    declare(scratch / "types")
    files = {"package.json": manifest(version), "json.d.ts": make_types(descriptors(scratch)), "json.js": "export {};\n"}
    files = {name: text.encode() for name, text in files.items()}
    files["LICENSE"] = (ROOT / "LICENSE").read_bytes()
    files["README.md"] = (WEB / "README.md").read_bytes()
    for path in [WEB / MODULE, *sorted((WEB / "view").glob("*.js"))]:
        files[path.relative_to(WEB).as_posix()] = path.read_bytes()
    for path in sorted((scratch / "types").rglob("*.d.ts")):
        files[path.relative_to(scratch / "types").as_posix()] = path.read_bytes()
    return files


def pack(files, path):
    """Writes a tarball as `npm pack` does: one tree gives one file."""
    date = int(os.environ.get("SOURCE_DATE_EPOCH", 499162500))  # npm's own: 1985, for file systems without 1970
    with open(path, "wb") as out, gzip.GzipFile("", "wb", 9, out, mtime=0) as packed, \
            tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for name in sorted(files):
            entry = tarfile.TarInfo(f"package/{name}")
            entry.size, entry.mtime, entry.mode = len(files[name]), date, 0o644
            tar.addfile(entry, io.BytesIO(files[name]))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", metavar="FOLDER", type=pathlib.Path, default=ROOT / "build" / "packages",
                        help="where the tarball goes (default: build/packages)")
    arguments = parser.parse_args()
    check_tools()
    version = run(["bash", ROOT / "scripts" / "version.sh"]).strip()
    arguments.output.mkdir(parents=True, exist_ok=True)
    path = arguments.output / f"isoscope-view-{version}.tgz"
    with tempfile.TemporaryDirectory() as scratch:
        pack(contents(version, pathlib.Path(scratch)), path)
    print(path)


if __name__ == "__main__":
    main()
