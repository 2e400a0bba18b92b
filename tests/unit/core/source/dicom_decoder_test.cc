#include "core/source/dicom_decoder.h"

#include <algorithm>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/dicom_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::DicomBytes;
using ::isoscope::testing::DicomElement;
using ::isoscope::testing::DicomNumber;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr auto kDataLoss = absl::StatusCode::kDataLoss;
constexpr std::int64_t kSliceBytes = 12 * 9 * 2;

class DicomDecoderTest : public ::testing::Test {
 protected:
  DicomDecoderTest() { WriteFile(path_, DicomBytes({}, pixels_)); }

  // Writes the good file with `from` in place of `to`, which it has.
  void Change(const std::string& from, const std::string& to) const {
    std::string bytes = DicomBytes({}, pixels_);
    ASSERT_NE(bytes.find(from), std::string::npos);
    WriteFile(path_, bytes.replace(bytes.find(from), from.size(), to));
  }

  TempDir dir_;
  const std::string path_ = dir_.Sub("a.dcm");
  const std::string pixels_ = testing::Noise({12, 9, 1}, ScalarType::kInt16);
  DicomDecoder decoder_{kSliceBytes};
  std::string out_ = std::string(kSliceBytes, '?');
};

TEST_F(DicomDecoderTest, HeaderAndPixelsAreThoseOfTheFile) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomHeader header, decoder_.ReadHeader(path_));
  EXPECT_EQ(header.width, 12);
  EXPECT_EQ(header.height, 9);
  EXPECT_EQ(header.frames, 1);
  EXPECT_EQ(header.components, 1);
  ISOSCOPE_ASSERT_OK(header.type.status());
  EXPECT_EQ(*header.type, ScalarType::kInt16);
  EXPECT_EQ(header.origin, (math::Vec3d{10, 20, 30}));
  EXPECT_EQ(header.spacing.x, 0.5);
  EXPECT_EQ(header.spacing.y, 2);
  EXPECT_EQ(header.direction.columns[0], (math::Vec3d{1, 0, 0}));
  EXPECT_EQ(header.direction.columns[2], (math::Vec3d{0, 0, 1}));
  EXPECT_EQ(header.series, "1.2.3");
  EXPECT_FALSE(header.has_pixels);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomHeader slice,
                                decoder_.ReadSlice(path_, true, out_.data()));
  EXPECT_TRUE(slice.has_pixels);
  EXPECT_EQ(slice.width, 12);
  EXPECT_TRUE(out_ == pixels_);
}

TEST_F(DicomDecoderTest, PixelsOfAnotherSizeAreNotRead) {
  WriteFile(path_, DicomBytes({.width = 13}, std::string(13 * 9 * 2, 'p')));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomHeader header,
                                decoder_.ReadSlice(path_, true, out_.data()));
  EXPECT_FALSE(header.has_pixels);
  EXPECT_EQ(header.width, 13);
  EXPECT_TRUE(out_ == std::string(kSliceBytes, '?'));
}

TEST_F(DicomDecoderTest, FilesThatTheLibraryRefusesAreErrorsWithoutItsWords) {
  constexpr char kName[] = "Doe^Jane";
  WriteFile(path_, kName);
  EXPECT_THAT(decoder_.ReadHeader(path_).status(), StatusIs(kDataLoss, ""));
  EXPECT_THAT(decoder_.ReadHeader(dir_.path()).status(), StatusIs(kDataLoss, ""));
  EXPECT_THAT(decoder_.ReadHeader(dir_.Sub("none")).status(), StatusIs(kDataLoss, ""));
  EXPECT_THAT(decoder_.ReadHeader(std::string(5000, 'p')).status(),
              StatusIs(kDataLoss, HasSubstr("too long")));
  WriteFile(path_, DicomBytes({}, pixels_));
  ISOSCOPE_EXPECT_OK(decoder_.ReadHeader(path_).status());
}

TEST_F(DicomDecoderTest, NumbersThatAreNotFiniteAreRefused) {
  // A slice without an order among the others.
  for (const char* position : {"nan\\20\\30", "10\\20\\inf", "1e999\\2\\3"}) {
    WriteFile(path_, DicomBytes({.position = position}, pixels_));
    const absl::StatusOr<DicomHeader> header = decoder_.ReadHeader(path_);
    EXPECT_TRUE(header.ok() ? math::IsFinite(header->origin) : absl::IsDataLoss(header.status()))
        << position;
  }
}

TEST_F(DicomDecoderTest, AssertionsOfTheLibraryEndItsProcessAlone) {
  // Found by dicom_fuzz: five samples a pixel, and bytes behind the pixels that are no element.
  Change(DicomElement(0x28, 2, "US", DicomNumber(std::uint16_t{1})),
         DicomElement(0x28, 2, "US", DicomNumber(std::uint16_t{5})));
  EXPECT_THAT(decoder_.ReadHeader(path_).status(), StatusIs(kDataLoss, HasSubstr("SIGABRT")));
  for (const std::size_t size : {4U, 6U, 9U}) {
    WriteFile(path_, DicomBytes({}, pixels_) + std::string(size, 'a'));
    EXPECT_THAT(decoder_.ReadSlice(path_, true, out_.data()).status(),
                StatusIs(kDataLoss, HasSubstr("SIGABRT")))
        << size;
  }
  WriteFile(path_, DicomBytes({}, pixels_));
  ISOSCOPE_EXPECT_OK(decoder_.ReadSlice(path_, true, out_.data()).status());
  EXPECT_TRUE(out_ == pixels_);
}

TEST_F(DicomDecoderTest, PixelsThatTheFileDoesNotHaveAreAnErrorOrZeroAndNeverTheSliceBefore) {
  for (const bool is_counted : {false, true}) {
    ISOSCOPE_ASSERT_OK(decoder_.ReadSlice(path_, is_counted, out_.data()).status());
    EXPECT_TRUE(out_ == pixels_);
  }
  WriteFile(path_, DicomBytes({}, pixels_.substr(0, 100)));
  EXPECT_THAT(decoder_.ReadSlice(path_, false, out_.data()).status(), StatusIs(kDataLoss, ""));
  // With a wrong count of pixels:
  ISOSCOPE_ASSERT_OK(decoder_.ReadSlice(path_, true, out_.data()).status());
  EXPECT_TRUE(out_ == pixels_.substr(0, 100) + std::string(kSliceBytes - 100, '\0'));
}

}  // namespace
}  // namespace isoscope::source
