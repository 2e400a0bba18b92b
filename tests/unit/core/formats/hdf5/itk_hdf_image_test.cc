// Images that ITK itself writes. HDF5's headers and ITK's do not agree, so hostile files are in
// hdf5_mesh_series_test.cc.

#include <cstdint>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "itkHDF5ImageIO.h"

#include "core/formats/open_volume.h"
#include "core/math/vec.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

// The axes of indices lie along -y, z and x of the world.
const std::vector<std::vector<double>> kDirections{{0, -1, 0}, {0, 0, 1}, {1, 0, 0}};

template <typename T>
void WriteItkImage(const std::string& path, const std::vector<unsigned>& dims,
                   itk::IOComponentEnum type, const std::vector<T>& samples,
                   unsigned components = 1) {
  const auto io = itk::HDF5ImageIO::New();
  const auto axes = static_cast<unsigned>(dims.size());
  io->SetFileName(path);
  io->SetNumberOfDimensions(axes);
  itk::ImageIORegion region(axes);
  for (unsigned axis = 0; axis < axes; ++axis) {
    io->SetDimensions(axis, dims[axis]);
    io->SetSpacing(axis, 0.25 * (axis + 1));
    io->SetOrigin(axis, 10.0 * (axis + 1));
    if (axes == 3) {
      io->SetDirection(axis, kDirections[axis]);
    }
    region.SetSize(axis, dims[axis]);
    region.SetIndex(axis, 0);
  }
  io->SetComponentType(type);
  io->SetPixelType(components == 1 ? itk::IOPixelEnum::SCALAR : itk::IOPixelEnum::VECTOR);
  io->SetNumberOfComponents(components);
  io->SetIORegion(region);
  io->Write(samples.data());
}

TEST(ItkHdfImageTest, SamplesAndPositionsAreThoseThatItkWrote) {
  const TempDir dir;
  std::vector<std::int16_t> samples;
  for (int i = 0; i < 24; ++i) {
    samples.push_back(static_cast<std::int16_t>(100 * i - 1000));
  }
  const std::string path = dir.Sub("a.h5");
  WriteItkImage(path, {4, 3, 2}, itk::IOComponentEnum::SHORT, samples);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
  const volume::GridGeometry& grid = source->info().geometry;
  EXPECT_EQ(grid.sample_dims, (math::Index3{4, 3, 2}));
  EXPECT_EQ(grid.spacing, (math::Vec3d{0.25, 0.5, 0.75}));
  EXPECT_EQ(grid.origin, (math::Vec3d{10, 20, 30}));
  EXPECT_EQ(grid.direction.columns[0], (math::Vec3d{0, -1, 0}));
  EXPECT_EQ(grid.direction.columns[1], (math::Vec3d{0, 0, 1}));
  EXPECT_EQ(grid.direction.columns[2], (math::Vec3d{1, 0, 0}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 1));
  EXPECT_EQ(testing::ValuesOf<std::int16_t>(read), samples);
}

TEST(ItkHdfImageTest, ComponentsAreChosenByNumber) {
  const TempDir dir;
  std::vector<float> samples;
  for (int i = 0; i < 2 * 24; ++i) {
    samples.push_back(0.5F * static_cast<float>(i));
  }
  const std::string path = dir.Sub("v.hdf5");
  WriteItkImage(path, {4, 3, 2}, itk::IOComponentEnum::FLOAT, samples, 2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
  ASSERT_EQ(series->info().fields.size(), 1U);
  EXPECT_THAT(series->info().fields[0].components, ElementsAre("0", "1"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, series->Open(0, 1, 0));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*second, 1));
  const std::vector<float> values = testing::ValuesOf<float>(read);
  ASSERT_EQ(values.size(), 24U);
  for (std::size_t i = 0; i < values.size(); ++i) {
    EXPECT_EQ(values[i], samples[2 * i + 1]) << i;
  }
}

TEST(ItkHdfImageTest, AnImageOfAPlaneIsRefusedWithItsShape) {
  const TempDir dir;
  const std::string path = dir.Sub("plane.h5");
  WriteItkImage(path, {4, 3}, itk::IOComponentEnum::UCHAR, std::vector<std::uint8_t>(12));
  EXPECT_THAT(OpenVolumeFile(path),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("plane.h5"), HasSubstr("2 axes (3 x 4 elements)"))));
}

}  // namespace
}  // namespace isoscope::source
