#include "core/source/chunks/chunk_box.h"

#include <limits>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/chunk_writer.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::PlainArray;

TEST(ChunkBoxTest, FindsTheChunksOfABox) {
  const ChunkGrid grid({10, 7}, {4, 3});
  EXPECT_EQ(grid.counts(), (ChunkIndex{3, 3}));
  EXPECT_EQ(grid.ChunksOf({.begin = {3, 3}, .end = {9, 6}}), (ChunkBox{{0, 1}, {3, 2}}));
  EXPECT_EQ(grid.ChunksOf({.begin = {4, 6}, .end = {8, 7}}), (ChunkBox{{1, 2}, {2, 3}}));
  EXPECT_EQ(grid.ElementsOf({2, 2}), (ChunkBox{{8, 6}, {12, 9}}));
  EXPECT_EQ(grid.NumberOf({2, 1}), 7);
}

TEST(ChunkBoxTest, MultipliesWithinALimit) {
  constexpr std::int64_t kMax = std::numeric_limits<std::int64_t>::max();
  EXPECT_EQ(CheckedVolume({2, 3, 4}, 2, 48), 24);
  EXPECT_EQ(CheckedVolume({2, 3, 4}, 2, 47), -1);
  EXPECT_EQ(CheckedVolume({kMax, kMax, kMax}, 8, kMax), -1);
  EXPECT_EQ(CheckedVolume({kMax, 0, kMax}, 8, kMax), 0);
  EXPECT_EQ(CheckedVolume({kMax, 2, 0}, 8, kMax), 0);
  EXPECT_EQ(CheckedVolume({}, 8, 8), 1);
}

TEST(ChunkBoxTest, GoesThroughIndexesInOrder) {
  const ChunkBox box{.begin = {1, 5}, .end = {3, 7}};
  ChunkIndex index = box.begin;
  std::string seen = DescribeIndex(index);
  while (NextIndex(box, &index)) {
    seen += DescribeIndex(index);
  }
  EXPECT_EQ(seen, "(1, 5)(1, 6)(2, 5)(2, 6)");
}

// All boxes of a small array, compared with element after element.
TEST(ChunkBoxTest, CopiesAndFillsParts) {
  const ChunkIndex dims = {3, 4, 2};
  for (const std::size_t size : {std::size_t{1}, std::size_t{2}, std::size_t{8}}) {
    const PlainArray array = PlainArray::Counting(dims, size);
    ChunkIndex begin(3, 0);
    do {
      ChunkIndex span(3, 1);
      do {
        ChunkBox part{.begin = begin, .end = begin};
        for (std::size_t axis = 0; axis < 3; ++axis) {
          part.end[axis] += span[axis];
        }
        if (IntersectionOf(part, BoxOf(dims)) != part) {
          continue;
        }
        const std::string cut = array.Cut(part, "");
        std::string out(cut.size(), '?');
        CopyPart(part, size, BoxOf(dims), array.bytes.data(), part, out.data());
        ASSERT_EQ(out, cut);
        // Back into an array of fills, and fill it again.
        const std::string element = std::string("12345678").substr(0, size);
        std::string all(array.bytes.size(), 'z');
        CopyPart(part, size, part, cut.data(), BoxOf(dims), all.data());
        const PlainArray copied{.dims = dims, .element_size = size, .bytes = all};
        ASSERT_EQ(copied.Cut(part, ""), cut);
        ASSERT_EQ(static_cast<std::size_t>(std::count(all.begin(), all.end(), 'z')) >=
                      all.size() - cut.size(),
                  true);
        FillPart(part, element, BoxOf(dims), all.data());
        std::string expected;
        while (expected.size() < cut.size()) {
          expected += element;
        }
        ASSERT_EQ((PlainArray{.dims = dims, .element_size = size, .bytes = all}).Cut(part, ""),
                  expected);
      } while (NextIndex({.begin = {1, 1, 1}, .end = {4, 5, 3}}, &span));
    } while (NextIndex(BoxOf(dims), &begin));
  }
}

}  // namespace
}  // namespace isoscope::source
