#include "core/source/refused_formats.h"

#include <filesystem>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;

class RefusedFormatsTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& bytes) {
    std::filesystem::create_directories(std::filesystem::path(dir_.Sub(name)).parent_path());
    testing::WriteFile(dir_.Sub(name), bytes);
    return dir_.Sub(name);
  }
  static void Expect(const std::string& path, const std::string& format,
                     const std::string& advice) {
    for (const absl::Status& status :
         {OpenVolumeFile(path).status(), OpenVolumeSeries(path).status()}) {
      EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument,
                                   AllOf(HasSubstr(path + ": " + format), HasSubstr(advice),
                                         Not(EndsWith(".")))));
    }
  }
  const testing::TempDir dir_;
};

TEST_F(RefusedFormatsTest, FoldersOfArraysAreKnownByTheirFiles) {
  Write("a.n5/attributes.json", "{\"n5\":\"2.5.0\"}");
  Write("a.n5/c0/attributes.json", "{}");
  Expect(dir_.Sub("a.n5"), "N5", "HDF5");
  Expect(dir_.Sub("a.n5/c0"), "N5", "HDF5");
  Write("b/.zgroup", "{}");
  Expect(dir_.Sub("b"), "Zarr", "TIFF");
}

TEST_F(RefusedFormatsTest, OtherFilesAreKnownByTheirNames) {
  Expect(Write("a.vtu", "<VTKFile type=\"UnstructuredGrid\"/>"), "a VTK grid", "Resample To Image");
  Expect(Write("a.pvtr", "<VTKFile type=\"PRectilinearGrid\"/>"), "a VTK grid", ".vti");
  Expect(Write("a.CZI", "ZISRAWFILE"), "a microscope's own format", "OME-TIFF");
  Expect(Write("a.mnc.gz", testing::Gzip("CDF")), "MINC as a gzip stream", "gunzip");
}

TEST_F(RefusedFormatsTest, AnythingElseIsNot) {
  EXPECT_EQ(WhyRefused(Write("a.bin", "x")), std::nullopt);
  EXPECT_EQ(WhyRefused(dir_.Sub("none")), std::nullopt);
  std::filesystem::create_directory(dir_.Sub("empty"));
  EXPECT_EQ(WhyRefused(dir_.Sub("empty")), std::nullopt);
}

}  // namespace
}  // namespace isoscope::source
