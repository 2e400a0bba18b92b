#include "core/formats/hdf5/hdf5_coordinates.h"

#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/status_macros.h"
#include "core/formats/hdf5/hdf5_series.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "hdf5.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteHdf5Dataset;
using ::isoscope::testing::WriteHdf5Numbers;
using ::isoscope::testing::WriteHdf5Scales;
using ::isoscope::testing::WriteHdf5Texts;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class Hdf5CoordinatesTest : public ::testing::Test {
 protected:
  void Write(const std::string& name, const std::vector<hsize_t>& dims,
             const std::vector<double>& values) {
    WriteHdf5Dataset(file_.get(), name, dims, H5T_IEEE_F64LE, values.data());
  }
  // 2 x 3 x 4 samples, in a group that is a plot of them.
  void WritePlot(const std::vector<std::string>& axes) {
    H5Gclose(H5Gcreate2(file_.get(), "g", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
    WriteHdf5Texts(file_.get(), "g", "NX_class", {"NXdata"});
    WriteHdf5Texts(file_.get(), "g", "signal", {"v"});
    WriteHdf5Texts(file_.get(), "g", "axes", axes);
    Write("g/v", {2, 3, 4}, samples_);
  }
  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(const std::string& name,
                                                     const std::string& letters = "",
                                                     const GridRules& rules = {}) {
    file_ = Hdf5Handle();
    ISOSCOPE_ASSIGN_OR_RETURN(series_, OpenHdf5Series(path_ + ":/" + name, letters, rules));
    return series_->Open(0, 0, 0);
  }
  const TempDir dir_;
  const std::string path_ = dir_.Sub("a.h5");
  Hdf5Handle file_{H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose};
  const std::vector<double> samples_ = std::vector<double>(120, 7);
  std::unique_ptr<VolumeSeries> series_;
};

TEST_F(Hdf5CoordinatesTest, AxesOfNexusGiveSpacingOriginAndUnit) {
  WritePlot({"z", "y", "x"});
  Write("g/z", {2}, {10, 13});
  Write("g/y", {3}, {-1, -1.5, -2});
  Write("g/x", {4}, {0.25, 0.5, 0.75, 1});
  for (const char* axis : {"g/x", "g/y", "g/z"}) {
    WriteHdf5Texts(file_.get(), axis, "units", {"mm"});
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("g/v"));
  const volume::GridGeometry& grid = source->info().geometry;
  EXPECT_EQ(grid.sample_dims, (math::Index3{4, 3, 2}));
  EXPECT_EQ(grid.spacing, (math::Vec3d{0.25, 0.5, 3}));
  EXPECT_EQ(grid.origin, (math::Vec3d{0.25, -1, 10}));
  EXPECT_EQ(grid.direction.columns[1], (math::Vec3d{0, -1, 0})) << "y descends";
  EXPECT_EQ(series_->info().length_unit, "mm");
}

// [x][y][z], as many write it: the slowest axis of the file is x of the world.
TEST_F(Hdf5CoordinatesTest, NamesDecideWhichAxisIsWhich) {
  WritePlot({"x", "y", "z"});
  Write("g/x", {2}, {0, 5});
  Write("g/y", {3}, {0, 1, 2});
  Write("g/z", {4}, {100, 101, 102, 103});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("g/v"));
  const volume::GridGeometry& grid = source->info().geometry;
  EXPECT_EQ(grid.sample_dims, (math::Index3{4, 3, 2}));
  EXPECT_EQ(grid.direction.columns[2], (math::Vec3d{1, 0, 0}));
  EXPECT_EQ(grid.direction.columns[1], (math::Vec3d{0, 1, 0}));
  EXPECT_EQ(grid.direction.columns[0], (math::Vec3d{0, 0, 1}));
  EXPECT_EQ(grid.spacing, (math::Vec3d{1, 1, 5}));
  EXPECT_EQ(grid.origin, (math::Vec3d{0, 0, 100}));
}

TEST_F(Hdf5CoordinatesTest, LettersOfTheUserGoBeforeNames) {
  WritePlot({"x", "y", "z"});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("g/v", "ZYX"));
  EXPECT_EQ(source->info().geometry.direction.columns[0], (math::Vec3d{1, 0, 0}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto turned, Open("g/v", "ZXY"));
  EXPECT_EQ(turned->info().geometry.direction.columns[0], (math::Vec3d{0, 1, 0}));
  EXPECT_EQ(turned->info().geometry.direction.columns[1], (math::Vec3d{1, 0, 0}));
}

TEST_F(Hdf5CoordinatesTest, BordersBetweenSamplesBecomeMiddles) {
  WritePlot({"z", ".", "."});
  Write("g/z", {3}, {10, 12, 14});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("g/v"));
  EXPECT_EQ(source->info().geometry.spacing.z, 2);
  EXPECT_EQ(source->info().geometry.origin.z, 11);
}

