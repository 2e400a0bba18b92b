"""Other programs' readers, for scripts/survey.py --compare: Debian's python3-nibabel, python3-h5py, python3-netcdf4,
python3-tifffile, python3-mrcfile, python3-pydicom, python3-zarr and python3-vtk9. Arrays of Zarr 3, which python3-zarr
does not read, are read here, with the codecs of python3-numcodecs. A reader that is not installed takes no file.

A reader gets the path and what `isoscope info --json` says of the first volume, and returns its samples in the same
order, [z][y][x], and the world positions of indices, as far as it knows them. It returns None for what it does not
take.
"""

import contextlib
import json
import math
import os

import numpy as np


class Other:
    """A volume of another reader: samples [z][y][x], and a 4 x 4 matrix from (x, y, z, 1) to the world, or None."""

    def __init__(self, samples, affine=None):
        self.samples = samples
        self.affine = affine

    def position_of(self, index):
        if self.affine is None:
            return None
        return [float(number) for number in (self.affine @ np.array([*index, 1.0]))[:3]]


def range_of(samples):
    """The least and the greatest of the finite samples, or None."""
    numbers = np.asarray(samples, dtype=np.float64).ravel()
    numbers = numbers[np.isfinite(numbers)]
    return [float(numbers.min()), float(numbers.max())] if numbers.size else None


def reversed_affine(affine):
    """The matrix of the same grid with its axes in the other order."""
    return affine[:, [2, 1, 0, 3]]


def read_with_nibabel(path, volume):
    import nibabel
    image = nibabel.load(path)
    data = image.dataobj
    is_slowest_first = path.lower().endswith(".mnc")
    if is_slowest_first:
        samples, affine = np.asarray(data), reversed_affine(image.affine)
        while samples.ndim > 3:
            samples = samples[0]
    else:
        slices = (slice(None),) * 3 + (0,) * (len(data.shape) - 3)
        samples, affine = np.asarray(data[slices]).T, image.affine
    if not isinstance(image, (nibabel.Nifti1Image, nibabel.MGHImage, nibabel.Minc1Image, nibabel.Minc2Image)):
        affine = None  # Analyze and PAR/REC have other conventions, or none
    if affine is not None:
        affine = np.diag([-1.0, -1.0, 1.0, 1.0]) @ affine  # RAS to LPS
    return Other(samples, affine)


def read_with_h5py(path, volume):
    import h5py
    found = []
    name = volume["fields"][0]["name"]

    def visit(where, item):
        if isinstance(item, h5py.Dataset) and where.rsplit("/", 1)[-1] == name:
            shape = [size for size in item.shape if size != 1]
            if shape == volume["sample_dims"][::-1]:
                found.append(item)

    with h5py.File(path, "r") as file:
        file.visititems(visit)
        return Other(found[0][()].reshape(volume["sample_dims"][::-1])) if len(found) == 1 else None


def read_with_netcdf4(path, volume):
    import netCDF4
    with netCDF4.Dataset(path) as file:
        group = file
        *groups, name = volume["fields"][0]["name"].split("/")
        for inner in groups:
            group = group[inner]
        variable = group[name]
        sizes = volume["sample_dims"][::-1]
        extra = len(variable.shape) - 3
        if extra < 0:
            return None
        # The first step, whichever axis that is: the others must have the sizes in this order.
        index = []
        left = list(sizes)
        for size in variable.shape:
            if left and size == left[0] and len(variable.shape) - len(index) <= len(left):
                index.append(slice(None))
                left.pop(0)
            elif extra > 0:
                index.append(0)
                extra -= 1
            else:
                index.append(slice(None))
                left and left.pop(0)
        data = variable[tuple(index)]
        return Other(np.ma.filled(np.ma.asarray(data, dtype=np.float64), math.nan))


def read_with_tifffile(path, volume):
    import tifffile
    pages = tifffile.imread(path)
    while pages.ndim > 3:
        pages = pages[0]
    return Other(pages)


def read_with_mrcfile(path, volume):
    import mrcfile
    with mrcfile.open(path, permissive=True) as file:
        data = np.asarray(file.data)
        return Other(data[0] if data.ndim == 4 else data)


