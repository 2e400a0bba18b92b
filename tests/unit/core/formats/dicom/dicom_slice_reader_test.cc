#include "core/formats/dicom/dicom_slice_reader.h"

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/math/vec.h"
#include "core/volume/scalar_type.h"
#include "tests/support/dicom_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::DicomBytes;
using ::isoscope::testing::DicomElement;
using ::isoscope::testing::DicomItem;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ValuesOf;
using ::isoscope::testing::WriteFile;
using ::testing::AllOf;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr auto kDataLoss = absl::StatusCode::kDataLoss;
constexpr int kSamples = 4 * 3;
constexpr std::size_t kSliceBytes = kSamples * 2;

// Sample i of an image is 100 image + i.
std::string Pixels(int image) {
  std::vector<std::int16_t> values;
  for (int i = 0; i < kSamples; ++i) {
    values.push_back(static_cast<std::int16_t>(100 * image + i));
  }
  return BytesOf(values);
}

class DicomSliceReaderTest : public ::testing::Test {
 protected:
  // A slice of 4 x 3.
  std::string Write(const std::string& name, testing::DicomSlice slice, const std::string& pixels) {
    slice.width = 4;
    slice.height = 3;
    return dir_.Write(name, DicomBytes(slice, pixels));
  }
  // Two frames, images 0 and 1, of which the second has slope 0.5 and intercept -5.
  std::string WriteFrames(const std::string& name, bool first_has_values = true) {
    std::string frames;
    for (const int z : {34, 30}) {
      const std::string position = DicomElement(0x20, 0x32, "DS", absl::StrCat("10\\20\\", z));
      const bool is_second = z == 30;
      const std::string values = DicomElement(0x28, 0x1052, "DS", is_second ? "-5" : "0") +
                                 DicomElement(0x28, 0x1053, "DS", is_second ? "0.5" : "1");
      frames += DicomItem(DicomElement(0x20, 0x9113, "SQ", DicomItem(position)) +
                          (is_second || first_has_values
                               ? DicomElement(0x28, 0x9145, "SQ", DicomItem(values))
                               : ""));
    }
    return Write(name,
                 {.storage_class = "1.2.840.10008.5.1.4.1.1.4.1",
                  .more = DicomElement(0x5200, 0x9230, "SQ", frames),
                  .frames = 2},
                 Pixels(0) + Pixels(1));
  }
  absl::StatusOr<std::vector<DicomSlice>> Read(const std::string& path) {
    const auto scan = ScanDicomFile(path);
    auto slices = scan.ok() ? ReadDicomSlices(path, *scan, &decoder_) : scan.status();
    if (slices.ok()) {
      SetDicomSampleTypes(&*slices);
    }
    return slices;
  }

  testing::TempDir dir_;
  DicomDecoder decoder_;
};

TEST_F(DicomSliceReaderTest, FileOfOneImageIsOneSlice) {
  const std::string path = Write("a", {.number = 9}, Pixels(3));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<DicomSlice> slices, Read(path));
  ASSERT_EQ(slices.size(), 1U);
  const DicomSlice& slice = slices[0];
  EXPECT_EQ(slice.path, path);
  EXPECT_EQ(slice.frame, -1);
  EXPECT_EQ(slice.width, 4);
  EXPECT_EQ(slice.height, 3);
  EXPECT_EQ(slice.type, ScalarType::kInt16);
  EXPECT_EQ(slice.origin, (math::Vec3d{10, 20, 30}));
  EXPECT_EQ(slice.spacing.x, 0.5);
  EXPECT_EQ(slice.spacing.y, 2);
  EXPECT_EQ(slice.direction.columns[2], (math::Vec3d{0, 0, 1}));
  EXPECT_EQ(slice.position, 30);
  EXPECT_EQ(slice.moment.instance_number, 9);

  DicomSliceReader reader(slices);
  std::string out(kSliceBytes, '?');
  ISOSCOPE_ASSERT_OK(reader.ReadSlice(0, out.data()));
  EXPECT_EQ(out, Pixels(3));
}

