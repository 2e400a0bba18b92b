#include "core/formats/stacks/ome_stack.h"

#include <cstdint>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/math/vec.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

std::string Ome(const std::string& attributes, const std::string& inside) {
  return absl::StrCat(
      "<?xml version=\"1.0\"?>\n<OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\">"
      "<Image ID=\"Image:0\"><Pixels SizeX=\"4\" SizeY=\"3\" ",
      attributes, ">", inside, "</Pixels></Image></OME>");
}

constexpr char kSizes[] = "SizeZ=\"2\" SizeC=\"3\" SizeT=\"2\" DimensionOrder=\"XYZCT\" ";

TEST(OmeStackTest, SizesUnitsNamesAndTimesComeFromTheTags) {
  const std::string xml =
      Ome(absl::StrCat(kSizes,
                       "PhysicalSizeX=\"500\" PhysicalSizeXUnit=\"nm\" PhysicalSizeY=\"0.25\" "
                       "PhysicalSizeZ=\"0.002\" PhysicalSizeZUnit=\"mm\" TimeIncrement=\"1.5\" "
                       "TimeIncrementUnit=\"min\""),
          "<Channel ID=\"c0\" Name=\"DAPI\"/><Channel ID=\"c1\"/><Channel Name=\"GFP\"/>"
          "<TiffData/>");
  EXPECT_TRUE(IsOmeXml(xml));
  EXPECT_FALSE(IsOmeXml("<svg/>"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OmeStack ome, ParseOmeXml(xml, "/d/a.tif", "a.tif", 12));
  const StackLayout& layout = ome.layout;
  EXPECT_EQ(ome.size_x, 4);
  EXPECT_EQ(ome.size_y, 3);
  EXPECT_EQ(layout.slices, 2);
  EXPECT_EQ(layout.channels, 3);
  EXPECT_EQ(layout.steps, 2);
  EXPECT_EQ(layout.length_unit, "nm");
  EXPECT_NEAR(layout.spacing.x, 500, 0);
  EXPECT_NEAR(layout.spacing.y, 250, 1e-9);  // micrometres, where no unit is given
  EXPECT_NEAR(layout.spacing.z, 2000, 1e-9);
  EXPECT_THAT(layout.channel_names, ElementsAre("DAPI", "", "GFP"));
  EXPECT_THAT(layout.times, ElementsAre(0, 1.5));
  EXPECT_EQ(layout.time_unit, "min");
  EXPECT_EQ(layout.PlaneOf(1, 2, 1).index, (1 * 3 + 2) * 2 + 1);
}

TEST(OmeStackTest, TheOrderSaysWhichAxisIsTheFastest) {
  const auto index_of = [](const char* order) {
    const std::string xml = absl::StrReplaceAll(Ome(kSizes, ""), {{"XYZCT", order}});
    const auto ome = ParseOmeXml(xml, "a.tif", "a.tif", 12);
    return ome.ok() ? ome->layout.PlaneOf(1, 2, 1).index : -1;
  };
  EXPECT_EQ(index_of("XYZCT"), 1 + 2 * 2 + 1 * 6);
  EXPECT_EQ(index_of("XYCZT"), 2 + 1 * 3 + 1 * 6);
  EXPECT_EQ(index_of("XYTCZ"), 1 + 2 * 2 + 1 * 6);
  EXPECT_EQ(index_of("XYCTZ"), 2 + 1 * 3 + 1 * 6);
  for (const char* order : {"XYZC", "ZCTXY", "XYZZT", ""}) {
    EXPECT_EQ(index_of(order), -1) << order;
  }
}

TEST(OmeStackTest, TiffDataGiveEachPlaneItsPage) {
  // Steps in two files, backwards in the second one.
  const std::string xml =
      Ome(kSizes,
          "<TiffData IFD=\"1\" PlaneCount=\"5\"><UUID FileName=\"a.tif\">urn</UUID></TiffData>"
          "<TiffData IFD=\"0\" FirstZ=\"1\" FirstC=\"2\"><UUID FileName=\"a.tif\"/></TiffData>"
          "<TiffData IFD=\"4\" FirstT=\"1\" PlaneCount=\"2\"><UUID FileName=\"b.tif\"/></TiffData>"
          "<TiffData IFD=\"2\" FirstT=\"1\" FirstC=\"1\" PlaneCount=\"2\"><UUID "
          "FileName=\"b.tif\"/></TiffData>"
          "<TiffData IFD=\"0\" FirstT=\"1\" FirstC=\"2\"><UUID FileName=\"b.tif\"/></TiffData>");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OmeStack ome, ParseOmeXml(xml, "d/a.tif", "a.tif", 6));
  const StackLayout& layout = ome.layout;
  EXPECT_THAT(layout.files, ElementsAre("a.tif", "b.tif"));
  EXPECT_EQ(layout.PlaneOf(0, 0, 0).index, 1);
  EXPECT_EQ(layout.PlaneOf(0, 2, 0).index, 5);
  EXPECT_EQ(layout.PlaneOf(0, 2, 1).index, 0);
  EXPECT_EQ(layout.PlaneOf(1, 0, 1).file, 1);
  EXPECT_EQ(layout.PlaneOf(1, 0, 1).index, 5);
  EXPECT_EQ(layout.PlaneOf(1, 1, 0).index, 2);
  EXPECT_EQ(layout.PlaneOf(1, 2, 0).index, 0);
  EXPECT_EQ(layout.PlaneOf(1, 2, 1).file, -1);  // nobody names it
}

