// An AFNI dataset is a header of text, .HEAD, and samples without any, .BRIK, .BRIK.gz or
// .BRIK.bz2. The header is attributes:
//
//   type  = float-attribute                 or integer-attribute, string-attribute
//   name  = IJK_TO_DICOM_REAL
//   count = 12
//    -3 0 0 66 0 -3 0 87 0 0 3 -54          numbers; of a string: a quotation mark and the text,
//                                           whose characters count with the ~ at their end
//
// These describe the samples:
//
//   DATASET_DIMENSIONS  x, y, z
//   DATASET_RANK        3, and the number of sub-bricks: volumes, one behind the other
//   BRICK_TYPES         of each: 0 uint8, 1 int16, 2 int32, 3 float32, 4 float64
//   BRICK_FLOAT_FACS    of each: the factor of its samples, 0 if there is none
//   BRICK_LABS          labels, a ~ between them
//   BYTEORDER_STRING    LSB_FIRST or MSB_FIRST
//   IJK_TO_DICOM_REAL   rows of the transform from indices to LPS; older files have these three
//   ORIGIN              instead: per axis, where it begins,
//   DELTA               the distance of samples,
//   ORIENT_SPECIFIC     and the direction
//   TAXIS_NUMS          the sub-bricks are steps: their number, slices with offsets, the unit
//   TAXIS_FLOATS        the first time, the interval, ...
//
// Source: https://afni.nimh.nih.gov/pub/dist/doc/program_help/README.attributes.html; nibabel's
// brikhead.py.

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/formats/medical/layout_formats.h"
#include "core/source/bytes/data_files.h"
#include "core/source/bytes/file_start.h"
#include "core/source/bytes/text_header.h"
#include "core/source/grid/affine_grid.h"

namespace isoscope::source {
namespace {

struct AfniHeader {
  std::map<std::string, std::vector<double>> numbers;
  std::map<std::string, std::string> texts;

  // The numbers of an attribute; none if it is absent.
  [[nodiscard]] std::vector<double> Numbers(const std::string& name) const {
    const auto found = numbers.find(name);
    return found == numbers.end() ? std::vector<double>() : found->second;
  }
  [[nodiscard]] std::string Text(const std::string& name) const {
    const auto found = texts.find(name);
    return found == texts.end() ? "" : found->second;
  }
};

absl::Status AfniError(const std::string& path, const std::string& what) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": AFNI header: ", what));
}

// The value of "key = value"; "" if the line has another key.
std::string ValueOf(absl::string_view line, absl::string_view key) {
  const std::pair<absl::string_view, absl::string_view> parts =
      absl::StrSplit(line, absl::MaxSplits('=', 1));
  return absl::StripAsciiWhitespace(parts.first) == key
             ? std::string(absl::StripAsciiWhitespace(parts.second))
             : "";
}

absl::StatusOr<AfniHeader> ReadAfniHeader(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, ReadTextHeader(path));
  AfniHeader header;
  std::size_t at = 0;
  std::string type;
  std::string name;
  absl::string_view line;
  while (NextLine(text, &at, &line)) {
    if (const std::string new_type = ValueOf(line, "type"); !new_type.empty()) {
      type = new_type;
    }
    if (const std::string new_name = ValueOf(line, "name"); !new_name.empty()) {
      name = new_name;
    }
    std::size_t count = 0;
    if (!absl::SimpleAtoi(ValueOf(line, "count"), &count)) {
      continue;
    }
    if (count > text.size() - at) {
      return AfniError(path, absl::StrFormat("%s has %d elements, the rest of the file %d bytes: "
                                             "it is cut",
                                             base::Printable(name), count, text.size() - at));
    }
    if (type == "string-attribute") {
      at = std::min(text.find('\'', at), text.size() - 1) + 1;
      header.texts[name] = text.substr(at, count);
      at = std::min(at + count, text.size());
      continue;
    }
    std::vector<double>& numbers = header.numbers[name];
    numbers.clear();
    while (numbers.size() < count) {
      const std::size_t begin = std::min(text.find_first_not_of(" \t\r\n", at), text.size());
      const std::size_t end = std::min(text.find_first_of(" \t\r\n", begin), text.size());
      if (!absl::SimpleAtod(absl::string_view(text).substr(begin, end - begin),
                            &numbers.emplace_back())) {
        return AfniError(
            path, absl::StrFormat(
                      "%s has \"%s\" among its %d numbers", base::Printable(name),
                      base::Printable(text.substr(begin, std::min<std::size_t>(end - begin, 40))),
                      count));
      }
      at = end;
    }
  }
  return header;
}

