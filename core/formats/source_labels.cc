// Where three formats keep their labels (of DICOM: dicom_child.cc):
//
//   NRRD    Segment3_LabelValue:=4              keys and values of the header, after its fields;
//           Segment3_Name:=left lung            escapes are those of NRRD: a line feed, a backslash
//           Segment3_Color:=0.5 0.68 0.46       red, green, blue, 0 to 1
//           Segment3_Layer:=0                   component of the samples
//
//   AFNI    '<VALUE_LABEL_DTABLE                the text of a string attribute, in NIML
//             ni_type="2*String"
//             ni_dimen="2" >
//            "1" "left lung"
//            "2" "right lung"
//           </VALUE_LABEL_DTABLE>~
//
//   NIfTI   byte 348 (540 of NIfTI-2): 1, 0, 0, 0 if extensions follow, each
//             int32  size, a multiple of 16, with these 8 bytes
//             int32  code: 4 AFNI, 30 Caret, ...
//             text   XML, zeros at its end:
//                      <AFNI_atr atr_name="VALUE_LABEL_DTABLE">as above, escaped</AFNI_atr>
//                      <LabelTable><Label Key="1" Red="0.5" Green="0.7" Blue="0.5">lung</Label>
//
// Sources: Slicer's vtkMRMLSegmentationStorageNode; AFNI's README.attributes and niml.h; nifti1.h;
// the GIFTI specification, section 4.6.

#include "core/formats/source_labels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

#include "core/base/check.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/formats/find_volume.h"
#include "core/formats/format_table.h"
#include "core/formats/medical/layout_formats.h"
#include "core/io/file.h"
#include "core/source/bytes/binary_header.h"
#include "core/source/bytes/file_start.h"
#include "core/source/bytes/text_header.h"
#include "expat.h"

namespace isoscope::source {
namespace {

using volume::Label;
using volume::LabelColor;

constexpr std::size_t kLabelHeadBytes = 1024;
constexpr std::size_t kMaxExtensionBytes = std::size_t{4} << 20;  // all of a file
constexpr std::size_t kNifti1Bytes = 348;
constexpr std::size_t kNifti2Bytes = 540;

// A colour of three numbers from 0 to 1; not set if they are something else.
std::optional<LabelColor> ColorOfShares(const std::vector<std::string>& shares) {
  std::array<std::uint8_t, 3> bytes{};
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    double share = 0;
    if (shares.size() != bytes.size() || !absl::SimpleAtod(shares[i], &share) ||
        !(share >= 0 && share <= 1)) {
      return std::nullopt;
    }
    bytes[i] = static_cast<std::uint8_t>(std::floor(share * 255 + 0.5));
  }
  return LabelColor{.red = bytes[0], .green = bytes[1], .blue = bytes[2]};
}

absl::StatusOr<Label> MakeLabel(absl::string_view value, absl::string_view name,
                                std::optional<LabelColor> color) {
  Label label{.name = volume::CleanLabelName(name), .color = color};
  if (!absl::SimpleAtod(value, &label.value) || !std::isfinite(label.value)) {
    return absl::InvalidArgumentError(
        absl::StrCat("the label \"", label.name, "\" has the value \"",
                     base::Printable(value.substr(0, 40)), "\"; expected a number"));
  }
  return label;
}

// The labels by value. Those of a value with several names are left out.
absl::StatusOr<std::vector<Label>> Finish(std::vector<Label> all) {
  volume::SortLabels(&all);
  std::vector<Label> labels;
  for (auto first = all.begin(); first != all.end();) {
    const auto last = std::find_if(first, all.end(),
                                   [&](const Label& label) { return label.value != first->value; });
    if (std::all_of(first, last, [&](const Label& label) { return label.name == first->name; })) {
      labels.push_back(std::move(*first));
    }
    first = last;
  }
  ISOSCOPE_RETURN_IF_ERROR(volume::ValidateLabels(labels));
  return labels;
}

struct Segment {
  std::string value{};
  std::string name{};
  std::string color{};
};

absl::StatusOr<std::vector<Label>> NrrdLabels(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, ReadTextHeader(path));
  std::map<std::int64_t, Segment> segments;
  std::size_t position = 0;
  absl::string_view line;
  while (NextLine(text, &position, &line) && !line.empty()) {
    const std::size_t middle = line.find(":=");
    if (middle == absl::string_view::npos || !absl::ConsumePrefix(&line, "Segment")) {
      continue;
    }
    const std::vector<absl::string_view> key = absl::StrSplit(
        line.substr(0, middle - absl::string_view("Segment").size()), absl::MaxSplits('_', 1));
    std::int64_t number = 0;
    if (key.size() != 2 || !absl::SimpleAtoi(key[0], &number)) {
      continue;
    }
    const std::string value =
        absl::StrReplaceAll(line.substr(line.find(":=") + 2), {{"\\n", "\n"}, {"\\\\", "\\"}});
    Segment& segment = segments[number];
    if (key[1] == "LabelValue") {
      segment.value = value;
    } else if (key[1] == "Name") {
      segment.name = value;
    } else if (key[1] == "Color") {
      segment.color = value;
    }
  }
  std::vector<Label> labels;
  for (const auto& [number, segment] : segments) {
    if (!segment.value.empty()) {  // old files have a component for each segment
      ISOSCOPE_ASSIGN_OR_RETURN(
          labels.emplace_back(),
          MakeLabel(segment.value, segment.name,
                    ColorOfShares(absl::StrSplit(segment.color, ' ', absl::SkipEmpty()))));
    }
  }
  return Finish(std::move(labels));
}