TEST(OmeStackTest, EachPlaneHasOnePageAndEachPageOnePlane) {
  const auto refusal = [](const std::string& data, std::int64_t pages) {
    return std::string(
        ParseOmeXml(Ome(kSizes, data), "/d/a.tif", "a.tif", pages).status().message());
  };
  EXPECT_THAT(refusal("<TiffData IFD=\"0\" PlaneCount=\"11\"/>"
                      "<TiffData IFD=\"11\" FirstZ=\"0\" FirstC=\"2\" FirstT=\"1\"/>",
                      12),
              HasSubstr("/d/a.tif: OME-XML: its TiffData give slice 0 of channel 2 and step 1 two "
                        "pages, IFD 10 and IFD 11"));
  EXPECT_THAT(refusal("<TiffData IFD=\"0\" PlaneCount=\"11\"/>"
                      "<TiffData IFD=\"3\" FirstZ=\"1\" FirstC=\"2\" FirstT=\"1\"/>",
                      11),
              HasSubstr("give slice 1 of channel 1 and step 0 and slice 1 of channel 2 and step 1 "
                        "one page, IFD 3"));
  EXPECT_THAT(refusal("<TiffData/>", 13),
              HasSubstr("2 slices, 3 channels and 2 steps take 12 of the 13 pages"));
  // The same once more says nothing else.
  EXPECT_EQ(refusal("<TiffData/><TiffData IFD=\"2\" FirstZ=\"0\" FirstC=\"1\"/>", 12), "");
  // The other pages may be those of another image.
  const std::string two = absl::StrReplaceAll(
      Ome(kSizes, "<TiffData/>"),
      {{"</Image>", "</Image><Image><Pixels SizeX=\"4\" SizeY=\"3\"/></Image>"}});
  ISOSCOPE_EXPECT_OK(ParseOmeXml(two, "/d/a.tif", "a.tif", 13).status());
}

TEST(OmeStackTest, AFileThatWasRenamedIsMeantByItsOldName) {
  const TempDir dir;
  const std::string xml = Ome(kSizes, "<TiffData><UUID FileName=\"old.tif\"/></TiffData>");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OmeStack ome,
                                ParseOmeXml(xml, dir.Sub("new.tif"), "new.tif", 12));
  EXPECT_THAT(ome.layout.files, ElementsAre("new.tif"));
  EXPECT_EQ(ome.layout.PlaneOf(1, 2, 1).index, 11);
  WriteFile(dir.Sub("old.tif"), "");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OmeStack other,
                                ParseOmeXml(xml, dir.Sub("new.tif"), "new.tif", 12));
  EXPECT_THAT(other.layout.files, ElementsAre("old.tif"));
}

TEST(OmeStackTest, ACompanionHoldsTheTagsInPlaceOfTheFile) {
  const std::string xml = "<OME><BinaryOnly MetadataFile=\"a.companion.ome\" UUID=\"u\"/></OME>";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OmeStack ome, ParseOmeXml(xml, "a.tif", "a.tif", 1));
  EXPECT_EQ(ome.companion, "a.companion.ome");
  EXPECT_THAT(ParseOmeXml("<OME/>", "a.tif", "a.tif", 1).status(),
              StatusIs(kInvalid, HasSubstr("without a tag Pixels")));
}

TEST(OmeStackTest, HostileXmlIsRefusedWithASentence) {
  const auto refusal = [](const std::string& xml) {
    return std::string(ParseOmeXml(xml, "/d/a.tif", "a.tif", 12).status().message());
  };
  for (const char* name : {"../b.tif", "/etc/passwd", "..", "a\\\\b.tif"}) {
    EXPECT_THAT(
        refusal(Ome(kSizes, absl::StrCat("<TiffData><UUID FileName=\"", name, "\"/></TiffData>"))),
        HasSubstr("expected a name without a folder"))
        << name;
    EXPECT_THAT(refusal(absl::StrCat("<OME><BinaryOnly MetadataFile=\"", name, "\"/></OME>")),
                HasSubstr("expected a name without a folder"));
  }
  EXPECT_THAT(refusal("<!DOCTYPE OME [<!ENTITY a \"aaaa\"><!ENTITY b \"&a;&a;\">]><OME>&b;</OME>"),
              HasSubstr("DOCTYPE"));
  EXPECT_THAT(refusal("<OME><Image>"), HasSubstr("or it is cut"));
  EXPECT_THAT(refusal(absl::StrReplaceAll(Ome(kSizes, ""), {{"SizeZ=\"2\"", "SizeZ=\"999999\""}})),
              HasSubstr("at most 1000000 planes"));
  EXPECT_THAT(refusal(absl::StrReplaceAll(Ome(kSizes, ""), {{"SizeZ=\"2\"", "SizeZ=\"-2\""}})),
              HasSubstr("SizeZ=\"-2\""));
  EXPECT_THAT(refusal(Ome(absl::StrCat(kSizes, "PhysicalSizeX=\"0\""), "")),
              HasSubstr("expected a length"));
  EXPECT_THAT(refusal(Ome(absl::StrCat(kSizes,
                                       "PhysicalSizeX=\"1\" PhysicalSizeY=\"1\" "
                                       "PhysicalSizeYUnit=\"reference frame\""),
                          "")),
              HasSubstr("expected one unit"));
  std::string many;
  for (int i = 0; i < 30; ++i) {
    many += "<TiffData IFD=\"0\" PlaneCount=\"1000000\"/>";
  }
  EXPECT_THAT(refusal(Ome(kSizes, many)), HasSubstr("more than twice"));
}

}  // namespace
}  // namespace isoscope::source
