#include "core/partition/histogram_builder.h"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "tests/support/block_cutter.h"
#include "tests/support/volume_files.h"

namespace isoscope::partition {
namespace {

using volume::ScalarType;

constexpr math::Index3 kDims{11, 9, 13};

// The counts of one loop over all samples.
volume::SampleHistogram BruteForce(ScalarType type, const std::string& samples) {
  volume::SampleHistogram histogram;
  volume::VisitScalarType(type, [&]<typename T>() {
    std::vector<double> values;
    volume::ScalarSpan range;
    for (std::size_t i = 0; i < samples.size(); i += sizeof(T)) {
      values.push_back(static_cast<double>(base::LoadLittleEndian<T>(samples.data() + i)));
      if (std::isfinite(values.back())) {
        range.min = std::min(range.min, values.back());
        range.max = std::max(range.max, values.back());
      }
    }
    histogram.bins = volume::BinsOf(type, range);
    histogram.counts.resize(static_cast<std::size_t>(histogram.bins.count));
    for (const double value : values) {
      if (std::isnan(value)) {
        ++histogram.nan_count;
      } else if (std::isinf(value)) {
        ++(value < 0 ? histogram.negative_infinity_count : histogram.positive_infinity_count);
      } else {
        ++histogram.counts[static_cast<std::size_t>(histogram.bins.IndexOf(value))];
      }
    }
  });
  return histogram;
}

// Counts all blocks, which are spread over shards, in steps of their own order.
volume::SampleHistogram CountAll(ScalarType type, const std::string& samples, int shard_count,
                                 std::uint64_t seed) {
  const volume::BlockLayout layout = volume::BlockLayout::Make(kDims, {4, 3, 5}).value();
  HistogramBuilder builder(layout, type, shard_count);
  std::vector<volume::BlockId> order(static_cast<std::size_t>(layout.block_count()));
  for (std::size_t i = 0; i < order.size(); ++i) {
    order[i] = static_cast<volume::BlockId>(i);
    std::swap(order[i], order[base::RandomBits(seed, i) % (i + 1)]);
  }
  for (const volume::BlockId id : order) {
    const std::string bytes = testing::CutBlock(layout, type, samples, id);
    const volume::BlockSamples block{.block_id = id, .type = type, .bytes = bytes.data()};
    builder.Cover(FiniteSpanOfBlock(layout, block));
    builder.Count(static_cast<int>(id % static_cast<unsigned>(shard_count)), {&block, 1});
  }
  volume::SampleHistogram sum = builder.Get(0);
  for (int shard = 1; shard < shard_count; ++shard) {
    sum.Add(builder.Get(shard));
  }
  return sum;
}

template <typename T>
std::string Bytes(const std::vector<T>& values) {
  std::string bytes;
  for (std::int64_t i = 0; i < math::Volume(kDims); ++i) {
    base::AppendLittleEndian(values[static_cast<std::size_t>(i) % values.size()], &bytes);
  }
  return bytes;
}

void ExpectBruteForce(ScalarType type, const std::string& samples) {
  const volume::SampleHistogram expected = BruteForce(type, samples);
  EXPECT_EQ(expected.TotalCount(), math::Volume(kDims));
  for (const int shards : {1, 3, 70}) {
    for (const std::uint64_t seed : {1U, 2U, 3U}) {
      EXPECT_EQ(CountAll(type, samples, shards, seed), expected)
          << volume::NameOf(type) << " in " << shards << " shards, order " << seed;
    }
  }
}

TEST(HistogramBuilderTest, EveryTypeCountsAsOneLoopDoesWhateverTheOrderAndTheShards) {
  for (const ScalarType type :
       {ScalarType::kUint8, ScalarType::kInt8, ScalarType::kUint16, ScalarType::kInt16,
        ScalarType::kUint32, ScalarType::kInt32, ScalarType::kFloat32, ScalarType::kFloat64}) {
    ExpectBruteForce(type, testing::Noise(kDims, type));
  }
}

TEST(HistogramBuilderTest, RangesThatGrowByAllOrdersOfMagnitudeLoseNoSample) {
  std::vector<double> values;
  for (int i = 0; i < 1200; ++i) {
    values.push_back(std::ldexp(i % 2 == 0 ? 1.0 : -0.75, i % 400 - 200));
  }
  ExpectBruteForce(ScalarType::kFloat64, Bytes(values));
  ExpectBruteForce(ScalarType::kFloat64, Bytes<double>({5e-324, -5e-324, 0.0, -0.0, 1e308, -1e308,
                                                        std::numeric_limits<double>::max(),
                                                        std::numeric_limits<double>::lowest()}));
  ExpectBruteForce(ScalarType::kFloat64, Bytes<double>({5e-324, -5e-324, 0.0, -0.0}));
  ExpectBruteForce(ScalarType::kFloat64, Bytes<double>({1e15, 1e15 + 0.125, 1e15 + 1}));
}

TEST(HistogramBuilderTest, NanAndInfinitiesAreCountedApart) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  ExpectBruteForce(ScalarType::kFloat32, Bytes<float>({1, nan, 2, kInf, nan, 3.5F, -kInf}));
  ExpectBruteForce(ScalarType::kFloat32, Bytes<float>({nan}));
  ExpectBruteForce(ScalarType::kFloat32, Bytes<float>({kInf, -kInf, nan}));
  ExpectBruteForce(ScalarType::kFloat64, Bytes<double>({static_cast<double>(kInf), 7}));
}

TEST(HistogramBuilderTest, EqualSamplesAreOneBin) {
  ExpectBruteForce(ScalarType::kUint16, Bytes<std::uint16_t>({777}));
  ExpectBruteForce(ScalarType::kFloat32, Bytes<float>({0}));
}

}  // namespace
}  // namespace isoscope::partition
