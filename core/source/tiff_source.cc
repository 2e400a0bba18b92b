// A TIFF file is a linked list of pages; a stack is one file of many pages, or many files of one
// page. A page is stored in strips (a few whole rows) or tiles (rectangles, those at the right and
// lower edge filled up), each compressed by itself:
//
//   strips of 4 rows        tiles of 4 x 4, of a page of 6 x 6
//   +------------+          +----+----+
//   | rows 0-3   |          |    |  ::|   ':' is no part of the page
//   +------------+          +----+----+
//   | rows 4-5   |          |    |  ::|
//   +------------+          |::::|::::|
//                           +----+----+
//
// Opening a stack reads the first page of every file, and the number of pages. All must have the
// size and type of the first. A slice is decoded when its rows are read: strips directly into their
// place, tiles through a buffer of one tile. Going to the next page is cheap; going back opens the
// file again.
//
// libtiff inflates a whole strip or tile by libdeflate, and accepts one that is too short. Samples
// of a damaged page would then be old memory. So zlib checks the data.
//
// libtiff writes its messages to standard error unless it is given functions: the last error goes
// into the status, warnings (mostly private tags) are dropped.

#include "core/source/tiff_source.h"

#include <algorithm>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/slice_source.h"
#include "tiffio.h"

namespace isoscope::source {
namespace {

// The largest decoded strip or tile. A larger one is taken for an attack.
constexpr std::int64_t kMaxPieceBytes = 2 * base::kGiB;

// The last message of libtiff in this thread. It takes plain functions only.
std::string& LastMessage() {
  thread_local std::string message;
  return message;
}

__attribute__((format(printf, 2, 0))) void KeepMessage(const char* /*module*/, const char* format,
                                                       va_list arguments) {
  char text[256];
  std::vsnprintf(text, sizeof(text), format, arguments);
  LastMessage() = text;
}

void DropMessage(const char* /*module*/, const char* /*format*/, va_list /*arguments*/) {}

std::string TakeMessage() {
  std::string message = std::exchange(LastMessage(), std::string());
  return message.empty() ? "unknown error" : message;
}

struct CloseTiff {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};
using TiffFile = std::unique_ptr<TIFF, CloseTiff>;

absl::StatusOr<TiffFile> OpenTiff(const std::string& path) {
  if (!io::PathExists(path)) {
    return absl::NotFoundError(absl::StrCat(path, ": no such file"));
  }
  TIFFSetErrorHandler(KeepMessage);
  TIFFSetWarningHandler(DropMessage);  // private tags
  TakeMessage();
  // m: no memory map, so that a cut file is an error and not a signal.
  TiffFile tiff(TIFFOpen(path.c_str(), "rm"));
  if (tiff == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": can't be read as TIFF: ", TakeMessage()));
  }
  return tiff;
}

// The format that all pages must share.
struct PageFormat {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  volume::ScalarType type = volume::ScalarType::kUint8;

  friend bool operator==(const PageFormat&, const PageFormat&) = default;
};

bool ScalarTypeOf(unsigned bits, unsigned format, volume::ScalarType* type) {
  const bool is_signed = format == SAMPLEFORMAT_INT;
  if (format == SAMPLEFORMAT_IEEEFP) {
    *type = bits == 32 ? volume::ScalarType::kFloat32 : volume::ScalarType::kFloat64;
    return bits == 32 || bits == 64;
  }
  if (format != SAMPLEFORMAT_UINT && !is_signed) {
    return false;
  }
  switch (bits) {
    case 8:
      *type = is_signed ? volume::ScalarType::kInt8 : volume::ScalarType::kUint8;
      return true;
    case 16:
      *type = is_signed ? volume::ScalarType::kInt16 : volume::ScalarType::kUint16;
      return true;
    case 32:
      *type = is_signed ? volume::ScalarType::kInt32 : volume::ScalarType::kUint32;
      return true;
    default:
      return false;
  }
}

// Returns the format of the current page.
absl::StatusOr<PageFormat> FormatOf(TIFF* tiff, const std::string& path) {
  PageFormat page;
  std::uint16_t bits = 1;
  std::uint16_t samples = 1;
  std::uint16_t format = SAMPLEFORMAT_UINT;
  std::uint16_t photometric = PHOTOMETRIC_MINISBLACK;
  TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &page.width);
  TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &page.height);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &bits);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &samples);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLEFORMAT, &format);
  TIFFGetField(tiff, TIFFTAG_PHOTOMETRIC, &photometric);
  if (samples != 1 ||
      (photometric != PHOTOMETRIC_MINISBLACK && photometric != PHOTOMETRIC_MINISWHITE)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d samples a pixel, photometric interpretation %d (a colour or palette image); "
        "expected greyscale: convert it",
        path, samples, photometric));
  }
  if (!ScalarTypeOf(bits, format, &page.type)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: samples of %d bits, format %d; expected integers of 8, 16 or 32 bits or floats of 32 "
        "or 64 bits",
        path, bits, format));
  }
  return page;
}

