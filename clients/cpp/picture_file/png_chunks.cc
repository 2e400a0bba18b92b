#include "clients/cpp/picture_file/png_chunks.h"

#include <zlib.h>

#include <cstddef>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

#include "core/base/check.h"

namespace isoscope::client {
namespace {

constexpr std::size_t kWordBytes = 4;
// Length, type and CRC.
constexpr std::size_t kFrameBytes = 3 * kWordBytes;
constexpr std::uint32_t kMaxChunkBytes = 0x7fffffff;

std::uint32_t Crc32(absl::string_view bytes) {
  return static_cast<std::uint32_t>(
      crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

absl::Status Damaged(std::size_t offset, absl::string_view what) {
  return absl::DataLossError(
      absl::StrCat("byte ", offset, ": ", what, "; expected a complete PNG"));
}

}  // namespace

std::string BigEndian32(std::uint32_t value) {
  return {static_cast<char>(value >> 24), static_cast<char>(value >> 16),
          static_cast<char>(value >> 8), static_cast<char>(value)};
}

std::uint32_t LoadBigEndian32(absl::string_view bytes) {
  std::uint32_t value = 0;
  for (const char c : bytes.substr(0, kWordBytes)) {
    value = value << 8 | static_cast<unsigned char>(c);
  }
  return value;
}

std::string MakePngChunk(absl::string_view type, absl::string_view data) {
  ISOSCOPE_CHECK_EQ(type.size(), kWordBytes);
  ISOSCOPE_CHECK_LE(data.size(), std::size_t{kMaxChunkBytes});
  std::string chunk =
      absl::StrCat(BigEndian32(static_cast<std::uint32_t>(data.size())), type, data);
  const std::string crc = BigEndian32(Crc32(absl::string_view(chunk).substr(kWordBytes)));
  return chunk += crc;
}

absl::StatusOr<std::vector<PngChunk>> ParsePngChunks(absl::string_view png) {
  if (png.substr(0, kPngSignature.size()) != kPngSignature) {
    return Damaged(0, "no signature of a PNG");
  }
  std::vector<PngChunk> chunks;
  for (std::size_t offset = kPngSignature.size();;) {
    const absl::string_view rest = png.substr(offset);
    if (rest.size() < kFrameBytes) {
      return Damaged(offset, "the bytes end before IEND");
    }
    const std::uint32_t size = LoadBigEndian32(rest);
    if (size > kMaxChunkBytes || size > rest.size() - kFrameBytes) {
      return Damaged(offset, absl::StrCat("a chunk of ", size, " bytes, of which ",
                                          rest.size() - kFrameBytes, " are there"));
    }
    const PngChunk chunk{.type = rest.substr(kWordBytes, kWordBytes),
                         .data = rest.substr(2 * kWordBytes, size),
                         .bytes = rest.substr(0, size + kFrameBytes)};
    if (Crc32(rest.substr(kWordBytes, kWordBytes + size)) !=
        LoadBigEndian32(rest.substr(2 * kWordBytes + size))) {
      return Damaged(offset, "the CRC of a chunk is wrong");
    }
    if (chunks.empty() && chunk.type != "IHDR") {
      return Damaged(offset, "the first chunk is not IHDR");
    }
    chunks.push_back(chunk);
    offset += chunk.bytes.size();
    if (chunk.type == "IEND") {
      return chunks;
    }
  }
}

}  // namespace isoscope::client
