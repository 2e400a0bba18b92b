// A reconstruction of Bruker's ParaVision is a folder, pdata/1: 2dseq holds the samples, and
// visu_pars (jcamp_parameters.h) describes them:
//
//   ##$VisuCoreFrameCount=10
//   ##$VisuCoreDim=2                        a frame is a slice; 3: a volume
//   ##$VisuCoreSize=( 2 )                   samples of a frame along x, y (and z)
//   80 64
//   ##$VisuCoreExtent=( 2 )                 its size in mm, from border to border
//   44 44
//   ##$VisuCoreOrientation=( 5, 9 )         by slice: the directions of x, y and the normal
//   1 0 0 0 0 -1 0 1 0 ...
//   ##$VisuCorePosition=( 5, 3 )            by slice: its first corner; of a slice in its middle
//   -22 -21.2 -4 ...
//   ##$VisuCoreDataSlope=( 10 )             by frame: value = slope * stored + VisuCoreDataOffs
//   ##$VisuCoreWordType=_16BIT_SGN_INT
//   ##$VisuCoreByteOrder=littleEndian
//   ##$VisuFGOrderDesc=( 2 )                groups of frames, the fastest first
//   (5, <FG_SLICE>, <>, 0, 2) (2, <FG_ECHO>, <>, 2, 1)
//
// Slices of frames make a volume, by FG_SLICE. Images of several kinds, real and imaginary parts,
// and coils (FG_ISA, FG_COMPLEX, FG_COIL) make fields. All other groups make steps.
//
// Source: ITK's Bruker2dseqImageIO, which takes positions for corners, too. The one of ITK 5.2
// moves them by half a sample in a wrong direction where the axes are turned.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

#include "core/base/status_macros.h"
#include "core/formats/medical/jcamp_parameters.h"
#include "core/formats/medical/layout_formats.h"
#include "core/io/file.h"
#include "core/source/grid/affine_grid.h"
#include "core/source/grid/sample_distance.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxBrukerSize = 65'536;  // of an axis
constexpr std::int64_t kMaxBrukerFrames = 1'000'000;
constexpr std::size_t kMaxBrukerGroups = 16;
// Positions and directions are rounded texts, so they may deviate by this share of the distance.
constexpr double kMaxBrukerDeviation = 1e-3;

struct FrameGroup {
  std::int64_t count = 1;
  std::string name;  // "FG_SLICE"
};

// The place of the ")" that is not in a text "<...>"; npos if there is none.
std::size_t EndOfTuple(absl::string_view text) {
  bool is_text = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    is_text = text[i] == '<' || (is_text && text[i] != '>');
    if (!is_text && text[i] == ')') {
      return i;
    }
  }
  return absl::string_view::npos;
}

// None if frames have no groups.
absl::StatusOr<std::vector<FrameGroup>> ReadGroups(const JcampParameters& header) {
  std::vector<FrameGroup> groups;
  absl::string_view text = header.Text("VisuFGOrderDesc");
  while (!text.empty()) {
    if (groups.size() == kMaxBrukerGroups) {
      return header.Error(
          absl::StrFormat("VisuFGOrderDesc has more than %d groups of frames", kMaxBrukerGroups));
    }
    const std::size_t end = EndOfTuple(text);
    const std::vector<absl::string_view> parts = absl::StrSplit(text.substr(0, end), ',');
    const absl::string_view whole = text;
    FrameGroup group;
    if (end == text.npos || parts.size() < 2 || !absl::ConsumePrefix(&text, "(") ||
        !absl::SimpleAtoi(parts[0].substr(1), &group.count) || group.count < 1 ||
        group.count > kMaxBrukerFrames) {
      return header.Error(absl::StrFormat(
          "VisuFGOrderDesc has \"%s\"; expected (COUNT, <NAME>, ...)", whole.substr(0, 20)));
    }
    absl::string_view name = absl::StripAsciiWhitespace(parts[1]);
    absl::ConsumePrefix(&name, "<");
    absl::ConsumeSuffix(&name, ">");
    group.name = std::string(name);
    groups.push_back(std::move(group));
    text = absl::StripLeadingAsciiWhitespace(text.substr(end));
  }
  return groups;
}

absl::StatusOr<volume::ScalarType> BrukerType(const JcampParameters& header) {
  const absl::string_view type = header.Text("VisuCoreWordType");
  if (type == "_8BIT_UNSGN_INT") {
    return volume::ScalarType::kUint8;
  }
  if (type == "_8BIT_SGN_INT") {
    return volume::ScalarType::kInt8;
  }
  if (type == "_16BIT_SGN_INT") {
    return volume::ScalarType::kInt16;
  }
  if (type == "_32BIT_SGN_INT") {
    return volume::ScalarType::kInt32;
  }
  if (type == "_32BIT_FLOAT") {
    return volume::ScalarType::kFloat32;
  }
  return header.Error(absl::StrCat("VisuCoreWordType is \"", type.substr(0, 40),
                                   "\"; expected an integer of 8 to 32 bits or a float"));
}

