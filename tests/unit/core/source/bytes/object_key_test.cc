#include "core/source/bytes/object_key.h"

#include <limits>
#include <string>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using testing::StatusIs;

TEST(ObjectKeyTest, AKeyLeadsBelowItsFolder) {
  for (const char* good : {"a", "c/0/1/2", ".zarray", "a..b/...", "é/ =+", ".zattrs/x"}) {
    ISOSCOPE_EXPECT_OK(CheckObjectKey(good));
  }
  ISOSCOPE_EXPECT_OK(CheckObjectKey(std::string(kMaxKeyBytes, 'k')));
  for (const std::string& bad :
       {std::string(), std::string("/a"), std::string("a/"), std::string("a//b"), std::string("."),
        std::string(".."), std::string("a/../b"), std::string("a/."), std::string("a\nb"),
        std::string("a\0b", 3), std::string(kMaxKeyBytes + 1, 'k')}) {
    EXPECT_THAT(CheckObjectKey(bad), StatusIs(absl::StatusCode::kInvalidArgument)) << bad;
  }
}

// Fields have the same names at an address and in a copy.
TEST(ObjectKeyTest, TheLastPartOfAnAddressIsDecodedWhereThatIsAName) {
  EXPECT_EQ(LastPartOfPath("https://host/a%20folder/two%3D2%2B%20%C3%A9.zarr/"),
            "two=2+ \u00e9.zarr");
  EXPECT_EQ(LastPartOfPath("http://host/100%"), "100%");
  EXPECT_EQ(LastPartOfPath("http://host/%zz%4"), "%zz%4");
  for (const char* const kept : {"a%2Fb", "a%0Ab", "%ff", "%00", "%2e"}) {
    EXPECT_EQ(LastPartOfPath(std::string("http://host/") + kept), kept);
  }
  EXPECT_EQ(LastPartOfPath("s3://bucket/a%20b.zarr"), "a%20b.zarr");
  EXPECT_EQ(LastPartOfPath("/data/a%20b.zarr/"), "a%20b.zarr");
  EXPECT_EQ(LastPartOfPath("run"), "run");
  EXPECT_EQ(LastPartOfPath("/"), "");
}

// Against a plain loop over the bytes of a small object.
TEST(ObjectKeyTest, ExtentsAreThoseOfALoop) {
  constexpr std::int64_t kObjectSize = 4;
  for (std::int64_t offset = -6; offset <= 6; ++offset) {
    for (std::int64_t size = -1; size <= 6; ++size) {
      const std::int64_t begin = offset < 0 ? kObjectSize + offset : offset;
      const std::int64_t end = size < 0 ? kObjectSize : begin + size;
      const bool is_within = begin >= 0 && begin <= kObjectSize && end <= kObjectSize;
      const auto extent =
          ExtentOf({.key = "k", .offset = offset, .size = size, .max_size = 2}, kObjectSize, "n");
      if (!is_within) {
        EXPECT_THAT(extent, StatusIs(absl::StatusCode::kOutOfRange)) << offset << " " << size;
      } else if (end - begin > 2) {
        EXPECT_THAT(extent, StatusIs(absl::StatusCode::kResourceExhausted));
      } else {
        ISOSCOPE_ASSERT_OK(extent);
        EXPECT_EQ(extent->offset, begin);
        EXPECT_EQ(extent->size, end - begin);
      }
    }
  }
  constexpr std::int64_t kLeast = std::numeric_limits<std::int64_t>::min();
  constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
  EXPECT_THAT(ExtentOf({.key = "k", .offset = kLeast, .size = kMost}, 4, "n"),
              StatusIs(absl::StatusCode::kOutOfRange));
  EXPECT_THAT(ExtentOf({.key = "k", .offset = kMost, .size = kMost}, 4, "n"),
              StatusIs(absl::StatusCode::kOutOfRange));
}

}  // namespace
}  // namespace isoscope::source
