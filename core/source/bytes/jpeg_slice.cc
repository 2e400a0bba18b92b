// A JP2 file is a row of boxes, one of which holds the codestream; numbers are big-endian:
//
//   length:32 kind:32 [length:64, if the first is 1] data      length 0: up to the end of the file
//
// The codestream (HasAllTiles):
//
//   ff4f                                           start
//   ff51 length:16 ability:16 right:32 bottom:32 left:32 top:32
//        width:32 height:32 x:32 y:32 ...          size of the image; size and place of tiles
//   ffxx length:16 data                            other segments of the header; 30 to 3f alone
//   ff90 10:16 tile:16 length:32 part:8 parts:8    part of a tile; `length` counts from ff90 on, 0:
//        data                                      up to the end; `parts` is 0 if it is not known
//   ffd9                                           end
//
// OpenJPEG reads from memory through three functions (ByteStream).

#include "core/source/bytes/jpeg_slice.h"

#include <openjpeg.h>
#include <sched.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <map>
#include <memory>

#include "absl/strings/ascii.h"
#include "absl/strings/str_format.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/image/jpeg_codec.h"
#include "core/io/file.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxFileBytes = 4 * base::kGiB;
constexpr std::uint64_t kStart = 0xff4fff51;  // and the size of the image

// The number of `size` bytes at `at`; 0 if they are not there.
std::uint64_t NumberAt(absl::string_view bytes, std::size_t at, std::size_t size) {
  if (at > bytes.size() || size > bytes.size() - at) {
    return 0;
  }
  std::uint64_t number = 0;
  for (const char byte : bytes.substr(at, size)) {
    number = number << 8 | static_cast<unsigned char>(byte);
  }
  return number;
}

// The codestream alone or in a file of boxes; empty if there is none.
absl::string_view CodestreamIn(absl::string_view bytes) {
  constexpr std::uint64_t kCodestreamBox = 0x6a703263;  // "jp2c"
  if (NumberAt(bytes, 0, 4) == kStart) {
    return bytes;
  }
  while (bytes.size() >= 8) {
    const std::uint64_t kind = NumberAt(bytes, 4, 4);
    const std::uint64_t short_length = NumberAt(bytes, 0, 4);
    const std::uint64_t head = short_length == 1 ? 16 : 8;
    const std::uint64_t length = short_length == 1   ? NumberAt(bytes, 8, 8)
                                 : short_length == 0 ? bytes.size()
                                                     : short_length;
    if (length < head) {
      return {};
    }
    if (kind == kCodestreamBox) {
      return bytes.substr(std::min(head, bytes.size()), length - head);  // or what there is of it
    }
    if (length > bytes.size()) {
      return {};
    }
    bytes.remove_prefix(length);
  }
  return {};
}

// 0 if the size of the image is not there, or is none.
std::uint64_t TileCount(absl::string_view codestream) {
  constexpr std::size_t kSizes = 8;
  const auto along = [&](std::size_t axis) -> std::uint64_t {
    const std::uint64_t end = NumberAt(codestream, kSizes + 4 * axis, 4);
    const std::uint64_t tile = NumberAt(codestream, kSizes + 16 + 4 * axis, 4);
    const std::uint64_t begin = NumberAt(codestream, kSizes + 24 + 4 * axis, 4);
    return tile == 0 || begin >= end ? 0 : (end - begin + tile - 1) / tile;
  };
  return NumberAt(codestream, 0, 4) == kStart ? along(0) * along(1) : 0;
}

struct TileParts {
  std::uint64_t found = 0;
  std::uint64_t expected = 0;  // 0: not known
};

// ---- OpenJPEG. ----------------------------------------------------------------------------------

struct ByteStream {
  absl::string_view bytes;
  std::size_t at = 0;
};

OPJ_SIZE_T ReadBytes(void* out, OPJ_SIZE_T size, void* user_data) {
  auto* stream = static_cast<ByteStream*>(user_data);
  const std::size_t count = std::min(size, stream->bytes.size() - stream->at);
  if (count == 0) {
    return static_cast<OPJ_SIZE_T>(-1);
  }
  std::memcpy(out, stream->bytes.data() + stream->at, count);
  stream->at += count;
  return count;
}