// The order of the frames of a file.
struct FrameOrder {
  std::int64_t slices = 1;
  std::int64_t fields = 1;
  std::int64_t steps = 1;
  std::string field_name;
  std::vector<FrameGroup> groups;

  struct Place {
    std::int64_t slice = 0;
    std::int64_t field = 0;
    std::int64_t step = 0;
  };
  [[nodiscard]] Place PlaceOf(std::int64_t frame) const {
    Place place;
    std::int64_t field_stride = 1;
    std::int64_t step_stride = 1;
    for (const FrameGroup& group : groups) {
      const std::int64_t index = frame % group.count;
      frame /= group.count;
      if (group.name == "FG_SLICE") {
        place.slice = index;
      } else if (IsOfFields(group)) {
        place.field += index * field_stride;
        field_stride *= group.count;
      } else {
        place.step += index * step_stride;
        step_stride *= group.count;
      }
    }
    return place;
  }
  static bool IsOfFields(const FrameGroup& group) {
    return group.name == "FG_ISA" || group.name == "FG_COMPLEX" || group.name == "FG_COIL";
  }
};

absl::StatusOr<FrameOrder> OrderFrames(const JcampParameters& header, std::int64_t frames,
                                       bool is_sliced) {
  FrameOrder order;
  ISOSCOPE_ASSIGN_OR_RETURN(order.groups, ReadGroups(header));
  if (order.groups.empty() && frames > 1) {
    order.groups.push_back({.count = frames, .name = is_sliced ? "FG_SLICE" : "FG_CYCLE"});
  }
  std::int64_t product = 1;
  for (const FrameGroup& group : order.groups) {
    if (group.count > kMaxBrukerFrames / product) {
      product = 0;
      break;
    }
    product *= group.count;
    if (group.name == "FG_SLICE") {
      if (!is_sliced || order.slices > 1) {
        return header.Error("VisuFGOrderDesc has FG_SLICE twice, or in frames that are volumes");
      }
      order.slices = group.count;
    } else if (FrameOrder::IsOfFields(group)) {
      order.fields *= group.count;
      absl::StrAppend(&order.field_name, order.field_name.empty() ? "" : " ",
                      absl::AsciiStrToLower(group.name.substr(3)));
    } else {
      order.steps *= group.count;
    }
  }
  if (product != frames) {
    return header.Error(absl::StrFormat("VisuFGOrderDesc has %d frames; VisuCoreFrameCount is %d",
                                        product, frames));
  }
  return order;
}

// The positions of slices, from the first to the last. `numbers`: three for all, for each slice, or
// for each frame.
absl::StatusOr<std::vector<math::Vec3d>> SlicePositions(const JcampParameters& header,
                                                        const FrameOrder& order,
                                                        const std::vector<double>& numbers) {
  const auto count = static_cast<std::int64_t>(numbers.size() / 3);
  const auto at = [&](std::int64_t i) {
    const auto first = static_cast<std::size_t>(3 * i);
    return math::Vec3d{numbers[first], numbers[first + 1], numbers[first + 2]};
  };
  if (count == order.slices) {
    std::vector<math::Vec3d> positions;
    for (std::int64_t i = 0; i < count; ++i) {
      positions.push_back(at(i));
    }
    return positions;
  }
  std::vector<std::optional<math::Vec3d>> found(static_cast<std::size_t>(order.slices));
  for (std::int64_t frame = 0; frame < count; ++frame) {
    std::optional<math::Vec3d>& known = found[static_cast<std::size_t>(order.PlaceOf(frame).slice)];
    if (known.has_value() && !(*known == at(frame))) {
      return header.Error(absl::StrFormat(
          "frame %d lies at (%g, %g, %g), one of the same slice before at (%g, %g, %g); expected "
          "volumes in one place",
          frame, at(frame).x, at(frame).y, at(frame).z, known->x, known->y, known->z));
    }
    known = at(frame);
  }
  std::vector<math::Vec3d> positions;
  for (const std::optional<math::Vec3d>& known : found) {
    if (!known.has_value()) {
      return header.Error("VisuCorePosition is one for all slices; expected one for each");
    }
    positions.push_back(*known);
  }
  return positions;
}

