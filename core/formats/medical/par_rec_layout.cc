// PAR/REC is an export of Philips scanners: .PAR is text, .REC the slices, one behind the other.
//
//   # CLINICAL TRYOUT             Research image export tool     V4.2
//   .    Angulation midslice(ap,fh,rl)[degr]:   -13.265  0.000  0.000
//   .    Off Centre midslice(ap,fh,rl) [mm] :   2.508  30.339  -16.032
//   .    Max. number of slices/locations    :   9
//     1   1    1  1 0 2     0  16    62   64   64 ...     one line a slice, numbers by column
//
// A slice is at index * bytes of a slice in the REC file. Its values are those of the console:
// rescale slope * stored + rescale intercept. Slices with equal keys (echo, dynamic, ...) are a
// volume; steps and fields are made of the keys:
//
//   image type and scanning sequence     fields: magnitude, real, imaginary, phase
//   the only other key that varies       steps; times from dynamics, echoes and cardiac phases
//   echoes, with others                  fields, too
//   several others                       steps, by their order
//   diffusion of version 4               steps by b factor, then as they come: it has no numbers
//
// The transform is made of the angulation and the centre in the scanner's axes (posterior,
// superior, left), and the way that slices lie in them. The angulation and the centre of each slice
// only show whether they are of one stack. Source: nibabel's parrec.py.

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/formats/medical/layout_formats.h"
#include "core/io/file.h"
#include "core/math/elementary.h"
#include "core/math/matrix.h"
#include "core/source/bytes/text_header.h"
#include "core/source/grid/affine_grid.h"
#include "core/source/grid/sample_distance.h"

namespace isoscope::source {
namespace {

// Columns of a line, from 0 on.
enum Column : std::size_t {
  kSlice = 0,
  kEcho = 1,
  kDynamic = 2,
  kPhase = 3,
  kType = 4,
  kSequence = 5,
  kIndex = 6,
  kPixelBits = 7,
  kWidth = 9,
  kHeight = 10,
  kIntercept = 11,
  kSlope = 12,
  kAngulation = 16,  // of three angles
  kOffCentre = 19,   // of three coordinates
  kThickness = 22,
  kGap = 23,
  kOrientation = 25,
  kSpacingX = 28,
  kSpacingY = 29,
  kEchoTime = 30,
  kDynamicTime = 31,
  kTriggerTime = 32,
  kDiffusionFactor = 33,
  kMinColumns = 41,  // of version 4
  kDiffusionValue = 41,
  kGradient = 42,
  kLabel = 48,
};

struct ColumnName {
  std::size_t column;
  const char* name;
  // Others than finite numbers are faults of the grid; in the other columns they are errors.
  bool is_distance = false;
};
// The columns that are read. The others may hold anything, as those of texts in version 4.1.
constexpr std::array<ColumnName, 30> kColumnNames{{{kSlice, "slice number"},
                                                   {kEcho, "echo number"},
                                                   {kDynamic, "dynamic scan number"},
                                                   {kPhase, "cardiac phase number"},
                                                   {kType, "image type"},
                                                   {kSequence, "scanning sequence"},
                                                   {kIndex, "index in REC file"},
                                                   {kPixelBits, "image pixel size"},
                                                   {kWidth, "recon resolution x"},
                                                   {kHeight, "recon resolution y"},
                                                   {kIntercept, "rescale intercept"},
                                                   {kSlope, "rescale slope"},
                                                   {kAngulation, "image angulation ap"},
                                                   {kAngulation + 1, "image angulation fh"},
                                                   {kAngulation + 2, "image angulation rl"},
                                                   {kOffCentre, "image offcentre ap"},
                                                   {kOffCentre + 1, "image offcentre fh"},
                                                   {kOffCentre + 2, "image offcentre rl"},
                                                   {kThickness, "slice thickness", true},
                                                   {kGap, "slice gap", true},
                                                   {kOrientation, "slice orientation"},
                                                   {kSpacingX, "pixel spacing x", true},
                                                   {kSpacingY, "pixel spacing y", true},
                                                   {kEchoTime, "echo time"},
                                                   {kDynamicTime, "dynamic scan begin time"},
                                                   {kTriggerTime, "trigger time"},
                                                   {kDiffusionFactor, "diffusion b factor"},
                                                   {kDiffusionValue, "diffusion b value number"},
                                                   {kGradient, "gradient orientation number"},
                                                   {kLabel, "label type"}}};

struct ParHeader {
  std::map<std::string, std::string> fields;  // by the text before the colon
  std::vector<std::vector<double>> lines;     // columns that are not read may be 0