// The strings in quotation marks of a table of AFNI, which begins in `text`.
absl::StatusOr<std::vector<Label>> AfniTable(absl::string_view text) {
  std::vector<std::string> words;
  const std::size_t begin = text.find('>');
  std::size_t end = text.find("</VALUE_LABEL_DTABLE");
  if (begin == absl::string_view::npos || end == absl::string_view::npos || end < begin) {
    return absl::InvalidArgumentError("the table VALUE_LABEL_DTABLE is cut");
  }
  text = text.substr(begin + 1, end - begin - 1);
  for (std::size_t at = 0; (at = text.find_first_of("\"'", at)) != absl::string_view::npos;) {
    end = text.find(text[at], at + 1);
    if (end == absl::string_view::npos || words.size() > 2 * volume::kMaxNamedLabels) {
      return absl::InvalidArgumentError(absl::StrCat(
          "the table VALUE_LABEL_DTABLE has ",
          end == absl::string_view::npos ? "a string without its end" : "too many labels"));
    }
    words.push_back(absl::StrReplaceAll(
        text.substr(at + 1, end - at - 1),
        {{"&quot;", "\""}, {"&apos;", "'"}, {"&lt;", "<"}, {"&gt;", ">"}, {"&amp;", "&"}}));
    at = end + 1;
  }
  if (words.size() % 2 != 0) {
    return absl::InvalidArgumentError(absl::StrCat("the table VALUE_LABEL_DTABLE has ",
                                                   words.size(),
                                                   " strings; expected pairs of value and name"));
  }
  std::vector<Label> labels;
  for (std::size_t i = 0; i < words.size(); i += 2) {
    ISOSCOPE_ASSIGN_OR_RETURN(labels.emplace_back(),
                              MakeLabel(words[i], words[i + 1], std::nullopt));
  }
  return Finish(std::move(labels));
}

absl::StatusOr<std::vector<Label>> AfniLabels(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, ReadTextHeader(path));
  const std::size_t begin = text.find("'<VALUE_LABEL_DTABLE");
  return begin == std::string::npos ? std::vector<Label>()
                                    : AfniTable(absl::string_view(text).substr(begin));
}

