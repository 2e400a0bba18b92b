// A page is stored in strips (a few whole rows) or tiles (rectangles, those at the right and lower
// edge filled up), each compressed by itself:
//
//   strips of 4 rows        tiles of 4 x 4, of a page of 6 x 6
//   +------------+          +----+----+
//   | rows 0-3   |          |    |  ::|   ':' is no part of the page
//   +------------+          +----+----+
//   | rows 4-5   |          |    |  ::|
//   +------------+          |::::|::::|
//                           +----+----+
//
// Strips are decoded directly into their place, tiles through a buffer of one tile.
//
// libtiff inflates a whole strip or tile by libdeflate, and accepts one that is too short. Samples
// of a damaged page would then be old memory. So zlib checks the data.
//
// libtiff writes its messages to standard error unless it is given functions: the last error goes
// into the status, warnings (mostly private tags) are dropped.
//
// A mounted file (core/io/mounted_file.h) is read through functions that libtiff calls (FarFile).

#include "core/formats/stacks/tiff_file.h"

#include <algorithm>
#include <cstdarg>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"

namespace isoscope::source {
namespace {

// The largest decoded strip or tile. A larger one is taken for an attack.
constexpr std::int64_t kMaxPieceBytes = 2 * base::kGiB;
constexpr std::size_t kMaxTiffPages = 1'000'000;
constexpr std::uint32_t kLsmInfoTag = 34412;
constexpr std::uint32_t kModelPixelScaleTag = 33550;
constexpr std::uint32_t kModelMatrixTag = 34264;

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

// Warnings of this thread, which are counted and dropped.
int& WarningCount() {
  thread_local int count = 0;
  return count;
}

void CountWarning(const char* /*module*/, const char* /*format*/, va_list /*arguments*/) {
  ++WarningCount();
}

std::string TakeMessage() {
  std::string message = std::exchange(LastMessage(), std::string());
  return message.empty() ? "unknown error" : message;
}

// Why the last read of a mounted file in this thread failed: libtiff keeps no reason.
absl::Status& FarError() {
  thread_local absl::Status error;
  return error;
}

// A mounted file with a position, as libtiff wants one.
struct FarFile {
  std::unique_ptr<io::RandomAccessFile> file;
  std::int64_t position = 0;
};

tmsize_t ReadFar(thandle_t handle, void* out, tmsize_t size) {
  auto* const far = static_cast<FarFile*>(handle);
  const std::int64_t left = std::max<std::int64_t>(far->file->size_bytes() - far->position, 0);
  const std::int64_t take = std::min<std::int64_t>(size, left);
  const absl::Status status =
      far->file->ReadAt(far->position, static_cast<std::size_t>(take), static_cast<char*>(out));
  if (!status.ok()) {
    FarError() = status;
    return -1;
  }
  far->position += take;
  return take;
}

tmsize_t WriteFar(thandle_t /*handle*/, void* /*bytes*/, tmsize_t /*size*/) { return -1; }

toff_t SeekFar(thandle_t handle, toff_t offset, int whence) {
  auto* const far = static_cast<FarFile*>(handle);
  const std::int64_t base = whence == SEEK_SET   ? 0
                            : whence == SEEK_CUR ? far->position
                                                 : far->file->size_bytes();
  // Offsets come from the file: any 64 bits. Reading behind the end gives nothing.
  constexpr std::int64_t kMaxPosition = std::numeric_limits<std::int64_t>::max() / 2;
  const auto step = static_cast<std::int64_t>(offset);
  far->position = step > kMaxPosition || step < -kMaxPosition
                      ? kMaxPosition
                      : std::max<std::int64_t>(base + step, 0);
  return static_cast<toff_t>(far->position);
}

int CloseFar(thandle_t handle) {
  delete static_cast<FarFile*>(handle);
  return 0;
}

toff_t SizeOfFar(thandle_t handle) {
  return static_cast<toff_t>(static_cast<FarFile*>(handle)->file->size_bytes());
}

absl::StatusOr<TiffFile> OpenFarTiff(const std::string& path) {
  auto far = std::make_unique<FarFile>();
  ISOSCOPE_ASSIGN_OR_RETURN(far->file, io::OpenRandomAccessFile(path));
  FarError() = absl::OkStatus();
  TiffFile tiff(TIFFClientOpen(path.c_str(), "rm", far.get(), ReadFar, WriteFar, SeekFar, CloseFar,
                               SizeOfFar, nullptr, nullptr));
  if (tiff != nullptr) {
    static_cast<void>(far.release());  // CloseFar has it
  }
  return tiff;
}

// Sets the type of samples; false if a volume can't have it.
bool SetSampleType(unsigned bits, unsigned format, PageFormat* page) {
  const bool is_signed = format == SAMPLEFORMAT_INT;
  const bool is_integer = format == SAMPLEFORMAT_UINT || is_signed;
  volume::ScalarType* const type = &page->type;
  if (bits == 1 && format == SAMPLEFORMAT_UINT) {
    page->is_bits = true;
    return true;
  }
  if ((bits == 64 && is_integer) || (bits == 16 && format == SAMPLEFORMAT_IEEEFP)) {
    page->wide = bits == 16 ? WideType::kFloat16 : is_signed ? WideType::kInt64 : WideType::kUint64;
    page->type = CarrierType(*page->wide);
    return true;
  }
  if (format == SAMPLEFORMAT_IEEEFP) {
    *type = bits == 32 ? volume::ScalarType::kFloat32 : volume::ScalarType::kFloat64;
    return bits == 32 || bits == 64;
  }
  if (!is_integer) {
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

const char* NameOfPhotometric(std::uint16_t photometric) {
  switch (photometric) {
    case PHOTOMETRIC_RGB:
      return "RGB";
    case PHOTOMETRIC_PALETTE:
      return "a palette";
    case PHOTOMETRIC_MASK:
      return "a mask";
    case PHOTOMETRIC_SEPARATED:
      return "CMYK";
    case PHOTOMETRIC_YCBCR:
      return "YCbCr";
    case PHOTOMETRIC_CIELAB:
      return "CIE L*a*b*";
    case PHOTOMETRIC_MINISBLACK:
    case PHOTOMETRIC_MINISWHITE:
      return "greyscale";
    default:
      return "another kind";
  }
}

absl::Status ColourError(const std::string& path, unsigned samples, std::uint16_t photometric) {
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: a colour or palette image: %d samples a pixel, photometric interpretation %d (%s)%s; "
      "expected greyscale, 1 sample a pixel: convert it, as ImageMagick does with `convert %s "
      "-alpha off -colorspace Gray grey.tif`",
      path, samples, photometric, NameOfPhotometric(photometric),
      photometric == PHOTOMETRIC_PALETTE ? ", so that samples are numbers of colours" : "", path));
}

// The bytes of a row of samples as libtiff decodes it: bits begin at a whole byte.
std::int64_t RowBytes(const PageFormat& format, std::uint32_t width) {
  return format.is_bits
             ? (std::int64_t{width} + 7) / 8
             : std::int64_t{width} * static_cast<std::int64_t>(volume::SizeOf(format.type));
}

// Makes bytes of 0 and 1 of a row of bits, the highest of each byte first.
void SpreadBits(const char* bits, std::uint32_t width, char* out) {
  for (std::uint32_t x = 0; x < width; ++x) {
    out[x] = static_cast<char>(static_cast<unsigned char>(bits[x / 8]) >> (7 - x % 8) & 1);
  }
}

absl::Status ReadStrips(TIFF* tiff, const PageFormat& format, std::uint16_t plane,
                        const std::string& path, char* out) {
  const std::int64_t row_bytes = RowBytes(format, format.width);
  if (static_cast<std::int64_t>(TIFFScanlineSize64(tiff)) != row_bytes) {
    return absl::DataLossError(absl::StrFormat("%s: rows of %d bytes, expected %d", path,
                                               TIFFScanlineSize64(tiff), row_bytes));
  }
  std::uint32_t strip_rows = 0;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_ROWSPERSTRIP, &strip_rows);
  strip_rows = std::min(std::max(strip_rows, 1U), format.height);
  std::vector<char> bits(format.is_bits ? static_cast<std::size_t>(strip_rows * row_bytes) : 0);
  for (std::uint32_t y = 0; y < format.height; y += strip_rows) {
    const std::uint32_t rows = std::min(strip_rows, format.height - y);
    const std::int64_t bytes = rows * row_bytes;
    if (TIFFReadEncodedStrip(tiff, TIFFComputeStrip(tiff, y, plane),
                             format.is_bits ? bits.data() : out,
                             static_cast<tmsize_t>(bytes)) != bytes) {
      return TiffDamage(path);
    }
    for (std::uint32_t row = 0; format.is_bits && row < rows; ++row) {
      SpreadBits(bits.data() + row * row_bytes, format.width,
                 out + std::size_t{row} * format.width);
    }
    out += format.is_bits ? std::int64_t{rows} * format.width : bytes;
  }
  return absl::OkStatus();
}

absl::Status ReadTiles(TIFF* tiff, const PageFormat& format, std::uint16_t plane,
                       const std::string& path, char* out) {
  const std::size_t sample_size = volume::SizeOf(format.type);
  std::uint32_t tile_width = 0;
  std::uint32_t tile_height = 0;
  TIFFGetField(tiff, TIFFTAG_TILEWIDTH, &tile_width);
  TIFFGetField(tiff, TIFFTAG_TILELENGTH, &tile_height);
  const auto tile_bytes = static_cast<std::int64_t>(TIFFTileSize64(tiff));
  const std::int64_t tile_row_bytes = RowBytes(format, tile_width);
  if (tile_width == 0 || tile_height == 0 || tile_bytes > kMaxPieceBytes ||
      tile_bytes != tile_row_bytes * tile_height) {
    return absl::DataLossError(absl::StrFormat("%s: tiles of %d x %d samples in %d bytes", path,
                                               tile_width, tile_height, tile_bytes));
  }
  std::vector<char> tile(static_cast<std::size_t>(tile_bytes));
  for (std::uint32_t y = 0; y < format.height; y += tile_height) {
    for (std::uint32_t x = 0; x < format.width; x += tile_width) {
      if (TIFFReadTile(tiff, tile.data(), x, y, 0, plane) < 0) {
        return TiffDamage(path);
      }
      const std::uint32_t rows = std::min(tile_height, format.height - y);
      const std::uint32_t columns = std::min(tile_width, format.width - x);
      for (std::uint32_t row = 0; row < rows; ++row) {
        char* const to = out + (std::size_t{y + row} * format.width + x) * sample_size;
        const char* const from = tile.data() + row * tile_row_bytes;
        if (format.is_bits) {
          SpreadBits(from, columns, to);
        } else {
          std::memcpy(to, from, columns * sample_size);
        }
      }
    }
  }
  return absl::OkStatus();
}

// The member TiffPages::raw_offset of the current page.
std::uint64_t RawOffset(TIFF* tiff) {
  std::uint16_t compression = COMPRESSION_NONE;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_COMPRESSION, &compression);
  if (compression != COMPRESSION_NONE || TIFFIsTiled(tiff) != 0) {
    return 0;
  }
  const std::uint64_t first = TIFFGetStrileOffset(tiff, 0);
  // Without an offset a header of billions of strips would be walked through.
  const std::uint32_t strips = first == 0 ? 0 : TIFFNumberOfStrips(tiff);
  std::uint64_t end = first;
  for (std::uint32_t strip = 0; strip < strips; ++strip) {
    if (TIFFGetStrileOffset(tiff, strip) != end) {
      return 0;
    }
    end += TIFFGetStrileByteCount(tiff, strip);
  }
  return first;
}