  [[nodiscard]] std::vector<double> Numbers(absl::string_view key) const {
    std::vector<double> numbers;
    for (const auto& [name, value] : fields) {
      if (absl::StartsWith(name, key)) {
        for (const absl::string_view word : absl::StrSplit(value, ' ', absl::SkipEmpty())) {
          if (!absl::SimpleAtod(word, &numbers.emplace_back())) {
            return {};
          }
        }
        break;
      }
    }
    return numbers;
  }
};

absl::Status ParError(const std::string& path, const std::string& what) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": PAR header: ", what));
}

// The columns of line `number` of the images, from 1 on.
absl::StatusOr<std::vector<double>> ParImageLine(absl::string_view line, std::size_t number,
                                                 const std::string& path) {
  const std::vector<absl::string_view> words =
      absl::StrSplit(line, absl::ByAnyChar(" \t"), absl::SkipEmpty());
  if (words.size() < kMinColumns) {
    return ParError(path, absl::StrFormat("line %d of images has %d columns; expected %d or more "
                                          "(version 4 or later), or it is cut",
                                          number, words.size(), kMinColumns));
  }
  std::vector<double> columns(words.size(), 0);
  for (const ColumnName& known : kColumnNames) {
    if (known.column >= words.size()) {
      continue;
    }
    double& value = columns[known.column];
    if (!absl::SimpleAtod(words[known.column], &value) ||
        !(std::isfinite(value) || known.is_distance)) {
      return ParError(path,
                      absl::StrFormat("line %d of images has \"%s\" as %s (column %d); "
                                      "expected a finite number",
                                      number, base::Printable(words[known.column].substr(0, 40)),
                                      known.name, known.column + 1));
    }
  }
  if (columns[kSlope] == 0) {
    return ParError(path, absl::StrFormat("line %d of images has the rescale slope 0, by which all "
                                          "its values would be %g; expected another one",
                                          number, columns[kIntercept]));
  }
  return columns;
}

absl::StatusOr<ParHeader> ReadParHeader(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, ReadTextHeader(path));
  ParHeader header;
  std::size_t at = 0;
  absl::string_view line;
  while (NextLine(text, &at, &line)) {
    line = absl::StripAsciiWhitespace(line);
    const std::size_t colon = line.find(':');
    if (absl::StartsWith(line, ". ") && colon != absl::string_view::npos) {
      header.fields[std::string(absl::StripAsciiWhitespace(line.substr(1, colon - 1)))] =
          std::string(absl::StripAsciiWhitespace(line.substr(colon + 1)));
    } else if (!line.empty() && absl::ascii_isdigit(static_cast<unsigned char>(line[0]))) {
      ISOSCOPE_ASSIGN_OR_RETURN(header.lines.emplace_back(),
                                ParImageLine(line, header.lines.size() + 1, path));
    }
  }
  if (header.lines.empty()) {
    return ParError(path, "no line of an image: not a PAR file of version 4, or cut");
  }
  return header;
}

// A number that all slices must have in common.
absl::StatusOr<double> OnlyNumber(const ParHeader& header, Column column, const char* name,
                                  const std::string& path) {
  const double first = header.lines.front()[column];
  for (const std::vector<double>& line : header.lines) {
    if (line[column] != first && !(std::isnan(line[column]) && std::isnan(first))) {
      return ParError(path,
                      absl::StrFormat("%s is %g in one slice and %g in another; expected a volume "
                                      "of equal slices: export one stack alone",
                                      name, first, line[column]));
    }
  }
  return first;
}