TEST_F(DicomSliceReaderTest, FramesAreSlicesWithTheirOwnRescaling) {
  const std::string path = WriteFrames("a");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<DicomSlice> slices, Read(path));
  ASSERT_EQ(slices.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(slices[i].frame, static_cast<std::int64_t>(i));
    EXPECT_EQ(slices[i].values.pixels.bits_stored, 16);
    EXPECT_EQ(slices[i].type, ScalarType::kFloat32) << "one of the frames is rescaled";
    EXPECT_TRUE(slices[i].values.is_frame);
    EXPECT_EQ(slices[i].spacing, (math::Vec3d{0.5, 2, 1}));
    EXPECT_EQ(slices[i].moment.instance_number, 65536 + static_cast<double>(i))
        << "behind those of files before this one";
  }
  EXPECT_EQ(slices[0].position, 34);
  EXPECT_EQ(slices[1].position, 30);
  EXPECT_EQ(slices[0].values.rescaling, Rescaling());
  EXPECT_EQ(slices[1].values.rescaling, (Rescaling{.slope = 0.5, .intercept = -5}));

  DicomSliceReader reader(slices);
  ISOSCOPE_ASSERT_OK(reader.Start());
  std::string out(kSamples * sizeof(float), '?');
  ISOSCOPE_ASSERT_OK(reader.ReadSlice(1, out.data()));
  for (int i = 0; i < kSamples; ++i) {
    EXPECT_EQ(ValuesOf<float>(out)[static_cast<std::size_t>(i)],
              0.5F * static_cast<float>(100 + i) - 5);
  }
  ISOSCOPE_ASSERT_OK(reader.ReadSlice(0, out.data()));
  EXPECT_EQ(ValuesOf<float>(out)[kSamples - 1], kSamples - 1);
}

TEST_F(DicomSliceReaderTest, GroupOfValuesInSomeFramesOnlyIsRefused) {
  EXPECT_THAT(Read(WriteFrames("a", false)),
              StatusIs(kInvalid, AllOf(HasSubstr("1 of its 2 frames have a slope"),
                                       HasSubstr("(0028,9145), frame 0 has none"))));
}

TEST_F(DicomSliceReaderTest, FramesOfReferenceAndUnitsOfValuesAreTold) {
  const auto read = [this](testing::DicomSlice slice) {
    return Read(Write("a", slice, Pixels(1)));
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<DicomSlice> ct,
                                read({.frame_of_reference = "1.2.77"}));
  EXPECT_EQ(ct[0].frame_of_reference, "1.2.77");
  EXPECT_EQ(ct[0].value_unit, "HU") << "of CT without a type";
  const std::string type = DicomElement(0x28, 0x1054, "LO", "OD");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<DicomSlice> density, read({.more = type}));
  EXPECT_EQ(density[0].frame_of_reference, "");
  EXPECT_EQ(density[0].value_unit, "OD");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<DicomSlice> pet,
                                read({.storage_class = "1.2.840.10008.5.1.4.1.1.128",
                                      .more = type + DicomElement(0x54, 0x1001, "CS", "BQML")}));
  EXPECT_EQ(pet[0].value_unit, "BQML");
}

TEST_F(DicomSliceReaderTest, HeadersThatAreNoSliceAreRefusedWithTheirFile) {
  const std::string path =
      Write("a", {.series = "1.2.8", .frames = 3}, Pixels(0) + Pixels(1) + Pixels(2));
  EXPECT_THAT(Read(path).status(),
              StatusIs(kInvalid, HasSubstr("no spacing between slices (0018,0088)")));
  WriteFile(path, "no DICOM");
  DicomScan scan;
  scan.transfer_syntax = "1.2.840.10008.1.2.4.91";
  EXPECT_THAT(ReadDicomSlices(path, scan, &decoder_).status(),
              StatusIs(kInvalid, AllOf(HasSubstr(path + ": can't be decoded"),
                                       HasSubstr("(transfer syntax 1.2.840.10008.1.2.4.91)"))));
}

