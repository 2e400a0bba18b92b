// A VTK ImageData file is XML; the samples stand in it or behind it:
//
//   <VTKFile type="ImageData" byte_order="LittleEndian" header_type="UInt64"
//            compressor="vtkZLibDataCompressor">
//    <ImageData WholeExtent="0 63 0 63 0 92" Origin="0 0 0" Spacing="3.2 3.2 1.5">
//     <Piece Extent="0 63 0 63 0 92">
//      <PointData Scalars="density">
//       <DataArray type="Int16" Name="density" format="appended" offset="0"/>
//       <DataArray type="Float32" Name="velocity" NumberOfComponents="3" format="binary">
//        AQAAAACAAABQCgAA...                          inline: base64
//       </DataArray>
//      </PointData>
//      <CellData> ... </CellData>
//     </Piece>
//    </ImageData>
//    <AppendedData encoding="raw">_...</AppendedData>    bytes: no XML from the underscore on
//   </VTKFile>
//
// expat gets the file in portions of 64 KiB. It is stopped at AppendedData, or at an inline array
// that is certain to be chosen: the text behind it may have gigabytes. Handlers get tags only, and
// no text. An extent counts points, inclusive: "0 63" are 64 points and 63 cells. Source: VTK's
// file format description, "XML File Formats", https://docs.vtk.org.

#include "core/source/vti_header.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdlib>
#include <limits>
#include <type_traits>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "expat.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxHeaderBytes = 64 * base::kMiB;  // of XML before the first array
constexpr std::int64_t kMaxTagBytes = base::kMiB;
constexpr std::size_t kMaxTextBytes = 4096;  // of a name
constexpr std::size_t kMaxArrays = 4096;
constexpr std::int64_t kMaxComponents = 4096;
constexpr std::int64_t kMaxNamedComponents = 9;  // of a tensor; names of more are left out

struct KnownType {
  const char* name;
  volume::ScalarType type;
};
constexpr std::array<KnownType, 8> kTypes{{{"UInt8", volume::ScalarType::kUint8},
                                           {"Int8", volume::ScalarType::kInt8},
                                           {"UInt16", volume::ScalarType::kUint16},
                                           {"Int16", volume::ScalarType::kInt16},
                                           {"UInt32", volume::ScalarType::kUint32},
                                           {"Int32", volume::ScalarType::kInt32},
                                           {"Float32", volume::ScalarType::kFloat32},
                                           {"Float64", volume::ScalarType::kFloat64}}};

const KnownType* FindType(const std::string& name) {
  const auto* row = std::find_if(kTypes.begin(), kTypes.end(),
                                 [&](const KnownType& known) { return name == known.name; });
  return row == kTypes.end() ? nullptr : row;
}

// Whether an array may be the default. VTK marks ghost points and cells in an array of its own,
// which may not.
bool IsEligible(const VtiArray& array) {
  return array.components == 1 && FindType(array.type) != nullptr && array.name != "vtkGhostType";
}

// Streams the file through expat until the samples are found.
class HeaderParser {
 public:
  explicit HeaderParser(std::string part)
      : parser_(XML_ParserCreate(nullptr)), part_(std::move(part)) {
    ISOSCOPE_CHECK(parser_ != nullptr);
    XML_SetUserData(parser_, this);
    XML_SetElementHandler(parser_, &HeaderParser::OnStart, &HeaderParser::OnEnd);
  }
  // Parses all arrays, with their units and the time.
  HeaderParser() : HeaderParser(std::string()) {
    is_whole_ = true;
    XML_SetCharacterDataHandler(parser_, &HeaderParser::OnText);
  }
  ~HeaderParser() { XML_ParserFree(parser_); }
  HeaderParser(const HeaderParser&) = delete;
  HeaderParser& operator=(const HeaderParser&) = delete;

