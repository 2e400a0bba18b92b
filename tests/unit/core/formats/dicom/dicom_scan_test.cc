#include "core/formats/dicom/dicom_scan.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/dicom/dicom_storage.h"
#include "tests/support/dicom_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::DicomBytes;
using ::isoscope::testing::DicomElement;
using ::isoscope::testing::DicomItem;
using ::isoscope::testing::DicomNumber;
using ::isoscope::testing::DicomOpenElement;
using ::isoscope::testing::DicomSlice;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;

constexpr char kComprehensiveReport[] = "1.2.840.10008.5.1.4.1.1.88.33";
constexpr char kDirectory[] = "1.2.840.10008.1.3.10";

class DicomScanTest : public ::testing::Test {
 protected:
  DicomScan Scan(const std::string& bytes) const {
    WriteFile(dir_.Sub("f"), bytes);
    const absl::StatusOr<DicomScan> scan = ScanDicomFile(dir_.Sub("f"));
    ISOSCOPE_EXPECT_OK(scan);
    return scan.value_or(DicomScan());
  }
  // The same without its pixels.
  static std::string WithoutPixels(const DicomSlice& slice) {
    const std::string whole = DicomBytes(slice, "");
    return whole.substr(0, whole.size() - DicomElement(0x7fe0, 0x10, "OW", "").size());
  }

  TempDir dir_;
  const std::string pixels_ = std::string(std::size_t{12} * 9 * 2, 'p');
};

TEST_F(DicomScanTest, ImageIsWholeOnlyWithItsLastPixel) {
  const std::string whole = DicomBytes({}, pixels_);
  const DicomScan scan = Scan(whole);
  EXPECT_EQ(scan.content, DicomContent::kImage);
  EXPECT_EQ(scan.series, "1.2.3");
  EXPECT_EQ(scan.transfer_syntax, "1.2.840.10008.1.2.1");
  EXPECT_EQ(Scan(whole + "behind the pixels").content, DicomContent::kImage);
  for (std::size_t size = 0; size < whole.size(); ++size) {
    EXPECT_EQ(Scan(whole.substr(0, size)).content, DicomContent::kCut) << size;
  }
}

TEST_F(DicomScanTest, PixelsLieWhereTheScanFoundThem) {
  const std::string bytes = DicomBytes({}, pixels_);
  const DicomScan scan = Scan(bytes);
  EXPECT_EQ(scan.pixels_offset, static_cast<std::int64_t>(bytes.size() - pixels_.size()));
  EXPECT_EQ(scan.storage_class, "1.2.840.10008.5.1.4.1.1.2");
  EXPECT_FALSE(IsSegmentationStorage(scan.storage_class) ||
               IsWholeSlideStorage(scan.storage_class));
  EXPECT_EQ(Scan(WithoutPixels({})).pixels_offset, -1);
  const std::string compressed =
      WithoutPixels({}) + DicomOpenElement(0x7fe0, 0x10, "OB", DicomItem("") + DicomItem(pixels_));
  EXPECT_EQ(Scan(compressed).content, DicomContent::kImage);
  EXPECT_EQ(Scan(compressed).pixels_offset, -1);
}

TEST_F(DicomScanTest, HeaderMayBeLargerThanTheWindowThatTheScanReadsThrough) {
  const std::string whole =
      DicomBytes({.number = 3, .description = "T1 axial", .series_number = 12, .frames = 2},
                 pixels_ + pixels_);
  const std::size_t first = whole.find(std::string("\x08\0\x16\0", 4));
  ASSERT_NE(first, std::string::npos);
  const DicomScan scan = Scan(whole);
  for (std::size_t size = 3000; size < 4300; size += 2) {  // each element lies on the edge once
    const std::string pad = DicomElement(8, 1, "UN", std::string(size, '\x28'));
    const DicomScan padded = Scan(whole.substr(0, first) + pad + whole.substr(first));
    ASSERT_EQ(padded.content, DicomContent::kImage) << size;
    ASSERT_EQ(padded.series, "1.2.3") << size;
    ASSERT_EQ(padded.series_number, 12) << size;
    ASSERT_EQ(padded.description, "T1 axial") << size;
    ASSERT_EQ(padded.width, 12) << size;
    ASSERT_EQ(padded.height, 9) << size;
    ASSERT_EQ(padded.frames, 2) << size;
    ASSERT_EQ(padded.moment.instance_number, 3) << size;
    ASSERT_EQ(padded.pixels_offset, scan.pixels_offset + static_cast<std::int64_t>(pad.size()));
  }
}

