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
// A RectilinearGrid has no origin and spacing, but three arrays in a tag Coordinates behind
// CellData. expat gets the file in portions of 64 KiB. It is stopped at AppendedData. Which array is chosen, and what grid the tags give, is told by
// vti_choice.h and vti_grid.h. Source: VTK's file format description, "XML File Formats",
// https://docs.vtk.org.
#include "core/formats/vtk/vti_header.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

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
// Streams the file through expat until the samples are found.
class HeaderParser {
 public:
  HeaderParser() : parser_(XML_ParserCreate(nullptr)) {
    ISOSCOPE_CHECK(parser_ != nullptr);
    XML_SetUserData(parser_, this);
    XML_SetElementHandler(parser_, &HeaderParser::OnStart, &HeaderParser::OnEnd);
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
            absl::StrFormat("%s: line %d: %s: no VTK file, or it is cut", file.path(),
                            static_cast<std::int64_t>(XML_GetCurrentLineNumber(parser_)),
                            XML_ErrorString(XML_GetErrorCode(parser_))));
      }
      // expat buffers an unfinished tag.
      if (!is_done_ && offset - XML_GetCurrentByteIndex(parser_) > kMaxTagBytes) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "%s: a tag of more than %d bytes: no VTK file", file.path(), kMaxTagBytes));
      }
    }
    if (!problem_.empty()) {
      return absl::InvalidArgumentError(absl::StrCat(file.path(), ": ", problem_));
    }
    return std::move(header_);
  }

 private:
  enum class Data { kNone, kField, kPoints, kCells, kCoordinates };

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
    auto* const parser = static_cast<HeaderParser*>(self);
    const absl::string_view all(text, static_cast<std::size_t>(size));
    parser->has_data_ = parser->has_data_ ||
                        (!parser->is_in_key_ && !absl::StripLeadingAsciiWhitespace(all).empty());
    std::string* const kept = parser->kept_text_;
    if (kept != nullptr) {
      kept->append(text, std::min(all.size(), kMaxTextBytes - kept->size()));
    }
  }

  void End(const std::string& name) {
    if (name == "PointData" || name == "CellData" || name == "FieldData" || name == "Coordinates") {
      data_ = Data::kNone;
    } else if (name == "DataArray") {
      array_ = nullptr;
      kept_text_ = nullptr;
    } else if (name == "InformationKey" && array_ != nullptr) {
      kept_text_ = text_of_array_;
      is_in_key_ = false;
      array_->unit = std::string(absl::StripAsciiWhitespace(array_->unit));
      if (!has_data_) {  // VTK writes the keys of some arrays behind the samples
        array_->inline_start = EndOfTag();
      }
    }
  }

  void Start(const std::string& name, VtiHeader::Attributes attributes) {
    if (name == "VTKFile") {
      header_.is_big_endian = attributes["byte_order"] == "BigEndian";
      header_.has_long_sizes = attributes["header_type"] == "UInt64";
      header_.compressor = attributes["compressor"];
    } else if (name == "ImageData" || name == "RectilinearGrid") {
      (name == "ImageData" ? header_.is_image : header_.is_rectilinear) = true;
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
    } else if (name == "Coordinates") {
      data_ = header_.piece_count == 1 ? Data::kCoordinates : Data::kNone;
    } else if (name == "FieldData") {
      data_ = Data::kField;
    } else if (name == "DataArray") {
      StartAnyArray(std::move(attributes));
    } else if (name == "InformationKey" && array_ != nullptr) {
      is_in_key_ = true;
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

  void StartAnyArray(VtiHeader::Attributes attributes) {
    has_data_ = false;
    if (data_ == Data::kField) {
      StartField(std::move(attributes));
    } else if (data_ == Data::kCoordinates) {
      StartCoordinates(std::move(attributes));
    } else if (data_ != Data::kNone) {
      StartArray(std::move(attributes));
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
    array.component_names = ComponentNames(array.components, attributes);
    header_.arrays.push_back(std::move(array));
    array_ = &header_.arrays.back();
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

  void StartCoordinates(VtiHeader::Attributes attributes) {
    if (header_.coordinates.size() == 3) {
      return Fail("more than three arrays in its Coordinates");
    }
    header_.coordinates.push_back({.name = attributes["Name"].substr(0, kMaxTextBytes),
                                   .type = attributes["type"].substr(0, kMaxTextBytes),
                                   .format = attributes["format"].substr(0, kMaxTextBytes),
                                   .offset = attributes["offset"].substr(0, kMaxTextBytes),
                                   .inline_start = EndOfTag()});
    array_ = &header_.coordinates.back();  // a key may follow
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
  VtiHeader header_;
  Data data_ = Data::kNone;
  VtiArray* array_ = nullptr;             // the open one
  std::string* kept_text_ = nullptr;      // where text of the header goes
  std::string* text_of_array_ = nullptr;  // where it goes behind a key
  bool has_data_ = false;                 // of the open array, text in front of or between its keys
  bool is_in_key_ = false;
  bool is_done_ = false;
  std::string problem_;
};
}  // namespace

absl::StatusOr<VtiHeader> ReadWholeVtiHeader(const io::RandomAccessFile& file) {
  return HeaderParser().Parse(file);
}
}  // namespace isoscope::source
