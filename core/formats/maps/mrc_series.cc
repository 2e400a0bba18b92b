// An MRC file is a header of 1024 bytes, an extended header, and the samples. Words of the header
// have 4 bytes, and are counted from 1:
//
//   1-3    NC NR NS       columns, rows and sections in the file, columns fastest
//   4      MODE           the sample type
//   5-7    NSTART         number of the first column, row and section on the cell's grid
//   8-10   MX MY MZ       samples of the grid along the cell's axes X, Y and Z
//   11-16  CELLA, CELLB   lengths of the cell in angstroms; its angles alpha, beta, gamma
//   17-19  MAPC MAPR MAPS the cell's axis (1 X, 2 Y, 3 Z) of columns, rows and sections
//   23     ISPG           space group; 401 to 630: a stack of volumes of MZ sections each
//   24     NSYMBT         bytes of the extended header
//   39, 40 IMOD's stamp and flags: bit 0 set if samples of mode 0 are signed
//   50-52  ORIGIN         world position of the first sample, X Y Z, in angstroms
//   53, 54 "MAP ", and the machine stamp: 0x44 little-endian, 0x11 big-endian
//
// The order of axes moves no sample: the directions of the grid are those of the axes.
//
// Sources: Cheng et al. 2015, "MRC2014"; https://www.ccpem.ac.uk/mrc_format/mrc2014.php;
// https://www.ccp4.ac.uk/html/maplib.html; IMOD's mrc_format. ORIGIN before NSTART, as in ChimeraX.

#include "core/formats/maps/mrc_series.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/math/elementary.h"
#include "core/source/bytes/file_start.h"
#include "core/source/bytes/located_series.h"
#include "core/source/grid/grid_faults.h"
#include "core/source/grid/sample_distance.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMrcHeaderBytes = 1024;
constexpr std::int64_t kMaxMrcSteps = 100'000;

// The header's words in one byte order.
class MrcHeader {
 public:
  // REQUIRES: kMrcHeaderBytes bytes.
  MrcHeader(absl::string_view bytes, bool is_big_endian)
      : bytes_(bytes), is_big_endian_(is_big_endian) {}

  [[nodiscard]] bool is_big_endian() const { return is_big_endian_; }
  // `word` counts from 1.
  [[nodiscard]] std::int32_t Integer(std::size_t word) const {
    const auto bits = base::LoadLittleEndian<std::uint32_t>(bytes_.data() + 4 * (word - 1));
    return std::bit_cast<std::int32_t>(is_big_endian_ ? __builtin_bswap32(bits) : bits);
  }
  [[nodiscard]] double Number(std::size_t word) const {
    return static_cast<double>(std::bit_cast<float>(Integer(word)));
  }
  // Returns true if the numbers make sense in this byte order.
  [[nodiscard]] bool is_plausible() const {
    constexpr std::int32_t kMaxAxis = 1 << 24;
    constexpr std::int32_t kMaxMode = 127;
    for (const std::size_t word : {1U, 2U, 3U}) {
      if (Integer(word) < 1 || Integer(word) > kMaxAxis) {
        return false;
      }
    }
    for (const std::size_t word : {17U, 18U, 19U}) {
      if (Integer(word) < 0 || Integer(word) > 3) {
        return false;
      }
    }
    return Integer(4) >= 0 && Integer(4) <= kMaxMode;
  }

 private:
  absl::string_view bytes_;
  bool is_big_endian_;
};

// The order that the machine stamp says, or the other one if only that makes sense.
std::optional<MrcHeader> FindMrcHeader(absl::string_view head) {
  constexpr std::size_t kMapOffset = 208;
  constexpr std::size_t kStampOffset = 212;
  constexpr char kBigStamp = 0x11;
  if (head.size() < kMrcHeaderBytes || head.substr(kMapOffset, 3) != "MAP") {
    return std::nullopt;
  }
  const bool is_big = head[kStampOffset] == kBigStamp;
  for (const bool is_big_endian : {is_big, !is_big}) {
    const MrcHeader header(head, is_big_endian);
    if (header.is_plausible()) {
      return header;
    }
  }
  return std::nullopt;
}

struct MrcType {
  volume::ScalarType scalar;
  std::optional<WideType> wide = std::nullopt;
};

