// A frame has a plane of its own, or it lies along the normal n of the plane of the first one:
//
//   class              place of frame i                                   needs
//   functional groups  its own position                                   each frame its item
//   nuclear medicine   position + (slice of i - 1) d n                    SpacingBetweenSlices d
//   dose grids         position + (offset i - offset 0) n                 GridFrameOffsetVector
//   one image          its own position
//   others             position + i d n                                   SpacingBetweenSlices d
//
// n is the cross product of the directions of rows and columns. In nuclear medicine d may be
// negative: slices are then stacked against n. In all other classes a negative d has no meaning.
// SliceThickness (0018,0050) is no distance, and is not read.
//
//   position 30, d = -3, n = (0, 0, 1)        z of slices 1, 2, 3: 30, 27, 24
//
// Offsets of a dose grid count from the first frame on if the first one is 0. They may also be z on
// the patient; then the first one is the z of the position, and the orientation is 1\0\0\0\1\0.
//
// "Others" are files of many frames with one position, which no class of the standard has. So they
// are taken only if nothing says that their frames are moments or angles (FrameIncrementPointer).
//
// Source: DICOM PS3.3, C.7.6.2.1.1 and C.7.6.16.2 (planes), C.7.6.17 (dimensions), C.8.4.11 and 15
// (nuclear medicine), C.8.8.3.2 (dose grids), 10.7.1 (distances of pixels).

#include "core/formats/dicom/dicom_geometry.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>

#include "absl/algorithm/container.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/formats/dicom/dicom_storage.h"
#include "core/source/grid/sample_distance.h"

namespace isoscope::source {
namespace {

constexpr std::uint32_t kSliceVector = 0x00540080;

// An element as messages name it.
struct Element {
  const char* name;
  const char* tag;
  const char* values;     // "3 numbers"
  const char* example;    // for dcmodify, which writes it into the data set
  const char* also = "";  // what else to do
};
constexpr Element kPosition{"position", "(0020,0032)", "3 numbers", "10\\20\\30"};
constexpr Element kOrientation{"orientation", "(0020,0037)", "6 numbers", "1\\0\\0\\0\\1\\0"};
constexpr Element kPixelSpacing{"pixel spacing", "(0028,0030)", "2 numbers", "0.5\\0.5",
                                "; or give --spacing X,Y,Z"};
constexpr Element kSliceSpacing{"spacing between slices", "(0018,0088)", "a number", "1.5",
                                "; or give --spacing X,Y,Z"};
constexpr Element kOffsets{"grid frame offsets", "(3004,000c)", "a number for each frame",
                           "0\\3\\6"};

// An element that is there, but not as it should be.
absl::Status BrokenError(const std::string& name, const Element& element) {
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: its %s %s is there, but not as %s; correct it in the file%s", name,
                      element.name, element.tag, element.values, element.also));
}

absl::Status MissingError(const std::string& name, const Element& element,
                          absl::string_view more = "") {
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s has no %s %s%s: no slice of a volume, or one without its place; if you know it, add it, "
      "as dcmodify -i '%s=%s' does%s",
      name, element.name, element.tag, more, element.tag, element.example, element.also));
}

template <std::size_t kCount>
absl::Status CheckGiven(const DicomNumbers<kCount>& numbers, const std::string& name,
                        const Element& element, absl::string_view more = "") {
  return numbers.is_given()     ? absl::OkStatus()
         : numbers.is_missing() ? MissingError(name, element, more)
                                : BrokenError(name, element);
}

// The directions of rows and columns. Texts of few digits are a little off; GDCM, too, takes those
// within a thousandth as they are.
absl::StatusOr<math::Mat3d> DirectionOf(const DicomNumbers<6>& orientation,
                                        const std::string& name) {
  constexpr double kAsItIs = 1e-3;
  constexpr double kMost = 1e-2;
  const std::array<double, 6>& d = orientation.values;
  math::Vec3d row{d[0], d[1], d[2]};
  math::Vec3d column{d[3], d[4], d[5]};
  const double off = std::max({std::abs(math::Length(row) - 1), std::abs(math::Length(column) - 1),
                               std::abs(math::Dot(row, column))});
  if (!(off <= kMost)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: its orientation (0020,0037) is %s: rows of length %g and columns of %g, with a cosine "
        "of %g between them; expected length 1 and right angles (within 1 %%)",
        name, absl::StrJoin(d, "\\"), math::Length(row), math::Length(column),
        math::Dot(row, column)));
  }
  if (off > kAsItIs) {
    row = row * (1 / math::Length(row));
    column = column - row * math::Dot(row, column);
    column = column * (1 / math::Length(column));
  }
  math::Mat3d direction;
  direction.columns = {row, column, math::Cross(row, column)};
  return direction;
}

