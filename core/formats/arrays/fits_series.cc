// World coordinates of the pixel p, counted from 1, are
//
//   w_i = CRVALi + CDELTi * sum_j PCi_j (p_j - CRPIXj),   or CDi_j in place of CDELTi * PCi_j
//
// They are straight lines only if no CTYPEi names an algorithm ("RA---TAN") or a quantity of the
// sky or the spectrum. Source: FITS Standard 4.0, section 8.
//
// FitsSource reads the stored integers into the tail of its output, and converts them from front to
// back: a result never overwrites an integer that is still to come.

#include "core/formats/arrays/fits_series.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <set>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/coding.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/formats/arrays/fits_header.h"
#include "core/math/vec.h"
#include "core/source/adapt/rescale.h"
#include "core/source/adapt/wide_source.h"
#include "core/source/bytes/file_source.h"
#include "core/source/bytes/sample_location.h"
#include "core/source/grid/grid_faults.h"

namespace isoscope::source {
namespace {

struct FitsGrid {
  volume::GridGeometry geometry{};
  std::string unit{};  // CUNIT
  std::string note{};
};

struct FitsImage {
  std::string field{};
  std::string unit{};  // BUNIT
  FitsGrid grid{};
  SampleLocation location{};
  std::optional<WideType> wide{};
  std::optional<std::int64_t> blank{};
};

absl::Status ImageError(const std::string& path, const FitsPart& part, absl::string_view what) {
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: FITS image %d%s: %s", path, part.number,
                      part.name.empty() ? "" : absl::StrCat(" ", base::Quoted(part.name)), what));
}

// The axes of more than one sample, by their indices.
std::vector<std::size_t> LongAxes(const FitsPart& part) {
  std::vector<std::size_t> axes;
  for (std::size_t i = 0; i < part.axes.size(); ++i) {
    if (part.axes[i] != 1) {
      axes.push_back(i);
    }
  }
  return axes;
}

bool IsFitsVolume(const FitsPart& part) { return part.is_image && LongAxes(part).size() == 3; }

// Returns true if a coordinate is no length on a straight line: "RA---TAN", "FREQ".
bool IsOfSkyOrSpectrum(const std::string& ctype) {
  static const auto* const names = new std::set<std::string>{
      "RA",   "DEC",  "GLON", "GLAT", "ELON", "ELAT", "FREQ", "ENER", "WAVN",   "VRAD",    "WAVE",
      "VOPT", "ZOPT", "AWAV", "VELO", "BETA", "FELO", "TIME", "UTC",  "STOKES", "VELOCITY"};
  const bool has_algorithm = ctype.size() >= 5 && ctype[4] == '-';
  return has_algorithm || names->contains(ctype);
}

// The matrix CDELT * PC, or CD, of the three axes. Not set if others have a share in it.
absl::StatusOr<std::optional<math::Mat3d>> ReadFitsMatrix(const FitsPart& part,
                                                          const std::vector<std::size_t>& axes) {
  bool has_cd = false;
  bool has_pc = false;
  for (std::size_t i = 1; i <= std::min<std::size_t>(part.axes.size(), 9); ++i) {
    for (std::size_t j = 1; j <= std::min<std::size_t>(part.axes.size(), 9); ++j) {
      has_cd = has_cd || part.cards.Has(absl::StrCat("CD", i, "_", j));
      has_pc = has_pc || part.cards.Has(absl::StrCat("PC", i, "_", j));
    }
  }
  if (has_cd && has_pc) {
    return absl::InvalidArgumentError("CDi_j and PCi_j; expected one of them");
  }
  math::Mat3d matrix;
  for (std::size_t j = 0; j < part.axes.size(); ++j) {
    const auto column = std::find(axes.begin(), axes.end(), j);
    for (std::size_t i = 0; i < part.axes.size(); ++i) {
      const auto row = std::find(axes.begin(), axes.end(), i);
      if (row == axes.end() && column == axes.end()) {
        continue;
      }
      ISOSCOPE_ASSIGN_OR_RETURN(
          double element, part.cards.Number(absl::StrCat(has_cd ? "CD" : "PC", i + 1, "_", j + 1),
                                            !has_cd && i == j ? 1 : 0));
      if (!has_cd) {
        ISOSCOPE_ASSIGN_OR_RETURN(const double step,
                                  part.cards.Number(absl::StrCat("CDELT", i + 1), 1));
        element *= step;
      }
      if (row != axes.end() && column != axes.end()) {
        matrix.columns[static_cast<std::size_t>(column - axes.begin())]
                      [static_cast<int>(row - axes.begin())] = element;
      } else if (element != 0) {
        return std::nullopt;
      }
    }
  }
  return matrix;
}