// The values of a series of four slices, each with what the file says of slope and intercept.
TEST_F(DicomSliceReaderTest, EachSliceHasItsOwnSlopeOneOfThemNone) {
  std::vector<DicomSlice> slices;
  const std::vector<std::pair<const char*, const char*>> values{
      {"0.5", "0"}, {"1", "0"}, {"", ""}, {"2", "-7.5"}};
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::string path = Write(absl::StrCat(i),
                                   {.position = absl::StrCat("0\\0\\", i),
                                    .intercept = values[i].second,
                                    .slope = values[i].first},
                                   Pixels(1));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<DicomSlice> read, Read(path));
    slices.push_back(read[0]);
  }
  SetDicomSampleTypes(&slices);
  ASSERT_EQ(slices[0].type, ScalarType::kFloat64);
  DicomSliceReader reader(slices);
  std::string out(kSamples * sizeof(double), '?');
  const std::vector<double> expected{50, 100, 100, 192.5};
  for (std::size_t z = 0; z < expected.size(); ++z) {
    ISOSCOPE_ASSERT_OK(reader.ReadSlice(static_cast<std::int64_t>(z), out.data()));
    EXPECT_EQ(ValuesOf<double>(out)[0], expected[z]) << z;
  }
}

TEST_F(DicomSliceReaderTest, SlopesThatAreHalfGivenOrNoNumberAreNamed) {
  struct Case {
    const char* slope;
    const char* intercept;
    const char* words;
  };
  for (const Case& c : {Case{"nan", "0", "(0028,1053) is there, but is no number"},
                        {"1\\2", "0", "(0028,1053) is there, but is no number"},
                        {"2", "x", "(0028,1052) is there, but is no number"},
                        {"2", "", "slope (0028,1053) of 2 without an intercept"},
                        {"", "5", "intercept (0028,1052) of 5 without a slope"},
                        {"0", "0", "(0028,1053) is 0"}}) {
    const std::string path = Write("a", {.intercept = c.intercept, .slope = c.slope}, Pixels(1));
    EXPECT_THAT(Read(path), StatusIs(kInvalid, HasSubstr(c.words))) << c.slope << c.intercept;
  }
  // Neither changes a value.
  for (const auto& [slope, intercept] :
       {std::pair("1", ""), std::pair("", "0"), std::pair("", "")}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const std::vector<DicomSlice> slices,
        Read(Write("a", {.intercept = intercept, .slope = slope}, Pixels(1))));
    EXPECT_EQ(slices[0].values.rescaling, Rescaling());
  }
}

TEST_F(DicomSliceReaderTest, SlopeOf0IsTakenOfABlankSlice) {
  const std::string path =
      Write("a", {.intercept = "3", .slope = "0"}, std::string(kSliceBytes, '\0'));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<DicomSlice> slices, Read(path));
  DicomSliceReader reader(slices);
  std::string out(kSliceBytes, '?');
  ASSERT_EQ(volume::SizeOf(slices[0].type), 2U);
  ISOSCOPE_ASSERT_OK(reader.ReadSlice(0, out.data()));
  EXPECT_EQ(ValuesOf<std::int16_t>(out)[kSamples - 1], 3);
}

