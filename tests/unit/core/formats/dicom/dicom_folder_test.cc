#include "core/formats/dicom/dicom_folder.h"

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
  EXPECT_THAT(DicomFilesOf(dir_.path()).value(), ElementsAre(dir_.Sub("a"), dir_.Sub("b")));
  EXPECT_THAT(DicomFilesOf(dir_.Sub("none")).value(), ElementsAre(dir_.Sub("a"), dir_.Sub("b")));
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
  EXPECT_TRUE(FindDicomSeries(dir_.Sub("7-0"), "", &decoder_).ok());
  std::filesystem::create_symlink(dir_.Sub("away"), dir_.Sub("7-3"));  // a slice, or not
  EXPECT_THAT(FindDicomSeries(dir_.Sub("7-0"), "", &decoder_).status(),
              StatusIs(kNotFound, AllOf(HasSubstr(dir_.Sub("7-3")), HasSubstr("may be a slice"))));
  EXPECT_THAT(ListDicomSeries(dir_.path()).status(), StatusIs(kNotFound, HasSubstr("7-3")));
}

// The series 3 in two folders, 7 in another, and others that do not count.
class DicomFolderBelowTest : public DicomFolderTest {
 protected:
  DicomFolderBelowTest() {
    for (const char* folder :
         {"disc/IMAGES/a", "disc/IMAGES/b", "disc/other/deep", "disc/.trash"}) {
      std::filesystem::create_directories(dir_.Sub(folder));
    }
    WriteFile(dir_.Sub("disc/IMAGES/a/1"), Slice(3, 0, "T1 axial"));
    WriteFile(dir_.Sub("disc/IMAGES/b/2"), Slice(3, 1));
    WriteFile(dir_.Sub("disc/other/deep/3"), Slice(7, 0));
    WriteFile(dir_.Sub("disc/.trash/4"), Slice(9, 0));
    WriteFile(dir_.Sub("disc/report"), Report());
    WriteFile(dir_.Sub("disc/DICOMDIR"), Index());
  }
  static std::string Index() {
    const std::string whole = DicomBytes({.storage_class = "1.2.840.10008.1.3.10"}, "");
    return whole.substr(0, whole.size() - 12);
  }
};

TEST_F(DicomFolderBelowTest, SeriesInFoldersBelowAreListedWithTheirFolders) {
  for (const char* name : {"disc", "disc/DICOMDIR"}) {
    const std::string path = dir_.Sub(name);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto entries, ListDicomSeries(path));
    ASSERT_EQ(entries.size(), 2U);
    EXPECT_EQ(DescribeDicomSeries(entries[0]), "3 \"T1 axial\", 2 images of 12 x 9 in IMAGES");
    EXPECT_EQ(entries[1].folder, "other/deep");
    EXPECT_THAT(FindDicomSeries(path, "", &decoder_),
                StatusIs(kInvalid, AllOf(HasSubstr("2 series"), HasSubstr("in other/deep"))));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomSeriesFiles found,
                                  FindDicomSeries(path, "3", &decoder_));
    ASSERT_EQ(found.images.size(), 2U) << "of both folders";
    EXPECT_EQ(found.images[1].path, dir_.Sub("disc/IMAGES/b/2"));
    EXPECT_FALSE(found.is_of_file);
    EXPECT_EQ(FindDicomSeries(path, "1.2.7", &decoder_)->images[0].path,
              dir_.Sub("disc/other/deep/3"));
    EXPECT_THAT(FindDicomSeries(path, "8", &decoder_),
                StatusIs(kInvalid, HasSubstr("no series 8")));
  }
}

TEST_F(DicomFolderBelowTest, OnlySeriesBelowIsFoundAndAFileNamesItsFolderAlone) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomSeriesFiles found,
                                FindDicomSeries(dir_.Sub("disc/other"), "", &decoder_));
  EXPECT_EQ(found.images.size(), 1U);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomSeriesFiles one,
                                FindDicomSeries(dir_.Sub("disc/IMAGES/a/1"), "", &decoder_));
  EXPECT_EQ(one.images.size(), 1U);
  EXPECT_TRUE(one.is_of_file);
}

TEST_F(DicomFolderBelowTest, FoldersBelowDoNotCountBesideAnImage) {
  WriteFile(dir_.Sub("disc/slice"), Slice(5, 0));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomSeriesFiles found,
                                FindDicomSeries(dir_.Sub("disc"), "", &decoder_));
  EXPECT_EQ(found.images[0].scan.series, "1.2.5");
  EXPECT_THAT(ListDicomSeries(dir_.Sub("disc/DICOMDIR")).value(), ::testing::SizeIs(3))
      << "an index has all";
}

