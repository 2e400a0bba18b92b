"""Writes one volume of uint16 as a file of each format; for partition_formats.py."""
import gzip
import struct
import zlib

import h5py
import netCDF4
import numpy
import PIL.Image
import pydicom


# Each writer takes an empty folder and the samples [z][y][x], and returns the file, and the flags that describe it.

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


def write_images(folder, samples, ending):
    """Slices, a file each; those of 8 bits have the upper half of each sample."""
    path = folder / ending
    path.mkdir()
    planes = samples if ending in ('png', 'jp2') else (samples >> 8).astype('u1')
    for z, plane in enumerate(planes):
        PIL.Image.fromarray(plane).save(path / f'{z:04}.{ending}')
    return path, []


def write_tiff(folder, samples, name='a.tif', first_tags=()):
    """first_tags: of the first page alone: (number, type, bytes)."""
    nz, ny, nx = samples.shape
    plane_bytes = nx * ny * 2
    tags = [(256, 4, nx), (257, 4, ny), (258, 3, 16), (259, 3, 1), (262, 3, 1), (273, 4, 0), (277, 3, 1),
            (278, 4, ny), (279, 4, plane_bytes)]
    path = folder / name
    with open(path, 'wb') as file:
        file.write(struct.pack('<2sHI', b'II', 42, 8))
        at = 8
        for z in range(nz):
            more = first_tags if z == 0 else ()
            extra = at + 2 + 12 * (len(tags) + len(more)) + 4
            data = extra + sum(len(text) for _, _, text in more)
            entries = [(tag, kind, 1, data if tag == 273 else value) for tag, kind, value in tags]
            for tag, kind, text in more:
                entries.append((tag, kind, len(text), extra))
                extra += len(text)
            following = data + plane_bytes if z + 1 < nz else 0
            file.write(struct.pack('<H', len(entries)) +
                       b''.join(struct.pack('<HHII', *entry) for entry in sorted(entries)) +
                       struct.pack('<I', following) +
                       b''.join(text for _, _, text in more) + samples[z].tobytes())
            at = following
    return path, []


def write_ome(folder, samples):
    nz, ny, nx = samples.shape
    text = (f'<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
            f'<Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" SizeX="{nx}" SizeY="{ny}" SizeZ="{nz}" '
            f'SizeC="1" SizeT="1"><Channel ID="Channel:0:0"/><TiffData IFD="0" PlaneCount="{nz}"/></Pixels></Image>'
            '</OME>')
    return write_tiff(folder, samples, 'a.ome.tif', [(270, 2, text.encode() + b'\0')])


def write_lsm(folder, samples):
    info = bytearray(500)
    struct.pack_into('<I6i', info, 0, 0x00400494C, 500, samples.shape[2], samples.shape[1], samples.shape[0], 1, 1)
    struct.pack_into('<3d', info, 40, 1e-7, 1e-7, 1e-7)
    return write_tiff(folder, samples, 'a.lsm', [(34412, 1, bytes(info))])


