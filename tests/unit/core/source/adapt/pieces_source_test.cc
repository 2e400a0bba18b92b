#include "core/source/adapt/pieces_source.h"

#include <algorithm>
#include <cstdint>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Noise;
using ::isoscope::testing::StatusIs;
using volume::ScalarType;

constexpr math::Index3 kDims{9, 7, 8};

volume::GridGeometry Grid(const math::Index3& dims) {
  volume::GridGeometry geometry;
  geometry.sample_dims = dims;
  return geometry;
}

// The samples of a box of `all`.
std::string Box(const std::string& all, const math::Index3& begin, const math::Index3& end) {
  std::string box;
  for (std::int64_t z = begin.z; z < end.z; ++z) {
    for (std::int64_t y = begin.y; y < end.y; ++y) {
      box += all.substr(static_cast<std::size_t>((z * kDims.y + y) * kDims.x + begin.x) * 2,
                        static_cast<std::size_t>(end.x - begin.x) * 2);
    }
  }
  return box;
}

// Cuts on each axis; pieces overlap by `overlap` samples and their sources have `around` more.
std::vector<SamplePiece> Cut(const std::vector<std::int64_t> (&cuts)[3], std::int64_t overlap) {
  std::vector<SamplePiece> pieces;
  for (std::size_t z = 0; z + 1 < cuts[2].size(); ++z) {
    for (std::size_t y = 0; y + 1 < cuts[1].size(); ++y) {
      for (std::size_t x = 0; x + 1 < cuts[0].size(); ++x) {
        SamplePiece piece;
        piece.begin = {cuts[0][x], cuts[1][y], cuts[2][z]};
        piece.end = {std::min(cuts[0][x + 1] + overlap, kDims.x),
                     std::min(cuts[1][y + 1] + overlap, kDims.y),
                     std::min(cuts[2][z + 1] + overlap, kDims.z)};
        piece.first = piece.begin;
        pieces.push_back(piece);
      }
    }
  }
  return pieces;
}

TEST(PiecesSourceTest, EveryRunOfRowsIsPutTogetherFromAnyPieces) {
  const std::string samples = Noise(kDims, ScalarType::kInt16);
  const std::vector<std::int64_t> whole[3] = {{0, 9}, {0, 7}, {0, 8}};
  const std::vector<std::int64_t> three[3] = {{0, 4, 9}, {0, 1, 7}, {0, 3, 4, 8}};
  const std::vector<std::int64_t> many[3] = {{0, 1, 2, 5, 9}, {0, 2, 4, 7}, {0, 2, 4, 8}};
  for (const auto* cuts : {&whole, &three, &many}) {
    for (const std::int64_t overlap : {0, 1}) {
      std::vector<SamplePiece> pieces = Cut(*cuts, overlap);
      for (SamplePiece& piece : pieces) {
        piece.first = {std::max<std::int64_t>(piece.begin.x - 1, 0), piece.begin.y,
                       std::max<std::int64_t>(piece.begin.z - 1, 0)};
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto gap, FindGap(kDims, pieces));
      ASSERT_FALSE(gap.has_value());
      const auto source = MakePiecesSource(
          {.name = "v", .geometry = Grid(kDims), .type = ScalarType::kInt16}, pieces, 0,
          [&](std::size_t i) -> absl::StatusOr<std::unique_ptr<VolumeSource>> {
            math::Index3 dims;
            for (int axis = 0; axis < 3; ++axis) {
              dims[axis] = pieces[i].end[axis] - pieces[i].first[axis];
            }
            return testing::MakeMemorySource(Grid(dims), ScalarType::kInt16,
                                             Box(samples, pieces[i].first, pieces[i].end), "p");
          });
      for (std::int64_t begin = 0; begin < 56; ++begin) {
        for (std::int64_t end = begin + 1; end <= 56; ++end) {
          std::string rows(static_cast<std::size_t>(end - begin) * 18, '\0');
          ISOSCOPE_ASSERT_OK(source->ReadRows(begin, end, rows.data()));
          ASSERT_TRUE(rows == samples.substr(static_cast<std::size_t>(begin) * 18, rows.size()))
              << begin << " to " << end;
        }
      }
    }
  }
}

