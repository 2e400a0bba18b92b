#include "core/formats/label_names.h"

#include <optional>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using volume::Label;
using volume::LabelColor;

TEST(LabelNamesTest, LinesOfAColourTableAreRead) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<Label> labels,
                                ParseLabelNames("#No. Label Name:   R   G   B   A\n"
                                                "53  Right-Hippocampus   220 216 20 0\r\n"
                                                "\n"
                                                "  0   Unknown  0 0 0 0\n"
                                                "17\tleft hippocampus 1 2 255 0",
                                                "lut.txt"));
  EXPECT_THAT(labels, ElementsAre(Label{0, "Unknown", LabelColor{0, 0, 0}},
                                  Label{17, "left hippocampus", LabelColor{1, 2, 255}},
                                  Label{53, "Right-Hippocampus", LabelColor{220, 216, 20}}));
}

TEST(LabelNamesTest, LinesOfALabelDescriptionAreRead) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::vector<Label> labels,
      ParseLabelNames("################\n# IDX   -R-  -G-  -B-  -A--  VIS MSH  LABEL\n"
                      "    0     0    0    0        0  0  0    \"Clear Label\"\n"
                      "    3   255    0    9     0.75  1  1    \"lung, left \"\"upper\"\"\"\n",
                      "labels.txt"));
  EXPECT_THAT(labels, ElementsAre(Label{0, "Clear Label", LabelColor{0, 0, 0}},
                                  Label{3, "lung, left \"\"upper\"\"", LabelColor{255, 0, 9}}));
}

TEST(LabelNamesTest, LinesOfCsvAreReadWithAndWithoutColours) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<Label> labels,
                                ParseLabelNames("\xef\xbb\xbf"
                                                "Value,Name,Color\n"
                                                "2, spleen ,#00ff80\n"
                                                "1,\"lung, \"\"left\"\"\"\n"
                                                "2.5,half,\n"
                                                "-3,\n",
                                                "names.csv"));
  EXPECT_THAT(labels,
              ElementsAre(Label{-3, "", {}}, Label{1, "lung, \"left\"", {}},
                          Label{2, "spleen", LabelColor{0, 255, 128}}, Label{2.5, "half", {}}));
}

TEST(LabelNamesTest, LinesOfAListAreRead) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::vector<Label> labels,
      ParseLabelNames("2 Precentral_R 2002\n1 Precentral_L 2001\r\n0\tUnclassified\n\n",
                      "aal.txt"));
  EXPECT_THAT(labels, ElementsAre(Label{0, "Unclassified", {}}, Label{1, "Precentral_L", {}},
                                  Label{2, "Precentral_R", {}}));
}

TEST(LabelNamesTest, AListLiesBesideANiftiFile) {
  const testing::TempDir dir;
  EXPECT_EQ(LabelNamesBeside(dir.Sub("aal.nii.gz")), std::nullopt);
  testing::WriteFile(dir.Sub("aal.nii.txt"), "1 one\n");
  EXPECT_EQ(LabelNamesBeside(dir.Sub("aal.nii.gz")), dir.Sub("aal.nii.txt"));
  EXPECT_EQ(LabelNamesBeside(dir.Sub("aal.nii")), dir.Sub("aal.nii.txt"));
  testing::WriteFile(dir.Sub("aal.nrrd.txt"), "1 one\n");
  EXPECT_EQ(LabelNamesBeside(dir.Sub("aal.nrrd")), std::nullopt);
}

TEST(LabelNamesTest, NoLinesAreNoLabels) {
  for (const char* text : {"", "\n", "# nothing\n", "\xef\xbb\xbf", "value,name\n"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<Label> labels, ParseLabelNames(text, "f"));
    EXPECT_THAT(labels, IsEmpty()) << text;
  }
}

TEST(LabelNamesTest, AnotherLineIsQuotedWithItsNumberAndTheForms) {
  const auto refuses = [](const std::string& text, const char* what) {
    EXPECT_THAT(ParseLabelNames(text, "names.csv").status(),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         AllOf(HasSubstr("names.csv: "), HasSubstr(what))))
        << text;
  };
  refuses("1,a\n\nliver\n", "line 3: \"liver\"; expected VALUE NAME RED");
  refuses("1,a\nvalue,name\n", "line 2: \"value,name\"");
  refuses("1,a,red\n", "line 1");
  refuses("1,a,#ff000\n", "line 1");
  refuses("1,\"a\n", "line 1");
  refuses("1,\"a\"b\n", "line 1");
  refuses("1,a,#ff0000,x\n", "line 1");
  refuses("nan,a\n", "line 1");
  refuses("1e999,a\n", "line 1");
  refuses("1 name 256 0 0 0\n", "line 1");
  refuses("1 left lung\n", "line 1");
  refuses("1 0.5\n", "line 1");
  refuses("1 2 3\n", "line 1");
  refuses("1 name 0 0 -1 0\n", "line 1");
  refuses("1 0 0 0 1 1 \"name\"\n", "line 1");
  refuses("1 0 0 0 1 1 1 \"\n", "line 1");
  refuses("7,a\n-0,b\n7.0,c\n", "line 3: the value 7 has a name in line 1 already");
  refuses("-0,a\n0,b\n", "line 2: the value 0 has a name in line 1 already");
  refuses("1,a\x1b[2J\n", "line 1: the name of the label 1, \"a?[2J\"");
  refuses("1,\xc3\n", "no UTF-8");
  refuses("1," + std::string(257, 'n') + "\n", "257 bytes");
  refuses(std::string(1000, 'x') + "\n", "...\"; expected");
  std::string many;
  for (int i = 0; i <= 65536; ++i) {
    many += std::to_string(i) + ",\n";
  }
  refuses(many, "65537 labels");
}

TEST(LabelNamesTest, EveryCutOfAFileIsReadOrRefused) {
  const std::string text = "17 a 1 2 3 0\n18 1 2 3 1 1 1 \"b\"\n19,\"c,\"\"d\",#00ff80\n";
  for (std::size_t size = 0; size <= text.size(); ++size) {
    const std::string exact = text.substr(0, size);
    const auto labels = ParseLabelNames(exact, "f");
    EXPECT_TRUE(labels.ok() || absl::IsInvalidArgument(labels.status())) << size;
  }
}

TEST(LabelNamesTest, AFileIsReadUpToItsLimit) {
  const testing::TempDir dir;
  testing::WriteFile(dir.Sub("names.csv"), "1,one\n");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<Label> labels,
                                ReadLabelNames(dir.Sub("names.csv")));
  EXPECT_THAT(labels, ElementsAre(Label{1, "one", {}}));
  testing::WriteFile(dir.Sub("large.csv"), std::string((16U << 20) + 1, '\n'));
  EXPECT_THAT(ReadLabelNames(dir.Sub("large.csv")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("large.csv")));
  EXPECT_THAT(ReadLabelNames(dir.Sub("absent.csv")).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("absent.csv")));
}

}  // namespace
}  // namespace isoscope::source