// The floats of 64 bits of a tag that libtiff does not know; one of another type gives one NaN.
std::vector<double> DoublesOf(TIFF* tiff, std::uint32_t tag) {
  std::uint32_t count = 0;
  const void* bytes = nullptr;
  if (TIFFGetField(tiff, tag, &count, &bytes) != 1 || bytes == nullptr) {
    return {};
  }
  const TIFFField* const field = TIFFFieldWithTag(tiff, tag);
  if (field == nullptr || TIFFFieldDataType(field) != TIFF_DOUBLE) {
    return {std::numeric_limits<double>::quiet_NaN()};
  }
  std::vector<double> numbers(count);
  std::memcpy(numbers.data(), bytes, count * sizeof(double));
  return numbers;
}

void ReadTiffHead(TIFF* tiff, TiffPages* pages) {
  const char* description = nullptr;
  if (TIFFGetField(tiff, TIFFTAG_IMAGEDESCRIPTION, &description) == 1 && description != nullptr) {
    pages->description = description;
  }
  float x_resolution = 0;
  float y_resolution = 0;
  TIFFGetField(tiff, TIFFTAG_XRESOLUTION, &x_resolution);
  TIFFGetField(tiff, TIFFTAG_YRESOLUTION, &y_resolution);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_RESOLUTIONUNIT, &pages->resolution_unit);
  pages->x_resolution = static_cast<double>(x_resolution);
  pages->y_resolution = static_cast<double>(y_resolution);
  pages->model_scale = DoublesOf(tiff, kModelPixelScaleTag);
  pages->has_model_matrix = !DoublesOf(tiff, kModelMatrixTag).empty();
  std::uint32_t count = 0;
  const void* bytes = nullptr;
  if (TIFFGetField(tiff, kLsmInfoTag, &count, &bytes) == 1 && bytes != nullptr) {
    pages->lsm.assign(static_cast<const char*>(bytes), count);
  }
  pages->raw_offset = RawOffset(tiff);
}

}  // namespace

