// DecodePng is libpng's, which reports errors by longjmp. So functions that call setjmp, and
// callbacks, own nothing that has a destructor; their callers do.

#include <png.h>

#include <array>
#include <csetjmp>
#include <cstddef>
#include <cstring>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/image/png_codec.h"

namespace isoscope::image {
namespace {

static_assert(sizeof(Rgba8) == 4, "libpng writes rows into the pixels");

struct ErrorText {
  std::array<char, 200> text{};
};

[[noreturn]] void OnError(png_structp png, png_const_charp message) {
  auto* error = static_cast<ErrorText*>(png_get_error_ptr(png));
  std::strncpy(error->text.data(), message, error->text.size() - 1);
  png_longjmp(png, 1);
}

void OnWarning(png_structp /*png*/, png_const_charp /*message*/) {}

struct PngBytes {
  const char* data = nullptr;
  std::size_t size = 0;
  std::size_t position = 0;
};

void ReadFromBytes(png_structp png, png_bytep data, std::size_t size) {
  auto* in = static_cast<PngBytes*>(png_get_io_ptr(png));
  if (size > in->size - in->position) {
    png_error(png, "the bytes end too early");
  }
  std::memcpy(data, in->data + in->position, size);
  in->position += size;
}

struct Header {
  png_uint_32 width = 0;
  png_uint_32 height = 0;
  std::size_t raw_row_bytes = 0;  // as stored
  std::size_t row_bytes = 0;      // as delivered
};

bool ReadHeader(png_structp png, png_infop info, Header* header) {
  if (setjmp(png_jmpbuf(png)) != 0) {  // NOLINT(cert-err52-cpp): libpng's way
    return false;
  }
  png_set_user_limits(png, kMaxPngSidePx, kMaxPngSidePx);
  png_set_chunk_malloc_max(png, 1 << 20);
  png_set_chunk_cache_max(png, 16);
  png_set_crc_action(png, PNG_CRC_ERROR_QUIT, PNG_CRC_ERROR_QUIT);
  png_set_benign_errors(png, 0);
  png_read_info(png, info);
  header->width = png_get_image_width(png, info);
  header->height = png_get_image_height(png, info);
  header->raw_row_bytes = png_get_rowbytes(png, info);
  png_set_expand(png);
  png_set_scale_16(png);
  png_set_gray_to_rgb(png);
  png_set_add_alpha(png, 0xff, PNG_FILLER_AFTER);
  png_set_interlace_handling(png);
  png_read_update_info(png, info);
  header->row_bytes = png_get_rowbytes(png, info);
  return true;
}

bool ReadRows(png_structp png, png_infop info, png_bytep* rows) {
  if (setjmp(png_jmpbuf(png)) != 0) {  // NOLINT(cert-err52-cpp): libpng's way
    return false;
  }
  png_read_image(png, rows);
  png_read_end(png, info);
  return true;
}

// Owns libpng's reading structs.
struct Reader {
  Reader() = default;
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
  ~Reader() { png_destroy_read_struct(&png, &info, nullptr); }

  ErrorText error;
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &error, OnError, OnWarning);
  png_infop info = png != nullptr ? png_create_info_struct(png) : nullptr;
};

absl::Status Damaged(const Reader& reader, const PngBytes& in) {
  return absl::DataLossError(absl::StrCat("PNG of ", in.size, " bytes, near byte ", in.position,
                                          ": ", reader.error.text.data(),
                                          "; expected a complete PNG"));
}

}  // namespace

absl::StatusOr<RgbaImage> DecodePng(absl::string_view png) {
  PngBytes in{.data = png.data(), .size = png.size()};
  Reader reader;
  ISOSCOPE_CHECK(reader.info != nullptr);
  png_set_read_fn(reader.png, &in, ReadFromBytes);
  Header header;
  if (!ReadHeader(reader.png, reader.info, &header)) {
    return Damaged(reader, in);
  }
  // Deflate makes at most 1032 bytes from one. A header that claims more is refused before memory
  // is allocated.
  constexpr std::size_t kMaxDeflateRatio = 1032;
  if (header.raw_row_bytes * header.height / kMaxDeflateRatio > png.size()) {
    return absl::DataLossError(absl::StrCat(
        "PNG of ", png.size(), " bytes claims ", header.width, " x ", header.height,
        " pixels; at most ", kMaxDeflateRatio * png.size(), " bytes of pixels fit in so few"));
  }
  RgbaImage image;
  image.width = static_cast<int>(header.width);
  image.height = static_cast<int>(header.height);
  ISOSCOPE_CHECK_EQ(header.row_bytes, std::size_t{header.width} * sizeof(Rgba8));
  image.pixels.resize(std::size_t{header.width} * header.height);
  std::vector<png_bytep> rows(header.height);
  for (std::size_t y = 0; y < rows.size(); ++y) {
    rows[y] = reinterpret_cast<png_bytep>(image.pixels.data() + y * header.width);
  }
  if (!ReadRows(reader.png, reader.info, rows.data())) {
    return Damaged(reader, in);
  }
  return image;
}

}  // namespace isoscope::image
