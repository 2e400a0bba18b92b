// Images that OpenJPEG and libjpeg-turbo write.

#include "core/source/bytes/jpeg_slice.h"

#include <openjpeg.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/image/jpeg_codec.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/dicom/htj2k_bytes.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::ReadFile;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr int kWidth = 50;
constexpr int kHeight = 40;

struct Jpeg2000Options {
  bool is_alone = false;  // a codestream without boxes
  int bits = 16;
  bool is_signed = false;
  int tile = 0;  // its side; 0: one for all
  unsigned components = 1;
  bool has_parts = false;  // a part of a tile for each resolution
};

// Sample i of the image, in the range of its type.
std::int32_t SampleAt(int i, const Jpeg2000Options& options) {
  const std::int32_t sample = (i * i / 7) & ((1 << options.bits) - 1);
  return options.is_signed ? sample - (1 << (options.bits - 1)) : sample;
}

std::string Jpeg2000(const Jpeg2000Options& options) {
  const TempDir dir;
  opj_cparameters_t parameters;
  opj_set_default_encoder_parameters(&parameters);
  parameters.tcp_numlayers = 1;
  parameters.cp_disto_alloc = 1;
  parameters.tile_size_on = options.tile > 0 ? OPJ_TRUE : OPJ_FALSE;
  parameters.cp_tdx = options.tile;
  parameters.cp_tdy = options.tile;
  parameters.numresolution = 3;
  parameters.tp_on = options.has_parts ? 1 : 0;
  parameters.tp_flag = 'R';
  opj_image_cmptparm_t component{};
  component.dx = 1;
  component.dy = 1;
  component.w = kWidth;
  component.h = kHeight;
  component.prec = static_cast<OPJ_UINT32>(options.bits);
  component.sgnd = options.is_signed ? 1 : 0;
  std::vector<opj_image_cmptparm_t> components(options.components, component);
  opj_image_t* const image =
      opj_image_create(options.components, components.data(),
                       options.components == 1 ? OPJ_CLRSPC_GRAY : OPJ_CLRSPC_SRGB);
  image->x1 = kWidth;
  image->y1 = kHeight;
  for (unsigned c = 0; c < options.components; ++c) {
    for (int i = 0; i < kWidth * kHeight; ++i) {
      image->comps[c].data[i] = SampleAt(i, options);
    }
  }
  opj_codec_t* const codec = opj_create_compress(options.is_alone ? OPJ_CODEC_J2K : OPJ_CODEC_JP2);
  opj_stream_t* const stream =
      opj_stream_create_default_file_stream(dir.Sub("a").c_str(), OPJ_FALSE);
  EXPECT_TRUE(opj_setup_encoder(codec, &parameters, image) &&
              opj_start_compress(codec, image, stream) && opj_encode(codec, stream) &&
              opj_end_compress(codec, stream));
  opj_stream_destroy(stream);
  opj_destroy_codec(codec);
  opj_image_destroy(image);
  return ReadFile(dir.Sub("a"));
}

std::string BigEndian(std::uint64_t number, int bytes) {
  std::string text;
  while (bytes-- > 0) {
    text += static_cast<char>(number >> (8 * bytes));
  }
  return text;
}

template <typename T>
void ExpectSamples(const SliceImage& slice, const Jpeg2000Options& options) {
  const std::vector<T> samples = testing::ValuesOf<T>(slice.samples);
  ASSERT_EQ(samples.size(), static_cast<std::size_t>(kWidth * kHeight));
  for (int i = 0; i < kWidth * kHeight; ++i) {
    ASSERT_EQ(samples[static_cast<std::size_t>(i)], SampleAt(i, options)) << i;
  }
}

class JpegSliceTest : public ::testing::Test {
 protected:
  absl::StatusOr<SliceImage> Read(const std::string& bytes,
                                  SlicePart part = SlicePart::kAll) const {
    WriteFile(dir_.Sub("f"), bytes);
    return ReadJpeg2000Slice(dir_.Sub("f"), part);
  }
  absl::StatusOr<SliceImage> ReadJpeg(const std::string& bytes) const {
    WriteFile(dir_.Sub("f"), bytes);
    return ReadJpegSlice(dir_.Sub("f"), SlicePart::kAll);
  }

  TempDir dir_;
};

