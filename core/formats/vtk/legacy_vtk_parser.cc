// A legacy file is a header of five lines, the grid, and arrays, each introduced by a line of text:
//
//   # vtk DataFile Version 3.0
//   a title
//   BINARY                                 or ASCII
//   DATASET STRUCTURED_POINTS
//   DIMENSIONS 64 64 93
//   ORIGIN 0 0 0
//   SPACING 1 1 2                          or DATASET RECTILINEAR_GRID (legacy_vtk_grid.cc)
//   POINT_DATA 380928                      or CELL_DATA, with one less on each axis
//   SCALARS density short 1
//   LOOKUP_TABLE default
//   (380928 samples, big-endian, and a line end)
//   FIELD FieldData 1
//   velocity 3 380928 float
//   (samples)
//   METADATA                               since version 4; ends with an empty line
//
// A binary array is passed by its size, one of text by counting its words. So one walk over the
// file (LegacyParser) finds the offsets of all arrays, and the samples are then read from there.
// Source: VTK's "File Formats", https://docs.vtk.org, and vtkDataReader for what that leaves open.

#include "core/formats/vtk/legacy_vtk_parser.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/formats/vtk/legacy_vtk_words.h"
#include "core/source/bytes/percent_code.h"
#include "core/source/bytes/text_scanner.h"

namespace isoscope::source {
namespace {

using volume::ScalarType;

constexpr absl::string_view kLegacyMark = "# vtk DataFile Version";
constexpr std::size_t kMaxLegacyArrays = 4096;
constexpr std::int64_t kMaxLegacyComponents = 4096;

// The types of VTK's writers; `long` has the 64 bits of Unix.
struct LegacyType {
  const char* name;
  ScalarType scalar;
  std::optional<WideType> wide = std::nullopt;
};
constexpr std::array<LegacyType, 14> kLegacyTypes{{
    {"char", ScalarType::kInt8},
    {"signed_char", ScalarType::kInt8},
    {"unsigned_char", ScalarType::kUint8},
    {"short", ScalarType::kInt16},
    {"unsigned_short", ScalarType::kUint16},
    {"int", ScalarType::kInt32},
    {"unsigned_int", ScalarType::kUint32},
    {"vtkidtype", ScalarType::kInt32},
    {"float", ScalarType::kFloat32},
    {"double", ScalarType::kFloat64},
    {"long", ScalarType::kFloat64, WideType::kInt64},
    {"vtktypeint64", ScalarType::kFloat64, WideType::kInt64},
    {"unsigned_long", ScalarType::kFloat64, WideType::kUint64},
    {"vtktypeuint64", ScalarType::kFloat64, WideType::kUint64},
}};

class LegacyParser {
 public:
  explicit LegacyParser(const io::RandomAccessFile* file) : words_(file) {}

  absl::StatusOr<LegacyVtkFile> Parse() {
    ISOSCOPE_RETURN_IF_ERROR(ParseHead());
    while (true) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::string keyword, words_.NextKeyword());
      if (keyword.empty()) {
        break;
      }
      ISOSCOPE_RETURN_IF_ERROR(ParseSection(keyword));
    }
    return std::move(parsed_);
  }

 private:
  enum class Part { kGrid, kPoints, kCells };

