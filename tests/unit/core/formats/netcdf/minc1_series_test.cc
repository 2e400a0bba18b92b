// MINC 1 files that the netCDF library writes: corners, real values slice by slice and step by
// step, and what is refused.

#include "core/formats/netcdf/minc1_series.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
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
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr std::size_t kSamples = 24;  // 2 x 3 x 4

struct Minc1 {
  std::vector<std::string> axes{"zspace", "yspace", "xspace"};  // of 2, 3 and 4 samples
  std::size_t steps = 0;                                        // 0: no axis of time
  nc_type type = NC_SHORT;
  std::string sign = "signed__";
  std::vector<double> valid{0, 1000};
  std::vector<std::string> limits{"zspace"};  // the axes of image-min and image-max
  std::vector<double> least{-1, -3};
  std::vector<double> most{1, 5};
  std::string spacing = "regular__";
  bool has_limits = true;
  std::vector<double> cosines{0, 1, 0};  // of xspace
  // Of xspace, in place of the numbers below.
  std::optional<double> step = std::nullopt;
  std::optional<double> start = std::nullopt;
  std::string unit_of_z = "mm";
};

class Minc1SeriesTest : public ::testing::Test {
 protected:
  // Sample i is `first` + 40 * i, or the most that the type holds.
  std::string Write(const Minc1& minc, double first = 0) {
    NetcdfWriter writer(path_, 0);
    std::vector<std::pair<std::string, int>> dimensions;
    std::vector<std::size_t> count;
    if (minc.steps > 0) {
      dimensions.emplace_back("time", writer.Dimension("time", minc.steps));
      count.push_back(minc.steps);
    }
    for (std::size_t i = 0; i < minc.axes.size(); ++i) {
      dimensions.emplace_back(minc.axes[i], writer.Dimension(minc.axes[i], 2 + i));
      count.push_back(2 + i);
    }
    if (minc.steps > 0) {
      writer.Variable("time", NC_DOUBLE, {dimensions[0].second}, {minc.steps},
                      std::vector<double>(minc.steps, 0), {{"units", "s"}},
                      {{"start", 0.5}, {"step", 2}});
    }
    for (std::size_t i = 0; i < minc.axes.size(); ++i) {
      writer.Variable(
          minc.axes[i], NC_INT, {}, {}, {0},
          {{"spacing", minc.spacing}, {"units", minc.axes[i] == "zspace" ? minc.unit_of_z : "mm"}});
      writer.Attribute(minc.axes[i], "start", {10.0 * static_cast<double>(1 + i)});
      writer.Attribute(minc.axes[i], "step", {i == 1 ? -2.0 : 1.5});
    }
    // x runs along world y, y against world x.
    writer.Attribute("xspace", "direction_cosines", minc.cosines);
    for (const auto& [name, number] : {std::pair{"step", minc.step}, {"start", minc.start}}) {
      if (number.has_value()) {
        writer.Attribute("xspace", name, {*number});
      }
    }
    writer.Attribute("yspace", "direction_cosines", {-1, 0, 0});
    std::vector<int> all;
    std::vector<int> of_limits;
    std::vector<std::size_t> limit_count;
    for (std::size_t i = 0; i < dimensions.size(); ++i) {
      all.push_back(dimensions[i].second);
      for (const std::string& name : minc.limits) {
        if (name == dimensions[i].first) {
          of_limits.push_back(dimensions[i].second);
          limit_count.push_back(count[i]);
        }
      }
    }
    const double most = minc.type == NC_BYTE ? 127 : 1e6;
    std::size_t sample_count = 1;
    for (const std::size_t size : count) {
      sample_count *= size;
    }
    std::vector<double> samples;
    for (std::size_t i = 0; i < sample_count; ++i) {
      samples.push_back(std::min(first + 40.0 * static_cast<double>(i), most));
    }
    writer.Variable("image", minc.type, all, count, samples, {{"signtype", minc.sign}});
    if (!minc.valid.empty()) {
      writer.Attribute("image", "valid_range", minc.valid);
    }
    if (minc.has_limits) {
      writer.Variable("image-min", NC_DOUBLE, of_limits, limit_count, minc.least);
      writer.Variable("image-max", NC_DOUBLE, of_limits, limit_count, minc.most);
    }
    return path_;
  }