// The text of one extension: the first LabelTable, and the table of AFNI.
class LabelXml {
 public:
  LabelXml() : parser_(XML_ParserCreate(nullptr)) {
    ISOSCOPE_CHECK(parser_ != nullptr);
    XML_SetUserData(parser_, this);
    XML_SetElementHandler(parser_, &LabelXml::OnStart, &LabelXml::OnEnd);
    XML_SetCharacterDataHandler(parser_, &LabelXml::OnText);
    // No table declares entities; they could make a short text long.
    XML_SetStartDoctypeDeclHandler(parser_, &LabelXml::OnDoctype);
  }
  ~LabelXml() { XML_ParserFree(parser_); }
  LabelXml(const LabelXml&) = delete;
  LabelXml& operator=(const LabelXml&) = delete;

  absl::StatusOr<std::vector<Label>> Parse(absl::string_view xml) {
    const bool is_xml =
        XML_Parse(parser_, xml.data(), static_cast<int>(xml.size()), 1) == XML_STATUS_OK;
    ISOSCOPE_RETURN_IF_ERROR(problem_);
    if (!is_xml && (tables_ > 0 || !afni_.empty())) {
      return absl::InvalidArgumentError(
          absl::StrCat("line ", XML_GetCurrentLineNumber(parser_),
                       " of the table: ", XML_ErrorString(XML_GetErrorCode(parser_))));
    }
    if (const std::size_t begin = afni_.find("<VALUE_LABEL_DTABLE"); begin != std::string::npos) {
      return AfniTable(absl::string_view(afni_).substr(begin));
    }
    return Finish(std::move(labels_));
  }

 private:
  static void XMLCALL OnStart(void* self, const XML_Char* name, const XML_Char** attributes) {
    static_cast<LabelXml*>(self)->Start(name, attributes);
  }
  static void XMLCALL OnEnd(void* self, const XML_Char* /*name*/) {
    static_cast<LabelXml*>(self)->End();
  }
  static void XMLCALL OnText(void* self, const XML_Char* text, int size) {
    auto* const xml = static_cast<LabelXml*>(self);
    if (xml->text_ != nullptr && xml->text_->size() < kMaxExtensionBytes) {
      xml->text_->append(text, static_cast<std::size_t>(size));
    }
  }
  static void XMLCALL OnDoctype(void* self, const XML_Char* /*name*/, const XML_Char* /*system*/,
                                const XML_Char* /*public_id*/, int /*has_subset*/) {
    static_cast<LabelXml*>(self)->Stop(
        absl::InvalidArgumentError("the XML of the extension declares a document type"));
  }

  void Start(absl::string_view name, const XML_Char** attributes) {
    std::map<std::string, std::string> values;
    for (; attributes[0] != nullptr; attributes += 2) {
      values[attributes[0]] = attributes[1];
    }
    if (name == "LabelTable") {
      ++tables_;
    } else if (name == "Label" && tables_ == 1 && values.count("Key") > 0) {
      absl::StatusOr<Label> label = MakeLabel(
          values["Key"], "", ColorOfShares({values["Red"], values["Green"], values["Blue"]}));
      if (!label.ok() || labels_.size() >= volume::kMaxNamedLabels) {
        Stop(label.ok() ? absl::InvalidArgumentError("too many labels") : label.status());
        return;
      }
      labels_.push_back(*std::move(label));
      text_ = &name_;
    } else if (name == "AFNI_atr" && values["atr_name"] == "VALUE_LABEL_DTABLE") {
      text_ = &afni_;
    }
  }
  void End() {
    if (text_ == &name_) {
      labels_.back().name = volume::CleanLabelName(name_);
      name_.clear();
    }
    text_ = nullptr;
  }
  void Stop(const absl::Status& problem) {
    problem_ = problem;
    text_ = nullptr;
    XML_StopParser(parser_, XML_FALSE);
  }

