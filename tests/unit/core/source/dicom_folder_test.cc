#include "core/source/dicom_folder.h"

#include <filesystem>
#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/stat.h>

#include "tests/support/dicom_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::DicomBytes;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::WriteFile;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr auto kNotFound = absl::StatusCode::kNotFound;

class DicomFolderTest : public ::testing::Test {
 protected:
  // A slice of 12 x 9 in a series of that number, whose UID is 1.2.number.
  std::string Slice(int series, int z, const std::string& description = "") const {
    return DicomBytes({.series = absl::StrCat("1.2.", series),
                       .position = absl::StrCat("0\\0\\", z),
                       .number = z,
                       .description = description,
                       .series_number = series},
                      pixels_);
  }
  // Three slices of series 7, and two of 3, "T1 axial".
  void WriteTwoSeries() const {
    for (int z = 0; z < 3; ++z) {
      WriteFile(dir_.Sub(absl::StrCat("7-", z)), Slice(7, z));
      if (z < 2) {
        WriteFile(dir_.Sub(absl::StrCat("3-", z)), Slice(3, z, "T1 axial"));
      }
    }
  }
  // A report: it has no pixels.
  static std::string Report() {
    const std::string whole = DicomBytes({.storage_class = "1.2.840.10008.5.1.4.1.1.88.33"}, "");
    return whole.substr(0, whole.size() - 12);
  }

  testing::TempDir dir_;
  const std::string pixels_ = std::string(12 * 9 * 2, 'p');
  DicomDecoder decoder_;
};

TEST_F(DicomFolderTest, FilesAreThoseWithTheMarkByNameWithoutTheIndex) {
  WriteFile(dir_.Sub("b"), Slice(7, 0));
  WriteFile(dir_.Sub("a"), std::string(128, 'x') + "DICM");
  WriteFile(dir_.Sub("DICOMDIR"), Slice(7, 0));
  WriteFile(dir_.Sub("c"), std::string(128, 'x') + "DICN");
  WriteFile(dir_.Sub("d"), std::string(128, 'x') + "DIC");
  EXPECT_THAT(DicomFilesIn(dir_.path()), ElementsAre(dir_.Sub("a"), dir_.Sub("b")));
  EXPECT_THAT(DicomFilesIn(dir_.Sub("none")), IsEmpty());
  EXPECT_TRUE(HasDicomFile(dir_.path()));
  EXPECT_FALSE(HasDicomFile(dir_.Sub("none")));
  EXPECT_TRUE(IsDicomFile(dir_.Sub("DICOMDIR")));
  EXPECT_FALSE(IsDicomFile(dir_.Sub("c")));
  EXPECT_FALSE(IsDicomFile(dir_.Sub("none")));
}

TEST_F(DicomFolderTest, FolderOfOthersHasNoDicomFile) {
  WriteFile(dir_.Sub("DICOMDIR"), Slice(7, 0));
  WriteFile(dir_.Sub("notes"), "notes");
  EXPECT_FALSE(HasDicomFile(dir_.path()));
}

TEST_F(DicomFolderTest, SliceThatCantBeOpenedIsAnErrorAndNotLeftOut) {
  WriteTwoSeries();
  std::filesystem::create_directory(dir_.Sub("more"));
  WriteFile(dir_.Sub("notes"), "no slice");
  ASSERT_EQ(mkfifo(dir_.Sub("pipe").c_str(), 0600), 0);
  EXPECT_THAT(DicomCandidatesIn(dir_.path()), ::testing::SizeIs(6)) << "slices and notes";
  EXPECT_TRUE(FindDicomSeries(dir_.Sub("7-0"), &decoder_).ok());
  std::filesystem::create_symlink(dir_.Sub("away"), dir_.Sub("7-3"));  // a slice, or not
  EXPECT_THAT(FindDicomSeries(dir_.Sub("7-0"), &decoder_).status(),
              StatusIs(kNotFound, AllOf(HasSubstr(dir_.Sub("7-3")), HasSubstr("may be a slice"))));
  EXPECT_THAT(ListDicomSeries(dir_.path()).status(), StatusIs(kNotFound, HasSubstr("7-3")));
}

TEST_F(DicomFolderTest, FolderIsThePathOrThatOfTheFile) {
  EXPECT_EQ(DicomFolder(dir_.path()), dir_.path());
  EXPECT_EQ(DicomFolder(dir_.Sub("7-0")), dir_.path());
  EXPECT_EQ(DicomFolder("no-such-file.dcm"), ".");
}

