#include "core/formats/dicom/dicom_values.h"

#include <cstdint>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ValuesOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

// Pixels of so many bits, in all bits that are allocated unless `stored` says less.
DicomPixels Bits(std::int64_t allocated, bool is_signed = false, std::int64_t stored = 0) {
  const std::int64_t bits = stored == 0 ? allocated : stored;
  return {.width = 2,
          .height = 1,
          .bits_allocated = allocated,
          .bits_stored = bits,
          .high_bit = bits - 1,
          .is_signed = is_signed};
}

DicomValues Image(const DicomPixels& pixels, double slope, double intercept) {
  return {.pixels = pixels, .rescaling = {.slope = slope, .intercept = intercept}};
}
DicomValues Frame(const DicomPixels& pixels, double slope, double intercept) {
  DicomValues values = Image(pixels, slope, intercept);
  values.is_frame = true;
  return values;
}

TEST(DicomValuesTest, SamplesThatAreNotRescaledKeepTheTypeOfTheirPixels) {
  EXPECT_EQ(DicomSampleType({Image(Bits(8), 1, 0)}), ScalarType::kUint8);
  EXPECT_EQ(DicomSampleType({Image(Bits(8, true), 1, 0)}), ScalarType::kInt8);
  EXPECT_EQ(DicomSampleType({Frame(Bits(16), 1, 0), Frame(Bits(16), 1, 0)}), ScalarType::kUint16);
  EXPECT_EQ(DicomSampleType({Image(Bits(16, true), 1, 0)}), ScalarType::kInt16);
  EXPECT_EQ(DicomSampleType({Image(Bits(32), 1, 0)}), ScalarType::kUint32);
  EXPECT_EQ(DicomSampleType({Image(Bits(32, true), 1, 0)}), ScalarType::kInt32);
  EXPECT_EQ(DicomSampleType({Image(Bits(16, false, 8), 1, 0)}), ScalarType::kUint16)
      << "no narrower than the pixels";
}

TEST(DicomValuesTest, WholeSlopesGiveTheSmallestIntegersThatHoldEveryValue) {
  struct Case {
    DicomPixels pixels;
    double slope;
    double intercept;
    ScalarType type;
  };
  for (const Case& c : std::vector<Case>{
           {Bits(16, false, 12), 1, -1024, ScalarType::kInt16},  // -1024 to 3071, as CT
           {Bits(16), 1, -1024, ScalarType::kInt32},             // to 64511
           {Bits(16), 1, 1, ScalarType::kUint32},                // 1 to 65536
           {Bits(16, true), 1, 32768, ScalarType::kUint16},
           {Bits(16, true), 1, 32767, ScalarType::kInt32},  // from -1 on
           {Bits(16, true), -1, 0, ScalarType::kInt32},     // to 32768
           {Bits(16, true), -1, -1, ScalarType::kInt16},    // 32767 to -32768
           {Bits(8), 257, 0, ScalarType::kUint16},
           {Bits(8), 1, -128, ScalarType::kInt8},
           {Bits(8), 0, 5, ScalarType::kUint8},
           {Bits(16, false, 7), 1, 1, ScalarType::kUint16},  // 1 to 128, no narrower than pixels
           {Bits(16, true, 7), 1, 1, ScalarType::kInt16},
           {Bits(32, true, 7), 1, 1, ScalarType::kInt32},
           {Bits(32), 1, 1, ScalarType::kFloat64},  // none of 32 bits
           {Bits(32), 1, -1, ScalarType::kFloat64}}) {
    EXPECT_EQ(DicomSampleType({Image(c.pixels, c.slope, c.intercept)}), c.type)
        << c.pixels.bits_stored << " " << c.slope << " " << c.intercept;
  }
}

TEST(DicomValuesTest, SlopesThatDifferHaveOneTypeThatHoldsAll) {
  const DicomPixels bits = Bits(16);
  EXPECT_EQ(DicomSampleType({Image(bits, 1, 0), Image(bits, 2, 0)}), ScalarType::kUint32);
  EXPECT_EQ(DicomSampleType({Image(bits, 1, 0), Image(bits, 0.5, 0)}), ScalarType::kFloat64);
  EXPECT_EQ(DicomSampleType({Image(bits, 1, 0), Image(bits, 1, 0.5)}), ScalarType::kFloat64);
  EXPECT_EQ(DicomSampleType({Image(Bits(16), 1, 0), Image(Bits(16, true), 1, 0)}),
            ScalarType::kInt32)
      << "of pixels with and without a sign";
  EXPECT_EQ(DicomSampleType({Frame(bits, 1, 0), Frame(bits, 2, 0)}), ScalarType::kFloat32);
  EXPECT_EQ(DicomSampleType({Frame(bits, 1, 0), Frame(Bits(32), 2, 0)}), ScalarType::kFloat64);
  EXPECT_EQ(DicomSampleType({Frame(bits, 0.5, 0), Image(bits, 1, 0)}), ScalarType::kFloat64);
}