bool IsTiff(absl::string_view head) {
  const absl::string_view mark = head.substr(0, 4);
  return mark == absl::string_view("II*\0", 4) || mark == absl::string_view("MM\0*", 4) ||
         mark == absl::string_view("II+\0", 4) || mark == absl::string_view("MM\0+", 4);
}

absl::StatusOr<TiffFile> OpenTiff(const std::string& path) {
  if (!io::PathExists(path)) {
    return absl::NotFoundError(absl::StrCat(path, ": no such file"));
  }
  ISOSCOPE_RETURN_IF_ERROR(base::CheckProcessInterrupt());  // of a stack of many files
  ISOSCOPE_RETURN_IF_ERROR(io::CheckIsRegularFile(path));   // libtiff would wait for a writer
  TIFFSetErrorHandler(KeepMessage);
  TIFFSetWarningHandler(CountWarning);  // private tags
  TakeMessage();
  // m: no memory map, so that a cut file is an error and not a signal.
  TiffFile tiff;
  if (io::IsMounted(path)) {
    ISOSCOPE_ASSIGN_OR_RETURN(tiff, OpenFarTiff(path));
    if (tiff == nullptr && !FarError().ok()) {
      return std::exchange(FarError(), absl::OkStatus());
    }
  } else {
    tiff.reset(TIFFOpen(path.c_str(), "rm"));
  }
  if (tiff == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": can't be read as TIFF: ", TakeMessage()));
  }
  return tiff;
}