  const testing::TempDir dir_;
  const std::string path_ = dir_.Sub("a.mnc");
};

TEST_F(Minc1SeriesTest, CornersAndRealValuesSliceBySlice) {
  Write({});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path_));
  ASSERT_EQ(series->info().fields.size(), 1u);
  EXPECT_EQ(series->info().fields[0].name, "a");
  EXPECT_EQ(series->info().length_unit, "mm");
  EXPECT_EQ(series->info().step_count(), 1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path_));
  EXPECT_EQ(volume->info().geometry.sample_dims, (math::Index3{4, 3, 2}));
  EXPECT_TRUE(volume->info().patient_frame.has_value());
  // RAS: x 30 + 1.5 i along y, y 20 - 2 j along -x, z 10 + 1.5 k. LPS turns the first two around.
  const math::Mat4d to_world = volume->info().geometry.world_from_index();
  EXPECT_LT(math::Length(math::TransformPoint(to_world, {0, 0, 0}) - math::Vec3d{20, -30, 10}),
            1e-9);
  EXPECT_LT(math::Length(math::TransformPoint(to_world, {3, 2, 1}) - math::Vec3d{16, -34.5, 11.5}),
            1e-9);
  ASSERT_EQ(volume->info().type, ScalarType::kFloat32);
  for (const std::int64_t planes : {1, 2}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*volume, planes));
    const auto values = ValuesOf<float>(bytes);
    for (std::size_t i = 0; i < kSamples; ++i) {
      const double part = 40.0 * static_cast<double>(i) / 1000;
      EXPECT_FLOAT_EQ(values[i], static_cast<float>(i < 12 ? -1 + 2 * part : -3 + 8 * part)) << i;
    }
  }
  // Rows that begin and end within slices.
  std::string rows(4 * 4 * sizeof(float), '\0');
  ISOSCOPE_ASSERT_OK(volume->ReadRows(1, 5, rows.data()));
  EXPECT_FLOAT_EQ(ValuesOf<float>(rows)[0], -1 + 2 * 0.16F);
  EXPECT_FLOAT_EQ(ValuesOf<float>(rows)[15], -3 + 8 * 0.76F);
}

TEST_F(Minc1SeriesTest, TheOrderOfAxesIsThatOfTheFile) {
  Write({.axes = {"xspace", "zspace", "yspace"}, .limits = {"xspace"}});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path_));
  EXPECT_EQ(volume->info().geometry.sample_dims, (math::Index3{4, 3, 2}));
  const math::Mat4d to_world = volume->info().geometry.world_from_index();
  // The fastest is y: 30 + 1.5 i against x; then z: 20 - 2 j; the slowest is x: 10 + 1.5 k along y.
  EXPECT_LT(math::Length(math::TransformPoint(to_world, {0, 0, 0}) - math::Vec3d{30, -10, 20}),
            1e-9);
  EXPECT_LT(math::Length(math::TransformPoint(to_world, {3, 2, 1}) - math::Vec3d{34.5, -11.5, 16}),
            1e-9);
}

TEST_F(Minc1SeriesTest, TimeMakesSteps) {
  Write({.steps = 3,
         .limits = {"time", "zspace"},
         .least = {0, 0, 10, 10, 20, 20},
         .most = {1000, 1000, 1010, 2010, 1020, 1020}});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path_));
  EXPECT_THAT(series->info().times, ElementsAre(0.5, 2.5, 4.5));
  EXPECT_EQ(series->info().time_unit, "s");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto step, series->Open(0, 0, 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*step, 1));
  EXPECT_FLOAT_EQ(ValuesOf<float>(bytes)[0], 10 + 960);
  EXPECT_FLOAT_EQ(ValuesOf<float>(bytes)[12], 10 + 2 * 1440);
}

TEST_F(Minc1SeriesTest, SamplesWithoutAScaleKeepTheirType) {
  Write({.limits = {}, .least = {0}, .most = {1000}});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto shorts, OpenVolumeFile(path_));
  ASSERT_EQ(shorts->info().type, ScalarType::kInt16);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(std::string bytes, ReadAll(*shorts, 2));
  EXPECT_EQ(ValuesOf<std::int16_t>(bytes)[23], 920);
  Write({.type = NC_FLOAT, .valid = {}});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto floats, OpenVolumeFile(path_));
  ASSERT_EQ(floats->info().type, ScalarType::kFloat32);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(bytes, ReadAll(*floats, 2));
  EXPECT_EQ(ValuesOf<float>(bytes)[23], 920);
}

