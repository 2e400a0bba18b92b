// A header of MRtrix is text up to a line END; '#' begins a comment:
//
//   mrtrix image
//   dim: 192,256,256
//   vox: 0.9,0.9,0.9           mm
//   layout: -0,-1,+2           by axis: its rank, 0 fastest; '-': stored from its end
//   datatype: Float32LE
//   transform: 1,0,0,-91       three rows, to RAS: from indices times vox
//   transform: 0,1,0,-100
//   transform: 0,0,1,-72
//   scaling: 0,1               offset and factor: offset + factor * stored
//   file: . 328                '.': this file, and the byte of the first sample; or NAME BYTE
//   END
//
// Axes of space stay as they are stored: ranks and signs go into the transform. A fourth axis must
// be the fastest (tuples) or the slowest (volumes). Without a transform MRtrix puts the centre at
// 0. Source: https://mrtrix.readthedocs.io, "MRtrix image formats"; formats/mrtrix_utils.h.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
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

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/formats/medical/layout_formats.h"
#include "core/source/adapt/wide_source.h"
#include "core/source/bytes/data_files.h"
#include "core/source/bytes/file_start.h"
#include "core/source/bytes/text_header.h"
#include "core/source/grid/affine_grid.h"
#include "core/source/grid/sample_distance.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxMrtrixHeaderBytes = 4 * base::kMiB;
constexpr std::size_t kMaxMrtrixAxes = 16;
constexpr absl::string_view kMrtrixMark = "mrtrix image";

absl::Status MrtrixError(const std::string& path, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": MRtrix header: ", what));
}

// The lines of each key, in lower case.
using MrtrixLines = std::map<std::string, std::vector<std::string>>;

struct MrtrixAxis {
  std::int64_t size = 1;
  std::int64_t rank = 0;
  bool is_reversed = false;
};

struct MrtrixText {
  MrtrixLines lines{};
  std::int64_t end = 0;  // bytes up to the one behind END
  bool is_gzip = false;
};

absl::StatusOr<MrtrixText> ReadMrtrixText(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FileStart start, ReadFileStart(path, kMaxMrtrixHeaderBytes));
  MrtrixText text{.is_gzip = start.is_gzip};
  std::size_t position = 0;
  absl::string_view line;
  if (!NextLine(start.bytes, &position, &line) || absl::StripAsciiWhitespace(line) != kMrtrixMark) {
    return absl::InvalidArgumentError(absl::StrCat(
        path,
        ": does not begin with \"mrtrix image\": not an MRtrix image, though its name says "
        "so"));
  }
  while (NextLine(start.bytes, &position, &line)) {
    line = absl::StripAsciiWhitespace(line.substr(0, line.find('#')));
    if (line == "END") {
      text.end = static_cast<std::int64_t>(position);
      return text;
    }
    const std::size_t colon = line.find(':');
    if (colon != line.npos) {
      const std::string key =
          absl::AsciiStrToLower(absl::StripAsciiWhitespace(line.substr(0, colon)));
      text.lines[key].emplace_back(absl::StripAsciiWhitespace(line.substr(colon + 1)));
    }
  }
  return MrtrixError(path, absl::StrFormat("no line END in %d bytes: the file is cut, or damaged",
                                           start.bytes.size()));
}

// The value of a key that may stand there once; "" without it.
absl::StatusOr<std::string> OnlyLine(const MrtrixText& text, const char* key,
                                     const std::string& path) {
  const auto found = text.lines.find(key);
  if (found == text.lines.end()) {
    return "";
  }
  return found->second.size() == 1
             ? absl::StatusOr<std::string>(found->second.front())
             : MrtrixError(path, absl::StrFormat("%d lines \"%s\"; expected one",
                                                 found->second.size(), key));
}

absl::StatusOr<std::vector<double>> NumbersOfLine(const std::string& line, const char* key,
                                                  const std::string& path) {
  std::vector<double> numbers;
  for (const absl::string_view word :
       absl::StrSplit(line, absl::ByAnyChar(", \t"), absl::SkipEmpty())) {
    if (!absl::SimpleAtod(word, &numbers.emplace_back())) {
      return MrtrixError(path,
                         absl::StrFormat("%s: %s; expected numbers", key, base::Quoted(line)));
    }
  }
  return numbers;
}

