#include "core/formats/refused_formats.h"

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/stat.h>

#include "core/formats/open_volume.h"
#include "core/source/bytes/file_content.h"
#include "core/source/bytes/raw_file.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "tests/support/folder_test.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class RefusedFormatsTest : public testing::FolderTest {
 protected:
  // The message of all ways to open a path: what it is, and what to do. FilesOfVolume may list a
  // file by its name alone.
  static void Expect(const std::string& path, const std::string& format,
                     const std::string& advice) {
    std::vector<absl::Status> all{OpenVolumeFile(path).status(), OpenVolumeSeries(path).status()};
    if (const absl::Status listed = FilesOfVolume(path).status(); !listed.ok()) {
      all.push_back(listed);
    }
    for (const absl::Status& status : all) {
      EXPECT_THAT(status, StatusIs(kInvalid, AllOf(HasSubstr(path + ": " + format),
                                                   HasSubstr(advice), Not(EndsWith(".")))));
    }
  }
};

TEST_F(RefusedFormatsTest, FoldersOfArraysAreKnownByTheirFiles) {
  Write("a.n5/attributes.json", "{\"n5\":\"2.5.0\"}");
  Write("a.n5/c0/attributes.json", "{}");
  Expect(dir_.Sub("a.n5"), "N5", "HDF5");
  Expect(dir_.Sub("a.n5/c0"), "N5", "HDF5");
  Write("case/system/controlDict", "FoamFile {}");
  Expect(dir_.Sub("case"), "OpenFOAM", "Resample To Image");
}

TEST_F(RefusedFormatsTest, OtherFilesAreKnownByTheirNames) {
  Expect(Write("a.vtu", "<VTKFile type=\"UnstructuredGrid\"/>"), "a VTK grid", "Resample To Image");
  Expect(Write("a.pvtr", "<VTKFile type=\"PRectilinearGrid\"/>"), "a VTK grid", ".vti");
  Expect(Write("a.CZI", "ZISRAWFILE"), "a microscope's own format", "OME-TIFF");
  Expect(Write("binary.stl", std::string(84, '\1')), "a mesh", "isoscope export");
  Expect(Write("head.dm4", "\1\2\3\4"), "Gatan's own format", "dm2mrc IN OUT.mrc");
  Expect(Write("w.pt", "\1\2\3\4"), "a Python pickle", "runs code");
  Expect(Write("head.nii.gz.part", "\1\2\3\4"), "an unfinished download", "let it finish");
  Expect(Write("a.case", "FORMAT"), "EnSight", "Resample To Image");
}

TEST_F(RefusedFormatsTest, ContentIsKnownUnderAnyName) {
  const std::string tar_block = std::string(257, 'x') + "ustar" + std::string(250, '\0');
  const std::vector<std::pair<std::string, std::pair<const char*, const char*>>> rows{
      {"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 3\n",
       {"a Git LFS pointer", "git lfs pull"}},
      {"/annex/objects/SHA256E-s1--00.nii\n", {"a pointer of git-annex", "git annex get"}},
      {"\n<!DOCTYPE html>\n<html>", {"a web page (HTML)", "the download went wrong"}},
      {"\xef\xbb\xbf<HTML><head>", {"a web page (HTML)", "the download went wrong"}},
      {"<?xml version=\"1.0\"?>\n<Error><Code>AccessDenied</Code></Error>",
       {"an error message of a server", "the download went wrong"}},
      {"<?xml version=\"1.0\"?>\n<Xdmf Version=\"3.0\">", {"XDMF", "FILE.h5:/name"}},
      {"<VTKFile type=\"PolyData\" version=\"1.0\">", {"a VTK grid", ".vti"}},
      {"", {"an empty file", "download it again"}},
      {tar_block, {"a tar archive", "unpack it"}},
      {std::string("\x28\xb5\x2f\xfd", 4) + "x", {"a file that Zstandard compressed", "unzstd"}},
      {std::string("\xfd\x37zXZ\0", 6) + "x", {"a file that xz compressed", "unxz"}},
      {"BZh91AY", {"a file that bzip2 compressed", "bunzip2"}},
      {"\x89PNG\r\n", {"a PNG picture", "slices are a folder"}},
      {"%PDF-1.4", {"a PDF document", "the data themselves"}},
      {std::string("\0\0\0\x18", 4) + "ftypmp42", {"a video", "PNG or TIFF"}},
      {"MATLAB 5.0 MAT-file, Platform: GLNXA64", {"a MAT-file of version 5 to 7", "-v7.3"}},
      {std::string("\x0e\x03\x13\x01", 4), {"HDF4", "h4toh5"}},
      {"# AmiraMesh 3D BINARY 2.0", {"Amira's own format", "bfconvert IN OUT.ome.tif"}},
      {"object 1 class gridpositions counts 2 2 2", {"OpenDX", "mrcfile.new('OUT.mrc'"}},
      {"\xc3\x40\xf1\x40", {"SEG-Y", "segyio.tools.cube('IN')"}},
      {"solid cube\nfacet normal 0 0 1", {"STL", "a mesh, not a volume"}},
      {"GRIB\1\2\3", {"GRIB", "cdo"}}};
  for (const auto& [bytes, texts] : rows) {
    // By its name each could also be something that is read.
    for (const char* name : {"a.bin", "a.nii.gz", "a.nii", "a.nrrd", "a.mha", "a.vti", "a.tif",
                             "a.h5", "a.mrc", "a.dcm", "a.nc", "a.vtk", "a.mgz"}) {
      SCOPED_TRACE(name);
      Expect(Write(name, bytes), texts.first, texts.second);
    }
  }
}

