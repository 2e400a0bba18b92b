// libpng reports errors by a jump to the frame that called setjmp. Frames in between hold nothing
// that needs a destructor: what does lives in PngReader, outside of them.

#include "core/formats/stacks/png_slice.h"

#include <png.h>

#include <csetjmp>
#include <cstddef>
#include <cstdio>
#include <memory>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {
namespace {

class PngReader {
 public:
  explicit PngReader(const std::string& path)
      : file_(std::fopen(path.c_str(), "rbe"), &std::fclose),
        png_(png_create_read_struct(PNG_LIBPNG_VER_STRING, this, OnError, OnWarning)),
        info_(png_ == nullptr ? nullptr : png_create_info_struct(png_)) {}
  ~PngReader() { png_destroy_read_struct(&png_, &info_, nullptr); }
  PngReader(const PngReader&) = delete;
  PngReader& operator=(const PngReader&) = delete;

  [[nodiscard]] bool is_open() const { return file_ != nullptr && info_ != nullptr; }
  // The message of libpng about a step that failed.
  [[nodiscard]] const std::string& said() const { return said_; }

  // False: said().
  bool ReadHeader() {
    if (setjmp(png_jmpbuf(png_)) != 0) {
      return false;
    }
    png_init_io(png_, file_.get());
    png_read_info(png_, info_);
    return true;
  }
  // Reads all rows, once, after the header.
  bool ReadRows(std::vector<png_byte*>* rows) {
    if (setjmp(png_jmpbuf(png_)) != 0) {
      return false;
    }
    png_set_expand_gray_1_2_4_to_8(png_);
    png_set_swap(png_);  // PNG is big-endian
    png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    png_read_image(png_, rows->data());
    png_read_end(png_, nullptr);
    return true;
  }

  [[nodiscard]] std::int64_t width() const { return png_get_image_width(png_, info_); }
  [[nodiscard]] std::int64_t height() const { return png_get_image_height(png_, info_); }
  [[nodiscard]] int bits() const { return png_get_bit_depth(png_, info_); }
  [[nodiscard]] bool is_grey() const {
    return png_get_color_type(png_, info_) == PNG_COLOR_TYPE_GRAY;
  }

 private:
  [[noreturn]] static void OnError(png_structp png, png_const_charp text) {
    static_cast<PngReader*>(png_get_error_ptr(png))->said_ = text;
    png_longjmp(png, 1);
  }
  static void OnWarning(png_structp /*png*/, png_const_charp /*text*/) {}

  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
  png_structp png_;
  png_infop info_;
  std::string said_;
};

}  // namespace

absl::StatusOr<SliceImage> ReadPngSlice(const std::string& path, SlicePart part) {
  PngReader reader(path);
  if (!reader.is_open()) {
    return absl::NotFoundError(absl::StrCat(path, ": can't be opened"));
  }
  if (!reader.ReadHeader()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": can't be read as PNG: ", reader.said()));
  }
  if (!reader.is_grey()) {
    return ColourSliceError(path);
  }
  SliceImage slice{
      .width = reader.width(),
      .height = reader.height(),
      .type = reader.bits() == 16 ? volume::ScalarType::kUint16 : volume::ScalarType::kUint8};
  if (slice.width > kMaxSliceSamples || slice.height > kMaxSliceSamples) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d x %d samples; expected at most %d along each axis", path,
                        slice.width, slice.height, kMaxSliceSamples));
  }
  if (part == SlicePart::kHeader) {
    return slice;
  }
  const auto row_bytes = static_cast<std::size_t>(slice.width) * volume::SizeOf(slice.type);
  slice.samples.resize(row_bytes * static_cast<std::size_t>(slice.height));
  std::vector<png_byte*> rows(static_cast<std::size_t>(slice.height));
  for (std::size_t y = 0; y < rows.size(); ++y) {
    rows[y] = reinterpret_cast<png_byte*>(&slice.samples[y * row_bytes]);
  }
  if (!reader.ReadRows(&rows)) {
    return absl::DataLossError(
        absl::StrCat(path, ": can't be read, the file may be cut: ", reader.said()));
  }
  return slice;
}

}  // namespace isoscope::source