// The axes of the image, each of any size.
absl::StatusOr<std::vector<MrtrixAxis>> ReadMrtrixAxes(const MrtrixText& text,
                                                       const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string dim, OnlyLine(text, "dim", path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string layout, OnlyLine(text, "layout", path));
  const std::vector<std::string> sizes =
      absl::StrSplit(dim, absl::ByAnyChar(", \t"), absl::SkipEmpty());
  const std::vector<std::string> ranks =
      absl::StrSplit(layout, absl::ByAnyChar(", \t"), absl::SkipEmpty());
  if (sizes.empty() || sizes.size() > kMaxMrtrixAxes || ranks.size() != sizes.size()) {
    return MrtrixError(path,
                       absl::StrFormat("dim: %s and layout: %s; expected as many of each, at "
                                       "most %d",
                                       base::Quoted(dim), base::Quoted(layout), kMaxMrtrixAxes));
  }
  std::vector<MrtrixAxis> axes(sizes.size());
  std::vector<bool> has_rank(sizes.size(), false);
  for (std::size_t i = 0; i < axes.size(); ++i) {
    MrtrixAxis& axis = axes[i];
    if (!absl::SimpleAtoi(sizes[i], &axis.size) || axis.size < 1) {
      return MrtrixError(
          path, absl::StrFormat("dim: %s; expected numbers of 1 or more", base::Quoted(dim)));
    }
    const char sign = ranks[i][0];
    const bool has_sign = sign == '+' || sign == '-';
    axis.is_reversed = sign == '-';
    if (!absl::SimpleAtoi(absl::string_view(ranks[i]).substr(has_sign ? 1 : 0), &axis.rank) ||
        axis.rank < 0 || axis.rank >= static_cast<std::int64_t>(axes.size()) ||
        has_rank[static_cast<std::size_t>(axis.rank)]) {
      return MrtrixError(path, absl::StrFormat("layout: %s; expected each rank from 0 to %d once, "
                                               "with a sign",
                                               base::Quoted(layout), axes.size() - 1));
    }
    has_rank[static_cast<std::size_t>(axis.rank)] = true;
  }
  return axes;
}

// Takes axes of one sample behind the first three away, so that at most a fourth is left.
absl::StatusOr<std::vector<MrtrixAxis>> TakeMrtrixVolumes(std::vector<MrtrixAxis> axes,
                                                          const std::string& path) {
  const std::size_t count = axes.size();
  const auto others =
      std::count_if(axes.begin() + std::min<std::ptrdiff_t>(3, axes.end() - axes.begin()),
                    axes.end(), [](const MrtrixAxis& axis) { return axis.size > 1; });
  if (count < 3 || others > 1) {
    return MrtrixError(
        path, absl::StrFormat(
                  "%d axes, %d of more than one sample behind the first three; expected "
                  "three of space, and at most one of volumes%s",
                  count, others,
                  count < 3 ? "" : ": take one of them, as mrconvert -coord 4 0 IN OUT does"));
  }
  for (std::size_t i = axes.size(); i-- > 3;) {
    if (axes[i].size == 1) {
      for (MrtrixAxis& axis : axes) {
        axis.rank -= axis.rank > axes[i].rank ? 1 : 0;
      }
      axes.erase(axes.begin() + static_cast<std::ptrdiff_t>(i));
    }
  }
  const bool is_between = axes.size() == 4 && axes[3].rank != 0 && axes[3].rank != 3;
  if (axes.size() == 4 && (is_between || axes[3].is_reversed)) {
    return MrtrixError(path,
                       "its volumes lie between its slices, or from last to first; expected "
                       "them one behind the other: mrconvert -strides 1,2,3,4 IN OUT");
  }
  return axes;
}

struct MrtrixType {
  volume::ScalarType type = volume::ScalarType::kUint8;
  std::optional<WideType> wide{};
  bool is_big_endian = false;
};