TEST_F(DicomSliceReaderTest, DosesNeedTheirScaling) {
  const auto read = [this](const char* scaling) {
    return Read(Write("a",
                      {.storage_class = "1.2.840.10008.5.1.4.1.1.481.2",
                       .more = DicomElement(0x3004, 0xe, "DS", scaling),
                       .intercept = "9",
                       .slope = "7"},
                      Pixels(1)));
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<DicomSlice> slices, read("0.25"));
  EXPECT_EQ(slices[0].values.rescaling, (Rescaling{.slope = 0.25})) << "doses have no other";
  EXPECT_THAT(read(""), StatusIs(kInvalid, HasSubstr("no dose grid scaling (3004,000e)")));
  EXPECT_THAT(read("0"), StatusIs(kInvalid, HasSubstr("of 0")));
  EXPECT_THAT(read("-1"), StatusIs(kInvalid, HasSubstr("of -1")));
  EXPECT_THAT(read("nan"), StatusIs(kInvalid, HasSubstr("is no number")));
}

TEST_F(DicomSliceReaderTest, Monochrome1IsNotInverted) {
  const std::string path =
      Write("a", {.photometric = "MONOCHROME1", .intercept = "-1024", .slope = "1"}, Pixels(1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<DicomSlice> slices, Read(path));
  DicomSliceReader reader(slices);
  std::string out(kSamples * sizeof(std::int32_t), '?');
  ASSERT_EQ(slices[0].type, ScalarType::kInt32);
  ISOSCOPE_ASSERT_OK(reader.ReadSlice(0, out.data()));
  EXPECT_EQ(ValuesOf<std::int32_t>(out)[2], 102 - 1024);
}

TEST_F(DicomSliceReaderTest, FilesOfOtherKindsAreNamed) {
  EXPECT_THAT(Read(Write("a", {.photometric = "PALETTE COLOR"}, Pixels(1))),
              StatusIs(kInvalid, AllOf(HasSubstr("palette"), HasSubstr("expected greyscale"))));
  EXPECT_THAT(Read(Write("a", {.image_type = "ORIGINAL\\PRIMARY\\M\\MOSAIC"}, Pixels(1))),
              StatusIs(kInvalid, AllOf(HasSubstr("a mosaic"), HasSubstr("dcm2niix"))));
  EXPECT_THAT(Read(Write("a",
                         {.more = DicomElement(0x28, 0x3000, "SQ",
                                               DicomItem(DicomElement(0x28, 0x3003, "LO", "x")))},
                         Pixels(1))),
              StatusIs(kInvalid, AllOf(HasSubstr("(0028,3000)"), HasSubstr("apply_modality_lut"))));
}

TEST_F(DicomSliceReaderTest, CompressedSlicesAreDecodedAndCleaned) {
  testing::DicomSlice slice{.transfer_syntax = testing::kDicomRle};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<DicomSlice> slices,
                                Read(Write("a", slice, Pixels(4))));
  DicomSliceReader reader(slices);
  ISOSCOPE_ASSERT_OK(reader.Start());
  std::string out(kSliceBytes, '?');
  ISOSCOPE_ASSERT_OK(reader.ReadSlice(0, out.data()));
  EXPECT_EQ(out, Pixels(4));
}

TEST_F(DicomSliceReaderTest, FileThatIsAnotherThanBeforeIsAnError) {
  const std::string path = Write("a", {}, Pixels(0));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<DicomSlice> slices, Read(path));
  DicomSliceReader reader(slices);
  std::string out(kSliceBytes, '?');
  WriteFile(path, DicomBytes({.width = 3, .height = 4}, Pixels(1)));
  EXPECT_THAT(reader.ReadSlice(0, out.data()),
              StatusIs(kDataLoss, HasSubstr("changed while it was read")));
  const std::string whole = DicomBytes({.width = 4, .height = 3}, Pixels(1));
  WriteFile(path, whole.substr(0, whole.size() - 1));
  EXPECT_THAT(reader.ReadSlice(0, out.data()), StatusIs(kInvalid, DicomCutError(path).message()));
  WriteFile(path, whole);
  ISOSCOPE_ASSERT_OK(reader.ReadSlice(0, out.data()));
  EXPECT_EQ(out, Pixels(1));
}

}  // namespace
}  // namespace isoscope::source