absl::Status CheckPixelSpacing(const DicomNumbers<2>& spacing, const std::string& name) {
  if (spacing.values[0] > 0 && spacing.values[1] > 0 && std::isfinite(spacing.values[0]) &&
      std::isfinite(spacing.values[1])) {
    return absl::OkStatus();
  }
  return NoSampleDistance(
      name, absl::StrCat("its pixel spacing (0028,0030) is ", absl::StrJoin(spacing.values, "\\")));
}

std::string FrameName(const std::string& path, std::size_t frame, std::size_t count) {
  return count == 1 ? absl::StrCat(path, ": the image")
                    : absl::StrFormat("%s: frame %d of %d", path, frame, count);
}

// "(0018,1063), (0018,1065)"
std::string NamesOf(const std::vector<std::uint32_t>& tags) {
  return absl::StrJoin(tags, ", ", [](std::string* out, std::uint32_t tag) {
    absl::StrAppendFormat(out, "(%04x,%04x)", tag >> 16, tag & 0xffff);
  });
}

absl::Status NoSlicesError(const DicomFrames& file, const std::string& path) {
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: its %d frames are no slices of a volume: %s tells them apart (0028,0009), as moments, "
      "angles or detectors; expected frames with positions, or the volume that was reconstructed "
      "from them",
      path, file.frames.size(), NamesOf(file.increments)));
}

// Distances of pixels that stand elsewhere than (0028,0030).
absl::StatusOr<DicomNumbers<2>> FallbackSpacing(const DicomFrames& file,
                                                absl::string_view storage_class,
                                                const std::string& path, bool has_spacing) {
  if (has_spacing) {
    return DicomNumbers<2>{.values = {1, 1}, .given = DicomGiven::kGiven};
  }
  if (IsSecondaryCaptureStorage(storage_class)) {
    return file.scanned_spacing;
  }
  const DicomFrame& first = file.frames.front();
  if (first.pixel_spacing.is_missing() && file.imager_spacing.is_given()) {
    return MissingError(absl::StrCat(path, ": the file"), kPixelSpacing,
                        ", but that of its detector (0018,1164), which magnifies");
  }
  return DicomNumbers<2>{};
}

// Returns the distance of each frame from the first plane, along the normal.
absl::StatusOr<std::vector<double>> OffsetsOfDose(const DicomFrames& file, const DicomPlane& first,
                                                  const std::string& path) {
  if (file.offsets != DicomGiven::kGiven) {
    const std::string name = absl::StrCat(path, ": the file");
    return file.offsets == DicomGiven::kMissing ? MissingError(name, kOffsets)
                                                : BrokenError(name, kOffsets);
  }
  std::vector<double> offsets;
  offsets.reserve(file.frames.size());
  for (const DicomFrame& frame : file.frames) {
    offsets.push_back(frame.offset);
  }
  const double tolerance = 1e-3 * std::abs(offsets[1] - offsets[0]);
  const bool is_relative = std::abs(offsets[0]) <= tolerance;
  const bool is_transverse =
      math::Length(first.direction.columns[0] - math::Vec3d{1, 0, 0}) < 1e-6 &&
      math::Length(first.direction.columns[1] - math::Vec3d{0, 1, 0}) < 1e-6;
  if (!is_relative && !(is_transverse && std::abs(offsets[0] - first.origin.z) <= tolerance)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: its grid frame offsets (3004,000c) begin with %g; expected 0, or %g, the z of its "
        "position, with the orientation 1\\0\\0\\0\\1\\0",
        path, offsets[0], first.origin.z));
  }
  for (std::size_t i = 2; i < offsets.size(); ++i) {
    if (!((offsets[i] - offsets[i - 1]) * (offsets[1] - offsets[0]) > 0)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: its grid frame offsets (3004,000c) go from %g to %g at frame %d, against their "
          "order; expected ascending or descending ones",
          path, offsets[i - 1], offsets[i], i));
    }
  }
  for (double& offset : offsets) {
    offset -= file.frames.front().offset;
  }
  return offsets;
}

