// Stacks written by libtiff, and damaged ones:
//
// - pages of every type, byte order, compression and shape, as one file and as many;
// - parts of slices, and the order of names with numbers;
// - mixed slices, colours, cut files, and strips that inflate to too little;
// - channels, steps and sizes of OME-XML, ImageJ and LSM, and of --axes.

#include "core/formats/stacks/tiff_source.h"

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/stacks/lsm_bytes.h"
#include "tests/unit/core/formats/stacks/tiff_files.h"
#include "tiffio.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Noise;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::ReadFile;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::TiffStackFile;
using ::isoscope::testing::WriteFile;
using ::isoscope::testing::WriteTiffStack;
using ::testing::_;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr math::Index3 kDims{37, 21, 6};

struct Page {
  ScalarType type = ScalarType::kUint16;
  std::uint16_t compression = COMPRESSION_NONE;
  bool is_tiled = false;
  std::uint16_t samples_per_pixel = 1;
  bool has_palette = false;
};

// Adds a page of width x height to an open file.
void AddPage(TIFF* tiff, const Page& page, std::uint32_t width, std::uint32_t height,
             const char* samples) {
  const bool is_float = page.type == ScalarType::kFloat32 || page.type == ScalarType::kFloat64;
  const bool is_signed = page.type == ScalarType::kInt8 || page.type == ScalarType::kInt16 ||
                         page.type == ScalarType::kInt32;
  const std::size_t size = volume::SizeOf(page.type);
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, width);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, height);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, static_cast<int>(8 * size));
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, static_cast<int>(page.samples_per_pixel));
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC,
               page.has_palette              ? PHOTOMETRIC_PALETTE
               : page.samples_per_pixel == 1 ? PHOTOMETRIC_MINISBLACK
                                             : PHOTOMETRIC_RGB);
  if (page.has_palette) {
    std::vector<std::uint16_t> channel(256);
    TIFFSetField(tiff, TIFFTAG_COLORMAP, channel.data(), channel.data(), channel.data());
  }
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, static_cast<int>(page.compression));
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT,
               is_float    ? SAMPLEFORMAT_IEEEFP
               : is_signed ? SAMPLEFORMAT_INT
                           : SAMPLEFORMAT_UINT);
  const std::size_t row_bytes = width * size * page.samples_per_pixel;
  if (page.is_tiled) {
    constexpr std::uint32_t kTile = 16;
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, kTile);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, kTile);
    for (std::uint32_t y = 0; y < height; y += kTile) {
      for (std::uint32_t x = 0; x < width; x += kTile) {
        std::string tile(kTile * kTile * size, '\0');
        for (std::uint32_t row = 0; row < std::min(kTile, height - y); ++row) {
          std::copy_n(samples + (y + row) * row_bytes + x * size, std::min(kTile, width - x) * size,
                      tile.data() + row * kTile * size);
        }
        ASSERT_GE(TIFFWriteTile(tiff, tile.data(), x, y, 0, 0), 0);
      }
    }
  } else {
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 5);
    for (std::uint32_t y = 0; y < height; ++y) {
      std::string row(samples + y * row_bytes, row_bytes);
      ASSERT_GE(TIFFWriteScanline(tiff, row.data(), y, 0), 0);
    }
  }
  ASSERT_NE(TIFFWriteDirectory(tiff), 0);
}

// A file of kDims.z pages. `mode`: "wl" little-endian, "wb" big-endian, "w8" BigTIFF.
void WritePages(const std::string& path, const char* mode, const Page& page,
                const std::string& samples) {
  TIFF* const tiff = TIFFOpen(path.c_str(), mode);
  ASSERT_NE(tiff, nullptr);
  const std::size_t plane = samples.size() / static_cast<std::size_t>(kDims.z);
  for (std::size_t z = 0; z < static_cast<std::size_t>(kDims.z); ++z) {
    AddPage(tiff, page, 37, 21, samples.data() + z * plane);
  }
  TIFFClose(tiff);
}

void WriteSlice(const std::string& path, const Page& page, std::uint32_t width,
                std::uint32_t height, const char* samples) {
  TIFF* const tiff = TIFFOpen(path.c_str(), "w");
  ASSERT_NE(tiff, nullptr);
  AddPage(tiff, page, width, height, samples);
  TIFFClose(tiff);
}

TEST(TiffSourceTest, PagesOfEveryTypeOrderCompressionAndShapeComeBackExactly) {
  const TempDir dir;
  const std::string path = dir.Sub("v.tif");
  for (const ScalarType type :
       {ScalarType::kUint8, ScalarType::kInt8, ScalarType::kUint16, ScalarType::kInt16,
        ScalarType::kUint32, ScalarType::kInt32, ScalarType::kFloat32, ScalarType::kFloat64}) {
    const std::string samples = Noise(kDims, type);
    for (const char* mode : {"wl", "wb", "w8"}) {
      for (const std::uint16_t compression :
           {std::uint16_t{COMPRESSION_NONE}, std::uint16_t{COMPRESSION_LZW}}) {
        for (const bool is_tiled : {false, true}) {
          SCOPED_TRACE(
              absl::StrCat(std::string(volume::NameOf(type)), mode, compression, is_tiled));
          WritePages(path, mode, {.type = type, .compression = compression, .is_tiled = is_tiled},
                     samples);
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
          EXPECT_EQ(source->info().geometry.sample_dims, kDims);
          EXPECT_EQ(source->info().type, type);
          for (const std::int64_t planes : {1, 4}) {  // twice: back to the first page
            ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, planes));
            EXPECT_TRUE(read == samples);
          }
        }
      }
    }
  }
}

