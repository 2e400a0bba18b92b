#!/usr/bin/env python3
"""Every advice of a refusal works when it is followed.

    advice_test.py ISOSCOPE SOURCE_TREE [unittest arguments]

A case makes a file that is refused, takes the advice out of the message, follows it by rote, and demands success. The
sentences of the sources that advise a flag, a command or another path are listed: each needs a case here, or a line in
ELSEWHERE that says which test follows it, or why it gives no advice.
"""

import glob
import json
import os
import re
import shlex
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'support'))
import skips  # noqa: E402

SOURCES = os.path.abspath(sys.argv.pop(2))
ISOSCOPE = os.path.abspath(sys.argv.pop(1))

# A pattern of a sentence, and what is to be said of it.
ELSEWHERE = [
    # Followed by other tests, which this one looks for.
    (r'choose one by --series N', 'test: dicom_folder_test.cc'),
    (r'choose one by its UID', 'test: dicom_folder_test.cc'),
    (r'expected slices at one distance', 'test: dicom_stack_test.cc'),
    (r'say which dataset, as in', 'test: hdf5_source_test.cc'),
    (r'no attribute says what they mean', 'test: hdf5_series_test.cc'),
    (r'raise --memory-limit', 'test: partition_plan_test.cc'),
    (r'holds the work of a run without --part', 'test: part_folder_test.cc'),
    (r'partition (its|the) first step with --time', 'test: series_partitioner_test.cc'),
    (r'the iterations of a series have one grid', 'test: hdf5_mesh_series_test.cc'),
    (r'a dataset of a pattern; expected a mesh', 'test: hdf5_file_series_test.cc'),
    (r'for what --append appends|--append DIR', 'says which flags do not fit'),
    (r'`aws configure export-credentials', 'test: remote_options_test.cc'),
    (r'isoscope copy', 'test: address_source_test.cc'),
    (r'is a Zarr store; expected --format zarr', 'test: address_source_test.cc'),
    (r' and --axes : expected', 'test: npy_header_test.cc'),
    (r"can't be indexed alone", 'test: sample_opener_test.cc'),
    (r'chunks; expected at most %d to read them in any order', 'test: hdf5_boxes_test.cc'),
    (r'is index-only, and nothing can be appended', 'test: sample_opener_test.cc'),
    # Those name what does not fit, or the choices.
    (r'is no box X0:X1', 'form of a value'),
    (r'^%s: --crop %d:%d on axis', 'names the limits'),
    (r'^(%s: |: )?(%d axes .*)?--axes ', 'names the letters that fit'),
    (r'--axes (is|for)', 'says which flags do not fit'),
    (r'as in \\"kinds: domain', 'form of a header'),
    (r"openPMD's basePath", 'form of a header'),
    (r"--crop and --stride can't help", 'says what does not help'),
    (r'^%s: --header-bytes', 'names the limits'),
    (r'a .* array without a name', 'names the choices'),
    (r'--field chooses fields of the source', 'names the choices'),
    (r'--shards ', 'says which flags do not fit'),
    (r"can't be used with|is for --server|is for raw files only|in plaintext|is a dataset", 'says which flags do not fit'),
    (r'^%s: %d axes \(%s elements\); expected 3 to 5', 'names the choices'),
    (r'--(direction|spacing|origin): (axis|axes|: each|$)', 'form of a value'),
    (r'leave --spacing out, or --resample', 'test: placed_source_test.cc'),
    (r'files of several stacks', 'test: stack_names_test.cc'),
    (r'leave --time out|--step : it has step 0 alone', 'names the choices'),
]


def nrrd(sizes, lines, sample_bytes=1, count=None):
    total = 1
    for size in sizes:
        total *= size
    head = f'NRRD0004\ntype: {"uchar" if sample_bytes == 1 else "short"}\ndimension: {len(sizes)}\n'
    head += f'sizes: {" ".join(map(str, sizes))}\nendian: little\n{lines}encoding: raw\n\n'
    return head.encode() + ramp(total if count is None else count)


def ramp(count):
    return bytes(i % 251 for i in range(count))


