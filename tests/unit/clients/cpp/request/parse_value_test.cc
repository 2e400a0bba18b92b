#include "clients/cpp/request/parse_value.h"

#include <limits>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

// Each of `texts` is refused with a message that quotes it.
template <typename Parser>
void ExpectRefused(Parser parse, const std::vector<std::string>& texts) {
  for (const std::string& text : texts) {
    SCOPED_TRACE("'" + text + "'");
    EXPECT_THAT(parse(text),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("'" + text + "' is not ")));
  }
}

TEST(ParseValueTest, IntegersKeepTheirLimits) {
  const auto parse = [](absl::string_view text) { return ParseInteger(text, 1, 16384); };
  EXPECT_EQ(*parse("1"), 1);
  EXPECT_EQ(*parse("16384"), 16384);
  ExpectRefused(parse,
                {"0", "-1", "16385", "", "1.5", "1e3", "0x10", "12px", "99999999999999999999"});
  EXPECT_THAT(parse("0"), StatusIs(absl::StatusCode::kInvalidArgument,
                                   HasSubstr("a whole number from 1 to 16384")));
}

TEST(ParseValueTest, SeedsTakeAll64Bits) {
  EXPECT_EQ(*ParseUnsigned("18446744073709551615"), std::numeric_limits<std::uint64_t>::max());
  ExpectRefused(ParseUnsigned, {"18446744073709551616", "-1", "", "1.0"});
}

TEST(ParseValueTest, NumbersAreFinite) {
  EXPECT_EQ(*ParseNumber("-1.5e3"), -1500);
  ExpectRefused(ParseNumber, {"", "nan", "inf", "-inf", "1e999", "1,5", "abc"});
  ExpectRefused(ParsePositiveNumber, {"0", "-1", "nan", "inf"});
}

TEST(ParseValueTest, VectorsHaveThreeFiniteNumbers) {
  EXPECT_EQ(*ParseVector("1,-2.5,3e2"), (math::Vec3d{1, -2.5, 300}));
  ExpectRefused(ParseVector,
                {"", "1", "1,2", "1,2,3,4", "1,2,", ",,", "1;2;3", "a,b,c", "1,nan,3", "1,2,inf"});
  ExpectRefused(ParsePositiveVector, {"1,0,1", "1,1,-1"});
}

TEST(ParseValueTest, DimsAreWholeNumbersOfAtLeastTwo) {
  EXPECT_EQ(*ParseDims("512,2,234"), (math::Index3{512, 2, 234}));
  ExpectRefused(ParseDims,
                {"512,512", "1,512,512", "0,2,2", "-2,2,2", "2.5,2,2", "2x2x2", "2,2,2,2"});
}

TEST(ParseValueTest, BlockCellsAreOneNumberOrThree) {
  EXPECT_EQ(*ParseBlockCells("8"), (math::Index3{8, 8, 8}));
  EXPECT_EQ(*ParseBlockCells("8x16x128"), (math::Index3{8, 16, 128}));
  ExpectRefused(ParseBlockCells, {"0", "129", "8x8", "8,8,8", "8x8x8x8", "8x0x8", "x", ""});
}

TEST(ParseValueTest, ByteSizesTakeAllSuffixes) {
  EXPECT_EQ(*ParseByteSize("1"), 1);
  EXPECT_EQ(*ParseByteSize("4096"), 4096);
  EXPECT_EQ(*ParseByteSize("2K"), 2048);
  EXPECT_EQ(*ParseByteSize("2KiB"), 2048);
  EXPECT_EQ(*ParseByteSize("512MiB"), std::int64_t{512} << 20);
  EXPECT_EQ(*ParseByteSize("512M"), std::int64_t{512} << 20);
  EXPECT_EQ(*ParseByteSize("1.5G"), std::int64_t{3} << 29);
  EXPECT_EQ(*ParseByteSize("3GiB"), std::int64_t{3} << 30);
  EXPECT_EQ(*ParseByteSize("1T"), std::int64_t{1} << 40);
  ExpectRefused(ParseByteSize, {"", "0", "-1", "0.1", "K", "KiB", "1KB", "1k", "1 K", "1GiBx",
                                "infK", "nan", "1e30T", "9e18"});
}

TEST(ParseValueTest, SecondsTakeUnits) {
  EXPECT_EQ(*ParseSeconds("30"), absl::Seconds(30));
  EXPECT_EQ(*ParseSeconds("1.5s"), absl::Milliseconds(1500));
  EXPECT_EQ(*ParseSeconds("2m"), absl::Minutes(2));
  ExpectRefused(ParseSeconds, {"", "0", "-1", "inf", "nan", "soon", "-2s"});
}

TEST(ParseValueTest, ColorsStayBetweenZeroAndOne) {
  EXPECT_EQ(*ParseColor("1,0.5,0"), (frame::Color{1, 0.5F, 0, 1}));
  EXPECT_EQ(*ParseColorWithAlpha("1,0.5,0,0.25"), (frame::Color{1, 0.5F, 0, 0.25F}));
  EXPECT_EQ(*ParseColorWithAlpha("0,0,0"), (frame::Color{0, 0, 0, 1}));
  ExpectRefused(ParseColor, {"1,1,1,1", "1,1", "1.1,0,0", "-0.1,0,0", "reddish"});
  ExpectRefused(ParseColorWithAlpha, {"1,1,1,2", "1,1,1,1,1"});
}

