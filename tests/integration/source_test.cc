// `render` and `export` straight from every kind of source that `partition` takes: what they give
// is what the same samples give as an NRRD file, and it is new when a file of the source is.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/math/vec.h"
#include "core/volume/scalar_type.h"
#include "hdf5.h"
#include "tests/support/dicom_file.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/hdf5_mesh_file.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/temp_dir.h"
#include "tests/support/vdb_file.h"
#include "tests/support/volume_files.h"
#include "tiffio.h"

namespace isoscope {
namespace {

namespace fs = std::filesystem;
using testing::CommandResult;
using testing::WriteFile;

constexpr math::Index3 kDims{24, 20, 16};
constexpr std::size_t kSliceBytes = std::size_t{24} * 20 * sizeof(std::int16_t);

// The samples for a source of each kind: all samples, int16, and the samples that its files already
// hold, if any. Files with unchanged samples are not written.
struct Samples {
  std::string now;
  std::string before;

  [[nodiscard]] std::string Slice(std::size_t z) const {
    return now.substr(z * kSliceBytes, kSliceBytes);
  }
  [[nodiscard]] bool IsNew(std::size_t z) const {
    return before.empty() || before.substr(z * kSliceBytes, kSliceBytes) != Slice(z);
  }
};

struct Source {
  const char* name;
  // Writes it into a folder.
  void (*write)(const std::string& folder, const Samples& samples);
  const char* input;  // in that folder
  // Where its samples lie, as fields of an NRRD header.
  const char* space = "left-posterior-superior";
  const char* directions = "(1,0,0) (0,1,0) (0,0,1)";
  const char* origin = "(0,0,0)";
  std::vector<std::string> flags{};
  bool is_int32 = false;  // the format has no int16
};

std::ostream& operator<<(std::ostream& out, const Source& source) { return out << source.name; }

void AddTiffPage(TIFF* tiff, std::string slice) {
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, static_cast<std::uint32_t>(kDims.x));
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, static_cast<std::uint32_t>(kDims.y));
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 16);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_INT);
  TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, static_cast<std::uint32_t>(kDims.y));
  ASSERT_GE(TIFFWriteEncodedStrip(tiff, 0, slice.data(), static_cast<tmsize_t>(slice.size())), 0);
  ASSERT_NE(TIFFWriteDirectory(tiff), 0);
}

void WriteTiffSlices(const std::string& folder, const Samples& samples) {
  for (std::size_t z = 0; z < static_cast<std::size_t>(kDims.z); ++z) {
    if (samples.IsNew(z)) {
      TIFF* const tiff = TIFFOpen(absl::StrCat(folder, "/s", z, ".tif").c_str(), "w");
      ASSERT_NE(tiff, nullptr);
      AddTiffPage(tiff, samples.Slice(z));
      TIFFClose(tiff);
    }
  }
}

void WriteTiffPages(const std::string& folder, const Samples& samples) {
  TIFF* const tiff = TIFFOpen((folder + "/pages.tif").c_str(), "w");
  ASSERT_NE(tiff, nullptr);
  for (std::size_t z = 0; z < static_cast<std::size_t>(kDims.z); ++z) {
    AddTiffPage(tiff, samples.Slice(z));
  }
  TIFFClose(tiff);
}

void WriteDicomSlices(const std::string& folder, const Samples& samples) {
  for (std::size_t z = 0; z < static_cast<std::size_t>(kDims.z); ++z) {
    const auto slice = static_cast<int>(z);
    if (samples.IsNew(z)) {
      WriteFile(absl::StrCat(folder, "/im", slice),
                testing::DicomBytes({.width = static_cast<std::uint16_t>(kDims.x),
                                     .height = static_cast<std::uint16_t>(kDims.y),
                                     .position = absl::StrCat("10\\20\\", 30 + 1.5 * slice),
                                     .number = slice + 1},
                                    samples.Slice(z)));
    }
  }
}

const std::vector<hsize_t> kHdf5Dims{static_cast<hsize_t>(kDims.z), static_cast<hsize_t>(kDims.y),
                                     static_cast<hsize_t>(kDims.x)};

// Two datasets: of the other one no sample reaches the isovalue.
void WriteHdf5(const std::string& folder, const Samples& samples) {
  const testing::Hdf5MeshWriter writer(folder + "/v.h5");
  const std::string other(samples.now.size(), '\x80');
  for (const auto& [name, bytes] : {std::pair{"field", &samples.now}, std::pair{"other", &other}}) {
    testing::WriteHdf5Dataset(writer.file(), name, kHdf5Dims, H5T_STD_I16LE, bytes->data());
  }
}