// This tells volumes apart, apart from the type of the image.
constexpr std::array<Column, 7> kKeys{kDynamic,        kEcho,     kPhase, kDiffusionFactor,
                                      kDiffusionValue, kGradient, kLabel};

double KeyOf(const std::vector<double>& line, Column column) {
  const bool has_numbers = line.size() > kDiffusionValue;  // in place of the factor
  return column >= line.size() || (column == kDiffusionFactor && has_numbers) ? 0 : line[column];
}

std::string TypeName(double type) {
  constexpr std::array<const char*, 4> kNames{"magnitude", "real", "imaginary", "phase"};
  return type >= 0 && type < 4 && type == std::floor(type) ? kNames[static_cast<std::size_t>(type)]
                                                           : absl::StrCat("type ", type);
}

// Type, scanning sequence, and the echo if it makes fields.
using FieldKey = std::array<double, 3>;

// A volume's field, and its place in the order of steps.
struct VolumeKey {
  FieldKey field;
  std::vector<double> step;

  friend auto operator<=>(const VolumeKey&, const VolumeKey&) = default;
};

// "phase", "magnitude sequence 4 echo 2": as much as tells it from the others.
std::string FieldName(const FieldKey& field, const std::set<FieldKey>& all) {
  const bool has_sequence = std::any_of(all.begin(), all.end(), [&](const FieldKey& other) {
    return other[0] == field[0] && other[1] != field[1];
  });
  return absl::StrCat(TypeName(field[0]), has_sequence ? absl::StrCat(" sequence ", field[1]) : "",
                      field[2] == 0 ? "" : absl::StrCat(" echo ", field[2]));
}

struct ParVolumes {
  std::vector<Column> varying;                                              // of kKeys
  std::map<VolumeKey, std::map<double, const std::vector<double>*>> lines;  // by slice number
};

absl::StatusOr<ParVolumes> SortLines(const ParHeader& header, const std::string& path) {
  ParVolumes volumes;
  for (const Column key : kKeys) {
    if (std::any_of(header.lines.begin(), header.lines.end(), [&](const std::vector<double>& l) {
          return KeyOf(l, key) != KeyOf(header.lines.front(), key);
        })) {
      volumes.varying.push_back(key);
    }
  }
  const bool has_echo_fields =
      volumes.varying.size() > 1 &&
      std::find(volumes.varying.begin(), volumes.varying.end(), kEcho) != volumes.varying.end();
  if (has_echo_fields) {
    volumes.varying.erase(std::find(volumes.varying.begin(), volumes.varying.end(), kEcho));
  }
  const bool is_diffusion = std::find(volumes.varying.begin(), volumes.varying.end(),
                                      kDiffusionFactor) != volumes.varying.end();
  for (const std::vector<double>& line : header.lines) {
    VolumeKey key{.field = {line[kType], line[kSequence], has_echo_fields ? line[kEcho] : 0},
                  .step = {}};
    for (const Column column : volumes.varying) {
      key.step.push_back(KeyOf(line, column));
    }
    if (is_diffusion) {
      key.step.push_back(0);
      while (volumes.lines[key].contains(line[kSlice])) {
        ++key.step.back();
      }
    }
    if (!volumes.lines[key].emplace(line[kSlice], &line).second) {
      return ParError(path,
                      absl::StrFormat("slice %g of type %g, echo %g, dynamic %g is there "
                                      "twice; expected slices that their numbers tell apart",
                                      line[kSlice], line[kType], line[kEcho], line[kDynamic]));
    }
  }
  return volumes;
}

// Every volume must have the slices 1 to n, and every field the same steps.
absl::Status CheckWhole(const ParVolumes& volumes, std::size_t slice_count,
                        const std::set<FieldKey>& fields,
                        const std::set<std::vector<double>>& steps, const std::string& path) {
  std::size_t index = 0;
  for (const auto& [key, slices] : volumes.lines) {
    ++index;
    if (slices.size() != slice_count) {
      return ParError(path,
                      absl::StrFormat("volume %d of %d has %d of %d slices: the scan was "
                                      "stopped, or the export is cut",
                                      index, volumes.lines.size(), slices.size(), slice_count));
    }
  }
  if (volumes.lines.size() != fields.size() * steps.size()) {
    return ParError(path, absl::StrFormat("%d volumes of %d types of images at %d steps; expected "
                                          "each type at each step: export one type alone",
                                          volumes.lines.size(), fields.size(), steps.size()));
  }
  return absl::OkStatus();
}