TEST(ParseValueTest, ColorsMayBeNamesAndHexDigitsAsInCss) {
  EXPECT_EQ(*ParseColor("red"), (frame::Color{1, 0, 0, 1}));
  EXPECT_EQ(*ParseColor("Teal"), (frame::Color{0, 128 / 255.0F, 128 / 255.0F, 1}));
  EXPECT_EQ(*ParseColor("aliceblue"), *ParseColor("#f0f8ff")) << "the first of the table";
  EXPECT_EQ(*ParseColor("yellowgreen"), *ParseColor("#9ACD32")) << "the last of the table";
  EXPECT_EQ(*ParseColor("#0f8"), *ParseColor("#00ff88"));
  EXPECT_EQ(*ParseColor("#00ff88"), (frame::Color{0, 1, 136 / 255.0F, 1}));
  EXPECT_EQ(*ParseColorWithAlpha("#00ff8880"), (frame::Color{0, 1, 136 / 255.0F, 128 / 255.0F}));
  EXPECT_EQ(*ParseColorWithAlpha("#0f88"), *ParseColorWithAlpha("#00ff8888"));
  EXPECT_EQ(*ParseColorWithAlpha("navy"), (frame::Color{0, 0, 128 / 255.0F, 1}));
  ExpectRefused(ParseColor, {"#", "#12", "#12345", "#1234567", "#ff00ff00", "#f0f0", "#gg0000",
                             "#0x1234", "# 12345", "#-12345", "", "tea l", "x"});
  ExpectRefused(ParseColorWithAlpha, {"#12345", "#1234567", "#123456789"});
  EXPECT_EQ(ParseSurface("30:teal:0.5")->color,
            (frame::Color{0, 128 / 255.0F, 128 / 255.0F, 0.5F}));
  EXPECT_EQ(ParseSurface("30:#008080")->color, *ParseColor("teal"));
}

TEST(ParseValueTest, SurfacesHaveALevelAndPerhapsAColour) {
  EXPECT_EQ(*ParseSurface("-7.5"), (SurfaceValue{.isovalue = -7.5, .color = {}}));
  EXPECT_EQ(*ParseSurface("30:1,0.5,0"),
            (SurfaceValue{.isovalue = 30, .color = frame::Color{1, 0.5F, 0, 1}}));
  EXPECT_EQ(*ParseSurface("30:1,0.5,0:0.25"),
            (SurfaceValue{.isovalue = 30, .color = frame::Color{1, 0.5F, 0, 0.25F}}));
  ExpectRefused(ParseSurface, {"", ":1,0,0", "30:", "30:reddish", "30:1,0", "x:1,0,0", "nan",
                               "30:1,1,1:0", "30:1,1,1:1.5", "30:1,1,1:-1", "30:1,1,1:nan",
                               "30:1,1,1:", "30:1,1,1:0.5:1", "30:0.5"});
}

TEST(ParseValueTest, PlanesAndBoxesAreListsOfNumbers) {
  EXPECT_EQ(*ParsePlane("0,-1,0.5,20"), (PlaneValue{.normal = {0, -1, 0.5}, .offset = 20}));
  ExpectRefused(ParsePlane, {"", "1,0,0", "0,0,0,1", "1,0,0,inf", "1,0,0,2,3", "a,b,c,d"});
  const math::Box3d box = *ParseBox("0,10,-5,5,3,3");
  EXPECT_EQ(box.min, (math::Vec3d{0, -5, 3}));
  EXPECT_EQ(box.max, (math::Vec3d{10, 5, 3}));
  ExpectRefused(ParseBox, {"", "0,10,-5,5,3", "10,0,0,1,0,1", "0,1,0,1,0,1,0", "0,1,0,1,0,nan"});
}

TEST(ParseValueTest, RegionsAreFourWholeNumbers) {
  EXPECT_EQ(*ParseRegion("0,0,1,1"), (view::Region{0, 0, 1, 1}));
  EXPECT_EQ(*ParseRegion("60000,2,300,65536"), (view::Region{60000, 2, 300, 65536}));
  ExpectRefused(ParseRegion, {"", "1,2,3", "1,2,3,4,5", "-1,0,1,1", "0,0,0,1", "0,0,1,0",
                              "0,0,1.5,1", "a,0,1,1", "0,0,1,99999999999", "0,0,65537,1"});
}

TEST(ParseValueTest, ChoicesAreListedWhenNoneFits) {
  const std::vector<std::pair<std::string, int>> choices = {{"depth", 1}, {"mask", 2}};
  EXPECT_EQ(*ParseChoice("mask", choices), 2);
  EXPECT_THAT(ParseChoice("Mask", choices),
              StatusIs(absl::StatusCode::kInvalidArgument, "'Mask' is none of: depth, mask"));
}

}  // namespace
}  // namespace isoscope::client
