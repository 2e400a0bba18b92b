#include "core/formats/find_volume.h"

#include <unistd.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "core/source/volume_series.h"
#include "tests/support/folder_test.h"
#include "tests/support/medical_files.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/stacks/tiff_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Noise;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::VtiBytes;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using volume::ScalarType;

constexpr math::Index3 kDims{4, 3, 2};

class FindVolumeTest : public testing::FolderTest {};

// Symptom: a folder of slices was taken for a file of the format that its name ends with.
TEST_F(FindVolumeTest, AFolderIsAFolderWhateverItsName) {
  for (const char* name : {"scan", "scan.map", "study.x.par", "run.h5", "a.vti", "b.pvd", "c.nii",
                           "d.mrc", "e.tif", "f.png", "g.nc", "h.dcm", "i.nrrd"}) {
    std::filesystem::create_directory(dir_.Sub(name));
    for (int z = 0; z < 3; ++z) {
      ASSERT_TRUE(testing::WriteTiffStack(absl::StrCat(dir_.Sub(name), "/s", z, ".tif"),
                                          {.pages = 1, .first = z}));
    }
    for (const std::string& path : {dir_.Sub(name), absl::StrCat(dir_.Sub(name), "/")}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FoundVolume found, FindVolume(path));
      EXPECT_EQ(found.format->name, "TIFF") << path;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
      EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{4, 3, 3})) << path;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(path));
      EXPECT_EQ(files.size(), 3U) << path;
    }
  }
}

// A store of Zarr is a folder, also by the array behind a colon and by its metadata.
// Root may read everything, so that it becomes somebody else.
class AsNobody {
 public:
  AsNobody() : was_root_(geteuid() == 0) { Become(kNobody); }
  ~AsNobody() { Become(0); }
  AsNobody(const AsNobody&) = delete;
  AsNobody& operator=(const AsNobody&) = delete;

 private:
  static constexpr uid_t kNobody = 65534;

  void Become(uid_t user) const { EXPECT_TRUE(!was_root_ || seteuid(user) == 0); }

  const bool was_root_;
};

// Symptom: without rights a TIFF was damaged, an HDF5 file was none, and a folder of Zarr lacked files.
TEST_F(FindVolumeTest, WhatMayNotBeReadIsPermissionDenied) {
  for (const char* name : {"a.tif", "a.h5", "a.nrrd", "a.raw"}) {
    testing::WriteFile(dir_.Sub(name), "bytes");
  }
  std::filesystem::create_directory(dir_.Sub("a.zarr"));
  testing::WriteFile(dir_.Sub("a.zarr/.zgroup"), R"({"zarr_format": 2})");
  using std::filesystem::perms;
  std::filesystem::permissions(dir_.Sub(""), perms::owner_all | perms::others_exec);
  for (const char* name : {"a.tif", "a.h5:/d", "a.nrrd", "a.raw", "a.zarr"}) {
    const std::string file = std::string(name).substr(0, std::string(name).find(':'));
    std::filesystem::permissions(dir_.Sub(file), perms::none);
    absl::Status status;
    {
      const AsNobody nobody;
      status = OpenVolumeSeries(dir_.Sub(name)).status();
    }
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr(file))) << name;
    std::filesystem::permissions(dir_.Sub(file), perms::owner_all);
  }
  std::filesystem::permissions(dir_.Sub(""), perms::owner_write | perms::owner_read);
  absl::Status status;
  {
    const AsNobody nobody;
    status = OpenVolumeSeries(dir_.Sub("a.nrrd")).status();
  }
  std::filesystem::permissions(dir_.Sub(""), perms::owner_all);
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr("a.nrrd")));
}

TEST_F(FindVolumeTest, FindsZarr) {
  Write("a.zarr/.zgroup", "{\"zarr_format\": 2}");
  Write("a.zarr/v/.zarray",
        R"({"zarr_format": 2, "shape": [2, 3, 4], "chunks": [2, 3, 4], "dtype": "|u1",
            "order": "C", "compressor": null, "filters": null, "fill_value": 5})");
  Write("a.zarr/v/0.0.0", "abcdefghijklmnopqrstuvwx");
  for (const char* path : {"a.zarr", "a.zarr/", "a.zarr:v", "a.zarr/v", "a.zarr/v/.zarray"}) {
    SCOPED_TRACE(path);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FoundVolume found, FindVolume(dir_.Sub(path)));
    EXPECT_EQ(found.format->name, "Zarr");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.Sub(path)));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*source, 1));
    EXPECT_EQ(samples, "abcdefghijklmnopqrstuvwx");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(dir_.Sub(path)));
    EXPECT_THAT(files, ElementsAre(dir_.Sub("a.zarr/.zgroup"), dir_.Sub("a.zarr/v/.zarray"),
                                   dir_.Sub("a.zarr/v/0.0.0")));
  }
  std::filesystem::create_directory(dir_.Sub("empty.zarr"));
  EXPECT_THAT(FindVolume(dir_.Sub("empty.zarr")),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("hidden files")));
}

