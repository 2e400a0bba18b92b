#include "core/formats/dicom/dicom_archive.h"

#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/find_volume.h"
#include "core/formats/open_request.h"
#include "core/formats/open_volume.h"
#include "tests/support/dicom_file.h"
#include "tests/support/folder_test.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/source/bytes/zip_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::DicomBytes;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ZipBytes;
using ::isoscope::testing::ZipEntry;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

// Sets TMPDIR as long as it lives.
class ScopedTemporaryPlace {
 public:
  explicit ScopedTemporaryPlace(const std::string& folder) {
    // NOLINTNEXTLINE(concurrency-mt-unsafe): a test of one thread
    if (const char* const before = std::getenv("TMPDIR"); before != nullptr) {
      before_ = before;
    }
    setenv("TMPDIR", folder.c_str(), 1);  // NOLINT(concurrency-mt-unsafe)
  }
  ~ScopedTemporaryPlace() {
    if (before_.has_value()) {
      setenv("TMPDIR", before_->c_str(), 1);  // NOLINT(concurrency-mt-unsafe)
    } else {
      unsetenv("TMPDIR");  // NOLINT(concurrency-mt-unsafe)
    }
  }
  ScopedTemporaryPlace(const ScopedTemporaryPlace&) = delete;
  ScopedTemporaryPlace& operator=(const ScopedTemporaryPlace&) = delete;

 private:
  std::optional<std::string> before_;
};

class DicomArchiveTest : public testing::FolderTest {
 protected:
  static std::string ArchivedSlice(int series, int z) {
    return DicomBytes({.series = absl::StrCat("1.2.", series),
                       .position = absl::StrCat("0\\0\\", z),
                       .number = z,
                       .series_number = series},
                      std::string(12 * 9 * 2, static_cast<char>('a' + z)));
  }
  static std::vector<ZipEntry> SeriesOfThree(int series) {
    std::vector<ZipEntry> entries;
    for (int z = 0; z < 3; ++z) {
      entries.push_back({.name = absl::StrCat("PAT/SE", series, "/IM", 9 - z),
                         .bytes = ArchivedSlice(series, z),
                         .is_deflated = z % 2 == 0});
    }
    return entries;
  }
};

TEST_F(DicomArchiveTest, AnArchiveIsOpenedLikeItsFolder) {
  std::vector<ZipEntry> entries = SeriesOfThree(7);
  entries.push_back({.name = "viewer.exe", .bytes = "MZ"});
  entries.push_back({.name = "PAT/", .bytes = ""});
  entries.push_back({.name = "DICOMDIR", .bytes = "index"});
  const std::string path = Write("export.zip", ZipBytes(entries));
  for (int z = 0; z < 3; ++z) {
    Write(absl::StrCat("folder/IM", z), ArchivedSlice(7, z));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto unpacked, OpenVolumeFile(dir_.Sub("folder")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string expected, ReadAll(*unpacked, 1));
  for (const std::string& name : {path, Write("noname", ZipBytes(entries))}) {
    std::unique_ptr<VolumeSource> volume;
    {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(name));
      EXPECT_EQ(series->info().name, name);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(volume, series->Open(0, 0, 0));
    }
    // The files outlive the series, as long as a volume needs them.
    EXPECT_EQ(volume->info().name, name);
    EXPECT_EQ(volume->info().geometry, unpacked->info().geometry);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*volume, 1));
    EXPECT_EQ(samples, expected);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(path));
  EXPECT_THAT(files, ::testing::ElementsAre(path));
}

TEST_F(DicomArchiveTest, SeveralSeriesAreListedAndChosen) {
  std::vector<ZipEntry> entries = SeriesOfThree(7);
  for (ZipEntry& entry : SeriesOfThree(3)) {
    entries.push_back(std::move(entry));
  }
  const std::string path = Write("export.zip", ZipBytes(entries));
  EXPECT_THAT(OpenVolumeSeries(path),
              StatusIs(kInvalid, AllOf(HasSubstr(path + ": 2 series"), Not(HasSubstr("000001_")))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto listed, ListSeries(path));
  ASSERT_EQ(listed.size(), 2U);
  EXPECT_EQ(listed[0].number, 3);
  EXPECT_EQ(listed[0].images, 3);
  EXPECT_EQ(listed[0].first_file, path);
  GridRules rules;
  rules.dicom_series = "7";
  ISOSCOPE_EXPECT_OK(OpenVolumeFile(path, "", rules).status());
  rules.dicom_series = "4";
  EXPECT_THAT(OpenVolumeFile(path, "", rules), StatusIs(kInvalid, HasSubstr("no series 4")));
  // The labels were looked for among the series of the folder of the archive.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string labels,
                                PathOfLabels({.path = path, .dicom_series = "7"}));
  EXPECT_EQ(labels, path);
}