// Two pages of 37 x 21 samples of so many bits, in strips or tiles.
struct OddPage {
  int bits = 1;
  int format = SAMPLEFORMAT_UINT;
  std::uint16_t compression = COMPRESSION_NONE;
  bool is_tiled = false;
  std::uint16_t photometric = PHOTOMETRIC_MINISBLACK;
  std::uint16_t fill_order = FILLORDER_MSB2LSB;
};

// `rows`: the bytes of all rows of both pages.
void WriteOddPages(const std::string& path, const char* mode, const OddPage& page,
                   const std::string& rows) {
  TIFF* const tiff = TIFFOpen(path.c_str(), mode);
  ASSERT_NE(tiff, nullptr);
  const std::size_t row_bytes = rows.size() / 42;
  for (std::size_t z = 0; z < 2; ++z) {
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, 37);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, 21);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, page.bits);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
    TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, page.format);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, static_cast<int>(page.photometric));
    TIFFSetField(tiff, TIFFTAG_FILLORDER, static_cast<int>(page.fill_order));
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, static_cast<int>(page.compression));
    if (page.is_tiled) {
      constexpr std::uint32_t kTile = 16;
      TIFFSetField(tiff, TIFFTAG_TILEWIDTH, kTile);
      TIFFSetField(tiff, TIFFTAG_TILELENGTH, kTile);
      const std::size_t tile_row = kTile * static_cast<std::size_t>(page.bits) / 8;
      for (std::uint32_t y = 0; y < 21; y += kTile) {
        for (std::uint32_t x = 0; x < 37; x += kTile) {
          std::string tile(kTile * tile_row, '\0');
          const std::size_t at = x * static_cast<std::size_t>(page.bits) / 8;
          for (std::uint32_t row = 0; row < std::min(kTile, 21 - y); ++row) {
            std::copy_n(rows.data() + (z * 21 + y + row) * row_bytes + at,
                        std::min(tile_row, row_bytes - at), tile.data() + row * tile_row);
          }
          ASSERT_GE(TIFFWriteTile(tiff, tile.data(), x, y, 0, 0), 0);
        }
      }
    } else {
      TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 5);
      for (std::uint32_t y = 0; y < 21; ++y) {
        std::string row = rows.substr((z * 21 + y) * row_bytes, row_bytes);
        ASSERT_GE(TIFFWriteScanline(tiff, row.data(), y, 0), 0);
      }
    }
    ASSERT_NE(TIFFWriteDirectory(tiff), 0);
  }
  TIFFClose(tiff);
}

constexpr math::Index3 kOddDims{37, 21, 2};

TEST(TiffSourceTest, BitsAreBytesOfZeroAndOne) {
  const TempDir dir;
  const std::string path = dir.Sub("v.tif");
  std::string rows = Noise({5, 42, 1}, ScalarType::kUint8);
  std::string expected;
  for (std::size_t row = 0; row < 42; ++row) {
    rows[row * 5 + 4] = static_cast<char>(rows[row * 5 + 4] & 0xf8);
    for (std::size_t x = 0; x < 37; ++x) {
      expected +=
          static_cast<char>(static_cast<unsigned char>(rows[row * 5 + x / 8]) >> (7 - x % 8) & 1);
    }
  }
  for (const std::uint16_t compression :
       {std::uint16_t{COMPRESSION_NONE}, std::uint16_t{COMPRESSION_PACKBITS},
        std::uint16_t{COMPRESSION_LZW}, std::uint16_t{COMPRESSION_ADOBE_DEFLATE},
        std::uint16_t{COMPRESSION_CCITTFAX3}, std::uint16_t{COMPRESSION_CCITTFAX4}}) {
    for (const bool is_tiled : {false, true}) {
      for (const std::uint16_t photometric :
           {std::uint16_t{PHOTOMETRIC_MINISBLACK}, std::uint16_t{PHOTOMETRIC_MINISWHITE}}) {
        for (const std::uint16_t fill_order :
             {std::uint16_t{FILLORDER_MSB2LSB}, std::uint16_t{FILLORDER_LSB2MSB}}) {
          SCOPED_TRACE(absl::StrCat(compression, is_tiled, photometric, fill_order));
          WriteOddPages(path, "wl",
                        {.compression = compression,
                         .is_tiled = is_tiled,
                         .photometric = photometric,
                         .fill_order = fill_order},
                        rows);
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
          EXPECT_EQ(source->info().type, ScalarType::kUint8);
          EXPECT_EQ(source->info().geometry.sample_dims, kOddDims);
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 1));
          EXPECT_TRUE(read == expected);
        }
      }
    }
  }
}