TEST_F(Hdf5CoordinatesTest, CoordinatesThatDoNotFitAreRefusedByName) {
  WritePlot({"z", "y", "x"});
  Write("g/y", {5}, {1, 2, 3, 4, 5});
  EXPECT_THAT(Open("g/v"),
              StatusIs(kInvalid, AllOf(HasSubstr("a.h5:/g/v: its coordinates \"y\" "
                                                 "have 5 elements; expected 3, or 4"))));
}

TEST_F(Hdf5CoordinatesTest, CoordinatesThatAPlotNamesAndHasNotAreRefusedByName) {
  WritePlot({"z", "y", "x"});
  Write("g/z", {2}, {0, 2});
  Write("g/x", {4}, {0, 1, 2, 3});
  EXPECT_THAT(Open("g/v"),
              StatusIs(kInvalid, AllOf(HasSubstr("names the coordinates \"y\" of axis 1"),
                                       HasSubstr("no such dataset"), HasSubstr("--spacing"))));
  EXPECT_TRUE(Open("g/v", "", {.has_spacing = true}).ok());
}

TEST_F(Hdf5CoordinatesTest, NexusScalesCoordinates) {
  WritePlot({"z", "y", "x"});
  Write("g/z", {2}, {0, 2});
  Write("g/y", {3}, {0, 1, 2});
  Write("g/x", {4}, {0, 1, 2, 3});
  Write("g/x_scaling_factor", {1}, {0.5});
  Write("g/x_offset", {1}, {10});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("g/v"));
  EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{0.5, 1, 2}));
  EXPECT_EQ(source->info().geometry.origin, (math::Vec3d{5, 0, 0}));
}

TEST_F(Hdf5CoordinatesTest, ValuesThatNexusScalesAreRefusedByName) {
  WritePlot({"z", "y", "x"});
  Write("g/v_scaling_factor", {1}, {0.1});
  EXPECT_THAT(Open("g/v"), StatusIs(kInvalid, AllOf(HasSubstr("v_scaling_factor"),
                                                    HasSubstr("(value + 0) * 0.1"))));
}

TEST_F(Hdf5CoordinatesTest, LengthsInSeveralUnitsBecomeMetresBesideOtherAxes) {
  WritePlot({"z", "y", "x"});
  Write("g/z", {2}, {0, 2});
  Write("g/y", {3}, {0, 0.5, 1});
  Write("g/x", {4}, {0, 1, 2, 3});
  WriteHdf5Texts(file_.get(), "g/z", "units", {"um"});
  WriteHdf5Texts(file_.get(), "g/x", "units", {"mm"});
  EXPECT_THAT(Open("g/v"), StatusIs(kInvalid, HasSubstr("\"y\" has some without a unit")));
  file_ = Hdf5Handle(H5Fopen(path_.c_str(), H5F_ACC_RDWR, H5P_DEFAULT), H5Fclose);
  WriteHdf5Texts(file_.get(), "g/y", "units", {"K"});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("g/v"));
  EXPECT_LT(math::Length(source->info().geometry.spacing - math::Vec3d{1e-3, 0.5, 2e-6}), 1e-15);
  EXPECT_EQ(series_->info().length_unit, "");
}

TEST_F(Hdf5CoordinatesTest, LengthsAlongOneAxisOnlyAreRefused) {
  Write("u", {2, 3, 4}, samples_);
  Write("z", {2}, {0, 250});
  WriteHdf5Texts(file_.get(), "z", "units", {"m"});
  WriteHdf5Scales(file_.get(), "u", {"/z", "", ""});
  EXPECT_THAT(Open("u"), StatusIs(kInvalid, AllOf(HasSubstr("\"z\" has coordinates in m"),
                                                  HasSubstr("\"X\" has none"))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("u", "", {.has_spacing = true}));
  EXPECT_EQ(source->info().geometry.spacing.z, 250);
}

TEST_F(Hdf5CoordinatesTest, UnevenAxisNeedsResampling) {
  WritePlot({"z", "y", "x"});
  Write("g/z", {2}, {0, 1});
  Write("g/y", {3}, {0, 1, 2});
  Write("g/x", {4}, {0, 1, 2, 5});
  EXPECT_THAT(Open("g/v"),
              StatusIs(kInvalid, AllOf(HasSubstr("\"x\" is not even"), HasSubstr("--resample"))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("g/v", "", {.resamples = true}));
  EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{6, 3, 2}));
  EXPECT_EQ(source->info().geometry.spacing.x, 1);
}

TEST_F(Hdf5CoordinatesTest, DimensionScalesGivePositionsToo) {
  Write("u", {5, 2, 3, 4}, samples_);
  Write("time", {5}, {0, 1, 2, 4, 8});
  Write("depth", {2}, {3, 5});
  WriteHdf5Texts(file_.get(), "u", "DIMENSION_LABELS", {"", "", "y", "x"});
  WriteHdf5Scales(file_.get(), "u", {"/time", "/depth", "", ""});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("u"));
  EXPECT_THAT(series_->info().times, ElementsAre(0, 1, 2, 4, 8));
  EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{1, 1, 2}));
  EXPECT_EQ(source->info().geometry.origin, (math::Vec3d{0, 0, 3}));
  EXPECT_EQ(source->info().geometry.direction.columns[2], (math::Vec3d{0, 0, 1}))
      << "up, as it counts";
}