TEST_F(FindVolumeTest, WhateverIsOneVolumeIsASeriesOfOneFieldAndOneStep) {
  const std::string samples = Noise(kDims, ScalarType::kInt16);
  testing::NiftiHeader nifti;
  nifti.dims = kDims;
  for (const std::string& path :
       {Write("head.nrrd", testing::NrrdHeader(kDims, "short", "raw") + samples),
        Write("head.mha", testing::MetaHeader(kDims, "MET_SHORT", "LOCAL") + samples),
        Write("head.nii.gz", testing::Gzip(testing::NiftiHeaderBytes(nifti) + samples))}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
    EXPECT_EQ(series->info().name, path);
    ASSERT_EQ(series->info().fields.size(), 1u);
    EXPECT_EQ(series->info().fields[0].name, "head");
    EXPECT_THAT(series->info().fields[0].components, ElementsAre(""));
    EXPECT_EQ(series->info().fields[0].unit, "");
    EXPECT_THAT(series->info().times, IsEmpty());
    EXPECT_EQ(series->info().step_count(), 1);
    EXPECT_EQ(series->info().time_unit, "");
    EXPECT_EQ(series->info().length_unit, path.ends_with(".nii.gz") ? "mm" : "");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto plain, OpenVolumeFile(path));
    for (int round = 0; round < 2; ++round) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
      EXPECT_EQ(volume->info().geometry, plain->info().geometry);
      EXPECT_EQ(volume->info().patient_frame.has_value(), plain->info().patient_frame.has_value());
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 1));
      EXPECT_TRUE(read == samples);
    }
  }
}

TEST_F(FindVolumeTest, VtkFilesAreSeriesByTheirEnding) {
  const std::string image = Write(
      "a.VTI",
      VtiBytes({.extent = "0 3 0 2 0 1",
                .fields = {{.name = "p", .type = "UInt8", .samples = std::string(24, 'p')},
                           {.name = "q", .type = "UInt8", .samples = std::string(24, 'q')}}}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto both, OpenVolumeSeries(image));
  EXPECT_EQ(both->info().fields.size(), 2u);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto one, OpenVolumeSeries(image + ":q"));
  ASSERT_EQ(one->info().fields.size(), 1u);
  EXPECT_EQ(one->info().fields[0].name, "q");
  const std::string pvd = Write("run.pvd",
                                "<VTKFile><Collection><DataSet timestep=\"3\" file=\"a.VTI\"/>"
                                "</Collection></VTKFile>");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto steps, OpenVolumeSeries(pvd));
  EXPECT_THAT(steps->info().times, ElementsAre(3));
  const std::string pieces = Write(
      "a.pvti",
      "<VTKFile><PImageData WholeExtent=\"0 3 0 2 0 1\" Origin=\"10 20 30\" Spacing=\"0.5 2 4\">"
      "<PPointData><PDataArray type=\"UInt8\" Name=\"q\"/></PPointData>"
      "<Piece Extent=\"0 3 0 2 0 1\" Source=\"a.VTI\"/></PImageData></VTKFile>");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tiled, OpenVolumeSeries(pieces));
  EXPECT_EQ(tiled->info().fields[0].name, "q");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, tiled->Open(0, 0, 0));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 2));
  EXPECT_EQ(read, std::string(24, 'q'));
  // A single volume of it, and its files, also as a step.
  for (const std::string& path : {pieces, pieces + ":q"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto only, OpenVolumeFile(path));
    EXPECT_EQ(only->info().geometry, volume->info().geometry);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(path));
    EXPECT_THAT(files, ElementsAre(pieces, image));
  }
  const std::string tiled_pvd =
      Write("tiled.pvd",
            "<VTKFile><Collection><DataSet timestep=\"3\" file=\"a.pvti\"/>"
            "</Collection></VTKFile>");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(tiled_pvd));
  EXPECT_THAT(files, ElementsAre(tiled_pvd, pieces, image));
}

