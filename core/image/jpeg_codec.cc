// Encoding and decoding by libjpeg-turbo, row by row:
//
// 1. Set up the state of libjpeg, and read or write the header (StartDecoding, State::Start).
// 2. Convert each row between RGBA and the three bytes a pixel of libjpeg.
// 3. Destroy the state. A warning while decoding counts as an error.
//
// Invariant: libjpeg reports errors by longjmp, which skips destructors. So functions that call
// setjmp own nothing that has a destructor, nor do those that they call; their callers do.
//
// libjpeg keeps the 8 rows of its row of blocks, and its Huffman codes are fixed. So the bytes do
// not depend on how rows are shared among calls, and those of earlier rows are complete.

#include "core/image/jpeg_codec.h"

#include <cstdio>
// jpeglib.h needs cstdio's FILE.
#include <jpeglib.h>
// jerror.h needs jpeglib.h.
#include <jerror.h>

#include <array>
#include <csetjmp>
#include <cstddef>
#include <new>
#include <utility>
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

// Where libjpeg writes to: a buffer that is moved to a string whenever it is full.
struct Destination {
  jpeg_destination_mgr base;  // first, as in ErrorManager
  std::array<JOCTET, std::size_t{16} * 1024> buffer;
  std::string bytes;
};

void StartBuffer(Destination* destination) {
  destination->base.next_output_byte = destination->buffer.data();
  destination->base.free_in_buffer = destination->buffer.size();
}

// Moves the first `size` bytes of the buffer to the string. False if there is no memory for them.
bool TakeBuffer(std::size_t size, Destination* destination) {
  try {
    destination->bytes.append(reinterpret_cast<const char*>(destination->buffer.data()), size);
  } catch (const std::bad_alloc&) {
    return false;
  }
  StartBuffer(destination);
  return true;
}

void OnStart(j_compress_ptr info) { StartBuffer(reinterpret_cast<Destination*>(info->dest)); }

boolean OnFullBuffer(j_compress_ptr info) {
  auto* const destination = reinterpret_cast<Destination*>(info->dest);
  if (!TakeBuffer(destination->buffer.size(), destination)) {
    ERREXIT1(info, JERR_OUT_OF_MEMORY, 0);
  }
  return TRUE;
}

void OnEnd(j_compress_ptr info) {
  auto* const destination = reinterpret_cast<Destination*>(info->dest);
  if (!TakeBuffer(destination->buffer.size() - destination->base.free_in_buffer, destination)) {
    ERREXIT1(info, JERR_OUT_OF_MEMORY, 0);
  }
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

// What libjpeg knows of a picture that is written, and its memory.
struct JpegRowWriter::State {
  State() = default;
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() { jpeg_destroy_compress(&info); }

  [[nodiscard]] absl::Status error() const {
    return absl::ResourceExhaustedError(
        absl::StrCat("JPEG of ", width, " x ", height, " pixels: ", errors.text.data()));
  }
  // Starts the picture. Errors jump.
  void Start();
  // Writes rows, and the end of the file after the last one. Errors jump: inlined, its variables
  // would be undefined in TryWrite.
  [[gnu::noinline]] void Write(const Rgba8* pixels, int count);
  // False if an error has come.
  bool TryWrite(const Rgba8* pixels, int count);

  int width = 0;
  int height = 0;
  Rgba8 background;
  int quality = 0;
  int row_count = 0;         // appended
  bool has_failed = false;   // libjpeg takes nothing more
  std::vector<JSAMPLE> row;  // three bytes a pixel
  jpeg_compress_struct info{};
  ErrorManager errors{};
  Destination destination{};
};

void JpegRowWriter::State::Start() {
  jpeg_create_compress(&info);
  destination.base.init_destination = OnStart;
  destination.base.empty_output_buffer = OnFullBuffer;
  destination.base.term_destination = OnEnd;
  info.dest = &destination.base;
  info.image_width = static_cast<JDIMENSION>(width);
  info.image_height = static_cast<JDIMENSION>(height);
  info.input_components = 3;
  info.in_color_space = JCS_RGB;
  jpeg_set_defaults(&info);
  jpeg_set_quality(&info, quality, TRUE);
  info.comp_info[0].h_samp_factor = 1;
  info.comp_info[0].v_samp_factor = 1;
  info.dct_method = JDCT_ISLOW;
  jpeg_start_compress(&info, TRUE);
}

void JpegRowWriter::State::Write(const Rgba8* pixels, int count) {
  if (row_count == 0) {
    Start();
  }
  const Rgba8* from = pixels;
  for (int y = 0; y < count; ++y) {
    JSAMPLE* to = row.data();
    for (int x = 0; x < width; ++x, ++from) {
      const Rgba8& pixel = from->a == 0 ? background : *from;
      *to++ = pixel.r;
      *to++ = pixel.g;
      *to++ = pixel.b;
    }
    JSAMPLE* samples = row.data();
    jpeg_write_scanlines(&info, &samples, 1);
  }
  if (info.next_scanline == info.image_height) {
    jpeg_finish_compress(&info);
  }
}

bool JpegRowWriter::State::TryWrite(const Rgba8* pixels, int count) {
  if (setjmp(errors.jump) != 0) {  // NOLINT(cert-err52-cpp): libjpeg's way
    return false;
  }
  Write(pixels, count);
  return true;
}

JpegRowWriter::JpegRowWriter(int width, int height, Rgba8 background, int quality)
    : state_(std::make_unique<State>()) {
  ISOSCOPE_CHECK_GE(width, 1);
  ISOSCOPE_CHECK_GE(height, 1);
  ISOSCOPE_CHECK_GE(quality, 1);
  ISOSCOPE_CHECK_LE(quality, 100);
  state_->width = width;
  state_->height = height;
  state_->background = background;
  state_->quality = quality;
  state_->row.resize(static_cast<std::size_t>(width) * 3);
  state_->info.err = jpeg_std_error(&state_->errors.base);
  state_->errors.base.error_exit = OnError;
  state_->errors.base.output_message = OnMessage;
}

JpegRowWriter::JpegRowWriter(JpegRowWriter&& other) noexcept = default;
JpegRowWriter& JpegRowWriter::operator=(JpegRowWriter&& other) noexcept = default;
JpegRowWriter::~JpegRowWriter() = default;

absl::StatusOr<std::string> JpegRowWriter::Append(std::span<const Rgba8> rows) {
  const auto row_size = static_cast<std::size_t>(state_->width);
  ISOSCOPE_CHECK_EQ(rows.size() % row_size, 0U);
  const std::size_t count = rows.size() / row_size;
  ISOSCOPE_CHECK_LE(count, static_cast<std::size_t>(state_->height - state_->row_count));
  if (state_->has_failed) {
    return state_->error();
  }
  if (count > 0 && !state_->TryWrite(rows.data(), static_cast<int>(count))) {
    state_->has_failed = true;
    return state_->error();
  }
  state_->row_count += static_cast<int>(count);
  return std::exchange(state_->destination.bytes, std::string());
}

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
  JpegRowWriter writer(width, height, background, quality);
  ISOSCOPE_CHECK_EQ(pixels.size(),
                    static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  return writer.Append(pixels);
}

}  // namespace isoscope::image