def write_analyze(folder, samples):
    path = folder / 'a.hdr'
    path.write_bytes(nifti_header((samples // 2).astype('<i2'), b'', 0).replace(
        struct.pack('<2h', 512, 16), struct.pack('<2h', 4, 16)))
    (folder / 'a.img').write_bytes((samples // 2).astype('<i2').tobytes())
    return path, []


def write_afni(folder, samples):
    def attribute(kind, name, values):
        text = f"'{values}~" if kind == 'string' else ' '.join(str(value) for value in values)
        count = len(values) + 1 if kind == 'string' else len(values)
        return f'type = {kind}-attribute\nname = {name}\ncount = {count}\n{text}\n\n'

    path = folder / 'a+orig.HEAD'
    path.write_text(''.join((
        attribute('integer', 'DATASET_DIMENSIONS', [*samples.shape[::-1], 0, 0]),
        attribute('integer', 'DATASET_RANK', [3, 1]),
        attribute('integer', 'BRICK_TYPES', [1]),
        attribute('float', 'BRICK_FLOAT_FACS', [0]),
        attribute('string', 'BYTEORDER_STRING', 'LSB_FIRST'),
        attribute('float', 'IJK_TO_DICOM_REAL', [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]))))
    (folder / 'a+orig.BRIK').write_bytes((samples // 2).astype('<i2').tobytes())
    return path, []


def write_par_rec(folder, samples):
    nz, ny, nx = samples.shape
    images = ''.join(f'{z + 1} 1 1 1 0 2 {z} 16 100 {nx} {ny} 0 1 0.004 1070 1860 0 0 0 0 0 0 1 0 0 1 0 2 1 1 10 0 0 0 '
                     '1 90 0 0 0 1 0.0\n' for z in range(nz))
    path = folder / 'a.PAR'
    path.write_text('# === DATA DESCRIPTION FILE ===\n#\n# CLINICAL TRYOUT   Research image export tool   V4\n#\n'
                    f'.    Max. number of slices/locations    :   {nz}\n'
                    '.    Angulation midslice(ap,fh,rl)[degr]:   0 0 0\n'
                    f'.    Off Centre midslice(ap,fh,rl) [mm] :   0 0 0\n#\n\n{images}\n'
                    '# === END OF DATA DESCRIPTION FILE ===\n')
    (folder / 'a.REC').write_bytes(samples.tobytes())
    return path, []


def write_cube(folder, samples):
    """Voxels of x lie together as text: its last axis is the first of the samples in memory."""
    texts = numpy.array([f' {value:5}'.encode() for value in range(65536)], 'S6')
    counts = samples.shape
    path = folder / 'a.cube'
    with open(path, 'wb') as file:
        file.write(b'a\nb\n')
        file.write(b'1 0 0 0\n' + b''.join(f'{count} {" ".join("1" if i == axis else "0" for i in range(3))}\n'.encode()
                                           for axis, count in enumerate(counts)) + b'1 1 0 0 0\n')
        for plane in samples:
            for row in plane:
                file.write(texts[row].tobytes() + b'\n')
    return path, []


def write_pvti(folder, samples):
    middle = samples.shape[0] // 2
    extents = []
    for name, begin, end in (('0.vti', 0, middle), ('1.vti', middle, samples.shape[0] - 1)):
        piece = samples[begin:end + 1]
        path, _ = write_vti(folder, piece)
        extent = f'0 {samples.shape[2] - 1} 0 {samples.shape[1] - 1} {begin} {end}'
        whole = path.read_bytes().replace(vtk_extent(piece).encode(), extent.encode(), 2)
        (folder / name).write_bytes(whole)
        path.unlink()
        extents.append(f'<Piece Extent="{extent}" Source="{name}"/>')
    path = folder / 'a.pvti'
    path.write_text(f'<VTKFile type="PImageData" version="1.0"><PImageData WholeExtent="{vtk_extent(samples)}" '
                    'GhostLevel="0" Origin="0 0 0" Spacing="1 1 1"><PPointData><PDataArray type="UInt16" Name="a"/>'
                    f'</PPointData>{"".join(extents)}</PImageData></VTKFile>')
    return path, []


def write_vtk_hdf(folder, samples):
    path = folder / 'a.vtkhdf'
    with h5py.File(path, 'w') as file:
        root = file.create_group('VTKHDF')
        root.attrs['Version'] = [1, 0]
        root.attrs['Type'] = numpy.bytes_('ImageData')
        root.attrs['WholeExtent'] = [n for count in samples.shape[::-1] for n in (0, count - 1)]
        root.attrs['Origin'], root.attrs['Spacing'] = [0.0] * 3, [1.0] * 3
        root.create_dataset('PointData/a', data=samples)
    return path, []


def write_open_pmd(folder, samples, iterations=1):
    for number in range(iterations):
        path = folder / (f'data{number}.h5' if iterations > 1 else 'data.h5')
        with h5py.File(path, 'w') as file:
            for name, text in (('openPMD', '1.1.0'), ('basePath', '/data/%T/'), ('meshesPath', 'fields/')):
                file.attrs[name] = numpy.bytes_(text)
            mesh = file.create_dataset(f'data/{number}/fields/rho', data=samples)
            iteration = file[f'data/{number}']
            iteration.attrs['time'], iteration.attrs['timeUnitSI'] = float(number), 1.0
            mesh.attrs['geometry'], mesh.attrs['dataOrder'] = numpy.bytes_('cartesian'), numpy.bytes_('C')
            mesh.attrs['axisLabels'] = numpy.array(['z', 'y', 'x'], 'S1')
            mesh.attrs['gridSpacing'], mesh.attrs['gridGlobalOffset'] = [1.0] * 3, [0.0] * 3
            mesh.attrs['gridUnitSI'], mesh.attrs['unitSI'] = 1.0, 1.0
    if iterations == 1:
        return path, []
    return folder / 'data%T.h5', ['--step', '1']


def write_imaris(folder, samples):
    def texts(group, **values):
        for name, value in values.items():
            group.attrs[name] = numpy.array([c.encode() for c in str(value)], 'S1')

    path = folder / 'a.ims'
    with h5py.File(path, 'w') as file:
        texts(file, ImarisVersion='5.5.0')
        image = file.create_group('DataSetInfo/Image')
        texts(image, Unit='um', **dict(zip('XYZ', samples.shape[::-1])))
        for axis, count in enumerate(samples.shape[::-1]):
            texts(image, **{f'ExtMin{axis}': 0, f'ExtMax{axis}': count})
        texts(file.create_group('DataSetInfo/Channel 0'), Name='a')
        file.create_dataset('DataSet/ResolutionLevel 0/TimePoint 0/Channel 0/Data', data=samples, chunks=(16, 64, 64),
                            compression='gzip', compression_opts=1)
    return path, []


def write_itk_hdf5(folder, samples):
    path = folder / 'itk.h5'
    with h5py.File(path, 'w') as file:
        image = file.create_group('ITKImage/0')
        image['Origin'], image['Spacing'], image['Directions'] = numpy.zeros(3), numpy.ones(3), numpy.eye(3)
        image['VoxelData'] = samples
    return path, []


def write_vdb(folder, samples):
    """Floats, all of them in leaves; half as many, since a float has twice the bytes."""
    import pyopenvdb  # Debian's module needs the numpy of the system

    grid = pyopenvdb.FloatGrid()
    grid.copyFromArray(numpy.ascontiguousarray(samples[:, :, ::2].transpose(2, 1, 0)).astype('f4'))
    path = folder / 'a.vdb'
    pyopenvdb.write(str(path), grids=[grid])
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
    'OME-TIFF': write_ome,
    'LSM': write_lsm,
    'Analyze': write_analyze,
    'AFNI': write_afni,
    'PAR/REC': write_par_rec,
    'cube': write_cube,
    'PVTI': write_pvti,
    'VTKHDF': write_vtk_hdf,
    'openPMD': write_open_pmd,
    'openPMD files': lambda folder, samples: write_open_pmd(folder, samples, 2),
    'Imaris': write_imaris,
    'ITK HDF5': write_itk_hdf5,
    'OpenVDB': write_vdb,
    'PNG slices': lambda folder, samples: write_images(folder, samples, 'png'),
    'BMP slices': lambda folder, samples: write_images(folder, samples, 'bmp'),
    'JPEG 2000 slices': lambda folder, samples: write_images(folder, samples, 'jp2'),
    'JPEG slices': lambda folder, samples: write_images(folder, samples, 'jpg'),
}