// Two iterations in files of their own: in the first no sample reaches the isovalue.
void WriteOpenPmd(const std::string& folder, const Samples& samples) {
  const std::string other(samples.now.size(), '\x80');
  for (const auto& [number, bytes] : {std::pair{"90", &other}, std::pair{"100", &samples.now}}) {
    if (bytes == &other && !samples.before.empty()) {
      continue;
    }
    testing::Hdf5MeshWriter writer(absl::StrCat(folder, "/data", number, ".h5"));
    writer.Texts("/", "openPMD", {"1.1.0"});
    writer.Texts("/", "basePath", {"/data/%T/"});
    writer.Texts("/", "meshesPath", {"fields/"});
    const std::string iteration = absl::StrCat("/data/", number);
    writer.Group("/data");
    writer.Group(iteration);
    writer.Numbers(iteration, "time", {std::stod(number)});
    writer.Numbers(iteration, "timeUnitSI", {1});
    writer.Group(iteration + "/fields");
    const std::string rho = iteration + "/fields/rho";
    testing::WriteHdf5Dataset(writer.file(), rho, kHdf5Dims, H5T_STD_I16LE, bytes->data());
    writer.Texts(rho, "geometry", {"cartesian"});
    writer.Texts(rho, "dataOrder", {"C"});
    writer.Texts(rho, "axisLabels", {"z", "y", "x"});
    writer.Numbers(rho, "gridSpacing", {3, 2, 1.5});
    writer.Numbers(rho, "gridUnitSI", {1});
    writer.Numbers(rho, "gridGlobalOffset", {30, 20, 10});
    writer.Numbers(rho, "unitSI", {1});
  }
}

// As ITK writes it.
void WriteItkHdf5(const std::string& folder, const Samples& samples) {
  testing::Hdf5MeshWriter writer(folder + "/v.h5");
  writer.Group("/ITKImage");
  writer.Group("/ITKImage/0");
  const auto write = [&](const char* name, const std::vector<hsize_t>& dims,
                         const std::vector<double>& numbers) {
    testing::WriteHdf5Dataset(writer.file(), absl::StrCat("/ITKImage/0/", name), dims,
                              H5T_NATIVE_DOUBLE, numbers.data());
  };
  write("Origin", {3}, {10, 20, 30});
  write("Spacing", {3}, {1.5, 2, 3});
  write("Directions", {3, 3}, {0, 1, 0, -1, 0, 0, 0, 0, 1});
  testing::WriteHdf5Dataset(writer.file(), "/ITKImage/0/VoxelData", kHdf5Dims, H5T_STD_I16LE,
                            samples.now.data());
}

// An array of points or cells with the tags around it.
void WriteVtiArray(const std::string& path, const math::Index3& extent, const std::string& data,
                   const std::string& attributes, const std::string& bytes) {
  std::string size;
  base::AppendLittleEndian(static_cast<std::uint32_t>(bytes.size()), &size);
  const std::string text = absl::StrCat("\"0 ", extent.x, " 0 ", extent.y, " 0 ", extent.z, "\"");
  WriteFile(path,
            absl::StrCat("<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" "
                         "byte_order=\"LittleEndian\">\n<ImageData WholeExtent=",
                         text, ">\n<Piece Extent=", text, ">\n<", data,
                         ">\n<DataArray type=\"Int16\" Name=\"v\" ", attributes,
                         " format=\"appended\" offset=\"0\"/>\n</", data,
                         "></Piece></ImageData>\n<AppendedData encoding=\"raw\">\n_", size, bytes,
                         "\n</AppendedData>\n</VTKFile>\n"));
}

void WriteVti(const std::string& folder, const Samples& samples) {
  WriteVtiArray(folder + "/v.vti", kDims - math::Index3{1, 1, 1}, "PointData", "Scalars=\"v\"",
                samples.now);
}

void WriteVtiCells(const std::string& folder, const Samples& samples) {
  WriteVtiArray(folder + "/v.vti", kDims, "CellData", "", samples.now);
}

// The other component has no sample at the isovalue.
void WriteVtiComponents(const std::string& folder, const Samples& samples) {
  std::string tuples;
  for (std::size_t at = 0; at < samples.now.size(); at += 2) {
    absl::StrAppend(&tuples, "\x80\x80", samples.now.substr(at, 2));
  }
  WriteVtiArray(folder + "/v.vti", kDims - math::Index3{1, 1, 1}, "PointData",
                "NumberOfComponents=\"2\"", tuples);
}