TEST_F(Minc1SeriesTest, TheSignAndTheRangeOfTypesAreMincs) {
  struct Case {
    nc_type type;
    std::string sign;
    std::vector<double> valid;
    double first;    // the sample
    double real;     // its real value, from 0 to 1
    double to_real;  // of one unit
  };
  const Case cases[] = {
      {NC_BYTE, "", {}, -128, 128 / 255.0, 1 / 255.0},  // unsigned: 128
      {NC_BYTE, "signed__", {}, -128, 0, 1 / 255.0},    //
      {NC_SHORT, "", {}, -32768, 0, 1 / 65535.0},       //
      {NC_SHORT, "unsigned", {}, -32768, 32768 / 65535.0, 1 / 65535.0},
      {NC_INT, "", {}, -2147483648.0, 0, 1 / 4294967295.0},     //
      {NC_SHORT, "unsigned", {0, -1}, 0, 0, 1 / 65535.0},       // -1 has the bits of 65535
      {NC_SHORT, "signed__", {100, -100}, -100, 0, 1 / 200.0},  // turned around
  };
  for (const Case& c : cases) {
    Minc1 minc{
        .type = c.type, .sign = c.sign, .valid = c.valid, .limits = {}, .least = {0}, .most = {1}};
    Write(minc, c.first);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path_));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*volume, 1));
    const bool is_wide = c.type == NC_INT;
    ASSERT_EQ(volume->info().type, is_wide ? ScalarType::kFloat64 : ScalarType::kFloat32);
    const auto value = [&](std::size_t i) {
      return is_wide ? ValuesOf<double>(bytes)[i] : static_cast<double>(ValuesOf<float>(bytes)[i]);
    };
    EXPECT_NEAR(value(0), c.real, 1e-7) << c.type << c.sign;
    EXPECT_NEAR(value(1) - value(0), 40 * c.to_real, 1e-7) << c.type << c.sign;
  }
}

TEST_F(Minc1SeriesTest, WithoutLimitsRealValuesGoFromZeroToOne) {
  Write({.has_limits = false});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path_));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*volume, 1));
  EXPECT_FLOAT_EQ(ValuesOf<float>(bytes)[23], 0.92F);
}

TEST_F(Minc1SeriesTest, AnEmptyRangeMeansTheLeastValue) {
  Write({.valid = {7, 7}});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path_));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*volume, 1));
  const auto values = ValuesOf<float>(bytes);
  EXPECT_THAT(std::vector<float>(values.begin(), values.begin() + 12), Each(-1));
}

TEST_F(Minc1SeriesTest, WhatIsNoVolumeIsRefusedWithASentence) {
  const auto error = [&] { return OpenVolumeFile(path_).status(); };
  Write({.spacing = "irregular"});
  EXPECT_THAT(error(), StatusIs(kInvalid, HasSubstr("zspace lie at uneven distances")));
  Write({.limits = {"yspace"}, .least = {0, 0, 0}, .most = {1, 1, 1}});
  EXPECT_THAT(error(), StatusIs(kInvalid, HasSubstr("image-min varies along yspace")));
  Write({.axes = {"zspace", "yspace", "xspace", "vector_dimension"}, .has_limits = false});
  EXPECT_THAT(error(), StatusIs(kInvalid, HasSubstr("xspace, vector_dimension\"; expected")));
  {
    NetcdfWriter writer(path_, 0);
    const std::vector<int> dims{writer.Dimension("z", 2), writer.Dimension("y", 3),
                                writer.Dimension("x", 4)};
    writer.Variable("p", NC_SHORT, dims, {2, 3, 4}, std::vector<double>(24, 7));
  }
  EXPECT_THAT(error(), StatusIs(kInvalid, HasSubstr("no variable \"image\"")));
  const std::string whole = testing::ReadFile(Write({}));
  testing::WriteFile(path_, whole.substr(0, whole.size() - 60));
  EXPECT_THAT(error(), StatusIs(kInvalid, HasSubstr("it is cut")));
}

