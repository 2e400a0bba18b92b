// Every file that a reader opens is among the files that decide the source, and each of these files
// changes the identity. Symptom: the cache gave the picture of an old file.
//
// Which files a reader opens, the system tells (tests/support/opened_files.h): also those that
// libraries open in a child process. A reader that begins to open another file fails here.

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_request.h"
#include "core/source/bytes/raw_file.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "core/source/source_stamps.h"
#include "hdf5.h"
#include "tests/support/dicom_file.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/hdf5_mesh_file.h"
#include "tests/support/medical_files.h"
#include "tests/support/opened_files.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/arrays/fits_bytes.h"
#include "tests/unit/core/formats/arrays/npy_bytes.h"
#include "tests/unit/core/formats/maps/mrc_bytes.h"
#include "tests/unit/core/formats/stacks/tiff_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"
#include "tests/unit/core/source/bytes/zip_bytes.h"
#include "zlib.h"

namespace isoscope::source {
namespace {

namespace fs = std::filesystem;

using ::isoscope::testing::AfniBytes;
using ::isoscope::testing::AnalyzeBytes;
using ::isoscope::testing::FitsCubeCards;
using ::isoscope::testing::FitsPartBytes;
using ::isoscope::testing::Gzip;
using ::isoscope::testing::Hdf5MeshWriter;
using ::isoscope::testing::MghBytes;
using ::isoscope::testing::MrcBytes;
using ::isoscope::testing::Nifti2Bytes;
using ::isoscope::testing::NiftiHeaderBytes;
using ::isoscope::testing::NpyBytes;
using ::isoscope::testing::NrrdHeader;
using ::isoscope::testing::ParBytes;
using ::isoscope::testing::ParImage;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::ReadFile;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::VtiBytes;
using ::isoscope::testing::WriteFile;
using ::isoscope::testing::WriteTiffStack;
using ::isoscope::testing::ZipBytes;
using ::testing::UnorderedElementsAreArray;

constexpr math::Index3 kDims{4, 3, 2};

// A source in a folder, and the names of all files that decide it.
struct Kind {
  const char* name;
  std::function<OpenRequest(const TempDir& dir)> make;
  std::vector<std::string> files;
};

std::string Int16() { return testing::Noise(kDims, volume::ScalarType::kInt16); }
std::string Bytes(char c) { return std::string(24, c); }

void LinkOut(hid_t file, const std::string& name, const std::string& to,
             const std::string& object) {
  ASSERT_GE(
      H5Lcreate_external(to.c_str(), object.c_str(), file, name.c_str(), H5P_DEFAULT, H5P_DEFAULT),
      0);
}

void WriteHdf5(const std::string& path, const std::string& dataset) {
  const Hdf5Handle file(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
  const std::vector<unsigned char> samples(24, 1);
  testing::WriteHdf5Dataset(file.get(), dataset, {2, 3, 4}, H5T_STD_U8LE, samples.data());
}

// An array of two chunks with the coordinates of one axis.
void WriteZarr(const TempDir& dir) {
  const auto array = [](const std::string& shape, const std::string& chunks,
                        const std::string& type) {
    return absl::StrCat("{\"zarr_format\": 2, \"shape\": ", shape, ", \"chunks\": ", chunks,
                        ", \"dtype\": \"", type,
                        "\", \"order\": \"C\", \"compressor\": null, \"fill_value\": 0, "
                        "\"filters\": null}");
  };
  const std::string root = "run.zarr/";
  dir.Write(root + ".zgroup", "{\"zarr_format\": 2}");
  dir.Write(root + "a/.zarray", array("[2, 3, 4]", "[1, 3, 4]", "|u1"));
  dir.Write(root + "a/.zattrs", "{\"_ARRAY_DIMENSIONS\": [\"z\", \"y\", \"x\"]}");
  dir.Write(root + "a/0.0.0", std::string(12, 'a'));
  dir.Write(root + "a/1.0.0", std::string(12, 'b'));
  dir.Write(root + "z/.zarray", array("[2]", "[2]", "|u1"));
  dir.Write(root + "z/.zattrs", "{\"_ARRAY_DIMENSIONS\": [\"z\"]}");
  dir.Write(root + "z/0", std::string("\1\3", 2));
}

// A VTKHDF image whose array lies in `samples`.
void WriteVtkHdf(const TempDir& dir, const std::string& name, const std::string& samples) {
  WriteHdf5(dir.Sub(samples), "/a");
  Hdf5MeshWriter file(dir.Sub(name));
  file.Group("/VTKHDF");
  file.Texts("/VTKHDF", "Type", {"ImageData"});
  file.Numbers("/VTKHDF", "WholeExtent", {0, 3, 0, 2, 0, 1});
  file.Numbers("/VTKHDF", "Origin", {0, 0, 0});
  file.Numbers("/VTKHDF", "Spacing", {1, 1, 1});
  file.Group("/VTKHDF/PointData");
  LinkOut(file.file(), "/VTKHDF/PointData/a", samples, "/a");
}

// An openPMD iteration whose record lies in `samples`.
void WriteOpenPmd(const TempDir& dir, const std::string& name, const std::string& samples,
                  double time) {
  WriteHdf5(dir.Sub(samples), "/rho");
  Hdf5MeshWriter file(dir.Sub(name));
  file.Texts("/", "openPMD", {"1.1.0"});
  file.Texts("/", "basePath", {"/data/%T/"});
  file.Texts("/", "meshesPath", {"fields/"});
  file.Group("/data");
  file.Group("/data/1");
  file.Numbers("/data/1", "time", {time});
  file.Numbers("/data/1", "timeUnitSI", {1});
  file.Group("/data/1/fields");
  LinkOut(file.file(), "/data/1/fields/rho", samples, "/rho");
  const Hdf5Handle linked(H5Fopen(dir.Sub(samples).c_str(), H5F_ACC_RDWR, H5P_DEFAULT), H5Fclose);
  const auto put = [&](const char* attribute, hid_t type, hsize_t count, const void* values) {
    const Hdf5Handle object(H5Oopen(linked.get(), "/rho", H5P_DEFAULT), H5Oclose);
    const Hdf5Handle space(
        count == 1 ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &count, nullptr), H5Sclose);
    const Hdf5Handle made(
        H5Acreate2(object.get(), attribute, type, space.get(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
    ASSERT_GE(H5Awrite(made.get(), type, values), 0);
  };
  const std::vector<double> ones{1, 1, 1};
  const std::vector<double> zeros{0, 0, 0};
  const Hdf5Handle text(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(text.get(), 16);
  const auto padded = [](const std::string& word) {
    return word + std::string(16 - word.size(), '\0');
  };
  put("geometry", text.get(), 1, padded("cartesian").data());
  put("dataOrder", text.get(), 1, padded("C").data());
  put("axisLabels", text.get(), 3, (padded("z") + padded("y") + padded("x")).data());
  put("gridSpacing", H5T_NATIVE_DOUBLE, 3, ones.data());
  put("gridGlobalOffset", H5T_NATIVE_DOUBLE, 3, zeros.data());
  put("gridUnitSI", H5T_NATIVE_DOUBLE, 1, ones.data());
  put("position", H5T_NATIVE_DOUBLE, 3, zeros.data());
  put("unitSI", H5T_NATIVE_DOUBLE, 1, ones.data());
}

OpenRequest Write(const TempDir& dir, const std::string& name, const std::string& bytes) {
  WriteFile(dir.Sub(name), bytes);
  return {.path = dir.Sub(name)};
}

// 4 x 3 samples of 8 bits.
std::string GreyPng(char grey) {
  std::string png("\x89PNG\r\n\x1a\n", 8);
  const auto number = [](std::uint32_t value) {
    std::string bytes;
    for (int shift = 24; shift >= 0; shift -= 8) {
      bytes += static_cast<char>(value >> shift);
    }
    return bytes;
  };
  const auto chunk = [&](const std::string& typed) {
    png += number(static_cast<std::uint32_t>(typed.size() - 4)) + typed;
    png += number(static_cast<std::uint32_t>(
        crc32(0, reinterpret_cast<const Bytef*>(typed.data()), static_cast<uInt>(typed.size()))));
  };
  chunk("IHDR" + number(4) + number(3) + std::string("\x08\0\0\0\0", 5));
  std::string rows;
  for (int y = 0; y < 3; ++y) {
    rows += '\0' + std::string(4, grey);  // no filter
  }
  std::string packed(100, '\0');
  uLongf size = packed.size();
  compress(reinterpret_cast<Bytef*>(packed.data()), &size,
           reinterpret_cast<const Bytef*>(rows.data()), rows.size());
  chunk("IDAT" + packed.substr(0, size));
  chunk("IEND");
  return png;
}

void WriteSlices(const TempDir& dir, const std::string& folder) {
  fs::create_directory(dir.Sub(folder));
  for (int z = 0; z < 3; ++z) {
    const std::string pixels(2 * 12 * 9, static_cast<char>(z));
    WriteFile(
        dir.Sub(absl::StrCat(folder, "/", z)),
        testing::DicomBytes({.position = absl::StrCat("0\\0\\", z), .number = z + 1}, pixels));
  }
}

constexpr char kOmeOfTwo[] =
    "<OME><Image><Pixels SizeX=\"4\" SizeY=\"3\" SizeZ=\"4\" DimensionOrder=\"XYZCT\">"
    "<TiffData FirstZ=\"0\" PlaneCount=\"2\"><UUID FileName=\"a.tif\"/></TiffData>"
    "<TiffData FirstZ=\"2\" PlaneCount=\"2\"><UUID FileName=\"b.tif\"/></TiffData>"
    "</Pixels></Image></OME>";

const std::vector<Kind>& Kinds() {
  static const auto* const kinds = new std::vector<Kind>{
      {"raw",
       [](const TempDir& dir) {
         OpenRequest request = Write(dir, "v.raw", Bytes('x'));
         request.raw = RawFormat{.dims = kDims};
         return request;
       },
       {"v.raw"}},
      {"nifti",
       [](const TempDir& dir) {
         return Write(dir, "v.nii", NiftiHeaderBytes({.dims = kDims}) + Int16());
       },
       {"v.nii"}},
      {"nifti_gz_with_label_names",
       [](const TempDir& dir) {
         OpenRequest request =
             Write(dir, "v.nii.gz", Gzip(NiftiHeaderBytes({.dims = kDims}) + Int16()));
         WriteFile(dir.Sub("names.txt"), "1,one\n");
         request.label_names = dir.Sub("names.txt");
         return request;
       },
       {"v.nii.gz", "names.txt"}},
      {"nifti_gz_with_label_names_beside",
       [](const TempDir& dir) {
         WriteFile(dir.Sub("v.nii.txt"), "1 one 2001\n");
         return Write(dir, "v.nii.gz", Gzip(NiftiHeaderBytes({.dims = kDims}) + Int16()));
       },
       {"v.nii.gz", "v.nii.txt"}},
      {"nifti_pair_by_its_samples",
       [](const TempDir& dir) {
         WriteFile(dir.Sub("v.hdr"),
                   NiftiHeaderBytes({.dims = kDims, .is_pair = true, .vox_offset = 0}));
         return Write(dir, "v.img.gz", Gzip(Int16()));
       },
       {"v.hdr", "v.img.gz"}},
      {"nifti2_pair",
       [](const TempDir& dir) {
         WriteFile(dir.Sub("v.img"), Int16());
         return Write(dir, "v.hdr", Nifti2Bytes({.dims = kDims, .is_pair = true}));
       },
       {"v.hdr", "v.img"}},
      {"analyze",
       [](const TempDir& dir) {
         WriteFile(dir.Sub("v.img"), std::string(4096, 'x'));
         return Write(dir, "v.hdr", AnalyzeBytes({}));
       },
       {"v.hdr", "v.img"}},
      {"mgh",
       [](const TempDir& dir) {
         return Write(dir, "v.mgz", Gzip(MghBytes({}) + std::string(4096, 'x')));
       },
       {"v.mgz"}},
      {"afni",
       [](const TempDir& dir) {
         WriteFile(dir.Sub("v+orig.HEAD"), AfniBytes(1, "1", "0"));
         return Write(dir, "v+orig.BRIK.gz", Gzip(Int16()));
       },
       {"v+orig.HEAD", "v+orig.BRIK.gz"}},
      {"par_rec",
       [](const TempDir& dir) {
         WriteFile(dir.Sub("v.REC"), Int16());
         return Write(dir, "v.PAR",
                      ParBytes(ParImage({.slice = 1}) + ParImage({.slice = 2, .index = 1})));
       },
       {"v.PAR", "v.REC"}},
      {"paravision",
       [](const TempDir& dir) {
         // Of the folder of a scan these two are read alone.
         for (const char* other : {"reco", "method", "acqp"}) {
           WriteFile(dir.Sub(other), "##TITLE=x\n");
         }
         WriteFile(dir.Sub("visu_pars"), testing::BrukerText({}));
         return Write(dir, "2dseq", std::string(4096, 'x'));
       },
       {"visu_pars", "2dseq"}},
      {"nrrd_of_several_files",
       [](const TempDir& dir) {
         for (const char* name : {"a.raw", "b.raw"}) {
           WriteFile(dir.Sub(name), std::string(12, name[0]));
         }
         return Write(dir, "v.nhdr",
                      "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n"
                      "data file: LIST\na.raw\nb.raw\n");
       },
       {"v.nhdr", "a.raw", "b.raw"}},
      {"metaimage_list",
       [](const TempDir& dir) {
         for (const char* name : {"a.raw", "b.raw"}) {
           WriteFile(dir.Sub(name), std::string(12, name[0]));
         }
         return Write(dir, "v.mhd",
                      "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementType = MET_UCHAR\n"
                      "ElementDataFile = LIST\na.raw\nb.raw\n");
       },
       {"v.mhd", "a.raw", "b.raw"}},
      {"metaimage_numbered",
       [](const TempDir& dir) {
         for (const char* name : {"s1.raw", "s2.raw"}) {
           WriteFile(dir.Sub(name), std::string(12, name[1]));
         }
         return Write(dir, "v.mhd",
                      "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementType = MET_UCHAR\n"
                      "ElementDataFile = s%d.raw 1 2 1\n");
       },
       {"v.mhd", "s1.raw", "s2.raw"}},
      {"mrc",
       [](const TempDir& dir) { return Write(dir, "v.mrc", MrcBytes({}, std::string(96, '\0'))); },
       {"v.mrc"}},
      {"cube",
       [](const TempDir& dir) {
         std::vector<int> numbers(24, 1);
         return Write(dir, "v.cube",
                      absl::StrCat("a\nb\n 1 0 0 0\n 4 1 0 0\n 3 0 1 0\n 2 0 0 1\n 8 8.0 0 0 0\n",
                                   absl::StrJoin(numbers, " "), "\n"));
       },
       {"v.cube"}},
      {"vti",
       [](const TempDir& dir) {
         return Write(dir, "v.vti",
                      VtiBytes({.extent = "0 3 0 2 0 1", .fields = {{"p", "UInt8", Bytes('x')}}}));
       },
       {"v.vti"}},
      {"pvd_with_pieces",
       [](const TempDir& dir) {
         const auto piece = [&](const std::string& name, const std::string& extent,
                                std::size_t samples) {
           WriteFile(
               dir.Sub(name),
               VtiBytes({.extent = extent, .fields = {{"p", "UInt8", std::string(samples, 'x')}}}));
         };
         piece("first.vti", "0 3 0 2 0 1", 24);
         piece("low.vti", "0 2 0 2 0 1", 18);
         piece("high.vti", "2 3 0 2 0 1", 12);
         WriteFile(dir.Sub("second.pvti"),
                   "<VTKFile type=\"PImageData\"><PImageData WholeExtent=\"0 3 0 2 0 1\" "
                   "GhostLevel=\"0\" Origin=\"10 20 30\" Spacing=\"0.5 2 4\"><PPointData>"
                   "<PDataArray type=\"UInt8\" Name=\"p\"/></PPointData>"
                   "<Piece Extent=\"0 2 0 2 0 1\" Source=\"low.vti\"/>"
                   "<Piece Extent=\"2 3 0 2 0 1\" Source=\"high.vti\"/>"
                   "</PImageData></VTKFile>");
         return Write(dir, "run.pvd",
                      "<VTKFile><Collection><DataSet timestep=\"0\" file=\"first.vti\"/>"
                      "<DataSet timestep=\"1\" file=\"second.pvti\"/></Collection></VTKFile>");
       },
       {"run.pvd", "first.vti", "second.pvti", "low.vti", "high.vti"}},
      {"legacy_vtk",
       [](const TempDir& dir) {
         return Write(dir, "v.vtk",
                      "# vtk DataFile Version 3.0\nx\nBINARY\nDATASET STRUCTURED_POINTS\n"
                      "DIMENSIONS 4 3 2\nORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA 24\n"
                      "SCALARS p unsigned_char 1\nLOOKUP_TABLE default\n" +
                          Bytes('x'));
       },
       {"v.vtk"}},
      {"dicom_folder",
       [](const TempDir& dir) {
         WriteSlices(dir, "scan");
         return OpenRequest{.path = dir.Sub("scan")};
       },
       {"scan/0", "scan/1", "scan/2"}},
      {"dicom_file_of_a_series",
       [](const TempDir& dir) {
         WriteSlices(dir, "scan");
         return OpenRequest{.path = dir.Sub("scan/1")};
       },
       {"scan/0", "scan/1", "scan/2"}},
      {"dicom_series_by_number",
       [](const TempDir& dir) {
         WriteSlices(dir, "scan");
         return OpenRequest{.path = dir.Sub("scan"), .dicom_series = "1.2.3"};
       },
       {"scan/0", "scan/1", "scan/2"}},
      {"tiff_folder",
       [](const TempDir& dir) {
         fs::create_directory(dir.Sub("scan"));
         for (const char* name : {"scan/1.tif", "scan/2.tif"}) {
           EXPECT_TRUE(WriteTiffStack(dir.Sub(name), {.pages = 1}));
         }
         return OpenRequest{.path = dir.Sub("scan")};
       },
       {"scan/1.tif", "scan/2.tif"}},
      {"ome_set",
       [](const TempDir& dir) {
         EXPECT_TRUE(WriteTiffStack(dir.Sub("a.tif"), {.pages = 2, .description = kOmeOfTwo}));
         EXPECT_TRUE(WriteTiffStack(dir.Sub("b.tif"), {.pages = 2}));
         return OpenRequest{.path = dir.Sub("a.tif")};
       },
       {"a.tif", "b.tif"}},
      {"ome_companion_by_its_folder",
       [](const TempDir& dir) {
         fs::create_directory(dir.Sub("scan"));
         EXPECT_TRUE(WriteTiffStack(
             dir.Sub("scan/a.tif"),
             {.pages = 2,
              .description = "<OME><BinaryOnly MetadataFile=\"b.companion.ome\"/></OME>"}));
         WriteFile(dir.Sub("scan/b.companion.ome"),
                   "<OME><Image><Pixels SizeX=\"4\" SizeY=\"3\" SizeZ=\"2\" "
                   "DimensionOrder=\"XYZCT\"><TiffData><UUID FileName=\"a.tif\"/></TiffData>"
                   "</Pixels></Image></OME>");
         return OpenRequest{.path = dir.Sub("scan")};
       },
       {"scan/a.tif", "scan/b.companion.ome"}},
      {"image_slices",
       [](const TempDir& dir) {
         for (const char* name : {"1.png", "2.png"}) {
           WriteFile(dir.Sub(name), GreyPng(name[0]));
         }
         return OpenRequest{.path = dir.Sub("*.png")};
       },
       {"1.png", "2.png"}},
      {"hdf5_dataset",
       [](const TempDir& dir) {
         WriteHdf5(dir.Sub("c.h5"), "/d");
         const Hdf5Handle b(
             H5Fcreate(dir.Sub("b.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
         LinkOut(b.get(), "d", "c.h5", "/d");
         const Hdf5Handle a(
             H5Fcreate(dir.Sub("a.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
         LinkOut(a.get(), "d", "b.h5", "/d");
         return OpenRequest{.path = dir.Sub("a.h5") + ":/d"};
       },
       {"a.h5", "b.h5", "c.h5"}},
      {"vtkhdf",
       [](const TempDir& dir) {
         WriteVtkHdf(dir, "run.vtkhdf", "samples.h5");
         return OpenRequest{.path = dir.Sub("run.vtkhdf")};
       },
       {"run.vtkhdf", "samples.h5"}},
      {"npy",
       [](const TempDir& dir) {
         WriteFile(dir.Sub("a.npy"), NpyBytes("|u1", "(2, 3, 4)", Bytes('a')));
         return OpenRequest{.path = dir.Sub("a.npy")};
       },
       {"a.npy"}},
      {"npz",
       [](const TempDir& dir) {
         WriteFile(
             dir.Sub("a.npz"),
             ZipBytes({{.name = "a.npy", .bytes = NpyBytes("|u1", "(2, 3, 4)", Bytes('a'))}}));
         return OpenRequest{.path = dir.Sub("a.npz")};
       },
       {"a.npz"}},
      {"fits",
       [](const TempDir& dir) {
         WriteFile(dir.Sub("a.fits"), FitsPartBytes(FitsCubeCards(8), Bytes('a')));
         return OpenRequest{.path = dir.Sub("a.fits")};
       },
       {"a.fits"}},
      {"mrtrix_with_its_data_file",
       [](const TempDir& dir) {
         WriteFile(dir.Sub("a.mih"),
                   "mrtrix image\ndim: 4,3,2\nvox: 1,1,1\nlayout: +0,+1,+2\ndatatype: UInt8\n"
                   "file: a.dat\nEND\n");
         WriteFile(dir.Sub("a.dat"), Bytes('a'));
         return OpenRequest{.path = dir.Sub("a.mih")};
       },
       {"a.mih", "a.dat"}},
      {"list_of_vti",
       [](const TempDir& dir) {
         WriteFile(dir.Sub("1.vti"),
                   VtiBytes({.extent = "0 3 0 2 0 1", .fields = {{"p", "UInt8", Bytes('x')}}}));
         WriteFile(dir.Sub("2.vti"),
                   VtiBytes({.extent = "0 3 0 2 0 1", .fields = {{"p", "UInt8", Bytes('x')}}}));
         WriteFile(dir.Sub("run.vti.series"),
                   "{\"file-series-version\": \"1.0\", \"files\": [{\"name\": \"1.vti\", "
                   "\"time\": 0}, {\"name\": \"2.vti\", \"time\": 1}]}");
         return OpenRequest{.path = dir.Sub("run.vti.series")};
       },
       {"1.vti", "2.vti", "run.vti.series"}},
      {"pattern_of_vti",
       [](const TempDir& dir) {
         WriteFile(dir.Sub("run_1.vti"),
                   VtiBytes({.extent = "0 3 0 2 0 1", .fields = {{"p", "UInt8", Bytes('x')}}}));
         WriteFile(dir.Sub("run_2.vti"),
                   VtiBytes({.extent = "0 3 0 2 0 1", .fields = {{"p", "UInt8", Bytes('x')}}}));
         return OpenRequest{.path = dir.Sub("run_*.vti")};
       },
       {"run_1.vti", "run_2.vti"}},
      {"zarr_with_coordinates",
       [](const TempDir& dir) {
         WriteZarr(dir);
         return OpenRequest{.path = dir.Sub("run.zarr")};
       },
       {"run.zarr/.zgroup", "run.zarr/a/.zarray", "run.zarr/a/.zattrs", "run.zarr/a/0.0.0",
        "run.zarr/a/1.0.0", "run.zarr/z/.zarray", "run.zarr/z/.zattrs", "run.zarr/z/0"}},
      {"openpmd_pattern",
       [](const TempDir& dir) {
         WriteOpenPmd(dir, "data1.h5", "one.h5", 1);
         WriteOpenPmd(dir, "data2.h5", "two.h5", 2);
         return OpenRequest{.path = dir.Sub("data%T.h5")};
       },
       {"data1.h5", "data2.h5", "one.h5", "two.h5"}},
  };
  return *kinds;
}

class SourceFilesTest : public ::testing::TestWithParam<Kind> {
 protected:
  // Reads all volumes to the end.
  static void ReadEverything(const OpenRequest& request) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, Open(request));
    for (std::size_t field = 0; field < series->info().fields.size(); ++field) {
      for (int step = 0; step < series->info().step_count(); ++step) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume,
                                      series->Open(static_cast<int>(field), 0, step));
        ISOSCOPE_EXPECT_OK(ReadAll(*volume, 1).status());
      }
    }
  }
  [[nodiscard]] std::set<std::string> Relative(const std::vector<std::string>& paths) const {
    std::set<std::string> names;
    for (const std::string& path : paths) {
      names.insert(fs::path(path).lexically_normal().lexically_relative(dir_.path()).string());
    }
    return names;
  }
  const TempDir dir_;
};

TEST_P(SourceFilesTest, AllThatTheReaderOpensAreListed) {
  const OpenRequest request = GetParam().make(dir_);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto listed, FilesOf(request));
  EXPECT_THAT(Relative(listed), UnorderedElementsAreArray(GetParam().files));
  testing::OpenedFiles opened(dir_.path());
  ReadEverything(request);
  const std::set<std::string> paths = opened.Take();
  std::set<std::string> names = Relative({paths.begin(), paths.end()});
  const std::set<std::string> expected(GetParam().files.begin(), GetParam().files.end());
  EXPECT_FALSE(names.empty());
  for (const std::string& name : names) {
    EXPECT_TRUE(expected.count(name) == 1) << name << " is read, but not listed";
  }
}

TEST_P(SourceFilesTest, EachOfThemChangesTheIdentityThoughSizeAndTimeAreKept) {
  const OpenRequest request = GetParam().make(dir_);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto opened, OpenIdentified(request));
  std::vector<std::string> before;
  for (int step = 0; step < opened->info().step_count(); ++step) {
    before.push_back(opened->IdentityOfStep(step).value());
  }
  for (const std::string& name : GetParam().files) {
    const std::string path = dir_.Sub(name);
    const auto time = fs::last_write_time(path);
    const std::string bytes = ReadFile(path);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOf(request));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string stamps, StampsOf(files));
    WriteFile(path, bytes);
    fs::last_write_time(path, time);
    EXPECT_NE(StampsOf(files).value(), stamps) << name;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto again, OpenIdentified(request));
    // Steps of a list are told by their files and times.
    bool differs = name == "run.pvd" || name == "run.vti.series";
    for (int step = 0; step < again->info().step_count(); ++step) {
      const std::string identity = again->IdentityOfStep(step).value();
      std::string& known = before[static_cast<std::size_t>(step)];
      differs = differs || identity != known;
      known = identity;
    }
    EXPECT_TRUE(differs) << name;
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, SourceFilesTest, ::testing::ValuesIn(Kinds()),
                         [](const auto& kind) { return kind.param.name; });

// Files that appear or vanish and change which file is read.

std::string ListOf(const OpenRequest& request) {
  return absl::StrJoin(FilesOf(request).value(), " ");
}

TEST(SourceFilesThatComeTest, PlainSamplesGoBeforePackedOnes) {
  const TempDir dir;
  WriteFile(dir.Sub("v.img.gz"), Gzip(Int16()));
  const OpenRequest request =
      Write(dir, "v.hdr", NiftiHeaderBytes({.dims = kDims, .is_pair = true, .vox_offset = 0}));
  const std::string before = ListOf(request);
  WriteFile(dir.Sub("v.img"), Int16());
  EXPECT_NE(ListOf(request), before);
  fs::remove(dir.Sub("v.img"));
  EXPECT_EQ(ListOf(request), before);
}

TEST(SourceFilesThatComeTest, AfniPrefersPlainSamplesToo) {
  const TempDir dir;
  WriteFile(dir.Sub("v.BRIK.gz"), Gzip(Int16()));
  const OpenRequest request = Write(dir, "v.HEAD", AfniBytes(1, "1", "0"));
  const std::string before = ListOf(request);
  WriteFile(dir.Sub("v.BRIK"), Int16());
  EXPECT_NE(ListOf(request), before);
}

TEST(SourceFilesThatComeTest, AHeaderThatAppearsForSamplesCounts) {
  const TempDir dir;
  WriteFile(dir.Sub("v.hdr.gz"),
            Gzip(NiftiHeaderBytes({.dims = kDims, .is_pair = true, .vox_offset = 0})));
  const OpenRequest request = Write(dir, "v.img", Int16());
  const std::string before = ListOf(request);
  WriteFile(dir.Sub("v.hdr"), NiftiHeaderBytes({.dims = kDims, .is_pair = true, .vox_offset = 0}));
  EXPECT_NE(ListOf(request), before);
}

TEST(SourceFilesThatComeTest, SlicesOfAFolderAndItsKindCount) {
  const TempDir dir;
  WriteSlices(dir, "scan");
  const OpenRequest request{.path = dir.Sub("scan")};
  const std::string before = ListOf(request);
  fs::copy(dir.Sub("scan/2"), dir.Sub("scan/3"));
  const std::string more = ListOf(request);
  EXPECT_NE(more, before);
  EXPECT_TRUE(WriteTiffStack(dir.Sub("scan/1.tif"), {.pages = 2}));
  EXPECT_FALSE(FilesOf(request).ok()) << "slices, or a DICOM series";
}

TEST(SourceFilesThatComeTest, AParFileBesideARecFileCounts) {
  const TempDir dir;
  const OpenRequest request = Write(dir, "v.rec", MrcBytes({}, std::string(96, '\0')));
  const std::string before = ListOf(request);
  WriteFile(dir.Sub("v.par"),
            ParBytes(ParImage({.slice = 1}) + ParImage({.slice = 2, .index = 1})));
  EXPECT_EQ(ListOf(request).substr(0, before.size()), before);
}

TEST(SourceFilesThatComeTest, ALinkThatIsTurnedCounts) {
  const TempDir dir;
  fs::create_directory(dir.Sub("one"));
  fs::create_directory(dir.Sub("two"));
  for (const char* name : {"one/v.nii", "two/v.nii"}) {
    WriteFile(dir.Sub(name), NiftiHeaderBytes({.dims = kDims}) + Int16());
    fs::last_write_time(dir.Sub(name), fs::file_time_type::clock::now() - std::chrono::hours(1));
  }
  fs::create_directory_symlink("one", dir.Sub("run"));
  const OpenRequest request{.path = dir.Sub("run/v.nii")};
  const std::string before = OpenIdentified(request).value()->IdentityOfStep(0).value();
  fs::remove(dir.Sub("run"));
  fs::create_directory_symlink("two", dir.Sub("run"));
  EXPECT_NE(OpenIdentified(request).value()->IdentityOfStep(0).value(), before);
}

}  // namespace
}  // namespace isoscope::source