  absl::Status ParseHead() {
    ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view mark, words_.NextLine());
    if (!IsLegacyVtk(mark)) {
      return absl::InvalidArgumentError(
          absl::StrCat("no legacy VTK file: its first line is not \"", kLegacyMark, " 3.0\""));
    }
    ISOSCOPE_RETURN_IF_ERROR(words_.NextLine().status());  // the title
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string coding, words_.NextKeyword());
    if (coding != "ASCII" && coding != "BINARY") {
      return absl::InvalidArgumentError(
          absl::StrFormat("\"%s\" in its third line; expected ASCII or BINARY", coding));
    }
    parsed_.is_binary = coding == "BINARY";
    ISOSCOPE_ASSIGN_OR_RETURN(std::string keyword, words_.NextKeyword());
    if (keyword == "FIELD") {  // a file of arrays without a grid
      return NoPoints("FIELD");
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string kind, words_.NextKeyword());
    if (keyword != "DATASET") {
      return absl::InvalidArgumentError(
          absl::StrFormat("\"%s\" in its fourth line; expected DATASET", keyword));
    }
    if (kind == "RECTILINEAR_GRID") {
      parsed_.grid.SetRectilinear();
      return absl::OkStatus();
    }
    return kind == "STRUCTURED_POINTS" ? absl::OkStatus() : NoPoints(kind);
  }

  static absl::Status NoPoints(const std::string& kind) {
    const bool has_samples = kind == "STRUCTURED_GRID" || kind == "UNSTRUCTURED_GRID";
    return absl::InvalidArgumentError(absl::StrFormat(
        "a dataset of kind %s; expected STRUCTURED_POINTS or RECTILINEAR_GRID: %s", kind,
        has_samples ? "resample it, as ParaView's filter \"Resample To Image\" does, and save it "
                      "as .vti"
                    : "it holds no samples in space"));
  }

  absl::Status ParseSection(const std::string& keyword) {
    ISOSCOPE_ASSIGN_OR_RETURN(const bool is_grid,
                              parsed_.grid.Take(keyword, parsed_.is_binary, &words_));
    if (is_grid) {
      return absl::OkStatus();
    }
    if (keyword == "POINT_DATA" || keyword == "CELL_DATA") {
      return BeginPart(keyword == "POINT_DATA" ? Part::kPoints : Part::kCells);
    }
    if (keyword == "METADATA") {
      return ParseMetadata();
    }
    if (keyword == "FIELD") {
      return ParseField();
    }
    if (part_ == Part::kGrid) {
      return absl::InvalidArgumentError(
          absl::StrFormat("\"%s\" before offset %d; expected DIMENSIONS, ORIGIN, SPACING, "
                          "coordinates, FIELD, POINT_DATA or CELL_DATA",
                          keyword, words_.position()));
    }
    return ParseAttribute(keyword);
  }

  absl::Status BeginPart(Part part) {
    const math::Index3& dims = parsed_.grid.dims();
    if (dims.x == 0) {
      return absl::InvalidArgumentError("no DIMENSIONS before its arrays");
    }
    part_ = part;
    tuples_ = 1;
    for (int axis = 0; axis < 3; ++axis) {
      // A plane of points has cells, too: one layer.
      tuples_ *= part == Part::kCells ? std::max<std::int64_t>(dims[axis] - 1, 1) : dims[axis];
      if (tuples_ > words_.file().size_bytes()) {
        return absl::InvalidArgumentError(
            absl::StrFormat("DIMENSIONS %d %d %d are more samples than its %d bytes hold", dims.x,
                            dims.y, dims.z, words_.file().size_bytes()));
      }
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t count,
                              words_.NextCount(part == Part::kCells ? "CELL_DATA" : "POINT_DATA", 0,
                                               std::int64_t{1} << 60));
    if (count != tuples_) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "arrays of %d %s; DIMENSIONS %d %d %d have %d", count,
          part == Part::kCells ? "cells" : "points", dims.x, dims.y, dims.z, tuples_));
    }
    return absl::OkStatus();
  }

  // An array of the points' or cells' attributes, behind its keyword.
  absl::Status ParseAttribute(const std::string& keyword) {
    struct Attribute {
      const char* keyword;
      std::int64_t components;
    };
    constexpr std::array<Attribute, 7> kAttributes{{{"VECTORS", 3},
                                                    {"NORMALS", 3},
                                                    {"TENSORS", 9},
                                                    {"TENSORS6", 6},
                                                    {"GLOBAL_IDS", 1},
                                                    {"PEDIGREE_IDS", 1},
                                                    {"EDGE_FLAGS", 1}}};
    LegacyVtkArray array{.name = "", .tuples = tuples_, .is_of_cells = part_ == Part::kCells};
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string name, words_.NextText());
    array.name = PercentDecode(name);
    if (keyword == "SCALARS") {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::string type, words_.NextText());
      ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view rest, words_.NextLine());
      const absl::string_view components = absl::StripAsciiWhitespace(rest);
      if (!components.empty() &&
          (!absl::SimpleAtoi(components, &array.components) || array.components < 1 ||
           array.components > kMaxLegacyComponents)) {
        return absl::InvalidArgumentError(
            absl::StrFormat("SCALARS %s of \"%s\" components; expected a number from 1 to %d",
                            array.name, components.substr(0, 64), kMaxLegacyComponents));
      }
      ISOSCOPE_RETURN_IF_ERROR(PassTableName());
      return AddArray(std::move(array), type);
    }
    if (keyword == "LOOKUP_TABLE" || keyword == "COLOR_SCALARS") {
      const bool is_table = keyword == "LOOKUP_TABLE";
      ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t count,
                                words_.NextCount(keyword, 0, std::int64_t{1} << 24));
      ISOSCOPE_RETURN_IF_ERROR(words_.NextLine().status());
      return words_.PassNumbers(is_table ? count * 4 : count, is_table ? 1 : tuples_, 8,
                                parsed_.is_binary);
    }
    if (keyword == "TEXTURE_COORDINATES") {
      ISOSCOPE_ASSIGN_OR_RETURN(array.components,
                                words_.NextCount("TEXTURE_COORDINATES", 1, kMaxLegacyComponents));
    } else {
      const auto* const found =
          std::find_if(kAttributes.begin(), kAttributes.end(),
                       [&](const Attribute& known) { return keyword == known.keyword; });
      if (found == kAttributes.end()) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "\"%s\" before offset %d; expected an array, as SCALARS, VECTORS or FIELD",
            absl::CHexEscape(keyword), words_.position()));
      }
      array.components = found->components;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string type, words_.NextText());
    ISOSCOPE_RETURN_IF_ERROR(words_.NextLine().status());
    return AddArray(std::move(array), type);
  }

  // Passes the line "LOOKUP_TABLE default", which some writers leave out.
  absl::Status PassTableName() {
    constexpr absl::string_view kTable = "LOOKUP_TABLE";
    const std::int64_t begin = words_.position();
    std::string next(kTable.size(), '\0');
    if (words_.file().size_bytes() - begin >= static_cast<std::int64_t>(next.size())) {
      ISOSCOPE_RETURN_IF_ERROR(words_.file().ReadAt(begin, next.size(), next.data()));
    }
    return absl::EqualsIgnoreCase(next, kTable) ? words_.NextLine().status() : absl::OkStatus();
  }

  absl::Status ParseField() {
    ISOSCOPE_RETURN_IF_ERROR(words_.NextText().status());
    ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t count,
                              words_.NextCount("FIELD", 0, std::int64_t{kMaxLegacyArrays}));
    for (std::int64_t i = 0; i < count; ++i) {
      ISOSCOPE_ASSIGN_OR_RETURN(std::string name, words_.NextText());
      while (absl::EqualsIgnoreCase(name, "METADATA")) {  // of the array before
        ISOSCOPE_RETURN_IF_ERROR(ParseMetadata());
        ISOSCOPE_ASSIGN_OR_RETURN(name, words_.NextText());
      }
      if (name == "NULL_ARRAY") {
        continue;
      }
      LegacyVtkArray array{.name = PercentDecode(name), .is_of_cells = part_ == Part::kCells};
      ISOSCOPE_ASSIGN_OR_RETURN(array.components,
                                words_.NextCount("an array's components", 0, kMaxLegacyComponents));
      ISOSCOPE_ASSIGN_OR_RETURN(
          array.tuples, words_.NextCount("an array's tuples", 0, words_.file().size_bytes()));
      ISOSCOPE_ASSIGN_OR_RETURN(const std::string type, words_.NextText());
      ISOSCOPE_RETURN_IF_ERROR(words_.NextLine().status());
      ISOSCOPE_RETURN_IF_ERROR(AddArray(std::move(array), type));
    }
    return absl::OkStatus();
  }

  // Takes the names of components and the unit of the last array, up to an empty line.
  absl::Status ParseMetadata() {
    ISOSCOPE_RETURN_IF_ERROR(words_.NextLine().status());
    bool is_unit = false;
    std::size_t names_left = 0;
    while (!words_.is_at_end()) {
      ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view line, words_.NextLine());
      if (absl::StripAsciiWhitespace(line).empty()) {
        break;
      }
      if (last_ == nullptr) {
        continue;
      }
      if (names_left > 0) {
        last_->component_names.push_back(PercentDecode(line));
        --names_left;
      } else if (line == "COMPONENT_NAMES") {
        last_->component_names.clear();
        names_left = static_cast<std::size_t>(last_->components);
      } else if (is_unit && absl::StartsWith(line, "DATA ")) {
        constexpr std::size_t kMaxUnit = 64;
        last_->unit = PercentDecode(absl::StripAsciiWhitespace(line.substr(5))).substr(0, kMaxUnit);
      }
      is_unit = absl::StartsWith(line, "NAME UNITS_LABEL ");
    }
    return absl::OkStatus();
  }

  // The array begins here; passes it.
  absl::Status AddArray(LegacyVtkArray array, const std::string& type_name) {
    last_ = nullptr;
    const std::string type = absl::AsciiStrToLower(type_name);
    array.offset = words_.position();
    const auto* const known =
        std::find_if(kLegacyTypes.begin(), kLegacyTypes.end(),
                     [&](const LegacyType& candidate) { return type == candidate.name; });
    if (type == "string" || type == "utf8_string") {
      return words_.PassTexts(array.components * array.tuples, parsed_.is_binary);
    }
    if (known == kLegacyTypes.end() && type != "bit") {
      return absl::InvalidArgumentError(absl::StrFormat(
          "array \"%s\" is of type \"%s\"; expected char, short, int, long, each also unsigned, "
          "float or double",
          array.name, type.substr(0, 64)));
    }
    const std::int64_t bits =
        type == "bit" ? 1 : 8 * static_cast<std::int64_t>(volume::SizeOf(known->scalar));
    ISOSCOPE_RETURN_IF_ERROR(
        words_.PassNumbers(array.components, array.tuples, bits, parsed_.is_binary));
    if (part_ == Part::kGrid) {
      if ((array.name == "TIME" || array.name == "TimeValue") && array.components == 1 &&
          array.tuples == 1 && type == "double") {
        ISOSCOPE_RETURN_IF_ERROR(ReadTime(array.offset));
      }
      return absl::OkStatus();
    }
    if (array.tuples != tuples_) {
      return absl::InvalidArgumentError(
          absl::StrFormat("array \"%s\" has %d tuples; expected %d, one a sample", array.name,
                          array.tuples, tuples_));
    }
    if (type == "bit" || array.components == 0 || array.name == "vtkGhostType") {
      return absl::OkStatus();
    }
    if (parsed_.arrays.size() == kMaxLegacyArrays) {
      return absl::InvalidArgumentError(absl::StrCat("more than ", kMaxLegacyArrays, " arrays"));
    }
    array.type = known->scalar;
    array.wide = known->wide;
    last_ = &parsed_.arrays.emplace_back(std::move(array));
    return absl::OkStatus();
  }

  absl::Status ReadTime(std::int64_t offset) {
    double time = 0;
    if (parsed_.is_binary) {
      std::array<char, 8> bytes{};
      ISOSCOPE_RETURN_IF_ERROR(words_.file().ReadAt(offset, bytes.size(), bytes.data()));
      std::reverse(bytes.begin(), bytes.end());
      time = base::LoadLittleEndian<double>(bytes.data());
    } else {
      TextScanner scanner(&words_.file(), offset);
      ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view word, scanner.NextWord());
      if (!absl::SimpleAtod(word, &time)) {
        time = std::nan("");
      }
    }
    if (!std::isfinite(time)) {
      return absl::InvalidArgumentError("its TIME is no finite number");
    }
    parsed_.time = time;
    return absl::OkStatus();
  }

  LegacyWords words_;
  LegacyVtkFile parsed_;
  Part part_ = Part::kGrid;
  std::int64_t tuples_ = 0;         // of the part's arrays
  LegacyVtkArray* last_ = nullptr;  // to which METADATA belongs; null if it is passed over
};

}  // namespace

bool IsLegacyVtk(absl::string_view head) { return absl::StartsWith(head, kLegacyMark); }

absl::StatusOr<LegacyVtkFile> ParseLegacyVtk(const io::RandomAccessFile& file) {
  return LegacyParser(&file).Parse();
}

}  // namespace isoscope::source