TEST_F(DicomScanTest, SegmentationsAndSlidesAreKnownByTheirClass) {
  for (const char* last : {"4", "7"}) {
    const std::string storage_class = absl::StrCat("1.2.840.10008.5.1.4.1.1.66.", last);
    EXPECT_TRUE(IsSegmentationStorage(
        Scan(DicomBytes({.storage_class = storage_class}, pixels_)).storage_class));
    // Without pixels it is no report, but cut.
    EXPECT_EQ(Scan(WithoutPixels({.storage_class = storage_class})).content, DicomContent::kCut);
  }
  EXPECT_TRUE(IsWholeSlideStorage(
      Scan(DicomBytes({.storage_class = "1.2.840.10008.5.1.4.1.1.77.1.6"}, pixels_))
          .storage_class));
}

TEST_F(DicomScanTest, ErrorOfACutFileNamesItAndSaysWhatToDo) {
  EXPECT_THAT(DicomCutError("a/b.dcm"),
              testing::StatusIs(absl::StatusCode::kInvalidArgument,
                                ::testing::AllOf(::testing::HasSubstr("a/b.dcm: does not hold"),
                                                 ::testing::HasSubstr("copy it again"))));
}

TEST_F(DicomScanTest, IndexReportAndFilesWithoutPixelsAreNoImages) {
  for (const char* storage_class : {kComprehensiveReport, kDirectory}) {
    EXPECT_EQ(Scan(WithoutPixels({.storage_class = storage_class})).content,
              DicomContent::kNoImage);
  }
  // A file of an unknown class, without the rows of an image.
  const std::string unknown = DicomBytes({.storage_class = "1.2.3.4.5"}, pixels_);
  EXPECT_EQ(Scan(unknown).content, DicomContent::kImage);
  const std::size_t rows = unknown.find(std::string("\x28\0\x10\0", 4));
  EXPECT_EQ(Scan(unknown.substr(0, rows)).content, DicomContent::kNoImage);
  EXPECT_EQ(Scan(WithoutPixels({.storage_class = "1.2.3.4.5"})).content, DicomContent::kCut);
  EXPECT_EQ(Scan(WithoutPixels({})).content, DicomContent::kCut) << "a CT slice has pixels";
}

TEST_F(DicomScanTest, PixelsOfAnIconAreNotThoseOfTheImage) {
  const std::string icon = DicomElement(0x7fe0, 0x10, "OW", "icon");
  const std::string sequences[] = {
      DicomElement(0x88, 0x200, "SQ", DicomItem(icon)),
      DicomOpenElement(0x88, 0x200, "SQ", DicomItem(icon)),
      DicomOpenElement(0x88, 0x200, "SQ", testing::DicomOpenItem(icon)),
      // Within a value of unknown kind all is implicit: tag, then a length of 32 bits.
      DicomOpenElement(0x88, 0x200, "UN",
                       testing::DicomOpenItem(std::string("\xe0\x7f\x10\0\4\0\0\0icon", 12)))};
  for (const std::string& sequence : sequences) {
    const DicomSlice slice{.more = sequence};
    EXPECT_EQ(Scan(DicomBytes(slice, pixels_)).content, DicomContent::kImage);
    EXPECT_EQ(Scan(WithoutPixels(slice)).content, DicomContent::kCut);
    const std::string whole = DicomBytes(slice, pixels_);
    for (std::size_t size = whole.size() - pixels_.size() - sequence.size(); size < whole.size();
         ++size) {
      EXPECT_EQ(Scan(whole.substr(0, size)).content, DicomContent::kCut) << size;
    }
  }
}

TEST_F(DicomScanTest, CompressedPixelsEndWithTheirLastFragment) {
  const std::string head = WithoutPixels({});
  const std::string fragments = DicomItem("") + DicomItem("frag") + DicomItem("ment");
  const std::string pixels = DicomOpenElement(0x7fe0, 0x10, "OB", fragments);
  EXPECT_EQ(Scan(head + pixels).content, DicomContent::kImage);
  for (std::size_t size = 0; size < pixels.size(); ++size) {
    EXPECT_EQ(Scan(head + pixels.substr(0, size)).content, DicomContent::kCut) << size;
  }
}