TEST_F(JpegSliceTest, Jpeg2000OfAnyBitsSignAndTilesHasTheSamplesThatWereWritten) {
  for (const bool is_alone : {false, true}) {
    for (const int bits : {1, 8, 9, 12, 16}) {
      for (const bool is_signed : {false, true}) {
        for (const int tile : {0, 16}) {
          const Jpeg2000Options options{.is_alone = is_alone,
                                        .bits = bits,
                                        .is_signed = is_signed,
                                        .tile = tile,
                                        .has_parts = bits == 12};
          SCOPED_TRACE(absl::StrCat(is_alone, " ", bits, " ", is_signed, " ", tile));
          const std::string bytes = Jpeg2000(options);
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SliceImage header, Read(bytes, SlicePart::kHeader));
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SliceImage slice, Read(bytes));
          EXPECT_TRUE(header.samples.empty());
          EXPECT_EQ(slice.width, kWidth);
          EXPECT_EQ(slice.height, kHeight);
          EXPECT_EQ(slice.type, header.type);
          ASSERT_EQ(slice.type, bits <= 8 ? (is_signed ? ScalarType::kInt8 : ScalarType::kUint8)
                                          : (is_signed ? ScalarType::kInt16 : ScalarType::kUint16));
          switch (slice.type) {
            case ScalarType::kInt8:
              ExpectSamples<std::int8_t>(slice, options);
              break;
            case ScalarType::kUint8:
              ExpectSamples<std::uint8_t>(slice, options);
              break;
            case ScalarType::kInt16:
              ExpectSamples<std::int16_t>(slice, options);
              break;
            default:
              ExpectSamples<std::uint16_t>(slice, options);
          }
        }
      }
    }
  }
}

TEST_F(JpegSliceTest, Jpeg2000OfColoursOrMoreBitsIsRefused) {
  EXPECT_THAT(Read(Jpeg2000({.bits = 8, .components = 3})),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("f: a colour image")));
  EXPECT_THAT(Read(Jpeg2000({.bits = 20}), SlicePart::kHeader),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("samples of 20 bits")));
  EXPECT_THAT(Read("no image"),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("f: can't be read as JPEG 2000")));
}

TEST_F(JpegSliceTest, Jpeg2000ThatIsCutIsRefusedWhereverItEnds) {
  for (const Jpeg2000Options& options :
       {Jpeg2000Options{.tile = 32}, Jpeg2000Options{.is_alone = true, .has_parts = true}}) {
    const std::string whole = Jpeg2000(options);
    ISOSCOPE_EXPECT_OK(Read(whole).status());
    ISOSCOPE_EXPECT_OK(Read(whole + "behind").status());
    for (std::size_t size = 0; size < whole.size(); ++size) {
      ASSERT_FALSE(HasAllTiles(whole.substr(0, size))) << size << " of " << whole.size();
    }
    EXPECT_THAT(Read(whole.substr(0, whole.size() - 1)),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("do not have all tiles")));
  }
}

TEST_F(JpegSliceTest, TileOrPartThatIsMissingIsNotFilledUp) {
  for (const bool has_parts : {false, true}) {
    const std::string whole =
        Jpeg2000({.is_alone = true, .tile = has_parts ? 0 : 32, .has_parts = has_parts});
    const std::size_t first = whole.find("\xff\x90");
    const std::size_t second = whole.find("\xff\x90", first + 2);
    ASSERT_NE(second, std::string::npos);
    ASSERT_TRUE(HasAllTiles(whole));
    EXPECT_FALSE(HasAllTiles(whole.substr(0, first) + whole.substr(second)));
  }
  // Five tiles in place of four, of which one is there: OpenJPEG would read zeros.
  std::string wider = Jpeg2000({.is_alone = true});
  wider[11] = static_cast<char>(wider[11] + kWidth);
  EXPECT_FALSE(HasAllTiles(wider));
}

TEST_F(JpegSliceTest, BoxesMayHaveLongLengthsOrNone) {
  const std::string alone = Jpeg2000({.is_alone = true});
  const std::string signature = BigEndian(12, 4) + "jP  \r\n\x87\n";
  EXPECT_TRUE(HasAllTiles(signature + BigEndian(alone.size() + 8, 4) + "jp2c" + alone));
  EXPECT_TRUE(
      HasAllTiles(signature + BigEndian(1, 4) + "jp2c" + BigEndian(alone.size() + 16, 8) + alone));
  EXPECT_TRUE(HasAllTiles(signature + BigEndian(0, 4) + "jp2c" + alone));
  EXPECT_FALSE(HasAllTiles(signature + BigEndian(12, 4) + "free" + alone));
  EXPECT_FALSE(HasAllTiles(signature + BigEndian(4, 4) + "jp2c" + alone)) << "a lying length";
  EXPECT_TRUE(HasAllTiles(signature + BigEndian(alone.size() + 9, 4) + "jp2c" + alone))
      << "as some writers have it";
  EXPECT_FALSE(HasAllTiles(signature + BigEndian(alone.size() + 9, 4) + "free" + alone));
  EXPECT_FALSE(HasAllTiles(signature + BigEndian(1, 4) + "jp2c" + BigEndian(16, 4)));
}

TEST_F(JpegSliceTest, TileBeyondTheLastIsNoTile) {
  std::string alone = Jpeg2000({.is_alone = true});
  alone[alone.find("\xff\x90") + 5] = 1;  // of one tile, number 0
  EXPECT_FALSE(HasAllTiles(alone));
}

