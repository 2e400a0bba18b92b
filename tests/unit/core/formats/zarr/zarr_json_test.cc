#include "core/formats/zarr/zarr_json.h"

#include <cmath>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

TEST(ZarrJsonTest, ReadsNumbersOfPython) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ZarrJson json,
      ParseZarrJson(R"({"a": NaN, "b": [1, -Infinity, Infinity], "NaN": "is NaN\" NaN", "c": 2})",
                    "x"));
  EXPECT_TRUE(std::isnan(*NumberOf(json["a"])));
  const double infinity = std::numeric_limits<double>::infinity();
  EXPECT_THAT(NumbersOf(json, "b"), ElementsAre(1, -infinity, infinity));
  EXPECT_EQ(TextOf(json, "NaN"), "is NaN\" NaN");
  EXPECT_THAT(NumbersOf(json, "c"), ElementsAre(2));
  EXPECT_THAT(NumbersOf(json, "NaN"), IsEmpty());
  EXPECT_THAT(NumbersOf(json, "none"), IsEmpty());
  EXPECT_EQ(TextOf(json, "c"), "");
  EXPECT_EQ(MemberOf(json["c"], "d"), nullptr);
}

TEST(ZarrJsonTest, RefusesWhatIsNoObject) {
  for (const char* text : {"", "[]", "3", "{", "{\"a\": }", "{\"a\": 1}}", "{\"a\": \"\\", "null",
                           "{\"a\": N}", "\xff\xfe"}) {
    EXPECT_THAT(ParseZarrJson(text, "f.zarr/zarr.json"),
                StatusIs(kInvalid, HasSubstr("f.zarr/zarr.json")))
        << text;
  }
  std::string deep = "{\"a\": ";
  deep += std::string(100'000, '[') + std::string(100'000, ']') + "}";
  EXPECT_THAT(ParseZarrJson(deep, "x"), StatusIs(kInvalid, HasSubstr("64 levels")));
}

TEST(ZarrJsonTest, NamesAPointerOfGitLfs) {
  EXPECT_THAT(ParseZarrJson("version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 3\n",
                            "f.zarr/.zattrs"),
              StatusIs(kInvalid, AllOf(HasSubstr("f.zarr/.zattrs: a Git LFS pointer"),
                                       HasSubstr("git lfs pull"))));
}

TEST(ZarrJsonTest, ShowsLittleOfAStrangersValue) {
  EXPECT_EQ(ShownJson(ZarrJson("a\x1b[2J")).find('\x1b'), std::string::npos);
  EXPECT_LT(ShownJson(ZarrJson(std::string(10'000, 'x'))).size(), 200U);
  EXPECT_EQ(ShownJson(ZarrJson(std::vector<int>(1000, 1))), "a list of 1000");
}

}  // namespace
}  // namespace isoscope::source