OPJ_BOOL SeekByte(OPJ_OFF_T at, void* user_data) {
  auto* stream = static_cast<ByteStream*>(user_data);
  if (at < 0 || static_cast<std::size_t>(at) > stream->bytes.size()) {
    return OPJ_FALSE;
  }
  stream->at = static_cast<std::size_t>(at);
  return OPJ_TRUE;
}

OPJ_OFF_T SkipBytes(OPJ_OFF_T count, void* user_data) {
  const auto* stream = static_cast<ByteStream*>(user_data);
  const auto left = static_cast<OPJ_OFF_T>(stream->bytes.size() - stream->at);
  const OPJ_OFF_T skipped = std::min(count, left);
  return SeekByte(static_cast<OPJ_OFF_T>(stream->at) + skipped, user_data) != 0 ? skipped : -1;
}

void KeepMessage(const char* text, void* user_data) {
  *static_cast<std::string*>(user_data) = base::Printable(absl::StripAsciiWhitespace(text));
}

// Threads that decode blocks of samples. Each takes address space, of which the process has little.
int DecodingThreads() {
  constexpr int kMaxThreads = 8;
  cpu_set_t processors;
  return sched_getaffinity(0, sizeof(processors), &processors) == 0
             ? std::clamp(CPU_COUNT(&processors), 1, kMaxThreads)
             : 1;
}

struct CodecDeleter {
  void operator()(opj_codec_t* codec) const { opj_destroy_codec(codec); }
};
struct StreamDeleter {
  void operator()(opj_stream_t* stream) const { opj_stream_destroy(stream); }
};
struct ImageDeleter {
  void operator()(opj_image_t* image) const { opj_image_destroy(image); }
};

absl::Status NotReadable(const std::string& path, const std::string& message) {
  return absl::DataLossError(
      absl::StrFormat("%s: can't be read as JPEG 2000, the file may be cut%s", path,
                      message.empty() ? "" : absl::StrCat(": ", message)));
}

absl::StatusOr<SliceImage> HeaderOf(const opj_image_t& image, const std::string& path) {
  if (image.numcomps != 1) {
    return ColourSliceError(path);
  }
  const opj_image_comp_t& samples = image.comps[0];
  if (samples.prec < 1 || samples.prec > 16) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: samples of %d bits; expected 1 to 16", path, samples.prec));
  }
  if (samples.w < 1 || samples.h < 1 || samples.w > kMaxSliceSamples ||
      samples.h > kMaxSliceSamples) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d x %d samples; expected at most %d along each axis", path, samples.w,
                        samples.h, kMaxSliceSamples));
  }
  using volume::ScalarType;
  return SliceImage{.width = samples.w,
                    .height = samples.h,
                    .type = samples.prec <= 8
                                ? (samples.sgnd != 0 ? ScalarType::kInt8 : ScalarType::kUint8)
                                : (samples.sgnd != 0 ? ScalarType::kInt16 : ScalarType::kUint16),
                    .bits = samples.prec};
}

template <typename T>
void CopySamples(const OPJ_INT32* from, std::string* to) {
  for (std::size_t at = 0; at < to->size(); at += sizeof(T)) {
    const auto sample = static_cast<T>(*from++);
    std::memcpy(to->data() + at, &sample, sizeof(T));
  }
}

}  // namespace

absl::StatusOr<SliceImage> ReadJpegSlice(const std::string& path, SlicePart part) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes, io::ReadWholeFile(path, kMaxFileBytes));
  const absl::StatusOr<image::RgbaImage> decoded = image::DecodeJpeg(bytes);
  if (!decoded.ok()) {
    return absl::Status(decoded.status().code(),
                        absl::StrCat(path, ": ", decoded.status().message()));
  }
  SliceImage slice{.width = decoded->width, .height = decoded->height};
  slice.samples.reserve(decoded->pixels.size());
  for (const image::Rgba8& pixel : decoded->pixels) {
    if (pixel.g != pixel.r || pixel.b != pixel.r) {
      return ColourSliceError(path);
    }
    slice.samples.push_back(static_cast<char>(pixel.r));
  }
  if (part == SlicePart::kHeader) {
    slice.samples.clear();
  }
  return slice;
}

