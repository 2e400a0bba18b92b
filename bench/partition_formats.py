#!/usr/bin/env python3
"""Partitions one volume of uint16 from a file of each format: time and peak memory.

    python3 bench/partition_formats.py --bin build/release/bin
    python3 bench/partition_formats.py --bin OLD/bin --bin build/release/bin --runs 15 --dims 512,512,234

The volume is smooth with noise, so that compressed files are a half of it. Each run calls `isoscope partition FILE
--memory-limit 128MiB` for each format and each folder of programs in turn. Time is the wall clock of the whole
program. Memory is the peak of the program (VmHWM, read until it ends) plus that of its child process, where a library
reads the file; pages that both share count twice. Two --bin folders compare two versions: the first is the base, and
the table has medians of the ratios of pairs, base over the other.

Needs python3-numpy, python3-h5py, python3-netcdf4 and python3-pydicom.
"""
import argparse
import gzip
import json
import os
import pathlib
import select
import shutil
import statistics
import struct
import subprocess
import sys
import tempfile
import time
import zlib

import h5py
import netCDF4
import numpy
import pydicom

LIMIT = '128MiB'


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--bin', action='append', required=True, help='folder of the programs; the first is the base')
    parser.add_argument('--dims', default='512,512,320', help='samples on x, y and z')
    parser.add_argument('--formats', help='some of them, by names of the table, separated by commas')
    parser.add_argument('--runs', type=int, default=3)
    parser.add_argument('--folder', help='for the files (default: a temporary one)')
    parser.add_argument('--json', help='where all measurements go')
    return parser.parse_args()


def make_volume(dims):
    nx, ny, nz = dims
    z, y, x = numpy.ogrid[0:nz, 0:ny, 0:nx]
    smooth = 8000 * (numpy.sin(x / 37) + numpy.sin(y / 29) + numpy.sin(z / 23)) + 30000
    return (smooth + numpy.random.default_rng(1).integers(0, 256, (nz, ny, nx))).astype('<u2')


# Each writer takes the folder and the samples [z][y][x], and returns the file, and the flags that describe it.

def write_raw(folder, samples):
    path = folder / 'a.raw'
    samples.tofile(path)
    dims = ','.join(str(n) for n in samples.shape[::-1])
    return path, ['--dims', dims, '--type', 'uint16']


def write_nrrd(folder, samples, encoding='raw'):
    path = folder / f'{encoding}.nrrd'
    sizes = ' '.join(str(n) for n in samples.shape[::-1])
    head = (f'NRRD0004\ntype: uint16\ndimension: 3\nsizes: {sizes}\nencoding: {encoding}\nendian: little\n\n').encode()
    data = samples.tobytes()
    path.write_bytes(head + (gzip.compress(data, 1) if encoding == 'gzip' else data))
    return path, []


def write_meta_image(folder, samples, compressed=False):
    path = folder / ('z.mha' if compressed else 'a.mha')
    data = zlib.compress(samples.tobytes(), 1) if compressed else samples.tobytes()
    sizes = ' '.join(str(n) for n in samples.shape[::-1])
    head = f'ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nDimSize = {sizes}\n'
    if compressed:
        head += f'CompressedData = True\nCompressedDataSize = {len(data)}\n'
    path.write_bytes((head + 'ElementType = MET_USHORT\nElementDataFile = LOCAL\n').encode() + data)
    return path, []


def nifti_header(samples, magic, offset):
    head = bytearray(348)
    struct.pack_into('<i', head, 0, 348)
    struct.pack_into('<8h', head, 40, 3, *samples.shape[::-1], 1, 1, 1, 1)
    struct.pack_into('<2h', head, 70, 512, 16)
    struct.pack_into('<8f', head, 76, 1, 1, 1, 1, 0, 0, 0, 0)
    struct.pack_into('<2f', head, 108, offset, 1)
    if magic:
        struct.pack_into('<2h', head, 252, 0, 1)
        for row in range(3):
            struct.pack_into('<4f', head, 280 + 16 * row, *(float(row == column) for column in range(4)))
        head[344:348] = magic
    return bytes(head)


def write_nifti(folder, samples, zipped=False):
    data = nifti_header(samples, b'n+1\0', 352) + bytes(4) + samples.tobytes()
    path = folder / ('a.nii.gz' if zipped else 'a.nii')
    path.write_bytes(gzip.compress(data, 1) if zipped else data)
    return path, []


