// The bytes of an array begin behind its tag, or at its offset behind the underscore of
// AppendedData. They are a few sizes of 4 or 8 bytes each, and then the samples:
//
//   plain       size, samples
//   compressed  n, bytes of a block, bytes of the last one (0: as the others), n compressed sizes;
//               n blocks, each by itself: a zlib stream, a block of LZ4, or an .xz stream (LZMA)
//
// For 80 000 bytes in blocks of 32 768: 3, 32768, 14464, 9011, 8700, 4100, then 21 811 bytes of
// blocks.
//
// Either is in base64 if it stands inline, or if AppendedData says so. Plain data are one run of
// base64; in compressed data, sizes and blocks are encoded separately, so that the blocks begin at
// the next whole group of four characters. Three bytes are always four characters, without gaps, so
// the position of a byte follows from its offset. Sizes beyond 4 GiB with a header of 32 bits are
// written without their upper bits. Source: VTK's file format description, "XML File Formats",
// https://docs.vtk.org.

#include "core/formats/vtk/vti_data.h"

#include <lz4.h>
#include <lzma.h>

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/bytes/byte_order.h"
#include "zlib.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxBlockBytes = 64 * base::kMiB;  // of compressed data, decoded
// Of the decoder of .xz, whose dictionary has 64 MiB at the highest level.
constexpr std::int64_t kMaxLzmaBytes = 72 * base::kMiB;
constexpr std::int64_t kMaxBlocks = std::int64_t{1} << 26;
constexpr std::size_t kGroupsAtOnce = 4096;  // of base64: 16 KiB of text, 12 KiB of bytes

// Bytes in a file, as they are or as base64 text from `start`.
class EncodedBytes {
 public:
  EncodedBytes(const io::RandomAccessFile* file, std::int64_t start, bool is_base64)
      : file_(file), start_(start), is_base64_(is_base64) {}

  // Returns the separately encoded bytes behind the first `size` bytes.
  [[nodiscard]] EncodedBytes Behind(std::int64_t size) const {
    return {file_, start_ + (is_base64_ ? (size + 2) / 3 * 4 : size), is_base64_};
  }
  // Bytes that the rest of the file can hold at most.
  [[nodiscard]] std::int64_t MaxSize() const {
    const std::int64_t rest = std::max<std::int64_t>(file_->size_bytes() - start_, 0);
    return is_base64_ ? rest / 4 * 3 : rest;
  }

  // Not set: text.
  [[nodiscard]] std::optional<std::int64_t> plain_start() const {
    return is_base64_ ? std::nullopt : std::optional(start_);
  }

  absl::Status ReadAt(std::int64_t offset, std::size_t size, char* out) const {
    if (!is_base64_) {
      return file_->ReadAt(start_ + offset, size, out);
    }
    std::string text;
    std::string bytes;
    auto skip = static_cast<std::size_t>(offset % 3);
    std::int64_t position = start_ + offset / 3 * 4;
    while (size > 0) {
      text.resize(4 * std::min(kGroupsAtOnce, (skip + size + 2) / 3));
      ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(position, text.size(), text.data()));
      const std::size_t take = std::min(size, text.size() / 4 * 3 - skip);
      // Abseil skips white space and accepts padding anywhere; both give fewer bytes.
      if (!absl::Base64Unescape(text, &bytes) || bytes.size() < skip + take) {
        return absl::DataLossError(
            absl::StrFormat("%s: no base64 text in the %d characters at byte %d: damaged or cut",
                            file_->path(), text.size(), position));
      }
      out = std::copy_n(bytes.data() + skip, take, out);
      size -= take;
      skip = 0;
      position += static_cast<std::int64_t>(text.size());
    }
    return absl::OkStatus();
  }

 private:
  const io::RandomAccessFile* file_;
  std::int64_t start_;
  bool is_base64_;
};

class PlainData final : public VtiData {
 public:
  PlainData(const EncodedBytes& bytes, std::int64_t skipped_bytes)
      : bytes_(bytes), skipped_bytes_(skipped_bytes) {}

  [[nodiscard]] std::int64_t memory_bytes() const override { return 32 * base::kKiB; }
  absl::Status ReadAt(std::int64_t offset, std::size_t size, char* out) override {
    return bytes_.ReadAt(skipped_bytes_ + offset, size, out);
  }
  [[nodiscard]] std::unique_ptr<VtiData> Again() const override {
    return std::make_unique<PlainData>(bytes_, skipped_bytes_);
  }
  [[nodiscard]] std::optional<std::int64_t> block_bytes() const override { return 0; }
  [[nodiscard]] std::optional<std::int64_t> plain_start() const override {
    const std::optional<std::int64_t> start = bytes_.plain_start();
    return start.has_value() ? std::optional(*start + skipped_bytes_) : std::nullopt;
  }

