#include "core/formats/dicom/dicom_decoder.h"

#include <cstdint>
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
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr auto kDataLoss = absl::StatusCode::kDataLoss;
constexpr std::int64_t kSliceBytes = 12 * 9 * 2;
constexpr DicomPixels kPixels{.width = 12,
                              .height = 9,
                              .bits_allocated = 16,
                              .bits_stored = 16,
                              .high_bit = 15,
                              .is_signed = true};

class DicomDecoderTest : public ::testing::Test {
 protected:
  DicomDecoderTest() { WriteFile(path_, Compressed()); }

  std::string Compressed() const {
    return DicomBytes({.transfer_syntax = testing::kDicomRle}, pixels_);
  }
  absl::Status ReadPixels() { return decoder_.ReadFrame(path_, false, 0, kPixels, out_.data()); }

  TempDir dir_;
  const std::string path_ = dir_.Sub("a.dcm");
  const std::string pixels_ = testing::Noise({12, 9, 1}, ScalarType::kInt16);
  DicomDecoder decoder_{kSliceBytes};
  std::string out_ = std::string(kSliceBytes, '?');
};

TEST_F(DicomDecoderTest, FramesAndPixelsAreThoseOfTheFile) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomFrames file, decoder_.ReadFrames(path_));
  EXPECT_EQ(file.pixels, kPixels);
  EXPECT_EQ(file.pixels.frame_bytes(), kSliceBytes);
  EXPECT_EQ(file.photometric, DicomPhotometric::kMonochrome);
  EXPECT_EQ(file.series, "1.2.3");
  ASSERT_EQ(file.frames.size(), 1U);
  EXPECT_THAT(file.frames[0].position.values, ElementsAre(10, 20, 30));
  EXPECT_THAT(file.frames[0].orientation.values, ElementsAre(1, 0, 0, 0, 1, 0));
  EXPECT_THAT(file.frames[0].pixel_spacing.values, ElementsAre(2, 0.5));
  ISOSCOPE_ASSERT_OK(ReadPixels());
  EXPECT_TRUE(out_ == pixels_);
}

TEST_F(DicomDecoderTest, PixelsThatAreStoredOtherwiseAreNotRead) {
  DicomPixels other = kPixels;
  other.is_signed = false;
  EXPECT_THAT(decoder_.ReadFrame(path_, false, 0, other, out_.data()),
              StatusIs(kDataLoss, HasSubstr("stored otherwise")));
  other = kPixels;
  other.width = 11;
  EXPECT_THAT(decoder_.ReadFrame(path_, false, 0, other, out_.data()), StatusIs(kDataLoss, ""));
  EXPECT_TRUE(out_ == std::string(kSliceBytes, '?'));
}

TEST_F(DicomDecoderTest, FilesThatTheLibraryRefusesAreErrorsWithoutItsWords) {
  constexpr char kName[] = "Doe^Jane";
  WriteFile(path_, kName);
  EXPECT_THAT(decoder_.ReadFrames(path_).status(), StatusIs(kDataLoss, ""));
  EXPECT_THAT(decoder_.ReadFrames(dir_.path()).status(), StatusIs(kDataLoss, ""));
  EXPECT_THAT(decoder_.ReadFrames(dir_.Sub("none")).status(), StatusIs(kDataLoss, ""));
  EXPECT_THAT(decoder_.ReadFrames(std::string(5000, 'p')).status(),
              StatusIs(kDataLoss, HasSubstr("too long")));
  WriteFile(path_, Compressed());
  ISOSCOPE_EXPECT_OK(decoder_.ReadFrames(path_).status());
}

TEST_F(DicomDecoderTest, NumbersThatAreNotFiniteAreBroken) {
  // A slice without an order among the others.
  for (const char* position : {"nan\\20\\30", "10\\20\\inf", "1e999\\2\\3"}) {
    WriteFile(path_, DicomBytes({.position = position}, pixels_));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomFrames file, decoder_.ReadFrames(path_));
    EXPECT_EQ(file.frames[0].position.given, DicomGiven::kBroken) << position;
  }
}

TEST_F(DicomDecoderTest, AssertionsOfTheLibraryEndItsProcessAlone) {
  // Found by dicom_fuzz: five samples a pixel.
  const auto samples = [](std::uint16_t count) {
    return DicomElement(0x28, 2, "US", DicomNumber(count));
  };
  std::string bytes = Compressed();
  bytes.replace(bytes.find(samples(1)), samples(1).size(), samples(5));
  WriteFile(path_, bytes);
  EXPECT_THAT(ReadPixels(), StatusIs(kDataLoss, HasSubstr("SIGABRT")));
  WriteFile(path_, Compressed());
  ISOSCOPE_EXPECT_OK(ReadPixels());
  EXPECT_TRUE(out_ == pixels_);
}

TEST_F(DicomDecoderTest, PixelsThatTheFileDoesNotHaveAreAnErrorAndNeverTheSliceBefore) {
  ISOSCOPE_ASSERT_OK(ReadPixels());
  WriteFile(path_, DicomBytes({}, pixels_.substr(0, 100)));
  EXPECT_THAT(ReadPixels(), StatusIs(kDataLoss, ""));
}

}  // namespace
}  // namespace isoscope::source