TEST_F(RefusedFormatsTest, ZipArchivesAreCalledSoUnderAnyName) {
  for (const char* name : {"a.nrrd", "a.mha", "a.vti", "a.tif", "a.h5", "a.mrc", "a.nc", "a.vtk"}) {
    Expect(Write(name, "PK\x03\x04 and so on"), "a ZIP archive", "unpack it");
  }
  for (const char* name : {"a.bin", "a.zip", "a.npz", "a.nii", "a.docx"}) {
    const std::string path = Write(name, "PK\x03\x04 and so on");
    EXPECT_THAT(OpenVolumeSeries(path),
                StatusIs(kInvalid, HasSubstr(path + ": a ZIP archive: no directory at its end")));
  }
}

TEST_F(RefusedFormatsTest, FormatsOfOtherProgramsAreKnownByTheirNames) {
  const std::vector<std::pair<const char*, const char*>> rows{
      {"a.am", "bfconvert IN OUT.ome.tif"},
      {"a.dx", "import gridData as d, mrcfile, numpy; g = d.Grid('IN'); m = mrcfile.new('OUT.mrc'"},
      {"a.xdmf", "SaveData('OUT.vti', OpenDataFile('./IN'))"},
      {"a.xmf", "SaveData('OUT.vti', OpenDataFile('./IN'))"},
      {"a.dm3", "dm2mrc IN OUT.mrc"},
      {"a.dm4", "dm2mrc IN OUT.mrc"},
      {"a.sgy", "numpy.save('OUT.npy', segyio.tools.cube('IN'))"},
      {"a.segy", "numpy.save('OUT.npy', segyio.tools.cube('IN'))"}};
  for (const auto& [name, command] : rows) {
    const std::string path = Write(name, std::string("\x01\x02\x03", 3));
    Expect(path, "", command);
    EXPECT_LE(OpenVolumeSeries(path).status().message().size() - path.size(), 300U) << name;
  }
}

TEST_F(RefusedFormatsTest, GzipStreamIsDescribedByWhatIsInIt) {
  Expect(Write("a.gz", testing::Gzip("PK\x03\x04")), "a gzip stream of a ZIP archive", "unpack it");
  Expect(Write("a.nii.gz", testing::Gzip(std::string(257, 'x') + "ustar")),
         "a gzip stream of a tar archive", "unpack it");
  Expect(Write("a.mnc.gz", testing::Gzip("CDF\1xxxx")), "netCDF in a gzip stream", "gunzip");
  Expect(Write("a.nrrd.gz", testing::Gzip("NRRD0004\n")), "NRRD in a gzip stream", "gunzip");
}

TEST_F(RefusedFormatsTest, PartOfAFileIsExplainedByTheFile) {
  const std::string file = Write("a.vti", "version https://git-lfs.github.com/spec/v1\n");
  EXPECT_THAT(OpenVolumeSeries(file + ":p:x"), StatusIs(kInvalid, HasSubstr(file + ": a Git LFS")));
  EXPECT_THAT(OpenVolumeFile(file + ":p"), StatusIs(kInvalid, HasSubstr(file + ": a Git LFS")));
}

