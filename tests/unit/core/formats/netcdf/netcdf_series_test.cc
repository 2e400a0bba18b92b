#include "core/formats/netcdf/netcdf_series.h"

#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "core/source/series_selection.h"
#include "core/source/volume_source.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/netcdf/netcdf_bytes.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::NetcdfWriter;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ValuesOf;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr int kModes[] = {0, NC_64BIT_OFFSET, NC_64BIT_DATA, NC_NETCDF4};
constexpr std::size_t kSamples = 24;  // 2 x 3 x 4

// Sample i of step t: 3 i + 100 t - 20.
std::vector<double> Ramp(int steps = 1) {
  std::vector<double> values;
  for (int t = 0; t < steps; ++t) {
    for (int i = 0; i < static_cast<int>(kSamples); ++i) {
      values.push_back(3 * i + 100 * t - 20);
    }
  }
  return values;
}

class NetcdfSeriesTest : public ::testing::Test {
 protected:
  // Dimensions z, y, x of 2, 3, 4 with coordinates, and variables of all kinds of values.
  std::string WriteRun(int mode) {
    const std::string path = dir_.Sub("run.nc");
    NetcdfWriter writer(path, mode);
    const int t = writer.Dimension("time", 0);
    const int z = writer.Dimension("z", 2);
    const int y = writer.Dimension("y", 3);
    const int x = writer.Dimension("x", 4);
    writer.Variable("time", NC_DOUBLE, {t}, {3}, {0, 0.5, 2}, {{"units", "s since 2000-01-01"}});
    writer.Variable("z", NC_DOUBLE, {z}, {2}, {5, 9}, {{"units", "m"}});
    writer.Variable("y", NC_FLOAT, {y}, {3}, {30, 20, 10}, {{"units", "m"}});
    writer.Variable("x", NC_SHORT, {x}, {4}, {-3, -1, 1, 3}, {{"units", "m"}});
    writer.Variable("u", NC_FLOAT, {t, z, y, x}, {3, 2, 3, 4}, Ramp(3),
                    {{"units", "m/s"}, {"long_name", "velocity"}});
    writer.Variable("packed", NC_SHORT, {t, z, y, x}, {3, 2, 3, 4}, Ramp(3), {},
                    {{"scale_factor", 0.5}, {"add_offset", 100}, {"_FillValue", -20}});
    writer.Variable("still", NC_INT, {z, y, x}, {2, 3, 4}, Ramp());
    return path;
  }
  absl::StatusOr<std::string> Samples(VolumeSeries* series, int field, int step) {
    auto volume = series->Open(field, 0, step);
    return volume.ok() ? ReadAll(**volume, 1) : volume.status();
  }
  testing::TempDir dir_;
};

TEST_F(NetcdfSeriesTest, VariablesAreFieldsAndTimesAreStepsInEveryFormat) {
  for (const int mode : kModes) {
    SCOPED_TRACE(mode);
    const std::string path = WriteRun(mode);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
    EXPECT_THAT(series->info().times, ElementsAre(0, 0.5, 2));
    EXPECT_EQ(series->info().time_unit, "s since 2000-01-01");
    EXPECT_EQ(series->info().length_unit, "m");
    ASSERT_EQ(series->info().fields.size(), 2u);
    EXPECT_EQ(series->info().fields[0].name, "u");
    EXPECT_EQ(series->info().fields[0].unit, "m/s");
    EXPECT_EQ(series->info().fields[0].long_name, "velocity");
    for (int step = 0; step < 3; ++step) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, step));
      EXPECT_EQ(volume->info().type, ScalarType::kFloat32);
      const auto world = volume->info().geometry.world_from_index();
      EXPECT_EQ(math::TransformPoint(world, {0, 0, 0}), (math::Vec3d{-3, 30, 5}));
      EXPECT_EQ(math::TransformPoint(world, {3, 2, 1}), (math::Vec3d{3, 10, 9}));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string u, ReadAll(*volume, 2));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string packed, Samples(series.get(), 1, step));
      for (std::size_t i = 0; i < kSamples; ++i) {
        const double stored = 3.0 * static_cast<double>(i) + 100 * step - 20;
        EXPECT_EQ(ValuesOf<float>(u)[i], static_cast<float>(stored));
        const float value = ValuesOf<float>(packed)[i];
        EXPECT_TRUE(stored == -20 ? std::isnan(value)
                                  : value == static_cast<float>(0.5 * stored + 100));
      }
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto still, OpenVolumeFile(path + ":still"));
    // Where nobody wrote an integer, it is missing.
    EXPECT_EQ(still->info().type, ScalarType::kFloat64);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*still, 1));
    for (std::size_t i = 0; i < kSamples; ++i) {
      EXPECT_EQ(ValuesOf<double>(read)[i], static_cast<double>(3 * i) - 20);
    }
    EXPECT_THAT(OpenVolumeFile(path),
                StatusIs(kInvalid, HasSubstr("u [m/s], packed; steps: 3, from 0 to 2 s")));
    EXPECT_THAT(OpenVolumeSeries(path + ":w"), StatusIs(absl::StatusCode::kNotFound));
  }
}

