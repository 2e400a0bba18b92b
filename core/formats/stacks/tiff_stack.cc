// Finding the planes of a stack has three steps:
//
// 1. Walk through the pages of the first file, for their offsets, and read its head (tiff_file.h).
// 2. Find out which plane holds which slice, channel and step (stack_layout.h): from OME-XML, from
//    ImageJ's description, from LSM's tag, from --axes, else every page is a slice.
// 3. Check that each plane is on a page that exists. Pages of other files are checked when they are
//    read.
//
// ImageJ writes large stacks with the directory of the first page only; the samples of all follow
// each other raw.

#include "core/formats/stacks/tiff_stack.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/formats/stacks/imagej_stack.h"
#include "core/formats/stacks/lsm_stack.h"
#include "core/formats/stacks/ome_stack.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "core/source/bytes/stack_names.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxCompanionBytes = 64 * base::kMiB;

std::string BaseNameOf(const std::string& path) { return path.substr(path.rfind('/') + 1); }

absl::Status NamedStatus(const std::string& name, const absl::Status& status) {
  return status.ok() ? status
                     : absl::Status(status.code(), absl::StrCat(name, ": ", status.message()));
}

// The layout that OME-XML describes, in the file itself or in its companion, which is set.
absl::StatusOr<StackLayout> LayoutOfOme(const std::string& path, TiffStack* stack) {
  const std::string own_name = BaseNameOf(path);
  const auto planes = static_cast<std::int64_t>(stack->pages.offsets.size());
  ISOSCOPE_ASSIGN_OR_RETURN(OmeStack ome,
                            ParseOmeXml(stack->pages.description, path, own_name, planes));
  if (!ome.companion.empty()) {
    stack->companion = path.substr(0, path.rfind('/') + 1) + ome.companion;
    const std::string& companion = stack->companion;
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string xml,
                              io::ReadWholeFile(companion, kMaxCompanionBytes));
    ISOSCOPE_ASSIGN_OR_RETURN(ome, ParseOmeXml(xml, companion, own_name, planes));
    if (!ome.companion.empty()) {
      return absl::InvalidArgumentError(
          absl::StrCat(companion, ": OME-XML that names another file, ", ome.companion,
                       ", in its place; expected the tags of an image"));
    }
  }
  if (ome.size_x != stack->format.width || ome.size_y != stack->format.height) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: OME-XML says %d x %d samples, but its first page has %d x %d", path,
                        ome.size_x, ome.size_y, stack->format.width, stack->format.height));
  }
  return std::move(ome.layout);
}

// The layout as the head of the first file says it; not set if it says nothing.
absl::StatusOr<std::optional<StackLayout>> LayoutOfHead(const std::string& path, TiffStack* stack) {
  const TiffPages& pages = stack->pages;
  if (IsOmeXml(pages.description)) {
    ISOSCOPE_ASSIGN_OR_RETURN(StackLayout layout, LayoutOfOme(path, stack));
    return layout;
  }
  if (IsImageJDescription(pages.description)) {
    const char* const unit = pages.resolution_unit == RESUNIT_INCH         ? "in"
                             : pages.resolution_unit == RESUNIT_CENTIMETER ? "cm"
                                                                           : "";
    auto layout =
        ParseImageJ(pages.description,
                    PixelDensity{.x = pages.x_resolution, .y = pages.y_resolution, .unit = unit});
    ISOSCOPE_RETURN_IF_ERROR(NamedStatus(path, layout.status()));
    return *std::move(layout);
  }
  if (!pages.lsm.empty()) {
    auto layout = ParseLsm(pages.lsm);
    ISOSCOPE_RETURN_IF_ERROR(NamedStatus(path, layout.status()));
    return *std::move(layout);
  }
  return std::nullopt;
}

