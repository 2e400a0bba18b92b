#include "core/formats/dicom/dicom_storage.h"

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

constexpr char kStorage[] = "1.2.840.10008.5.1.4.1.1.";

TEST(DicomStorageTest, ClassesOfImagesMustHavePixels) {
  // CT, enhanced CT and MR, segmentation, label map, PET, dose, ultrasound, thickness map.
  for (const char* suffix : {"2", "2.1", "4.1", "66.4", "66.7", "128", "481.2", "3.1", "81.1"}) {
    EXPECT_EQ(DicomStorageOf(absl::StrCat(kStorage, suffix)), DicomStorage::kImage) << suffix;
  }
}

TEST(DicomStorageTest, ReportsPlansAndDirectoriesHaveNone) {
  // Spectra, an ECG, a presentation, raw data, a registration, a report, structures, a plan, a PDF.
  for (const char* suffix :
       {"4.2", "9.1.1", "11.1", "66", "66.1", "88.33", "481.3", "481.5", "104.1"}) {
    EXPECT_EQ(DicomStorageOf(absl::StrCat(kStorage, suffix)), DicomStorage::kOther) << suffix;
  }
  EXPECT_EQ(DicomStorageOf("1.2.840.10008.1.3.10"), DicomStorage::kOther);
}

TEST(DicomStorageTest, OtherClassesAreUnknown) {
  for (const char* uid : {"", "1.2.3.4.5", "1.2.840.113619.4.26", "1.2.840.1000"}) {
    EXPECT_EQ(DicomStorageOf(uid), DicomStorage::kUnknown) << uid;
  }
}

TEST(DicomStorageTest, SegmentationsAndSlidesAreTold) {
  EXPECT_TRUE(IsSegmentationStorage(absl::StrCat(kStorage, "66.4")));
  EXPECT_TRUE(IsSegmentationStorage(absl::StrCat(kStorage, "66.7")));
  EXPECT_FALSE(IsSegmentationStorage(absl::StrCat(kStorage, "66.5")));
  EXPECT_FALSE(IsSegmentationStorage("66.4"));
  EXPECT_TRUE(IsWholeSlideStorage(absl::StrCat(kStorage, "77.1.6")));
  EXPECT_FALSE(IsWholeSlideStorage(absl::StrCat(kStorage, "77.1.4")));
}

TEST(DicomStorageTest, ClassesWhoseFramesLieElsewhereAreTold) {
  struct Case {
    bool (*is_class)(absl::string_view uid);
    const char* suffix;
  };
  for (const Case& c : {Case{&IsNuclearStorage, "20"},
                        {&IsDoseStorage, "481.2"},
                        {&IsUltrasoundVolumeStorage, "6.2"},
                        {&IsSecondaryCaptureStorage, "7"},
                        {&IsSecondaryCaptureStorage, "7.3"}}) {
    EXPECT_TRUE(c.is_class(absl::StrCat(kStorage, c.suffix))) << c.suffix;
    EXPECT_FALSE(c.is_class(c.suffix));
    EXPECT_FALSE(c.is_class(absl::StrCat(kStorage, "4"))) << "magnetic resonance";
    EXPECT_FALSE(c.is_class(absl::StrCat(kStorage, "77.1.6"))) << "slides";
  }
  EXPECT_TRUE(IsDirectoryStorage("1.2.840.10008.1.3.10"));
  EXPECT_FALSE(IsDirectoryStorage("1.3.10"));
  EXPECT_FALSE(IsDirectoryStorage(absl::StrCat(kStorage, "20")));
}

}  // namespace
}  // namespace isoscope::source