TEST_F(NetcdfSeriesTest, EveryTypeIsReadAsItIs) {
  struct Case {
    nc_type type;
    ScalarType expected;
  };
  for (const Case& c :
       {Case{NC_BYTE, ScalarType::kInt8}, Case{NC_UBYTE, ScalarType::kUint8},
        Case{NC_SHORT, ScalarType::kInt16}, Case{NC_USHORT, ScalarType::kUint16},
        Case{NC_INT, ScalarType::kInt32}, Case{NC_UINT, ScalarType::kUint32},
        Case{NC_FLOAT, ScalarType::kFloat32}, Case{NC_DOUBLE, ScalarType::kFloat64},
        Case{NC_INT64, ScalarType::kFloat64}, Case{NC_UINT64, ScalarType::kFloat64}}) {
    SCOPED_TRACE(c.type);
    std::vector<double> values;
    for (std::size_t i = 0; i < kSamples; ++i) {
      values.push_back(static_cast<double>(i) + 1);
    }
    {
      NetcdfWriter writer(dir_.Sub("a.nc"), NC_NETCDF4);
      writer.LeaveUnfilled();
      const std::vector<int> dims{writer.Dimension("a", 2), writer.Dimension("b", 3),
                                  writer.Dimension("d", 4)};
      writer.Variable("p", c.type, dims, {2, 3, 4}, values, {}, {}, {1, 2, 3});
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(dir_.Sub("a.nc")));
    ASSERT_EQ(volume->info().type, c.expected);
    EXPECT_EQ(volume->info().geometry.sample_dims, (math::Index3{4, 3, 2}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 1));
    volume::VisitScalarType(c.expected, [&]<typename T>() {
      for (std::size_t i = 0; i < kSamples; ++i) {
        EXPECT_EQ(ValuesOf<T>(read)[i], static_cast<T>(values[i]));
      }
    });
  }
}

TEST_F(NetcdfSeriesTest, MissingValuesAreHoles) {
  {
    NetcdfWriter writer(dir_.Sub("a.nc"), 0);
    const std::vector<int> dims{writer.Dimension("a", 2), writer.Dimension("b", 3),
                                writer.Dimension("d", 4)};
    std::vector<double> values = Ramp();
    values[5] = NC_FILL_FLOAT;
    writer.Variable("library", NC_FLOAT, dims, {2, 3, 4}, values);
    std::vector<double> unwritten = Ramp();
    unwritten[5] = NC_FILL_SHORT;
    writer.Variable("unwritten", NC_SHORT, dims, {2, 3, 4}, unwritten);
    writer.Variable("missing", NC_INT, dims, {2, 3, 4}, Ramp(), {}, {{"missing_value", -5}});
    writer.Variable("valid", NC_BYTE, dims, {2, 3, 4}, Ramp(), {},
                    {{"valid_min", -17}, {"valid_max", 40}});
    writer.Variable("bytes", NC_BYTE, dims, {2, 3, 4}, Ramp(), {{"_Unsigned", "true"}});
  }
  const auto read = [&](const std::string& field, ScalarType type) {
    auto volume = OpenVolumeFile(absl::StrCat(dir_.Sub("a.nc"), ":", field));
    EXPECT_TRUE(volume.ok() && (*volume)->info().type == type) << volume.status();
    return volume.ok() ? ReadAll(**volume, 1).value_or("") : "";
  };
  const auto library = ValuesOf<float>(read("library", ScalarType::kFloat32));
  EXPECT_TRUE(std::isnan(library[5]));
  EXPECT_EQ(library[4], -8);
  const auto unwritten = ValuesOf<float>(read("unwritten", ScalarType::kFloat32));
  EXPECT_TRUE(std::isnan(unwritten[5]));
  EXPECT_EQ(unwritten[4], -8);
  const auto missing = ValuesOf<double>(read("missing", ScalarType::kFloat64));
  EXPECT_TRUE(std::isnan(missing[5]));
  EXPECT_EQ(missing[6], -2);
  const auto valid = ValuesOf<float>(read("valid", ScalarType::kFloat32));
  EXPECT_TRUE(std::isnan(valid[0]));
  EXPECT_EQ(valid[1], -17);
  EXPECT_EQ(valid[20], 40);
  EXPECT_TRUE(std::isnan(valid[21]));
  const auto bytes = ValuesOf<std::uint8_t>(read("bytes", ScalarType::kUint8));
  EXPECT_EQ(bytes[0], 236);
}