  absl::StatusOr<VtiHeader> Parse(const io::RandomAccessFile& file) {
    std::string buffer(static_cast<std::size_t>(64 * base::kKiB), '\0');
    std::int64_t offset = 0;
    while (!is_done_ && offset < file.size_bytes()) {
      if (offset > kMaxHeaderBytes && header_.arrays.empty()) {
        return absl::InvalidArgumentError(
            absl::StrFormat("%s: no array in the first %d bytes", file.path(), kMaxHeaderBytes));
      }
      const auto size = static_cast<std::size_t>(
          std::min(file.size_bytes() - offset, static_cast<std::int64_t>(buffer.size())));
      ISOSCOPE_RETURN_IF_ERROR(file.ReadAt(offset, size, buffer.data()));
      offset += static_cast<std::int64_t>(size);
      if (XML_Parse(parser_, buffer.data(), static_cast<int>(size),
                    offset == file.size_bytes() ? 1 : 0) == XML_STATUS_ERROR &&
          !is_done_) {
        return absl::InvalidArgumentError(
            absl::StrFormat("%s: line %d: %s: no VTK ImageData file, or it is cut", file.path(),
                            static_cast<std::int64_t>(XML_GetCurrentLineNumber(parser_)),
                            XML_ErrorString(XML_GetErrorCode(parser_))));
      }
      // expat buffers an unfinished tag.
      if (!is_done_ && offset - XML_GetCurrentByteIndex(parser_) > kMaxTagBytes) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "%s: a tag of more than %d bytes: no VTK ImageData file", file.path(), kMaxTagBytes));
      }
    }
    if (!problem_.empty()) {
      return absl::InvalidArgumentError(absl::StrCat(file.path(), ": ", problem_));
    }
    return std::move(header_);
  }

 private:
  enum class Data { kNone, kField, kPoints, kCells };

  static void XMLCALL OnStart(void* self, const XML_Char* name, const XML_Char** attributes) {
    VtiHeader::Attributes map;
    for (; attributes[0] != nullptr; attributes += 2) {
      map[attributes[0]] = attributes[1];
    }
    static_cast<HeaderParser*>(self)->Start(name, std::move(map));
  }
  static void XMLCALL OnEnd(void* self, const XML_Char* name) {
    static_cast<HeaderParser*>(self)->End(name);
  }
  static void XMLCALL OnText(void* self, const XML_Char* text, int size) {
    std::string* const kept = static_cast<HeaderParser*>(self)->kept_text_;
    if (kept != nullptr) {
      kept->append(text, std::min(static_cast<std::size_t>(size), kMaxTextBytes - kept->size()));
    }
  }

  void End(const std::string& name) {
    if (name == "PointData" || name == "CellData" || name == "FieldData") {
      data_ = Data::kNone;
    } else if (name == "DataArray") {
      array_ = nullptr;
      kept_text_ = nullptr;
    } else if (name == "InformationKey" && array_ != nullptr) {
      kept_text_ = text_of_array_;
      array_->unit = std::string(absl::StripAsciiWhitespace(array_->unit));
      array_->inline_start = EndOfTag();
    }
  }

  void Start(const std::string& name, VtiHeader::Attributes attributes) {
    if (name == "VTKFile") {
      header_.is_big_endian = attributes["byte_order"] == "BigEndian";
      header_.has_long_sizes = attributes["header_type"] == "UInt64";
      header_.compressor = attributes["compressor"];
    } else if (name == "ImageData") {
      header_.is_image = true;
      header_.image = std::move(attributes);
    } else if (name == "Piece") {
      ++header_.piece_count;
      if (header_.piece_count == 1) {
        header_.piece_extent = attributes["Extent"];
      }
    } else if (name == "PointData" || name == "CellData") {
      const bool is_first = header_.piece_count == 1;
      data_ = !is_first ? Data::kNone : name == "PointData" ? Data::kPoints : Data::kCells;
      if (is_first) {
        (name == "PointData" ? header_.point_scalars : header_.cell_scalars) =
            attributes["Scalars"];
      }
    } else if (name == "FieldData") {
      data_ = is_whole_ ? Data::kField : Data::kNone;
    } else if (name == "DataArray" && data_ == Data::kField) {
      StartField(std::move(attributes));
    } else if (name == "DataArray" && data_ != Data::kNone) {
      StartArray(std::move(attributes));
    } else if (name == "InformationKey" && array_ != nullptr) {
      text_of_array_ = kept_text_;  // goes on behind the key
      kept_text_ = nullptr;
      if (attributes["name"] == "UNITS_LABEL") {
        array_->unit.clear();
        kept_text_ = &array_->unit;
      }
    } else if (name == "AppendedData") {
      header_.appended_encoding = attributes["encoding"];
      header_.appended_start = EndOfTag();
      Stop();  // the rest need not be XML
    }
  }

  void StartArray(VtiHeader::Attributes attributes) {
    array_ = nullptr;  // the arrays move
    kept_text_ = nullptr;
    VtiArray array{.name = attributes["Name"],
                   .type = attributes["type"],
                   .is_of_cells = data_ == Data::kCells,
                   .format = attributes["format"],
                   .offset = attributes["offset"],
                   .inline_start = EndOfTag()};
    const std::string& components = attributes["NumberOfComponents"];
    if (!components.empty() && (!absl::SimpleAtoi(components, &array.components) ||
                                array.components < 1 || array.components > kMaxComponents)) {
      return Fail(absl::StrFormat("array \"%s\" of %s components; expected 1 to %d",
                                  array.name.substr(0, kMaxTextBytes),
                                  components.substr(0, kMaxTextBytes), kMaxComponents));
    }
    if (header_.arrays.size() == kMaxArrays ||
        std::max({array.name.size(), array.type.size(), array.format.size(), array.offset.size()}) >
            kMaxTextBytes) {
      return Fail(absl::StrFormat("more than %d arrays, or one with a name of more than %d bytes",
                                  kMaxArrays, kMaxTextBytes));
    }
    if (is_whole_) {
      array.component_names = ComponentNames(array.components, attributes);
    }
    header_.arrays.push_back(std::move(array));
    const VtiArray& last = header_.arrays.back();
    if (!is_whole_ && last.format != "appended" && IsCertain(last)) {
      Stop();
    }
    array_ = is_whole_ ? &header_.arrays.back() : nullptr;
  }

  void StartField(VtiHeader::Attributes attributes) {
    if (attributes["Name"] != "TimeValue" || header_.time_value.has_value()) {
      return;
    }
    header_.time_value = VtiArray{.name = "TimeValue",
                                  .type = attributes["type"].substr(0, kMaxTextBytes),
                                  .format = attributes["format"].substr(0, kMaxTextBytes),
                                  .offset = attributes["offset"].substr(0, kMaxTextBytes),
                                  .inline_start = EndOfTag()};
    array_ = &*header_.time_value;
    if (array_->format == "ascii") {
      kept_text_ = &array_->text;
    }
  }

  // One name each, or none.
  static std::vector<std::string> ComponentNames(std::int64_t components,
                                                 const VtiHeader::Attributes& attributes) {
    std::vector<std::string> names;
    for (std::int64_t i = 0; i < components && components <= kMaxNamedComponents; ++i) {
      const auto found = attributes.find(absl::StrCat("ComponentName", i));
      if (found == attributes.end() || found->second.empty() ||
          found->second.size() > kMaxTextBytes) {
        return {};
      }
      names.push_back(found->second);
    }
    return names;
  }

  // Whether no array that follows can be preferred to this one.
  [[nodiscard]] bool IsCertain(const VtiArray& array) const {
    if (array.is_of_cells) {
      return false;  // PointData may follow
    }
    if (!part_.empty()) {
      return array.name == part_;
    }
    return IsEligible(array) &&
           (header_.point_scalars.empty() || header_.point_scalars == array.name);
  }

  [[nodiscard]] std::int64_t EndOfTag() const {
    return static_cast<std::int64_t>(XML_GetCurrentByteIndex(parser_)) +
           XML_GetCurrentByteCount(parser_);
  }
  void Stop() {
    is_done_ = true;
    XML_StopParser(parser_, XML_FALSE);
  }
  void Fail(std::string problem) {
    problem_ = std::move(problem);
    Stop();
  }

  XML_Parser parser_;
  const std::string part_;
  VtiHeader header_;
  Data data_ = Data::kNone;
  bool is_whole_ = false;
  VtiArray* array_ = nullptr;             // the open one, if is_whole_
  std::string* kept_text_ = nullptr;      // where text of the header goes
  std::string* text_of_array_ = nullptr;  // where it goes behind a key
  bool is_done_ = false;
  std::string problem_;
};

