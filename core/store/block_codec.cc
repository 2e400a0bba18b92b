// LZ4 and Zstandard take two steps, and decoding the same in reverse:
//
//   1. Shuffle, for samples wider than a byte: the first byte of every sample, then the second of
//      every sample, and so on. Neighbouring samples often agree in their higher bytes, so these
//      become long repeats.
//   2. Compress: one LZ4 block without frame or size, or one Zstandard frame (RFC 8878).
//
// Example: the uint16 samples 0x0102, 0x0103, 0x0104 are stored as 02 01 03 01 04 01 and shuffled
// to 02 03 04 01 01 01.
//
// Packed blocks have no shuffle and no library: sample_packing.cc. They are decoded faster than LZ4
// where samples change smoothly, and slower where they repeat.
//
// Invariants: a compressed block is at least one byte smaller than its samples, else it is stored
// raw; the decoder refuses any other size before it looks at the bytes. The block index holds the
// raw size, so neither format needs to.
//
// Layout: docs/format/shard.md, "blocks.bin".

#include "core/store/block_codec.h"

#include <lz4.h>
#include <zstd.h>

#include <cstdint>
#include <memory>
#include <utility>

#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/store/sample_packing.h"

namespace isoscope::store {
namespace {

// The fastest of Zstandard's ordinary levels.
constexpr int kZstdLevel = 1;
// LZ4 replaces packing where it is smaller than this share of it. Where samples repeat that much, it
// is decoded as fast.
constexpr double kShareForLz4 = 0.75;

// Making a context costs more than compressing a small block: each thread keeps its own.
ZSTD_CCtx* ThreadCompressor() {
  thread_local const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(),
                                                                                  &ZSTD_freeCCtx);
  ISOSCOPE_CHECK(context != nullptr);
  return context.get();
}
ZSTD_DCtx* ThreadDecompressor() {
  thread_local const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(),
                                                                                  &ZSTD_freeDCtx);
  ISOSCOPE_CHECK(context != nullptr);
  return context.get();
}

template <std::size_t kWidth>
void Shuffle(const char* in, std::size_t count, char* out) {
  for (std::size_t byte = 0; byte < kWidth; ++byte) {
    for (std::size_t i = 0; i < count; ++i) {
      out[byte * count + i] = in[i * kWidth + byte];
    }
  }
}
template <std::size_t kWidth>
void Unshuffle(const char* in, std::size_t count, char* out) {
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t byte = 0; byte < kWidth; ++byte) {
      out[i * kWidth + byte] = in[byte * count + i];
    }
  }
}

void ShuffleOf(std::size_t width, const char* in, std::size_t count, char* out) {
  switch (width) {
    case 2:
      return Shuffle<2>(in, count, out);
    case 4:
      return Shuffle<4>(in, count, out);
    default:
      ISOSCOPE_CHECK_EQ(width, 8U);
      return Shuffle<8>(in, count, out);
  }
}
void UnshuffleOf(std::size_t width, const char* in, std::size_t count, char* out) {
  switch (width) {
    case 2:
      return Unshuffle<2>(in, count, out);
    case 4:
      return Unshuffle<4>(in, count, out);
    default:
      ISOSCOPE_CHECK_EQ(width, 8U);
      return Unshuffle<8>(in, count, out);
  }
}

// Compresses into `*out`, which then has the compressed size. False, often early, if that would not
// be below `limit`. REQUIRES: limit <= bytes.size().
bool Compress(BlockEncoding encoding, absl::string_view bytes, std::size_t limit,
              std::string* out) {
  if (limit < 2 || bytes.size() > LZ4_MAX_INPUT_SIZE) {
    return false;
  }
  out->resize(limit - 1);
  std::size_t size = 0;
  if (encoding == BlockEncoding::kLz4) {
    size = static_cast<std::size_t>(LZ4_compress_default(
        bytes.data(), out->data(), static_cast<int>(bytes.size()), static_cast<int>(out->size())));
  } else {
    const std::size_t result = ZSTD_compressCCtx(ThreadCompressor(), out->data(), out->size(),
                                                 bytes.data(), bytes.size(), kZstdLevel);
    size = ZSTD_isError(result) != 0 ? 0 : result;
  }
  out->resize(size);
  return size > 0;
}

// True if `stored` decompresses to exactly `size` bytes.
bool Decompress(BlockEncoding encoding, absl::string_view stored, std::size_t size, char* out) {
  if (stored.size() >= size || size > LZ4_MAX_INPUT_SIZE) {
    return false;
  }
  if (encoding == BlockEncoding::kLz4) {
    return LZ4_decompress_safe(stored.data(), out, static_cast<int>(stored.size()),
                               static_cast<int>(size)) == static_cast<int>(size);
  }
  return ZSTD_decompressDCtx(ThreadDecompressor(), out, size, stored.data(), stored.size()) == size;
}