absl::Status TiffDamage(const std::string& path) {
  if (!FarError().ok()) {
    return std::exchange(FarError(), absl::OkStatus());
  }
  return absl::DataLossError(absl::StrFormat("%s: can't be decoded: %s", path, TakeMessage()));
}

absl::StatusOr<PageFormat> FormatOfPage(TIFF* tiff, const std::string& path, TiffColours colours) {
  PageFormat page;
  std::uint16_t bits = 1;
  std::uint16_t samples = 1;
  std::uint16_t format = SAMPLEFORMAT_UINT;
  std::uint16_t photometric = PHOTOMETRIC_MINISBLACK;
  std::uint16_t planar = PLANARCONFIG_CONTIG;
  TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &page.width);
  TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &page.height);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &bits);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &samples);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLEFORMAT, &format);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_PLANARCONFIG, &planar);
  TIFFGetField(tiff, TIFFTAG_PHOTOMETRIC, &photometric);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_ORIENTATION, &page.orientation);
  if (page.orientation < ORIENTATION_TOPLEFT || page.orientation > ORIENTATION_LEFTBOT) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: orientation %d; expected 1 to 8", path, page.orientation));
  }
  std::uint32_t depth = 1;
  TIFFGetField(tiff, TIFFTAG_IMAGEDEPTH, &depth);
  if (depth != 1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: an ImageDepth (32997) of %d, slices within one page, which is not "
                        "read: save it with a page a slice",
                        path, depth));
  }
  const bool is_grey =
      photometric == PHOTOMETRIC_MINISBLACK || photometric == PHOTOMETRIC_MINISWHITE;
  if (colours == TiffColours::kForDisplay) {
    page.planes = planar == PLANARCONFIG_SEPARATE ? samples : 1;
    if (samples < 1 || (samples > 1 && planar != PLANARCONFIG_SEPARATE)) {
      return ColourError(path, samples, photometric);
    }
  } else if (samples != 1 || !is_grey) {
    return ColourError(path, samples, photometric);
  }
  if (!SetSampleType(bits, format, &page)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: samples of %d bits, format %d; expected integers of 1, 8, 16, 32 or 64 bits or floats "
        "of 16, 32 or 64 bits",
        path, bits, format));
  }
  return page;
}