 private:
  const EncodedBytes bytes_;
  const std::int64_t skipped_bytes_;  // the size
};

struct BlockTable {
  std::int64_t block_bytes = 0;       // decoded, of each block but the last
  std::int64_t size = 0;              // decoded, of all
  std::vector<std::int64_t> offsets;  // of each compressed block, and the end
};

struct Decoded {
  std::size_t size = 0;  // bytes that came out
  int error = 0;         // of the library; 0: none
};

// Decodes a whole block, which must fill `out`.
using BlockDecoder = Decoded (*)(const std::vector<char>& in, std::vector<char>* out);

Decoded DecodeZlib(const std::vector<char>& in, std::vector<char>* out) {
  auto size = static_cast<uLongf>(out->size());
  const int result =
      uncompress(reinterpret_cast<Bytef*>(out->data()), &size,
                 reinterpret_cast<const Bytef*>(in.data()), static_cast<uLong>(in.size()));
  return {.size = size, .error = result};
}

Decoded DecodeLz4(const std::vector<char>& in, std::vector<char>* out) {
  // Blocks have at most 64 MiB.
  const int size = LZ4_decompress_safe(in.data(), out->data(), static_cast<int>(in.size()),
                                       static_cast<int>(out->size()));
  return size < 0 ? Decoded{.size = 0, .error = size}
                  : Decoded{.size = static_cast<std::size_t>(size), .error = 0};
}

Decoded DecodeLzma(const std::vector<char>& in, std::vector<char>* out) {
  std::uint64_t limit = kMaxLzmaBytes;
  std::size_t read = 0;
  std::size_t size = 0;
  const lzma_ret result = lzma_stream_buffer_decode(
      &limit, 0, nullptr, reinterpret_cast<const std::uint8_t*>(in.data()), &read, in.size(),
      reinterpret_cast<std::uint8_t*>(out->data()), &size, out->size());
  return {.size = size, .error = static_cast<int>(result)};
}

struct Compressor {
  absl::string_view name;   // in the file
  absl::string_view label;  // for messages
  BlockDecoder decode;
  std::int64_t memory_bytes = 0;  // of the library, beside the block
};

constexpr std::array<Compressor, 3> kCompressors{
    {{"vtkZLibDataCompressor", "zlib", DecodeZlib, 0},
     {"vtkLZ4DataCompressor", "LZ4", DecodeLz4, 0},
     {"vtkLZMADataCompressor", "LZMA", DecodeLzma, kMaxLzmaBytes}}};

// Null for a name that is none of theirs.
const Compressor* FindCompressor(absl::string_view name) {
  const auto* const found =
      std::find_if(kCompressors.begin(), kCompressors.end(),
                   [&](const Compressor& compressor) { return compressor.name == name; });
  return found == kCompressors.end() ? nullptr : found;
}

class CompressedData final : public VtiData {
 public:
  CompressedData(std::string path, const EncodedBytes& bytes,
                 std::shared_ptr<const BlockTable> blocks, const Compressor& compressor)
      : path_(std::move(path)),
        bytes_(bytes),
        shared_blocks_(std::move(blocks)),
        blocks_(*shared_blocks_),
        compressor_(compressor) {}

  [[nodiscard]] std::int64_t memory_bytes() const override {
    return 32 * base::kKiB + 2 * blocks_.block_bytes + compressor_.memory_bytes +
           static_cast<std::int64_t>(blocks_.offsets.size() * sizeof(std::int64_t));
  }

  [[nodiscard]] std::unique_ptr<VtiData> Again() const override {
    return std::make_unique<CompressedData>(path_, bytes_, shared_blocks_, compressor_);
  }
  [[nodiscard]] std::optional<std::int64_t> block_bytes() const override {
    return compressor_.memory_bytes > 0 ? std::nullopt : std::optional(blocks_.block_bytes);
  }

  absl::Status ReadAt(std::int64_t offset, std::size_t size, char* out) override {
    const std::int64_t end = offset + static_cast<std::int64_t>(size);
    while (offset < end) {
      const std::int64_t block = offset / blocks_.block_bytes;
      ISOSCOPE_RETURN_IF_ERROR(Hold(block));
      const std::int64_t first = block * blocks_.block_bytes;
      const std::int64_t stop = std::min(end, first + static_cast<std::int64_t>(decoded_.size()));
      out = std::copy(decoded_.begin() + (offset - first), decoded_.begin() + (stop - first), out);
      offset = stop;
    }
    return absl::OkStatus();
  }