// The vector from each slice to the next. INVALID_ARGUMENT unless all are equal, and along the
// normal.
absl::StatusOr<math::Vec3d> SliceStep(const JcampParameters& header,
                                      const std::vector<math::Vec3d>& positions,
                                      const math::Vec3d& normal) {
  const math::Vec3d step = positions[1] - positions[0];
  const double distance = math::Length(step);
  if (!(std::abs(math::Dot(step, normal)) >= distance * (1 - kMaxBrukerDeviation)) ||
      !(distance > 0)) {
    return header.Error(absl::StrFormat(
        "slices go on by (%g, %g, %g), but their normal is (%g, %g, %g): old versions of "
        "ParaVision write positions that do not fit; export the scan as DICOM",
        step.x, step.y, step.z, normal.x, normal.y, normal.z));
  }
  for (std::size_t i = 2; i < positions.size(); ++i) {
    const math::Vec3d other = positions[i] - positions[i - 1];
    if (math::Length(other - step) > kMaxBrukerDeviation * distance) {
      return header.Error(absl::StrFormat(
          "slices %d and %d are (%g, %g, %g) apart, the first two (%g, %g, %g); expected slices at "
          "equal distances",
          i - 1, i, other.x, other.y, other.z, step.x, step.y, step.z));
    }
  }
  return step;
}

absl::StatusOr<std::array<math::Vec3d, 3>> BrukerAxes(const JcampParameters& header,
                                                      const std::vector<double>& numbers) {
  for (std::size_t i = 9; i < numbers.size(); ++i) {
    if (std::abs(numbers[i] - numbers[i % 9]) > kMaxBrukerDeviation) {
      return header.Error(
          "slices of several orientations, as of a localizer; expected one for a volume: export "
          "the scan as DICOM");
    }
  }
  std::array<math::Vec3d, 3> axes;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    axes.at(axis) = {numbers[3 * axis], numbers[3 * axis + 1], numbers[3 * axis + 2]};
    if (std::abs(math::Length(axes.at(axis)) - 1) > kMaxBrukerDeviation) {
      return header.Error(
          absl::StrFormat("VisuCoreOrientation has a direction of length %g; expected 1",
                          math::Length(axes.at(axis))));
    }
  }
  return axes;
}

// Sets the grid of frames of these sizes.
absl::Status SetBrukerGrid(const JcampParameters& header, const FrameOrder& order,
                           std::int64_t frames, const std::vector<double>& sizes,
                           const std::string& path, FileLayout* layout) {
  const bool is_sliced = sizes.size() == 2;
  const auto slices = static_cast<std::size_t>(order.slices);
  const auto all = static_cast<std::size_t>(frames);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> extent,
                            header.Numbers("VisuCoreExtent", {sizes.size()}));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> directions,
                            header.Numbers("VisuCoreOrientation", {9, 9 * slices, 9 * all}));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> corners,
                            header.Numbers("VisuCorePosition", {3, 3 * slices, 3 * all}));
  ISOSCOPE_ASSIGN_OR_RETURN(const auto axes, BrukerAxes(header, directions));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<math::Vec3d> positions,
                            SlicePositions(header, order, corners));
  std::array<math::Vec3d, 3> steps;
  math::Index3 dims{1, 1, order.slices};
  math::Vec3d first = positions.front();
  for (std::size_t axis = 0; axis < sizes.size(); ++axis) {
    const absl::Status good = CheckSampleDistance(
        path, absl::StrFormat("number %d of VisuCoreExtent", axis + 1), extent[axis]);
    layout->faults.distances.Update(good);
    dims[static_cast<int>(axis)] = static_cast<std::int64_t>(sizes[axis]);
    steps.at(axis) = axes.at(axis) * (good.ok() ? extent[axis] / sizes[axis] : 1);
    first = first + steps.at(axis) * 0.5;  // from the corner to the middle of the first sample
  }
  if (is_sliced) {
    steps[2] = axes[2];  // of one slice, which is refused by its number
  }
  if (is_sliced && slices > 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(steps[2], SliceStep(header, positions, axes[2]));
  }
  AffineRows rows;
  for (int world = 0; world < 3; ++world) {
    rows.at(static_cast<std::size_t>(world)) = {steps[0][world], steps[1][world], steps[2][world],
                                                first[world]};
  }
  ISOSCOPE_ASSIGN_OR_RETURN(layout->geometry,
                            GridFromAffine(dims, rows, PatientWorld::kLps, path, &layout->faults));
  layout->shear = FindShear(rows);
  return absl::OkStatus();
}

