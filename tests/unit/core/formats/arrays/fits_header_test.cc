#include "core/formats/arrays/fits_header.h"

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/folder_test.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/arrays/fits_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::FitsCubeCards;
using ::isoscope::testing::FitsPartBytes;
using ::isoscope::testing::Gzip;
using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class FitsHeaderTest : public testing::FolderTest {};

TEST_F(FitsHeaderTest, ValuesAreReadAsTheStandardWritesThem) {
  FitsCards cards;
  for (const char* card :
       {"BSCALE  =              1.5D+02 / comment", "OBJECT  = 'O''Brien / x  ' / comment",
        "NAXIS   =                    3", "COMMENT = none", "HISTORY text", "BITPIX  = -32/x",
        "TWICE   = 1", "TWICE   = 2", "SAME    = 7", "SAME    = 7", "EMPTY   = ''"}) {
    std::string text = card;
    text.resize(80, ' ');
    ISOSCOPE_EXPECT_OK(cards.Add(text));
  }
  EXPECT_EQ(*cards.Number("BSCALE", 0), 150);
  EXPECT_EQ(cards.Text("OBJECT"), "O'Brien / x");
  EXPECT_EQ(*cards.Integer("NAXIS", 0), 3);
  EXPECT_EQ(*cards.Integer("BITPIX", 0), -32);
  EXPECT_EQ(*cards.Integer("SAME", 0), 7);
  EXPECT_EQ(*cards.Integer("NONE", 5), 5);
  EXPECT_TRUE(cards.Has("EMPTY"));
  EXPECT_THAT(cards.Integer("TWICE", 0), StatusIs(kInvalid, HasSubstr("another value")));
  EXPECT_THAT(cards.Integer("OBJECT", 0), StatusIs(kInvalid, HasSubstr("one integer")));
  EXPECT_THAT(cards.Number("OBJECT", 0), StatusIs(kInvalid, HasSubstr("one number")));
  std::string open = "OPEN    = 'no end";
  open.resize(80, ' ');
  EXPECT_THAT(cards.Add(open), StatusIs(kInvalid, HasSubstr("has no end")));
  EXPECT_THAT(cards.Add(std::string(80, '\1')), StatusIs(kInvalid, HasSubstr("printable ASCII")));
}

TEST_F(FitsHeaderTest, PartsAreFoundBehindEachOther) {
  const std::string bytes =
      FitsPartBytes({"SIMPLE  = T", "BITPIX  = 8", "NAXIS   = 0", "EXTEND  = T"}, "") +
      FitsPartBytes({"XTENSION= 'BINTABLE'", "BITPIX  = 8", "NAXIS   = 2", "NAXIS1  = 10",
                     "NAXIS2  = 300", "PCOUNT  = 5", "GCOUNT  = 1"},
                    std::string(3005, 't')) +
      FitsPartBytes(FitsCubeCards(16, {"EXTNAME = 'SCI     '"}, "XTENSION= 'IMAGE   '"),
                    std::string(48, 'a'));
  for (const std::string& path : {Write("a.fits", bytes), Write("a.fits.gz", Gzip(bytes)),
                                  Write("zeros.fits", bytes + std::string(100, '\0'))}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FitsFile file, ReadFitsFile(path));
    ASSERT_EQ(file.parts.size(), 3U);
    EXPECT_TRUE(file.parts[0].axes.empty());
    EXPECT_FALSE(file.parts[1].is_image);
    const FitsPart& part = file.parts[2];
    EXPECT_TRUE(part.is_image);
    EXPECT_EQ(part.name, "SCI");
    EXPECT_EQ(part.bits, 16);
    EXPECT_THAT(part.axes, ElementsAre(4, 3, 2));
    EXPECT_EQ(part.samples_start, 2880 + 2880 + 5760 + 2880);
  }
}

TEST_F(FitsHeaderTest, OtherBytesAreRefused) {
  const auto error = [&](const std::string& bytes) {
    return ReadFitsFile(Write("bad.fits", bytes)).status();
  };
  const std::string good = FitsPartBytes(FitsCubeCards(8), std::string(24, 'a'));
  EXPECT_THAT(error("text"), StatusIs(kInvalid, HasSubstr("not a FITS file")));
  EXPECT_THAT(error(good.substr(0, 2000)), StatusIs(kInvalid, HasSubstr("it is cut")));
  EXPECT_THAT(error(good + "XTENSION= 'IMAGE'"), StatusIs(kInvalid, HasSubstr("it is cut")));
  EXPECT_THAT(error(good + std::string(2880, 'x')), StatusIs(kInvalid, HasSubstr("no other part")));
  struct Case {
    std::vector<std::string> cards;
    const char* message;
  };
  for (const Case& c : std::vector<Case>{
           {{"SIMPLE  = T"}, "BITPIX 0"},
           {{"SIMPLE  = T", "BITPIX  = 12", "NAXIS   = 0"}, "BITPIX 12"},
           {{"SIMPLE  = T", "BITPIX  = 8"}, "NAXIS -1"},
           {{"SIMPLE  = T", "BITPIX  = 8", "NAXIS   = 1000"}, "NAXIS 1000"},
           {{"SIMPLE  = T", "BITPIX  = 8", "NAXIS   = 1"}, "NAXIS1 is -1 or missing"},
           {{"SIMPLE  = T", "BITPIX  = 8", "NAXIS   = 1", "NAXIS1  = -5"}, "NAXIS1 is -5"},
           {{"SIMPLE  = T", "BITPIX  = x", "NAXIS   = 0"}, "BITPIX is \"x\""},
           {{"SIMPLE  = T", "BITPIX  = 8", "BITPIX  = 16", "NAXIS   = 0"}, "another value"},
           {{"SIMPLE  = T", "BITPIX  = 64", "NAXIS   = 2", "NAXIS1  = 4000000000000",
             "NAXIS2  = 4000000000000"},
            "more samples than any file holds"},
           {{"SIMPLE  = T", "BITPIX  = 64", "NAXIS   = 1", "NAXIS1  = 9000000000000000000"},
            "more samples than any file holds"}}) {
    EXPECT_THAT(error(FitsPartBytes(c.cards, "")), StatusIs(kInvalid, HasSubstr(c.message)))
        << c.message;
  }
  std::string endless = good.substr(0, 480);
  endless.resize(5'000'000, ' ');
  EXPECT_THAT(error(endless), StatusIs(kInvalid, HasSubstr("no END in")));
  EXPECT_TRUE(IsFits(good));
}

}  // namespace
}  // namespace isoscope::source