TEST_F(DicomFolderTest, SeriesAreListedByNumberAndOneIsChosenByNumberOrUid) {
  WriteTwoSeries();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto entries, ListDicomSeries(dir_.path()));
  ASSERT_EQ(entries.size(), 2U);
  EXPECT_EQ(entries[0].uid, "1.2.3");
  EXPECT_EQ(entries[0].images, 2);
  EXPECT_EQ(entries[0].first_file, dir_.Sub("3-0"));
  EXPECT_EQ(entries[1].number, 7);
  EXPECT_EQ(DescribeDicomSeries(entries[0]), "3 \"T1 axial\", 2 images of 12 x 9");
  EXPECT_EQ(DescribeDicomSeries(entries[1]), "7, 3 images of 12 x 9");
  for (const char* choice : {"7", "1.2.7"}) {
    for (const std::string& path : {dir_.path(), dir_.Sub("3-1")}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string file, FindDicomSeriesFile(path, choice));
      EXPECT_EQ(file, dir_.Sub("7-0"));
    }
  }
  EXPECT_THAT(FindDicomSeriesFile(dir_.path(), "8"),
              StatusIs(kInvalid, AllOf(HasSubstr("no series 8"), HasSubstr("T1 axial"))));
}

TEST_F(DicomFolderTest, NumberThatTwoSeriesHaveChoosesNone) {
  WriteFile(dir_.Sub("a"), DicomBytes({.series = "1.2.3", .series_number = 5}, pixels_));
  WriteFile(dir_.Sub("b"), DicomBytes({.series = "1.2.4", .series_number = 5}, pixels_));
  EXPECT_THAT(FindDicomSeriesFile(dir_.path(), "5"),
              StatusIs(kInvalid, AllOf(HasSubstr("2 series of number 5"),
                                       HasSubstr("1.2.3: 5, 1 image of 12 x 9; 1.2.4: 5"))));
}

TEST_F(DicomFolderTest, FilesOfASeriesAreFoundByAFileOfItOrIfItIsTheOnlyOne) {
  WriteTwoSeries();
  WriteFile(dir_.Sub("report"), Report());
  EXPECT_THAT(FindDicomSeries(dir_.path(), &decoder_).status(),
              StatusIs(kInvalid, AllOf(HasSubstr("2 series"), HasSubstr("--series N"))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomSeriesFiles found,
                                FindDicomSeries(dir_.Sub("7-1"), &decoder_));
  ASSERT_EQ(found.images.size(), 3U);
  for (std::size_t z = 0; z < 3; ++z) {
    EXPECT_EQ(found.images[z].path, dir_.Sub(absl::StrCat("7-", z)));
    EXPECT_EQ(found.images[z].scan.series, "1.2.7");
    EXPECT_EQ(found.images[z].scan.content, DicomContent::kImage);
  }
  EXPECT_THAT(found.left_out, ElementsAre(dir_.Sub("report")));
  EXPECT_THAT(FindDicomSeries(dir_.Sub("report"), &decoder_).status(),
              StatusIs(kInvalid, HasSubstr("without an image")));
}

TEST_F(DicomFolderTest, FileThatIsCutStopsItsSeriesOrAllIfItHasNone) {
  WriteTwoSeries();
  const std::string whole = Slice(3, 1);
  WriteFile(dir_.Sub("3-1"), whole.substr(0, whole.size() - 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomSeriesFiles found,
                                FindDicomSeries(dir_.Sub("3-0"), &decoder_));
  ASSERT_EQ(found.images.size(), 2U);
  EXPECT_EQ(found.images[1].scan.content, DicomContent::kCut);
  EXPECT_THAT(FindDicomSeries(dir_.Sub("3-1"), &decoder_).status(),
              StatusIs(kInvalid, DicomCutError(dir_.Sub("3-1")).message()));
  WriteFile(dir_.Sub("3-1"), whole.substr(0, whole.find("1.2.3\0")));
  EXPECT_THAT(FindDicomSeries(dir_.Sub("7-0"), &decoder_).status(),
              StatusIs(kInvalid, HasSubstr(dir_.Sub("3-1") + ": ")));
}

TEST_F(DicomFolderTest, FoldersWithoutAnImageSayWhatTheyHold) {
  EXPECT_THAT(FindDicomSeries(dir_.path(), &decoder_).status(),
              StatusIs(kNotFound, HasSubstr("a folder without DICOM files")));
  WriteFile(dir_.Sub("r"), Report());
  EXPECT_THAT(FindDicomSeries(dir_.path(), &decoder_).status(),
              StatusIs(kNotFound, HasSubstr("none of its 1 DICOM files is an image")));
  EXPECT_THAT(ListDicomSeries(dir_.path()).status(),
              StatusIs(kNotFound, HasSubstr("a folder without a DICOM image")));
}

}  // namespace
}  // namespace isoscope::source