absl::StatusOr<MrtrixType> ReadMrtrixType(const MrtrixText& text, const std::string& path) {
  using volume::ScalarType;
  struct Known {
    absl::string_view name;
    ScalarType type;
    std::optional<WideType> wide;
  };
  static constexpr std::array<Known, 11> kKnown{
      {{"int8", ScalarType::kInt8, std::nullopt},
       {"uint8", ScalarType::kUint8, std::nullopt},
       {"int16", ScalarType::kInt16, std::nullopt},
       {"uint16", ScalarType::kUint16, std::nullopt},
       {"int32", ScalarType::kInt32, std::nullopt},
       {"uint32", ScalarType::kUint32, std::nullopt},
       {"int64", ScalarType::kFloat64, WideType::kInt64},
       {"uint64", ScalarType::kFloat64, WideType::kUint64},
       {"float16", ScalarType::kUint16, WideType::kFloat16},
       {"float32", ScalarType::kFloat32, std::nullopt},
       {"float64", ScalarType::kFloat64, std::nullopt}}};
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string name, OnlyLine(text, "datatype", path));
  const std::string lower = absl::AsciiStrToLower(name);
  const bool is_little = absl::EndsWith(lower, "le");
  const bool is_big = absl::EndsWith(lower, "be");
  const absl::string_view base_name =
      absl::string_view(lower).substr(0, lower.size() - (is_little || is_big ? 2 : 0));
  const auto* const known = std::find_if(kKnown.begin(), kKnown.end(),
                                         [&](const Known& each) { return each.name == base_name; });
  if (known == kKnown.end()) {
    return MrtrixError(
        path, absl::StrFormat("datatype: %s; expected integers of 8 to 64 bits or floats of 16 to "
                              "64 bits: convert it, as mrconvert -datatype %s IN OUT does",
                              base::Quoted(name), lower == "bit" ? "uint8" : "float32"));
  }
  const bool is_byte = volume::SizeOf(known->type) == 1;
  if (is_byte == (is_little || is_big)) {
    return MrtrixError(path, absl::StrFormat("datatype: %s; expected %s", base::Quoted(name),
                                             is_byte ? "no byte order"
                                                     : "LE or BE behind it: the byte order is not "
                                                       "known"));
  }
  return MrtrixType{.type = known->type, .wide = known->wide, .is_big_endian = is_big};
}

// The transform from indices times distances to RAS; not set without one.
absl::StatusOr<std::optional<AffineRows>> ReadMrtrixTransform(const MrtrixText& text,
                                                              const std::string& path) {
  const auto found = text.lines.find("transform");
  if (found == text.lines.end()) {
    return std::nullopt;
  }
  AffineRows rows{};
  const std::size_t count = found->second.size();
  for (std::size_t r = 0; r < count; ++r) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> row,
                              NumbersOfLine(found->second[r], "transform", path));
    const bool is_last = r == 3 && row == std::vector<double>{0, 0, 0, 1};
    if (row.size() != 4 || r > 3 || (r == 3 && !is_last)) {
      return MrtrixError(path, absl::StrFormat("transform: %s as row %d; expected three rows of "
                                               "four numbers",
                                               base::Quoted(found->second[r]), r + 1));
    }
    if (r < 3) {
      std::copy(row.begin(), row.end(), rows[r].begin());
    }
  }
  return count < 3 ? absl::StatusOr<std::optional<AffineRows>>(MrtrixError(
                         path, absl::StrFormat("%d rows of the transform; expected three", count)))
                   : rows;
}

// Sets the grid of the stored axes of space.
absl::Status TakeMrtrixGrid(const MrtrixText& text, const std::vector<MrtrixAxis>& axes,
                            const std::string& path, FileLayout* layout) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string vox, OnlyLine(text, "vox", path));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<double> distances, NumbersOfLine(vox, "vox", path));
  if (distances.size() > kMaxMrtrixAxes) {
    return MrtrixError(path, absl::StrFormat("%d numbers of vox", distances.size()));
  }
  distances.resize(std::max<std::size_t>(distances.size(), 3),
                   std::numeric_limits<double>::quiet_NaN());
  for (std::size_t axis = 0; axis < 3; ++axis) {
    layout->faults.distances.Update(CheckSampleDistance(
        path, absl::StrFormat("number %d of vox in the MRtrix header", axis + 1), distances[axis]));
    if (!(std::isfinite(distances[axis]) && distances[axis] > 0)) {
      distances[axis] = 1;
    }
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<AffineRows> given, ReadMrtrixTransform(text, path));
  AffineRows transform{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
  if (given.has_value()) {
    transform = *given;
    layout->patient_frame.emplace();
  } else {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      transform[axis][3] = -0.5 * static_cast<double>(axes[axis].size - 1) * distances[axis];
    }
  }
  AffineRows rows{};
  math::Index3 dims;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    // The ranks of the axes of space among themselves.
    const auto stored = std::count_if(axes.begin(), axes.begin() + 3, [&](const MrtrixAxis& other) {
      return other.rank < axes[axis].rank;
    });
    dims[static_cast<int>(stored)] = axes[axis].size;
    const double step = axes[axis].is_reversed ? -distances[axis] : distances[axis];
    const double first =
        axes[axis].is_reversed ? static_cast<double>(axes[axis].size - 1) * distances[axis] : 0;
    for (std::size_t r = 0; r < 3; ++r) {
      rows[r][static_cast<std::size_t>(stored)] = transform[r][axis] * step;
      rows[r][3] += transform[r][axis] * first;
    }
  }
  for (std::size_t r = 0; r < 3; ++r) {
    rows[r][3] += transform[r][3];
  }
  ISOSCOPE_ASSIGN_OR_RETURN(layout->geometry,
                            GridFromAffine(dims, rows, PatientWorld::kRas, path, &layout->faults));
  layout->shear = FindShear(rows);
  return absl::OkStatus();
}