// `count` numbers in `text`.
template <typename T>
absl::StatusOr<std::vector<T>> ParseNumbers(const std::string& text, std::size_t count,
                                            const char* what, const std::string& path) {
  std::vector<T> numbers;
  for (const absl::string_view part :
       absl::StrSplit(text, absl::ByAnyChar(" \t\r\n"), absl::SkipEmpty())) {
    T number{};
    bool is_number = false;
    if constexpr (std::is_same_v<T, double>) {
      is_number = absl::SimpleAtod(part, &number);
    } else {
      is_number = absl::SimpleAtoi(part, &number);
    }
    if (!is_number) {
      break;
    }
    numbers.push_back(number);
  }
  if (numbers.size() != count) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %s=\"%s\"; expected %d numbers", path, what, text, count));
  }
  return numbers;
}

// The extent of the image, which its first piece must fill.
absl::StatusOr<VtiExtent> WholeExtent(const VtiHeader& header, const std::string& path) {
  const auto found = header.image.find("WholeExtent");
  const std::string text = found == header.image.end() ? "" : found->second;
  ISOSCOPE_ASSIGN_OR_RETURN(const VtiExtent extent, ParseVtiExtent(text, "WholeExtent", path));
  ISOSCOPE_ASSIGN_OR_RETURN(const VtiExtent piece,
                            ParseVtiExtent(header.piece_extent, "Extent", path));
  if (piece != extent) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: its first piece is %s of %s; expected the whole image in one piece",
                        path, header.piece_extent, text));
  }
  return extent;
}