// Times, if one key alone makes the steps, and its column of times ascends.
void SetTimes(const ParVolumes& volumes, std::size_t steps, FileLayout* layout) {
  if (volumes.varying.size() != 1) {
    return;
  }
  struct TimeColumn {
    Column key;
    Column time;
    const char* unit;
  };
  constexpr std::array<TimeColumn, 3> kTimes{
      {{kDynamic, kDynamicTime, "s"}, {kEcho, kEchoTime, "ms"}, {kPhase, kTriggerTime, "ms"}}};
  for (const TimeColumn& known : kTimes) {
    if (known.key != volumes.varying.front()) {
      continue;
    }
    std::vector<double> times;
    for (const auto& [key, slices] : volumes.lines) {
      if (times.size() < steps) {
        times.push_back((*slices.begin()->second)[known.time]);
      }
    }
    if (std::adjacent_find(times.begin(), times.end(), std::greater_equal<>()) == times.end()) {
      layout->times = std::move(times);
      layout->time_unit = known.unit;
    }
  }
}

// The transform to RAS.
absl::StatusOr<AffineRows> ParTransform(const ParHeader& header, const math::Index3& dims,
                                        const math::Vec3d& spacing, double orientation,
                                        const std::string& path) {
  const std::vector<double> angles = header.Numbers("Angulation midslice");
  const std::vector<double> centre = header.Numbers("Off Centre midslice");
  // Columns: the directions of x, y and z in the scanner's axes.
  math::Mat3d lie;
  if (orientation == 1) {  // transverse
    lie = {{{{0, 0, 1}, {1, 0, 0}, {0, 1, 0}}}};
  } else if (orientation == 2) {  // sagittal
    lie = {{{{1, 0, 0}, {0, -1, 0}, {0, 0, -1}}}};
  } else if (orientation == 3) {  // coronal
    lie = {{{{0, 0, 1}, {0, -1, 0}, {1, 0, 0}}}};
  }
  if (angles.size() != 3 || centre.size() != 3 || orientation < 1 || orientation > 3) {
    return ParError(path, absl::StrFormat("no angulation, no centre, or slice orientation %g; "
                                          "expected 1, 2 or 3",
                                          orientation));
  }
  const auto turn = [](double degrees, int axis) {
    const double cosine = math::Cos(degrees * std::numbers::pi / 180);
    const double sine = math::Sin(degrees * std::numbers::pi / 180);
    math::Mat3d m;
    const auto a = static_cast<std::size_t>((axis + 1) % 3);
    const auto b = static_cast<std::size_t>((axis + 2) % 3);
    m.columns[a][static_cast<int>(a)] = m.columns[b][static_cast<int>(b)] = cosine;
    m.columns[a][static_cast<int>(b)] = sine;
    m.columns[b][static_cast<int>(a)] = -sine;
    return m;
  };
  const math::Mat3d mx = turn(angles[0], 0);
  const math::Mat3d my = turn(angles[1], 1);
  const math::Mat3d mz = turn(angles[2], 2);
  AffineRows rows;
  std::array<math::Vec3d, 4> columns;
  math::Vec3d half;
  for (int axis = 0; axis < 3; ++axis) {
    const auto index = static_cast<std::size_t>(axis);
    columns[index] = mz * (mx * (my * lie.columns[index])) * spacing[axis];
    half = half + columns[index] * (static_cast<double>(dims[axis] - 1) / 2);
  }
  columns[3] = math::Vec3d{centre[0], centre[1], centre[2]} - half;
  for (std::size_t i = 0; i < 4; ++i) {  // posterior, superior, left to RAS
    rows[0][i] = -columns[i].z;
    rows[1][i] = -columns[i].x;
    rows[2][i] = columns[i].y;
  }
  return rows;
}