// Returns the count that an attribute has at that index; 0 if it is no count.
std::int64_t CountAt(const std::vector<double>& numbers, std::size_t index) {
  constexpr double kMax = 0x1p31;
  return index < numbers.size() && numbers[index] >= 0 && numbers[index] < kMax
             ? static_cast<std::int64_t>(numbers[index])
             : 0;
}

absl::StatusOr<volume::ScalarType> AfniType(const std::vector<double>& types,
                                            std::int64_t sub_bricks, const std::string& path) {
  constexpr std::array<volume::ScalarType, 5> kTypes{
      {volume::ScalarType::kUint8, volume::ScalarType::kInt16, volume::ScalarType::kInt32,
       volume::ScalarType::kFloat32, volume::ScalarType::kFloat64}};
  const std::set<double> used(types.begin(), types.end());
  if (static_cast<std::int64_t>(types.size()) != sub_bricks || used.size() != 1 ||
      !(*used.begin() >= 0 && *used.begin() < kTypes.size())) {
    return AfniError(
        path, absl::StrFormat("%d BRICK_TYPES (%s) for %d sub-bricks; expected one type for all of "
                              "them, 0 (uint8), 1 (int16), 2 (int32), 3 (float32) or 4 (float64): "
                              "convert it (3dcalc -datum float)",
                              types.size(), absl::StrJoin(used, ", "), sub_bricks));
  }
  return kTypes[static_cast<std::size_t>(*used.begin())];
}

// The transform to LPS.
absl::StatusOr<AffineRows> AfniTransform(const AfniHeader& header, const std::string& path) {
  AffineRows rows{};
  const std::vector<double> real = header.Numbers("IJK_TO_DICOM_REAL");
  if (real.size() == 12) {
    for (std::size_t i = 0; i < 12; ++i) {
      rows[i / 4][i % 4] = real[i];
    }
    return rows;
  }
  if (!real.empty()) {
    return AfniError(path,
                     absl::StrFormat("IJK_TO_DICOM_REAL has %d numbers; expected 12", real.size()));
  }
  const std::vector<double> origin = header.Numbers("ORIGIN");
  const std::vector<double> delta = header.Numbers("DELTA");
  const std::vector<double> orient = header.Numbers("ORIENT_SPECIFIC");
  std::set<std::size_t> world_axes;
  for (std::size_t axis = 0; axis < 3 && axis < orient.size(); ++axis) {
    if (orient[axis] >= 0 && orient[axis] <= 5) {  // R to L, L to R, P to A, A to P, I to S, S to I
      world_axes.insert(static_cast<std::size_t>(orient[axis]) / 2);
    }
  }
  if (world_axes.size() != 3 || origin.size() < 3 || delta.size() < 3) {
    return AfniError(path,
                     "neither IJK_TO_DICOM_REAL nor ORIGIN, DELTA and ORIENT_SPECIFIC of three "
                     "axes: not a volume, or cut");
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t world = static_cast<std::size_t>(orient[axis]) / 2;
    rows[world][axis] = delta[axis];
    rows[world][3] = origin[axis];
  }
  return rows;
}