// Returns the index of the dimension with this tag; the number of dimensions if there is none.
std::size_t DimensionOf(const DicomFrames& file, std::uint32_t tag) {
  return static_cast<std::size_t>(absl::c_find(file.dimensions, tag) - file.dimensions.begin());
}

bool IsSliceSpacing(double distance, bool is_nuclear) {
  return std::isfinite(distance) && (is_nuclear ? distance != 0 : distance > 0);
}

// The same by the distance between slices.
absl::StatusOr<std::vector<double>> OffsetsOfSlices(const DicomFrames& file, bool is_nuclear,
                                                    const std::string& path, bool has_spacing) {
  DicomNumbers<1> spacing = file.frames.front().slice_spacing;
  if (has_spacing && (!spacing.is_given() || !IsSliceSpacing(spacing.value(), is_nuclear))) {
    spacing = {.values = {1}, .given = DicomGiven::kGiven};
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckGiven(spacing, absl::StrCat(path, ": the file"), kSliceSpacing));
  const double distance = spacing.value();
  if (!IsSliceSpacing(distance, is_nuclear)) {
    return NoSampleDistance(
        path, absl::StrFormat("its spacing between slices (0018,0088) is %g", distance));
  }
  const std::size_t slices = DimensionOf(file, kSliceVector);
  std::vector<double> offsets;
  for (std::size_t i = 0; i < file.frames.size(); ++i) {
    const std::vector<std::uint32_t>& indices = file.frames[i].indices;
    const double slice = is_nuclear && slices < indices.size()
                             ? static_cast<double>(indices[slices]) - 1
                             : static_cast<double>(i);
    if (slice < 0) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: frame %d has the number 0 in its slice vector (0054,0080); expected 1 or more", path,
          i));
    }
    offsets.push_back(slice * distance);
  }
  return offsets;
}

bool IsDose(const DicomFrames& file, absl::string_view storage_class) {
  return IsDoseStorage(storage_class) || file.offsets != DicomGiven::kMissing;
}

// Checks that frames without functional groups are slices.
absl::Status CheckAreSlices(const DicomFrames& file, absl::string_view storage_class,
                            const std::string& path) {
  const bool has_slices = DimensionOf(file, kSliceVector) < file.dimensions.size();
  return file.increments.empty() || IsDose(file, storage_class) ||
                 (IsNuclearStorage(storage_class) && has_slices)
             ? absl::OkStatus()
             : NoSlicesError(file, path);
}

// Checks that the order of frames in their stacks is that of their places, up or down.
absl::Status CheckStacks(const DicomFrames& file, const std::vector<DicomPlane>& planes,
                         const std::string& path) {
  constexpr std::uint32_t kStack = 0x00209056;
  constexpr std::uint32_t kInStack = 0x00209057;
  const std::size_t stack = DimensionOf(file, kStack);
  const std::size_t in_stack = DimensionOf(file, kInStack);
  // The frames, by stack and then by the number in it.
  std::map<std::uint32_t, std::map<std::uint32_t, std::size_t>> frames;
  for (std::size_t i = 0; i < file.frames.size(); ++i) {
    const std::vector<std::uint32_t>& indices = file.frames[i].indices;
    if (in_stack >= indices.size() || indices[in_stack] == 0) {
      return absl::OkStatus();  // frames without numbers
    }
    const std::uint32_t number = stack < indices.size() ? indices[stack] : 0;
    const auto same = frames[number].emplace(indices[in_stack], i).first;
    if (math::Length(planes[i].origin - planes[same->second].origin) > 0.1 * planes[i].spacing.x) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: frames %d and %d have the same number in their stack (0020,9057), but lie %g apart",
          path, same->second, i, math::Length(planes[i].origin - planes[same->second].origin)));
    }
  }
  for (const auto& [number, places] : frames) {
    double direction = 0;
    const DicomPlane* before = nullptr;
    for (const auto& [index, frame] : places) {
      const double step = before == nullptr ? 0 : planes[frame].position - before->position;
      if (direction * step < 0) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "%s: frame %d is number %d of its stack (0020,9057), but its position (0020,0032) lies "
            "before that of the number before: one of the two is wrong",
            path, frame, index));
      }
      direction = direction == 0 ? step : direction;
      before = &planes[frame];
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<DicomPlane> PlaneOfDicomFrame(const DicomFrame& frame, const std::string& name,
                                             const DicomNumbers<2>& fallback, bool has_spacing) {
  ISOSCOPE_RETURN_IF_ERROR(CheckGiven(frame.position, name, kPosition));
  ISOSCOPE_RETURN_IF_ERROR(CheckGiven(frame.orientation, name, kOrientation));
  DicomNumbers<2> spacing = frame.pixel_spacing.is_missing() ? fallback : frame.pixel_spacing;
  const bool says_spacing =
      frame.pixel_spacing.is_given() && CheckPixelSpacing(frame.pixel_spacing, name).ok();
  if (has_spacing && !says_spacing) {
    spacing = {.values = {1, 1}, .given = DicomGiven::kGiven};
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckGiven(spacing, name, kPixelSpacing));
  ISOSCOPE_RETURN_IF_ERROR(CheckPixelSpacing(spacing, name));
  DicomPlane plane;
  plane.has_spacing = says_spacing || !has_spacing;
  const std::array<double, 3>& p = frame.position.values;
  plane.origin = {p[0], p[1], p[2]};
  plane.spacing = {spacing.values[1], spacing.values[0], 1};
  ISOSCOPE_ASSIGN_OR_RETURN(plane.direction, DirectionOf(frame.orientation, name));
  plane.position = math::Dot(plane.origin, plane.direction.columns[2]);
  return plane;
}