TEST_F(DicomScanTest, NumbersOfPixelsThatAreNoneMakeTheFileUnfit) {
  // Found by dicom_fuzz: GDCM ends the process on these.
  const std::string good = DicomBytes({}, pixels_);
  const std::string rows =
      DicomElement(0x28, 0x10, "US", DicomNumber(std::uint16_t{9}));  // DicomSlice::height
  const std::size_t at = good.find(rows);
  ASSERT_NE(at, std::string::npos);
  for (const std::string& bad :
       {DicomElement(0x28, 0x10, "UN", "\x09"), DicomElement(0x28, 0x10, "LO", "9 "),
        DicomElement(0x28, 0x10, "US", std::string("\x09\0\0\0", 4))}) {
    std::string bytes = good;
    bytes.replace(at, rows.size(), bad);
    EXPECT_EQ(Scan(bytes).content, DicomContent::kCut) << bad.substr(4, 2);
  }
}

TEST_F(DicomScanTest, FewerPixelsThanRowsAndColumnsSayMakeTheFileCut) {
  // GDCM accepts them, and leaves the other pixels undefined.
  EXPECT_EQ(Scan(DicomBytes({}, pixels_)).content, DicomContent::kImage);
  EXPECT_TRUE(Scan(DicomBytes({}, pixels_)).is_counted);
  EXPECT_EQ(Scan(DicomBytes({}, pixels_ + "..")).content, DicomContent::kImage);
  EXPECT_EQ(Scan(DicomBytes({}, pixels_.substr(2))).content, DicomContent::kCut);
  EXPECT_EQ(Scan(DicomBytes({}, "")).content, DicomContent::kCut);
  EXPECT_EQ(Scan(DicomBytes({.width = 65535, .height = 65535}, pixels_)).content,
            DicomContent::kCut);
  // If a number is there twice, the larger one counts, because GDCM may take either.
  const std::string one_row = DicomElement(0x28, 0x10, "US", DicomNumber(std::uint16_t{1}));
  EXPECT_EQ(Scan(DicomBytes({.more = one_row}, pixels_.substr(2))).content, DicomContent::kCut);
  // Colours may be stored in fewer bytes.
  std::string colour = DicomBytes({}, pixels_);
  const auto samples = [](std::uint16_t count) {
    return DicomElement(0x28, 2, "US", DicomNumber(count));
  };
  colour.replace(colour.find(samples(1)), samples(1).size(), samples(3));
  EXPECT_EQ(Scan(colour).content, DicomContent::kImage);
  EXPECT_FALSE(Scan(colour).is_counted);
}

TEST_F(DicomScanTest, KindThatThereIsNotInTheGroup0002MakesTheFileUnfit) {
  // Found by dicom_fuzz: GDCM ends the process on these.
  const std::string good = DicomBytes({}, pixels_);
  const std::string kind = DicomElement(2, 0x12, "UI", "1.2.3.4").substr(0, 6);
  const std::size_t at = good.find(kind);
  ASSERT_NE(at, std::string::npos);
  for (const std::string& bad : {std::string("ZZ"), std::string("U\0", 2), std::string("\0\0", 2),
                                 std::string("S "), std::string("ui")}) {
    std::string bytes = good;
    bytes.replace(at + 4, 2, bad);
    EXPECT_EQ(Scan(bytes).content, DicomContent::kCut) << bad;
  }
}

// A data set in the implicit encoding: tag, then a length of 32 bits.
std::string Implicit(std::uint16_t group, std::uint16_t element, std::string value) {
  value.resize(value.size() + value.size() % 2, '\0');
  return DicomNumber(group) + DicomNumber(element) +
         DicomNumber(static_cast<std::uint32_t>(value.size())) + value;
}