absl::StatusOr<MrcType> MrcTypeOf(const MrcHeader& header) {
  using volume::ScalarType;
  constexpr std::int32_t kImodStamp = 1146047817;  // "IMOD"
  switch (header.Integer(4)) {
    case 0:
      return MrcType{header.Integer(39) == kImodStamp && header.Integer(40) % 2 == 0
                         ? ScalarType::kUint8
                         : ScalarType::kInt8};
    case 1:
      return MrcType{ScalarType::kInt16};
    case 2:
      return MrcType{ScalarType::kFloat32};
    case 6:
      return MrcType{ScalarType::kUint16};
    case 12:
      return MrcType{CarrierType(WideType::kFloat16), WideType::kFloat16};
    default:
      break;
  }
  const std::int32_t mode = header.Integer(4);
  return absl::InvalidArgumentError(absl::StrFormat(
      "samples of mode %d%s; expected 0 (int8), 1 (int16), 2 (float32), 6 (uint16) or 12 "
      "(float16): convert it, as newstack -mode 2 of IMOD does",
      mode,
      mode == 3 || mode == 4 ? " (complex numbers: a Fourier transform)"
      : mode == 101          ? " (4 bits, two samples a byte)"
                             : ""));
}

// Returns the axes of the cell along which columns, rows and sections run, from 0.
absl::StatusOr<std::array<int, 3>> MrcAxes(const MrcHeader& header) {
  std::array<int, 3> axes{header.Integer(17) - 1, header.Integer(18) - 1, header.Integer(19) - 1};
  if (axes == std::array<int, 3>{-1, -1, -1}) {
    return std::array<int, 3>{0, 1, 2};
  }
  std::array<int, 3> sorted = axes;
  std::sort(sorted.begin(), sorted.end());
  if (sorted != std::array<int, 3>{0, 1, 2}) {
    return absl::InvalidArgumentError(
        absl::StrFormat("MAPC, MAPR and MAPS are %d, %d and %d; expected 1, 2 and 3 in some order",
                        axes[0] + 1, axes[1] + 1, axes[2] + 1));
  }
  return axes;
}

// The directions of the cell's axes: X along world x, Y in the plane of world x and y.
math::Mat3d CellDirections(const MrcHeader& header, GridFaults* faults) {
  std::array<double, 3> angles{header.Number(14), header.Number(15), header.Number(16)};
  if (angles == std::array<double, 3>{0, 0, 0}) {
    angles = {90, 90, 90};
  }
  if (angles == std::array<double, 3>{90, 90, 90}) {
    return math::Mat3d{};
  }
  const auto cosine = [](double degrees) { return math::Cos(degrees * std::numbers::pi / 180); };
  const double a = cosine(angles[0]);
  const double b = cosine(angles[1]);
  const double c = cosine(angles[2]);
  const double sine = std::sqrt(1 - c * c);
  const double y = (a - b * c) / sine;
  const double z = std::sqrt(1 - b * b - y * y);
  constexpr double kFlat = 1e-3;
  const bool is_angle = std::all_of(angles.begin(), angles.end(),
                                    [](double angle) { return angle > 0 && angle < 180; });
  if (!is_angle || !(sine > kFlat) || !(z > kFlat)) {
    faults->directions.Update(
        NoDirections("", absl::StrFormat("cell angles %g, %g and %g degrees: they span no cell",
                                         angles[0], angles[1], angles[2])));
    return math::Mat3d{};
  }
  return math::Mat3d{.columns = {{{1, 0, 0}, {c, sine, 0}, {b, y, z}}}};
}

// Returns the distance of samples along each of the cell's axes; all 1 without a cell.
math::Vec3d CellSpacing(const MrcHeader& header, const std::array<int, 3>& axes, bool* has_cell,
                        GridFaults* faults) {
  const math::Vec3d cell{header.Number(11), header.Number(12), header.Number(13)};
  *has_cell = cell != math::Vec3d{0, 0, 0};
  const bool has_grid = header.Integer(8) != 0 || header.Integer(9) != 0 || header.Integer(10) != 0;
  math::Vec3d spacing{1, 1, 1};
  for (int i = 0; *has_cell && i < 3; ++i) {
    const int axis = axes[static_cast<std::size_t>(i)];
    const auto word = static_cast<std::size_t>(axis);
    // Some programs leave out all three.
    const std::int32_t samples =
        header.Integer(has_grid ? 8 + word : 1 + static_cast<std::size_t>(i));
    spacing[axis] = cell[axis] / samples;
    if (!(samples > 0) || !(cell[axis] > 0) || !std::isfinite(cell[axis])) {
      faults->distances.Update(NoSampleDistance(
          "", absl::StrFormat("a cell of %g x %g x %g angstroms with %d x %d x %d samples, which "
                              "is no cell (one of 0 x 0 x 0 means none)",
                              cell.x, cell.y, cell.z, header.Integer(8), header.Integer(9),
                              header.Integer(10))));
      *has_cell = false;
      return {1, 1, 1};
    }
  }
  return spacing;
}