TEST_F(DicomFolderBelowTest, FilesThatDecideAreThoseBelow) {
  EXPECT_TRUE(HasDicomFileBelow(dir_.Sub("disc")));
  EXPECT_FALSE(HasDicomFileBelow(dir_.Sub("disc/IMAGES/a"))) << "it lies in it";
  EXPECT_THAT(DicomFilesOf(dir_.Sub("disc")).value(),
              ElementsAre(dir_.Sub("disc/report"), dir_.Sub("disc/IMAGES/a/1"),
                          dir_.Sub("disc/IMAGES/b/2"), dir_.Sub("disc/other/deep/3")));
  EXPECT_THAT(DicomFilesOf(dir_.Sub("disc/IMAGES/a/1")).value(),
              ElementsAre(dir_.Sub("disc/IMAGES/a/1")));
}

TEST_F(DicomFolderBelowTest, LinksThatGoRoundAreFollowedOnce) {
  std::filesystem::create_directory_symlink(dir_.Sub("disc"), dir_.Sub("disc/IMAGES/a/again"));
  std::filesystem::create_directory_symlink(dir_.Sub("disc/other/deep"), dir_.Sub("disc/also"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto entries, ListDicomSeries(dir_.Sub("disc")));
  ASSERT_EQ(entries.size(), 2U);
  EXPECT_EQ(entries[0].images, 2);
  EXPECT_EQ(entries[1].images, 1);
}

TEST_F(DicomFolderBelowTest, EightFoldersAreLookedThrough) {
  std::string path = dir_.Sub("deep");
  for (int depth = 1; depth <= 8; ++depth) {
    absl::StrAppend(&path, "/", depth);
  }
  std::filesystem::create_directories(path + "/9");
  WriteFile(path + "/9/a", Slice(3, 0));
  EXPECT_FALSE(HasDicomFileBelow(dir_.Sub("deep")));
  WriteFile(path + "/a", Slice(3, 0));
  EXPECT_TRUE(HasDicomFileBelow(dir_.Sub("deep")));
}

TEST_F(DicomFolderBelowTest, FileThatIsCutStopsSeriesOfItsFolderOnly) {
  const std::string whole = Slice(7, 1);
  WriteFile(dir_.Sub("disc/other/deep/cut"), whole.substr(0, whole.find("1.2.7")));
  ISOSCOPE_EXPECT_OK(FindDicomSeries(dir_.Sub("disc"), "3", &decoder_).status());
  EXPECT_THAT(FindDicomSeries(dir_.Sub("disc"), "7", &decoder_),
              StatusIs(kInvalid, HasSubstr("deep/cut")));
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
  EXPECT_THAT(FindDicomSeries(dir_.path(), "", &decoder_).status(),
              StatusIs(kInvalid, AllOf(HasSubstr("2 series"), HasSubstr("--series N"))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomSeriesFiles found,
                                FindDicomSeries(dir_.Sub("7-1"), "", &decoder_));
  ASSERT_EQ(found.images.size(), 3U);
  for (std::size_t z = 0; z < 3; ++z) {
    EXPECT_EQ(found.images[z].path, dir_.Sub(absl::StrCat("7-", z)));
    EXPECT_EQ(found.images[z].scan.series, "1.2.7");
    EXPECT_EQ(found.images[z].scan.content, DicomContent::kImage);
  }
  EXPECT_THAT(found.left_out, ElementsAre(dir_.Sub("report")));
  EXPECT_THAT(FindDicomSeries(dir_.Sub("report"), "", &decoder_).status(),
              StatusIs(kInvalid, HasSubstr("without an image")));
}

TEST_F(DicomFolderTest, FileThatIsCutStopsItsSeriesOrAllIfItHasNone) {
  WriteTwoSeries();
  const std::string whole = Slice(3, 1);
  WriteFile(dir_.Sub("3-1"), whole.substr(0, whole.size() - 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomSeriesFiles found,
                                FindDicomSeries(dir_.Sub("3-0"), "", &decoder_));
  ASSERT_EQ(found.images.size(), 2U);
  EXPECT_EQ(found.images[1].scan.content, DicomContent::kCut);
  EXPECT_THAT(FindDicomSeries(dir_.Sub("3-1"), "", &decoder_).status(),
              StatusIs(kInvalid, DicomCutError(dir_.Sub("3-1")).message()));
  WriteFile(dir_.Sub("3-1"), whole.substr(0, whole.find("1.2.3\0")));
  EXPECT_THAT(FindDicomSeries(dir_.Sub("7-0"), "", &decoder_).status(),
              StatusIs(kInvalid, HasSubstr(dir_.Sub("3-1") + ": ")));
}

TEST_F(DicomFolderTest, FoldersWithoutAnImageSayWhatTheyHold) {
  EXPECT_THAT(FindDicomSeries(dir_.path(), "", &decoder_).status(),
              StatusIs(kNotFound, HasSubstr("a folder without DICOM files")));
  WriteFile(dir_.Sub("r"), Report());
  EXPECT_THAT(FindDicomSeries(dir_.path(), "", &decoder_).status(),
              StatusIs(kNotFound, HasSubstr("none of its 1 DICOM files is an image")));
  EXPECT_THAT(ListDicomSeries(dir_.path()).status(),
              StatusIs(kNotFound, HasSubstr("a folder without a DICOM image")));
}

}  // namespace
}  // namespace isoscope::source