math::Vec3d VectorAt(const std::vector<double>& line, std::size_t column) {
  return {line[column], line[column + 1], line[column + 2]};
}

std::string TextOf(const math::Vec3d& v) { return absl::StrFormat("%g, %g, %g", v.x, v.y, v.z); }

using SlicesByNumber = std::map<double, const std::vector<double>*>;

// The slices of all volumes must be one stack, that of the first volume: turned alike, their
// centres evenly apart on a line. Programs that do not know the centres write the same one for all.
absl::Status CheckStack(const SlicesByNumber& stack, const SlicesByNumber& slices,
                        const std::string& path) {
  constexpr double kMaxDegrees = 0.02;  // headers have two or three digits behind the point
  constexpr double kMaxDistance = 0.1;  // mm; one of 31 headers is 0.08 off
  constexpr double kMaxShare = 0.02;    // of the distance of slices
  const double first = stack.begin()->first;
  const math::Vec3d angles = VectorAt(*stack.begin()->second, kAngulation);
  const math::Vec3d begin = VectorAt(*stack.begin()->second, kOffCentre);
  const math::Vec3d step = (VectorAt(*stack.rbegin()->second, kOffCentre) - begin) *
                           (1 / std::max(1.0, static_cast<double>(stack.size()) - 1));
  double index = 0;
  for (const auto& [slice, line] : slices) {
    const math::Vec3d own_angles = VectorAt(*line, kAngulation);
    if (math::Length(own_angles - angles) > kMaxDegrees) {
      return ParError(
          path, absl::StrFormat("slice %g is turned by %s degrees (image angulation), and slice %g "
                                "by %s; expected a volume of equal slices: export one stack alone",
                                first, TextOf(angles), slice, TextOf(own_angles)));
    }
    const math::Vec3d centre = VectorAt(*line, kOffCentre);
    const math::Vec3d expected = begin + step * index;
    if (math::Length(centre - expected) > kMaxDistance + kMaxShare * math::Length(step)) {
      return ParError(
          path,
          absl::StrFormat("the centre of slice %g is at %s mm (image offcentre); expected %s, "
                          "as slices lie evenly between the first and the last one: export "
                          "one stack alone",
                          slice, TextOf(centre), TextOf(expected)));
    }
    ++index;
  }
  return absl::OkStatus();
}

absl::StatusOr<std::string> RecOf(const std::string& path) {
  const std::string stem = path.substr(0, path.rfind('.'));
  for (const char* ending : {".REC", ".rec"}) {
    if (io::PathExists(stem + ending)) {
      return stem + ending;
    }
  }
  return absl::NotFoundError(absl::StrCat(path, ": its data file ", stem, ".REC does not exist"));
}