// The grid of the world coordinates; samples 1 apart, and a note, if they are no straight lines.
absl::StatusOr<FitsGrid> ReadFitsGrid(const std::string& path, const FitsPart& part,
                                      const std::vector<std::size_t>& axes,
                                      const GridRules& rules) {
  FitsGrid grid;
  std::vector<std::string> kinds;
  std::vector<std::string> units;
  bool is_linear = true;
  for (std::size_t i = 0; i < 3; ++i) {
    grid.geometry.sample_dims[static_cast<int>(i)] = part.axes[axes[i]];
    const std::string number = absl::StrCat(axes[i] + 1);
    kinds.push_back(part.cards.Text("CTYPE" + number));
    units.push_back(part.cards.Text("CUNIT" + number));
    ISOSCOPE_ASSIGN_OR_RETURN(const double turn, part.cards.Number("CROTA" + number, 0));
    is_linear =
        is_linear && !IsOfSkyOrSpectrum(kinds.back()) && units.back() == units.front() && turn == 0;
  }
  std::optional<math::Mat3d> matrix;
  if (is_linear) {
    ISOSCOPE_ASSIGN_OR_RETURN(matrix, ReadFitsMatrix(part, axes));
  }
  if (!matrix.has_value()) {
    grid.note = absl::StrFormat(
        "samples are 1 apart: the axes %s in %s are no lengths of one unit along straight lines",
        base::PrintableAscii(absl::StrJoin(kinds, ", ")),
        base::PrintableAscii(absl::StrJoin(units, ", ")));
    return grid;
  }
  volume::GridGeometry& geometry = grid.geometry;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::string number = absl::StrCat(axes[i] + 1);
    ISOSCOPE_ASSIGN_OR_RETURN(const double value, part.cards.Number("CRVAL" + number, 0));
    geometry.origin[static_cast<int>(i)] += value;
    // Without any place the first sample lies at 0, as in other formats.
    const bool has_place = part.cards.Has("CRPIX" + number) || part.cards.Has("CRVAL" + number);
    ISOSCOPE_ASSIGN_OR_RETURN(const double pixel,
                              part.cards.Number("CRPIX" + number, has_place ? 0 : 1));
    const math::Vec3d column = matrix->columns[i];
    geometry.origin = geometry.origin + column * (1 - pixel);
    const double length = math::Length(column);
    geometry.spacing[static_cast<int>(i)] = length;
    if (length > 0 && std::isfinite(length)) {
      geometry.direction.columns[i] = column * (1 / length);
    }
  }
  grid.unit = units.front();
  ISOSCOPE_RETURN_IF_ERROR(
      TakeGridByRules(absl::StrFormat("%s: FITS image %d", path, part.number), rules, &geometry));
  return grid;
}

absl::Status TakeFitsType(const FitsPart& part, FitsImage* image) {
  switch (part.bits) {
    case 8:
      image->location.stored_type = volume::ScalarType::kUint8;
      break;
    case 16:
      image->location.stored_type = volume::ScalarType::kInt16;
      break;
    case 32:
      image->location.stored_type = volume::ScalarType::kInt32;
      break;
    case 64:
      image->wide = WideType::kInt64;
      image->location.stored_type = CarrierType(*image->wide);
      break;
    case -32:
      image->location.stored_type = volume::ScalarType::kFloat32;
      break;
    default:
      image->location.stored_type = volume::ScalarType::kFloat64;
      break;
  }
  image->location.is_big_endian = true;
  ISOSCOPE_ASSIGN_OR_RETURN(image->location.slope, part.cards.Number("BSCALE", 1));
  ISOSCOPE_ASSIGN_OR_RETURN(image->location.intercept, part.cards.Number("BZERO", 0));
  if (!std::isfinite(image->location.slope) || !std::isfinite(image->location.intercept) ||
      image->location.slope == 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("BSCALE %g, BZERO %g; expected finite numbers, BSCALE not 0",
                        image->location.slope, image->location.intercept));
  }
  if (part.bits > 0 && part.cards.Has("BLANK")) {
    ISOSCOPE_ASSIGN_OR_RETURN(image->blank, part.cards.Integer("BLANK", 0));
  }
  const bool is_scaled = image->location.slope != 1 || image->location.intercept != 0;
  if (image->wide.has_value() && (is_scaled || image->blank.has_value())) {
    return absl::InvalidArgumentError(
        "64-bit integers with BSCALE, BZERO or BLANK, which are not read: convert it, as "
        "hdu.data.astype('float64') of astropy does");
  }
  return absl::OkStatus();
}