TEST_F(JpegSliceTest, PaletteMakesColours) {
  const std::string alone = Jpeg2000({.is_alone = true, .bits = 8});
  const auto box = [](const std::string& kind, const std::string& data) {
    return BigEndian(data.size() + 8, 4) + kind + data;
  };
  const std::string size =
      box("ihdr", BigEndian(kHeight, 4) + BigEndian(kWidth, 4) + std::string("\0\1\7\7\0\0", 6));
  const std::string colours = box("colr", std::string("\1\0\0\0\0\0\x10", 7));  // sRGB
  std::string entries = BigEndian(256, 2) + "\3\7\7\7";
  for (int i = 0; i < 256; ++i) {
    entries += BigEndian(static_cast<std::uint64_t>(i), 1) + "ab";
  }
  const std::string palette = box("pclr", entries);
  const std::string channels = box("cmap", std::string("\0\0\1\0\0\0\1\1\0\0\1\2", 12));
  const std::string file = BigEndian(12, 4) + "jP  \r\n\x87\n" +
                           box("ftyp", "jp2 " + BigEndian(0, 4) + "jp2 ") +
                           box("jp2h", size + colours + palette + channels) + box("jp2c", alone);
  EXPECT_THAT(Read(file),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("f: a colour image")));
}

TEST_F(JpegSliceTest, MarksWithoutALengthStandInTheHeader) {
  std::string alone = Jpeg2000({.is_alone = true});
  alone.insert(alone.find("\xff\x90"), "\xff\x30\xff\x3f");
  EXPECT_TRUE(HasAllTiles(alone));
}

TEST_F(JpegSliceTest, NumberOfPartsMayBeUnknown) {
  std::string alone = Jpeg2000({.is_alone = true});
  alone[alone.find("\xff\x90") + 11] = 0;
  EXPECT_TRUE(HasAllTiles(alone));
}

TEST_F(JpegSliceTest, LastTilePartMayHaveNoLength) {
  std::string alone = Jpeg2000({.is_alone = true});
  const std::size_t part = alone.find("\xff\x90");
  ASSERT_NE(part, std::string::npos);
  alone.replace(part + 6, 4, 4, '\0');
  EXPECT_TRUE(HasAllTiles(alone));
  EXPECT_FALSE(HasAllTiles(alone.substr(0, alone.size() - 1)));
  EXPECT_FALSE(HasAllTiles(alone.substr(0, part + 12)));
  alone.replace(part + 6, 4, BigEndian(2, 4));  // less than its own segment
  EXPECT_FALSE(HasAllTiles(alone));
}

TEST_F(JpegSliceTest, JpegOfEqualColoursIsGreyAndOthersAreRefused) {
  std::vector<image::Rgba8> pixels;
  for (int i = 0; i < 64; ++i) {
    const auto grey = static_cast<std::uint8_t>(4 * i);
    pixels.push_back({grey, grey, grey, 255});
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string grey, image::EncodeJpeg(8, 8, pixels, {}, 100));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SliceImage slice, ReadJpeg(grey));
  EXPECT_EQ(slice.width, 8);
  EXPECT_EQ(slice.type, ScalarType::kUint8);
  ASSERT_EQ(slice.samples.size(), 64U);
  for (std::size_t i = 0; i < 64; ++i) {
    EXPECT_NEAR(static_cast<std::uint8_t>(slice.samples[i]), static_cast<double>(4 * i), 2);
  }
  for (std::size_t size = 0; size < grey.size(); ++size) {
    EXPECT_THAT(ReadJpeg(grey.substr(0, size)),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("f: no readable JPEG")))
        << size;
  }
  for (std::uint8_t more = 20; more < 160; ++more) {
    const auto other = static_cast<std::uint8_t>(90 + more);
    for (const image::Rgba8 colour :
         {image::Rgba8{other, 90, 90, 255}, image::Rgba8{90, other, 90, 255},
          image::Rgba8{90, 90, other, 255}}) {  // some decode to two equal ones
      pixels.assign(64, colour);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string colours,
                                    image::EncodeJpeg(8, 8, pixels, {}, 100));
      ASSERT_THAT(ReadJpeg(colours),
                  StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("a colour image")));
    }
  }
}

TEST_F(JpegSliceTest, HighThroughputCodestreamsAreDecodedFromBytes) {
  const std::string bytes = isoscope::testing::Htj2kBytes();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SliceImage image,
                                DecodeJpeg2000(bytes, "x", SlicePart::kAll));
  EXPECT_EQ(image.width, 8);
  EXPECT_EQ(image.height, 8);
  EXPECT_EQ(image.bits, 12);
  EXPECT_EQ(image.type, volume::ScalarType::kUint16);
  EXPECT_EQ(image.samples, isoscope::testing::BytesOf(isoscope::testing::Htj2kSamples()));
  EXPECT_THAT(DecodeJpeg2000(bytes.substr(0, 150), "x", SlicePart::kAll),
              StatusIs(absl::StatusCode::kDataLoss));
}

}  // namespace
}  // namespace isoscope::source