// Opens the first file and reads its head.
absl::StatusOr<TiffStack> ScanStack(const std::string& path, const std::string& name) {
  TiffStack stack{.name = name, .files = {path}};
  ISOSCOPE_ASSIGN_OR_RETURN(const TiffFile first, OpenTiff(path));
  const TiffFile& tiff = first;
  ISOSCOPE_ASSIGN_OR_RETURN(stack.pages, ScanTiffPages(tiff.get(), path));
  const bool shows_colours =
      IsImageJDescription(stack.pages.description) || !stack.pages.lsm.empty();
  stack.colours = shows_colours ? TiffColours::kForDisplay : TiffColours::kRefused;
  if (TIFFSetSubDirectory(tiff.get(), stack.pages.offsets.front()) == 0) {
    return TiffDamage(path);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(stack.format, FormatOfPage(tiff.get(), path, stack.colours));
  stack.is_big_endian = TIFFIsBigEndian(tiff.get()) != 0;
  return stack;
}

// All pages of the files are planes in a row.
absl::Status CheckSliceFiles(const std::vector<std::string>& files, const TiffStack& stack) {
  if (stack.pages.offsets.size() > 1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d pages in one of %d files; expected one file of many pages, or many "
                        "files of one page",
                        files[0], stack.pages.offsets.size(), files.size()));
  }
  const PageFormat& format = stack.format;
  for (const std::string& path : files) {
    ISOSCOPE_ASSIGN_OR_RETURN(const TiffFile tiff, OpenTiff(path));
    ISOSCOPE_ASSIGN_OR_RETURN(const PageFormat other,
                              FormatOfPage(tiff.get(), path, stack.colours));
    if (!(other == format)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %d x %d samples of %s, but %s has %d x %d of %s: expected slices of one size and "
          "type",
          path, other.width, other.height, other.type_name(), files[0], format.width, format.height,
          format.type_name()));
    }
  }
  return absl::OkStatus();
}

// The planes that a file of ImageJ holds behind its only directory; else those of its pages.
absl::StatusOr<std::int64_t> CountPlanes(std::int64_t described, TiffStack* stack) {
  const auto planes = static_cast<std::int64_t>(stack->pages.offsets.size()) * stack->format.planes;
  if (described <= planes || stack->pages.offsets.size() > 1 || stack->pages.raw_offset == 0 ||
      stack->format.planes != 1 || stack->format.is_bits) {
    return planes;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, io::OpenRandomAccessFile(stack->files.front()));
  stack->raw_offset = static_cast<std::int64_t>(stack->pages.raw_offset);
  const std::int64_t behind = file->size_bytes() - *stack->raw_offset;
  return std::min(described, behind / std::max<std::int64_t>(stack->format.plane_bytes(), 1));
}

// Checks that the planes are there, and gives the files of the layout their paths.
absl::Status CheckPlanes(const std::string& path, std::int64_t planes, TiffStack* stack) {
  StackLayout& layout = stack->layout;
  const std::string own_name = BaseNameOf(path);
  if (!layout.files.empty()) {
    const std::string folder = path.substr(0, path.rfind('/') + 1);
    stack->files.clear();
    stack->scanned_file = -1;
    for (const std::string& name : layout.files) {
      if (name == own_name) {
        stack->scanned_file = static_cast<std::int32_t>(stack->files.size());
      }
      stack->files.push_back(name == own_name ? path : folder + name);
      if (io::IsMounted(path) && !io::IsMounted(stack->files.back())) {
        return absl::InvalidArgumentError(
            absl::StrFormat("%s: is one of a set of files, as %s, which can't be read at an "
                            "address; bring them all "
                            "to a folder, each with: isoscope copy ADDRESS DIR",
                            path, stack->files.back()));
      }
      if (!io::PathExists(stack->files.back())) {
        return absl::NotFoundError(absl::StrFormat(
            "%s: no such file; %s names it: the files of a set must lie in one folder",
            stack->files.back(), path));
      }
    }
  }
  const auto unnamed = std::count_if(layout.planes.begin(), layout.planes.end(),
                                     [](const StackPlane& plane) { return plane.file < 0; });
  if (unnamed > 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: OME-XML: no TiffData names %d of the %d planes of %d slices, %d channels and %d steps",
        path, unnamed, layout.planes.size(), layout.slices, layout.channels, layout.steps));
  }
  for (const StackPlane& plane : layout.planes) {
    if (plane.file == stack->scanned_file && plane.index >= planes) {
      return absl::DataLossError(absl::StrFormat(
          "%s: %d planes, but its head says %d: %d channels, %d slices, %d frames: the file is cut,"
          " or %s",
          path, planes, layout.planes.size(), layout.channels, layout.slices, layout.steps,
          PagesAdvice(path)));
    }
  }
  return absl::OkStatus();
}

// Pixels of a print are 1 apart, and so are slices, which TIFF says nothing of. Pixels that are not
// square can't be. "" if they are.
std::string WhyNotSquare(const TiffPages& pages) {
  constexpr double kTolerance = 1e-3;
  const double x = pages.x_resolution;
  const double y = pages.y_resolution;
  return x > 0 && y > 0 && std::abs(x - y) > kTolerance * std::max(x, y)
             ? absl::StrFormat(
                   "pixels that are not square (XResolution %g, YResolution %g), and no "
                   "distance of slices",
                   x, y)
             : "";
}

