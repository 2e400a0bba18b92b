#include "clients/cpp/picture_file/png_chunks.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/image/png_codec.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::StatusIs;

std::string SmallPng() {
  const std::vector<image::Rgba8> pixels(6, image::Rgba8{1, 2, 3, 255});
  return image::EncodePng(3, 2, pixels);
}

TEST(PngChunksTest, EmptyChunkHasTheKnownBytes) {
  EXPECT_EQ(MakePngChunk("IEND", ""), std::string("\0\0\0\0IEND\xae\x42\x60\x82", 12));
}

TEST(PngChunksTest, ChunksTogetherAreTheFile) {
  const std::string png = SmallPng();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<PngChunk> chunks, ParsePngChunks(png));
  std::string joined(kPngSignature);
  for (const PngChunk& chunk : chunks) {
    joined += std::string(chunk.bytes);
    EXPECT_EQ(MakePngChunk(chunk.type, chunk.data), chunk.bytes);
  }
  EXPECT_EQ(joined, png);
  EXPECT_EQ(chunks.front().type, "IHDR");
  EXPECT_EQ(LoadBigEndian32(chunks.front().data), 3U) << "the width";
  EXPECT_EQ(chunks.back().type, "IEND");
}

TEST(PngChunksTest, EveryPrefixAndEveryFlippedBitIsRefused) {
  const std::string png = SmallPng();
  for (std::size_t size = 0; size < png.size(); ++size) {
    // A buffer of exactly this size, so that sanitizers see a read behind it.
    const std::vector<char> cut(png.begin(), png.begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_THAT(ParsePngChunks({cut.data(), cut.size()}), StatusIs(absl::StatusCode::kDataLoss))
        << size;
  }
  for (std::size_t bit = 0; bit < 8 * png.size(); ++bit) {
    std::string damaged = png;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << bit % 8));
    EXPECT_THAT(ParsePngChunks(damaged), StatusIs(absl::StatusCode::kDataLoss)) << bit;
  }
}

TEST(PngChunksTest, BytesAfterTheEndAreIgnored) {
  const std::string png = SmallPng();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto chunks, ParsePngChunks(png));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto more, ParsePngChunks(png + "more"));
  EXPECT_EQ(more.size(), chunks.size());
}

}  // namespace
}  // namespace isoscope::client