TEST_F(NetcdfSeriesTest, UnevenLevelsAreResampledIfTheRulesSaySo) {
  {
    NetcdfWriter writer(dir_.Sub("a.nc"), NC_NETCDF4);
    const std::vector<int> dims{writer.Dimension("lev", 3), writer.Dimension("y", 2),
                                writer.Dimension("x", 4)};
    writer.Variable("lev", NC_DOUBLE, {dims[0]}, {3}, {100, 40, 10}, {{"positive", "down"}});
    std::vector<double> values;
    for (const int level : {100, 40, 10}) {
      for (int i = 0; i < 8; ++i) {
        values.push_back(level + 1000 * i);
      }
    }
    values[8] = -99;
    writer.Variable("p", NC_SHORT, dims, {3, 2, 4}, values, {}, {{"_FillValue", -99}});
    writer.Variable("q", NC_SHORT, dims, {3, 2, 4}, values);
  }
  const std::string path = dir_.Sub("a.nc");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto series,
      OpenVolumeSeries(path, {.axes = "", .rules = {.resamples = true, .fill = -99}}));
  for (const int field : {0, 1}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(field, 0, 0));
    EXPECT_EQ(source->info().type, ScalarType::kFloat32);
    EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{4, 2, 4}));
    EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{1, 1, 30}));
    EXPECT_EQ(math::TransformPoint(source->info().geometry.world_from_index(), {0, 0, 3}),
              (math::Vec3d{0, 0, -10}));
    const auto read = ValuesOf<float>(ReadAll(*source, 1).value());
    for (std::size_t z = 0; z < 4; ++z) {
      for (std::size_t i = 1; i < 8; ++i) {
        EXPECT_EQ(read[8 * z + i],
                  static_cast<float>(100 - 30 * static_cast<int>(z) + 1000 * static_cast<int>(i)));
      }
    }
    // The hole at level 40 takes part in 70, but not in 100 and 10.
    EXPECT_EQ(read[0], 100);
    EXPECT_TRUE(std::isnan(read[8]));
    EXPECT_TRUE(std::isnan(read[16]));
    EXPECT_EQ(read[24], 10);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto single,
                                OpenVolumeFile(path + ":q", "", {.resamples = true}));
  EXPECT_THAT(single->info().note, HasSubstr("3 samples, 30 to 60 apart, became 4, 30 apart"));
}

