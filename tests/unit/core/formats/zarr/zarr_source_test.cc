#include "core/formats/zarr/zarr_source.h"

#include <memory>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/chunks/stored_array.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/formats/zarr/zarr_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::MemoryStore;
using ::isoscope::testing::Objects;
using ::isoscope::testing::PlainArray;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::testing::_;

// Rows of every length, of a component in the middle of the axes.
TEST(ZarrSourceTest, ReadsRows) {
  const PlainArray array = PlainArray::Counting({5, 3, 6, 7}, 2);
  Objects objects;
  testing::AddChunks("", array, {.chunk_dims = {2, 2, 4, 3}, .fill = std::string(2, '\0')}, false,
                     &objects);
  ZarrArray metadata{.dims = {5, 3, 6, 7},
                     .chunk_dims = {2, 2, 4, 3},
                     .type = NumberType::kUint16,
                     .fill = std::string(2, '\0'),
                     .codecs = {{.name = "bytes"}},
                     .separator = '.'};
  const auto store = std::make_shared<const MemoryStore>(objects);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(std::shared_ptr<const ChunkedArray> chunks,
                                OpenStoredArray(store, metadata.SpecOf("a")));
  const auto source = MakeZarrSource(
      {.name = "a", .geometry = {.sample_dims = {7, 6, 5}, .origin = {}, .direction = {}}}, chunks,
      {.space = {0, 2, 3}, .index = {0, 1, 0, 0}}, {});
  EXPECT_EQ(source->info().type, volume::ScalarType::kUint16);
  EXPECT_GT(source->info().memory_bytes, 0);
  const std::string all = array.Cut({.begin = {0, 1, 0, 0}, .end = {5, 2, 6, 7}}, "");
  for (std::int64_t begin = 0; begin < 30; ++begin) {
    for (std::int64_t end = begin + 1; end <= 30; ++end) {
      std::string rows(static_cast<std::size_t>(14 * (end - begin)), '?');
      ISOSCOPE_ASSERT_OK(source->ReadRows(begin, end, rows.data()));
      ASSERT_EQ(rows, all.substr(static_cast<std::size_t>(14 * begin), rows.size()))
          << begin << " " << end;
    }
  }
  // Plane after plane, each chunk is read once.
  (void)store->TakeReads();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 1));
  EXPECT_EQ(read, all);
  EXPECT_EQ(store->TakeReads().size(), 18U);  // 3 x 2 x 3, those of the component alone
}

TEST(ZarrSourceTest, ReadsBandsAndHeedsCancellation) {
  const PlainArray array = PlainArray::Counting({5, 6, 7}, 2);
  Objects objects;
  testing::AddChunks("", array, {.chunk_dims = {2, 4, 3}, .fill = std::string(2, '\0')}, false,
                     &objects);
  ZarrArray metadata{.dims = {5, 6, 7},
                     .chunk_dims = {2, 4, 3},
                     .type = NumberType::kUint16,
                     .fill = std::string(2, '\0'),
                     .codecs = {{.name = "bytes"}},
                     .separator = '.'};
  const auto store = std::make_shared<const MemoryStore>(objects);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(std::shared_ptr<const ChunkedArray> chunks,
                                OpenStoredArray(store, metadata.SpecOf("a")));
  const auto source = MakeZarrSource(
      {.name = "a", .geometry = {.sample_dims = {7, 6, 5}, .origin = {}, .direction = {}}}, chunks,
      {.space = {0, 1, 2}, .index = {0, 0, 0}}, {});
  EXPECT_EQ(source->info().planes_at_once, 2);
  for (std::int64_t z = 0; z < 5; ++z) {
    for (std::int64_t end_z = z + 1; end_z <= 5; ++end_z) {
      for (std::int64_t y = 0; y < 6; ++y) {
        for (std::int64_t end_y = y + 1; end_y <= 6; ++end_y) {
          std::string band(static_cast<std::size_t>(14 * (end_z - z) * (end_y - y)), '?');
          ISOSCOPE_ASSERT_OK(source->ReadBand(z, end_z, y, end_y, band.data()));
          ASSERT_EQ(band, array.Cut({.begin = {z, y, 0}, .end = {end_z, end_y, 7}}, ""));
        }
      }
    }
  }
  // A band of the planes of a layer reads its chunks once.
  (void)store->TakeReads();
  std::string band(14 * 2 * 6, '?');
  ISOSCOPE_ASSERT_OK(source->ReadBand(2, 4, 0, 6, band.data()));
  EXPECT_EQ(store->TakeReads().size(), 6U);
  base::Cancellation cancelled;
  cancelled.Cancel();
  {
    const CancellableReads reads(source.get(), cancelled);
    EXPECT_THAT(source->ReadRows(0, 6, band.data()), StatusIs(absl::StatusCode::kCancelled, _));
    EXPECT_THAT(source->ReadBand(2, 4, 0, 6, band.data()),
                StatusIs(absl::StatusCode::kCancelled, _));
  }
  ISOSCOPE_EXPECT_OK(source->ReadRows(0, 6, band.data()));
}

TEST(ZarrSourceTest, ServesTypesThatNoVolumeHas) {
  const auto open = [](NumberType type, const std::string& bytes, const ZarrPacking& packing) {
    ZarrArray metadata{.dims = {2, 2, 2},
                       .chunk_dims = {2, 2, 2},
                       .type = type,
                       .fill = std::string(SizeOf(type), '\0'),
                       .codecs = {{.name = "bytes"}},
                       .separator = '.'};
    const auto store = std::make_shared<const MemoryStore>(Objects{{"0.0.0", bytes}});
    std::shared_ptr<const ChunkedArray> chunks = *OpenStoredArray(store, metadata.SpecOf("a"));
    return MakeZarrSource(
        {.name = "a", .geometry = {.sample_dims = {2, 2, 2}, .origin = {}, .direction = {}}},
        chunks, {.space = {0, 1, 2}, .index = {0, 0, 0}}, packing);
  };
  const auto wide = open(NumberType::kInt64,
                         testing::NumberText<std::int64_t>({0, -1, 2, 3, 4, 5, 6, 1LL << 53}), {});
  EXPECT_EQ(wide->info().type, volume::ScalarType::kFloat64);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string doubles, ReadAll(*wide, 1));
  EXPECT_EQ(doubles, testing::NumberText<double>({0, -1, 2, 3, 4, 5, 6, 0x1p53}));
  const auto half =
      open(NumberType::kFloat16,
           testing::NumberText<std::uint16_t>({0, 0x3c00, 0xc000, 0x7bff, 1, 0, 0, 0}), {});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string floats, ReadAll(*half, 2));
  EXPECT_EQ(floats, testing::NumberText<float>({0, 1, -2, 65504, 0x1p-24F, 0, 0, 0}));
  const auto packed =
      open(NumberType::kInt16, testing::NumberText<std::int16_t>({0, 1, 2, 3, 4, 5, 6, 7}),
           {.slope = 0.5, .intercept = 1});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string scaled, ReadAll(*packed, 1));
  EXPECT_EQ(scaled, testing::NumberText<float>({1, 1.5, 2, 2.5, 3, 3.5, 4, 4.5}));
}

}  // namespace
}  // namespace isoscope::source
