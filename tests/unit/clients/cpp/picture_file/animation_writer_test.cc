// Both formats, read back by hand (APNG) and by libwebp's own reader.

#include "clients/cpp/picture_file/animation_writer.h"

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <webp/decode.h>
#include <webp/demux.h>

#include "clients/cpp/picture_file/apng_writer.h"
#include "clients/cpp/picture_file/png_chunks.h"
#include "clients/cpp/picture_file/webp_writer.h"
#include "core/cli/usage.h"
#include "core/image/png_codec.h"
#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;

constexpr int kWidth = 37;
constexpr int kHeight = 21;

// A picture that changes from frame to frame in a part of it; with_alpha: also in its alpha, with
// colours under transparent pixels. Frame 1 of those is opaque by chance.
image::RgbaImage Frame(int i, bool with_alpha) {
  image::RgbaImage frame{.width = kWidth, .height = kHeight, .pixels = {}};
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      image::Rgba8 pixel{static_cast<std::uint8_t>(7 * x + 3 * y), static_cast<std::uint8_t>(5 * y),
                         static_cast<std::uint8_t>(x * y), 255};
      if (x > 5 + i && x < 15 + i) {
        pixel.g = static_cast<std::uint8_t>(40 * i);
        pixel.a = static_cast<std::uint8_t>(with_alpha && i != 1 ? 20 * x + y : 255);
      }
      frame.pixels.push_back(pixel);
    }
  }
  return frame;
}

std::string PngOf(const image::RgbaImage& picture) {
  return image::EncodePng(picture.width, picture.height, picture.pixels);
}

AnimationOptions Options(bool with_alpha, int frame_count) {
  return {.width_px = kWidth,
          .height_px = kHeight,
          .frame_count = frame_count,
          .fps = 12.5,
          .has_alpha = with_alpha};
}

absl::StatusOr<std::string> WriteAnimation(const std::string& path, bool with_alpha,
                                           int frame_count) {
  absl::StatusOr<std::unique_ptr<AnimationWriter>> writer =
      CreateAnimation(path, Options(with_alpha, frame_count));
  if (!writer.ok()) {
    return writer.status();
  }
  for (int i = 0; i < frame_count; ++i) {
    const absl::Status added = (*writer)->AddFrame(PngOf(Frame(i, with_alpha)));
    if (!added.ok()) {
      return added;
    }
  }
  const absl::Status finished = (*writer)->Finish();
  return finished.ok() ? io::ReadWholeFile(path, 10'000'000) : finished;
}

// The frames of an APNG as PNGs, each with the header of the file.
std::vector<std::string> FramesOfApng(const std::string& apng, int frame_count) {
  const absl::StatusOr<std::vector<PngChunk>> chunks = ParsePngChunks(apng);
  EXPECT_THAT(chunks, testing::IsOk());
  std::string head;
  std::vector<std::string> frames;
  std::uint32_t sequence = 0;
  for (const PngChunk& chunk : *chunks) {
    if (chunk.type == "IHDR") {
      head = std::string(kPngSignature) + std::string(chunk.bytes);
    } else if (chunk.type == "acTL") {
      EXPECT_EQ(LoadBigEndian32(chunk.data), static_cast<std::uint32_t>(frame_count));
      EXPECT_EQ(LoadBigEndian32(chunk.data.substr(4)), 0U) << "plays for ever";
      EXPECT_TRUE(frames.empty()) << "acTL comes before the pixels";
    } else if (chunk.type == "fcTL") {
      EXPECT_EQ(chunk.data.size(), 26U);
      EXPECT_EQ(LoadBigEndian32(chunk.data), sequence++);
      EXPECT_EQ(LoadBigEndian32(chunk.data.substr(4)), static_cast<std::uint32_t>(kWidth));
      EXPECT_EQ(LoadBigEndian32(chunk.data.substr(8)), static_cast<std::uint32_t>(kHeight));
      EXPECT_EQ(LoadBigEndian32(chunk.data.substr(20)), (100U << 16) + 1250) << "100/1250 s";
      EXPECT_EQ(chunk.data.substr(24), absl::string_view("\0\0", 2));
      frames.push_back(head);
    } else if (chunk.type == "IDAT") {
      EXPECT_EQ(frames.size(), 1U);
      frames.back() += std::string(chunk.bytes);
    } else if (chunk.type == "fdAT") {
      EXPECT_EQ(LoadBigEndian32(chunk.data), sequence++);
      EXPECT_GT(frames.size(), 1U);
      frames.back() += MakePngChunk("IDAT", chunk.data.substr(4));
    }
  }
  for (std::string& frame : frames) {
    frame += MakePngChunk("IEND", "");
  }
  return frames;
}