TEST(DicomValuesTest, BitsWithoutAMeaningAreDropped) {
  DicomPixels pixels = Bits(16, true, 12);
  std::string bytes = BytesOf(std::vector<std::uint16_t>{0xf800, 0x07ff, 0x0fff, 0x8001});
  CleanDicomPixels(pixels, 4, bytes.data());
  EXPECT_THAT(ValuesOf<std::int16_t>(bytes), ElementsAre(-2048, 2047, -1, 1));
  pixels.is_signed = false;
  bytes = BytesOf(std::vector<std::uint16_t>{0xf800, 0x07ff});
  CleanDicomPixels(pixels, 2, bytes.data());
  EXPECT_THAT(ValuesOf<std::uint16_t>(bytes), ElementsAre(0x800, 0x7ff));
  pixels.high_bit = 13;  // the value is in bits 2 to 13
  bytes = BytesOf(std::vector<std::uint16_t>{0xc007, 0x3ffc});
  CleanDicomPixels(pixels, 2, bytes.data());
  EXPECT_THAT(ValuesOf<std::uint16_t>(bytes), ElementsAre(1, 0xfff));
  bytes = std::string("\xff\x81", 2);
  CleanDicomPixels(Bits(8, true, 7), 2, bytes.data());
  EXPECT_THAT(ValuesOf<std::int8_t>(bytes), ElementsAre(-1, 1));
  bytes = BytesOf(std::vector<std::uint32_t>{0x80ffffff});
  CleanDicomPixels(Bits(32, true, 24), 1, bytes.data());
  EXPECT_THAT(ValuesOf<std::int32_t>(bytes), ElementsAre(-1));
  // All bits are stored.
  bytes = BytesOf(std::vector<std::uint16_t>{0xffff});
  CleanDicomPixels(Bits(16), 1, bytes.data());
  EXPECT_THAT(ValuesOf<std::uint16_t>(bytes), ElementsAre(0xffff));
}

TEST(DicomValuesTest, SamplesAreSlopeTimesStoredPlusIntercept) {
  const std::string stored = BytesOf(std::vector<std::uint16_t>{0, 100, 65535});
  const auto write = [&stored](const DicomValues& values, ScalarType type) {
    std::string out(3 * volume::SizeOf(type), '?');
    char* const tail = out.data() + out.size() - stored.size();  // as DicomSliceReader does
    stored.copy(tail, stored.size());
    WriteDicomSamples(values, type, 3, tail, out.data());
    return out;
  };
  EXPECT_EQ(write(Image(Bits(16), 1, 0), ScalarType::kUint16), stored);
  EXPECT_THAT(ValuesOf<std::int32_t>(write(Image(Bits(16), 1, -1024), ScalarType::kInt32)),
              ElementsAre(-1024, -924, 64511));
  EXPECT_THAT(ValuesOf<float>(write(Frame(Bits(16), 0.5, -5), ScalarType::kFloat32)),
              ElementsAre(-5, 45, 32762.5));
  EXPECT_THAT(ValuesOf<double>(write(Image(Bits(16), 0.1, 0), ScalarType::kFloat64)),
              ElementsAre(0, 100 * 0.1, 65535 * 0.1));
  EXPECT_THAT(ValuesOf<double>(write(Image(Bits(16), 1, 0), ScalarType::kFloat64)),
              ElementsAre(0, 100, 65535))
      << "not rescaled, beside slices that are";
  EXPECT_THAT(ValuesOf<std::uint16_t>(write(Image(Bits(16), 0, 7), ScalarType::kUint16)),
              ElementsAre(7, 7, 7));
}

TEST(DicomValuesTest, PixelsThatAreNoGreyNumbersAreRefusedByName) {
  const auto check = [](const DicomPixels& pixels,
                        DicomPhotometric photometric = DicomPhotometric::kMonochrome) {
    return CheckDicomPixels(pixels, photometric);
  };
  ISOSCOPE_EXPECT_OK(check(Bits(16, true, 12)));
  ISOSCOPE_EXPECT_OK(check(Bits(8), DicomPhotometric::kMissing));
  EXPECT_THAT(check(Bits(8), DicomPhotometric::kPalette), StatusIs(kInvalid, HasSubstr("palette")));
  EXPECT_THAT(check(Bits(8), DicomPhotometric::kColour), StatusIs(kInvalid, HasSubstr("colour")));
  EXPECT_THAT(check(Bits(8), DicomPhotometric::kOther), StatusIs(kInvalid, HasSubstr("0028,0004")));
  DicomPixels pixels = Bits(8);
  pixels.components = 3;
  EXPECT_THAT(check(pixels), StatusIs(kInvalid, HasSubstr("3 components")));
  for (const std::int64_t bits : {0, 1, 12, 64}) {
    EXPECT_THAT(check(Bits(bits)), StatusIs(kInvalid, HasSubstr("8, 16 or 32 bits"))) << bits;
  }
  EXPECT_THAT(check(Bits(16, false, 17)), StatusIs(kInvalid, HasSubstr("17 bits stored")));
  pixels = Bits(16, false, 12);
  pixels.high_bit = 10;
  EXPECT_THAT(check(pixels), StatusIs(kInvalid, HasSubstr("12 bits stored below bit 10")));
  pixels.high_bit = 16;
  EXPECT_THAT(check(pixels), StatusIs(kInvalid));
  pixels = Bits(16);
  pixels.bits_stored = 0;
  EXPECT_THAT(check(pixels), StatusIs(kInvalid));
  pixels = Bits(16);
  pixels.height = 0;
  EXPECT_THAT(check(pixels), StatusIs(kInvalid, HasSubstr("2 x 0 pixels")));
}

}  // namespace
}  // namespace isoscope::source