// Steps of time, or fields named by the labels of the sub-bricks.
void SetAfniVolumes(const AfniHeader& header, std::int64_t sub_bricks, FileLayout* layout) {
  const std::vector<double> times = header.Numbers("TAXIS_NUMS");
  if (CountAt(times, 0) == sub_bricks) {
    layout->steps = sub_bricks;
    const std::vector<double> floats = header.Numbers("TAXIS_FLOATS");
    if (floats.size() > 1 && std::isfinite(floats[1]) && floats[1] > 0) {
      constexpr std::int64_t kMilliseconds = 77001;
      constexpr std::int64_t kSeconds = 77002;
      const std::int64_t unit = CountAt(times, 2);
      layout->interval = floats[1];
      layout->first_time = floats[0];
      layout->time_unit = unit == kMilliseconds ? "ms" : unit == kSeconds ? "s" : "";
    }
    return;
  }
  if (sub_bricks == 1) {
    return;
  }
  const std::vector<std::string> labels = absl::StrSplit(header.Text("BRICK_LABS"), '~');
  std::set<std::string> used;
  for (std::int64_t i = 0; i < sub_bricks; ++i) {
    const auto index = static_cast<std::size_t>(i);
    std::string label =
        index < labels.size() ? base::Printable(absl::StripAsciiWhitespace(labels[index])) : "";
    if (label.empty() || !used.insert(label).second) {
      label = absl::StrCat(label, "#", i);
      used.insert(label);
    }
    layout->fields.push_back(std::move(label));
  }
}

absl::Status FindBrik(const std::string& path, SampleLocation* location) {
  const std::string name = path.substr(path.rfind('/') + 1);
  const std::string brik = name.substr(0, name.rfind('.')) + ".BRIK";
  absl::StatusOr<std::vector<std::string>> files;
  for (const auto& [ending, encoding] :
       {std::pair{"", SampleEncoding::kRaw}, std::pair{".gz", SampleEncoding::kDeflate},
        std::pair{".bz2", SampleEncoding::kBzip2}}) {
    auto found = SingleFile(path, absl::StrCat(brik, ending));
    if (found.ok()) {
      location->files = *std::move(found);
      const bool is_plain =
          encoding == SampleEncoding::kDeflate && !IsGzipFile(location->files.front());
      location->encoding = is_plain ? SampleEncoding::kRaw : encoding;
      return absl::OkStatus();
    }
    if (files.status().code() == absl::StatusCode::kUnknown) {
      files = std::move(found);
    }
  }
  return files.status();
}

}  // namespace

absl::StatusOr<FileLayout> ReadAfniLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const AfniHeader header, ReadAfniHeader(path));
  const std::vector<double> sizes = header.Numbers("DATASET_DIMENSIONS");
  const std::vector<double> rank = header.Numbers("DATASET_RANK");
  const std::int64_t sub_bricks = CountAt(rank, 1);
  if (sub_bricks < 1 || sizes.size() < 3) {
    return AfniError(path, "DATASET_RANK or DATASET_DIMENSIONS is missing, or has no volumes");
  }
  FileLayout layout{.length_unit = "mm"};
  SampleLocation& location = layout.location;
  location.volume_count = sub_bricks;
  ISOSCOPE_ASSIGN_OR_RETURN(location.stored_type,
                            AfniType(header.Numbers("BRICK_TYPES"), sub_bricks, path));
  location.is_big_endian = absl::StartsWith(header.Text("BYTEORDER_STRING"), "MSB");
  SetAfniVolumes(header, sub_bricks, &layout);
  std::vector<double> factors = header.Numbers("BRICK_FLOAT_FACS");
  factors.resize(static_cast<std::size_t>(sub_bricks), 0);
  for (const double factor : factors) {
    if (!std::isfinite(factor)) {
      return AfniError(path,
                       absl::StrFormat("BRICK_FLOAT_FACS has %g; expected finite factors, or 0 "
                                       "for none",
                                       factor));
    }
    layout.rescalings.push_back({.slope = factor != 0 ? factor : 1});
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const AffineRows rows, AfniTransform(header, path));
  ISOSCOPE_ASSIGN_OR_RETURN(
      layout.geometry, GridFromAffine({CountAt(sizes, 0), CountAt(sizes, 1), CountAt(sizes, 2)},
                                      rows, PatientWorld::kLps, path, &layout.faults));
  layout.shear = FindShear(rows);
  layout.patient_frame.emplace();
  ISOSCOPE_RETURN_IF_ERROR(FindBrik(path, &location));
  return layout;
}

}  // namespace isoscope::source
