#include "core/source/adapt/slice_source.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Noise;
using ::isoscope::testing::StatusIs;
using ::testing::_;

constexpr math::Index3 kDims{5, 7, 4};
constexpr std::size_t kRowBytes = 10;

class FakeReader final : public SliceReader {
 public:
  FakeReader(std::string samples, std::vector<std::int64_t>* reads)
      : samples_(std::move(samples)), reads_(reads) {}
  absl::Status ReadSlice(std::int64_t z, char* out) override {
    reads_->push_back(z);
    if (z == 3 && reads_->size() == 1) {
      return absl::DataLossError("first read of the last slice");
    }
    std::copy_n(samples_.data() + static_cast<std::size_t>(z) * 7 * kRowBytes, 7 * kRowBytes, out);
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t memory_bytes() const override { return 1000; }

 private:
  const std::string samples_;
  std::vector<std::int64_t>* const reads_;
};

TEST(SliceSourceTest, EveryRunOfRowsIsRightAndASliceInPartsIsDecodedOnce) {
  const std::string samples = Noise(kDims, volume::ScalarType::kInt16);
  volume::GridGeometry geometry;
  geometry.sample_dims = kDims;
  std::vector<std::int64_t> reads;
  const auto source =
      MakeSliceSource({.name = "fake", .geometry = geometry, .type = volume::ScalarType::kInt16},
                      std::make_unique<FakeReader>(samples, &reads));
  EXPECT_EQ(source->info().memory_bytes, 1000 + 2 * 7 * static_cast<std::int64_t>(kRowBytes));
  for (std::int64_t begin = 0; begin < 28; ++begin) {
    for (std::int64_t end = begin + 1; end <= 28; ++end) {
      std::string rows(static_cast<std::size_t>(end - begin) * kRowBytes, '\0');
      ISOSCOPE_ASSERT_OK(source->ReadRows(begin, end, rows.data()));
      EXPECT_TRUE(rows == samples.substr(static_cast<std::size_t>(begin) * kRowBytes, rows.size()));
    }
  }
  reads.assign(1, 0);
  std::string row(kRowBytes, '\0');
  for (std::int64_t begin = 0; begin < 28; ++begin) {
    ISOSCOPE_ASSERT_OK(source->ReadRows(begin, begin + 1, row.data()));
  }
  EXPECT_THAT(reads, ::testing::ElementsAre(0, 0, 1, 2, 3));
}

TEST(SliceSourceTest, SliceThatFailedIsNotTakenForHeld) {
  volume::GridGeometry geometry;
  geometry.sample_dims = kDims;
  std::vector<std::int64_t> reads;
  const std::string samples = Noise(kDims, volume::ScalarType::kInt16);
  const auto source =
      MakeSliceSource({.name = "fake", .geometry = geometry, .type = volume::ScalarType::kInt16},
                      std::make_unique<FakeReader>(samples, &reads));
  std::string row(kRowBytes, '\0');
  EXPECT_THAT(source->ReadRows(27, 28, row.data()), StatusIs(absl::StatusCode::kDataLoss, _));
  ISOSCOPE_ASSERT_OK(source->ReadRows(27, 28, row.data()));
  EXPECT_EQ(row, samples.substr(27 * kRowBytes));
}

}  // namespace
}  // namespace isoscope::source