// ITK knows NIfTI by the ending of the name, so that --format nifti was refused for others.
TEST_F(FindVolumeTest, NiftiIsKnownByContentIfItIsForced) {
  const std::string samples = Noise(kDims, ScalarType::kInt16);
  for (const std::string& path :
       {Write("head.foo", testing::NiftiHeaderBytes({.dims = kDims}) + samples),
        Write("head.tif", testing::Gzip(testing::NiftiHeaderBytes({.dims = kDims}) + samples)),
        Write("head.mgh", testing::Nifti2Bytes({.dims = kDims}) + samples)}) {
    SCOPED_TRACE(path);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series,
                                  OpenVolumeSeries(path, {.axes = "", .format = "nifti"}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
    EXPECT_EQ(ReadAll(*volume, 1).value(), samples);
  }
  EXPECT_THAT(
      OpenVolumeSeries(Write("noise.foo", std::string(600, 'x')), {.axes = "", .format = "nifti"}),
      StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("not a NIfTI file")));
  EXPECT_FALSE(OpenVolumeSeries(Write("a.mgh", testing::MghBytes({}) + samples),
                                {.axes = "", .format = "nifti"})
                   .ok());
}

TEST_F(FindVolumeTest, ANameSaysInAnyCaseThatAFileHasItsOwnDimensions) {
  for (const char* name : {"a.nii", "a.nii.gz", "a.NRRD", "a.nhdr", "b/a.mha", "a.mhd", "a.hdr",
                           "a.dcm", "a.h5:/d", "a.vti:p", "a.pvd", "a.MRC", "a.tiff", "a*.tif"}) {
    EXPECT_TRUE(NamesFormat(name)) << name;
  }
  for (const char* name : {"a.raw", "a.nrrd.raw", "a", "nii", "a.gz"}) {
    EXPECT_FALSE(NamesFormat(name)) << name;
  }
}

// Symptom: with one order by names and another by content, such files were taken for the first
// format of that name.
TEST_F(FindVolumeTest, ContentDecidesAmongFormatsThatShareNames) {
  const auto format_of = [&](const std::string& path) {
    const auto found = FindVolume(path);
    return found.ok() ? std::string(found->format->name) : found.status().ToString();
  };
  const std::string dicom = std::string(128, '\0') + "DICM" + std::string(600, '\0');
  EXPECT_EQ(format_of(Write("a.img", dicom)), "DICOM") << "without a header beside it";
  EXPECT_EQ(format_of(Write("b.hdr", dicom)), "DICOM");
  EXPECT_EQ(format_of(Write("c", dicom)), "DICOM");
  EXPECT_EQ(format_of(Write("d.hdr", testing::NiftiHeaderBytes({.dims = kDims}))), "NIfTI-1");
  EXPECT_EQ(format_of(Write("e.nii", testing::Nifti2Bytes({.dims = kDims}))), "NIfTI-2");
  EXPECT_EQ(format_of(Write("f.nii", "text")), "NIfTI") << "its reader says why it is not";
  EXPECT_EQ(format_of(Write("g", "NRRD0004\n")), "NRRD");
  EXPECT_EQ(format_of(Write("h.mha", "NRRD0004\n")), "MetaImage") << "the name decides";
}

TEST_F(FindVolumeTest, AFormatIsForcedByItsNameInAnyCase) {
  const std::string path = Write("a.mgz", "NRRD0004\n");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FoundVolume found, FindVolume(path, "NRRD"));
  EXPECT_EQ(found.format->name, "NRRD");
  for (const char* name : {"hdf5", "vti", "slices", "vdb"}) {
    EXPECT_THAT(FindVolume(path, name),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         HasSubstr("expected one of nifti, nrrd, metaimage, dicom, mrc")));
  }
}

TEST_F(FindVolumeTest, ErrorsAreThoseOfTheFormat) {
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("none.nrrd")),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.nrrd")));
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("none.pvd")),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.pvd")));
  EXPECT_THAT(OpenVolumeSeries(Write("a.txt", "text")),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("unknown kind of file")));
  EXPECT_THAT(OpenVolumeSeries(Write("a.nrrd", "NRRD0004\n"), {.axes = "TZYX"}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--axes TZYX")));
}

}  // namespace
}  // namespace isoscope::source