// No reader takes one for samples, or says that it is cut: also where the header is there alone.
TEST_F(RefusedFormatsTest, PointersOfGitLfsAreNoSamples) {
  const std::string pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 3\n";
  const auto is_named = [](const std::string& file) {
    return StatusIs(kInvalid, AllOf(HasSubstr(file + ": a Git LFS"), HasSubstr("git lfs pull")));
  };
  const std::string zip = Write("a.zip", pointer);
  EXPECT_THAT(OpenVolumeFile(zip), is_named(zip));
  const std::string raw = Write("a.raw", pointer);
  for (const std::int64_t size : {4, 1000}) {
    EXPECT_THAT(OpenRawFile(raw, {.dims = {size, 2, 2}}), is_named(raw));
  }
  for (const char* const encoding : {"raw", "gzip"}) {
    const std::string header =
        Write("a.nhdr", absl::StrCat("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 2 2\n",
                                     "encoding: ", encoding, "\ndata file: a.raw\n"));
    const auto opened = OpenVolumeFile(header);
    std::string samples(16, '\0');
    EXPECT_THAT(opened.ok() ? (*opened)->ReadRows(0, 4, samples.data()) : opened.status(),
                is_named(raw))
        << encoding;
  }
}

TEST_F(RefusedFormatsTest, WhatAReaderTakesIsNotExplained) {
  for (const std::string& bytes :
       {std::string("NRRD0004\n"), std::string("II*\0", 4), std::string("\x89HDF\r\n\x1a\n", 8),
        std::string("<VTKFile type=\"ImageData\">"), std::string("# vtk DataFile Version 3.0\n"),
        std::string("ObjectType = Image\n"), std::string("CDF\1"), std::string("\x93NUMPY\1"),
        std::string(64, '\1')}) {
    EXPECT_EQ(DescribeContent(Write("a", bytes)), std::nullopt) << bytes;
  }
  const absl::Status status = absl::InvalidArgumentError("its own words");
  EXPECT_EQ(ExplainByContent(Write("a", "NRRD0004\n"), status), status);
  const absl::Status cancelled = absl::CancelledError("stopped");
  EXPECT_EQ(ExplainByContent(Write("b", "PK\x03\x04"), cancelled), cancelled);
}

TEST_F(RefusedFormatsTest, UnknownKindIsThreeLinesWithHowItBegins) {
  const auto message_of = [&](const std::string& name, const std::string& bytes) {
    const std::string path = Write(name, bytes);
    const std::string message(OpenVolumeSeries(path).status().message());
    EXPECT_LE(message.size() - path.size(), 3 * 80U) << message;
    EXPECT_THAT(message, AllOf(HasSubstr(path + ": unknown kind of file: "),
                               HasSubstr("--list-formats"), HasSubstr("--dims X,Y,Z --type T")));
    return message;
  };
  EXPECT_THAT(message_of("a.txt", "x,y,z\n1,2,3\n"), HasSubstr("text that begins with \"x,y,z\""));
  EXPECT_THAT(message_of("a.raw", std::string("\x01\x02\xff\xfe\0\x03\x04\x05\x06", 9)),
              HasSubstr("its first bytes are 0102fffe00030405;"));
  EXPECT_THAT(message_of("a.raw", std::string(2000, '\0')), HasSubstr("it begins with zeros"));
  EXPECT_THAT(message_of("a.gz", testing::Gzip("\x01\x02\x03\x04")),
              HasSubstr("a gzip stream; its first bytes are 01020304"));
  EXPECT_THAT(message_of("a", "\x1b[31mred" + std::string(100, 'x')), Not(HasSubstr("\x1b")));
}

TEST_F(RefusedFormatsTest, NamedPipeIsNotOpened) {
  const std::string pipe = dir_.Sub("pipe");
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_EQ(DescribeContent(pipe), std::nullopt);
}

TEST_F(RefusedFormatsTest, AnythingElseIsNot) {
  EXPECT_EQ(WhyRefused(Write("a.bin", "x")), std::nullopt);
  EXPECT_EQ(WhyRefused(dir_.Sub("none")), std::nullopt);
  std::filesystem::create_directory(dir_.Sub("empty"));
  EXPECT_EQ(WhyRefused(dir_.Sub("empty")), std::nullopt);
}

}  // namespace
}  // namespace isoscope::source