TEST_F(DicomScanTest, FilesWithoutAMarkAreKnownByTheirFirstElements) {
  const std::string whole = DicomBytes({}, pixels_);
  const std::string meta = whole.substr(132);
  const std::string data = whole.substr(whole.find(std::string("\x08\0\x16\0", 4)));
  const std::string length = DicomElement(2, 0, "UL", std::string(4, '\0'));
  for (const std::string& bytes :
       {meta, meta.substr(length.size()), data, DicomElement(8, 5, "CS", "ISO_IR 100") + data}) {
    const DicomScan scan = Scan(bytes);
    EXPECT_TRUE(scan.is_dicom);
    EXPECT_EQ(scan.content, DicomContent::kImage);
    EXPECT_EQ(scan.series, "1.2.3");
    EXPECT_EQ(scan.transfer_syntax, "1.2.840.10008.1.2.1");
    EXPECT_EQ(scan.storage_class, "1.2.840.10008.5.1.4.1.1.2");
    EXPECT_EQ(scan.pixels_offset, static_cast<std::int64_t>(bytes.size() - pixels_.size()));
  }
  const std::string implicit =
      Implicit(8, 0, std::string(4, '\0')) + Implicit(8, 0x16, "1.2.840.10008.5.1.4.1.1.4") +
      Implicit(0x20, 0xe, "1.2.77") + Implicit(0x28, 0x10, DicomNumber(std::uint16_t{9})) +
      Implicit(0x28, 0x11, DicomNumber(std::uint16_t{12})) +
      Implicit(0x28, 0x100, DicomNumber(std::uint16_t{16})) + Implicit(0x7fe0, 0x10, pixels_);
  const DicomScan scan = Scan(implicit);
  EXPECT_EQ(scan.content, DicomContent::kImage);
  EXPECT_EQ(scan.transfer_syntax, "1.2.840.10008.1.2");
  EXPECT_EQ(scan.series, "1.2.77");
  EXPECT_EQ(scan.bits_allocated, 16);
  EXPECT_TRUE(scan.is_counted);
}

TEST_F(DicomScanTest, MosaicsAreKnownByAValueOfTheirType) {
  EXPECT_TRUE(
      Scan(DicomBytes({.image_type = "ORIGINAL\\PRIMARY\\M\\ND\\MOSAIC"}, pixels_)).is_mosaic);
  EXPECT_TRUE(Scan(DicomBytes({.image_type = "DERIVED\\MOSAIC\\M"}, pixels_)).is_mosaic);
  EXPECT_FALSE(Scan(DicomBytes({.image_type = "ORIGINAL\\NOMOSAIC"}, pixels_)).is_mosaic);
  EXPECT_FALSE(Scan(DicomBytes({}, pixels_)).is_mosaic);
  // Of United Imaging, with the number of slices.
  const auto grid = [this](const char* type, const char* count) {
    return Scan(DicomBytes({.more = DicomElement(0x65, 0x1050, "DS", count), .image_type = type},
                           pixels_))
        .is_mosaic;
  };
  EXPECT_TRUE(grid("ORIGINAL\\PRIMARY\\M\\VFRAME", "20"));
  EXPECT_FALSE(grid("ORIGINAL\\PRIMARY\\M\\VFRAME", "1"));
  EXPECT_FALSE(grid("ORIGINAL\\PRIMARY\\M", "20"));
}

TEST_F(DicomScanTest, HighThroughputJpeg2000IsKnownByItsTransferSyntax) {
  DicomScan scan;
  for (const char* last : {"1", "2", "3"}) {
    scan.transfer_syntax = absl::StrCat("1.2.840.10008.1.2.4.20", last);
    EXPECT_TRUE(scan.is_high_throughput());
  }
  for (const char* other :
       {"1.2.840.10008.1.2.4.20", "1.2.840.10008.1.2.4.90", "1.2.840.10008.1.2.4.2011"}) {
    scan.transfer_syntax = other;
    EXPECT_FALSE(scan.is_high_throughput()) << other;
  }
}

TEST_F(DicomScanTest, FlippedBitsNeverCrashAndShowNoField) {
  const std::string whole =
      DicomBytes({.more = DicomOpenElement(0x88, 0x200, "SQ", DicomItem("abcdefgh"))}, pixels_);
  for (std::size_t at = 0; at < whole.size(); ++at) {
    std::string flipped = whole;
    flipped[at] = static_cast<char>(flipped[at] ^ (1 << at % 8));
    const DicomScan scan = Scan(flipped);
    EXPECT_EQ(scan.series.find_first_not_of("0123456789."), std::string::npos);
    EXPECT_EQ(scan.transfer_syntax.find_first_not_of("0123456789."), std::string::npos);
  }
}

}  // namespace
}  // namespace isoscope::source