// Takes the sizes of pixels that GeoTIFF has. Its z is 0 where slices are no heights: then they are
// as far apart as the user says. Places on the Earth are not read. False: there are none.
bool TakeModelScale(const TiffPages& pages, StackLayout* layout) {
  const std::vector<double>& scale = pages.model_scale;
  if (scale.empty() && !pages.has_model_matrix) {
    return false;
  }
  const bool is_whole =
      scale.size() == 3 && std::all_of(scale.begin(), scale.end(),
                                       [](double size) { return size > 0 && std::isfinite(size); });
  if (is_whole) {
    layout->spacing = {scale[0], scale[1], scale[2]};
  } else if (scale.empty()) {
    layout->distances = "GeoTIFF's ModelTransformation (34264), which is not read";
  } else {
    layout->distances =
        absl::StrCat("GeoTIFF's ModelPixelScale (33550) is ", absl::StrJoin(scale, " "));
  }
  return true;
}

// Lays the planes out; `described`: as the head of the first file says.
absl::Status LayOut(const std::vector<std::string>& files, const std::string& axes,
                    TiffStack* stack) {
  const std::string& path = files.front();
  std::optional<StackLayout> described;
  if (files.size() == 1) {
    auto head = LayoutOfHead(path, stack);
    if (!head.ok() && axes.empty()) {
      return absl::Status(head.status().code(), absl::StrCat(head.status().message(),
                                                             ": mend it, or ", PagesAdvice(path)));
    }
    described = head.ok() ? *std::move(head) : std::optional<StackLayout>();
  } else {
    if (axes.empty()) {
      ISOSCOPE_RETURN_IF_ERROR(CheckStackNames(stack->name, files));
    }
    ISOSCOPE_RETURN_IF_ERROR(CheckSliceFiles(files, *stack));
  }
  const bool is_known = described.has_value();
  if (is_known) {
    stack->layout = *std::move(described);
  } else if (!TakeModelScale(stack->pages, &stack->layout)) {
    stack->layout.distances = WhyNotSquare(stack->pages);
  }
  std::int64_t planes = static_cast<std::int64_t>(files.size());
  if (files.size() == 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        planes, CountPlanes(IsImageJDescription(stack->pages.description)
                                ? static_cast<std::int64_t>(stack->layout.planes.size())
                                : 0,
                            stack));
  }
  if (planes > kMaxStackPlanes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d planes; expected at most %d", path, planes, kMaxStackPlanes));
  }
  if (!axes.empty()) {
    ISOSCOPE_RETURN_IF_ERROR(
        NamedStatus(stack->name, ApplyPageAxes(axes, planes, is_known, &stack->layout)));
  } else if (!is_known) {
    stack->layout.slices = planes;
    LayPlanes("Z", &stack->layout);
  }
  if (files.size() > 1) {
    for (StackPlane& plane : stack->layout.planes) {
      plane = {.file = static_cast<std::int32_t>(plane.index), .index = 0};
    }
    stack->files = files;
    return absl::OkStatus();
  }
  return CheckPlanes(path, planes, stack);
}

}  // namespace

void TurnPages(std::uint16_t orientation, volume::GridGeometry* geometry) {
  // The directions of columns (index x) and rows (index y): 1 and -1 are along the world's x, 2 and
  // -2 along its y.
  struct Turn {
    int columns;
    int rows;
  };
  constexpr std::array<Turn, 8> kTurns{
      {{1, 2}, {-1, 2}, {-1, -2}, {1, -2}, {2, 1}, {2, -1}, {-2, -1}, {-2, 1}}};
  const Turn& turn = kTurns.at(orientation - std::size_t{1});
  for (const int index : {0, 1}) {
    const int run = index == 0 ? turn.columns : turn.rows;
    const int world = std::abs(run) - 1;
    math::Vec3d direction{0, 0, 0};
    direction[world] = run < 0 ? -1 : 1;
    geometry->direction.columns[static_cast<std::size_t>(index)] = direction;
    if (run < 0) {
      geometry->origin[world] +=
          geometry->spacing[index] * static_cast<double>(geometry->sample_dims[index] - 1);
    }
  }
}

absl::StatusOr<TiffStack> FindTiffStack(const std::vector<std::string>& files,
                                        const std::string& name, const std::string& axes) {
  if (files.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": no TIFF files"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(TiffStack stack, ScanStack(files.front(), name));
  ISOSCOPE_RETURN_IF_ERROR(LayOut(files, axes, &stack));
  return stack;
}

}  // namespace isoscope::source