def read_with_vtk(path, volume):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOLegacy import vtkStructuredPointsReader
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader
    reader = vtkXMLImageDataReader() if path.lower().endswith(".vti") else vtkStructuredPointsReader()
    reader.SetFileName(path)
    if path.lower().endswith(".vtk"):
        reader.ReadAllScalarsOn()
        reader.ReadAllVectorsOn()
    reader.Update()
    image = reader.GetOutput()
    if image is None or image.GetNumberOfPoints() == 0:
        return None
    name = volume["fields"][0]["name"]
    sizes = volume["sample_dims"][::-1]
    origin, spacing = np.array(image.GetOrigin()), np.array(image.GetSpacing())
    for data, shift in ((image.GetPointData(), 0.0), (image.GetCellData(), 0.5)):
        array = data.GetArray(name)
        if array is None or array.GetNumberOfTuples() != math.prod(sizes):
            continue
        values = vtk_to_numpy(array)
        matrix = image.GetDirectionMatrix()
        directions = np.array([[matrix.GetElement(row, column) for column in range(3)] for row in range(3)])
        affine = np.eye(4)
        affine[:3, :3] = directions * spacing
        affine[:3, 3] = origin + affine[:3, :3] @ (np.array(image.GetExtent()[::2]) + shift)
        return Other((values if values.ndim == 1 else values[:, 0]).reshape(sizes), affine)
    return None


def read_image_with_vtk(path, volume):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOImage import vtkMetaImageReader, vtkNrrdReader
    is_meta = path.lower().endswith((".mha", ".mhd"))
    reader = vtkMetaImageReader() if is_meta else vtkNrrdReader()
    if not reader.CanReadFile(path):
        return None
    reader.SetFileName(path)
    reader.Update()
    image = reader.GetOutput()
    values = vtk_to_numpy(image.GetPointData().GetScalars())
    # It does not read orientations of either format.
    return Other((values if values.ndim == 1 else values[:, 0]).reshape(volume["sample_dims"][::-1]))


def read_with_pydicom(path, series):
    """A series of slices, each a file; of several steps at equal places, the first."""
    import pydicom
    slices = []
    for folder, _, names in os.walk(path):
        for name in names:
            with contextlib.suppress(pydicom.errors.InvalidDicomError):
                file = pydicom.dcmread(os.path.join(folder, name))
                if "Rows" in file and series in (None, file.SeriesInstanceUID):
                    slices.append(file)
    if len({file.SeriesInstanceUID for file in slices}) != 1 or any(file.get("NumberOfFrames", 1) != 1 for file in slices):
        return None
    right, down = (np.array(slices[0].ImageOrientationPatient[i:i + 3], dtype=float) for i in (0, 3))
    normal = np.cross(right, down)
    at_places = {}
    for file in slices:
        at_places.setdefault(round(float(normal @ np.array(file.ImagePositionPatient, dtype=float)), 3), []).append(file)
    # What orders steps differs between makers; all of them number their images in it.
    ordered = [min(at_places[place], key=lambda file: int(file.InstanceNumber)) for place in sorted(at_places)]
    first, last = (np.array(ordered[i].ImagePositionPatient, dtype=float) for i in (0, -1))
    row_spacing, column_spacing = (float(number) for number in ordered[0].PixelSpacing)
    samples = np.stack([file.pixel_array * float(file.get("RescaleSlope", 1)) + float(file.get("RescaleIntercept", 0))
                        for file in ordered])
    affine = np.eye(4)
    affine[:3, :3] = np.column_stack([right * column_spacing, down * row_spacing, (last - first) / (len(ordered) - 1)])
    affine[:3, 3] = first
    return Other(samples, affine)


def decode_zarr(data, dtype, shape, codecs, fill):
    """The array that codecs of Zarr 3 have encoded, in NumPy alone. `fill`: what missing inner chunks of shards are."""
    import numcodecs
    dtype = dtype.newbyteorder("<")
    order = tuple(range(len(shape)))
    steps = []
    sharding = None
    for codec in codecs:
        configuration = codec.get("configuration", {})
        if codec["name"] == "transpose":
            axes = {"C": range(len(shape)), "F": range(len(shape))[::-1]}.get(str(configuration["order"]),
                                                                              configuration["order"])
            order = tuple(order[axis] for axis in axes)
        elif codec["name"] == "bytes":
            dtype = dtype.newbyteorder(">" if configuration.get("endian") == "big" else "<")
        elif codec["name"] == "sharding_indexed":
            sharding = configuration
        else:
            # Decoders need none of what Zarr's own codecs are configured with, and numcodecs does not know it all.
            name = codec["name"].removeprefix("numcodecs.")
            steps.append({"id": name, **(configuration if name != codec["name"] else {})})
    for step in reversed(steps):
        data = data[:-4] if step["id"] == "crc32c" else numcodecs.get_codec(step).decode(data)
    stored = tuple(shape[axis] for axis in order)
    array = (np.frombuffer(data, dtype).reshape(stored) if sharding is None else
             decode_shard(data, dtype, stored, sharding, fill))
    return np.transpose(array, np.argsort(order))