absl::Status ReadTiffPlane(TIFF* tiff, const PageFormat& format, std::uint16_t plane,
                           const std::string& path, char* out) {
  std::uint16_t compression = COMPRESSION_NONE;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_COMPRESSION, &compression);
  if (compression == COMPRESSION_ADOBE_DEFLATE || compression == COMPRESSION_DEFLATE) {
    TIFFSetField(tiff, TIFFTAG_DEFLATE_SUBCODEC, DEFLATE_SUBCODEC_ZLIB);
  }
  const bool is_fax = compression == COMPRESSION_CCITTFAX3 ||
                      compression == COMPRESSION_CCITTFAX4 || compression == COMPRESSION_CCITTRLE ||
                      compression == COMPRESSION_CCITTRLEW;
  TakeMessage();
  WarningCount() = 0;
  ISOSCOPE_RETURN_IF_ERROR(TIFFIsTiled(tiff) != 0 ? ReadTiles(tiff, format, plane, path, out)
                                                  : ReadStrips(tiff, format, plane, path, out));
  // Rows of a fax that end early are filled up, and reported only.
  return is_fax && (WarningCount() > 0 || !LastMessage().empty()) ? TiffDamage(path)
                                                                  : absl::OkStatus();
}

absl::string_view PageFormat::type_name() const {
  if (is_bits) {
    return "bits";
  }
  if (!wide.has_value()) {
    return volume::NameOf(type);
  }
  return *wide == WideType::kFloat16 ? "float16" : *wide == WideType::kInt64 ? "int64" : "uint64";
}

absl::StatusOr<TiffPages> ScanTiffPages(TIFF* tiff, const std::string& path) {
  TiffPages pages;
  while (true) {
    std::uint32_t kind = 0;
    TIFFGetFieldDefaulted(tiff, TIFFTAG_SUBFILETYPE, &kind);
    if (pages.offsets.empty()) {
      ReadTiffHead(tiff, &pages);
    }
    if (pages.offsets.empty() || (kind & FILETYPE_REDUCEDIMAGE) == 0) {
      pages.offsets.push_back(TIFFCurrentDirOffset(tiff));
    }
    if (pages.offsets.size() > kMaxTiffPages) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: more than %d pages", path, kMaxTiffPages));
    }
    if (TIFFLastDirectory(tiff) != 0) {  // libtiff forgets it if the next page can't be read
      break;
    }
    if (TIFFReadDirectory(tiff) == 0) {
      if (!FarError().ok()) {
        return std::exchange(FarError(), absl::OkStatus());
      }
      return absl::DataLossError(
          absl::StrFormat("%s: page %d can't be read: %s: the file is cut or damaged", path,
                          pages.offsets.size() + 1, TakeMessage()));
    }
  }
  return pages;
}

}  // namespace isoscope::source