TEST(TiffSourceTest, WideIntegersAndHalfFloatsBecomeFloats) {
  const TempDir dir;
  const std::string path = dir.Sub("v.tif");
  constexpr std::size_t kCount = 37 * 42;
  std::string integers(kCount * 8, '\0');
  std::string halves(kCount * 2, '\0');
  std::string doubles(kCount * 8, '\0');
  std::string floats(kCount * 4, '\0');
  for (std::size_t i = 0; i < kCount; ++i) {
    const auto integer = static_cast<std::int64_t>(i) * 1'000'003;
    const auto value = static_cast<double>(integer);
    std::memcpy(integers.data() + 8 * i, &integer, 8);
    std::memcpy(doubles.data() + 8 * i, &value, 8);
    const auto half = static_cast<std::uint16_t>(0x3c00 + (i % 4) * 0x400);  // 1, 2, 4, 8
    const float single = static_cast<float>(1 << (i % 4));
    std::memcpy(halves.data() + 2 * i, &half, 2);
    std::memcpy(floats.data() + 4 * i, &single, 4);
  }
  struct Case {
    OddPage page;
    const std::string& stored;
    ScalarType type;
    const std::string& expected;
  };
  for (const Case& c : {Case{{64, SAMPLEFORMAT_INT}, integers, ScalarType::kFloat64, doubles},
                        Case{{64, SAMPLEFORMAT_UINT}, integers, ScalarType::kFloat64, doubles},
                        Case{{16, SAMPLEFORMAT_IEEEFP}, halves, ScalarType::kFloat32, floats}}) {
    for (const char* mode : {"wl", "wb", "w8"}) {
      for (const bool is_tiled : {false, true}) {
        OddPage page = c.page;
        page.is_tiled = is_tiled;
        page.compression = is_tiled ? COMPRESSION_LZW : COMPRESSION_NONE;
        WriteOddPages(path, mode, page, c.stored);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
        EXPECT_EQ(source->info().type, c.type);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 1));
        EXPECT_TRUE(read == c.expected) << c.page.bits << mode << is_tiled;
      }
    }
  }
  const std::int64_t beyond = (std::int64_t{1} << 53) + 1;
  std::memcpy(integers.data() + 80, &beyond, 8);
  WriteOddPages(path, "wl", {.bits = 64}, integers);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
  EXPECT_THAT(ReadAll(*source, 1),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("9007199254740993")));
  WriteOddPages(path, "wl", {.bits = 4}, std::string(19 * 42, 'a'));
  EXPECT_THAT(OpenVolumeFile(path),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("samples of 4 bits")));
}

TEST(TiffSourceTest, DamageInAFaxIsNoRowOfZeros) {
  const TempDir dir;
  const std::string path = dir.Sub("v.tif");
  const std::string rows = Noise({5, 42, 1}, ScalarType::kUint8);
  for (const std::uint16_t compression :
       {std::uint16_t{COMPRESSION_CCITTFAX3}, std::uint16_t{COMPRESSION_CCITTFAX4}}) {
    WriteOddPages(path, "wl", {.compression = compression}, rows);
    const std::string whole = ReadFile(path);
    int found = 0;
    for (std::size_t at = 8; at + 30 < 200; at += 9) {
      std::string damaged = whole;
      damaged.replace(at, 30, std::string(30, '\0'));
      WriteFile(path, damaged);
      const auto source = OpenVolumeFile(path);
      found += source.ok() && ReadAll(**source, 1).ok() ? 0 : 1;
    }
    EXPECT_GT(found, 15);
  }
}

TEST(TiffSourceTest, PartsOfSlicesAreCutOutOfThem) {
  const TempDir dir;
  const std::string samples = Noise(kDims, ScalarType::kUint16);
  WritePages(dir.Sub("v.tiff"), "w", {}, samples);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir.Sub("v.tiff")));
  EXPECT_FALSE(source->info().is_seekable);
  for (std::int64_t begin = 0; begin + 50 < 21 * 6; begin += 5) {
    std::string rows(50 * 74, '\0');
    ISOSCOPE_ASSERT_OK(source->ReadRows(begin, begin + 50, rows.data()));
    EXPECT_TRUE(rows == samples.substr(static_cast<std::size_t>(begin) * 74, 50 * 74));
  }
}