// The planes of all volumes, z fastest.
absl::Status SetBrukerSlices(const JcampParameters& header, const FrameOrder& order,
                             std::int64_t frames, std::int64_t planes_of_frame,
                             FileLayout* layout) {
  const auto all = static_cast<std::size_t>(frames);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> slopes,
                            header.Numbers("VisuCoreDataSlope", {0, 1, all}));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> offsets,
                            header.Numbers("VisuCoreDataOffs", {0, 1, all}));
  const auto of = [](const std::vector<double>& numbers, std::int64_t frame, double absent) {
    return numbers.empty() ? absent
                           : numbers[numbers.size() == 1 ? 0 : static_cast<std::size_t>(frame)];
  };
  const bool is_reversed = header.Text("VisuCoreDiskSliceOrder") == "disk_reverse_slice_order";
  const math::Index3& dims = layout->geometry.sample_dims;
  const std::int64_t plane_bytes =
      dims.x * dims.y * static_cast<std::int64_t>(volume::SizeOf(layout->location.stored_type));
  layout->slices.resize(static_cast<std::size_t>(frames * planes_of_frame));
  for (std::int64_t frame = 0; frame < frames; ++frame) {
    const FrameOrder::Place place = order.PlaceOf(frame);
    for (std::int64_t plane = 0; plane < planes_of_frame; ++plane) {
      const std::int64_t stored = place.slice + plane;  // one of them is 0
      const std::int64_t z = is_reversed ? dims.z - 1 - stored : stored;
      layout->slices[static_cast<std::size_t>((place.field * order.steps + place.step) * dims.z +
                                              z)] = {
          .offset = (frame * planes_of_frame + plane) * plane_bytes,
          .rescaling = {.slope = of(slopes, frame, 1), .intercept = of(offsets, frame, 0)}};
    }
  }
  return absl::OkStatus();
}

}  // namespace

bool IsBrukerHeader(absl::string_view head) {
  return absl::StartsWith(head, "##TITLE=Parameter List, ParaVision") ||
         (absl::StartsWith(head, "##TITLE") && absl::StrContains(head, "##$VisuVersion"));
}

absl::StatusOr<FileLayout> ReadBrukerLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const JcampParameters header, ReadJcampParameters(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t axes, header.Count("VisuCoreDim", 3));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t frames,
                            header.Count("VisuCoreFrameCount", kMaxBrukerFrames));
  const absl::string_view kinds = header.Text("VisuCoreDimDesc");
  if (axes == 1 || (!kinds.empty() && absl::StrContains(kinds, "spectroscopic"))) {
    return header.Error(
        absl::StrFormat("%d axes (%s); expected two or three in space", axes, kinds.substr(0, 60)));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> sizes,
                            header.Numbers("VisuCoreSize", {static_cast<std::size_t>(axes)}));
  for (const double size : sizes) {
    if (!(size >= 1 && size <= kMaxBrukerSize) || size != std::floor(size)) {
      return header.Error(
          absl::StrFormat("VisuCoreSize has %g; expected 1 to %d samples", size, kMaxBrukerSize));
    }
  }
  const bool is_sliced = axes == 2;
  ISOSCOPE_ASSIGN_OR_RETURN(const FrameOrder order, OrderFrames(header, frames, is_sliced));
  const std::int64_t planes_of_frame = is_sliced ? 1 : static_cast<std::int64_t>(sizes[2]);
  if (frames > kMaxBrukerFrames / planes_of_frame) {
    return header.Error(absl::StrFormat("%d frames of %d planes; expected at most %d planes",
                                        frames, planes_of_frame, kMaxBrukerFrames));
  }
  FileLayout layout{.steps = order.steps, .length_unit = "mm"};
  for (std::int64_t field = 0; order.fields > 1 && field < order.fields; ++field) {
    layout.fields.push_back(absl::StrCat(order.field_name, " ", field + 1));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(layout.location.stored_type, BrukerType(header));
  const absl::string_view bytes = header.Text("VisuCoreByteOrder");
  if (bytes != "littleEndian" && bytes != "bigEndian") {
    return header.Error(absl::StrCat("VisuCoreByteOrder is \"", bytes.substr(0, 40),
                                     "\"; expected littleEndian or bigEndian"));
  }
  layout.location.is_big_endian = bytes == "bigEndian";
  ISOSCOPE_RETURN_IF_ERROR(SetBrukerGrid(header, order, frames, sizes, path, &layout));
  ISOSCOPE_RETURN_IF_ERROR(SetBrukerSlices(header, order, frames, planes_of_frame, &layout));
  const std::string samples = path.substr(0, path.rfind('/') + 1) + "2dseq";
  if (!io::PathExists(samples)) {
    return absl::NotFoundError(absl::StrCat(path, ": its data file ", samples, " does not exist"));
  }
  layout.location.files = {samples};
  return layout;
}

}  // namespace isoscope::source