void WriteGzipNrrd(const std::string& folder, const Samples& samples) {
  WriteFile(folder + "/v.nrrd",
            testing::NrrdHeader(kDims, "short", "gzip") + testing::Gzip(samples.now));
}

void WriteDetachedNrrd(const std::string& folder, const Samples& samples) {
  if (samples.before.empty()) {
    WriteFile(folder + "/v.nhdr",
              testing::NrrdHeader(kDims, "short", "raw", "data file: samples\n"));
  }
  WriteFile(folder + "/samples", samples.now);
}

// Slices 1 to 16 in files of their own.
void WriteNumberedSlices(const std::string& folder, const Samples& samples, bool is_compressed) {
  for (std::size_t z = 0; z < static_cast<std::size_t>(kDims.z); ++z) {
    if (samples.IsNew(z)) {
      WriteFile(absl::StrCat(folder, "/s", z + 1),
                is_compressed ? testing::Gzip(samples.Slice(z)) : samples.Slice(z));
    }
  }
}

void WriteNrrdOfSlices(const std::string& folder, const Samples& samples) {
  WriteNumberedSlices(folder, samples, true);
  if (samples.before.empty()) {
    WriteFile(folder + "/v.nhdr",
              testing::NrrdHeader(kDims, "short", "gzip", "data file: s%d 1 16 1\n"));
  }
}

void WriteMetaImageOfSlices(const std::string& folder, const Samples& samples) {
  WriteNumberedSlices(folder, samples, false);
  std::string names;
  for (int z = 1; z <= 16; ++z) {
    absl::StrAppend(&names, "s", z, "\n");
  }
  if (samples.before.empty()) {
    WriteFile(folder + "/v.mhd", testing::MetaHeader(kDims, "MET_SHORT", "LIST\n" + names));
  }
}

void WriteGzipNifti(const std::string& folder, const Samples& samples) {
  WriteFile(folder + "/v.nii.gz",
            testing::Gzip(testing::NiftiHeaderBytes({.dims = kDims}) + samples.now));
}

void WriteRaw(const std::string& folder, const Samples& samples) {
  WriteFile(folder + "/v.raw", samples.now);
}

std::string AsInt32(const std::string& samples) {
  std::string wide;
  for (std::size_t i = 0; i < samples.size(); i += sizeof(std::int16_t)) {
    wide += samples.substr(i, sizeof(std::int16_t));
    wide.append(2, (samples[i + 1] & '\x80') != 0 ? '\xff' : '\0');
  }
  return wide;
}

void WriteVdb(const std::string& folder, const Samples& samples) {
  testing::VdbFileGrid grid{.type = "int32"};
  const char* next = samples.now.data();
  for (math::Index3 at{0, 0, 0}; at.z < kDims.z; ++at.z) {
    for (at.y = 0; at.y < kDims.y; ++at.y) {
      for (at.x = 0; at.x < kDims.x; ++at.x) {
        std::int16_t sample = 0;
        std::memcpy(&sample, next, sizeof(sample));
        next += sizeof(sample);
        grid.fills.push_back(
            {.begin = at, .end = at + math::Index3{1, 1, 1}, .value = 1.0 * sample});
      }
    }
  }
  testing::WriteVdbFile(folder + "/v.vdb", {grid});
}

