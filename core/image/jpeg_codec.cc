// Encoding and decoding by libjpeg-turbo, row by row:
//
// 1. Set up the state of libjpeg, and read or write the header (StartDecoding).
// 2. Convert each row between RGBA and the three bytes a pixel of libjpeg.
// 3. Destroy the state. A warning while decoding counts as an error.
//
// Invariant: libjpeg reports errors by longjmp, which skips destructors. So functions that call
// setjmp own nothing that has a destructor; their callers do.

#include "core/image/jpeg_codec.h"

#include <cstdio>
// jpeglib.h needs cstdio's FILE.
#include <jpeglib.h>

#include <array>
#include <csetjmp>
#include <cstddef>
#include <cstdlib>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

#include "core/base/check.h"

namespace isoscope::image {
namespace {

struct ErrorManager {
  jpeg_error_mgr base;  // first, so that libjpeg's pointer to it is one to this
  std::jmp_buf jump;
  std::array<char, JMSG_LENGTH_MAX> text;
};

[[noreturn]] void OnError(j_common_ptr info) {
  auto* manager = reinterpret_cast<ErrorManager*>(info->err);
  manager->base.format_message(info, manager->text.data());
  std::longjmp(manager->jump, 1);  // NOLINT(cert-err52-cpp): libjpeg's way
}

void OnMessage(j_common_ptr /*info*/) {}

// The memory that libjpeg writes to, and its state.
struct Encoder {
  Encoder() = default;
  Encoder(const Encoder&) = delete;
  Encoder& operator=(const Encoder&) = delete;
  ~Encoder() {
    jpeg_destroy_compress(&info);
    std::free(bytes);  // NOLINT(cppcoreguidelines-no-malloc): jpeg_mem_dest took it by malloc
  }

  jpeg_compress_struct info{};
  ErrorManager errors{};
  unsigned char* bytes = nullptr;
  unsigned long size = 0;  // NOLINT(google-runtime-int): libjpeg's type
};

struct Picture {
  int width = 0;
  int height = 0;
  const Rgba8* pixels = nullptr;
  Rgba8 background;
  int quality = 0;
};

// `row` has room for three bytes a pixel.
bool Encode(const Picture& picture, JSAMPLE* row, Encoder* encoder) {
  jpeg_compress_struct& info = encoder->info;
  info.err = jpeg_std_error(&encoder->errors.base);
  encoder->errors.base.error_exit = OnError;
  encoder->errors.base.output_message = OnMessage;
  if (setjmp(encoder->errors.jump) != 0) {  // NOLINT(cert-err52-cpp): libjpeg's way
    return false;
  }
  jpeg_create_compress(&info);
  jpeg_mem_dest(&info, &encoder->bytes, &encoder->size);
  info.image_width = static_cast<JDIMENSION>(picture.width);
  info.image_height = static_cast<JDIMENSION>(picture.height);
  info.input_components = 3;
  info.in_color_space = JCS_RGB;
  jpeg_set_defaults(&info);
  jpeg_set_quality(&info, picture.quality, TRUE);
  info.comp_info[0].h_samp_factor = 1;
  info.comp_info[0].v_samp_factor = 1;
  info.dct_method = JDCT_ISLOW;
  jpeg_start_compress(&info, TRUE);
  const Rgba8* from = picture.pixels;
  while (info.next_scanline < info.image_height) {
    JSAMPLE* to = row;
    for (int x = 0; x < picture.width; ++x, ++from) {
      const Rgba8& pixel = from->a == 0 ? picture.background : *from;
      *to++ = pixel.r;
      *to++ = pixel.g;
      *to++ = pixel.b;
    }
    jpeg_write_scanlines(&info, &row, 1);
  }
  jpeg_finish_compress(&info);
  return true;
}

// The state of libjpeg while it reads.
struct Decoder {
  Decoder() = default;
  Decoder(const Decoder&) = delete;
  Decoder& operator=(const Decoder&) = delete;
  ~Decoder() { jpeg_destroy_decompress(&info); }

