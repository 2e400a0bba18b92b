// EncodePng is read back by libpng, and DecodePng reads files of other writers:
//
// - every size and content, also where stripes meet;
// - the structure of the file: chunks, checksums, one complete zlib stream;
// - the same bytes for any number of threads and any address of buffers;
// - damage: every truncation, every flipped bit, sizes that the bytes can't hold.

#include "core/image/png_codec.h"

#include <png.h>
#include <unistd.h>
#include <zlib.h>

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/string_view.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "oneapi/tbb/global_control.h"
#include "oneapi/tbb/parallel_for.h"
#include "oneapi/tbb/task_arena.h"
#include "oneapi/tbb/task_group.h"
#include <sys/resource.h>

#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::image {
namespace {

using isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::vector<Rgba8> MakePixels(int width, int height, bool opaque) {
  std::vector<Rgba8> pixels;
  std::uint32_t state = 12345;
  for (int i = 0; i < width * height; ++i) {
    state = state * 1664525U + 1013904223U;
    pixels.push_back({.r = static_cast<std::uint8_t>(i % 251),
                      .g = static_cast<std::uint8_t>(state >> 24),
                      .b = static_cast<std::uint8_t>(i / 7),
                      .a = opaque ? std::uint8_t{255} : static_cast<std::uint8_t>(state >> 16)});
  }
  return pixels;
}

std::vector<Rgba8> MakeNoise(int width, int height, bool opaque) {
  std::vector<Rgba8> pixels(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    pixels[i] = std::bit_cast<Rgba8>(static_cast<std::uint32_t>(base::RandomBits(7, i)));
    if (opaque) {
      pixels[i].a = 255;
    }
  }
  return pixels;
}

std::vector<Rgba8> MakeConstant(int width, int height, Rgba8 color) {
  return std::vector<Rgba8>(static_cast<std::size_t>(width) * static_cast<std::size_t>(height),
                            color);
}

// By libpng's simplified interface: shares nothing with DecodePng, and takes wider images.
RgbaImage ReadByLibpng(const std::string& png) {
  png_image image;
  std::memset(&image, 0, sizeof(image));
  image.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_memory(&image, png.data(), png.size()), 0) << image.message;
  image.format = PNG_FORMAT_RGBA;
  RgbaImage result{.width = static_cast<int>(image.width),
                   .height = static_cast<int>(image.height),
                   .pixels = {}};
  result.pixels.resize(std::size_t{image.width} * image.height);
  EXPECT_NE(png_image_finish_read(&image, nullptr, result.pixels.data(), 0, nullptr), 0)
      << image.message;
  EXPECT_EQ(image.warning_or_error, 0U) << image.message;
  return result;
}

struct Chunk {
  std::string type;
  std::string data;
};

std::uint32_t BigEndian32At(const std::string& bytes, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    value = value << 8 | static_cast<std::uint8_t>(bytes[at + i]);
  }
  return value;
}

// Checks each chunk's CRC.
std::vector<Chunk> ChunksOf(const std::string& png) {
  std::vector<Chunk> chunks;
  std::size_t at = 8;
  while (at < png.size()) {
    const std::size_t size = BigEndian32At(png, at);
    chunks.push_back({.type = png.substr(at + 4, 4), .data = png.substr(at + 8, size)});
    const auto* covered = reinterpret_cast<const Bytef*>(png.data()) + at + 4;
    EXPECT_EQ(BigEndian32At(png, at + 8 + size), crc32_z(0, covered, size + 4));
    at += size + 12;
  }
  EXPECT_EQ(at, png.size());
  return chunks;
}

// Colour type byte of the header: 8 signature, 8 chunk head, 4 + 4 size, 1 bit depth.
int ColorType(const std::string& png) { return png[25]; }