// Finds the files of the samples.
absl::Status TakeMrtrixFiles(const MrtrixText& text, const std::string& path,
                             SampleLocation* location) {
  const auto found = text.lines.find("file");
  if (found == text.lines.end() || found->second.size() > 100'000) {
    return MrtrixError(path,
                       "no line \"file\", or more than 100000; expected \". BYTE\" or \"NAME "
                       "BYTE\"");
  }
  for (const std::string& line : found->second) {
    const std::size_t space = line.find_last_of(" \t");
    std::string name = line;
    std::int64_t offset = 0;
    if (space != line.npos && absl::SimpleAtoi(line.substr(space + 1), &offset)) {
      name = std::string(absl::StripAsciiWhitespace(line.substr(0, space)));
    }
    const bool is_here = name == ".";
    if (name.empty() || offset < 0 || name.find('[') != name.npos ||
        (is_here && (offset < text.end || found->second.size() > 1)) ||
        (!is_here && text.is_gzip) || (!location->files.empty() && offset != location->offset)) {
      return MrtrixError(path,
                         absl::StrFormat("file: %s, where the header ends at byte %d; expected "
                                         "\". BYTE\" behind it, or names of files without "
                                         "brackets, all with one offset: mrconvert IN OUT.mif",
                                         base::Quoted(line), text.end));
    }
    location->offset = offset;
    if (is_here) {
      location->files = {path};
    } else {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> file, SingleFile(path, name));
      location->files.push_back(file.front());
    }
  }
  if (text.is_gzip) {
    location->encoding = SampleEncoding::kDeflate;
    location->decoded_skip = std::exchange(location->offset, 0);
  }
  return absl::OkStatus();
}

}  // namespace

bool IsMrtrixHeader(absl::string_view head) {
  std::size_t position = 0;
  absl::string_view line;
  return NextLine(head, &position, &line) && absl::StripAsciiWhitespace(line) == kMrtrixMark;
}

absl::StatusOr<FileLayout> ReadMrtrixLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const MrtrixText text, ReadMrtrixText(path));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<MrtrixAxis> axes, ReadMrtrixAxes(text, path));
  ISOSCOPE_ASSIGN_OR_RETURN(axes, TakeMrtrixVolumes(std::move(axes), path));
  ISOSCOPE_ASSIGN_OR_RETURN(const MrtrixType type, ReadMrtrixType(text, path));
  FileLayout layout{.wide = type.wide, .length_unit = "mm"};
  layout.location.stored_type = type.type;
  layout.location.is_big_endian = type.is_big_endian;
  ISOSCOPE_RETURN_IF_ERROR(TakeMrtrixFiles(text, path, &layout.location));
  ISOSCOPE_RETURN_IF_ERROR(TakeMrtrixGrid(text, axes, path, &layout));
  if (axes.size() == 4) {
    layout.steps = axes[3].size;  // numbered: nothing says that the fourth axis is time
    (axes[3].rank == 0 ? layout.location.components : layout.location.volume_count) = axes[3].size;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string scaling, OnlyLine(text, "scaling", path));
  if (!scaling.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> numbers,
                              NumbersOfLine(scaling, "scaling", path));
    if (numbers.size() != 2 || !std::isfinite(numbers[0]) || !std::isfinite(numbers[1]) ||
        numbers[1] == 0) {
      return MrtrixError(path, absl::StrFormat("scaling: %s; expected an offset and a factor that "
                                               "is not 0",
                                               base::Quoted(scaling)));
    }
    layout.location.intercept = numbers[0];
    layout.location.slope = numbers[1];
    if (layout.wide.has_value() && (numbers[0] != 0 || numbers[1] != 1)) {
      return MrtrixError(path,
                         "scaling of 64-bit integers or float16, which is not read: convert "
                         "it, as mrconvert -datatype float64 IN OUT does");
    }
  }
  return layout;
}

}  // namespace isoscope::source