TEST(TiffSourceTest, FilesOfTwoStacksAreRefusedAndTakenAsNeighbours) {
  const TempDir dir;
  const std::string samples = Noise({37, 21, 1}, ScalarType::kUint8);
  for (const char* name : {"ct1.tif", "ct2.tif", "mask1.tif", "mask2.tif"}) {
    WriteSlice(dir.Sub(name), {.type = ScalarType::kUint8}, 37, 21, samples.data());
  }
  EXPECT_THAT(OpenVolumeFile(dir.path()).status(),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr(absl::StrCat("choose one, as in '", dir.Sub("ct[0-9]*.tif'")))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto one, OpenVolumeFile(dir.Sub("ct[0-9]*.tif")));
  EXPECT_EQ(one->info().geometry.sample_dims.z, 2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto all, OpenVolumeSeries(dir.path(), {.axes = "Z"}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, all->Open(0, 0, 0));
  EXPECT_EQ(source->info().geometry.sample_dims.z, 4);
}

TEST(TiffSourceTest, FolderAndPatternAreStackedByTheNumbersInTheirNames) {
  const TempDir dir;
  const std::string samples = Noise({37, 21, 12}, ScalarType::kUint8);
  for (std::size_t z = 0; z < 12; ++z) {
    WriteSlice(dir.Sub(absl::StrCat("slice", z, z % 2 == 0 ? ".tif" : ".TIFF")),
               {.type = ScalarType::kUint8}, 37, 21, samples.data() + z * 37 * 21);
  }
  WriteFile(dir.Sub("notes.txt"), "no slice");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto folder, OpenVolumeFile(dir.path()));
  EXPECT_EQ(folder->info().geometry.sample_dims, (math::Index3{37, 21, 12}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*folder, 5));
  EXPECT_TRUE(read == samples);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pattern, OpenVolumeFile(dir.Sub("slice?.tif")));
  EXPECT_EQ(pattern->info().geometry.sample_dims.z, 5);  // 0, 2, 4, 6, 8
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string second, ReadAll(*pattern, 5));
  EXPECT_TRUE(second.substr(37 * 21, 37 * 21) == samples.substr(2 * 37 * 21, 37 * 21));
}

TEST(TiffSourceTest, MixedSlicesColourAndCutFilesAreRefused) {
  const TempDir dir;
  const std::string samples = Noise({64, 64, 3}, ScalarType::kFloat64);
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  WriteSlice(dir.Sub("a1.tif"), {}, 20, 20, samples.data());
  WriteSlice(dir.Sub("a2.tif"), {}, 20, 21, samples.data());
  EXPECT_THAT(OpenVolumeFile(dir.Sub("a*.tif")).status(),
              StatusIs(kInvalid, HasSubstr("20 x 21 samples of uint16, but")));
  WriteSlice(dir.Sub("a2.tif"), {.type = ScalarType::kInt16}, 20, 20, samples.data());
  EXPECT_THAT(OpenVolumeFile(dir.Sub("a*.tif")).status(), StatusIs(kInvalid, HasSubstr("int16")));
  WriteSlice(dir.Sub("c.tif"), {.type = ScalarType::kUint8, .samples_per_pixel = 3}, 20, 20,
             samples.data());
  EXPECT_THAT(OpenVolumeFile(dir.Sub("c.tif")).status(), StatusIs(kInvalid, HasSubstr("colour")));
  // The samples of a palette image are numbers of colours. Two slices, because a single one is
  // refused anyway.
  for (const char* name : {"p1.tif", "p2.tif"}) {
    WriteSlice(dir.Sub(name), {.type = ScalarType::kUint8, .has_palette = true}, 20, 20,
               samples.data());
  }
  EXPECT_THAT(OpenVolumeFile(dir.Sub("p*.tif")).status(), StatusIs(kInvalid, HasSubstr("palette")));
  EXPECT_THAT(OpenVolumeFile(dir.Sub("a1.tif")).status(), StatusIs(kInvalid, _));  // one slice
  EXPECT_THAT(OpenVolumeFile(dir.Sub("absent*.tif")).status(),
              StatusIs(kInvalid, HasSubstr("no TIFF files")));
  WriteFile(dir.Sub("text.tif"), "no TIFF");
  EXPECT_THAT(OpenVolumeFile(dir.Sub("text.tif")).status(), StatusIs(kInvalid, HasSubstr("TIFF")));

  const std::string samples_of_pages = Noise(kDims, ScalarType::kUint16);
  WritePages(dir.Sub("v.tif"), "w", {.compression = COMPRESSION_LZW}, samples_of_pages);
  const std::string whole = ReadFile(dir.Sub("v.tif"));
  for (std::size_t size = 0; size < whole.size(); size += 61) {
    WriteFile(dir.Sub("cut.tif"), whole.substr(0, size));
    const auto source = OpenVolumeFile(dir.Sub("cut.tif"));
    if (source.ok()) {  // the pages that are whole look like a smaller stack
      EXPECT_LT((*source)->info().geometry.sample_dims.z, kDims.z) << size;
    }
  }
  int refused = 0;
  int same = 0;
  for (std::size_t at = 0; at < whole.size(); at += 7) {
    std::string flipped = whole;
    flipped[at] = static_cast<char>(flipped[at] ^ 0x81);
    WriteFile(dir.Sub("cut.tif"), flipped);
    const auto source = OpenVolumeFile(dir.Sub("cut.tif"));
    if (!source.ok()) {
      ++refused;
      EXPECT_THAT(std::string(source.status().message()), HasSubstr("cut.tif")) << at;
      continue;
    }
    if (math::Volume((*source)->info().geometry.sample_dims) > 10 * math::Volume(kDims)) {
      continue;
    }
    const absl::StatusOr<std::string> read = ReadAll(**source, 1);
    if (read.ok()) {
      EXPECT_EQ(read->size(),
                static_cast<std::size_t>(math::Volume((*source)->info().geometry.sample_dims)) *
                    volume::SizeOf((*source)->info().type))
          << at;
      same += *read == samples_of_pages ? 1 : 0;
    } else {
      ++refused;
      EXPECT_TRUE(absl::IsDataLoss(read.status()) || absl::IsInvalidArgument(read.status())) << at;
      EXPECT_THAT(std::string(read.status().message()), HasSubstr("cut.tif")) << at;
    }
  }
  // LZW has no checksum. But most flips change samples, or are found.
  EXPECT_GT(refused, 10);
  EXPECT_LT(same, static_cast<int>(whole.size() / 7 / 4));
}