absl::StatusOr<FitsImage> ReadFitsImage(const std::string& path, const FitsFile& file,
                                        const FitsPart& part, const GridRules& rules) {
  const std::vector<std::size_t> axes = LongAxes(part);
  if (!part.is_image || axes.size() != 3) {
    const bool is_compressed = part.cards.Text("ZIMAGE") == "T";
    return ImageError(
        path, part,
        is_compressed ? std::string("it is compressed in tiles; decompress it first (funpack FILE)")
        : part.is_image
            ? absl::StrFormat(
                  "axes of %s samples; expected three of more than one%s",
                  part.axes.empty() ? "no" : absl::StrJoin(part.axes, " x "),
                  axes.size() > 3 ? ": save one volume of it, hdu.data[0] of astropy" : "")
            : std::string("a table or groups, no image"));
  }
  FitsImage image{.unit = part.cards.Text("BUNIT")};
  const absl::Status typed = TakeFitsType(part, &image);
  if (!typed.ok()) {
    return ImageError(path, part, typed.message());
  }
  auto grid = ReadFitsGrid(path, part, axes, rules);
  if (!grid.ok()) {
    return absl::StrContains(grid.status().message(), path)
               ? grid.status()
               : ImageError(path, part, grid.status().message());
  }
  image.grid = *std::move(grid);
  image.location.files = {path};
  image.location.has_more_behind = true;
  image.location.encoding = file.is_gzip ? SampleEncoding::kDeflate : SampleEncoding::kRaw;
  (file.is_gzip ? image.location.decoded_skip : image.location.offset) = part.samples_start;
  return image;
}

// The samples of an image with its note, and with NaN for BLANK.
class FitsSource final : public VolumeSource {
 public:
  // `stored` has the integers as they are, if `image` has a blank value.
  FitsSource(std::unique_ptr<VolumeSource> stored, const FitsImage& image)
      : VolumeSource(InfoOf(*stored, image)),
        stored_(std::move(stored)),
        blank_(image.blank),
        slope_(image.location.slope),
        intercept_(image.location.intercept) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    if (!blank_.has_value()) {
      return stored_->ReadRows(begin_row, end_row, out);
    }
    const auto count =
        static_cast<std::size_t>((end_row - begin_row) * info().geometry.sample_dims.x);
    const volume::ScalarType type = stored_->info().type;
    char* const in = out + count * (volume::SizeOf(info().type) - volume::SizeOf(type));
    ISOSCOPE_RETURN_IF_ERROR(stored_->ReadRows(begin_row, end_row, in));
    volume::VisitScalarType(type, [&]<typename T>() {
      if constexpr (std::is_integral_v<T>) {
        if (info().type == volume::ScalarType::kFloat32) {
          Convert<T, float>(in, count, out);
        } else {
          Convert<T, double>(in, count, out);
        }
      }
    });
    return absl::OkStatus();
  }

 private:
  static SourceInfo InfoOf(const VolumeSource& stored, const FitsImage& image) {
    SourceInfo info = stored.info();
    info.note = image.grid.note;
    if (image.blank.has_value()) {
      info.type = RescaledType(info.type);
    }
    return info;
  }

  template <typename In, typename Out>
  void Convert(const char* in, std::size_t count, char* out) const {
    for (std::size_t i = 0; i < count; ++i) {
      const In value = base::LoadLittleEndian<In>(in + i * sizeof(In));
      const Out result = std::int64_t{value} == *blank_
                             ? std::numeric_limits<Out>::quiet_NaN()
                             : static_cast<Out>(slope_ * static_cast<double>(value) + intercept_);
      base::StoreLittleEndian(result, out + i * sizeof(Out));
    }
  }

  const std::unique_ptr<VolumeSource> stored_;
  const std::optional<std::int64_t> blank_;
  const double slope_;
  const double intercept_;
};