// A PNG by libpng's simplified interface, of a kind EncodePng does not write.
std::string WriteOtherFormat(png_uint_32 format, int width, int height, const void* pixels,
                             const void* colormap, png_uint_32 colormap_entries) {
  png_image image;
  std::memset(&image, 0, sizeof(image));
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(width);
  image.height = static_cast<png_uint_32>(height);
  image.format = format;
  image.colormap_entries = colormap_entries;
  std::string out(1 << 16, '\0');
  png_alloc_size_t size = out.size();
  EXPECT_NE(png_image_write_to_memory(&image, out.data(), &size, 0, pixels, 0, colormap), 0);
  out.resize(size);
  return out;
}

TEST(PngCodecTest, PixelsSurviveTheRoundTrip) {
  for (const bool opaque : {false, true}) {
    for (const auto& [width, height] : std::vector<std::pair<int, int>>{
             {1, 1}, {1, 7}, {7, 1}, {3, 5}, {64, 64}, {257, 131}, {2000, 3}}) {
      SCOPED_TRACE(::testing::Message() << width << " x " << height << " opaque " << opaque);
      const std::vector<Rgba8> pixels = MakePixels(width, height, opaque);
      const std::string png = EncodePng(width, height, pixels);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RgbaImage decoded, DecodePng(png));
      EXPECT_EQ(decoded, (RgbaImage{.width = width, .height = height, .pixels = pixels}));
    }
  }
}

TEST(PngCodecTest, EverySizeAndContentIsReadBackByLibpng) {
  const std::vector<std::pair<int, int>> sizes{
      {1, 1},   {1, 300},   {300, 1},  {2, 2},   {3, 3},     {5, 4},
      {15, 17}, {16, 16},   {17, 15},  {31, 33}, {70000, 3},  // a row longer than a stripe
      {33, 31}, {700, 301}, {1, 70000}};
  for (const auto& [width, height] : sizes) {
    for (const bool opaque : {false, true}) {
      const std::uint8_t alpha = opaque ? 255 : 0;
      for (const std::vector<Rgba8>& pixels :
           {MakePixels(width, height, opaque), MakeNoise(width, height, opaque),
            MakeConstant(width, height, {0, 0, 0, alpha}),
            MakeConstant(width, height, {255, 255, 255, alpha}),
            MakeConstant(width, height, {1, 2, 3, alpha})}) {
        EXPECT_EQ(ReadByLibpng(EncodePng(width, height, pixels)),
                  (RgbaImage{.width = width, .height = height, .pixels = pixels}))
            << width << " x " << height << " opaque " << opaque;
      }
    }
  }
}

TEST(PngCodecTest, NoRowIsLostOrFilteredWronglyWhereStripesMeet) {
  // Stripes are 2^18 bytes of RGBA rows: 255 rows of 256 pixels, 63 of 1024, 3 of 16384.
  for (const auto& [width, rows] :
       std::vector<std::pair<int, int>>{{256, 255}, {1024, 63}, {16384, 3}}) {
    for (const int height : {rows - 1, rows, rows + 1, 2 * rows, 2 * rows + 1, 3 * rows - 1}) {
      for (const bool opaque : {false, true}) {
        const std::vector<Rgba8> pixels = MakePixels(width, height, opaque);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RgbaImage decoded,
                                      DecodePng(EncodePng(width, height, pixels)));
        EXPECT_EQ(decoded, (RgbaImage{.width = width, .height = height, .pixels = pixels}))
            << width << " x " << height << " opaque " << opaque;
      }
    }
  }
}

TEST(PngCodecTest, NoiseGrowsButLittleAndIsReadBack) {
  for (const bool opaque : {false, true}) {
    const std::vector<Rgba8> noise = MakeNoise(1024, 500, opaque);
    const std::string png = EncodePng(1024, 500, noise);
    const std::size_t raw = noise.size() * (opaque ? 3 : 4);
    EXPECT_GT(png.size(), raw);
    EXPECT_LT(png.size(), raw + raw / 100);
    EXPECT_EQ(ReadByLibpng(png).pixels, noise);
  }
}