absl::Status SetParGrid(const ParHeader& header, std::size_t slice_count, const std::string& path,
                        FileLayout* layout) {
  math::Index3 dims{0, 0, static_cast<std::int64_t>(slice_count)};
  math::Vec3d spacing;
  double orientation = 0;
  const auto count = [](double number) {
    return number >= 0 && number < 65536 ? static_cast<std::int64_t>(number) : 0;
  };
  ISOSCOPE_ASSIGN_OR_RETURN(const double width,
                            OnlyNumber(header, kWidth, "the width (recon resolution)", path));
  ISOSCOPE_ASSIGN_OR_RETURN(const double height,
                            OnlyNumber(header, kHeight, "the height (recon resolution)", path));
  dims.x = count(width);
  dims.y = count(height);
  ISOSCOPE_ASSIGN_OR_RETURN(spacing.x, OnlyNumber(header, kSpacingX, "pixel spacing x", path));
  ISOSCOPE_ASSIGN_OR_RETURN(spacing.y, OnlyNumber(header, kSpacingY, "pixel spacing y", path));
  ISOSCOPE_ASSIGN_OR_RETURN(const double thickness,
                            OnlyNumber(header, kThickness, "slice thickness", path));
  ISOSCOPE_ASSIGN_OR_RETURN(const double gap, OnlyNumber(header, kGap, "slice gap", path));
  spacing.z = thickness + gap;  // slices overlap where the gap is negative
  constexpr std::array<const char*, 3> kNames{"pixel spacing x", "pixel spacing y",
                                              "slice thickness + slice gap"};
  for (int axis = 0; axis < 3; ++axis) {
    const absl::Status good = CheckSampleDistance(
        path, absl::StrCat(kNames.at(static_cast<std::size_t>(axis)), " of the PAR header"),
        spacing[axis]);
    layout->faults.distances.Update(good);
    spacing[axis] = good.ok() ? spacing[axis] : 1;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(orientation,
                            OnlyNumber(header, kOrientation, "slice orientation", path));
  ISOSCOPE_ASSIGN_OR_RETURN(const AffineRows rows,
                            ParTransform(header, dims, spacing, orientation, path));
  ISOSCOPE_ASSIGN_OR_RETURN(layout->geometry,
                            GridFromAffine(dims, rows, PatientWorld::kRas, path, &layout->faults));
  layout->shear = FindShear(rows);
  layout->patient_frame.emplace();
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<FileLayout> ReadParRecLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const ParHeader header, ReadParHeader(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const ParVolumes volumes, SortLines(header, path));
  const std::vector<double> max_slices = header.Numbers("Max. number of slices/locations");
  std::set<double> slices;
  for (const std::vector<double>& line : header.lines) {
    slices.insert(line[kSlice]);
  }
  const std::size_t slice_count =
      std::max(slices.size(), max_slices.size() == 1 && max_slices[0] > 0 && max_slices[0] < 65536
                                  ? static_cast<std::size_t>(max_slices[0])
                                  : 0);
  std::set<FieldKey> fields;
  std::set<std::vector<double>> steps;
  for (const auto& [key, lines] : volumes.lines) {
    fields.insert(key.field);
    steps.insert(key.step);
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckWhole(volumes, slice_count, fields, steps, path));
  FileLayout layout{.steps = static_cast<std::int64_t>(steps.size()), .length_unit = "mm"};
  if (fields.size() > 1) {  // else the field has the name of the file
    for (const FieldKey& field : fields) {
      layout.fields.push_back(FieldName(field, fields));
    }
  }
  SetTimes(volumes, steps.size(), &layout);
  ISOSCOPE_RETURN_IF_ERROR(SetParGrid(header, slice_count, path, &layout));
  ISOSCOPE_ASSIGN_OR_RETURN(const double bits,
                            OnlyNumber(header, kPixelBits, "the size of a pixel", path));
  if (bits != 8 && bits != 16) {
    return ParError(path, absl::StrFormat("pixels of %g bits; expected 8 or 16", bits));
  }
  layout.location.stored_type =
      bits == 8 ? volume::ScalarType::kUint8 : volume::ScalarType::kUint16;
  const std::int64_t slice_bytes = layout.geometry.sample_dims.x * layout.geometry.sample_dims.y *
                                   static_cast<std::int64_t>(bits / 8);
  std::set<double> indices;
  for (const auto& [key, lines] : volumes.lines) {
    ISOSCOPE_RETURN_IF_ERROR(CheckStack(volumes.lines.begin()->second, lines, path));
    for (const auto& [slice, line] : lines) {
      const double index = (*line)[kIndex];
      if (!(index >= 0 && index < 0x1p31 && index == std::floor(index))) {
        return ParError(path,
                        absl::StrFormat("slice %g has index %g in the REC file", slice, index));
      }
      if (!indices.insert(index).second) {
        return ParError(path, absl::StrFormat("slice %g has index %g in the REC file, as another "
                                              "slice has; expected an index for each",
                                              slice, index));
      }
      layout.slices.push_back(
          {.offset = static_cast<std::int64_t>(index) * slice_bytes,
           .rescaling = {.slope = (*line)[kSlope], .intercept = (*line)[kIntercept]}});
    }
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::string rec, RecOf(path));
  layout.location.files = {std::move(rec)};
  return layout;
}

}  // namespace isoscope::source
