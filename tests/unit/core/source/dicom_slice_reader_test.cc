#include "core/source/dicom_slice_reader.h"

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
#include "tests/unit/core/source/vti_bytes.h"

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
    WriteFile(dir_.Sub(name), DicomBytes(slice, pixels));
    return dir_.Sub(name);
  }
  // Two frames, images 0 and 1, of which the second has slope 0.5 and intercept -5.
  std::string WriteFrames(const std::string& name) {
    std::string frames;
    for (const int z : {34, 30}) {
      const std::string position = DicomElement(0x20, 0x32, "DS", absl::StrCat("10\\20\\", z));
      const std::string values =
          DicomElement(0x28, 0x1052, "DS", "-5") + DicomElement(0x28, 0x1053, "DS", "0.5");
      frames += DicomItem(DicomElement(0x20, 0x9113, "SQ", DicomItem(position)) +
                          (z == 30 ? DicomElement(0x28, 0x9145, "SQ", DicomItem(values)) : ""));
    }
    return Write(name,
                 {.storage_class = "1.2.840.10008.5.1.4.1.1.4.1",
                  .more = DicomElement(0x5200, 0x9230, "SQ", frames),
                  .frames = 2},
                 Pixels(0) + Pixels(1));
  }
  absl::StatusOr<std::vector<DicomSlice>> Read(const std::string& path) {
    const auto scan = ScanDicomFile(path);
    return scan.ok() ? ReadDicomSlices(path, *scan, &decoder_) : scan.status();
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
    EXPECT_EQ(slices[i].stored_type, ScalarType::kInt16);
    EXPECT_EQ(slices[i].type, ScalarType::kFloat32) << "one of the frames is rescaled";
    EXPECT_TRUE(slices[i].is_rescaled);
    EXPECT_EQ(slices[i].spacing, (math::Vec3d{0.5, 2, 1}));
    EXPECT_EQ(slices[i].moment.instance_number, static_cast<double>(i));
  }
  EXPECT_EQ(slices[0].position, 34);
  EXPECT_EQ(slices[1].position, 30);
  EXPECT_EQ(slices[0].rescaling, Rescaling());
  EXPECT_EQ(slices[1].rescaling, (Rescaling{.slope = 0.5, .intercept = -5}));

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

TEST_F(DicomSliceReaderTest, HeadersThatAreNoSliceAreRefusedWithTheirFile) {
  const std::string path =
      Write("a", {.series = "1.2.8", .frames = 3}, Pixels(0) + Pixels(1) + Pixels(2));
  EXPECT_THAT(Read(path).status(), StatusIs(kInvalid, HasSubstr("frame 0 of 3 has no position")));
  WriteFile(path, "no DICOM");
  DicomScan scan;
  scan.transfer_syntax = "1.2.840.10008.1.2.4.91";
  EXPECT_THAT(ReadDicomSlices(path, scan, &decoder_).status(),
              StatusIs(kInvalid, AllOf(HasSubstr(path + ": can't be decoded"),
                                       HasSubstr("(transfer syntax 1.2.840.10008.1.2.4.91)"))));
  scan.transfer_syntax = "1.2.840.10008.1.2.4.202";
  EXPECT_THAT(ReadDicomSlices(path, scan, &decoder_).status(),
              StatusIs(kInvalid, HasSubstr("High-Throughput JPEG 2000")));
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