def nifti(rows=None, qform=0, distances=(1, 1, 1)):
    head = bytearray(352)
    struct.pack_into('<i', head, 0, 348)
    struct.pack_into('<8h', head, 40, 3, 6, 5, 4, 1, 1, 1, 1)
    struct.pack_into('<2h', head, 70, 2, 8)
    struct.pack_into('<4f', head, 76, 1, *distances)
    struct.pack_into('<f', head, 108, 352)
    head[123] = 2
    struct.pack_into('<2h', head, 252, qform, 1 if rows else 0)
    if rows:
        struct.pack_into('<12f', head, 280, *rows)
    head[344:348] = b'n+1\0'
    return bytes(head) + ramp(120)


def analyze(distances):
    head = bytearray(348)
    struct.pack_into('<i', head, 0, 348)
    struct.pack_into('<8h', head, 40, 3, 6, 5, 4, 1, 1, 1, 1)
    struct.pack_into('<2h', head, 70, 2, 8)
    struct.pack_into('<4f', head, 76, 0, *distances)
    return bytes(head)


def cdf(dims, variables):
    """A classic netCDF file. A variable: name, names of dimensions, attributes, values of floats."""
    def name(text):
        raw = text.encode()
        return struct.pack('>I', len(raw)) + raw + b'\0' * (-len(raw) % 4)

    def attributes(items):
        if not items:
            return struct.pack('>2I', 0, 0)
        out = struct.pack('>2I', 12, len(items))
        for key, value in items.items():
            raw = value.encode()
            out += name(key) + struct.pack('>2I', 2, len(raw)) + raw + b'\0' * (-len(raw) % 4)
        return out

    numbers = {dim: i for i, (dim, _) in enumerate(dims)}

    def header(begins):
        out = b'CDF\x01' + struct.pack('>3I', 0, 10, len(dims))
        for dim, size in dims:
            out += name(dim) + struct.pack('>I', size)
        out += attributes({}) + struct.pack('>2I', 11, len(variables))
        for (var, axes, texts, values), begin in zip(variables, begins):
            out += name(var) + struct.pack('>I', len(axes))
            out += b''.join(struct.pack('>I', numbers[axis]) for axis in axes)
            out += attributes(texts) + struct.pack('>3I', 5, 4 * len(values), begin)
        return out

    begins, at = [], len(header([0] * len(variables)))
    for _, _, _, values in variables:
        begins.append(at)
        at += 4 * len(values)
    return header(begins) + b''.join(struct.pack(f'>{len(v)}f', *v) for _, _, _, v in variables)


def tiff(pages, description='', resolution=None):
    """Pages of 6 x 5 samples of 8 bits."""
    out = bytearray(b'II*\0\0\0\0\0')
    link = 4
    for page in range(pages):
        data = len(out)
        out += bytes((7 * page + i) % 251 for i in range(30))
        entries = [(256, 3, 1, 6), (257, 3, 1, 5), (258, 3, 1, 8), (259, 3, 1, 1), (262, 3, 1, 1)]
        if page == 0 and description:
            text = description.encode() + b'\0'
            out += b'\0' * (len(out) % 2)
            entries.append((270, 2, len(text), len(out)))
            out += text
        entries += [(273, 4, 1, data), (277, 3, 1, 1), (278, 3, 1, 5), (279, 4, 1, 30)]
        if resolution:
            out += b'\0' * (len(out) % 2)
            for tag, value in zip((282, 283), resolution):
                entries.append((tag, 5, 1, len(out)))
                out += struct.pack('<2I', value, 1)
            entries.append((296, 3, 1, 1))
        out += b'\0' * (len(out) % 2)
        struct.pack_into('<I', out, link, len(out))
        out += struct.pack('<H', len(entries))
        for tag, kind, count, value in entries:
            out += struct.pack('<2HI', tag, kind, count) + struct.pack('<I', value)
        link = len(out)
        out += b'\0\0\0\0'
    return bytes(out)


def vtk_xml(kind, inner):
    return (f'<VTKFile type="{kind}"><{kind} WholeExtent="0 2 0 1 0 1"><Piece Extent="0 2 0 1 0 1"><PointData>'
            '<DataArray type="Float32" Name="p" format="ascii">' + ' '.join(map(str, range(12))) + '</DataArray>'
            f'</PointData>{inner}</Piece></{kind}></VTKFile>').encode()