  jpeg_decompress_struct info{};
  ErrorManager errors{};
};

// A warning means missing or wrong bytes, in whose place libjpeg would decode grey.
void OnDecoderMessage(j_common_ptr info, int level) {
  if (level < 0) {
    OnError(info);
  }
}

// Reads the sizes of the picture.
bool StartDecoding(absl::string_view jpeg, Decoder* decoder) {
  jpeg_decompress_struct& info = decoder->info;
  info.err = jpeg_std_error(&decoder->errors.base);
  decoder->errors.base.error_exit = OnError;
  decoder->errors.base.output_message = OnMessage;
  decoder->errors.base.emit_message = OnDecoderMessage;
  if (setjmp(decoder->errors.jump) != 0) {  // NOLINT(cert-err52-cpp): libjpeg's way
    return false;
  }
  jpeg_create_decompress(&info);
  jpeg_mem_src(&info, reinterpret_cast<const unsigned char*>(jpeg.data()), jpeg.size());
  jpeg_read_header(&info, TRUE);
  info.out_color_space = JCS_RGB;
  return true;
}

// Reads the pixels. `row` has room for three bytes a pixel, `to` for all pixels.
bool DecodeRows(Decoder* decoder, JSAMPLE* row, Rgba8* to) {
  jpeg_decompress_struct& info = decoder->info;
  if (setjmp(decoder->errors.jump) != 0) {  // NOLINT(cert-err52-cpp): libjpeg's way
    return false;
  }
  jpeg_start_decompress(&info);
  while (info.output_scanline < info.output_height) {
    Rgba8* const pixels = to + std::size_t{info.output_scanline} * info.output_width;
    jpeg_read_scanlines(&info, &row, 1);
    for (std::size_t x = 0; x < info.output_width; ++x) {
      pixels[x] = {row[3 * x], row[3 * x + 1], row[3 * x + 2], 255};
    }
  }
  jpeg_finish_decompress(&info);
  return true;
}

}  // namespace

absl::StatusOr<RgbaImage> DecodeJpeg(absl::string_view jpeg) {
  Decoder decoder;
  const auto error = [&decoder] {
    return absl::DataLossError(absl::StrCat("no readable JPEG: ", decoder.errors.text.data()));
  };
  if (jpeg.empty()) {
    return absl::DataLossError("no readable JPEG: it is empty");
  }
  if (!StartDecoding(jpeg, &decoder)) {
    return error();
  }
  constexpr JDIMENSION kMaxSide = kMaxPngSidePx;
  const JDIMENSION width = decoder.info.image_width;
  const JDIMENSION height = decoder.info.image_height;
  if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide) {
    return absl::DataLossError(
        absl::StrCat("a JPEG of ", width, " x ", height, " pixels: sides are at most ", kMaxSide));
  }
  RgbaImage image{
      .width = static_cast<int>(width), .height = static_cast<int>(height), .pixels = {}};
  image.pixels.resize(std::size_t{width} * height);
  std::vector<JSAMPLE> row(std::size_t{width} * 3);
  if (!DecodeRows(&decoder, row.data(), image.pixels.data())) {
    return error();
  }
  return image;
}

absl::StatusOr<std::string> EncodeJpeg(int width, int height, std::span<const Rgba8> pixels,
                                       Rgba8 background, int quality) {
  ISOSCOPE_CHECK_GE(width, 1);
  ISOSCOPE_CHECK_GE(height, 1);
  ISOSCOPE_CHECK_EQ(pixels.size(),
                    static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  ISOSCOPE_CHECK_GE(quality, 1);
  ISOSCOPE_CHECK_LE(quality, 100);
  std::vector<JSAMPLE> row(static_cast<std::size_t>(width) * 3);
  Encoder encoder;
  const Picture picture{.width = width,
                        .height = height,
                        .pixels = pixels.data(),
                        .background = background,
                        .quality = quality};
  if (!Encode(picture, row.data(), &encoder)) {
    return absl::ResourceExhaustedError(
        absl::StrCat("JPEG of ", width, " x ", height, " pixels: ", encoder.errors.text.data()));
  }
  return std::string(reinterpret_cast<const char*>(encoder.bytes), encoder.size);
}

}  // namespace isoscope::image
