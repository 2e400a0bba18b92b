#include "core/partition/block_cutter.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/volume/block_samples.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"

namespace isoscope::partition {
namespace {

constexpr volume::ScalarType kAllTypes[] = {
    volume::ScalarType::kUint8,   volume::ScalarType::kInt8,   volume::ScalarType::kUint16,
    volume::ScalarType::kInt16,   volume::ScalarType::kUint32, volume::ScalarType::kInt32,
    volume::ScalarType::kFloat32, volume::ScalarType::kFloat64};

double SampleAt(const std::string& samples, volume::ScalarType type, const math::Index3& dims,
                const math::Index3& at) {
  return volume::VisitScalarType(type, [&]<typename T>() {
    const auto i = static_cast<std::size_t>((at.z * dims.y + at.y) * dims.x + at.x);
    return static_cast<double>(base::LoadLittleEndian<T>(samples.data() + i * sizeof(T)));
  });
}

// All planes at once, brute force over samples.
void ExpectBlocksMatch(const std::string& samples, volume::ScalarType type,
                       const math::Index3& dims, const math::Index3& cells) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, volume::BlockLayout::Make(dims, cells));
  const Slab slab{.samples = samples.data(), .begin_z = 0};
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    volume::ScalarSpan expected;
    const math::IndexBox own = layout.OwnSamplesOf(id);
    const math::IndexBox stored = layout.StoredSamplesOf(id);
    std::string out(volume::StoredSizeBytes(layout, id, type), '\x5a');
    CutBlock(layout, type, slab, id, out.data());
    for (std::int64_t z = stored.begin.z; z < stored.end.z; ++z) {
      for (std::int64_t y = stored.begin.y; y < stored.end.y; ++y) {
        for (std::int64_t x = stored.begin.x; x < stored.end.x; ++x) {
          const math::Index3 at{x, y, z};
          const double value = SampleAt(samples, type, dims, at);
          const double cut = SampleAt(out, type, stored.dims(), at - stored.begin);
          ASSERT_TRUE(value == cut || (std::isnan(value) && std::isnan(cut)));
          if (own.Contains(at) && !std::isnan(value)) {
            expected.min = std::min(expected.min, value);
            expected.max = std::max(expected.max, value);
          }
        }
      }
    }
    ASSERT_EQ(SpanOfBlock(layout, type, slab, id), expected) << "block " << id;
    const volume::BlockSamples stored_samples{.block_id = id, .type = type, .bytes = out.data()};
    ASSERT_EQ(SpanOfBlock(layout, stored_samples), expected) << "block " << id;
  }
}

TEST(BlockCutterTest, SamplesAndSpansMatchBruteForceForAllTypesAndOddSizes) {
  const math::Index3 dims{37, 21, 11};
  for (const volume::ScalarType type : kAllTypes) {
    SCOPED_TRACE(std::string(volume::NameOf(type)));
    const std::string samples = testing::Noise(dims, type);
    for (const math::Index3& cells :
         {math::Index3{4, 4, 4}, math::Index3{8, 8, 8}, math::Index3{16, 16, 16},
          math::Index3{32, 5, 3}, math::Index3{1, 2, 128}}) {
      ExpectBlocksMatch(samples, type, dims, cells);
    }
  }
}

TEST(BlockCutterTest, NanDoesNotEnterASpanAndAllNanIsEmpty) {
  const math::Index3 dims{18, 9, 9};
  std::string samples = testing::Noise(dims, volume::ScalarType::kFloat32);
  for (std::size_t i = 0; i < samples.size() / 4; ++i) {
    // Half of the volume all NaN, every third sample of the rest.
    if (i % 18 >= 8 || i % 3 == 0) {
      base::StoreLittleEndian(std::numeric_limits<float>::quiet_NaN(), samples.data() + 4 * i);
    }
  }
  ExpectBlocksMatch(samples, volume::ScalarType::kFloat32, dims, {4, 4, 4});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, volume::BlockLayout::Make(dims, {4, 4, 4}));
  const Slab slab{.samples = samples.data(), .begin_z = 0};
  EXPECT_EQ(SpanOfBlock(layout, volume::ScalarType::kFloat32, slab, layout.IdOf({3, 0, 0})),
            volume::ScalarSpan{});
}

TEST(BlockCutterTest, InfinityCountsAndZerosOfBothSignsGiveOnePattern) {
  const math::Index3 dims{3, 3, 3};
  std::vector<double> values(27, 0.0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, volume::BlockLayout::Make(dims, {2, 2, 2}));
  for (std::size_t negative = 0; negative < 27; ++negative) {
    values.assign(27, 0.0);
    values[negative] = -0.0;
    const Slab slab{.samples = reinterpret_cast<const char*>(values.data()), .begin_z = 0};
    const volume::ScalarSpan span = SpanOfBlock(layout, volume::ScalarType::kFloat64, slab, 0);
    EXPECT_FALSE(std::signbit(span.min));
    EXPECT_FALSE(std::signbit(span.max));
  }
  values[5] = std::numeric_limits<double>::infinity();
  const Slab slab{.samples = reinterpret_cast<const char*>(values.data()), .begin_z = 0};
  EXPECT_EQ(SpanOfBlock(layout, volume::ScalarType::kFloat64, slab, 0).max,
            std::numeric_limits<double>::infinity());
}

TEST(BlockCutterTest, SlabThatStartsInsideTheVolumeGivesTheSameBlock) {
  const math::Index3 dims{10, 9, 20};
  const std::string samples = testing::Noise(dims, volume::ScalarType::kUint16);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, volume::BlockLayout::Make(dims, {4, 4, 4}));
  const volume::BlockId id = layout.IdOf({1, 1, 2});
  const std::int64_t begin_z = layout.StoredSamplesOf(id).begin.z;
  const Slab whole{.samples = samples.data(), .begin_z = 0};
  const Slab part{.samples = samples.data() + begin_z * 90 * 2, .begin_z = begin_z};
  std::string from_whole(volume::StoredSizeBytes(layout, id, volume::ScalarType::kUint16), '\0');
  std::string from_part = from_whole;
  CutBlock(layout, volume::ScalarType::kUint16, whole, id, from_whole.data());
  CutBlock(layout, volume::ScalarType::kUint16, part, id, from_part.data());
  EXPECT_EQ(from_whole, from_part);
  EXPECT_EQ(SpanOfBlock(layout, volume::ScalarType::kUint16, whole, id),
            SpanOfBlock(layout, volume::ScalarType::kUint16, part, id));
}

}  // namespace
}  // namespace isoscope::partition