// Strips as they are: a page of 8 x 2 samples of 16 bits, the second one inflates to less.
TEST(TiffSourceTest, AStripThatInflatesToTooLittleIsDamagedAndNotWhatTheMemoryHeld) {
  const TempDir folder;
  const std::string path = folder.Sub("damaged.tif");
  constexpr unsigned char kGood[] = {0x78, 0x9c, 0x4b, 0x4c, 0xc4, 0x0f,
                                     0x00, 0xc8, 0x30, 0x0c, 0x21};
  constexpr unsigned char kBad[] = {0x78, 0x9c, 0x4b, 0xba, 0x3b, 0xf0,
                                    0xff, 0xc8, 0x30, 0x0c, 0x21};
  TIFF* const tiff = TIFFOpen(path.c_str(), "wl");
  ASSERT_NE(tiff, nullptr);
  for (const unsigned char* strip : {kGood, kBad}) {
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, 8);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, 2);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, 16);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_ADOBE_DEFLATE);
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 2);
    std::string bytes(reinterpret_cast<const char*>(strip), sizeof(kGood));
    ASSERT_EQ(TIFFWriteRawStrip(tiff, 0, bytes.data(), sizeof(kGood)), sizeof(kGood));
    ASSERT_NE(TIFFWriteDirectory(tiff), 0);
  }
  TIFFClose(tiff);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
  std::string plane(32, 'x');
  ISOSCOPE_EXPECT_OK(source->ReadSlab(0, 1, plane.data()));
  EXPECT_EQ(plane, std::string(32, 'a'));
  EXPECT_THAT(source->ReadSlab(1, 2, plane.data()),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("damaged.tif")));
}

// The plane that each slice of a volume is, by its first sample; -1 if it can't be read.
std::vector<int> PlanesOf(VolumeSeries& series, int field, int step) {
  std::vector<int> planes;
  const auto source = series.Open(field, 0, step);
  EXPECT_TRUE(source.ok()) << source.status();
  const auto bytes = source.ok() ? ReadAll(**source, 1) : source.status();
  if (!bytes.ok()) {
    return {-1};
  }
  const math::Index3& dims = (*source)->info().geometry.sample_dims;
  for (std::int64_t z = 0; z < dims.z; ++z) {
    std::vector<std::uint16_t> plane(static_cast<std::size_t>(dims.x * dims.y));
    std::memcpy(plane.data(), bytes->data() + z * dims.x * dims.y * 2, plane.size() * 2);
    planes.push_back(plane[0] / 100);
    for (std::size_t i = 0; i < plane.size(); ++i) {
      EXPECT_EQ(plane[i], plane[0] + i);
    }
  }
  return planes;
}

std::string OmeText(const std::string& pixels, const std::string& data) {
  return absl::StrCat("<?xml version=\"1.0\"?><OME><Image><Pixels SizeX=\"4\" SizeY=\"3\" ", pixels,
                      ">", data, "</Pixels></Image></OME>");
}
constexpr char kOmeSizes[] = "SizeZ=\"2\" SizeC=\"3\" SizeT=\"2\" DimensionOrder=\"XYCZT\" ";

TEST(TiffSourceTest, ChannelsOfOmeAreFieldsAndItsTimesSteps) {
  const TempDir dir;
  const std::string path = dir.Sub("a.ome.tif");
  for (const char* mode : {"wl", "wb", "w8"}) {
    ASSERT_TRUE(WriteTiffStack(
        path, {.pages = 12,
               .description = OmeText(absl::StrCat(kOmeSizes,
                                                   "PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.25\" "
                                                   "PhysicalSizeZ=\"2\" TimeIncrement=\"4\""),
                                      "<Channel Name=\"red\"/><Channel Name=\"green\"/><Channel/>"),
               .mode = mode}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
    ASSERT_EQ(series->info().fields.size(), 3u);
    EXPECT_EQ(series->info().fields[1].name, "green");
    EXPECT_EQ(series->info().fields[2].name, "channel 2");
    EXPECT_THAT(series->info().times, ElementsAre(0, 4));
    EXPECT_EQ(series->info().time_unit, "s");
    EXPECT_EQ(series->info().length_unit, "um");
    EXPECT_THAT(PlanesOf(*series, 0, 0), ElementsAre(0, 3));
    EXPECT_THAT(PlanesOf(*series, 2, 1), ElementsAre(8, 11));
    EXPECT_THAT(PlanesOf(*series, 1, 0), ElementsAre(1, 4));  // back to an earlier page
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(1, 0, 1));
    EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{0.5, 0.25, 2}));
    EXPECT_EQ(source->info().geometry.origin, (math::Vec3d{0, 0, 0}));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto part, OpenVolumeSeries(path + ":green"));
  EXPECT_EQ(part->info().fields.size(), 1u);
  EXPECT_THAT(PlanesOf(*part, 0, 1), ElementsAre(7, 10));
  EXPECT_THAT(OpenVolumeFile(path).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("red, green, channel 2")));
}