TEST_F(DicomArchiveTest, HarmfulArchivesAreRefused) {
  const std::string slice = ArchivedSlice(7, 0);
  for (const char* name : {"../x", "a/../../x", "/etc/x", "a\\..\\x", "C:/x", "..", "a//../b"}) {
    EXPECT_THAT(OpenVolumeSeries(Write("bad.zip", ZipBytes({{.name = name, .bytes = slice}}))),
                StatusIs(kInvalid, HasSubstr("leads out of it")))
        << name;
  }
  EXPECT_THAT(
      OpenVolumeSeries(Write("bad.zip", ZipBytes({{.name = "a", .bytes = slice, .flags = 1}}))),
      StatusIs(kInvalid, HasSubstr("is encrypted")));
  EXPECT_THAT(
      OpenVolumeSeries(Write("bad.zip", ZipBytes({{.name = "a", .bytes = slice, .crc = 1}}))),
      StatusIs(absl::StatusCode::kDataLoss, HasSubstr("its checksum is")));
  EXPECT_THAT(OpenVolumeSeries(Write("bad.zip", ZipBytes({{.name = "a", .bytes = "text"}}))),
              StatusIs(kInvalid, HasSubstr("none of its 1 members is a DICOM file; unpack it")));
}

// Symptom: a viewer of a GiB beside the slices was unpacked to be removed.
TEST_F(DicomArchiveTest, OfWhatIsNoDicomOnlyTheStartIsRead) {
  constexpr std::size_t kViewerBytes = std::size_t{3} << 20;
  std::vector<ZipEntry> entries = SeriesOfThree(7);
  // A checksum is compared as the last byte is read.
  entries.insert(entries.begin(), {.name = "viewer.exe",
                                   .bytes = "MZ" + std::string(kViewerBytes, '\x90'),
                                   .is_deflated = true,
                                   .crc = 1});
  ISOSCOPE_EXPECT_OK(OpenVolumeFile(Write("export.zip", ZipBytes(entries))).status());
  // Where the start does not tell, the file does: what says DICOM lies behind it.
  const std::string late =
      testing::DicomElement(0x0008, 0x0001, "UN", std::string(kViewerBytes, 'x')) +
      testing::DicomElement(0x0008, 0x0016, "UI", "1.2.840.10008.5.1.4.1.1.2");
  for (const bool is_deflated : {false, true}) {
    EXPECT_THAT(
        OpenVolumeSeries(Write(
            "late.zip", ZipBytes({{.name = "a", .bytes = late, .is_deflated = is_deflated}}))),
        StatusIs(kInvalid, Not(HasSubstr("is a DICOM file"))));
  }
}

TEST_F(DicomArchiveTest, BombsAreRefusedByWhatTheyPromise) {
  // What the members hold is never looked at.
  const std::string noise = testing::Noise({1000, 1000, 1}, volume::ScalarType::kUint8);
  std::vector<ZipEntry> entries;
  for (int i = 0; i < 2; ++i) {
    entries.push_back(
        {.name = absl::StrCat("a", i), .bytes = noise, .is_deflated = true, .size = 1'000'000'000});
  }
  EXPECT_THAT(OpenVolumeSeries(Write("bomb.zip", ZipBytes(entries))),
              StatusIs(kInvalid, HasSubstr("2000000000 bytes in an archive of")));
  entries[0].size = 5'000'000'000;
  EXPECT_THAT(OpenVolumeSeries(Write("bomb.zip", ZipBytes(entries, {.is_long = true}))),
              StatusIs(kInvalid));
  std::string text = ZipBytes({{.name = "a", .bytes = "12345678"}, {.name = "b", .bytes = "1"}});
  // The second entry's offset: within the first member.
  const std::size_t entry = text.rfind(std::string("PK\x01\x02", 4));
  text.replace(entry + 42, 4, std::string("\x0a\0\0\0", 4));
  EXPECT_THAT(OpenVolumeSeries(Write("bomb.zip", text)),
              StatusIs(kInvalid, HasSubstr("overlaps another one")));
}

TEST_F(DicomArchiveTest, NothingIsLeftBehind) {
  const std::string folder = dir_.Sub("tmp");
  std::filesystem::create_directory(folder);
  const ScopedTemporaryPlace place(folder);
  const std::string good = Write("good.zip", ZipBytes(SeriesOfThree(7)));
  std::vector<ZipEntry> entries = SeriesOfThree(7);
  entries[2].crc = 1;
  const std::string bad = Write("bad.zip", ZipBytes(entries));
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(good));
    EXPECT_FALSE(std::filesystem::is_empty(folder));
    EXPECT_THAT(OpenVolumeFile(bad), StatusIs(absl::StatusCode::kDataLoss));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder));
}

}  // namespace
}  // namespace isoscope::source