bool HasAllTiles(absl::string_view bytes) {
  constexpr std::uint64_t kTilePart = 0xff90;
  constexpr std::uint64_t kEnd = 0xffd9;
  constexpr std::uint64_t kLeastPart = 14;  // its own segment, and the start of data
  const absl::string_view codestream = CodestreamIn(bytes);
  const std::uint64_t tile_count = TileCount(codestream);
  std::map<std::uint64_t, TileParts> tiles;
  std::size_t at = 2;
  while (NumberAt(codestream, at, 2) != kEnd) {
    const std::uint64_t marker = NumberAt(codestream, at, 2);
    if (marker >> 8 != 0xff) {
      return false;
    }
    if (marker != kTilePart) {
      const bool has_length = marker < 0xff30 || marker > 0xff3f;
      at += has_length ? 2 + std::max<std::uint64_t>(NumberAt(codestream, at + 2, 2), 2) : 2;
      continue;
    }
    TileParts& tile = tiles[NumberAt(codestream, at + 4, 2)];
    ++tile.found;
    tile.expected = std::max(tile.expected, NumberAt(codestream, at + 11, 1));
    const std::uint64_t length = NumberAt(codestream, at + 6, 4);
    at = length == 0 ? std::max(at + kLeastPart, codestream.size() - 2)
                     : at + std::max(length, kLeastPart);
  }
  return tile_count > 0 && tiles.size() == tile_count && tiles.rbegin()->first < tile_count &&
         std::all_of(tiles.begin(), tiles.end(),
                     [](const auto& tile) { return tile.second.found >= tile.second.expected; });
}

absl::StatusOr<SliceImage> ReadJpeg2000Slice(const std::string& path, SlicePart part) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes, io::ReadWholeFile(path, kMaxFileBytes));
  return DecodeJpeg2000(bytes, path, part);
}

absl::StatusOr<SliceImage> DecodeJpeg2000(absl::string_view bytes, const std::string& path,
                                          SlicePart part) {
  if (!HasAllTiles(bytes)) {
    return NotReadable(
        path, absl::StrCat("its ", bytes.size(), " bytes do not have all tiles and the end"));
  }
  const bool is_alone = NumberAt(bytes, 0, 4) == kStart;
  const std::unique_ptr<opj_codec_t, CodecDeleter> codec(
      opj_create_decompress(is_alone ? OPJ_CODEC_J2K : OPJ_CODEC_JP2));
  const std::unique_ptr<opj_stream_t, StreamDeleter> stream(
      opj_stream_create(std::size_t{1} << 20, OPJ_TRUE));
  opj_dparameters_t parameters;
  opj_set_default_decoder_parameters(&parameters);
  if (codec == nullptr || stream == nullptr ||
      opj_setup_decoder(codec.get(), &parameters) == OPJ_FALSE) {
    return absl::ResourceExhaustedError(absl::StrCat(path, ": no memory for OpenJPEG"));
  }
  static_cast<void>(opj_codec_set_threads(codec.get(), DecodingThreads()));  // else it is slower
  std::string message;
  opj_set_error_handler(codec.get(), KeepMessage, &message);
  ByteStream byte_stream{.bytes = bytes};
  opj_stream_set_read_function(stream.get(), ReadBytes);
  opj_stream_set_skip_function(stream.get(), SkipBytes);
  opj_stream_set_seek_function(stream.get(), SeekByte);
  opj_stream_set_user_data(stream.get(), &byte_stream, nullptr);
  opj_stream_set_user_data_length(stream.get(), bytes.size());
  opj_image_t* read = nullptr;
  const bool has_header = opj_read_header(stream.get(), codec.get(), &read) != OPJ_FALSE;
  const std::unique_ptr<opj_image_t, ImageDeleter> image(read);
  if (!has_header) {
    return NotReadable(path, message);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(SliceImage slice, HeaderOf(*image, path));
  if (part == SlicePart::kHeader) {
    return slice;
  }
  if (opj_decode(codec.get(), stream.get(), image.get()) == OPJ_FALSE ||
      opj_end_decompress(codec.get(), stream.get()) == OPJ_FALSE) {
    return NotReadable(path, message);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(slice, HeaderOf(*image, path));  // a palette makes colours of samples
  const OPJ_INT32* const samples = image->comps[0].data;
  if (samples == nullptr) {
    return NotReadable(path, message);
  }
  slice.samples.resize(static_cast<std::size_t>(slice.width * slice.height) *
                       volume::SizeOf(slice.type));
  if (volume::SizeOf(slice.type) == 1) {
    CopySamples<std::uint8_t>(samples, &slice.samples);
  } else {
    CopySamples<std::uint16_t>(samples, &slice.samples);
  }
  return slice;
}

}  // namespace isoscope::source