 private:
  // Decodes a block into decoded_.
  absl::Status Hold(std::int64_t block) {
    if (block == held_block_) {
      return absl::OkStatus();
    }
    held_block_ = -1;
    const auto at = static_cast<std::size_t>(block);
    decoded_.resize(static_cast<std::size_t>(
        std::min(blocks_.block_bytes, blocks_.size - block * blocks_.block_bytes)));
    encoded_.resize(static_cast<std::size_t>(blocks_.offsets[at + 1] - blocks_.offsets[at]));
    ISOSCOPE_RETURN_IF_ERROR(bytes_.ReadAt(blocks_.offsets[at], encoded_.size(), encoded_.data()));
    const Decoded result = compressor_.decode(encoded_, &decoded_);
    if (result.error != 0 || result.size != decoded_.size()) {
      return absl::DataLossError(
          absl::StrFormat("%s: compressed block %d of %d is damaged: %d of %d bytes, %s error %d",
                          path_, block, blocks_.offsets.size() - 1, result.size, decoded_.size(),
                          compressor_.label, result.error));
    }
    held_block_ = block;
    return absl::OkStatus();
  }

  const std::string path_;
  const EncodedBytes bytes_;  // of the blocks
  const std::shared_ptr<const BlockTable> shared_blocks_;
  const BlockTable& blocks_;
  const Compressor& compressor_;
  std::int64_t held_block_ = -1;
  std::vector<char> decoded_;
  std::vector<char> encoded_;
};

// Reads the sizes that stand before the samples.
class SizeReader {
 public:
  SizeReader(const VtiHeader& header, const EncodedBytes& bytes)
      : bytes_per_size_(header.has_long_sizes ? 8 : 4),
        is_big_endian_(header.is_big_endian),
        bytes_(bytes) {}

  [[nodiscard]] std::int64_t BytesOf(std::int64_t count) const {
    return count * static_cast<std::int64_t>(bytes_per_size_);
  }
  // Sizes [first, first + count). Those beyond int64 come out negative.
  [[nodiscard]] absl::StatusOr<std::vector<std::int64_t>> Read(std::int64_t first,
                                                               std::int64_t count) const {
    if (BytesOf(first + count) > bytes_.MaxSize()) {
      return absl::InvalidArgumentError(
          "the file ends within the sizes before its samples: it is cut");
    }
    std::string text(static_cast<std::size_t>(BytesOf(count)), '\0');
    ISOSCOPE_RETURN_IF_ERROR(bytes_.ReadAt(BytesOf(first), text.size(), text.data()));
    if (is_big_endian_) {
      SwapBytes(bytes_per_size_, static_cast<std::size_t>(count), text.data());
    }
    std::vector<std::int64_t> sizes(static_cast<std::size_t>(count));
    for (std::size_t i = 0; i < sizes.size(); ++i) {
      const char* at = text.data() + i * bytes_per_size_;
      sizes[i] = bytes_per_size_ == 4 ? std::int64_t{base::LoadLittleEndian<std::uint32_t>(at)}
                                      : base::LoadLittleEndian<std::int64_t>(at);
    }
    return sizes;
  }

 private:
  const std::size_t bytes_per_size_;
  const bool is_big_endian_;
  const EncodedBytes bytes_;
};

// The table of compressed blocks, at most `max_bytes` of them, for `size` bytes in all.
absl::StatusOr<BlockTable> ReadBlockTable(const SizeReader& reader, std::int64_t size,
                                          std::int64_t max_bytes) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::int64_t> head, reader.Read(0, 3));
  const std::int64_t count = head[0];
  const std::int64_t block_bytes = head[1];
  const std::int64_t last_bytes = head[2] == 0 ? block_bytes : head[2];
  if (count < 1 || count > kMaxBlocks || block_bytes < 1 || block_bytes > kMaxBlockBytes ||
      last_bytes < 1 || last_bytes > block_bytes ||
      (count - 1) * block_bytes + last_bytes != size) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d compressed blocks of %d bytes, the last of %d; expected %d bytes in all, blocks of at "
        "most %d",
        count, block_bytes, last_bytes, size, kMaxBlockBytes));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::int64_t> sizes, reader.Read(3, count));
  BlockTable blocks{.block_bytes = block_bytes, .size = size, .offsets = {0}};
  blocks.offsets.reserve(sizes.size() + 1);
  for (const std::int64_t compressed : sizes) {
    // No compressor makes a block much larger.
    if (compressed < 1 || compressed > block_bytes + block_bytes / 8 + 1024 ||
        blocks.offsets.back() + compressed > max_bytes) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "compressed block %d of %d: %d bytes at %d, where %d are left in the file: it is cut or "
          "damaged",
          blocks.offsets.size() - 1, count, compressed, blocks.offsets.back(),
          max_bytes - blocks.offsets.back()));
    }
    blocks.offsets.push_back(blocks.offsets.back() + compressed);
  }
  return blocks;
}