TEST(TiffSourceTest, AnOmeSetOfSeveralFilesIsReadWhole) {
  const TempDir dir;
  std::string data;
  for (int t = 0; t < 2; ++t) {
    absl::StrAppend(&data, "<TiffData IFD=\"0\" FirstT=\"", t,
                    "\" PlaneCount=\"6\"><UUID FileName=\"t", t, ".tif\">u</UUID></TiffData>");
  }
  for (int t = 0; t < 2; ++t) {
    ASSERT_TRUE(
        WriteTiffStack(dir.Sub(absl::StrCat("t", t, ".tif")),
                       {.pages = 6, .description = OmeText(kOmeSizes, data), .first = 6 * t}));
  }
  for (const char* name : {"t0.tif", "t1.tif"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(dir.Sub(name)));
    EXPECT_THAT(PlanesOf(*series, 2, 0), ElementsAre(2, 5));
    EXPECT_THAT(PlanesOf(*series, 2, 1), ElementsAre(8, 11));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(dir.Sub(name)));
    EXPECT_EQ(files.size(), 2u);
    EXPECT_EQ(files[0], dir.Sub(name));
  }
  std::filesystem::remove(dir.Sub("t1.tif"));
  EXPECT_THAT(OpenVolumeSeries(dir.Sub("t0.tif")).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("t1.tif: no such file")));
}

TEST(TiffSourceTest, OmeThatContradictsItsPagesIsRefused) {
  const TempDir dir;
  const std::string path = dir.Sub("a.tif");
  const auto refusal = [&](int pages, const std::string& description) {
    EXPECT_TRUE(WriteTiffStack(path, {.pages = pages, .description = description}));
    return std::string(OpenVolumeSeries(path).status().message());
  };
  EXPECT_THAT(refusal(11, OmeText(kOmeSizes, "")), HasSubstr("no TiffData names 1 of the 12"));
  EXPECT_THAT(refusal(11, OmeText(kOmeSizes, "<TiffData IFD=\"0\" PlaneCount=\"12\"/>")),
              HasSubstr("11 planes, but its head says 12"));
  EXPECT_THAT(refusal(12, OmeText("SizeX=\"5\"", "")), HasSubstr("or it is cut"));  // twice SizeX
  EXPECT_THAT(refusal(2,
                      "<OME><Image><Pixels SizeX=\"5\" SizeY=\"3\" SizeZ=\"2\" "
                      "DimensionOrder=\"XYZCT\"/></Image></OME>"),
              HasSubstr("OME-XML says 5 x 3 samples, but its first page has 4 x 3"));
  EXPECT_THAT(refusal(2, "<OME><BinaryOnly MetadataFile=\"b.companion.ome\"/></OME>"),
              HasSubstr("b.companion.ome"));
  WriteFile(dir.Sub("b.companion.ome"),
            "<OME><BinaryOnly MetadataFile=\"b.companion.ome\"/></OME>");
  EXPECT_THAT(std::string(OpenVolumeSeries(path).status().message()),
              HasSubstr("names another file"));
  WriteFile(dir.Sub("b.companion.ome"),
            "<OME><Image><Pixels SizeX=\"4\" SizeY=\"3\" SizeZ=\"2\" DimensionOrder=\"XYZCT\">"
            "<TiffData><UUID FileName=\"a.tif\"/></TiffData></Pixels></Image></OME>");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
  EXPECT_THAT(PlanesOf(*series, 0, 0), ElementsAre(0, 1));
}

TEST(TiffSourceTest, ImageJsChannelsAreFieldsAndItsFramesSteps) {
  const TempDir dir;
  const std::string path = dir.Sub("a.tif");
  constexpr char kText[] =
      "ImageJ=1.53t\nimages=12\nchannels=3\nslices=2\nframes=2\nunit=micron\nspacing=3\n"
      "finterval=0.5\n";
  // Its colour tables only show the samples.
  ASSERT_TRUE(WriteTiffStack(
      path,
      {.pages = 12, .description = kText, .resolution = 4, .photometric = PHOTOMETRIC_PALETTE}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
  EXPECT_EQ(series->info().fields.size(), 3u);
  EXPECT_THAT(series->info().times, ElementsAre(0, 0.5));
  EXPECT_EQ(series->info().length_unit, "um");
  EXPECT_THAT(PlanesOf(*series, 1, 1), ElementsAre(7, 10));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(0, 0, 0));
  EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{0.25, 0.25, 3}));
  // Told otherwise.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto turned, OpenVolumeSeries(path, {.axes = "CTZ"}));
  EXPECT_THAT(PlanesOf(*turned, 1, 1), ElementsAre(6, 7));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto slices, OpenVolumeSeries(path, {.axes = "Z"}));
  EXPECT_EQ(PlanesOf(*slices, 0, 0).size(), 12u);
}