TEST(PiecesSourceTest, FirstOfOverlappingPiecesCounts) {
  std::vector<SamplePiece> pieces(2);
  pieces[0] = {.begin = {0, 0, 0}, .end = {2, 2, 2}, .first = {0, 0, 0}};
  pieces[1] = {.begin = {1, 0, 0}, .end = {3, 2, 2}, .first = {1, 0, 0}};
  const auto source = MakePiecesSource(
      {.name = "v", .geometry = Grid({3, 2, 2}), .type = ScalarType::kUint8}, pieces, 100,
      [](std::size_t i) -> absl::StatusOr<std::unique_ptr<VolumeSource>> {
        return testing::MakeMemorySource(Grid({2, 2, 2}), ScalarType::kUint8,
                                         std::string(8, i == 0 ? 'a' : 'b'), "p");
      });
  std::string rows(12, '\0');
  ISOSCOPE_ASSERT_OK(source->ReadRows(0, 4, rows.data()));
  EXPECT_EQ(rows, "aabaabaabaab");
  EXPECT_GE(source->info().memory_bytes, 200);
}

TEST(PiecesSourceTest, ErrorOfAPieceIsPassedOn) {
  const auto source =
      MakePiecesSource({.name = "v", .geometry = Grid({2, 2, 2}), .type = ScalarType::kUint8},
                       {{.begin = {0, 0, 0}, .end = {2, 2, 2}, .first = {0, 0, 0}}}, 0,
                       [](std::size_t) -> absl::StatusOr<std::unique_ptr<VolumeSource>> {
                         return absl::NotFoundError("gone");
                       });
  std::string rows(8, '\0');
  EXPECT_THAT(source->ReadRows(0, 4, rows.data()), StatusIs(absl::StatusCode::kNotFound, "gone"));
}

// Random boxes against a table of all samples.
TEST(PiecesSourceTest, GapsAreFoundIfThereAreAny) {
  std::mt19937 random(5);
  const auto draw = [&](std::int64_t limit) {
    return static_cast<std::int64_t>(random() % static_cast<std::uint32_t>(limit));
  };
  int gaps = 0;
  for (int round = 0; round < 2000; ++round) {
    std::vector<SamplePiece> pieces(static_cast<std::size_t>(1 + draw(12)));
    std::vector<bool> has(static_cast<std::size_t>(math::Volume(kDims)));
    for (SamplePiece& piece : pieces) {
      for (int axis = 0; axis < 3; ++axis) {
        piece.begin[axis] = draw(3) > 0 ? 0 : draw(kDims[axis]);
        piece.end[axis] = draw(3) > 0
                              ? kDims[axis]
                              : piece.begin[axis] + draw(kDims[axis] - piece.begin[axis] + 1);
      }
      for (std::int64_t z = piece.begin.z; z < piece.end.z; ++z) {
        for (std::int64_t y = piece.begin.y; y < piece.end.y; ++y) {
          for (std::int64_t x = piece.begin.x; x < piece.end.x; ++x) {
            has[static_cast<std::size_t>((z * kDims.y + y) * kDims.x + x)] = true;
          }
        }
      }
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto gap, FindGap(kDims, pieces));
    const bool is_tiled = std::find(has.begin(), has.end(), false) == has.end();
    ASSERT_EQ(!gap.has_value(), is_tiled) << round;
    if (gap.has_value()) {
      ++gaps;
      EXPECT_FALSE(has[static_cast<std::size_t>((gap->z * kDims.y + gap->y) * kDims.x + gap->x)]);
    }
  }
  EXPECT_GT(gaps, 100);
  EXPECT_LT(gaps, 1900);
}

}  // namespace
}  // namespace isoscope::source