def write_nifti2(folder, samples):
    head = bytearray(540)
    struct.pack_into('<i8s2h', head, 0, 540, b'n+2\0\r\n\x1a\n', 512, 16)
    struct.pack_into('<8q', head, 16, 3, *samples.shape[::-1], 1, 1, 1, 1)
    struct.pack_into('<8d', head, 104, 1, 1, 1, 1, 0, 0, 0, 0)
    struct.pack_into('<q2d', head, 168, 544, 1, 0)
    struct.pack_into('<2i', head, 344, 0, 1)
    for row in range(3):
        struct.pack_into('<4d', head, 400 + 32 * row, *(float(row == column) for column in range(4)))
    path = folder / 'two.nii'
    path.write_bytes(bytes(head) + bytes(4) + samples.tobytes())
    return path, []


def write_mgh(folder, samples):
    head = bytearray(284)
    struct.pack_into('>7i', head, 0, 1, *samples.shape[::-1], 1, 4, 0)  # int16, the nearest that it has
    path = folder / 'a.mgh'
    path.write_bytes(bytes(head) + (samples // 2).astype('>i2').tobytes())
    return path, []


def write_mrc(folder, samples):
    nx, ny, nz = samples.shape[::-1]
    head = bytearray(1024)
    struct.pack_into('<10i', head, 0, nx, ny, nz, 6, 0, 0, 0, nx, ny, nz)
    struct.pack_into('<6f3i', head, 40, nx, ny, nz, 90, 90, 90, 1, 2, 3)
    head[208:212] = b'MAP '
    head[212:216] = bytes([0x44, 0x44, 0, 0])
    path = folder / 'a.mrc'
    path.write_bytes(bytes(head) + samples.tobytes())
    return path, []


def vtk_extent(samples):
    return ' '.join(f'0 {n - 1}' for n in samples.shape[::-1])


def write_legacy_vtk(folder, samples):
    dims = ' '.join(str(n) for n in samples.shape[::-1])
    head = (f'# vtk DataFile Version 3.0\na\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS {dims}\nORIGIN 0 0 0\n'
            f'SPACING 1 1 1\nPOINT_DATA {samples.size}\nSCALARS a unsigned_short\nLOOKUP_TABLE default\n')
    path = folder / 'a.vtk'
    path.write_bytes(head.encode() + samples.astype('>u2').tobytes())
    return path, []


def write_vti(folder, samples, compressed=False):
    compressor = ' compressor="vtkZLibDataCompressor"' if compressed else ''
    data = samples.tobytes()
    if compressed:
        size = 1 << 15
        blocks = [zlib.compress(data[at:at + size], 1) for at in range(0, len(data), size)]
        head = struct.pack(f'<{3 + len(blocks)}Q', len(blocks), size, len(data) % size, *map(len, blocks))
        data = head + b''.join(blocks)
    else:
        data = struct.pack('<Q', len(data)) + data
    extent = vtk_extent(samples)
    text = (f'<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64"{compressor}>'
            f'<ImageData WholeExtent="{extent}" Origin="0 0 0" Spacing="1 1 1"><Piece Extent="{extent}"><PointData>'
            '<DataArray type="UInt16" Name="a" format="appended" offset="0"/></PointData></Piece></ImageData>'
            '<AppendedData encoding="raw">_')
    path = folder / ('z.vti' if compressed else 'a.vti')
    path.write_bytes(text.encode() + data + b'</AppendedData></VTKFile>')
    return path, []


def write_vtr(folder, samples):
    arrays = [samples, *(numpy.arange(n, dtype='<f8') for n in samples.shape[::-1])]
    blobs = [struct.pack('<Q', array.nbytes) + array.tobytes() for array in arrays]
    offsets = [sum(len(blob) for blob in blobs[:i]) for i in range(len(blobs))]
    axes = ''.join(f'<DataArray type="Float64" Name="{"xyz"[i]}" format="appended" offset="{offsets[i + 1]}"/>'
                   for i in range(3))
    extent = vtk_extent(samples)
    text = ('<VTKFile type="RectilinearGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">'
            f'<RectilinearGrid WholeExtent="{extent}"><Piece Extent="{extent}"><PointData>'
            f'<DataArray type="UInt16" Name="a" format="appended" offset="0"/></PointData><Coordinates>{axes}'
            '</Coordinates></Piece></RectilinearGrid><AppendedData encoding="raw">_')
    path = folder / 'a.vtr'
    path.write_bytes(text.encode() + b''.join(blobs) + b'</AppendedData></VTKFile>')
    return path, []


def write_hdf5(folder, samples, chunked=False):
    path = folder / ('chunks.h5' if chunked else 'a.h5')
    options = {'chunks': (16, 64, 64), 'compression': 'gzip', 'compression_opts': 1} if chunked else {}
    with h5py.File(path, 'w') as file:
        file.create_dataset('a', data=samples, **options)
    return path, []


def write_netcdf(folder, samples, kind):
    path = folder / f'{kind}.nc'
    kinds = {'netcdf3': ('NETCDF3_64BIT_OFFSET', 'i2'), 'netcdf4': ('NETCDF4', 'u2')}
    with netCDF4.Dataset(path, 'w', format=kinds[kind][0]) as file:
        for name, count in zip('zyx', samples.shape):
            file.createDimension(name, count)
        variable = file.createVariable('a', kinds[kind][1], tuple('zyx'))
        variable[:] = samples if kind == 'netcdf4' else (samples // 2).astype('i2')
    return path, []


def write_minc1(folder, samples):
    path = folder / 'a.mnc'
    names = ['zspace', 'yspace', 'xspace']
    with netCDF4.Dataset(path, 'w', format='NETCDF3_CLASSIC') as file:
        for name, count in zip(names, samples.shape):
            file.createDimension(name, count)
            axis = file.createVariable(name, 'i4')
            axis.step, axis.start, axis.spacing = 1.0, 0.0, 'regular__'
        for name, value in (('image-min', 0.0), ('image-max', 32767.0)):
            file.createVariable(name, 'f8')[...] = value
        image = file.createVariable('image', 'i2', tuple(names))
        image.signtype, image.valid_range = 'signed__', numpy.array([0.0, 32767.0])
        image[:] = (samples // 2).astype('i2')
    return path, []


def dicom_dataset(samples, syntax):
    dataset = pydicom.Dataset()
    dataset.file_meta = pydicom.dataset.FileMetaDataset()
    dataset.file_meta.TransferSyntaxUID = syntax
    dataset.is_little_endian, dataset.is_implicit_VR = True, False
    dataset.SeriesInstanceUID = '1.2.3'
    dataset.Rows, dataset.Columns = samples.shape[1:]
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, 'MONOCHROME2'
    dataset.BitsAllocated = dataset.BitsStored = 16
    dataset.HighBit, dataset.PixelRepresentation = 15, 0
    dataset.PixelSpacing = [1, 1]
    dataset.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
    return dataset


def save_dicom(dataset, path, storage):
    dataset.SOPClassUID = dataset.file_meta.MediaStorageSOPClassUID = storage
    dataset.SOPInstanceUID = dataset.file_meta.MediaStorageSOPInstanceUID = pydicom.uid.generate_uid()
    dataset.save_as(path, write_like_original=False)


def write_dicom_slices(folder, samples):
    path = folder / 'dicom'
    path.mkdir()
    for z, plane in enumerate(samples):
        dataset = dicom_dataset(samples, pydicom.uid.ExplicitVRLittleEndian)
        dataset.ImagePositionPatient = [0, 0, z]
        dataset.InstanceNumber = z + 1
        dataset.PixelData = plane.tobytes()
        save_dicom(dataset, path / f'{z:04}.dcm', pydicom.uid.CTImageStorage)
    return path, []


def write_dicom_frames(folder, samples):
    dataset = dicom_dataset(samples, pydicom.uid.ExplicitVRLittleEndian)
    dataset.NumberOfFrames = samples.shape[0]
    frames = []
    for z in range(samples.shape[0]):
        place, frame = pydicom.Dataset(), pydicom.Dataset()
        place.ImagePositionPatient = [0, 0, z]
        frame.PlanePositionSequence = [place]
        frames.append(frame)
    shared, measures, orientation = pydicom.Dataset(), pydicom.Dataset(), pydicom.Dataset()
    measures.PixelSpacing, measures.SliceThickness = [1, 1], 1
    orientation.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
    shared.PixelMeasuresSequence, shared.PlaneOrientationSequence = [measures], [orientation]
    dataset.SharedFunctionalGroupsSequence = [shared]
    dataset.PerFrameFunctionalGroupsSequence = frames
    dataset.PixelData = samples.tobytes()
    path = folder / 'frames.dcm'
    save_dicom(dataset, path, '1.2.840.10008.5.1.4.1.1.2.1')
    return path, []


def write_tiff(folder, samples):
    nz, ny, nx = samples.shape
    plane_bytes = nx * ny * 2
    tags = [(256, 4, nx), (257, 4, ny), (258, 3, 16), (259, 3, 1), (262, 3, 1), (273, 4, 0), (277, 3, 1),
            (278, 4, ny), (279, 4, plane_bytes)]
    path = folder / 'a.tif'
    with open(path, 'wb') as file:
        file.write(struct.pack('<2sHI', b'II', 42, 8))
        at = 8
        for z in range(nz):
            data = at + 2 + 12 * len(tags) + 4
            entries = b''.join(struct.pack('<HHII', tag, kind, 1, data if tag == 273 else value)
                               for tag, kind, value in tags)
            following = data + plane_bytes if z + 1 < nz else 0
            file.write(struct.pack('<H', len(tags)) + entries + struct.pack('<I', following) + samples[z].tobytes())
            at = following
    return path, []


FORMATS = {
    'raw': write_raw,
    'NRRD': write_nrrd,
    'NRRD gzip': lambda folder, samples: write_nrrd(folder, samples, 'gzip'),
    'MetaImage': write_meta_image,
    'MetaImage zlib': lambda folder, samples: write_meta_image(folder, samples, True),
    'NIfTI': write_nifti,
    'NIfTI gzip': lambda folder, samples: write_nifti(folder, samples, True),
    'VTI': write_vti,
    'VTI zlib': lambda folder, samples: write_vti(folder, samples, True),
    'HDF5': write_hdf5,
    'HDF5 gzip chunks': lambda folder, samples: write_hdf5(folder, samples, True),
    'TIFF': write_tiff,
    'DICOM slices': write_dicom_slices,
    'DICOM frames': write_dicom_frames,
    'NIfTI-2': write_nifti2,
    'MGH': write_mgh,
    'MRC': write_mrc,
    'legacy VTK': write_legacy_vtk,
    'VTR': write_vtr,
    'netCDF classic': lambda folder, samples: write_netcdf(folder, samples, 'netcdf3'),
    'netCDF-4': lambda folder, samples: write_netcdf(folder, samples, 'netcdf4'),
    'MINC 1': write_minc1,
}


def peak_kib(pid):
    """The largest resident memory of a process so far; 0 if it is gone."""
    try:
        for line in pathlib.Path(f'/proc/{pid}/status').read_text().splitlines():
            if line.startswith('VmHWM:'):
                return int(line.split()[1])
    except OSError:
        pass
    return 0


def children_of(pid):
    try:
        return [int(child) for child in pathlib.Path(f'/proc/{pid}/task/{pid}/children').read_text().split()]
    except OSError:
        return []


def partition(program, path, flags, output):
    """Seconds, MiB of the program and of its children; None in place of all if it refused the file."""
    shutil.rmtree(output, ignore_errors=True)
    start = time.perf_counter()
    process = subprocess.Popen([program, 'partition', path, *flags, '--output', output, '--memory-limit', LIMIT],
                               stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    own, of_children = 0, {}
    end = os.pidfd_open(process.pid)
    while not select.select([end], [], [], 0.02)[0]:
        own = max(own, peak_kib(process.pid))
        for child in children_of(process.pid):
            of_children[child] = max(of_children.get(child, 0), peak_kib(child))
    seconds = time.perf_counter() - start
    os.close(end)
    if process.wait() != 0:
        print(process.stderr.read().strip()[:300], file=sys.stderr)
        return None
    return seconds, own / 1024, max(of_children.values(), default=0) / 1024


def main():
    arguments = parse_arguments()
    names = arguments.formats.split(',') if arguments.formats else list(FORMATS)
    samples = make_volume([int(n) for n in arguments.dims.split(',')])
    measured = {}
    with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
        folder = pathlib.Path(folder)
        print('| format | seconds | program, MiB | child, MiB |' + (' ratio |' if len(arguments.bin) > 1 else ''))
        print('|---|---|---|---|' + ('---|' if len(arguments.bin) > 1 else ''), flush=True)
        for name in names:
            path, flags = FORMATS[name](folder, samples)
            runs = []
            for run in range(arguments.runs):
                order = arguments.bin if run % 2 == 0 else arguments.bin[::-1]
                pair = {bin_: partition(pathlib.Path(bin_) / 'isoscope', path, flags, folder / 'out') for bin_ in order}
                runs.append(pair)
            shutil.rmtree(path) if path.is_dir() else path.unlink()
            measured[name] = runs
            rows = [[run[bin_] for run in runs] for bin_ in arguments.bin]
            if None in rows[-1]:
                print(f'| {name} | refused | | |', flush=True)
                continue
            seconds = statistics.median(row[0] for row in rows[-1])
            line = f'| {name} | {seconds:.2f} | {max(r[1] for r in rows[-1]):.0f} | {max(r[2] for r in rows[-1]):.0f} |'
            if len(arguments.bin) > 1:
                known = None not in rows[0]
                line += f' {statistics.median(a[0] / b[0] for a, b in zip(*rows)):.3f} |' if known else ' new |'
            print(line, flush=True)
    if arguments.json:
        pathlib.Path(arguments.json).write_text(json.dumps({'dims': arguments.dims, 'runs': measured}, indent=1))


if __name__ == '__main__':
    main()