absl::StatusOr<volume::GridGeometry> MrcGeometry(const MrcHeader& header, std::int64_t sections,
                                                 const GridRules& rules, bool* has_cell) {
  GridFaults faults;
  ISOSCOPE_ASSIGN_OR_RETURN(const auto axes, MrcAxes(header));
  const math::Mat3d directions = CellDirections(header, &faults);
  const math::Vec3d spacing = CellSpacing(header, axes, has_cell, &faults);
  volume::GridGeometry geometry;
  geometry.sample_dims = {header.Integer(1), header.Integer(2), sections};
  const math::Vec3d origin{header.Number(50), header.Number(51), header.Number(52)};
  const bool has_origin = origin != math::Vec3d{0, 0, 0};
  geometry.origin = origin;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto index = static_cast<int>(i);
    const int axis = axes[i];
    geometry.spacing[index] = spacing[axis];
    geometry.direction.columns[i] = directions.columns[static_cast<std::size_t>(axis)];
    if (!has_origin) {
      geometry.origin =
          geometry.origin + geometry.direction.columns[i] * (spacing[axis] * header.Integer(5 + i));
    }
  }
  ReplaceFaults("", &geometry, &faults);
  ISOSCOPE_RETURN_IF_ERROR(faults.Check(rules, ""));
  return geometry;
}

absl::StatusOr<LocatedFile> LocateMrc(const FileStart& head, const std::string& path,
                                      const std::string& field, const GridRules& rules) {
  const std::optional<MrcHeader> header = FindMrcHeader(head.bytes);
  if (!header.has_value()) {
    return absl::InvalidArgumentError(
        "no MRC file: its first 1024 bytes have no \"MAP\" at byte 208, or sizes, mode and axes "
        "make no sense in either byte order; to read it as raw samples rename it to end in .raw, "
        "and "
        "give --dims and --type");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const MrcType type, MrcTypeOf(*header));
  constexpr std::int32_t kFirstStack = 401;
  constexpr std::int32_t kLastStack = 630;
  const bool is_stack = header->Integer(23) >= kFirstStack && header->Integer(23) <= kLastStack;
  const std::int64_t all_sections = header->Integer(3);
  const std::int64_t sections = is_stack ? header->Integer(10) : all_sections;
  if (sections < 1 || all_sections % sections != 0 || all_sections / sections > kMaxMrcSteps) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "a stack of volumes (space group %d) of %d sections each, with %d sections in all; "
        "expected 1 to %d whole volumes",
        header->Integer(23), sections, all_sections, kMaxMrcSteps));
  }
  if (header->Integer(24) < 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("an extended header of %d bytes; expected 0 or more", header->Integer(24)));
  }
  LocatedFile located{.info = {.name = path}};
  bool has_cell = false;
  ISOSCOPE_ASSIGN_OR_RETURN(located.geometry, MrcGeometry(*header, sections, rules, &has_cell));
  located.info.length_unit = has_cell ? "angstrom" : "";
  const std::int64_t volumes = all_sections / sections;
  for (std::int64_t i = 0; volumes > 1 && i < volumes; ++i) {
    located.info.times.push_back(static_cast<double>(i));
  }
  const std::int64_t start = static_cast<std::int64_t>(kMrcHeaderBytes) + header->Integer(24);
  located.Add({.name = field},
              {.location = SampleLocation{.files = {path},
                                          .offset = head.is_gzip ? 0 : start,
                                          .encoding = head.is_gzip ? SampleEncoding::kDeflate
                                                                   : SampleEncoding::kRaw,
                                          .decoded_skip = head.is_gzip ? start : 0,
                                          .is_big_endian = header->is_big_endian(),
                                          .stored_type = type.scalar,
                                          .volume_count = volumes},
               .wide = type.wide});
  return located;
}

}  // namespace

bool IsMrcHeader(absl::string_view head) { return FindMrcHeader(head).has_value(); }

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenMrcSeries(const std::string& file,
                                                            const std::string& field,
                                                            const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FileStart head, ReadFileStart(file, kMrcHeaderBytes));
  auto located = LocateMrc(head, file, field, rules);
  if (!located.ok()) {
    return absl::Status(located.status().code(),
                        absl::StrCat(file, ": ", located.status().message()));
  }
  return MakeLocatedSeries(*std::move(located));
}

}  // namespace isoscope::source
