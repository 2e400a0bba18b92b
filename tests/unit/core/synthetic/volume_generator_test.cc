// Each field is compared with its formula, in doubles:
//
// - values, range and quantisation for every sample type;
// - the same bytes for any division into calls, and beyond 32-bit indices;
// - seeds, and the variance of random fields for every spectrum;
// - bad parameters, with the message.

#include "core/synthetic/volume_generator.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr double kPi = std::numbers::pi;
constexpr GeneratedField kAllFields[] = {GeneratedField::kRandom,        GeneratedField::kGyroid,
                                         GeneratedField::kMarschnerLobb, GeneratedField::kShells,
                                         GeneratedField::kMixing,        GeneratedField::kLabels};

template <typename T>
std::vector<T> Generate(const GeneratorParameters& parameters, const math::Index3& dims,
                        ScalarType type) {
  const auto generator = VolumeGenerator::Make(parameters, dims, type);
  EXPECT_THAT(generator.status(), testing::IsOk());
  std::vector<T> samples(static_cast<std::size_t>(math::Volume(dims)));
  (*generator)->FillRows(0, (*generator)->row_count(), reinterpret_cast<char*>(samples.data()));
  return samples;
}

// Calls visit(sample, p) for each sample and its coordinates.
template <typename T, typename Visit>
void ForEachSample(const std::vector<T>& samples, const math::Index3& dims, const Visit& visit) {
  const auto longest = static_cast<double>(std::max({dims.x, dims.y, dims.z}) - 1);
  std::size_t i = 0;
  for (std::int64_t z = 0; z < dims.z; ++z) {
    for (std::int64_t y = 0; y < dims.y; ++y) {
      for (std::int64_t x = 0; x < dims.x; ++x, ++i) {
        visit(samples[i], math::Vec3d{static_cast<double>(2 * x - dims.x + 1) / longest,
                                      static_cast<double>(2 * y - dims.y + 1) / longest,
                                      static_cast<double>(2 * z - dims.z + 1) / longest});
      }
    }
  }
}

// The sum of waves by its definition, one cosine a wave.
double RandomSum(const GeneratorParameters& parameters, const math::Vec3d& p) {
  double sum = 0;
  double squares = 0;
  for (int w = 0; w < parameters.wave_count; ++w) {
    const auto random = [&](std::uint64_t n) {
      return base::RandomUnit(parameters.seed, 4 * static_cast<std::uint64_t>(w) + n);
    };
    const double z = 2 * random(0) - 1;
    const double azimuth = 2 * kPi * random(1);
    const double number =
        2 * std::pow(parameters.max_wave_number / 2, (w + random(2)) / parameters.wave_count);
    const double amplitude = std::pow(number, (1 - parameters.spectrum_exponent) / 2);
    const double in_plane = std::sqrt(1 - z * z);
    const double along =
        in_plane * std::cos(azimuth) * p.x + in_plane * std::sin(azimuth) * p.y + z * p.z;
    sum += amplitude * std::cos(kPi * number * along + 2 * kPi * random(3));
    squares += amplitude * amplitude / 2;
  }
  return sum / std::sqrt(squares);
}

TEST(VolumeGeneratorTest, FieldsAreTheirFormulas) {
  const math::Index3 dims{37, 21, 30};
  GeneratorParameters parameters;
  const auto expect = [&](GeneratedField field, auto formula) {
    parameters.field = field;
    double worst = 0;
    ForEachSample(Generate<float>(parameters, dims, ScalarType::kFloat32), dims,
                  [&](float sample, const math::Vec3d& p) {
                    const double expected = std::clamp(formula(p), 0.0, 1.0);
                    worst = std::max(worst, std::abs(static_cast<double>(sample) - expected));
                  });
    EXPECT_LT(worst, 2e-5) << static_cast<int>(field);
  };
  expect(GeneratedField::kRandom,
         [&](const math::Vec3d& p) { return 0.5 + RandomSum(parameters, p) / 7; });
  expect(GeneratedField::kGyroid, [&](const math::Vec3d& p) {
    const double a = kPi * parameters.periods;
    return 0.5 + (std::sin(a * p.x) * std::cos(a * p.y) + std::sin(a * p.y) * std::cos(a * p.z) +
                  std::sin(a * p.z) * std::cos(a * p.x)) /
                     3;
  });
  expect(GeneratedField::kMarschnerLobb, [&](const math::Vec3d& p) {
    const double r = std::sqrt(p.x * p.x + p.y * p.y);
    const double rho = std::cos(2 * kPi * 6 * std::cos(kPi * r / 2));
    return (1 - std::sin(kPi * p.z / 2) + 0.25 * (1 + rho)) / 2.5;
  });
  expect(GeneratedField::kShells, [&](const math::Vec3d& p) {
    const double r = math::Length(p);
    return r >= 1 ? 0 : 0.5 - 0.5 * std::cos(2 * kPi * 8 * r);
  });
  expect(GeneratedField::kMixing, [&](const math::Vec3d& p) {
    const double stir = std::exp(-p.z * p.z / 0.16);
    const double height = p.z + (stir < 1e-4 ? 0 : 0.2 * stir * RandomSum(parameters, p));
    const double t = std::clamp(0.5 + height / 0.12, 0.0, 1.0);
    return t * t * (3 - 2 * t);
  });
}

