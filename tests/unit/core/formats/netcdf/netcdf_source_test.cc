#include "core/formats/netcdf/netcdf_source.h"

#include <memory>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/netcdf/netcdf_bytes.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::NetcdfWriter;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::ValuesOf;

// Axes in the order x, time, z, component, y.
TEST(NetcdfSourceTest, ReadsStepsAndComponentsWhateverTheOrderOfAxes) {
  const testing::TempDir dir;
  const std::vector<std::size_t> sizes{5, 2, 4, 2, 3};
  {
    NetcdfWriter writer(dir.Sub("a.nc"), NC_NETCDF4);
    writer.LeaveUnfilled();
    std::vector<int> dims;
    const std::vector<std::string> names{"x", "time", "z", "component", "y"};
    for (std::size_t i = 0; i < names.size(); ++i) {
      dims.push_back(writer.Dimension(names[i], sizes[i]));
    }
    std::vector<double> values(240);
    for (std::size_t i = 0; i < values.size(); ++i) {
      values[i] = static_cast<double>(i);
    }
    writer.Variable("v", NC_INT, dims, sizes, values, {}, {}, {2, 1, 3, 2, 2});
  }
  for (const std::int64_t step : {0, 1}) {
    for (const std::int64_t component : {0, 1}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto file, NetcdfFile::Open(dir.Sub("a.nc")));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto volumes, file->Arrays());
      ASSERT_EQ(volumes.size(), 1u);
      volumes[0].roles = CfRolesOf(volumes[0].axes).value();
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume,
                                    OpenNetcdfVolume(std::move(file), volumes[0], step, component));
      EXPECT_EQ(volume->info().geometry.sample_dims, (math::Index3{3, 4, 5}));
      EXPECT_EQ(math::TransformPoint(volume->info().geometry.world_from_index(), {2, 3, 4}),
                (math::Vec3d{4, 2, 3}));
      for (const std::int64_t planes : {1, 2, 5}) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, planes));
        std::size_t i = 0;
        for (int x = 0; x < 5; ++x) {
          for (int z = 0; z < 4; ++z) {
            for (int y = 0; y < 3; ++y) {
              EXPECT_EQ(ValuesOf<std::int32_t>(read)[i++],
                        (((x * 2 + step) * 4 + z) * 2 + component) * 3 + y);
            }
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace isoscope::source