def vti(attributes):
    return vtk_xml('ImageData', '').replace(b'<ImageData ', f'<ImageData {attributes} '.encode())


def legacy_vtk(lines):
    return (f'# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 3 2 2\n{lines}'
            'POINT_DATA 12\nSCALARS p int 1\nLOOKUP_TABLE default\n').encode() + b'\n'.join(
                str(i).encode() for i in range(12)) + b'\n'


def mrc(cell=(6, 5, 4), angles=(90, 90, 90), origin=(0, 0, 0)):
    head = bytearray(1024)
    struct.pack_into('<10i', head, 0, 6, 5, 4, 0, 0, 0, 0, 6, 5, 4)
    struct.pack_into('<6f', head, 40, *cell, *angles)
    struct.pack_into('<3i', head, 64, 1, 2, 3)
    struct.pack_into('<3f', head, 196, *origin)
    head[208:216] = b'MAP \x44\x44\0\0'
    return bytes(head) + ramp(120)


def dicom(z, pixel_spacing):
    """A slice of 6 x 5 samples of 16 bits."""
    def element(group, number, kind, value):
        raw = value.encode() if isinstance(value, str) else value
        raw += b'\0' * (len(raw) % 2) if kind in ('UI', 'OW') else b' ' * (len(raw) % 2)
        size = struct.pack('<2xI' if kind == 'OW' else '<H', len(raw))
        return struct.pack('<2H', group, number) + kind.encode() + size + raw

    def number(value):
        return struct.pack('<H', value)

    meta = element(2, 0x10, 'UI', '1.2.840.10008.1.2.1')
    return (b'\0' * 128 + b'DICM' + element(2, 0, 'UL', struct.pack('<I', len(meta))) + meta +
            element(8, 0x16, 'UI', '1.2.840.10008.5.1.4.1.1.4') + element(8, 0x18, 'UI', f'1.2.3.{z + 1}') +
            element(8, 0x60, 'CS', 'MR') + element(0x20, 0xe, 'UI', '1.2.3') +
            element(0x20, 0x13, 'IS', str(z + 1)) + element(0x20, 0x32, 'DS', f'0\\0\\{2 * z}') +
            element(0x20, 0x37, 'DS', '1\\0\\0\\0\\1\\0') + element(0x28, 2, 'US', number(1)) +
            element(0x28, 4, 'CS', 'MONOCHROME2') + element(0x28, 0x10, 'US', number(5)) +
            element(0x28, 0x11, 'US', number(6)) + element(0x28, 0x30, 'DS', pixel_spacing) +
            element(0x28, 0x100, 'US', number(16)) + element(0x28, 0x101, 'US', number(16)) +
            element(0x28, 0x102, 'US', number(15)) + element(0x28, 0x103, 'US', number(0)) +
            element(0x7fe0, 0x10, 'OW', struct.pack('<30H', *(4 * z + i for i in range(30)))))


def png(value):
    """A grey image of 6 x 5 samples."""
    def chunk(kind, data):
        return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))

    rows = b''.join(b'\0' + bytes(value + 7 * x for x in range(6)) for _ in range(5))
    return (b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', struct.pack('>2I5B', 6, 5, 8, 0, 0, 0, 0)) +
            chunk(b'IDAT', zlib.compress(rows)) + chunk(b'IEND', b''))


def coordinates(x):
    arrays = ''.join(f'<DataArray type="Float64" Name="{n}" format="ascii">{v}</DataArray>'
                     for n, v in (('x', x), ('y', '0 1'), ('z', '0 1')))
    return f'<Coordinates>{arrays}</Coordinates>'


