#include "core/partition/portion_reader.h"

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::partition {
namespace {

using ::isoscope::testing::Noise;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::_;
using volume::ScalarType;

constexpr math::Index3 kDims{10, 30, 37};

// A memory source that can't seek.
class SequentialSource final : public source::VolumeSource {
 public:
  explicit SequentialSource(std::unique_ptr<source::VolumeSource> source)
      : VolumeSource(InfoOf(source->info())), source_(std::move(source)) {}
  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    return source_->ReadRows(begin_row, end_row, out);
  }

 private:
  static source::SourceInfo InfoOf(source::SourceInfo info) {
    info.is_seekable = false;
    return info;
  }

  std::unique_ptr<source::VolumeSource> source_;
};

class PortionReaderTest : public ::testing::TestWithParam<bool> {
 protected:
  std::unique_ptr<source::VolumeSource> Source() const {
    volume::GridGeometry geometry;
    geometry.sample_dims = kDims;
    auto source = testing::MakeMemorySource(geometry, ScalarType::kInt16, samples_, "noise");
    if (GetParam()) {
      return source;
    }
    return std::make_unique<SequentialSource>(std::move(source));
  }

  const std::string samples_ = Noise(kDims, ScalarType::kInt16);
  const TempDir dir_;
  base::Cancellation never_;
};
INSTANTIATE_TEST_SUITE_P(All, PortionReaderTest, ::testing::Bool());

TEST_P(PortionReaderTest, EveryPortionHoldsItsSamplesInEveryPassForEveryShapeOfPortion) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, volume::BlockLayout::Make(kDims, {4, 5, 3}));
  const auto source = Source();
  for (const std::int64_t layers : {1, 2, 4}) {
    for (const std::int64_t rows : {1, 2, 4, 6}) {
      if (layers > 1 && rows < 6) {
        continue;  // bands have one layer
      }
      const PartitionPlan plan{.layers_per_portion = layers, .block_rows_per_portion = rows};
      PortionReader reader(source.get(), layout, plan, dir_.path(), &never_);
      for (int pass = 0; pass < 2; ++pass) {
        std::string previous;
        for (std::int64_t i = 0; i < PortionCount(layout, plan); ++i) {
          const math::IndexBox box = SamplesOfPortion(layout, PortionAt(layout, plan, i));
          std::string portion(static_cast<std::size_t>(math::Volume(box.dims())) * 2, '\0');
          ISOSCOPE_ASSERT_OK(reader.Read(i, i == 0 ? nullptr : previous.data(), portion.data()));
          std::string expected;
          for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
            expected +=
                samples_.substr(static_cast<std::size_t>((z * kDims.y + box.begin.y) * kDims.x * 2),
                                static_cast<std::size_t>((box.end.y - box.begin.y) * kDims.x * 2));
          }
          EXPECT_TRUE(portion == expected) << layers << " " << rows << " portion " << i;
          previous = portion;
        }
      }
    }
  }
}

// A source of layers that are read as a whole, and what was read of it.
class LayeredSource final : public source::VolumeSource {
 public:
  LayeredSource(std::unique_ptr<source::VolumeSource> source, std::int64_t planes_at_once)
      : VolumeSource(InfoOf(source->info(), planes_at_once)), source_(std::move(source)) {}
  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    reads.emplace_back(begin_row / kDims.y, (end_row - 1) / kDims.y + 1);
    return source_->ReadRows(begin_row, end_row, out);
  }
  absl::Status ReadBand(std::int64_t begin_z, std::int64_t end_z, std::int64_t begin_y,
                        std::int64_t end_y, char* out) override {
    reads.emplace_back(begin_z, end_z);
    return source_->ReadBand(begin_z, end_z, begin_y, end_y, out);
  }
  void HeedCancellation(const base::Cancellation* cancellation) override { heeded = cancellation; }

  std::vector<std::pair<std::int64_t, std::int64_t>> reads;  // planes
  const base::Cancellation* heeded = nullptr;

 private:
  static source::SourceInfo InfoOf(source::SourceInfo info, std::int64_t planes_at_once) {
    info.planes_at_once = planes_at_once;
    return info;
  }

  std::unique_ptr<source::VolumeSource> source_;
};

TEST(PortionReaderLayersTest, PlanesOfALayerAreReadTogether) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, volume::BlockLayout::Make(kDims, {4, 5, 3}));
  const std::string samples = Noise(kDims, ScalarType::kInt16);
  volume::GridGeometry geometry;
  geometry.sample_dims = kDims;
  const base::Cancellation never;
  for (const std::int64_t at_once : {1, 4, 5, 100}) {
    for (const std::int64_t rows : {2, 6}) {
      LayeredSource source(
          testing::MakeMemorySource(geometry, ScalarType::kInt16, samples, "noise"), at_once);
      const PartitionPlan plan{.layers_per_portion = rows == 6 ? 3 : 1,
                               .block_rows_per_portion = rows};
      const TempDir dir;
      {
        PortionReader reader(&source, layout, plan, dir.path(), &never);
        EXPECT_EQ(source.heeded, &never);
        std::string previous;
        for (std::int64_t i = 0; i < PortionCount(layout, plan); ++i) {
          const math::IndexBox box = SamplesOfPortion(layout, PortionAt(layout, plan, i));
          std::string portion(static_cast<std::size_t>(math::Volume(box.dims())) * 2, '\0');
          source.reads.clear();
          ISOSCOPE_ASSERT_OK(reader.Read(i, i == 0 ? nullptr : previous.data(), portion.data()));
          std::string expected;
          for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
            expected +=
                samples.substr(static_cast<std::size_t>((z * kDims.y + box.begin.y) * kDims.x * 2),
                               static_cast<std::size_t>((box.end.y - box.begin.y) * kDims.x * 2));
          }
          EXPECT_TRUE(portion == expected) << at_once << " " << rows << " portion " << i;
          for (const auto& [begin, end] : source.reads) {
            EXPECT_TRUE(end == box.end.z || end % at_once == 0) << at_once << " " << end;
          }
          if (at_once == 100) {
            EXPECT_EQ(source.reads.size(), 1U);
          }
          previous = portion;
        }
      }
      EXPECT_EQ(source.heeded, nullptr);
    }
  }
}

TEST_P(PortionReaderTest, CancellationStopsIt) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, volume::BlockLayout::Make(kDims, {4, 5, 3}));
  const auto source = Source();
  base::Cancellation cancelled;
  cancelled.Cancel();
  for (const std::int64_t rows : {1, 6}) {
    const PartitionPlan plan{.block_rows_per_portion = rows};
    PortionReader reader(source.get(), layout, plan, dir_.path(), &cancelled);
    std::vector<char> portion(samples_.size());
    EXPECT_THAT(reader.Read(0, nullptr, portion.data()), StatusIs(absl::StatusCode::kCancelled, _));
  }
}

}  // namespace
}  // namespace isoscope::partition