TEST(PngCodecTest, EmptyAndSmoothPicturesAreSmall) {
  EXPECT_LT(EncodePng(1024, 1024, MakeConstant(1024, 1024, {})).size(), 30000U);
  std::vector<Rgba8> ramp = MakeConstant(1024, 1024, {0, 0, 0, 255});
  for (std::size_t i = 0; i < ramp.size(); ++i) {
    ramp[i].r = static_cast<std::uint8_t>(i / 1024 / 4);
  }
  EXPECT_LT(EncodePng(1024, 1024, ramp).size(), 30000U);
}

TEST(PngCodecTest, ThreadsDontChangeTheBytes) {
  const tbb::global_control allow(tbb::global_control::max_allowed_parallelism, 4);
  for (const bool opaque : {false, true}) {
    for (const std::vector<Rgba8>& pixels :
         {MakePixels(1000, 800, opaque), MakeNoise(1000, 800, opaque)}) {
      std::string by_one;
      tbb::task_arena(1).execute([&] { by_one = EncodePng(1000, 800, pixels); });
      tbb::task_arena four(4);
      for (int repetition = 0; repetition < 5; ++repetition) {
        std::string by_four;
        four.execute([&] { by_four = EncodePng(1000, 800, pixels); });
        EXPECT_EQ(by_one == by_four, true) << "opaque " << opaque;
      }
    }
  }
}

// Symptom: one coordinator among thousands had PNGs of the same pixels, but other bytes.
TEST(PngCodecTest, WhereTheEncodersBuffersLieDoesntChangeTheBytes) {
  constexpr int kSide = 32;
  // All bytes of the first row but the first are repeated once, as differences to the row above.
  std::vector<Rgba8> pixels = MakeNoise(kSide, kSide, false);
  for (Rgba8& pixel : pixels) {  // noise that deflate makes smaller
    pixel = {.r = static_cast<std::uint8_t>(pixel.r % 16),
             .a = static_cast<std::uint8_t>(pixel.a % 4)};
  }
  constexpr std::size_t kAgain = std::size_t{10} * kSide;
  for (std::size_t x = 0; x < kSide; ++x) {
    const Rgba8 above = pixels[kAgain - kSide + x];
    const Rgba8 first = pixels[x];
    pixels[kAgain + x] = {.r = static_cast<std::uint8_t>(above.r + first.r + (x == 0 ? 1 : 0)),
                          .g = static_cast<std::uint8_t>(above.g + first.g),
                          .b = static_cast<std::uint8_t>(above.b + first.b),
                          .a = static_cast<std::uint8_t>(above.a + first.a)};
  }
  const std::string expected = EncodePng(kSide, kSide, pixels);
  int others = 0;
  // Each allocation takes the place of the previous stream, so that the next one lies elsewhere.
  // Nothing is written.
  constexpr std::size_t kPlaceBytes = std::size_t{64} * 1024;
  constexpr std::size_t kPlaceCount = 30'000;
  std::vector<std::unique_ptr<char[]>> taken(kPlaceCount);
  for (std::unique_ptr<char[]>& place : taken) {
    place = std::make_unique_for_overwrite<char[]>(kPlaceBytes);
    others += EncodePng(kSide, kSide, pixels) == expected ? 0 : 1;
  }
  EXPECT_EQ(others, 0);
}

TEST(PngCodecTest, ACallersCancelledTasksDontLeaveHolesInThePicture) {
  const std::vector<Rgba8> pixels = MakePixels(1000, 400, false);
  const std::string expected = EncodePng(1000, 400, pixels);
  std::string png;
  tbb::task_group_context context;
  tbb::parallel_for(
      0, 1,
      [&](int) {
        context.cancel_group_execution();
        png = EncodePng(1000, 400, pixels);
      },
      context);
  EXPECT_EQ(png == expected, true);
}