absl::StatusOr<std::vector<DicomPlane>> PlanesOfDicomFrames(const DicomFrames& file,
                                                            absl::string_view storage_class,
                                                            const std::string& path,
                                                            bool has_spacing) {
  const std::size_t count = file.frames.size();
  const bool has_groups = file.group_items > 0;
  if (has_groups && file.group_items != static_cast<std::int64_t>(count)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: functional groups (5200,9230) of %d frames, but %d frames (0028,0008): damaged", path,
        file.group_items, count));
  }
  const bool has_one_place = count > 1 && !has_groups;
  if (has_one_place) {
    ISOSCOPE_RETURN_IF_ERROR(CheckAreSlices(file, storage_class, path));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const DicomNumbers<2> fallback,
                            FallbackSpacing(file, storage_class, path, has_spacing));
  std::vector<DicomPlane> planes;
  for (std::size_t i = 0; i < count; ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        planes.emplace_back(),
        PlaneOfDicomFrame(file.frames[i], FrameName(path, i, count), fallback, has_spacing));
  }
  if (!has_one_place) {
    ISOSCOPE_RETURN_IF_ERROR(CheckStacks(file, planes, path));
    return planes;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::vector<double> offsets,
      IsDose(file, storage_class)
          ? OffsetsOfDose(file, planes.front(), path)
          : OffsetsOfSlices(file, IsNuclearStorage(storage_class), path, has_spacing));
  for (std::size_t i = 0; i < count; ++i) {
    const math::Vec3d normal = planes[i].direction.columns[2];
    planes[i].origin = planes[i].origin + normal * offsets[i];
    planes[i].position = math::Dot(planes[i].origin, normal);
  }
  return planes;
}

std::vector<double> RanksOfDicomFrames(const DicomFrames& file) {
  constexpr auto kSpace = std::to_array<std::uint32_t>(
      {kSliceVector, 0x00200032, 0x00200037, 0x00201041, 0x00209056, 0x00209057, 0x00209113,
       0x00209116, 0x0020930e, 0x0020930f, 0x00209301, 0x00209302});
  using Indices = std::vector<std::uint32_t>;
  std::map<Indices, double> ranks;  // of indices without those of space
  std::vector<Indices> own;
  for (const DicomFrame& frame : file.frames) {
    Indices indices;
    for (std::size_t i = 0; i < file.dimensions.size() && i < frame.indices.size(); ++i) {
      if (!absl::c_linear_search(kSpace, file.dimensions[i])) {
        indices.push_back(frame.indices[i]);
      }
    }
    if (indices.empty() ||
        absl::c_count(indices, 0U) == static_cast<std::ptrdiff_t>(indices.size())) {
      return {};
    }
    ranks[indices] = 0;
    own.push_back(std::move(indices));
  }
  double rank = 0;
  for (auto& [indices, its_rank] : ranks) {
    its_rank = rank++;
  }
  std::vector<double> result;
  result.reserve(own.size());
  for (const Indices& indices : own) {
    result.push_back(ranks.at(indices));
  }
  return result;
}

}  // namespace isoscope::source