class FitsSeries final : public VolumeSeries {
 public:
  FitsSeries(SeriesInfo info, std::vector<FitsImage> images)
      : VolumeSeries(std::move(info)), images_(std::move(images)) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int /*component*/,
                                                     int /*step*/) override {
    const FitsImage& image = images_[static_cast<std::size_t>(field)];
    SampleLocation location = image.location;
    if (image.blank.has_value()) {
      location.slope = 1;
      location.intercept = 0;
    }
    const std::string name =
        images_.size() > 1 ? absl::StrCat(info().name, ":", image.field) : info().name;
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> source,
                              MakeFileSource(image.grid.geometry, location, name));
    if (image.wide.has_value()) {
      source = MakeWideSource(std::move(source), *image.wide);
    }
    return std::make_unique<FitsSource>(std::move(source), image);
  }

 private:
  const std::vector<FitsImage> images_;
};

std::string PrintableFitsName(const FitsPart& part) {
  return part.name.empty() ? absl::StrCat(part.number)
                           : absl::StrCat(base::PrintableAscii(part.name));
}

absl::Status NoSuchPart(const std::string& path, const std::string& wanted, const FitsFile& file) {
  std::vector<std::string> names;
  for (const FitsPart& part : file.parts) {
    if (IsFitsVolume(part) && names.size() < 50) {
      names.push_back(PrintableFitsName(part));
    }
  }
  return absl::NotFoundError(absl::StrFormat("%s: no image %s in %d parts; its volumes are %s",
                                             path, base::Quoted(wanted), file.parts.size(),
                                             names.empty() ? "none" : absl::StrJoin(names, ", ")));
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenFitsSeries(const std::string& path,
                                                             const std::string& part,
                                                             const std::string& field,
                                                             const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FitsFile file, ReadFitsFile(path));
  std::int64_t number = -1;
  const bool is_number = absl::SimpleAtoi(part, &number);
  std::vector<FitsImage> images;
  std::set<std::string> names;
  SeriesInfo info{.name = part.empty() ? path : absl::StrCat(path, ":", part)};
  absl::Status first_error;
  for (const FitsPart& each : file.parts) {
    const bool is_named = !each.name.empty() && absl::EqualsIgnoreCase(each.name, part);
    if (!part.empty() && !is_named && !(is_number && number == each.number)) {
      continue;
    }
    // Parts that are none have no samples: the first one of a file of extensions.
    const bool is_wanted = !part.empty() || IsFitsVolume(each);
    if (!is_wanted) {
      if (!each.axes.empty()) {
        first_error.Update(ReadFitsImage(path, file, each, rules).status());
      }
      continue;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(FitsImage image, ReadFitsImage(path, file, each, rules));
    std::string name = !each.name.empty() ? each.name
                       : each.number == 0 ? field
                                          : absl::StrCat(each.number);
    if (!base::IsPlain(name) || !names.insert(name).second) {
      name = absl::StrCat(each.number);
      names.insert(name);
    }
    image.field = name;
    if (!images.empty() && image.grid.geometry != images.front().grid.geometry) {
      info.fields_elsewhere.push_back(std::move(name));
      continue;
    }
    info.fields.push_back({.name = std::move(name), .unit = base::PrintableAscii(image.unit)});
    info.length_unit = base::PrintableAscii(image.grid.unit);
    images.push_back(std::move(image));
    if (!part.empty()) {
      break;
    }
  }
  if (images.empty()) {
    return !part.empty() ? NoSuchPart(path, part, file)
           : first_error.ok()
               ? absl::InvalidArgumentError(absl::StrCat(path, ": a FITS file without an image"))
               : first_error;
  }
  return std::make_unique<FitsSeries>(std::move(info), std::move(images));
}

}  // namespace isoscope::source