TEST(PngCodecTest, TheFileIsChunksInOrderAndOneCompleteZlibStream) {
  const std::string png = EncodePng(1000, 400, MakePixels(1000, 400, false));
  std::vector<Chunk> chunks = ChunksOf(png);
  ASSERT_GE(chunks.size(), 5U);
  EXPECT_EQ(chunks.front().type, "IHDR");
  EXPECT_EQ(chunks.front().data, std::string("\0\0\x03\xe8\0\0\x01\x90\x08\x06\0\0\0", 13));
  EXPECT_EQ(chunks[1].type, "sRGB");
  EXPECT_EQ(chunks[1].data, std::string(1, '\0'));
  EXPECT_EQ(chunks.back().type, "IEND");
  EXPECT_EQ(chunks.back().data, "");
  std::string deflated;
  for (std::size_t i = 2; i + 1 < chunks.size(); ++i) {
    EXPECT_EQ(chunks[i].type, "IDAT");
    deflated += chunks[i].data;
  }
  // uncompress2 returns the bytes that it used, and checks Adler-32.
  std::vector<Bytef> rows(400 * (1 + 4 * 1000) + 1);
  uLongf row_bytes = rows.size();
  uLong used = deflated.size();
  ASSERT_EQ(
      uncompress2(rows.data(), &row_bytes, reinterpret_cast<const Bytef*>(deflated.data()), &used),
      Z_OK);
  EXPECT_EQ(row_bytes, rows.size() - 1);
  EXPECT_EQ(used, deflated.size());
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST(PngCodecDeathTest, RunningOutOfMemoryThrows) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  const std::vector<Rgba8> noise = MakeNoise(4096, 2048, false);
  constexpr int kThrew = 42;
  EXPECT_EXIT(tbb::task_arena(1).execute([&] {
    EncodePng(1, 1, MakeConstant(1, 1, {}));  // allocations that happen once
    // The picture is 32 MiB; 16 MiB more than what is mapped now are not enough for its PNG.
    std::size_t pages = 0;
    std::ifstream("/proc/self/statm") >> pages;
    const rlim_t bytes = pages * static_cast<std::size_t>(sysconf(_SC_PAGESIZE)) + (1 << 24);
    const rlimit limit{.rlim_cur = bytes, .rlim_max = bytes};
    ASSERT_EQ(setrlimit(RLIMIT_AS, &limit), 0);
    try {
      EncodePng(4096, 2048, noise);
    } catch (const std::bad_alloc&) {
      std::_Exit(kThrew);
    }
  }),
              ::testing::ExitedWithCode(kThrew), "");
}
#endif

TEST(PngCodecTest, OnlyOpaqueImagesLoseTheirAlphaChannel) {
  EXPECT_EQ(ColorType(EncodePng(4, 4, MakePixels(4, 4, true))), PNG_COLOR_TYPE_RGB);
  std::vector<Rgba8> pixels = MakePixels(4, 4, true);
  pixels.back().a = 254;
  EXPECT_EQ(ColorType(EncodePng(4, 4, pixels)), PNG_COLOR_TYPE_RGB_ALPHA);
}

TEST(PngCodecTest, SamePixelsGiveSameBytesAndSayTheyAreSrgb) {
  const std::vector<Rgba8> pixels = MakePixels(50, 40, false);
  const std::string png = EncodePng(50, 40, pixels);
  EXPECT_EQ(png, EncodePng(50, 40, pixels));
  EXPECT_THAT(png, StartsWith("\x89PNG\r\n\x1a\n"));
  EXPECT_THAT(png, HasSubstr("sRGB"));
}

TEST(PngRowWriterTest, RowsInPiecesGiveTheFileOfTheWhole) {
  for (const bool opaque : {true, false}) {
    for (const int width : {1, 333, 70000}) {
      const int height = width == 70000 ? 5 : 601;
      const std::vector<Rgba8> pixels = MakePixels(width, height, opaque);
      const int stripe_rows = PngRowWriter::RowsPerStripe(width);
      for (const int rows : {stripe_rows, 2 * stripe_rows, 7}) {
        PngRowWriter writer(width, height, opaque);
        std::string png = writer.Begin();
        for (int y = 0; y < height; y += rows) {
          const auto begin = static_cast<std::size_t>(y) * static_cast<std::size_t>(width);
          const auto count = static_cast<std::size_t>(std::min(rows, height - y)) *
                             static_cast<std::size_t>(width);
          png += writer.Append(std::span(pixels).subspan(begin, count));
        }
        png += writer.End();
        if (rows % stripe_rows == 0) {
          EXPECT_EQ(png, EncodePng(width, height, pixels)) << width << " " << rows;
        }
        EXPECT_EQ(ReadByLibpng(png).pixels, pixels) << width << " " << rows;
      }
    }
  }
}