// "point array "velocity" of 3 components, cell array "p"".
std::string Listed(const VtiHeader& header) {
  constexpr std::size_t kMaxListed = 50;
  std::vector<std::string> lines;
  for (const VtiArray& array : header.arrays) {
    if (lines.size() == kMaxListed) {
      lines.emplace_back("and more");
      break;
    }
    lines.push_back(absl::StrCat(
        array.is_of_cells ? "cell" : "point", " array \"", array.name, "\"",
        array.components > 1 ? absl::StrCat(" of ", array.components, " components") : ""));
  }
  return absl::StrJoin(lines, ", ");
}

const VtiArray* FindNamed(const VtiHeader& header, absl::string_view name) {
  const VtiArray* found = nullptr;
  for (const VtiArray& array : header.arrays) {
    if (array.name == name && (found == nullptr || (found->is_of_cells && !array.is_of_cells))) {
      found = &array;
    }
  }
  return found;
}

const VtiArray* FindDefault(const VtiHeader& header) {
  const VtiArray* found = nullptr;
  const auto rank = [&](const VtiArray& array) {
    return array.is_of_cells ? (array.name == header.cell_scalars ? 1 : 0)
                             : (array.name == header.point_scalars ? 3 : 2);
  };
  for (const VtiArray& array : header.arrays) {
    if (IsEligible(array) && (found == nullptr || rank(array) > rank(*found))) {
      found = &array;
    }
  }
  return found;
}

absl::Status WithoutChoice(const VtiHeader& header, const VtiArray& array,
                           const std::string& path) {
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: array \"%s\" has %d components: choose one of 0 to %d, as in %s:%s:0; the file holds %s",
      path, array.name, array.components, array.components - 1, path, array.name, Listed(header)));
}

}  // namespace

absl::StatusOr<VtiHeader> ReadVtiHeader(const io::RandomAccessFile& file, const std::string& part) {
  return HeaderParser(part).Parse(file);
}

absl::StatusOr<VtiHeader> ReadWholeVtiHeader(const io::RandomAccessFile& file) {
  return HeaderParser().Parse(file);
}