TEST(TiffSourceTest, SizesOfPixelsAlongSomeAxesOnlyAreRefused) {
  const TempDir dir;
  const std::string path = dir.Sub("a.tif");
  const auto refusal = [&](const TiffStackFile& file) {
    EXPECT_TRUE(WriteTiffStack(path, file));
    EXPECT_TRUE(OpenVolumeSeries(path, {.axes = "", .rules = {.has_spacing = true}}).ok());
    const auto series = OpenVolumeSeries(path);
    EXPECT_THAT(series, StatusIs(absl::StatusCode::kInvalidArgument,
                                 AllOf(HasSubstr("a.tif"), HasSubstr("--spacing X,Y,Z"))));
    return std::string(series.status().message());
  };
  EXPECT_THAT(refusal({.resolution = 100, .y_resolution = 50, .unit = RESUNIT_INCH}),
              HasSubstr("XResolution 100, YResolution 50"));
  EXPECT_THAT(refusal({.pages = 2,
                       .description = OmeText("DimensionOrder=\"XYZCT\" SizeZ=\"2\" SizeC=\"1\" "
                                              "SizeT=\"1\" PhysicalSizeX=\"0.1\" "
                                              "PhysicalSizeY=\"0.1\"",
                                              "")}),
              HasSubstr("PhysicalSizeX and PhysicalSizeY, but no PhysicalSizeZ"));
  EXPECT_THAT(refusal({.model_scale = {30, 30, 0}}),
              HasSubstr("GeoTIFF's ModelPixelScale (33550) is 30 30 0"));
  EXPECT_THAT(refusal({.description = "ImageJ=1\nimages=6\nunit=um\nspacing=3\n"}),
              HasSubstr("spacing=3"));
  // Those of a print are none.
  ASSERT_TRUE(WriteTiffStack(path, {.resolution = 300, .unit = RESUNIT_INCH}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
  EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{1, 1, 1}));
}

