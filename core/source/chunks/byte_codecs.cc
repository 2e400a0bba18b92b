// Codecs of bytes: compressors, checksums and shuffles.
//
// A compressor is a function that decodes into at most so many bytes as the chunk needs. None asks
// its stream how long it is: frames of zstd need not say it, and a damaged stream may lie.

#include <lzma.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <limits>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "blosc.h"
#include "bzlib.h"
#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/printable.h"
#include "core/source/chunks/chunk_codec.h"
#include "lz4.h"
#include "zlib.h"
#include "zstd.h"

namespace isoscope::source {
namespace {

using Bytes = absl::StatusOr<std::string>;

absl::Status DamagedStream(absl::string_view what) {
  return absl::DataLossError(absl::StrCat(what, ": it is damaged or cut"));
}

// ---- Compressors. -------------------------------------------------------------------------------

// Each resizes `out`, decodes into it, and resizes it to what there was. A buffer that has the size
// already, as that of the chunk before, is not filled with zeros first.

// zlib's own or gzip's streams, of which several may follow each other.
template <int window_bits>
absl::Status InflateChunk(absl::string_view in, std::size_t max_size, std::string* out) {
  if (in.size() > std::numeric_limits<uInt>::max() ||
      max_size >= std::numeric_limits<uInt>::max()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%d bytes of %d; expected less than 4 GiB", in.size(), max_size));
  }
  z_stream z{};
  if (inflateInit2(&z, window_bits) != Z_OK) {
    return absl::ResourceExhaustedError("no memory for zlib");
  }
  const std::unique_ptr<z_stream, int (*)(z_stream*)> ends(&z, inflateEnd);
  out->resize(max_size + 1);  // a byte more shows a stream that is too long
  z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(in.data()));
  z.avail_in = static_cast<uInt>(in.size());
  z.next_out = reinterpret_cast<Bytef*>(out->data());
  z.avail_out = static_cast<uInt>(out->size());
  while (true) {
    const int result = inflate(&z, Z_FINISH);
    if (result != Z_STREAM_END) {
      return z.avail_out == 0 ? absl::DataLossError(absl::StrCat("more than ", max_size, " bytes"))
                              : DamagedStream(z.msg == nullptr ? "the stream has no end" : z.msg);
    }
    if (z.avail_in == 0) {
      break;
    }
    if (inflateReset(&z) != Z_OK) {
      return DamagedStream("the stream can't be read on");
    }
  }
  const std::size_t size = out->size() - z.avail_out;
  if (size > max_size) {
    return absl::DataLossError(absl::StrCat("more than ", max_size, " bytes"));
  }
  out->resize(size);
  return absl::OkStatus();
}

absl::Status DecodeZstd(absl::string_view in, std::size_t max_size, std::string* out) {
  out->resize(max_size);
  const std::size_t size = ZSTD_decompress(out->data(), out->size(), in.data(), in.size());
  if (ZSTD_isError(size) != 0) {
    return DamagedStream(ZSTD_getErrorName(size));
  }
  out->resize(size);
  return absl::OkStatus();
}

absl::Status DecodeBz2(absl::string_view in, std::size_t max_size, std::string* out) {
  constexpr std::size_t kMax = std::numeric_limits<unsigned int>::max();
  if (in.size() > kMax || max_size > kMax) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%d bytes of %d; expected less than 4 GiB", in.size(), max_size));
  }
  out->resize(max_size);
  auto size = static_cast<unsigned int>(out->size());
  const int result = BZ2_bzBuffToBuffDecompress(out->data(), &size, const_cast<char*>(in.data()),
                                                static_cast<unsigned int>(in.size()), 0, 0);
  if (result == BZ_OUTBUFF_FULL) {
    return absl::DataLossError(absl::StrCat("more than ", max_size, " bytes"));
  }
  if (result != BZ_OK) {
    return DamagedStream(absl::StrCat("bzip2's error ", result));
  }
  out->resize(size);
  return absl::OkStatus();
}