TEST(AnimationWriterTest, ApngHoldsEachFramesPixelsAndTimes) {
  const TempDir folder;
  for (const bool with_alpha : {false, true}) {
    SCOPED_TRACE(with_alpha);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string apng,
                                  WriteAnimation(folder.Sub("a.apng"), with_alpha, 4));
    const std::vector<std::string> frames = FramesOfApng(apng, 4);
    ASSERT_EQ(frames.size(), 4U);
    for (int i = 0; i < 4; ++i) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage decoded,
                                    image::DecodePng(frames[static_cast<std::size_t>(i)]));
      EXPECT_EQ(decoded, Frame(i, with_alpha)) << "frame " << i;
    }
    // A program that knows no animation sees the first frame.
    EXPECT_EQ(image::DecodePng(apng).value(), Frame(0, with_alpha));
  }
}

TEST(AnimationWriterTest, WebpHoldsEachFramesPixelsAndTimes) {
  const TempDir folder;
  for (const bool with_alpha : {false, true}) {
    SCOPED_TRACE(with_alpha);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string webp,
                                  WriteAnimation(folder.Sub("a.webp"), with_alpha, 4));
    const WebPData data{reinterpret_cast<const std::uint8_t*>(webp.data()), webp.size()};
    WebPAnimDecoder* const decoder = WebPAnimDecoderNew(&data, nullptr);
    ASSERT_NE(decoder, nullptr);
    WebPAnimInfo info;
    ASSERT_NE(WebPAnimDecoderGetInfo(decoder, &info), 0);
    EXPECT_EQ(info.canvas_width, static_cast<std::uint32_t>(kWidth));
    EXPECT_EQ(info.canvas_height, static_cast<std::uint32_t>(kHeight));
    EXPECT_EQ(info.frame_count, 4U);
    EXPECT_EQ(info.loop_count, 0U) << "plays for ever";
    for (int i = 0; i < 4; ++i) {
      std::uint8_t* pixels = nullptr;
      int end_ms = 0;
      ASSERT_NE(WebPAnimDecoderGetNext(decoder, &pixels, &end_ms), 0);
      EXPECT_EQ(end_ms, 80 * (i + 1));
      const image::RgbaImage expected = Frame(i, with_alpha);
      int different = 0;
      for (std::size_t k = 0; k < expected.pixels.size(); ++k) {
        // The reader puts frames together by alpha: a clear pixel's colour does not come back.
        const image::Rgba8& pixel = expected.pixels[k];
        const bool is_same =
            pixel.a == 0 ? pixels[4 * k + 3] == 0 : std::memcmp(&pixel, pixels + 4 * k, 4) == 0;
        different += is_same ? 0 : 1;
      }
      EXPECT_EQ(different, 0) << "frame " << i;
    }
    WebPAnimDecoderDelete(decoder);
  }
}