class AdviceTest(unittest.TestCase):

    def setUp(self):
        own = tempfile.TemporaryDirectory(prefix='isoscope-advice-test-')
        self.addCleanup(own.cleanup)
        self.folder = own.name
        self.runs = 0
        self.environment = dict(os.environ, XDG_CACHE_HOME=os.path.join(own.name, 'cache'))

    def file(self, name, data):
        path = os.path.join(self.folder, name)
        with open(path, 'wb') as file:
            file.write(data)
        return path

    def run_isoscope(self, arguments):
        done = subprocess.run([ISOSCOPE, *arguments], capture_output=True, text=True, timeout=120,
                              env=self.environment, cwd=self.folder)
        return done.returncode, done.stderr

    def output(self):
        self.runs += 1
        return os.path.join(self.folder, f'out{self.runs}')

    def refused(self, arguments, pattern):
        """Returns the message of a refusal, which has the pattern in it."""
        status, message = self.run_isoscope(arguments)
        self.assertNotEqual(status, 0, arguments)
        self.assertRegex(message, pattern)
        return message

    def works(self, arguments, message):
        status, said = self.run_isoscope(arguments)
        self.assertEqual(status, 0, f'the advice of "{message}"\nwas followed by {arguments}:\n{said}')

    def commands(self, message):
        """Follows the commands in backticks, one after the other."""
        found = re.findall(r'`isoscope ([^`]*)`', message)
        self.assertTrue(found, message)
        folder = self.output()
        for command in found:
            words = [folder if word == 'DIR' else word for word in shlex.split(command)]
            if words[0] == 'render':
                words += ['--isovalue', '60', '--output', self.output() + '.png']
            self.works(words, message)

    def flag(self, arguments, message, flag, value=None):
        """Follows an advice to give a flag, with a value in place of that of the message."""
        self.assertIn(flag + (' ' if value else ''), message)
        self.works([*arguments, flag, *([value] if value else [])], message)

    # ---- Distances. ----

    def test_distances_that_are_missing_or_none(self):
        self.file('a.img', ramp(120))
        for name, data in (
                ('a.nii', nifti(distances=(1, 0, 1))),
                ('q.nii', nifti(qform=1, distances=(1, -2, 1))),
                ('a.hdr', analyze((1, 1, 0))),
                ('a.nrrd', nrrd((6, 5, 4), 'spacings: 1 nan 2\n')),
                ('a.mha', b'ObjectType = Image\nNDims = 3\nDimSize = 6 5 4\nElementSpacing = 1 1 -1\n'
                          b'ElementType = MET_UCHAR\nElementDataFile = LOCAL\n' + ramp(120)),
                ('a.tif', tiff(4, resolution=(100, 50))),
                ('b.tif', tiff(4, 'ImageJ=1\nimages=4\nunit=um\nspacing=3\n')),
                ('c.tif', tiff(4, '<OME><Image><Pixels SizeX="6" SizeY="5" SizeZ="4" SizeC="1" SizeT="1" '
                                  'DimensionOrder="XYZCT" PhysicalSizeX="0.1" PhysicalSizeY="0.1"/></Image></OME>')),
                ('b.nrrd', nrrd((6, 5, 4), 'spacings: 1 0 -2\n')),
                ('a.vti', vti('Spacing="1 0 1"')),
                ('a.vtk', legacy_vtk('SPACING 1 1 0\n')),
                ('a.mrc', mrc(cell=(6, 0, 4)))):
            with self.subTest(name):
                self.follow_on_all(self.file(name, data), ['--spacing'])

    def test_distances_of_dicom(self):
        for name, spacing in (('none', '0\\1'), ('text', 'one\\two')):
            with self.subTest(name):
                os.mkdir(os.path.join(self.folder, name))
                for z in range(3):
                    self.file(f'{name}/{z}.dcm', dicom(z, spacing))
                self.follow_on_all(os.path.join(self.folder, name), ['--spacing'])

    def test_distances_of_hdf5(self):
        try:
            import h5py  # pylint: disable=import-outside-toplevel
        except ImportError:
            skips.skip('h5py', 'h5py is not installed')
        path = os.path.join(self.folder, 'a.h5')
        with h5py.File(path, 'w') as file:
            volume = file.create_dataset('v', (4, 5, 6), 'u1', list(ramp(120)))
            volume.attrs['element_size_um'] = (1.0, 0.0, 2.0)
        self.follow_on_all(path, ['--spacing'])

    def test_origins_and_directions_that_are_none(self):
        nan = float('nan')
        turn = (1, 0, 0, 0, 1, 0, 0, 0, 1)
        for name, data, flags in (
                ('a.nii', nifti(rows=(*turn[:3], nan, *turn[3:6], 0, *turn[6:], 0)), ['--origin']),
                ('b.nii', nifti(rows=(nan, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0)), ['--spacing', '--direction']),
                ('a.nrrd', nrrd((6, 5, 4), 'space: LPS\nspace directions: (1,0,0) (0,0,0) (0,0,1)\n'),
                 ['--spacing', '--direction']),
                ('b.nrrd', nrrd((6, 5, 4), 'space: LPS\nspace directions: (1,0,0) (0,1,0) (1,1,0)\n'),
                 ['--direction']),
                ('c.nrrd', nrrd((6, 5, 4), 'space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n'
                                           'space origin: (nan,0,0)\n'), ['--origin']),
                ('a.mha', b'ObjectType = Image\nNDims = 3\nDimSize = 6 5 4\nOffset = 1 inf 0\n'
                          b'ElementType = MET_UCHAR\nElementDataFile = LOCAL\n' + ramp(120), ['--origin']),
                ('b.mha', b'ObjectType = Image\nNDims = 3\nDimSize = 6 5 4\nTransformMatrix = 1 0 0 1 0 0 0 0 1\n'
                          b'ElementType = MET_UCHAR\nElementDataFile = LOCAL\n' + ramp(120), ['--direction']),
                ('a.vti', vti('Origin="nan 0 0"'), ['--origin']),
                ('b.vti', vti('Direction="1 0 0 nan 1 0 0 0 1" Spacing="0 1 1"'), ['--spacing', '--direction']),
                ('a.vtk', legacy_vtk('ORIGIN 0 0 -inf\n'), ['--origin']),
                ('a.mrc', mrc(origin=(nan, 1, 1)), ['--origin']),
                ('b.mrc', mrc(angles=(90, 180, 90)), ['--direction'])):
            with self.subTest(name):
                self.follow_on_all(self.file(name, data), flags)

    def follow_on_all(self, path, flags):
        """Follows the advice to give these flags, and no other ones, by each command."""
        values = {'--spacing': '1,2,3', '--origin': '7,8,9', '--direction': '1,0,0,0,1,0,0,0,1'}
        for command in (['render', path, '--isovalue', '5', '--output', self.output() + '.png'], ['info', path],
                        ['partition', path, '--output', self.output()]):
            message = self.refused(command, re.escape(flags[0]))
            advised = re.findall(r'(--(?:spacing|origin|direction)) X', message)
            self.assertEqual(advised, flags, message)
            self.works(command + [word for flag in flags for word in (flag, values[flag])], message)

    # ---- Grids. ----

    def test_sheared_axes(self):
        path = self.file('a.nii', nifti(rows=(1, 0.3, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0)))
        render = ['render', path, '--isovalue', '60', '--output', self.output() + '.png']
        message = self.refused(render, 'sheared')
        self.flag(render, message, '--ignore-shear')

    def test_uneven_axes(self):
        levels = ('z', ['z'], {}, [0, 1, 3, 7])
        values = ('p', ['z', 'y', 'x'], {}, [float(i) for i in range(120)])
        for name, data in (('a.nc', cdf([('z', 4), ('y', 5), ('x', 6)], [levels, values])),
                           ('a.vtr', vtk_xml('RectilinearGrid', coordinates('0 1 5')))):
            with self.subTest(name):
                path = self.file(name, data)
                render = ['render', path, '--isovalue', '5', '--output', self.output() + '.png']
                message = self.refused(render, 'is not even')
                self.flag(render, message, '--resample')

    # ---- The meaning of axes. ----

    def test_axes_of_netcdf_without_meaning(self):
        values = [float(i % 251) for i in range(360)]
        path = self.file('a b.nc', cdf([('run', 3), ('lev', 4), ('lat', 5), ('lon', 6)],
                                       [('u', ['run', 'lev', 'lat', 'lon'], {}, values)]))
        for command in (['render', path, '--isovalue', '60', '--output', self.output() + '.png'], ['info', path],
                        ['info', path + ':u'], ['partition', path, '--output', self.output()]):
            self.commands(self.refused(command, r'run \(\?, 3\)'))

    def test_axes_of_zarr(self):
        folder = os.path.join(self.folder, 'a b.zarr')
        os.makedirs(os.path.join(folder, 'u'))
        shape = [3, 4, 5, 6]
        self.file('a b.zarr/.zgroup', b'{"zarr_format": 2}')
        self.file('a b.zarr/u/.zattrs', b'{"_ARRAY_DIMENSIONS": ["run", "lev", "lat", "lon"]}')
        self.file('a b.zarr/u/.zarray', json.dumps(
            {'zarr_format': 2, 'shape': shape, 'chunks': shape, 'dtype': '|u1', 'order': 'C', 'compressor': None, 'filters': None,
             'fill_value': 0}).encode())
        self.file('a b.zarr/u/0.0.0.0', ramp(360))
        for command in (['render', folder, '--isovalue', '60', '--output', self.output() + '.png'], ['info', folder],
                        ['info', folder + ':u'], ['partition', folder, '--output', self.output()]):
            self.commands(self.refused(command, 'its axes are run'))

    def test_pages_of_tiff(self):
        for name, description in (('a.tif', 'ImageJ=1\nimages=4\nslices=3\nframes=2\n'),
                                  ('b.tif', '<OME><Image/></OME>'),
                                  ('c.tif', '<OME><Image><Pixels SizeX="6" SizeY="5" SizeZ="1" SizeC="1" SizeT="4" '
                                            'DimensionOrder="XYZCT"/></Image></OME>'),
                                  ('d.tif', 'ImageJ=1\nimages=9\nslices=9\n')):
            with self.subTest(name):
                path = self.file(name, tiff(4, description))
                self.commands(self.refused(['info', path], 'say what its pages are'))

    def test_slices_without_numbers(self):
        names = ('c.png', 'd.png')
        for i, name in enumerate(names):
            self.file(name, png(50 * i))
        render = ['render', self.folder, '--isovalue', '60', '--output', self.output() + '.webp']
        message = self.refused(['info', self.folder], 'no number says in which order the files lie: c.png, d.png')
        self.flag(['info', self.folder], message, '--axes', 'Z')
        self.flag(render, self.refused(render, 'no number says'), '--input-axes', 'Z')
        for given, name in zip(names, re.findall(r'z\d\.png', message)):
            os.rename(os.path.join(self.folder, given), os.path.join(self.folder, name))
        self.works(['info', self.folder], message)

    # ---- Several volumes. ----

    def test_several_volumes_in_one_file(self):
        volumes = nrrd((6, 5, 4, 3), 'kinds: domain domain domain time\n', count=360)
        path = self.file('four.nrrd', volumes)
        status, message = self.run_isoscope(['render', path, '--isovalue', '60', '--output', self.output() + '.png'])
        self.assertEqual(status, 0, message)
        self.assertIn('takes step 2 of 0 to 2; --step chooses', message)

    def test_components_of_a_vti(self):
        data = vtk_xml('ImageData', '').replace(b'Name="p"', b'Name="p" NumberOfComponents="3"')
        data = data.replace(b' 11<', b' ' + b' '.join(str(i).encode() for i in range(11, 36)) + b'<')
        path = self.file('v.vti', data)
        status, message = self.run_isoscope(['render', path, '--isovalue', '9', '--output', self.output() + '.png'])
        if status != 0:
            part = re.search(r'as in (\S+)[;,]', message)
            self.assertTrue(part, message)
            self.works(['render', part.group(1), '--isovalue', '9', '--output', self.output() + '.png'], message)

    # ---- Names of files. ----

    def test_files_by_another_name(self):
        for name, data in (('a.vti', vtk_xml('RectilinearGrid', coordinates('0 1 2'))),
                           ('b.vtr', vtk_xml('ImageData', ''))):
            with self.subTest(name):
                path = self.file(name, data)
                message = self.refused(['info', path], 'rename it to end in')
                ending = re.search(r'rename it to end in (\.\w+)', message).group(1)
                renamed = path[:-4] + ending
                os.rename(path, renamed)
                self.works(['info', renamed], message)

    def test_samples_that_are_raw(self):
        for name in ('a.mrc', 'a.img', 'a.bin'):
            with self.subTest(name):
                path = self.file(name, ramp(120))
                message = self.refused(['info', path], '--dims')
                ending = re.search(r'rename it to end in (\.\w+)', message)
                if ending:
                    renamed = path[:-4] + ending.group(1)
                    os.rename(path, renamed)
                    path = renamed
                self.works(['info', path, '--dims', '6,5,4', '--type', 'uint8'], message)

    def test_netcdf_by_the_name_of_minc(self):
        path = self.file('a.mnc', cdf([('z', 4), ('y', 5), ('x', 6)],
                                      [('p', ['z', 'y', 'x'], {}, [float(i) for i in range(120)])]))
        message = self.refused(['info', path], '--format netcdf')
        self.works(['info', path, '--format', 'netcdf'], message)

    def test_a_format_by_its_name(self):
        path = self.file('a.bin', nrrd((6, 5, 4), ''))
        message = self.refused(['info', path, '--format', 'nrdd'], 'known are|expected one of')
        self.assertIn('nrrd', message)
        self.works(['info', path, '--format', 'nrrd'], message)

    # ---- A source without a time. ----

    def test_steps_that_need_a_time(self):
        series = self.output()
        volumes = self.file('four.nrrd', nrrd((6, 5, 4, 2), 'kinds: domain domain domain time\n', count=240))
        self.works(['partition', volumes, '--output', series], 'none')
        next_step = self.file('four_next.nrrd', nrrd((6, 5, 4), ''))
        append = ['partition', next_step, '--append', series, '--field', 'four']
        message = self.refused(append, 'give it with --time VALUE')
        self.flag(append, message, '--time', '9')

    # ---- The list. ----

    def test_every_advice_of_the_sources_has_its_case(self):
        with open(__file__, encoding='utf-8') as file:
            own = file.read()
        said = own[own.index('class AdviceTest'):]
        cases = [re.escape(text) for text in (
            '--spacing X,Y,Z', '--ignore-shear', '--resample interpolates', 'isoscope partition', '--axes Z',
            'rename it to end in', '--format netcdf', '--dims', '--format %s', 'give it with --time VALUE',
            'choose one of 0 to', '--origin X,Y,Z', '--direction XX,XY', 'number them, as in')]
        self.assertIn('def test_sheared_axes', said)
        missing = []
        for folder in ('core/source', 'core/formats', 'core/partition', 'client-cli/session'):
            for path in sorted(glob.glob(os.path.join(SOURCES, folder, '**', '*.cc'), recursive=True)):
                with open(path, encoding='utf-8') as file:
                    for sentence in sentences(file.read()):
                        if not any(re.search(p, sentence) for p in cases + [p for p, _ in ELSEWHERE]):
                            missing.append(f'{os.path.relpath(path, SOURCES)}: {sentence[:200]}')
        self.assertEqual(missing, [], 'advice that no case follows')
        tests = {os.path.basename(p) for p in glob.glob(os.path.join(SOURCES, 'tests/unit/**/*_test.cc'),
                                                        recursive=True)}
        for _, why in ELSEWHERE:
            if why.startswith('test: '):
                self.assertIn(why[6:], tests)


def sentences(text):
    """The literals of each error that advises a flag, a command or another path."""
    found = []
    for match in re.finditer(r'\w*(?:Error|NoSampleDistance)\(', text):
        depth, at, is_text = 1, match.end(), False
        while at < len(text) and depth:
            c = text[at]
            if is_text:
                at += c == '\\'
                is_text = c != '"'
            elif c == '"':
                is_text = True
            else:
                depth += (c == '(') - (c == ')')
            at += 1
        sentence = ''.join(re.findall(r'"((?:[^"\\]|\\.)*)"', text[match.end():at]))
        if re.search(r'(?<![\w-])--[a-z]|isoscope [a-z]+ |rename it to end|choose one|as in ', sentence):
            found.append(sentence)
    return found


if __name__ == '__main__':
    unittest.main()