TEST_F(NetcdfSeriesTest, RefusesInASentence) {
  const auto write = [&](std::vector<double> z, const std::vector<double>& time) {
    NetcdfWriter writer(dir_.Sub("a.nc"), 0);
    const std::vector<int> dims{writer.Dimension("time", time.size()),
                                writer.Dimension("lev", z.size()), writer.Dimension("y", 3),
                                writer.Dimension("x", 4)};
    writer.Variable("time", NC_DOUBLE, {dims[0]}, {time.size()}, time);
    writer.Variable("lev", NC_DOUBLE, {dims[1]}, {z.size()}, z);
    writer.Variable("p", NC_BYTE, dims, {time.size(), z.size(), 3, 4},
                    std::vector<double>(time.size() * z.size() * 12, 1));
  };
  write({1000, 850, 500, 300}, {0, 1});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir_.Sub("a.nc")));
  EXPECT_THAT(series->Open(0, 0, 0),
              StatusIs(kInvalid, AllOf(HasSubstr("a.nc:p"), HasSubstr("\"lev\" is not even"),
                                       HasSubstr("--resample"))));
  write({1, 2, 3}, {1, 0});
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("a.nc")),
              StatusIs(kInvalid, AllOf(HasSubstr("a.nc"), HasSubstr("time axis"))));
  write({1}, {0, 1});
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("a.nc")),
              StatusIs(kInvalid, AllOf(HasSubstr("a.nc:p"), HasSubstr("lev (Z, 1)"),
                                       HasSubstr("expected one Z"))));
  testing::WriteFile(dir_.Sub("a.nc"), "CDF\x01 and no more");
  EXPECT_THAT(OpenVolumeSeries(dir_.Sub("a.nc")), StatusIs(kInvalid, HasSubstr("netCDF")));
}

// CF 5: a variable names coordinates whose names are not those of dimensions.
TEST_F(NetcdfSeriesTest, CoordinatesThatAVariableNamesPlaceItOrAreRefused) {
  const std::string path = dir_.Sub("c.nc");
  {
    NetcdfWriter writer(path, 0);
    const int z = writer.Dimension("k", 2);
    const int y = writer.Dimension("y", 3);
    const int x = writer.Dimension("x", 4);
    writer.Variable("depth", NC_DOUBLE, {z}, {2}, {2, 7}, {{"units", "m"}, {"positive", "down"}});
    writer.Variable("y", NC_DOUBLE, {y}, {3}, {0, 1, 2}, {{"units", "m"}});
    writer.Variable("x", NC_DOUBLE, {x}, {4}, {0, 1, 2, 3}, {{"units", "m"}});
    writer.Variable("high", NC_DOUBLE, {z, y, x}, {2, 3, 4}, Ramp(),
                    {{"units", "m"}, {"standard_name", "altitude"}});
    writer.Variable("t", NC_FLOAT, {z, y, x}, {2, 3, 4}, Ramp(), {{"coordinates", "depth"}});
    writer.Variable("u", NC_FLOAT, {z, y, x}, {2, 3, 4}, Ramp(), {{"coordinates", "high"}});
    writer.Variable("half", NC_FLOAT, {z, y, x}, {2, 3, 4}, Ramp());
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path + ":t"));
  ASSERT_EQ(series->info().fields.size(), 1u) << "others have other coordinates";
  EXPECT_EQ(series->info().length_unit, "m");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
  const auto world = volume->info().geometry.world_from_index();
  EXPECT_EQ(math::TransformPoint(world, {0, 0, 0}), (math::Vec3d{0, 0, -2}));
  EXPECT_EQ(math::TransformPoint(world, {3, 2, 1}), (math::Vec3d{3, 2, -7}));
  EXPECT_THAT(OpenVolumeFile(path + ":u"),
              StatusIs(kInvalid, AllOf(HasSubstr("c.nc:u"), HasSubstr("\"high\" depend on 3 axes"),
                                       HasSubstr("--spacing X,Y,Z"))));
  EXPECT_THAT(OpenVolumeFile(path + ":half"),
              StatusIs(kInvalid, AllOf(HasSubstr("c.nc:half"), HasSubstr("\"k\" has none"),
                                       HasSubstr("--spacing X,Y,Z"))));
  for (const char* name : {":u", ":half"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto indexed,
                                  OpenVolumeFile(path + name, "", {.has_spacing = true}));
    EXPECT_EQ(indexed->info().geometry.spacing.z, 1) << name;
  }
}