class TiffReader final : public SliceReader {
 public:
  // One file of many pages, or many files of one page.
  TiffReader(std::vector<std::string> files, bool is_one_file, const PageFormat& format)
      : files_(std::move(files)), is_one_file_(is_one_file), format_(format) {}

  absl::Status ReadSlice(std::int64_t z, char* out) override {
    const std::string& path = files_[is_one_file_ ? 0 : static_cast<std::size_t>(z)];
    ISOSCOPE_RETURN_IF_ERROR(Seek(z, path));
    TIFF* const tiff = tiff_.get();
    ISOSCOPE_ASSIGN_OR_RETURN(const PageFormat format, FormatOf(tiff, path));
    if (!(format == format_)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: slice %d has %d x %d samples of %s, the first %d x %d of %s: expected slices of one "
          "size and type",
          path, z, format.width, format.height, volume::NameOf(format.type), format_.width,
          format_.height, volume::NameOf(format_.type)));
    }
    std::uint16_t compression = COMPRESSION_NONE;
    TIFFGetFieldDefaulted(tiff, TIFFTAG_COMPRESSION, &compression);
    if (compression == COMPRESSION_ADOBE_DEFLATE || compression == COMPRESSION_DEFLATE) {
      TIFFSetField(tiff, TIFFTAG_DEFLATE_SUBCODEC, DEFLATE_SUBCODEC_ZLIB);
    }
    return TIFFIsTiled(tiff) != 0 ? ReadTiles(tiff, path, out) : ReadStrips(tiff, path, out);
  }

 private:
  // Makes slice `z` the current page. Pages are a linked list: forwards is cheap.
  absl::Status Seek(std::int64_t z, const std::string& path) {
    if (!is_one_file_ || tiff_ == nullptr || z < page_) {
      tiff_ = nullptr;
      ISOSCOPE_ASSIGN_OR_RETURN(tiff_, OpenTiff(path));
      page_ = is_one_file_ ? 0 : z;
    }
    for (; page_ < z; ++page_) {
      if (TIFFReadDirectory(tiff_.get()) == 0) {
        tiff_ = nullptr;
        return absl::DataLossError(
            absl::StrFormat("%s: page %d can't be read: %s", path, page_ + 1, TakeMessage()));
      }
    }
    return absl::OkStatus();
  }

  [[nodiscard]] static absl::Status Damaged(const std::string& path) {
    return absl::DataLossError(absl::StrFormat("%s: can't be decoded: %s", path, TakeMessage()));
  }

  absl::Status ReadStrips(TIFF* tiff, const std::string& path, char* out) const {
    const std::int64_t row_bytes =
        std::int64_t{format_.width} * static_cast<std::int64_t>(volume::SizeOf(format_.type));
    if (static_cast<std::int64_t>(TIFFScanlineSize64(tiff)) != row_bytes) {
      return absl::DataLossError(absl::StrFormat("%s: rows of %d bytes, expected %d", path,
                                                 TIFFScanlineSize64(tiff), row_bytes));
    }
    std::uint32_t strip_rows = 0;
    TIFFGetFieldDefaulted(tiff, TIFFTAG_ROWSPERSTRIP, &strip_rows);
    strip_rows = std::min(std::max(strip_rows, 1U), format_.height);
    for (std::uint32_t y = 0; y < format_.height; y += strip_rows) {
      const std::int64_t bytes = std::min(strip_rows, format_.height - y) * row_bytes;
      if (TIFFReadEncodedStrip(tiff, TIFFComputeStrip(tiff, y, 0), out,
                               static_cast<tmsize_t>(bytes)) != bytes) {
        return Damaged(path);
      }
      out += bytes;
    }
    return absl::OkStatus();
  }

  absl::Status ReadTiles(TIFF* tiff, const std::string& path, char* out) const {
    const std::size_t sample_size = volume::SizeOf(format_.type);
    std::uint32_t tile_width = 0;
    std::uint32_t tile_height = 0;
    TIFFGetField(tiff, TIFFTAG_TILEWIDTH, &tile_width);
    TIFFGetField(tiff, TIFFTAG_TILELENGTH, &tile_height);
    const auto tile_bytes = static_cast<std::int64_t>(TIFFTileSize64(tiff));
    const std::int64_t tile_row_bytes =
        std::int64_t{tile_width} * static_cast<std::int64_t>(sample_size);
    if (tile_width == 0 || tile_height == 0 || tile_bytes > kMaxPieceBytes ||
        tile_bytes != tile_row_bytes * tile_height) {
      return absl::DataLossError(absl::StrFormat("%s: tiles of %d x %d samples in %d bytes", path,
                                                 tile_width, tile_height, tile_bytes));
    }
    std::vector<char> tile(static_cast<std::size_t>(tile_bytes));
    for (std::uint32_t y = 0; y < format_.height; y += tile_height) {
      for (std::uint32_t x = 0; x < format_.width; x += tile_width) {
        if (TIFFReadTile(tiff, tile.data(), x, y, 0, 0) < 0) {
          return Damaged(path);
        }
        const std::uint32_t rows = std::min(tile_height, format_.height - y);
        const std::size_t bytes = std::min(tile_width, format_.width - x) * sample_size;
        for (std::uint32_t row = 0; row < rows; ++row) {
          std::memcpy(out + (std::size_t{y + row} * format_.width + x) * sample_size,
                      tile.data() + row * tile_row_bytes, bytes);
        }
      }
    }
    return absl::OkStatus();
  }

  const std::vector<std::string> files_;
  const bool is_one_file_;
  const PageFormat format_;
  TiffFile tiff_;
  std::int64_t page_ = 0;  // the current one of tiff_
};

}  // namespace