TEST_F(Hdf5CoordinatesTest, TimesMustAscend) {
  Write("u", {3, 2, 3, 4}, samples_);
  Write("falling", {3}, {0, 2, 2});
  WriteHdf5Texts(file_.get(), "u", "DIMENSION_LABELS", {"t", "z", "y", "x"});
  WriteHdf5Scales(file_.get(), "u", {"/falling", "", "", ""});
  EXPECT_THAT(Open("u"), StatusIs(kInvalid, AllOf(HasSubstr("has 2 at index 2, behind 2"))));
}

TEST_F(Hdf5CoordinatesTest, ScaleThatNetcdfMadeWithoutValuesIsNone) {
  Write("u", {2, 3, 4}, samples_);
  Write("z", {2}, {0, 0});
  WriteHdf5Texts(file_.get(), "z", "NAME",
                 {"This is a netCDF dimension but not a netCDF variable.        2"});
  WriteHdf5Scales(file_.get(), "u", {"/z", "", ""});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("u"));
  EXPECT_EQ(source->info().geometry.spacing.z, 1);
}

TEST_F(Hdf5CoordinatesTest, ScaleOfEqualValuesIsRefused) {
  Write("u", {2, 3, 4}, samples_);
  Write("z", {2}, {0, 0});
  WriteHdf5Scales(file_.get(), "u", {"/z", "", ""});
  EXPECT_THAT(Open("u"), StatusIs(kInvalid, HasSubstr("axis \"z\" begins and ends at 0")));
}

TEST_F(Hdf5CoordinatesTest, ElementSizeIsForAxesWithoutCoordinates) {
  Write("u", {2, 3, 4}, samples_);
  Write("z", {2}, {0, 9});
  WriteHdf5Scales(file_.get(), "u", {"/z", "", ""});
  WriteHdf5Numbers(file_.get(), "u", "element_size_um", {4, 2, 0.5});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("u"));
  EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{0.5, 2, 9}));
}

TEST_F(Hdf5CoordinatesTest, ElementSizeIsInMicrometres) {
  Write("u", {2, 3, 4}, samples_);
  WriteHdf5Numbers(file_.get(), "u", "element_size_um", {4, 2, 0.5});
  Write("mixed", {2, 3, 4}, samples_);
  WriteHdf5Numbers(file_.get(), "mixed", "element_size_um", {4, 2, 0.5});
  Write("z", {2}, {0, 0.002});
  WriteHdf5Texts(file_.get(), "z", "units", {"mm"});
  WriteHdf5Scales(file_.get(), "mixed", {"/z", "", ""});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("u"));
  EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{0.5, 2, 4}));
  EXPECT_EQ(series_->info().length_unit, "um");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto mixed, Open("mixed"));
  EXPECT_LT(math::Length(mixed->info().geometry.spacing - math::Vec3d{0.5e-6, 2e-6, 2e-6}), 1e-15);
  EXPECT_EQ(series_->info().length_unit, "m");
}

TEST_F(Hdf5CoordinatesTest, ElementSizeThatIsNoneIsRefusedByName) {
  Write("two", {2, 3, 4}, samples_);
  WriteHdf5Numbers(file_.get(), "two", "element_size_um", {4, 2});
  Write("zero", {2, 3, 4}, samples_);
  WriteHdf5Numbers(file_.get(), "zero", "element_size_um", {4, 0, 1});
  EXPECT_THAT(Open("two"), StatusIs(kInvalid, HasSubstr("element_size_um has 2 numbers")));
  EXPECT_THAT(Open("zero"),
              StatusIs(kInvalid, HasSubstr("element_size_um has 4, 0, 1 in place of")));
}

TEST_F(Hdf5CoordinatesTest, AttributeWithTheNamesOfAllAxesDecides) {
  Write("v", {2, 3, 4, 5}, samples_);
  WriteHdf5Texts(file_.get(), "v", "axistags",
                 {"{\"axes\": [{\"key\": \"z\"}, {\"key\": \"y\"}, {\"key\": \"x\"}, "
                  "{\"key\": \"c\"}]}"});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("v"));
  EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{4, 3, 2}));
  EXPECT_EQ(series_->info().fields[0].components.size(), 5U);
}

TEST_F(Hdf5CoordinatesTest, NamesThatMeanOtherThingsLeaveThePlainOrder) {
  Write("v", {2, 3, 4}, samples_);
  WriteHdf5Texts(file_.get(), "v", "axes", {"t", "y", "x"});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open("v"));
  EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{4, 3, 2}));
}

}  // namespace
}  // namespace isoscope::source