absl::StatusOr<VtiChoice> ChooseVtiArray(const VtiHeader& header, const std::string& part,
                                         const std::string& path) {
  if (!header.is_image || header.piece_count < 1 || header.arrays.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": no ImageData with an array in its PointData or CellData"));
  }
  if (part.empty()) {
    const VtiArray* found = FindDefault(header);
    if (found != nullptr) {
      return VtiChoice{*found, 0};
    }
    const auto single = std::find_if(header.arrays.begin(), header.arrays.end(),
                                     [](const VtiArray& array) { return array.components == 1; });
    if (single != header.arrays.end()) {
      return VtiChoice{*single, 0};  // its type is refused later, by name
    }
    return WithoutChoice(header, header.arrays.front(), path);
  }
  const VtiArray* found = FindNamed(header, part);
  if (found != nullptr) {
    return found->components == 1 ? absl::StatusOr<VtiChoice>(VtiChoice{*found, 0})
                                  : WithoutChoice(header, *found, path);
  }
  const std::size_t colon = part.rfind(':');
  std::int64_t component = -1;
  if (colon != std::string::npos && absl::SimpleAtoi(part.substr(colon + 1), &component)) {
    found = FindNamed(header, part.substr(0, colon));
  }
  if (found == nullptr) {
    return absl::NotFoundError(
        absl::StrFormat("%s: no array \"%s\"; it holds %s", path, part, Listed(header)));
  }
  if (component < 0 || component >= found->components) {
    return WithoutChoice(header, *found, path);
  }
  return VtiChoice{*found, component};
}

absl::StatusOr<volume::ScalarType> VtiTypeOf(const VtiArray& array, const std::string& path) {
  const KnownType* known = FindType(array.type);
  if (known == nullptr) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: array \"%s\" is of type \"%s\"; expected (U)Int8, (U)Int16, (U)Int32, Float32 or "
        "Float64",
        path, array.name, array.type));
  }
  return known->type;
}

bool IsVtiNumber(const std::string& type) {
  return FindType(type) != nullptr || type == "Int64" || type == "UInt64";
}

absl::StatusOr<VtiExtent> ParseVtiExtent(const std::string& text, const char* attribute,
                                         const std::string& path) {
  constexpr std::int64_t kMaxIndex = std::numeric_limits<std::int32_t>::max();  // VTK's own
  VtiExtent extent{};
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::int64_t> numbers,
                            ParseNumbers<std::int64_t>(text, extent.size(), attribute, path));
  for (const std::int64_t index : numbers) {
    if (index < -kMaxIndex || index > kMaxIndex) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: %s=\"%s\"; expected 32-bit numbers", path, attribute, text));
    }
  }
  std::copy(numbers.begin(), numbers.end(), extent.begin());
  return extent;
}

absl::StatusOr<volume::GridGeometry> VtiGridOf(const VtiHeader::Attributes& image,
                                               const VtiExtent& extent, bool is_of_cells,
                                               const std::string& path) {
  const auto get = [&](const char* name, const char* fallback) {
    const auto found = image.find(name);
    return found == image.end() ? std::string(fallback) : found->second;
  };
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> origin,
                            ParseNumbers<double>(get("Origin", "0 0 0"), 3, "Origin", path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> spacing,
                            ParseNumbers<double>(get("Spacing", "1 1 1"), 3, "Spacing", path));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::vector<double> direction,
      ParseNumbers<double>(get("Direction", "1 0 0 0 1 0 0 0 1"), 9, "Direction", path));
  volume::GridGeometry geometry;
  geometry.origin = {origin[0], origin[1], origin[2]};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto index = static_cast<int>(axis);
    const std::int64_t point_count = extent[2 * axis + 1] - extent[2 * axis] + 1;
    geometry.sample_dims[index] = point_count - (is_of_cells ? 1 : 0);
    geometry.spacing[index] = spacing[axis];
    geometry.direction.columns[axis] = {direction[axis], direction[3 + axis], direction[6 + axis]};
    // VTK's origin is that of the point with index 0.
    const double first = static_cast<double>(extent[2 * axis]) + (is_of_cells ? 0.5 : 0.0);
    geometry.origin = geometry.origin + geometry.direction.columns[axis] * (spacing[axis] * first);
  }
  return geometry;
}

absl::StatusOr<volume::GridGeometry> VtiGeometry(const VtiHeader& header, bool is_of_cells,
                                                 const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const VtiExtent extent, WholeExtent(header, path));
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry,
                            VtiGridOf(header.image, extent, is_of_cells, path));
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(
        valid.code(),
        absl::StrCat(path, is_of_cells ? ": the centres of its cells: " : ": ", valid.message()));
  }
  return geometry;
}

}  // namespace isoscope::source