// Files of xz, and streams of LZMA without its frame. Both say what their dictionary takes, which
// is bounded: 64 MiB at the highest level of xz.
absl::Status DecodeLzma(absl::string_view in, std::size_t max_size, std::string* out) {
  constexpr std::uint64_t kMaxDictionary = std::uint64_t{128} << 20;
  lzma_stream stream = LZMA_STREAM_INIT;
  if (lzma_auto_decoder(&stream, kMaxDictionary, LZMA_CONCATENATED) != LZMA_OK) {
    return absl::ResourceExhaustedError("no memory for liblzma");
  }
  const std::unique_ptr<lzma_stream, void (*)(lzma_stream*)> ends(&stream, lzma_end);
  out->resize(max_size + 1);  // a byte more shows a stream that is too long
  stream.next_in = reinterpret_cast<const std::uint8_t*>(in.data());
  stream.avail_in = in.size();
  stream.next_out = reinterpret_cast<std::uint8_t*>(out->data());
  stream.avail_out = out->size();
  const lzma_ret result = lzma_code(&stream, LZMA_FINISH);
  if (stream.avail_out == 0) {
    return absl::DataLossError(absl::StrCat("more than ", max_size, " bytes"));
  }
  if (result == LZMA_MEMLIMIT_ERROR) {
    return absl::DataLossError(absl::StrFormat("its dictionary takes %d bytes; expected at most %d",
                                               lzma_memusage(&stream), kMaxDictionary));
  }
  if (result != LZMA_STREAM_END || stream.avail_in != 0) {
    return DamagedStream(absl::StrCat("liblzma's error ", static_cast<int>(result)));
  }
  out->resize(out->size() - stream.avail_out);
  return absl::OkStatus();
}

// numcodecs writes the length in front: 4 bytes.
absl::Status DecodeLz4(absl::string_view in, std::size_t max_size, std::string* out) {
  base::Decoder decoder(in);
  std::uint32_t size = 0;
  if (!decoder.Read(&size)) {
    return DamagedStream(absl::StrCat(in.size(), " bytes without a length"));
  }
  if (size > max_size || size > static_cast<std::uint32_t>(LZ4_MAX_INPUT_SIZE) ||
      in.size() > static_cast<std::size_t>(std::numeric_limits<int>::max())) {
    return absl::DataLossError(
        absl::StrFormat("a length of %d; expected at most %d", size, max_size));
  }
  const absl::string_view block = in.substr(sizeof(size));
  out->resize(size);
  const int decoded = LZ4_decompress_safe(block.data(), out->data(), static_cast<int>(block.size()),
                                          static_cast<int>(size));
  return decoded == static_cast<int>(size) ? absl::OkStatus()
                                           : DamagedStream("the block can't be decoded");
}

absl::Status DecodeBlosc(absl::string_view in, std::size_t max_size, std::string* out) {
  if (in.size() < BLOSC_MIN_HEADER_LENGTH) {
    return DamagedStream(absl::StrCat(in.size(), " bytes without a head"));
  }
  std::size_t size = 0;
  if (blosc_cbuffer_validate(in.data(), in.size(), &size) != 0) {
    return DamagedStream("the head has sizes that make no sense");
  }
  if (size > max_size) {
    return absl::DataLossError(
        absl::StrFormat("a length of %d; expected at most %d", size, max_size));
  }
  out->resize(size);
  if (size == 0) {
    return absl::OkStatus();
  }
  const int decoded = blosc_decompress_ctx(in.data(), out->data(), out->size(), 1);
  if (decoded != static_cast<int>(size)) {
    const char* const library = blosc_cbuffer_complib(in.data());
    return DamagedStream(
        absl::StrFormat("blosc's error %d with %s (it has %s)", decoded,
                        library == nullptr ? "a compressor that it does not know" : library,
                        blosc_list_compressors()));
  }
  return absl::OkStatus();
}

class CompressorCodec final : public ChunkCodec {
 public:
  using DecodeFunction = absl::Status (*)(absl::string_view in, std::size_t max_size,
                                          std::string* out);
  CompressorCodec(DecodeFunction decode, std::int64_t max_size)
      : decode_(decode), max_size_(static_cast<std::size_t>(max_size)) {}
  [[nodiscard]] Bytes Decode(std::string encoded) const override {
    std::string out;
    absl::Status status = decode_(encoded, max_size_, &out);
    return status.ok() ? Bytes(std::move(out)) : Bytes(std::move(status));
  }
  [[nodiscard]] absl::Status DecodeInto(absl::string_view encoded,
                                        std::string* out) const override {
    return decode_(encoded, max_size_, out);
  }

 private:
  const DecodeFunction decode_;
  const std::size_t max_size_;
};

absl::Status CheckAreBytes(const ChunkData& data) {
  return data.is_array ? absl::InvalidArgumentError(
                             "encodes bytes, and no codec in front of it makes some; expected "
                             "\"bytes\" there")
                       : absl::OkStatus();
}