TEST(VolumeGeneratorTest, BytesDoNotDependOnHowRowsAreAskedFor) {
  const math::Index3 dims{300, 7, 5};  // more than one run of samples, rows that cross planes
  for (const GeneratedField field : kAllFields) {
    const GeneratorParameters parameters{.field = field};
    const auto whole = Generate<std::uint16_t>(parameters, dims, ScalarType::kUint16);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto generator,
                                  VolumeGenerator::Make(parameters, dims, ScalarType::kUint16));
    for (const std::int64_t step : {1, 2, 3, 5, 8}) {
      std::vector<std::uint16_t> parts(whole.size());
      for (std::int64_t row = 0; row < generator->row_count(); row += step) {
        generator->FillRows(row, std::min(row + step, generator->row_count()),
                            reinterpret_cast<char*>(parts.data() + row * dims.x));
      }
      EXPECT_TRUE(parts == whole) << static_cast<int>(field) << " by " << step;
    }
  }
}

template <typename T>
void ExpectScaled(const std::vector<float>& values, ScalarType type) {
  const auto samples = Generate<T>({.field = GeneratedField::kShells}, {16, 16, 16}, type);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto value = static_cast<double>(values[i]);
    if constexpr (std::is_floating_point_v<T>) {
      EXPECT_EQ(static_cast<double>(samples[i]), value);
    } else {
      const auto lowest = static_cast<double>(std::numeric_limits<T>::lowest());
      const double range = static_cast<double>(std::numeric_limits<T>::max()) - lowest;
      EXPECT_NEAR(static_cast<double>(samples[i]), lowest + value * range,
                  sizeof(T) == 4 ? 1 : 0.51);
    }
  }
}

TEST(VolumeGeneratorTest, ValuesFillTheRangeOfEveryType) {
  const auto values =
      Generate<float>({.field = GeneratedField::kShells}, {16, 16, 16}, ScalarType::kFloat32);
  EXPECT_EQ(*std::min_element(values.begin(), values.end()), 0.0F);
  EXPECT_GT(*std::max_element(values.begin(), values.end()), 0.95F);
  ExpectScaled<std::uint8_t>(values, ScalarType::kUint8);
  ExpectScaled<std::int8_t>(values, ScalarType::kInt8);
  ExpectScaled<std::uint16_t>(values, ScalarType::kUint16);
  ExpectScaled<std::int16_t>(values, ScalarType::kInt16);
  ExpectScaled<std::uint32_t>(values, ScalarType::kUint32);
  ExpectScaled<std::int32_t>(values, ScalarType::kInt32);
  ExpectScaled<float>(values, ScalarType::kFloat32);
  ExpectScaled<double>(values, ScalarType::kFloat64);
}

TEST(VolumeGeneratorTest, BothEndsOfTheRangeAreReachedExactlyWhereTheFieldIsClamped) {
  // Above and below the stirred layer one fluid each: 0 and 1.
  const GeneratorParameters parameters{.field = GeneratedField::kMixing};
  const auto bytes = Generate<std::int8_t>(parameters, {9, 9, 41}, ScalarType::kInt8);
  EXPECT_EQ(bytes.front(), -128);
  EXPECT_EQ(bytes.back(), 127);
  const auto words = Generate<std::uint32_t>(parameters, {9, 9, 41}, ScalarType::kUint32);
  EXPECT_EQ(words.front(), 0u);
  EXPECT_EQ(words.back(), 0xffffffffu);
  const auto integers = Generate<std::int32_t>(parameters, {9, 9, 41}, ScalarType::kInt32);
  EXPECT_EQ(integers.front(), std::numeric_limits<std::int32_t>::lowest());
  EXPECT_EQ(integers.back(), std::numeric_limits<std::int32_t>::max());
}

template <typename T>
void ExpectLabels(ScalarType type) {
  const GeneratedRegions regions(3, 5);
  const math::Index3 dims{19, 24, 15};
  const GeneratorParameters parameters{
      .field = GeneratedField::kLabels, .seed = 3, .region_count = 5};
  std::set<int> found;
  ForEachSample(Generate<T>(parameters, dims, type), dims, [&](T sample, const math::Vec3d& p) {
    ASSERT_EQ(sample, static_cast<T>(regions.At(p)));
    found.insert(static_cast<int>(sample));
  });
  EXPECT_THAT(found, ::testing::ElementsAre(0, 1, 2, 3, 4, 5));
}