TEST(PngCodecTest, GreyAndPalettePngsAreExpanded) {
  const std::array<std::uint8_t, 4> grey{0, 85, 170, 255};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      RgbaImage image, DecodePng(WriteOtherFormat(PNG_FORMAT_GRAY, 2, 2, grey.data(), nullptr, 0)));
  ASSERT_EQ(image.pixels.size(), 4U);
  EXPECT_EQ(image.pixels[1], (Rgba8{85, 85, 85, 255}));
  EXPECT_EQ(image.pixels[3], (Rgba8{255, 255, 255, 255}));

  const std::array<std::uint8_t, 8> palette{10, 20, 30, 255, 40, 50, 60, 70};
  const std::array<std::uint8_t, 2> indices{1, 0};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      image, DecodePng(WriteOtherFormat(PNG_FORMAT_RGBA_COLORMAP, 2, 1, indices.data(),
                                        palette.data(), 2)));
  ASSERT_EQ(image.pixels.size(), 2U);
  EXPECT_EQ(image.pixels[0], (Rgba8{40, 50, 60, 70}));
  EXPECT_EQ(image.pixels[1], (Rgba8{10, 20, 30, 255}));
}

TEST(PngCodecTest, EveryTruncationIsDataLoss) {
  const std::string png = EncodePng(9, 5, MakePixels(9, 5, false));
  for (std::size_t size = 0; size < png.size(); ++size) {
    // A buffer of exactly this size, so that an overread is seen by the sanitizer.
    const auto buffer = std::make_unique<char[]>(size);
    std::memcpy(buffer.get(), png.data(), size);
    EXPECT_THAT(DecodePng(absl::string_view(buffer.get(), size)),
                StatusIs(absl::StatusCode::kDataLoss, _))
        << size;
  }
}

TEST(PngCodecTest, EveryFlippedBitIsDataLoss) {
  const std::string png = EncodePng(9, 5, MakePixels(9, 5, false));
  for (std::size_t bit = 0; bit < png.size() * 8; ++bit) {
    std::string damaged = png;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
    EXPECT_THAT(DecodePng(damaged), StatusIs(absl::StatusCode::kDataLoss, _)) << "bit " << bit;
  }
}

TEST(PngCodecTest, SizesThatTheBytesCantHoldAreRefusedBeforeMemoryIsTaken) {
  std::string png = EncodePng(1, 1, MakePixels(1, 1, false));
  // Width and height 16384 with a checksum that is right.
  constexpr std::size_t kHeader = 12;
  for (const std::size_t at : {16U, 20U}) {
    png[at + 2] = 0x40;
    png[at + 3] = 0;
  }
  std::uint32_t crc = 0xffffffff;
  for (std::size_t i = kHeader; i < kHeader + 17; ++i) {
    crc ^= static_cast<std::uint8_t>(png[i]);
    for (int bit = 0; bit < 8; ++bit) {
      crc = crc >> 1 ^ ((crc & 1) != 0 ? 0xedb88320U : 0U);
    }
  }
  crc = ~crc;
  for (std::size_t i = 0; i < 4; ++i) {
    png[kHeader + 17 + i] = static_cast<char>(crc >> (24 - 8 * i));
  }
  EXPECT_THAT(DecodePng(png), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("16384 x 16384")));
}

TEST(PngCodecTest, OtherBytesAreDataLoss) {
  EXPECT_THAT(DecodePng(""), StatusIs(absl::StatusCode::kDataLoss, _));
  EXPECT_THAT(DecodePng("GIF89a, not a PNG at all, whatever the name"),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("Not a PNG")));
}

}  // namespace
}  // namespace isoscope::image