template <CompressorCodec::DecodeFunction decode>
absl::StatusOr<std::unique_ptr<ChunkCodec>> MakeCompressor(const ChunkJson& /*configuration*/,
                                                           ChunkData* data) {
  if (absl::Status status = CheckAreBytes(*data); !status.ok()) {
    return status;
  }
  auto codec = std::make_unique<CompressorCodec>(decode, data->size_bytes);
  data->size_bytes = MaxCompressedBytes(data->size_bytes);
  data->is_exact = false;
  return codec;
}

// Python's numbers of formats: any, xz, LZMA alone, and streams without a head.
absl::StatusOr<std::unique_ptr<ChunkCodec>> MakeLzma(const ChunkJson& configuration,
                                                     ChunkData* data) {
  const auto format = configuration.find("format");
  if (format != configuration.end() && !format->is_null() && *format != 0 && *format != 1 &&
      *format != 2) {
    return absl::InvalidArgumentError(
        "its format is none of 0, 1 and 2: a stream without a head does not tell how to decode it; "
        "write it as xz (1)");
  }
  return MakeCompressor<DecodeLzma>(configuration, data);
}

// ---- Checksums: four bytes in front or at the end. ----------------------------------------------

std::uint32_t Crc32cOf(absl::string_view bytes) { return base::Crc32c(bytes); }
std::uint32_t Crc32Of(absl::string_view bytes) {
  return static_cast<std::uint32_t>(
      crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}
std::uint32_t Adler32Of(absl::string_view bytes) {
  return static_cast<std::uint32_t>(
      adler32_z(1, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

class ChecksumCodec final : public ChunkCodec {
 public:
  using SumFunction = std::uint32_t (*)(absl::string_view bytes);
  ChecksumCodec(SumFunction sum, bool is_in_front) : sum_(sum), is_in_front_(is_in_front) {}
  [[nodiscard]] Bytes Decode(std::string encoded) const override {
    constexpr std::size_t kSize = sizeof(std::uint32_t);
    if (encoded.size() < kSize) {
      return DamagedStream(absl::StrCat(encoded.size(), " bytes without a checksum"));
    }
    const std::size_t payload = encoded.size() - kSize;
    const auto stored =
        base::LoadLittleEndian<std::uint32_t>(encoded.data() + (is_in_front_ ? 0 : payload));
    const std::uint32_t computed =
        sum_(absl::string_view(encoded).substr(is_in_front_ ? kSize : 0, payload));
    if (stored != computed) {
      return absl::DataLossError(absl::StrFormat(
          "its checksum is %08x, and that of its bytes %08x: it is damaged", stored, computed));
    }
    encoded.erase(is_in_front_ ? 0 : payload, kSize);
    return encoded;
  }

 private:
  const SumFunction sum_;
  const bool is_in_front_;
};

template <ChecksumCodec::SumFunction sum, bool is_in_front>
absl::StatusOr<std::unique_ptr<ChunkCodec>> MakeChecksum(const ChunkJson& configuration,
                                                         ChunkData* data) {
  if (absl::Status status = CheckAreBytes(*data); !status.ok()) {
    return status;
  }
  const auto location = configuration.find("location");
  bool starts = is_in_front;
  if (location != configuration.end() && !location->is_null()) {
    if (*location != "start" && *location != "end") {
      return absl::InvalidArgumentError("its location is neither \"start\" nor \"end\"");
    }
    starts = *location == "start";
  }
  data->size_bytes += 4;
  return std::make_unique<ChecksumCodec>(sum, starts);
}

// HDF5's: sums of 16-bit words, big-endian, in ones' complement. The last word ends with a zero byte
// if the number of bytes is odd.
std::uint32_t Fletcher32Of(absl::string_view bytes) {
  constexpr std::size_t kWordsBetweenFolds = 360;  // the sums stay below 2^32
  const auto fold = [](std::uint32_t sum) { return (sum & 0xffffU) + (sum >> 16); };
  std::uint32_t first = 0;
  std::uint32_t second = 0;
  std::size_t words = 0;
  for (std::size_t i = 0; i < bytes.size(); i += 2) {
    const auto high = static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[i]));
    const std::uint32_t low = i + 1 < bytes.size() ? static_cast<unsigned char>(bytes[i + 1]) : 0U;
    first += high << 8 | low;
    second += first;
    if (++words % kWordsBetweenFolds == 0 || i + 2 >= bytes.size()) {
      first = fold(first);
      second = fold(second);
    }
  }
  first = fold(first);
  second = fold(second);
  return second << 16 | first;
}

// ---- Shuffle: the first bytes of all elements, then the second ones, ... ------------------------

class ShuffleCodec final : public ChunkCodec {
 public:
  explicit ShuffleCodec(std::size_t element_size) : element_size_(element_size) {}
  [[nodiscard]] Bytes Decode(std::string encoded) const override {
    if (encoded.size() % element_size_ != 0) {
      return absl::DataLossError(
          absl::StrFormat("%d bytes are no elements of %d", encoded.size(), element_size_));
    }
    const std::size_t count = encoded.size() / element_size_;
    std::string out(encoded.size(), '\0');
    for (std::size_t byte = 0; byte < element_size_; ++byte) {
      const char* const in = encoded.data() + byte * count;
      for (std::size_t i = 0; i < count; ++i) {
        out[i * element_size_ + byte] = in[i];
      }
    }
    return out;
  }

 private:
  const std::size_t element_size_;
};

absl::StatusOr<std::unique_ptr<ChunkCodec>> MakeShuffle(const ChunkJson& configuration,
                                                        ChunkData* data) {
  if (absl::Status status = CheckAreBytes(*data); !status.ok()) {
    return status;
  }
  constexpr std::int64_t kMaxElement = 256;
  constexpr std::int64_t kDefault = 4;
  const auto found = configuration.find("elementsize");
  const bool is_given = found != configuration.end();
  if (is_given && (!found->is_number_integer() || *found < 1 || *found > kMaxElement)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("its elementsize is no integer from 1 to %d", kMaxElement));
  }
  return std::make_unique<ShuffleCodec>(
      static_cast<std::size_t>(is_given ? found->get<std::int64_t>() : kDefault));
}

// ---- Bits: 8 to a byte, the highest one first; in front a byte with the number of unused ones. ---

class PackBitsCodec final : public ChunkCodec {
 public:
  explicit PackBitsCodec(std::size_t count) : count_(count) {}
  [[nodiscard]] Bytes Decode(std::string encoded) const override {
    const std::size_t unused = (8 - count_ % 8) % 8;
    if (static_cast<unsigned char>(encoded[0]) != unused) {
      return DamagedStream(absl::StrFormat("%d bits are unused; expected %d",
                                           static_cast<unsigned char>(encoded[0]), unused));
    }
    std::string out(count_, '\0');
    for (std::size_t i = 0; i < count_; ++i) {
      const auto byte = static_cast<unsigned char>(encoded[1 + i / 8]);
      out[i] = static_cast<char>(byte >> (7 - i % 8) & 1U);
    }
    return out;
  }

 private:
  const std::size_t count_;  // of bools
};

absl::StatusOr<std::unique_ptr<ChunkCodec>> MakePackBits(const ChunkJson& /*configuration*/,
                                                         ChunkData* data) {
  if (data->is_array) {  // Zarr 3 has another one of this name
    return absl::InvalidArgumentError("it is read as a filter of Zarr 2 alone");
  }
  if (data->type != NumberType::kBool || !data->is_exact) {
    return absl::InvalidArgumentError("it encodes bool alone");
  }
  const std::int64_t count = data->size_bytes;
  data->size_bytes = 1 + count / 8 + (count % 8 == 0 ? 0 : 1);
  return std::make_unique<PackBitsCodec>(static_cast<std::size_t>(count));
}

}  // namespace

absl::Span<const CodecRow> ByteCodecs() {
  constexpr int kZlib = 15;
  constexpr int kGzip = 15 + 16;
  static constexpr CodecRow kRows[] = {
      {"adler32", MakeChecksum<Adler32Of, true>},
      {"blosc", MakeCompressor<DecodeBlosc>},
      {"bz2", MakeCompressor<DecodeBz2>},
      {"crc32", MakeChecksum<Crc32Of, true>},
      {"crc32c", MakeChecksum<Crc32cOf, false>},
      {"fletcher32", MakeChecksum<Fletcher32Of, false>},
      {"gzip", MakeCompressor<InflateChunk<kGzip>>},
      {"lz4", MakeCompressor<DecodeLz4>},
      {"lzma", MakeLzma},
      {"packbits", MakePackBits},
      {"shuffle", MakeShuffle},
      {"zlib", MakeCompressor<InflateChunk<kZlib>>},
      {"zstd", MakeCompressor<DecodeZstd>},
  };
  return kRows;
}

}  // namespace isoscope::source
