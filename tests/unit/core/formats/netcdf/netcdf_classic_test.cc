#include "core/formats/netcdf/netcdf_classic.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/netcdf/netcdf_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::NetcdfWriter;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

TEST(NetcdfClassicTest, NoByteOfTheSamplesMayBeMissing) {
  const testing::TempDir dir;
  for (const int mode : {0, NC_64BIT_OFFSET, NC_64BIT_DATA}) {
    for (const bool has_two : {false, true}) {
      {
        NetcdfWriter writer(dir.Sub("a.nc"), mode);
        const int t = writer.Dimension("time", 0);
        const int x = writer.Dimension("x", 5);
        writer.Variable("x", NC_DOUBLE, {x}, {5}, {1, 2, 3, 4, 5}, {{"units", "m"}});
        writer.Variable("bytes", NC_BYTE, {t, x}, {3, 5}, std::vector<double>(15, 7));
        if (has_two) {
          writer.Variable("shorts", NC_SHORT, {t, x}, {3, 5}, std::vector<double>(15, 7));
        }
      }
      const std::string whole = testing::ReadFile(dir.Sub("a.nc"));
      EXPECT_TRUE(CheckClassicNetcdfLength(dir.Sub("a.nc")).ok());
      // The library may pad the last record.
      for (std::size_t size = 4; size + 4 < whole.size(); ++size) {
        testing::WriteFile(dir.Sub("a.nc"), whole.substr(0, size));
        EXPECT_THAT(CheckClassicNetcdfLength(dir.Sub("a.nc")),
                    StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("a.nc")))
            << size << " of " << whole.size();
      }
    }
  }
}

TEST(NetcdfClassicTest, OtherFormatsPassAndHostileHeadersDoNot) {
  const testing::TempDir dir;
  const auto check = [&](const std::string& bytes) {
    testing::WriteFile(dir.Sub("a.nc"), bytes);
    return CheckClassicNetcdfLength(dir.Sub("a.nc"));
  };
  EXPECT_TRUE(check("").ok());
  EXPECT_TRUE(check("CDF").ok());
  EXPECT_TRUE(check("\x89HDF").ok());
  EXPECT_FALSE(check("CDF\x01").ok());
  EXPECT_FALSE(check("CDF\x05" + std::string(200, '\xff')).ok());
  EXPECT_TRUE(check("CDF\x02" + std::string(200, '\0')).ok());
}

}  // namespace
}  // namespace isoscope::source