// Finds the first byte of the array.
absl::StatusOr<EncodedBytes> FindBytes(const io::RandomAccessFile& file, const VtiHeader& header,
                                       const VtiArray& array) {
  const bool is_appended = array.format == "appended";
  if (!is_appended && array.format != "binary") {
    return absl::InvalidArgumentError(
        absl::StrFormat("data format \"%s\"; expected appended or binary: write the file anew "
                        "without text (ascii) data",
                        array.format));
  }
  std::int64_t position = is_appended ? header.appended_start : array.inline_start;
  if (position < 0) {
    return absl::InvalidArgumentError("no AppendedData: the file is cut");
  }
  // White space, and for appended data the underscore that begins it.
  constexpr std::int64_t kMaxSpace = 4096;
  const std::int64_t limit = std::min(position + kMaxSpace, file.size_bytes());
  char c = ' ';
  for (; position < limit; ++position) {
    ISOSCOPE_RETURN_IF_ERROR(file.ReadAt(position, 1, &c));
    if (!absl::ascii_isspace(static_cast<unsigned char>(c))) {
      break;
    }
  }
  if (!is_appended) {
    return EncodedBytes(&file, position, true);
  }
  if (c != '_') {
    return absl::InvalidArgumentError("no '_' at the start of AppendedData: the file is cut");
  }
  const std::string& encoding = header.appended_encoding;
  if (encoding != "raw" && encoding != "base64") {
    return absl::InvalidArgumentError(
        absl::StrFormat("encoding \"%s\" of AppendedData; expected raw or base64", encoding));
  }
  std::int64_t offset = 0;
  if (!absl::SimpleAtoi(array.offset, &offset) || offset < 0 || offset > file.size_bytes()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("offset=\"%s\" in %d bytes of file", array.offset, file.size_bytes()));
  }
  return EncodedBytes(&file, position + 1 + offset, encoding == "base64");
}

absl::StatusOr<std::unique_ptr<VtiData>> OpenCompressed(const std::string& path,
                                                        const SizeReader& reader,
                                                        const EncodedBytes& bytes,
                                                        std::int64_t size,
                                                        const Compressor& compressor) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::int64_t> count, reader.Read(0, 1));
  const std::int64_t size_count = 3 + std::clamp<std::int64_t>(count[0], 0, kMaxBlocks);
  const EncodedBytes blocks = bytes.Behind(reader.BytesOf(size_count));
  ISOSCOPE_ASSIGN_OR_RETURN(BlockTable table, ReadBlockTable(reader, size, blocks.MaxSize()));
  return std::make_unique<CompressedData>(
      path, blocks, std::make_shared<const BlockTable>(std::move(table)), compressor);
}

absl::StatusOr<std::unique_ptr<VtiData>> OpenPlain(const VtiHeader& header,
                                                   const SizeReader& reader,
                                                   const EncodedBytes& bytes, std::int64_t size) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::int64_t> stored, reader.Read(0, 1));
  const std::int64_t skipped_bytes = reader.BytesOf(1);
  const bool fits = stored[0] == (header.has_long_sizes ? size : size & 0xffffffff);
  if (!fits || bytes.MaxSize() - skipped_bytes < size) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "its samples need %d bytes, the array says %d and the file has room for %d", size,
        stored[0], std::max<std::int64_t>(bytes.MaxSize() - skipped_bytes, 0)));
  }
  return std::make_unique<PlainData>(bytes, skipped_bytes);
}

absl::StatusOr<std::unique_ptr<VtiData>> Open(const io::RandomAccessFile& file,
                                              const VtiHeader& header, const VtiArray& array,
                                              std::int64_t size) {
  const Compressor* const compressor = FindCompressor(header.compressor);
  if (!header.compressor.empty() && compressor == nullptr) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "compressor \"%s\"; expected vtkZLibDataCompressor, vtkLZ4DataCompressor or "
        "vtkLZMADataCompressor, or none",
        header.compressor));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const EncodedBytes bytes, FindBytes(file, header, array));
  const SizeReader reader(header, bytes);
  return header.compressor.empty() ? OpenPlain(header, reader, bytes, size)
                                   : OpenCompressed(file.path(), reader, bytes, size, *compressor);
}

}  // namespace

absl::StatusOr<std::unique_ptr<VtiData>> OpenVtiData(const io::RandomAccessFile& file,
                                                     const VtiHeader& header, const VtiArray& array,
                                                     std::int64_t size) {
  // NOLINTNEXTLINE(clang-analyzer-cplusplus.NewDeleteLeaks): the StatusOr owns it
  auto data = Open(file, header, array, size);
  if (!data.ok()) {
    return absl::Status(data.status().code(), absl::StrFormat("%s: array \"%s\": %s", file.path(),
                                                              array.name, data.status().message()));
  }
  return data;
}

}  // namespace isoscope::source