TEST(VolumeGeneratorTest, LabelsAreTheSameNumbersInEveryType) {
  ExpectLabels<std::uint8_t>(ScalarType::kUint8);
  ExpectLabels<std::int8_t>(ScalarType::kInt8);
  ExpectLabels<std::uint16_t>(ScalarType::kUint16);
  ExpectLabels<std::int32_t>(ScalarType::kInt32);
  ExpectLabels<float>(ScalarType::kFloat32);
  ExpectLabels<double>(ScalarType::kFloat64);
  for (const GeneratedField field : kAllFields) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto generator,
        VolumeGenerator::Make({.field = field}, {4, 4, 4}, ScalarType::kUint8));
    EXPECT_EQ(generator->labels().size(), field == GeneratedField::kLabels ? 12u : 0u);
  }
}

TEST(VolumeGeneratorTest, SeedChangesFieldsWithChanceAndNoOthers) {
  const math::Index3 dims{24, 24, 24};
  for (const GeneratedField field : kAllFields) {
    const bool has_chance = field == GeneratedField::kRandom || field == GeneratedField::kMixing ||
                            field == GeneratedField::kLabels;
    const auto first = Generate<float>({.field = field, .seed = 1}, dims, ScalarType::kFloat32);
    const auto again = Generate<float>({.field = field, .seed = 1}, dims, ScalarType::kFloat32);
    const auto other = Generate<float>({.field = field, .seed = 2}, dims, ScalarType::kFloat32);
    EXPECT_TRUE(first == again);
    EXPECT_EQ(first == other, !has_chance) << static_cast<int>(field);
  }
}

TEST(VolumeGeneratorTest, RandomFieldHasUnitVarianceForEverySpectrum) {
  for (const double exponent : {0.0, 5.0 / 3, 3.0}) {
    GeneratorParameters parameters;
    parameters.spectrum_exponent = exponent;
    parameters.wave_count = 300;
    parameters.max_wave_number = 12;
    const auto values = Generate<float>(parameters, {48, 48, 48}, ScalarType::kFloat32);
    double sum = 0;
    double squares = 0;
    for (const float value : values) {
      const double g = (static_cast<double>(value) - 0.5) * 7;
      sum += g;
      squares += g * g;
    }
    const auto count = static_cast<double>(values.size());
    EXPECT_NEAR(sum / count, 0, 0.35) << exponent;
    EXPECT_NEAR(squares / count, 1, 0.35) << exponent;
  }
}

TEST(VolumeGeneratorTest, SamplesFarBeyond32BitIndicesAreThoseOfASmallVolumeThere) {
  // 2^40 rows' worth of volume, of which four rows are made: no index may wrap.
  const math::Index3 dims{16, 1 << 15, 1 << 20};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto generator,
      VolumeGenerator::Make({.field = GeneratedField::kGyroid, .periods = 1e6}, dims,
                            ScalarType::kFloat32));
  const std::int64_t row = generator->row_count() - 3;
  std::vector<float> samples(3 * 16);
  generator->FillRows(row, row + 3, reinterpret_cast<char*>(samples.data()));
  const auto longest = static_cast<double>(dims.z - 1);
  const double a = kPi * 1e6;
  const double z = a;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const double x = a * static_cast<double>(2 * static_cast<int>(i % 16) - 15) / longest;
    const double y =
        a * static_cast<double>(2 * (dims.y - 3 + static_cast<int>(i / 16)) - dims.y + 1) / longest;
    const double g =
        std::sin(x) * std::cos(y) + std::sin(y) * std::cos(z) + std::sin(z) * std::cos(x);
    EXPECT_NEAR(static_cast<double>(samples[i]), 0.5 + g / 3, 1e-5);
  }
}

TEST(VolumeGeneratorTest, BadParametersSayWhatIsAllowed) {
  const auto expect = [](auto change, const char* what) {
    GeneratorParameters parameters;
    math::Index3 dims{4, 4, 4};
    change(&parameters, &dims);
    EXPECT_THAT(VolumeGenerator::Make(parameters, dims, ScalarType::kUint8).status(),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  expect([](auto* p, auto*) { p->wave_count = 0; }, "0 waves: expected 1 to 4096");
  expect([](auto* p, auto*) { p->wave_count = 5000; }, "5000 waves");
  expect([](auto* p, auto*) { p->max_wave_number = 1; }, "wave number 1: expected 2 or more");
  expect([](auto* p, auto*) { p->max_wave_number = std::nan(""); }, "wave number nan");
  expect([](auto* p, auto*) { p->spectrum_exponent = 1e9; }, "-20 to 20");
  expect([](auto* p, auto*) { p->thickness = 0; }, "thickness 0");
  expect([](auto* p, auto*) { p->alpha = -1; }, "alpha -1");
  expect([](auto* p, auto*) { p->shell_count = 0; }, "0 shells");
  expect([](auto* p, auto*) { p->region_count = 1; }, "1 regions: expected 2 to 100");
  expect([](auto* p, auto*) { p->region_count = 101; }, "101 regions");
  expect([](auto*, auto* d) { d->y = 1; }, "1");
  expect([](auto*, auto* d) { *d = {1 << 20, 1 << 20, 1 << 20}; }, "more than any file holds");
}

}  // namespace
}  // namespace isoscope::source