  XML_Parser parser_;
  std::vector<Label> labels_;
  std::string name_;             // of the label that is open
  std::string afni_;             // the table of AFNI
  std::string* text_ = nullptr;  // where text goes; null: nowhere
  int tables_ = 0;
  absl::Status problem_;
};

absl::StatusOr<std::vector<Label>> NiftiLabels(const std::string& path, bool is_second) {
  const std::size_t header_bytes = is_second ? kNifti2Bytes : kNifti1Bytes;
  ISOSCOPE_ASSIGN_OR_RETURN(const FileStart start,
                            ReadFileStart(path, header_bytes + 4 + kMaxExtensionBytes));
  if (start.bytes.size() < header_bytes + 4 || start.bytes[header_bytes] == 0) {
    return std::vector<Label>();
  }
  const BinaryHeader file(start.bytes,
                          BeginsBigEndian(start.bytes, static_cast<std::uint32_t>(header_bytes)));
  // The extensions end in front of the samples, if these are in this file.
  const bool is_pair = file.bytes().substr(is_second ? 4 : 344, 3) == (is_second ? "ni2" : "ni1");
  const double offset = is_second ? static_cast<double>(file.Load<std::int64_t>(168))
                                  : static_cast<double>(file.Load<float>(108));
  const auto size = static_cast<double>(file.bytes().size());
  const auto end =
      static_cast<std::size_t>(!is_pair && offset >= 0 && offset < size ? offset : size);
  for (std::size_t at = header_bytes + 4; end >= 8 && at <= end - 8;) {
    const auto bytes = static_cast<std::size_t>(std::max(0, file.Load<std::int32_t>(at)));
    if (bytes < 8 || bytes > end - at) {
      break;  // samples are read by others, who need no extensions
    }
    absl::string_view text = absl::string_view(file.bytes()).substr(at + 8, bytes - 8);
    text = absl::StripAsciiWhitespace(text.substr(0, text.find('\0')));
    if (absl::StartsWith(text, "<")) {
      ISOSCOPE_ASSIGN_OR_RETURN(std::vector<Label> labels, LabelXml().Parse(text));
      if (!labels.empty()) {
        return labels;
      }
    }
    at += bytes;
  }
  return std::vector<Label>();
}

absl::StatusOr<std::vector<Label>> LabelsOfHeader(const std::string& header,
                                                  absl::string_view head) {
  if (absl::StartsWith(head, "NRRD000")) {
    return NrrdLabels(header);
  }
  if (IsNifti1Header(head) || IsNifti2Header(head)) {
    return NiftiLabels(header, IsNifti2Header(head));
  }
  return IsAfniHeader(head) ? AfniLabels(header) : std::vector<Label>();
}

}  // namespace

std::optional<std::string> FileOfSourceLabels(const std::string& path,
                                              absl::Span<const Format> formats) {
  const auto found = FindVolume(path, "", formats);
  if (found.ok() && found->format->read_labels != nullptr) {
    return std::nullopt;
  }
  std::string header = LayoutHeaderPath(found.ok() ? found->request.file : path);
  if (!io::PathExists(header) || io::IsDirectory(header)) {
    return std::nullopt;
  }
  return header;
}

absl::StatusOr<std::vector<Label>> ReadSourceLabels(const std::string& path,
                                                    absl::Span<const Format> formats) {
  if (const auto found = FindVolume(path, "", formats);
      found.ok() && found->format->read_labels != nullptr) {
    return found->format->read_labels(path);
  }
  const std::optional<std::string> header = FileOfSourceLabels(path, formats);
  if (!header.has_value()) {
    return std::vector<Label>();
  }
  const absl::StatusOr<FileStart> start = ReadFileStart(*header, kLabelHeadBytes);
  if (!start.ok()) {
    return std::vector<Label>();
  }
  absl::StatusOr<std::vector<Label>> labels = LabelsOfHeader(*header, start->bytes);
  if (!labels.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(*header, ": ", labels.status().message()));
  }
  return labels;
}

}  // namespace isoscope::source