// Readers that put pictures together into a film look for the one image of each.
TEST(AnimationWriterTest, ASinglePictureIsOneLosslessImage) {
  for (const bool with_alpha : {false, true}) {
    const image::RgbaImage expected = Frame(0, with_alpha);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string webp, WebpOfPng(PngOf(expected)));
    EXPECT_EQ(webp.substr(0, 4), "RIFF");
    EXPECT_EQ(webp.substr(8, 8), "WEBPVP8L");
    int width = 0;
    int height = 0;
    std::uint8_t* const pixels = WebPDecodeRGBA(reinterpret_cast<const std::uint8_t*>(webp.data()),
                                                webp.size(), &width, &height);
    ASSERT_NE(pixels, nullptr);
    EXPECT_EQ(width, kWidth);
    EXPECT_EQ(height, kHeight);
    EXPECT_EQ(std::memcmp(pixels, expected.pixels.data(), expected.pixels.size() * 4), 0);
    WebPFree(pixels);
    EXPECT_EQ(webp, WebpOfPng(PngOf(expected)).value()) << "the same bytes each time";
  }
  EXPECT_THAT(WebpOfPng("no PNG"), StatusIs(absl::StatusCode::kDataLoss));
}

TEST(AnimationWriterTest, ASinglePictureIsAtMostAsLargeAsTheFormatAllows) {
  const int side = kMaxWebpSidePx + 1;
  const std::vector<image::Rgba8> pixels(static_cast<std::size_t>(side),
                                         image::Rgba8{1, 2, 3, 255});
  EXPECT_THAT(WebpOfPng(image::EncodePng(side, 1, pixels)),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(AnimationWriterTest, OneFrameIsAnAnimation) {
  const TempDir folder;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string apng,
                                WriteAnimation(folder.Sub("a.apng"), false, 1));
  EXPECT_EQ(FramesOfApng(apng, 1).size(), 1U);
  ISOSCOPE_EXPECT_OK(WriteAnimation(folder.Sub("a.webp"), false, 1).status());
}

TEST(AnimationWriterTest, WrongFramesAreRefusedAndNothingIsLeftBehind) {
  const TempDir folder;
  image::RgbaImage narrow = Frame(0, false);
  narrow.width = 7;
  narrow.height = 111;
  for (const char* name : {"a.apng", "a.webp"}) {
    SCOPED_TRACE(name);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto writer,
                                  CreateAnimation(folder.Sub(name), Options(false, 2)));
    EXPECT_THAT(writer->AddFrame("no PNG"), StatusIs(absl::StatusCode::kDataLoss));
    EXPECT_THAT(writer->AddFrame(PngOf(narrow)), StatusIs(absl::StatusCode::kDataLoss));
    ISOSCOPE_EXPECT_OK(writer->AddFrame(PngOf(Frame(0, false))));
    EXPECT_THAT(writer->Finish(), StatusIs(absl::StatusCode::kFailedPrecondition));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(AnimationWriterTest, NamesAndSizesDecideTheFormat) {
  EXPECT_TRUE(IsAnimationName("a.apng"));
  EXPECT_TRUE(IsAnimationName("a.WebP"));
  for (const AnimationFormat format : kAnimationFormats) {
    EXPECT_TRUE(IsAnimationName("a." + std::string(NameOf(format))));
  }
  EXPECT_FALSE(IsAnimationName("a.png"));
  EXPECT_FALSE(IsAnimationName("apng"));
  ISOSCOPE_EXPECT_OK(CheckAnimationSize("a.webp", kMaxWebpSidePx, 1));
  EXPECT_TRUE(absl::IsInvalidArgument(CheckAnimationSize("a.webp", 1, kMaxWebpSidePx + 1)));
  ISOSCOPE_EXPECT_OK(CheckAnimationSize("a.apng", 1, kMaxWebpSidePx + 1));
}

TEST(AnimationWriterTest, WebpRefusesAnAnimationLongerThanItCanCount) {
  AnimationOptions options = Options(false, 1'000'000);
  options.fps = 0.1;
  EXPECT_THAT(CreateWebp("unused.webp", options), StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace isoscope::client