// Shuffles, and does the same.
bool ShuffleAndCompress(BlockEncoding encoding, std::size_t width, absl::string_view samples,
                        std::size_t limit, std::string* out) {
  if (width == 1) {
    return Compress(encoding, samples, limit, out);
  }
  std::string shuffled(samples.size(), '\0');
  ShuffleOf(width, samples.data(), samples.size() / width, shuffled.data());
  return Compress(encoding, shuffled, limit, out);
}

bool DecompressAndUnshuffle(BlockEncoding encoding, std::size_t width, absl::string_view stored,
                            std::size_t raw_size, std::string* scratch, char* out) {
  if (width == 1) {
    return Decompress(encoding, stored, raw_size, out);
  }
  scratch->resize(raw_size);
  if (!Decompress(encoding, stored, raw_size, scratch->data())) {
    return false;
  }
  UnshuffleOf(width, scratch->data(), raw_size / width, out);
  return true;
}

// Packs the block, or compresses it by LZ4. Returns kRaw if neither makes it smaller.
BlockEncoding PackOrCompress(std::size_t width, const math::Index3& dims, absl::string_view samples,
                             std::string* out) {
  const bool is_packed = width <= kMaxPackedWidth && PackSamples(width, dims, samples, out);
  const std::size_t limit =
      is_packed ? static_cast<std::size_t>(kShareForLz4 * static_cast<double>(out->size()))
                : samples.size();
  std::string compressed;
  if (ShuffleAndCompress(BlockEncoding::kLz4, width, samples, limit, &compressed)) {
    *out = std::move(compressed);
    return BlockEncoding::kLz4;
  }
  return is_packed ? BlockEncoding::kPacked : BlockEncoding::kRaw;
}

}  // namespace

absl::StatusOr<BlockEncoding> ParseBlockEncoding(absl::string_view name) {
  for (const BlockEncoding encoding :
       {BlockEncoding::kRaw, BlockEncoding::kLz4, BlockEncoding::kZstd, BlockEncoding::kPacked}) {
    if (name == NameOf(encoding)) {
      return encoding;
    }
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("compression \"%s\", expected none, lz4, zstd or packed", name));
}

absl::string_view NameOf(BlockEncoding encoding) {
  switch (encoding) {
    case BlockEncoding::kRaw:
      return "none";
    case BlockEncoding::kLz4:
      return "lz4";
    case BlockEncoding::kZstd:
      return "zstd";
    case BlockEncoding::kPacked:
      return "packed";
    case BlockEncoding::kOverhang:
      return "overhang";
  }
  return "unknown";
}

BlockEncoding EncodeBlock(BlockEncoding wanted, volume::ScalarType type, const math::Index3& dims,
                          absl::string_view samples, std::string* out) {
  const std::size_t width = volume::SizeOf(type);
  ISOSCOPE_CHECK_EQ(samples.size(), static_cast<std::size_t>(math::Volume(dims)) * width);
  BlockEncoding encoding = BlockEncoding::kRaw;
  if (wanted == BlockEncoding::kPacked) {
    encoding = PackOrCompress(width, dims, samples, out);
  } else if (wanted != BlockEncoding::kRaw &&
             ShuffleAndCompress(wanted, width, samples, samples.size(), out)) {
    encoding = wanted;
  }
  if (encoding == BlockEncoding::kRaw) {
    out->assign(samples.data(), samples.size());
  }
  return encoding;
}

absl::Status DecodeBlock(BlockEncoding encoding, volume::ScalarType type, const math::Index3& dims,
                         absl::string_view stored, std::string* scratch, char* out) {
  const std::size_t width = volume::SizeOf(type);
  const std::size_t raw_size = static_cast<std::size_t>(math::Volume(dims)) * width;
  bool is_whole = false;
  switch (encoding) {
    case BlockEncoding::kRaw:
      is_whole = stored.size() == raw_size;
      stored.copy(out, raw_size);
      break;
    case BlockEncoding::kPacked:
      is_whole = stored.size() < raw_size && width <= kMaxPackedWidth &&
                 UnpackSamples(width, dims, stored, scratch, out);
      break;
    case BlockEncoding::kLz4:
    case BlockEncoding::kZstd:
      is_whole = DecompressAndUnshuffle(encoding, width, stored, raw_size, scratch, out);
      break;
    case BlockEncoding::kOverhang:  // not all samples (block_overhang.h)
      break;
  }
  return is_whole ? absl::OkStatus()
                  : absl::DataLossError(absl::StrFormat("%d bytes are no %s encoding of %d bytes",
                                                        stored.size(), NameOf(encoding), raw_size));
}

}  // namespace isoscope::store
