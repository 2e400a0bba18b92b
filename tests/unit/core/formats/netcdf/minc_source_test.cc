#include "core/formats/netcdf/minc_source.h"

#include <cstdint>
#include <filesystem>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "itkMINCImageIO.h"

#include "core/formats/open_volume.h"
#include "core/source/volume_source.h"
#include "hdf5.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

// A file of 4 x 3 x 2 samples as ITK and libminc write it: sample i is 100 + i; RAS, x runs along
// y.
std::string WriteMinc(const testing::TempDir& dir) {
  std::vector<float> values;
  for (int i = 0; i < 24; ++i) {
    values.push_back(static_cast<float>(100 + i));
  }
  const std::string path = dir.Sub("a.mnc");
  const auto io = itk::MINCImageIO::New();
  io->SetFileName(path);
  io->SetNumberOfDimensions(3);
  const std::vector<std::vector<double>> directions{{0, 1, 0}, {-1, 0, 0}, {0, 0, 1}};
  const std::vector<unsigned> dims{4, 3, 2};
  const std::vector<double> spacing{1.5, 2, 3};
  const std::vector<double> origin{10, 20, 30};
  itk::ImageIORegion region(3);
  for (unsigned axis = 0; axis < 3; ++axis) {
    io->SetDimensions(axis, dims[axis]);
    io->SetSpacing(axis, spacing[axis]);
    io->SetOrigin(axis, origin[axis]);
    io->SetDirection(axis, directions[axis]);
    region.SetSize(axis, dims[axis]);
    region.SetIndex(axis, 0);
  }
  io->SetComponentType(itk::IOComponentEnum::FLOAT);
  io->SetNumberOfComponents(1);
  io->SetPixelType(itk::IOPixelEnum::SCALAR);
  io->SetIORegion(region);
  io->WriteImageInformation();
  io->Write(values.data());
  return path;
}

TEST(MincSourceTest, CornersAndValues) {
  const testing::TempDir dir;
  const std::string path = WriteMinc(dir);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
  EXPECT_EQ(series->info().fields[0].name, "a");
  EXPECT_EQ(series->info().length_unit, "mm");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path));
  EXPECT_EQ(volume->info().geometry.sample_dims, (math::Index3{4, 3, 2}));
  EXPECT_TRUE(volume->info().patient_frame.has_value());
  const math::Mat4d to_world = volume->info().geometry.world_from_index();
  EXPECT_LT(math::Length(math::TransformPoint(to_world, {0, 0, 0}) - math::Vec3d{-10, -20, 30}),
            1e-9);
  EXPECT_LT(math::Length(math::TransformPoint(to_world, {3, 2, 1}) - math::Vec3d{-6, -24.5, 33}),
            1e-9);
  ASSERT_EQ(volume->info().type, volume::ScalarType::kFloat32);
  for (const std::int64_t planes : {1, 2}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*volume, planes));
    const auto values = testing::ValuesOf<float>(bytes);
    for (int i = 0; i < 24; ++i) {
      EXPECT_EQ(values[static_cast<std::size_t>(i)], static_cast<float>(100 + i));
    }
  }
}

// Changes an attribute of an axis.
void ChangeMinc(const std::string& path, const std::string& axis, const std::string& attribute,
                const std::vector<double>& numbers, const std::string& text = "") {
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  ASSERT_GE(file, 0);
  const std::string name = "/minc-2.0/dimensions/" + axis;
  if (H5Aexists_by_name(file, name.c_str(), attribute.c_str(), H5P_DEFAULT) > 0) {
    H5Adelete_by_name(file, name.c_str(), attribute.c_str(), H5P_DEFAULT);
  }
  if (text.empty()) {
    testing::WriteHdf5Numbers(file, name, attribute, numbers);
  } else {
    testing::WriteHdf5Texts(file, name, attribute, {text}, true);
  }
  H5Fclose(file);
}

// ITK and libminc would take the step of another axis, and millimetres for any unit.
TEST(MincSourceTest, HeaderIsCheckedBeforeTheLibrariesReadIt) {
  const testing::TempDir dir;
  std::string path = WriteMinc(dir);
  ChangeMinc(path, "xspace", "step", {0});
  EXPECT_THAT(OpenVolumeFile(path),
              StatusIs(kInvalid, HasSubstr("a.mnc: MINC 2: the step of xspace is 0")));
  path = WriteMinc(dir);
  ChangeMinc(path, "zspace", "units", {}, "cm");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path));
  const volume::GridGeometry& grid = volume->info().geometry;
  EXPECT_LT(math::Length(grid.spacing - math::Vec3d{1.5, 2, 30}), 1e-9);
  EXPECT_LT(math::Length(grid.origin - math::Vec3d{-10, -20, 300}), 1e-9);
}

TEST(MincSourceTest, OtherFilesAreRefused) {
  const testing::TempDir dir;
  testing::WriteFile(dir.Sub("one.mnc"), std::string("CDF\1") + std::string(100, 'x'));
  EXPECT_THAT(OpenVolumeFile(dir.Sub("one.mnc")), StatusIs(kInvalid, HasSubstr("netCDF header")));
  testing::WriteFile(dir.Sub("text.mnc"), "hello");
  EXPECT_THAT(OpenVolumeFile(dir.Sub("text.mnc")),
              StatusIs(kInvalid, HasSubstr("not a MINC file")));
  const std::string whole = testing::ReadFile(WriteMinc(dir));
  for (std::size_t size = 8; size < whole.size(); size += whole.size() / 7) {
    testing::WriteFile(dir.Sub("cut.mnc"), whole.substr(0, size));
    const auto volume = OpenVolumeFile(dir.Sub("cut.mnc"));
    EXPECT_FALSE(volume.ok() && ReadAll(**volume, 1).ok()) << size;
  }
}

// HDF5, libminc and ITK read them in a child: whatever it does, this process gets a status, and the
// folder keeps the file alone.
TEST(MincSourceTest, HostileBytesAreErrorsOrValues) {
  const testing::TempDir dir;
  const std::string whole = testing::ReadFile(WriteMinc(dir));
  const testing::TempDir hostile;
  std::mt19937 random(20261125);
  int refused = 0;
  for (int i = 0; i < 40; ++i) {
    std::string bytes = whole;
    for (int flips = 1 + i % 6; flips > 0; --flips) {
      // A number of 4 bytes at a time is either random or as large as it can be.
      const std::size_t at = random() % (bytes.size() - 4);
      const std::uint32_t number = i % 2 == 0 ? 0xffffffffU : static_cast<std::uint32_t>(random());
      bytes.replace(at, 4, BytesOf(std::vector<std::uint32_t>{number}));
    }
    testing::WriteFile(hostile.Sub("a.mnc"), bytes);
    const auto volume = OpenVolumeFile(hostile.Sub("a.mnc"));
    const absl::Status status = volume.ok() ? ReadAll(**volume, 1).status() : volume.status();
    EXPECT_NE(status.code(), absl::StatusCode::kInternal) << i << ": " << status;
    if (!status.ok()) {
      ++refused;
      EXPECT_THAT(status.message(), HasSubstr("a.mnc")) << i;
    }
  }
  EXPECT_GT(refused, 3) << "the bytes that count were hit";
  const auto files = std::filesystem::directory_iterator(hostile.path());
  EXPECT_EQ(std::distance(begin(files), end(files)), 1);
}

}  // namespace
}  // namespace isoscope::source