// The library reads them in a child: whatever it does, this process gets a status or values.
TEST_F(Minc1SeriesTest, HostileBytesAreErrorsOrValues) {
  const std::string whole = testing::ReadFile(Write(
      {.steps = 2, .limits = {"time", "zspace"}, .least = {0, 0, 0, 0}, .most = {1, 1, 2, 2}}));
  std::mt19937 random(20261126);
  int refused = 0;
  for (int i = 0; i < 60; ++i) {
    std::string bytes = whole;
    for (int flips = 1 + i % 4; flips > 0; --flips) {
      const std::size_t at = random() % (bytes.size() - 4) / 4 * 4;  // a number of the header
      const std::uint32_t number = i % 2 == 0 ? 0xffffff7fU : static_cast<std::uint32_t>(random());
      bytes.replace(at, 4, BytesOf(std::vector<std::uint32_t>{number}));
    }
    testing::WriteFile(path_, bytes);
    const auto series = OpenVolumeSeries(path_);
    absl::Status status = series.status();
    if (series.ok()) {
      const auto volume = (*series)->Open(0, 0, (*series)->info().step_count() - 1);
      const bool is_small =
          volume.ok() && math::Volume((*volume)->info().geometry.sample_dims) < 1 << 20;
      status = !volume.ok() ? volume.status()
               : is_small   ? ReadAll(**volume, 1).status()
                            : absl::OkStatus();
    }
    EXPECT_NE(status.code(), absl::StatusCode::kInternal) << i << ": " << status;
    if (!status.ok()) {
      ++refused;
      EXPECT_THAT(status.message(), HasSubstr("a.mnc")) << i;
    }
  }
  EXPECT_GT(refused, 3) << "the bytes that count were hit";
}

TEST_F(Minc1SeriesTest, NumbersThatAreNoneAreRefusedByName) {
  EXPECT_THAT(OpenMinc1Series(Write({.step = 0}), "f"),
              StatusIs(kInvalid, HasSubstr("MINC 1: the step of xspace is 0")));
  EXPECT_THAT(OpenMinc1Series(Write({.step = std::nan("")}), "f"),
              StatusIs(kInvalid, HasSubstr("the step of xspace is nan")));
  EXPECT_THAT(OpenMinc1Series(Write({.start = std::nan("")}), "f"),
              StatusIs(kInvalid, HasSubstr("the start of xspace is nan")));
  EXPECT_THAT(OpenMinc1Series(Write({.valid = {std::nan(""), 9}}), "f"),
              StatusIs(kInvalid, HasSubstr("valid_range has nan at index 0")));
  EXPECT_THAT(OpenMinc1Series(Write({.most = {1, std::nan("")}}), "f"),
              StatusIs(kInvalid, HasSubstr("image-max has nan at index 1")));
}

TEST_F(Minc1SeriesTest, CosinesAreAVectorOfLengthOneAndUnitsOneLength) {
  for (const std::vector<double>& bad :
       {std::vector<double>{0, 1}, {0, 2, 0}, {0, 0, 0}, {0, std::nan(""), 0}, {0, 1, 0, 0}}) {
    EXPECT_THAT(OpenMinc1Series(Write({.cosines = bad}), "f"),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("direction_cosines")))
        << bad.size() << " " << bad[1];
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto rounded,
                                OpenMinc1Series(Write({.cosines = {0, 1.0005, 0}}), "f"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto plain, OpenMinc1Series(Write({}), "f"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto one, plain->Open(0, 0, 0));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto mixed, OpenMinc1Series(Write({.unit_of_z = "cm"}), "f"));
  EXPECT_EQ(mixed->info().length_unit, "cm");  // of the slowest axis
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto other, mixed->Open(0, 0, 0));
  EXPECT_NEAR(other->info().geometry.spacing.x, one->info().geometry.spacing.x / 10, 1e-12);
  EXPECT_NEAR(other->info().geometry.spacing.z, one->info().geometry.spacing.z, 1e-12);
  EXPECT_THAT(OpenMinc1Series(Write({.unit_of_z = "s"}), "f"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("\"s\"")));
}

}  // namespace
}  // namespace isoscope::source