def decode_shard(data, dtype, shape, configuration, fill):
    inner = configuration["chunk_shape"]
    counts = [size // part for size, part in zip(shape, inner)]
    has_checksum = any(codec["name"] == "crc32c" for codec in configuration["index_codecs"])
    size = 16 * math.prod(counts) + (4 if has_checksum else 0)
    index = data[:size] if configuration.get("index_location") == "start" else data[-size:]
    entries = np.frombuffer(index[:16 * math.prod(counts)], "<u8").reshape(*counts, 2)
    array = np.full(shape, fill, dtype)
    for place in np.ndindex(*counts):
        offset, length = (int(number) for number in entries[place])
        if offset != 2**64 - 1:
            box = tuple(slice(i * part, (i + 1) * part) for i, part in zip(place, inner))
            array[box] = decode_zarr(data[offset:offset + length], dtype, tuple(inner), configuration["codecs"], fill)
    return array


def fill_of(value, dtype):
    """A number, or for floats "NaN", "Infinity", or bits such as "0x7fc00000"."""
    if isinstance(value, str) and value.startswith("0x"):
        return np.frombuffer(int(value, 16).to_bytes(dtype.itemsize, "little"), dtype.newbyteorder("<"))[0]
    return dtype.type(float(value)) if isinstance(value, str) else value or 0


def read_zarr3(folder, metadata):
    shape = metadata["shape"]
    chunk = metadata["chunk_grid"]["configuration"]["chunk_shape"]
    dtype = np.dtype(metadata["data_type"])
    keys = metadata["chunk_key_encoding"]
    is_v2 = keys["name"] == "v2"
    separator = keys.get("configuration", {}).get("separator", "." if is_v2 else "/")
    fill = fill_of(metadata["fill_value"], dtype)
    array = np.full([-(-size // part) * part for size, part in zip(shape, chunk)], fill, dtype)
    for place in np.ndindex(*[-(-size // part) for size, part in zip(shape, chunk)]):
        key = separator.join(([] if is_v2 else ["c"]) + [str(i) for i in place])
        path = os.path.join(folder, key)
        if os.path.exists(path):
            with open(path, "rb") as file:
                box = tuple(slice(i * part, (i + 1) * part) for i, part in zip(place, chunk))
                array[box] = decode_zarr(file.read(), dtype, tuple(chunk), metadata["codecs"], fill)
    return array[tuple(slice(size) for size in shape)]


def read_with_zarr(path, volume):
    """The first three axes from the end; of a store whose path is no array, none."""
    metadata_path = os.path.join(path, "zarr.json")
    if os.path.exists(metadata_path):
        with open(metadata_path, encoding="utf-8") as file:
            metadata = json.load(file)
        samples = read_zarr3(path, metadata) if metadata["node_type"] == "array" else None
    else:
        import zarr
        samples = zarr.open_array(path, mode="r")[...] if os.path.exists(os.path.join(path, ".zarray")) else None
    if samples is None or samples.ndim < 3:
        return None
    samples = samples[(0,) * (samples.ndim - 3)]
    return Other(samples) if list(samples.shape[::-1]) == volume["sample_dims"] else None


READERS = {
    ".nii": read_with_nibabel, ".nii.gz": read_with_nibabel, ".mgz": read_with_nibabel, ".mgh": read_with_nibabel,
    ".mnc": read_with_nibabel, ".hdr": read_with_nibabel, ".img": read_with_nibabel, ".par": read_with_nibabel,
    ".h5": read_with_h5py, ".hdf5": read_with_h5py, ".nxs": read_with_h5py, ".mat": read_with_h5py,
    ".hdf": read_with_h5py, ".nx5": read_with_h5py, ".h5ad": read_with_h5py,
    ".nc": read_with_netcdf4, ".nc4": read_with_netcdf4,
    ".tif": read_with_tifffile, ".tiff": read_with_tifffile,
    ".mrc": read_with_mrcfile, ".map": read_with_mrcfile, ".ccp4": read_with_mrcfile, ".map.gz": read_with_mrcfile,
    ".mrc.gz": read_with_mrcfile, ".ccp4.gz": read_with_mrcfile,
    ".vti": read_with_vtk, ".vtk": read_with_vtk,
    ".nrrd": read_image_with_vtk, ".nhdr": read_image_with_vtk, ".mha": read_image_with_vtk, ".mhd": read_image_with_vtk,
}


def read(path, volume, series=None):
    """The first volume of a file, or of one series of a DICOM folder, by another reader, or None."""
    if os.path.isdir(path):
        if any(os.path.exists(os.path.join(path, name)) for name in (".zarray", "zarr.json")):
            with contextlib.suppress(Exception):
                return read_with_zarr(path, volume)
            return None
        with contextlib.suppress(Exception):
            return read_with_pydicom(path, series)
        return None
    lower = path.lower()
    for ending in sorted(READERS, key=len, reverse=True):
        if lower.endswith(ending):
            with contextlib.suppress(Exception):  # whatever a reader thinks of a file
                return READERS[ending](path, volume)
            return None
    return None
