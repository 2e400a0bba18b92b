// TIFF files by libtiff: their pages, and the planes of samples on them.

#ifndef ISOSCOPE_CORE_FORMATS_STACKS_TIFF_FILE_H_
#define ISOSCOPE_CORE_FORMATS_STACKS_TIFF_FILE_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/adapt/wide_source.h"
#include "core/volume/scalar_type.h"
#include "tiffio.h"

namespace isoscope::source {

struct CloseTiff {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};
using TiffFile = std::unique_ptr<TIFF, CloseTiff>;

// True for the first bytes of a TIFF file, BigTIFF, too.
bool IsTiff(absl::string_view head);

// Opens the file at its first page. NOT_FOUND: no such file. INVALID_ARGUMENT: no TIFF.
absl::StatusOr<TiffFile> OpenTiff(const std::string& path);
// DATA_LOSS with the last message of libtiff.
absl::Status TiffDamage(const std::string& path);

// The format that all pages of a volume share.
struct PageFormat {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  volume::ScalarType type = volume::ScalarType::kUint8;  // of `wide`, its carrier
  std::optional<WideType> wide{};                        // integers of 64 bits, floats of 16
  bool is_bits = false;  // samples of 1 bit, read as bytes of 0 and 1
  // Planes that a page holds one after the other; else each page is one plane.
  std::uint16_t planes = 1;
  std::uint16_t orientation = 1;  // where row 0 and column 0 are, as TIFF numbers it

  [[nodiscard]] std::int64_t plane_bytes() const {
    return std::int64_t{width} * height * static_cast<std::int64_t>(volume::SizeOf(type));
  }
  // "uint16", "float16", "bits": what a sample is in the file.
  [[nodiscard]] absl::string_view type_name() const;

  friend bool operator==(const PageFormat&, const PageFormat&) = default;
};

enum class TiffColours {
  kRefused,
  kForDisplay,  // the file says that its colours only show the samples
};

// Returns the format of the current page. INVALID_ARGUMENT: colours, a palette, or samples of a
// type that a volume can't have; slices within the page (ImageDepth); the message says what to do.
absl::StatusOr<PageFormat> FormatOfPage(TIFF* tiff, const std::string& path, TiffColours colours);

// Reads a plane of the current page as [y][x], x fastest, in the byte order of this machine, into
// `out`, which holds format.plane_bytes(). DATA_LOSS: damaged; of pages that are compressed as fax,
// also what libtiff only warns of.
// REQUIRES: `format` is that of the page.
absl::Status ReadTiffPlane(TIFF* tiff, const PageFormat& format, std::uint16_t plane,
                           const std::string& path, char* out);

// The description in the head of a stack, and the offsets of its pages.
struct TiffPages {
  // The offsets are for TIFFSetSubDirectory. Reduced pages, which are thumbnails, are left out.
  std::vector<std::uint64_t> offsets;
  std::string description;  // of the first page
  // Pixels in a unit of length along x and y, and the unit as TIFF numbers it; 0 if there is none.
  double x_resolution = 0;
  double y_resolution = 0;
  std::uint16_t resolution_unit = 0;
  // GeoTIFF's ModelPixelScale (33550) as the file has it, three numbers if it is good; and whether
  // there is a ModelTransformation (34264).
  std::vector<double> model_scale;
  bool has_model_matrix = false;
  std::string lsm;  // the bytes of the tag CZ_LSMINFO of the first page
  // The first byte of the samples of the first page, if they lie there raw in one piece; else 0.
  std::uint64_t raw_offset = 0;
};

// Walks through all pages. INVALID_ARGUMENT: more than a million. DATA_LOSS: the list of pages
// leads to one that can't be read.
absl::StatusOr<TiffPages> ScanTiffPages(TIFF* tiff, const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_STACKS_TIFF_FILE_H_