// Pages of 4 x 3: where the first and the last sample of a row, and of a column, lie.
TEST(TiffSourceTest, PagesLieAsTheirOrientationSays) {
  struct Case {
    std::uint16_t orientation;
    math::Vec3d first;
    math::Vec3d row_end;
    math::Vec3d column_end;
  };
  const TempDir dir;
  const std::string path = dir.Sub("a.tif");
  for (const Case& c :
       {Case{1, {0, 0, 0}, {3, 0, 0}, {0, 2, 0}}, Case{2, {3, 0, 0}, {0, 0, 0}, {3, 2, 0}},
        Case{3, {3, 2, 0}, {0, 2, 0}, {3, 0, 0}}, Case{4, {0, 2, 0}, {3, 2, 0}, {0, 0, 0}},
        Case{5, {0, 0, 0}, {0, 3, 0}, {2, 0, 0}}, Case{6, {2, 0, 0}, {2, 3, 0}, {0, 0, 0}},
        Case{7, {2, 3, 0}, {2, 0, 0}, {0, 3, 0}}, Case{8, {0, 3, 0}, {0, 0, 0}, {2, 3, 0}}}) {
    SCOPED_TRACE(c.orientation);
    ASSERT_TRUE(WriteTiffStack(path, {.pages = 2, .orientation = c.orientation}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
    const auto world = source->info().geometry.world_from_index();
    EXPECT_EQ(math::TransformPoint(world, {0, 0, 0}), c.first);
    EXPECT_EQ(math::TransformPoint(world, {3, 0, 0}), c.row_end);
    EXPECT_EQ(math::TransformPoint(world, {0, 2, 0}), c.column_end);
  }
}

TEST(TiffSourceTest, ALargeStackOfImageJHasOneDirectoryAndItsPlanesBehindEachOther) {
  const TempDir dir;
  const std::string path = dir.Sub("a.tif");
  for (const char* mode : {"wl", "wb"}) {
    const TiffStackFile file{
        .pages = 1, .description = "ImageJ=1.53t\nimages=6\nslices=3\nframes=2\n", .mode = mode};
    ASSERT_TRUE(WriteTiffStack(path, file));
    // The samples may lie before the directory: the planes are put behind it, and it names them.
    std::string bytes = ReadFile(path);
    TIFF* const tiff = TIFFOpen(path.c_str(), "r");
    ASSERT_NE(tiff, nullptr);
    const auto offset = static_cast<std::uint32_t>(TIFFGetStrileOffset(tiff, 0));
    TIFFClose(tiff);
    std::string old_word(reinterpret_cast<const char*>(&offset), 4);
    const auto end = static_cast<std::uint32_t>(bytes.size());
    std::string new_word(reinterpret_cast<const char*>(&end), 4);
    if (mode[1] == 'b') {
      std::reverse(old_word.begin(), old_word.end());
      std::reverse(new_word.begin(), new_word.end());
    }
    // The entry: tag 273, type 4, count 1, offset.
    const std::string entry = mode[1] == 'b' ? std::string("\x01\x11\0\x04\0\0\0\x01", 8)
                                             : std::string("\x11\x01\x04\0\x01\0\0\0", 8);
    const std::size_t at = bytes.find(entry + old_word);
    ASSERT_NE(at, std::string::npos);
    bytes.replace(at + 8, 4, new_word);
    for (int plane = 0; plane < 6; ++plane) {
      const std::vector<std::uint16_t> samples = testing::TiffPlane(file, plane);
      std::string text(reinterpret_cast<const char*>(samples.data()), samples.size() * 2);
      bytes += mode[1] == 'b' ? testing::Swapped(text, 2) : text;
    }
    WriteFile(path, bytes);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
    EXPECT_THAT(PlanesOf(*series, 0, 0), ElementsAre(0, 1, 2));
    EXPECT_THAT(PlanesOf(*series, 0, 1), ElementsAre(3, 4, 5));
    WriteFile(path, bytes.substr(0, bytes.size() - 1));
    EXPECT_THAT(OpenVolumeSeries(path).status(),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("5 planes, but its head says 6")));
  }
}

TEST(TiffSourceTest, LsmHasThumbnailsBetweenItsPagesAndChannelsInThem) {
  const TempDir dir;
  const std::string path = dir.Sub("a.lsm");
  ASSERT_TRUE(WriteTiffStack(
      path, {.pages = 4,
             .lsm = testing::LsmBytes({.slices = 2, .channels = 2, .steps = 2, .interval = 3}),
             .channels = 2,
             .photometric = PHOTOMETRIC_RGB,
             .has_thumbnails = true}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
  EXPECT_EQ(series->info().fields.size(), 2u);
  EXPECT_THAT(series->info().times, ElementsAre(0, 3));
  EXPECT_THAT(PlanesOf(*series, 1, 0), ElementsAre(1, 3));
  EXPECT_THAT(PlanesOf(*series, 0, 1), ElementsAre(4, 6));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(0, 0, 0));
  EXPECT_NEAR(source->info().geometry.spacing.z, 0.5, 1e-12);
}

TEST(TiffSourceTest, AxesSayWhatPlainPagesAndFilesAre) {
  const TempDir dir;
  ASSERT_TRUE(WriteTiffStack(dir.Sub("a.tif"), {.pages = 12}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pages,
                                OpenVolumeSeries(dir.Sub("a.tif"), {.axes = "TC3Z2"}));
  EXPECT_EQ(pages->info().step_count(), 2);
  EXPECT_THAT(PlanesOf(*pages, 1, 1), ElementsAre(8, 9));
  EXPECT_THAT(
      OpenVolumeSeries(dir.Sub("a.tif"), {.axes = "C5Z"}).status(),
      StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("12 planes can't be so many")));
  std::filesystem::create_directory(dir.Sub("d"));
  for (int i = 0; i < 4; ++i) {
    ASSERT_TRUE(WriteTiffStack(dir.Sub(absl::StrCat("d/s", i, ".tif")), {.pages = 1, .first = i}));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, OpenVolumeSeries(dir.Sub("d"), {.axes = "ZC2"}));
  EXPECT_THAT(PlanesOf(*files, 1, 0), ElementsAre(1, 3));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pattern,
                                OpenVolumeSeries(dir.Sub("d/s*.tif"), {.axes = "C2Z"}));
  EXPECT_THAT(PlanesOf(*pattern, 1, 0), ElementsAre(2, 3));
}

TEST(TiffSourceTest, RefusedColoursSayWhatToDo) {
  const TempDir dir;
  ASSERT_TRUE(WriteTiffStack(dir.Sub("p.tif"), {.photometric = PHOTOMETRIC_PALETTE}));
  EXPECT_THAT(
      std::string(OpenVolumeFile(dir.Sub("p.tif")).status().message()),
      AllOf(HasSubstr("photometric interpretation 3 (a palette), so that samples are numbers"),
            HasSubstr("`convert "), HasSubstr("-colorspace Gray")));
}

TEST(TiffSourceTest, CutStacksAreRefused) {
  const TempDir dir;
  const std::string path = dir.Sub("a.tif");
  ASSERT_TRUE(WriteTiffStack(path, {.pages = 12, .description = OmeText(kOmeSizes, "")}));
  const std::string whole = ReadFile(path);
  for (std::size_t i = 0; i < 16; ++i) {
    WriteFile(path, whole.substr(0, i * whole.size() / 16));
    const auto series = OpenVolumeSeries(path);
    EXPECT_FALSE(series.ok()) << i;
    EXPECT_THAT(std::string(series.status().message()), HasSubstr("a.tif")) << i;
  }
}

}  // namespace
}  // namespace isoscope::source
