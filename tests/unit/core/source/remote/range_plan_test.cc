#include "core/source/remote/range_plan.h"

#include <algorithm>
#include <string>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::source {
namespace {

TEST(RangePlanTest, JoinsNeighboursAndSplitsLongRanges) {
  std::string out(100, '\0');
  const std::vector<ByteRange> ranges = {{.offset = 50, .size = 10, .out = &out[0]},
                                         {.offset = 0, .size = 5, .out = &out[10]},
                                         {.offset = 8, .size = 2, .out = &out[20]},
                                         {.offset = 13, .size = 0, .out = nullptr},
                                         {.offset = 14, .size = 1, .out = &out[30]}};
  const auto pieces = PlanRanges(ranges, {.max_gap_bytes = 3, .max_piece_bytes = 4});
  ASSERT_EQ(pieces.size(), 7u);  // [0, 10) in 3, [14, 15), [50, 60) in 3
  EXPECT_EQ(pieces[0].begin, 0);
  EXPECT_EQ(pieces[0].end, 4);
  EXPECT_EQ(pieces[1].end, 7);
  EXPECT_EQ(pieces[2].end, 10);
  EXPECT_EQ(pieces[3].begin, 14);
  EXPECT_EQ(pieces[3].end, 15);
  EXPECT_EQ(pieces[6].end, 60);
  EXPECT_TRUE(PlanRanges({}, {}).empty());
}

// Random ranges against a copy of each: every byte comes, however the pieces are cut, and each is
// requested once.
TEST(RangePlanTest, EveryByteComesOnce) {
  constexpr std::int64_t kSize = 300;
  std::string object(kSize, '\0');
  for (std::size_t i = 0; i < object.size(); ++i) {
    object[i] = static_cast<char>(base::RandomBits(1, i));
  }
  for (std::uint64_t seed = 0; seed < 3000; ++seed) {
    std::uint64_t counter = 0;
    const auto draw = [&](std::int64_t below) {
      return static_cast<std::int64_t>(base::RandomBits(seed, counter++) %
                                       static_cast<std::uint64_t>(below));
    };
    std::vector<ByteRange> ranges(static_cast<std::size_t>(draw(8)));
    std::vector<std::string> outs(ranges.size());
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      ranges[i].offset = draw(kSize + 1);
      ranges[i].size = static_cast<std::size_t>(draw(kSize - ranges[i].offset + 1));
      outs[i].assign(ranges[i].size, '?');
      ranges[i].out = outs[i].data();
    }
    const RangeRules rules{.max_gap_bytes = draw(20), .max_piece_bytes = draw(60) + 1};
    const auto pieces = PlanRanges(ranges, rules);
    std::int64_t end = -1;
    for (const RangePiece& piece : pieces) {
      ASSERT_GE(piece.begin, std::max<std::int64_t>(end, 0));
      ASSERT_LT(piece.begin, piece.end);
      ASSERT_LE(piece.end - piece.begin, rules.max_piece_bytes);
      end = piece.end;
      PieceWriter writer(piece);
      while (writer.left_bytes() > 0) {
        const auto size = static_cast<std::size_t>(std::min(writer.left_bytes(), draw(30) + 1));
        writer.Append(
            absl::string_view(object).substr(static_cast<std::size_t>(writer.position()), size));
      }
      EXPECT_EQ(writer.position(), piece.end);
    }
    ASSERT_LE(end, kSize);
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      ASSERT_EQ(outs[i], object.substr(static_cast<std::size_t>(ranges[i].offset), ranges[i].size))
          << seed;
    }
  }
}

}  // namespace
}  // namespace isoscope::source