bool NaturalLess(const std::string& a, const std::string& b) {
  const auto is_digit = [](char c) { return absl::ascii_isdigit(static_cast<unsigned char>(c)); };
  std::size_t i = 0;
  std::size_t j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const auto end_of = [&](const std::string& text, std::size_t at) {
        while (at < text.size() && is_digit(text[at])) {
          ++at;
        }
        return at;
      };
      const std::size_t a_end = end_of(a, i);
      const std::size_t b_end = end_of(b, j);
      const std::size_t a_first = std::min(a.find_first_not_of('0', i), a_end);
      const std::size_t b_first = std::min(b.find_first_not_of('0', j), b_end);
      if (a_end - a_first != b_end - b_first) {
        return a_end - a_first < b_end - b_first;
      }
      const int order = a.compare(a_first, a_end - a_first, b, b_first, b_end - b_first);
      if (order != 0) {
        return order < 0;
      }
      i = a_end;
      j = b_end;
    } else if (a[i] != b[j]) {
      return a[i] < b[j];
    } else {
      ++i;
      ++j;
    }
  }
  if ((i < a.size()) != (j < b.size())) {
    return j < b.size();
  }
  return a < b;  // equal but for zeros in front
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenTiffStack(const std::vector<std::string>& files,
                                                            const std::string& name) {
  if (files.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": no TIFF files"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const TiffFile first, OpenTiff(files[0]));
  ISOSCOPE_ASSIGN_OR_RETURN(const PageFormat format, FormatOf(first.get(), files[0]));
  std::int64_t slices = 1;
  while (TIFFReadDirectory(first.get()) != 0) {
    ++slices;
  }
  if (files.size() > 1) {
    if (slices > 1) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: %d pages in one of %d files; expected one file of many pages, or "
                          "many files of one page",
                          files[0], slices, files.size()));
    }
    slices = static_cast<std::int64_t>(files.size());
    for (const std::string& path : files) {
      ISOSCOPE_ASSIGN_OR_RETURN(const TiffFile tiff, OpenTiff(path));
      ISOSCOPE_ASSIGN_OR_RETURN(const PageFormat other, FormatOf(tiff.get(), path));
      if (!(other == format)) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "%s: %d x %d samples of %s, but %s has %d x %d of %s: expected slices of one size and "
            "type",
            path, other.width, other.height, volume::NameOf(other.type), files[0], format.width,
            format.height, volume::NameOf(format.type)));
      }
    }
  }
  volume::GridGeometry geometry;
  geometry.sample_dims = {std::int64_t{format.width}, std::int64_t{format.height}, slices};
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(name, ": ", valid.message()));
  }
  return MakeSliceSource(geometry, format.type, name,
                         std::make_unique<TiffReader>(files, files.size() == 1, format));
}

}  // namespace isoscope::source
