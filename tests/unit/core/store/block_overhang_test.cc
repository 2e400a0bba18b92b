#include "core/store/block_overhang.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/crc32c.h"
#include "core/base/random.h"
#include "core/volume/block_samples.h"
#include "tests/support/status_matchers.h"

namespace isoscope::store {
namespace {

using ::isoscope::testing::StatusIs;

volume::BlockLayout LayoutOf(const math::Index3& dims, const math::Index3& cells) {
  return *volume::BlockLayout::Make(dims, cells);
}

std::string Bytes(std::uint64_t seed, std::size_t size, std::uint64_t range) {
  std::string bytes(size, '\0');
  for (std::size_t i = 0; i < size; ++i) {
    bytes[i] = static_cast<char>(base::RandomBits(seed, i) % range);
  }
  return bytes;
}

// The samples of a block that lie in its unit, as ReadBlock writes them; zeros elsewhere.
std::string OnlyPart(const volume::BlockLayout& layout, const SourceSamples& source,
                     volume::BlockId id, std::size_t size, const std::string& samples) {
  const math::IndexBox stored = layout.StoredSamplesOf(id);
  const math::IndexBox part = PartInUnit(layout, source, id);
  const math::Index3 dims = stored.dims();
  std::string only(samples.size(), '\0');
  for (std::int64_t z = part.begin.z; z < part.end.z; ++z) {
    for (std::int64_t y = part.begin.y; y < part.end.y; ++y) {
      for (std::int64_t x = part.begin.x; x < part.end.x; ++x) {
        const auto at = static_cast<std::size_t>(
            ((z - stored.begin.z) * dims.y + y - stored.begin.y) * dims.x + x - stored.begin.x);
        std::copy_n(samples.data() + at * size, size, only.data() + at * size);
      }
    }
  }
  return only;
}

TEST(BlockOverhangTest, PartsAreThoseOfTheUnitOfTheFirstOwnSample) {
  // Blocks of 16 cells, units of 64 samples: along x, block 3 has own samples 48 to 64.
  const volume::BlockLayout layout = LayoutOf({200, 40, 40}, {16, 16, 16});
  const SourceSamples source{.request = {}, .unit_origin = {0, 0, 0}, .unit_dims = {64, 64, 64}};
  EXPECT_EQ(UnitOfBlock(layout, source, 3), (math::Index3{0, 0, 0}));
  EXPECT_EQ(PartInUnit(layout, source, 3),
            (math::IndexBox{.begin = {47, 0, 0}, .end = {64, 18, 18}}));
  EXPECT_EQ(UnitOfBlock(layout, source, 4), (math::Index3{1, 0, 0}));
  EXPECT_EQ(PartInUnit(layout, source, 4),
            (math::IndexBox{.begin = {64, 0, 0}, .end = {82, 18, 18}}));
  // A grid of units that begins before the volume.
  const SourceSamples cropped{.request = {}, .unit_origin = {-60, 0, 0}, .unit_dims = {64, 64, 64}};
  EXPECT_EQ(UnitOfBlock(layout, cropped, 0), (math::Index3{0, 0, 0}));
  EXPECT_EQ(PartInUnit(layout, cropped, 0),
            (math::IndexBox{.begin = {0, 0, 0}, .end = {4, 18, 18}}));
}

// Any blocks, units and types: overhang and unit give the samples. Cut or flipped bytes give an error, or
// samples whose checksum is another.
TEST(BlockOverhangTest, OverhangAndUnitAreTheBlock) {
  constexpr std::array kTypes = {volume::ScalarType::kUint8, volume::ScalarType::kInt16,
                                 volume::ScalarType::kFloat32, volume::ScalarType::kFloat64};
  std::uint64_t next = 0;
  const auto draw = [&next](std::int64_t low, std::int64_t high) {
    return low + static_cast<std::int64_t>(base::RandomBits(11, next++) %
                                           static_cast<std::uint64_t>(high - low + 1));
  };
  int overhang_count = 0;
  for (int i = 0; i < 400; ++i) {
    SCOPED_TRACE(i);
    const volume::BlockLayout layout =
        LayoutOf({draw(2, 50), draw(2, 40), draw(2, 40)}, {draw(1, 17), draw(1, 17), draw(1, 17)});
    SourceSamples source;
    for (int axis = 0; axis < 3; ++axis) {
      source.unit_dims[axis] = draw(1, 40);
      source.unit_origin[axis] = -draw(0, source.unit_dims[axis] - 1);
    }
    const volume::ScalarType type = kTypes[static_cast<std::size_t>(draw(0, 3))];
    const auto id = static_cast<volume::BlockId>(draw(0, layout.block_count() - 1));
    const std::string samples =
        Bytes(next, volume::StoredSizeBytes(layout, id, type), i % 2 == 0 ? 256 : 3);
    std::string stored;
    const BlockEncoding encoding = EncodeOverhang(layout, source, type, id, samples, &stored);
    if (encoding == BlockEncoding::kRaw) {
      EXPECT_EQ(stored, samples);
      continue;
    }
    ++overhang_count;
    ASSERT_EQ(encoding, BlockEncoding::kOverhang);
    ASSERT_LT(stored.size(), samples.size());
    const std::string part = OnlyPart(layout, source, id, volume::SizeOf(type), samples);
    std::string found = part;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::uint32_t crc32c,
                                  DecodeOverhang(layout, source, type, id, stored, found.data()));
    EXPECT_EQ(found, samples);
    EXPECT_EQ(crc32c, base::Crc32c(samples));

    std::string bad = stored;
    if (draw(0, 1) == 0) {
      bad.resize(static_cast<std::size_t>(draw(0, static_cast<std::int64_t>(bad.size()) - 1)));
    } else {
      bad[static_cast<std::size_t>(draw(0, static_cast<std::int64_t>(bad.size()) - 1))] ^=
          static_cast<char>(1 << draw(0, 7));
    }
    found = part;
    const auto got = DecodeOverhang(layout, source, type, id, bad, found.data());
    if (got.ok()) {
      EXPECT_TRUE(*got != base::Crc32c(found) || found == samples);
    } else {
      EXPECT_THAT(got, StatusIs(absl::StatusCode::kDataLoss));
    }
  }
  EXPECT_GT(overhang_count, 200);
}

TEST(BlockOverhangTest, ABlockWithinItsUnitHasNoSamplesInIt) {
  const volume::BlockLayout layout = LayoutOf({20, 20, 20}, {16, 16, 16});
  const SourceSamples source{.request = {}, .unit_origin = {0, 0, 0}, .unit_dims = {64, 64, 64}};
  const std::string samples =
      Bytes(1, volume::StoredSizeBytes(layout, 0, volume::ScalarType::kUint8), 256);
  std::string stored;
  EXPECT_EQ(EncodeOverhang(layout, source, volume::ScalarType::kUint8, 0, samples, &stored),
            BlockEncoding::kOverhang);
  EXPECT_EQ(stored.size(), kOverhangHeadBytes);
  std::string found = samples;
  EXPECT_THAT(
      DecodeOverhang(layout, source, volume::ScalarType::kUint8, 0, stored + "x", found.data()),
      StatusIs(absl::StatusCode::kDataLoss));
}

}  // namespace
}  // namespace isoscope::store