TEST_F(NetcdfSeriesTest, FieldOnAnotherGridIsNamedWithThePathThatOpensIt) {
  const std::string path = dir_.Sub("g.nc");
  {
    NetcdfWriter writer(path, 0);
    const std::vector<int> dims{writer.Dimension("z", 2), writer.Dimension("y", 3),
                                writer.Dimension("x", 4)};
    const int other = writer.Dimension("x2", 4);
    writer.Variable("a", NC_FLOAT, dims, {2, 3, 4}, Ramp());
    writer.Variable("c", NC_FLOAT, dims, {2, 3, 4}, Ramp());
    writer.Variable("b", NC_FLOAT, {dims[0], dims[1], other}, {2, 3, 4}, Ramp());
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto series, OpenVolumeSeries(path));
  EXPECT_EQ(series->info().fields.size(), 2u);
  EXPECT_THAT(series->info().fields_elsewhere, ElementsAre("b"));
  EXPECT_THAT(SelectFrom(std::move(series), {.fields = {"b"}}),
              StatusIs(kInvalid, AllOf(HasSubstr("no field \"b\""),
                                       HasSubstr("another grid: open " + path + ":b"))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto named, OpenVolumeSeries(path + ":b"));
  EXPECT_EQ(named->info().fields[0].name, "b");
}

TEST_F(NetcdfSeriesTest, DimensionsWithoutMeaningAreNamedAndAxesGivesIt) {
  const std::string path = dir_.Sub("b.nc");
  {
    NetcdfWriter writer(path, 0);
    const int run = writer.Dimension("run", 3);
    const int z = writer.Dimension("lev", 2);
    const int y = writer.Dimension("lat", 3);
    const int x = writer.Dimension("lon", 4);
    writer.Variable("lev", NC_FLOAT, {z}, {2}, {1000, 500}, {{"units", "hPa"}});
    writer.Variable("still", NC_BYTE, {z, y, x}, {2, 3, 4}, Ramp());
    writer.Variable("u", NC_FLOAT, {run, z, y, x}, {3, 2, 3, 4}, Ramp(3));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto others, OpenVolumeSeries(path));
  EXPECT_EQ(others->info().fields[0].name, "still");
  EXPECT_THAT(
      OpenVolumeSeries(path + ":u"),
      StatusIs(kInvalid,
               AllOf(HasSubstr(path + ":u"), HasSubstr("run (?, 3)"), HasSubstr("lev (Z, 2)"),
                     HasSubstr("isoscope partition " + path + ":u --axes CZYX --output DIR"))));
  for (const char* axes : {"TZYX", "CZYX"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path + ":u", {.axes = axes}));
    ASSERT_EQ(series->info().fields.size(), 1u);
    const bool has_time = axes[0] == 'T';
    EXPECT_EQ(series->info().step_count(), has_time ? 3 : 1);
    // Three runs are no vector.
    EXPECT_EQ(series->info().fields[0].components,
              has_time ? std::vector<std::string>{""} : std::vector<std::string>({"0", "1", "2"}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume,
                                  series->Open(0, has_time ? 0 : 2, has_time ? 2 : 0));
    EXPECT_EQ(math::TransformPoint(volume->info().geometry.world_from_index(), {0, 0, 1}),
              (math::Vec3d{0, 0, -500}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 1));
    EXPECT_EQ(ValuesOf<float>(read)[5], 3 * 5 + 200 - 20);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto turned, OpenVolumeSeries(path, {.axes = "XYZ"}));
  EXPECT_EQ(turned->info().fields[0].name, "still");
  EXPECT_THAT(OpenVolumeSeries(path + ":u", {.axes = "ZYX"}),
              StatusIs(kInvalid, AllOf(HasSubstr(":u"), HasSubstr("run (?, 3)"))));
  EXPECT_THAT(OpenVolumeSeries(path, {.axes = "TCZYX"}),
              StatusIs(kInvalid, HasSubstr("no variable has such axes")));
  EXPECT_THAT(OpenVolumeSeries(path, {.axes = "Z2YX"}), StatusIs(kInvalid, HasSubstr("Z2YX")));
}

TEST_F(NetcdfSeriesTest, CutFilesAreErrorsOrShortOfNothing) {
  for (const int mode : {0, NC_NETCDF4}) {
    const std::string whole = testing::ReadFile(WriteRun(mode));
    for (std::size_t size = 0; size < whole.size(); size += whole.size() / 13) {
      testing::WriteFile(dir_.Sub("cut.nc"), whole.substr(0, size));
      const auto series = OpenVolumeSeries(dir_.Sub("cut.nc"));
      if (series.ok()) {
        EXPECT_FALSE(Samples(series->get(), 0, 2).ok()) << mode << " " << size;
      }
    }
  }
}

}  // namespace
}  // namespace isoscope::source