class CommandTest : public ::testing::Test {
 protected:
  // Returns the file that a command writes to its --output from `input`. The cache is the test's
  // own.
  std::string Output(const std::string& command, const std::string& input,
                     const std::vector<std::string>& more) {
    std::vector<std::string> arguments{command, input,      "--isovalue",
                                       "0",     "--output", directory_.Sub("output")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    if (command == "render") {
      arguments.insert(arguments.end(), {"--width", "96", "--height", "80", "--renderer", "cpu",
                                         "--view", "front"});  // patients or not
    }
    const CommandResult result = testing::RunIsoscope(
        arguments, {.environment = {"XDG_CACHE_HOME=" + directory_.Sub("cache")}});
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return testing::ReadFile(directory_.Sub("output"));
  }

  [[nodiscard]] std::size_t CachedCount() const {
    const fs::directory_iterator entries(directory_.Sub("cache/isoscope"));
    return static_cast<std::size_t>(std::distance(begin(entries), end(entries)));
  }

  testing::TempDir directory_;
};

class SourceTest : public CommandTest, public ::testing::WithParamInterface<Source> {};

TEST_P(SourceTest, GivesWhatItsSamplesGiveAndChangesWithThem) {
  const Source& source = GetParam();
  const std::string folder = directory_.Sub("source");
  fs::create_directory(folder);
  const std::string input = folder + "/" + source.input;
  const std::string nrrd = directory_.Sub("reference.nrrd");

  Samples samples{.now = testing::SampleField(testing::GyroidField(2), kDims,
                                              volume::ScalarType::kInt16, 300, 0),
                  .before = ""};
  std::string first_picture;
  for (const std::size_t cached_count : {0U, 2U}) {
    ASSERT_NO_FATAL_FAILURE(source.write(folder, samples));
    WriteFile(nrrd,
              absl::StrCat("NRRD0004\ntype: ", source.is_int32 ? "int" : "short",
                           "\ndimension: 3\nspace: ", source.space, "\nsizes: ", kDims.x, " ",
                           kDims.y, " ", kDims.z, "\nspace directions: ", source.directions,
                           "\nspace origin: ", source.origin, "\nendian: little\nencoding: raw\n\n",
                           source.is_int32 ? AsInt32(samples.now) : samples.now));
    const std::string picture = Output("render", input, source.flags);
    EXPECT_EQ(CachedCount(), cached_count + 1);
    EXPECT_TRUE(picture == Output("render", nrrd, {}));
    EXPECT_NE(picture, first_picture);
    EXPECT_TRUE(Output("render", input, source.flags) == picture) << "from the cache";
    EXPECT_TRUE(Output("export", input, source.flags) == Output("export", nrrd, {}));
    EXPECT_EQ(CachedCount(), cached_count + 2);
    // One slice in the middle of the surface: of a stack one file.
    first_picture = picture;
    samples.before = samples.now;
    samples.now.replace(7 * kSliceBytes, kSliceBytes, kSliceBytes, '\0');
  }
}

INSTANTIATE_TEST_SUITE_P(
    Kinds, SourceTest,
    ::testing::Values(
        Source{.name = "Raw",
               .write = WriteRaw,
               .input = "v.raw",
               .flags = {"--dims", "24,20,16", "--type", "int16"}},
        Source{.name = "GzipNrrd",
               .write = WriteGzipNrrd,
               .input = "v.nrrd",
               .directions = "(0,1.5,0) (-2,0,0) (0,0,3)",
               .origin = "(10,20,30)"},
        Source{.name = "DetachedNrrd",
               .write = WriteDetachedNrrd,
               .input = "v.nhdr",
               .directions = "(0,1.5,0) (-2,0,0) (0,0,3)",
               .origin = "(10,20,30)"},
        Source{.name = "GzipNifti",
               .write = WriteGzipNifti,
               .input = "v.nii.gz",
               .space = "right-anterior-superior",
               .directions = "(0,1.5,0) (-2,0,0) (0,0,3)",
               .origin = "(10,20,30)"},
        Source{.name = "NrrdOfSlices",
               .write = WriteNrrdOfSlices,
               .input = "v.nhdr",
               .directions = "(0,1.5,0) (-2,0,0) (0,0,3)",
               .origin = "(10,20,30)"},
        Source{.name = "MetaImageOfSlices",
               .write = WriteMetaImageOfSlices,
               .input = "v.mhd",
               .directions = "(0,1.5,0) (-2,0,0) (0,0,3)",
               .origin = "(10,20,30)"},
        Source{.name = "Vti", .write = WriteVti, .input = "v.vti"},
        Source{.name = "VtiCells",
               .write = WriteVtiCells,
               .input = "v.vti",
               .origin = "(0.5,0.5,0.5)"},
        Source{.name = "VtiComponent", .write = WriteVtiComponents, .input = "v.vti:v:1"},
        Source{.name = "Hdf5", .write = WriteHdf5, .input = "v.h5:/field"},
        Source{.name = "OpenPmdPattern",
               .write = WriteOpenPmd,
               .input = "data1%T.h5:rho",
               .directions = "(1.5,0,0) (0,2,0) (0,0,3)",
               .origin = "(10,20,30)"},
        Source{.name = "ItkHdf5",
               .write = WriteItkHdf5,
               .input = "v.h5",
               .directions = "(0,1.5,0) (-2,0,0) (0,0,3)",
               .origin = "(10,20,30)"},
        Source{.name = "TiffFolder", .write = WriteTiffSlices, .input = ""},
        Source{.name = "TiffPattern", .write = WriteTiffSlices, .input = "s*.tif"},
        Source{.name = "TiffPages", .write = WriteTiffPages, .input = "pages.tif"},
        Source{.name = "DicomFolder",
               .write = WriteDicomSlices,
               .input = ".",
               .directions = "(0.5,0,0) (0,2,0) (0,0,1.5)",
               .origin = "(10,20,30)"},
        Source{.name = "DicomFile",
               .write = WriteDicomSlices,
               .input = "im3",
               .directions = "(0.5,0,0) (0,2,0) (0,0,1.5)",
               .origin = "(10,20,30)"},
        Source{.name = "Vdb", .write = WriteVdb, .input = "v.vdb:density", .is_int32 = true}),
    [](const auto& test) { return std::string(test.param.name); });

using PatternTest = CommandTest;

// The files of a pattern are steps of one dataset.
TEST_F(PatternTest, EachStepOfAPatternGivesThePictureOfItsSamples) {
  const std::string folder = directory_.Sub("source");
  fs::create_directory(folder);
  const Samples samples{.now = testing::SampleField(testing::GyroidField(2), kDims,
                                                    volume::ScalarType::kInt16, 300, 0),
                        .before = ""};
  ASSERT_NO_FATAL_FAILURE(WriteOpenPmd(folder, samples));
  const std::string nrrd = directory_.Write(
      "reference.nrrd",
      absl::StrCat("NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\n"
                   "sizes: ",
                   kDims.x, " ", kDims.y, " ", kDims.z,
                   "\nspace directions: (1.5,0,0) (0,2,0) (0,0,3)\nspace origin: "
                   "(10,20,30)\nendian: little\nencoding: raw\n\n",
                   samples.now));
  const std::string dataset = directory_.Sub("dataset");
  const CommandResult partitioned =
      testing::RunIsoscope({"partition", folder + "/data%T.h5", "--shards", "3", "--memory-limit",
                            "128MiB", "--output", dataset},
                           {});
  ASSERT_EQ(partitioned.exit_code, 0) << partitioned.err;
  // The record in a picture says which step it shows.
  const std::string expected = Output("render", nrrd, {"--no-metadata"});
  EXPECT_TRUE(Output("render", dataset, {"--no-metadata", "--step", "1"}) == expected);
  EXPECT_TRUE(Output("render", dataset, {"--no-metadata", "--time", "100"}) == expected);
  EXPECT_FALSE(Output("render", dataset, {"--no-metadata", "--step", "0"}) == expected);
}

TEST(DicomReportTest, IsLeftOutWithOneLineAndNoFieldIsPrinted) {
  const testing::TempDir directory;
  const std::string more = testing::DicomElement(0x31, 0x1010, "LO", "Doe^Jane");
  for (int z = 0; z < 3; ++z) {
    WriteFile(
        directory.Sub(absl::StrCat("im", z)),
        testing::DicomBytes({.position = absl::StrCat("0\\0\\", z), .number = z, .more = more},
                            std::string(std::size_t{12} * 9 * 2, 'p')));
  }
  const std::string report =
      testing::DicomBytes({.storage_class = "1.2.840.10008.5.1.4.1.1.88.33", .more = more}, "");
  WriteFile(directory.Sub("report"), report.substr(0, report.size() - 12));
  const CommandResult result = testing::RunIsoscope({"info", directory.path()});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_TRUE(absl::StrContains(result.out, "12 x 9 x 3 of int16")) << result.out;
  EXPECT_TRUE(absl::StrContains(result.err, directory.Sub("report"))) << result.err;
  EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
  EXPECT_FALSE(absl::StrContains(result.out + result.err, "Doe"));
}

TEST(DecoderModuleTest, AProgramWithoutOneReadsOtherFilesAndSaysWhatIsMissing) {
  const testing::TempDir directory;
  const std::string program = directory.Sub("isoscope");
  std::filesystem::copy_file(testing::IsoscopePath(), program);
  const std::string pixels(std::size_t{12} * 9 * 2, 'p');
  WriteFile(directory.Sub("a.dcm"), testing::DicomBytes({}, pixels));
  WriteFile(directory.Sub("a.raw"), pixels + pixels);
  const CommandResult raw = testing::RunCommand(
      {program, "info", directory.Sub("a.raw"), "--dims", "12,9,2", "--type", "int16"}, {});
  EXPECT_EQ(raw.exit_code, 0) << raw.err;
  const CommandResult dicom = testing::RunCommand({program, "info", directory.Sub("a.dcm")}, {});
  EXPECT_EQ(dicom.exit_code, 1) << dicom.err;
  EXPECT_TRUE(absl::StrContains(dicom.err, "isoscope_dicom.so belongs in lib/isoscope"))
      << dicom.err;
  WriteFile(directory.Sub("a.vdb"), "x");
  const CommandResult vdb = testing::RunCommand({program, "info", directory.Sub("a.vdb")}, {});
  EXPECT_EQ(vdb.exit_code, 1) << vdb.err;
  EXPECT_TRUE(absl::StrContains(vdb.err, "isoscope_vdb.so belongs in lib/isoscope")) << vdb.err;
}

TEST(HostileDicomTest, EndsPartitionWithAnErrorLineAndLeavesNoDataset) {
  // Bytes behind the pixels, by which GDCM would end its process, do no harm; missing ones do.
  const testing::TempDir directory;
  fs::create_directory(directory.Sub("series"));
  const auto path = [&](int z) { return directory.Sub(absl::StrCat("series/im", z)); };
  const auto bytes = [](int z) {
    return testing::DicomBytes({.position = absl::StrCat("0\\0\\", z), .number = z},
                               std::string(std::size_t{12} * 9 * 2, 'p'));
  };
  for (int z = 0; z < 3; ++z) {
    WriteFile(path(z), bytes(z));
  }
  const std::vector<std::string> command{"partition", directory.Sub("series"), "--output",
                                         directory.Sub("dataset")};
  WriteFile(path(1), bytes(1).substr(0, bytes(1).size() - 20));
  const CommandResult refused = testing::RunIsoscope(command);
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_TRUE(absl::StrContains(refused.err, path(1) + ": ")) << refused.err;
  EXPECT_FALSE(absl::StrContains(refused.err, "Assertion")) << refused.err;
  EXPECT_EQ(std::count(refused.err.begin(), refused.err.end(), '\n'), 1) << refused.err;
  EXPECT_EQ(std::distance(fs::directory_iterator(directory.path()), fs::directory_iterator()), 1)
      << "the series alone";
  WriteFile(path(1), bytes(1) + "aaaaaa");
  EXPECT_EQ(testing::RunIsoscope(command).exit_code, 0);
}

TEST(HostileDicomTest, AChildThatDiesIsNamedWithItsFileAndLeavesNothing) {
  // GDCM reads compressed files, and aborts at bytes behind the pixels that are no element.
  const testing::TempDir directory;
  fs::create_directory(directory.Sub("series"));
  const auto path = [&](int z) { return directory.Sub(absl::StrCat("series/im", z)); };
  const auto bytes = [](int z) {
    return testing::DicomBytes(
        {.position = absl::StrCat("0\\0\\", z), .number = z, .transfer_syntax = testing::kDicomRle},
        std::string(std::size_t{12} * 9 * 2, 'p'));
  };
  for (int z = 0; z < 3; ++z) {
    WriteFile(path(z), bytes(z));
  }
  EXPECT_EQ(testing::RunIsoscope({"info", directory.Sub("series")}).exit_code, 0);
  WriteFile(path(1), bytes(1) + "aaaaaa");
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"info", directory.Sub("series")},
        {"render", directory.Sub("series"), "--isovalue", "0", "--output", directory.Sub("a.png")},
        {"partition", directory.Sub("series"), "--output", directory.Sub("dataset")}}) {
    const CommandResult died = testing::RunIsoscope(command);
    EXPECT_EQ(died.exit_code, 1) << command[0] << died.err;
    EXPECT_EQ(died.out, "") << command[0];
    EXPECT_TRUE(absl::StrContains(died.err, path(1) + ": ")) << died.err;
    EXPECT_TRUE(absl::StrContains(died.err, "it was ended by SIGABRT")) << died.err;
    EXPECT_FALSE(absl::StrContains(died.err, "Assertion")) << died.err;
    EXPECT_EQ(std::count(died.err.begin(), died.err.end(), '\n'), 1) << died.err;
    EXPECT_EQ(std::distance(fs::directory_iterator(directory.path()), fs::directory_iterator()), 1)
        << "the series alone, after " << command[0];
  }
}

TEST(EmptyFolderTest, SaysWhatIsMissing) {
  const testing::TempDir directory;
  const CommandResult result = testing::RunIsoscope(
      {"render", directory.path(), "--isovalue", "0", "--output", directory.Sub("o.png")});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(absl::StrContains(result.err, "no finished dataset, no slices and no DICOM"))
      << result.err;
}

}  // namespace
}  // namespace isoscope
