// Each kernel against its definition, sample by sample, on every instruction set.

#include "core/extract/label_kernels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "gtest/gtest.h"

// As in label_kernels.cc, so that all of its targets are tested.
#define HWY_WANT_AVX3_DL
#include "core/base/coding.h"
#include "core/base/random.h"
#include "hwy/targets.h"

namespace isoscope::extract {
namespace {

using volume::ScalarType;

constexpr std::array<ScalarType, 8> kAllTypes{
    ScalarType::kUint8,  ScalarType::kInt8,  ScalarType::kUint16,  ScalarType::kInt16,
    ScalarType::kUint32, ScalarType::kInt32, ScalarType::kFloat32, ScalarType::kFloat64};

template <typename Check>
void OnEveryTarget(const Check& check) {
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    check();
  }
}

// Marks of random samples around the labels against a search of each.
template <typename T>
void ExpectMarksAreTheLabels(ScalarType type, const std::vector<double>& labels) {
  const LabelSet set = MakeLabelSet(type, labels);
  for (const std::size_t count :
       {std::size_t{1}, std::size_t{63}, std::size_t{64}, std::size_t{65}, std::size_t{1000}}) {
    std::vector<T> samples(count);
    for (std::size_t i = 0; i < count; ++i) {
      samples[i] = static_cast<T>(base::RandomBits(count, i) % 127);
      if (i % 5 == 0) {
        samples[i] = static_cast<T>(static_cast<double>(std::numeric_limits<T>::max()));
      }
      if constexpr (std::is_signed_v<T>) {
        samples[i] = i % 3 == 0 ? static_cast<T>(-samples[i]) : samples[i];
      }
      if constexpr (std::is_floating_point_v<T>) {
        samples[i] = i % 7 == 0 ? std::numeric_limits<T>::quiet_NaN() : samples[i];
      }
    }
    std::string bytes(count * sizeof(T), '\0');
    std::copy_n(reinterpret_cast<const char*>(samples.data()), bytes.size(), bytes.data());
    std::vector<std::uint8_t> marks(count + kMarkPadding, 7);
    MarkLabels(set, bytes.data(), count, marks.data());
    for (std::size_t i = 0; i < count; ++i) {
      const bool expected =
          std::find(labels.begin(), labels.end(), static_cast<double>(samples[i])) != labels.end();
      ASSERT_EQ(marks[i], expected ? 1 : 0)
          << volume::NameOf(type) << " " << static_cast<double>(samples[i]);
    }
  }
}

TEST(LabelKernelsTest, MarksAreTheLabelsOfEveryType) {
  std::vector<double> many;  // no two follow each other
  std::vector<double> dense;
  for (int i = 0; i < 60; ++i) {
    many.push_back(-40 + 3 * i);
    dense.push_back(i - 5);
  }
  const std::vector<std::vector<double>> sets{
      {3}, {-7, 0, 1, 2, 100}, {0.5, 3, 1e300}, {-1e300}, {255}, {65535}, {-128, 127}, many, dense};
  OnEveryTarget([&] {
    for (const ScalarType type : kAllTypes) {
      for (const std::vector<double>& labels : sets) {
        volume::VisitScalarType(type,
                                [&]<typename T>() { ExpectMarksAreTheLabels<T>(type, labels); });
      }
    }
  });
}

TEST(LabelKernelsTest, LabelsThatFollowEachOtherAreOneIntervalOfIntegers) {
  const std::vector<double> labels{1, 2, 3, 7, 300};
  EXPECT_EQ(MakeLabelSet(ScalarType::kInt16, labels).intervals.size(), 3U);
  EXPECT_EQ(MakeLabelSet(ScalarType::kUint8, labels).intervals.size(), 2U);
  EXPECT_EQ(MakeLabelSet(ScalarType::kFloat32, labels).intervals.size(), 5U);
}

TEST(LabelKernelsTest, NumbersAreAllButNan) {
  OnEveryTarget([] {
    for (const std::size_t nan : {std::size_t{0}, std::size_t{64}, std::size_t{99}}) {
      std::vector<float> samples(100, 1.0F);
      samples[3] = std::numeric_limits<float>::infinity();
      std::vector<std::uint8_t> marks(100 + kMarkPadding);
      const auto* bytes = reinterpret_cast<const char*>(samples.data());
      EXPECT_FALSE(MarkNumbers(ScalarType::kFloat32, bytes, 100, marks.data()));
      samples[nan] = std::numeric_limits<float>::quiet_NaN();
      EXPECT_TRUE(MarkNumbers(ScalarType::kFloat32, bytes, 100, marks.data()));
      for (std::size_t i = 0; i < 100; ++i) {
        EXPECT_EQ(marks[i], i == nan ? 0 : 1);
      }
      EXPECT_FALSE(MarkNumbers(ScalarType::kUint8, bytes, 400, marks.data()));
    }
  });
}

std::vector<std::uint8_t> RandomMarks(std::size_t count) {
  std::vector<std::uint8_t> marks(count + kMarkPadding);
  for (std::size_t i = 0; i < count; ++i) {
    marks[i] = static_cast<std::uint8_t>(base::RandomBits(3, i) & 1);
  }
  return marks;
}

TEST(LabelKernelsTest, SobelIsTheSumOfTwentySevenSamples) {
  OnEveryTarget([] {
    SobelScratch scratch;
    for (const math::Index3& dims :
         {math::Index3{3, 3, 3}, math::Index3{5, 4, 3}, math::Index3{18, 18, 18},
          math::Index3{70, 5, 4}, math::Index3{3, 40, 6}}) {
      const auto row = static_cast<std::size_t>(dims.x);
      const auto slice = static_cast<std::size_t>(dims.x * dims.y);
      const auto count = static_cast<std::size_t>(math::Volume(dims));
      const std::vector<std::uint8_t> marks = RandomMarks(count);
      std::vector<std::uint32_t> sobel(count + kMarkPadding);
      FillSobel(marks.data(), row, slice, count, &scratch, sobel.data());
      for (std::int64_t z = 1; z + 1 < dims.z; ++z) {
        for (std::int64_t y = 1; y + 1 < dims.y; ++y) {
          for (std::int64_t x = 1; x + 1 < dims.x; ++x) {
            std::array<int, 3> sums{};
            for (int k = 0; k < 27; ++k) {
              const std::array<int, 3> d{k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1};
              const std::int64_t at = x + d[0] + dims.x * (y + d[1] + dims.y * (z + d[2]));
              for (std::size_t a = 0; a < 3; ++a) {
                const int weight = (2 - std::abs(d[(a + 1) % 3])) * (2 - std::abs(d[(a + 2) % 3]));
                sums[a] += d[a] * weight * marks[static_cast<std::size_t>(at)];
              }
            }
            const std::uint32_t word =
                sobel[static_cast<std::size_t>(x + dims.x * (y + dims.y * z))];
            for (std::size_t a = 0; a < 3; ++a) {
              ASSERT_EQ(static_cast<int>(word >> 8 * a & 255), sums[a] + 16);
            }
            ASSERT_EQ(word >> 24, 0U);
          }
        }
      }
    }
  });
}

TEST(LabelKernelsTest, WithoutAGradientTheNormalIsAlongTheEdge) {
  // The filter of all samples is 0.
  const std::vector<std::uint32_t> sobel(8, kSobelZero * 0x010101);
  const std::vector<std::uint8_t> marks{0, 1, 1, 0, 0, 0, 0, 0};
  const std::vector<std::uint32_t> lower{0, 2};
  OnEveryTarget([&] {
    std::vector<math::Vec3f> normals(2 + 64);
    FillLabelNormals({.axis = 2,
                      .count = 2,
                      .lower_samples = lower.data(),
                      .upper_distance = 1,
                      .marks = marks.data(),
                      .sobel = sobel.data()},
                     math::Mat3d{}, normals.data());
    // Away from the inside.
    EXPECT_EQ(normals[0], (math::Vec3f{0, 0, -1}));
    EXPECT_EQ(normals[1], (math::Vec3f{0, 0, 1}));
  });
}

}  // namespace
}  // namespace isoscope::extract
