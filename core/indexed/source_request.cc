// Each member of a request that is set has a line of text:
//
//   path           /data/run.zarr/0
//   raw            512,512,234 uint16 big 352          dims, type, byte order, header bytes
//   format, dicom_series, axes                         as they were given
//   ignores_shear, resamples                           yes
//   crop           0:64,0:64,10:20
//   stride         2
//   fill           -999                                17 digits: any double comes back
//   fields         one a line
//   steps          0:10:1
//
// The partitioner of a series adds which of its volumes it is:
//
//   volume_field   density
//   volume_component, volume_step                      2

#include "core/indexed/source_request.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "core/base/status_macros.h"
#include "core/io/mounted_file.h"
#include "core/source/source_stamps.h"
#include "core/store/source_volume.h"

namespace isoscope::indexed {
namespace {

constexpr absl::string_view kYes = "yes";

// Integers with one separator between them.
template <typename Integer, std::size_t kCount>
bool ParseIntegers(absl::string_view text, char separator, Integer (&numbers)[kCount]) {
  const std::vector<absl::string_view> parts = absl::StrSplit(text, separator);
  bool is_good = parts.size() == kCount;
  for (std::size_t i = 0; is_good && i < kCount; ++i) {
    is_good = absl::SimpleAtoi(parts[i], &numbers[i]);
  }
  return is_good;
}

std::string TextOf(const source::RawFormat& raw) {
  return absl::StrCat(raw.dims.x, ",", raw.dims.y, ",", raw.dims.z, " ", volume::NameOf(raw.type),
                      raw.is_big_endian ? " big " : " little ", raw.header_bytes);
}

bool ParseRaw(absl::string_view text, std::optional<source::RawFormat>* raw) {
  const std::vector<absl::string_view> parts = absl::StrSplit(text, ' ');
  std::int64_t dims[3] = {};
  source::RawFormat& format = raw->emplace();
  if (parts.size() != 4 || !ParseIntegers(parts[0], ',', dims) ||
      (parts[2] != "big" && parts[2] != "little") ||
      !absl::SimpleAtoi(parts[3], &format.header_bytes) || format.header_bytes < 0 || dims[0] < 1 ||
      dims[1] < 1 || dims[2] < 1) {
    return false;
  }
  const auto type = volume::ScalarTypeFromName(parts[1]);
  format.dims = {dims[0], dims[1], dims[2]};
  format.is_big_endian = parts[2] == "big";
  format.type = type.value_or(format.type);
  return type.ok();
}

std::string TextOf(const source::SampleBox& box) {
  const auto& [begin, end] = box;
  return absl::StrFormat("%d:%d,%d:%d,%d:%d", begin.x, end.x, begin.y, end.y, begin.z, end.z);
}

bool ParseCrop(absl::string_view text, std::optional<source::SampleBox>* crop) {
  const auto box = source::ParseSampleBox(text);
  if (box.ok()) {
    *crop = *box;
  }
  return box.ok();
}

bool ParseSwitch(absl::string_view text, bool* is_set) {
  *is_set = text == kYes;
  return *is_set;
}

bool ParseText(absl::string_view text, std::string* out) {
  *out = std::string(text);
  return true;
}

bool ParseSteps(absl::string_view text, std::optional<source::StepRange>* steps) {
  int numbers[3] = {};
  if (!ParseIntegers(text, ':', numbers)) {
    return false;
  }
  steps->emplace() = {.first = numbers[0], .last = numbers[1], .stride = numbers[2]};
  return numbers[0] >= 0 && numbers[2] >= 1;
}

// Not set: no such member.
std::optional<bool> ParseMember(absl::string_view name, absl::string_view text,
                                source::OpenRequest* request) {
  if (name == "path") {
    return ParseText(text, &request->path) && !text.empty();
  }
  if (name == "raw") {
    return ParseRaw(text, &request->raw);
  }
  if (name == "format") {
    return ParseText(text, &request->format);
  }
  if (name == "dicom_series") {
    return ParseText(text, &request->dicom_series);
  }
  if (name == "axes") {
    return ParseText(text, &request->axes);
  }
  if (name == "ignores_shear") {
    return ParseSwitch(text, &request->ignores_shear);
  }
  if (name == "resamples") {
    return ParseSwitch(text, &request->resamples);
  }
  if (name == "crop") {
    return ParseCrop(text, &request->crop);
  }
  if (name == "stride") {
    return absl::SimpleAtoi(text, &request->stride) && request->stride >= 1;
  }
  if (name == "fill") {
    return absl::SimpleAtod(text, &request->fill.emplace());
  }
  if (name == "fields") {
    request->fields = absl::StrSplit(text, '\n');
    return true;
  }
  if (name == "steps") {
    return ParseSteps(text, &request->steps);
  }
  return std::nullopt;
}

}  // namespace

bool IsAddress(absl::string_view path) { return io::IsAddressText(path); }

absl::StatusOr<std::map<std::string, std::string>> EncodeSourceRequest(
    const source::OpenRequest& request) {
  std::map<std::string, std::string> members;
  members["path"] = request.path;
  if (!IsAddress(request.path)) {
    ISOSCOPE_ASSIGN_OR_RETURN(members["path"], source::ResolvedPath(request.path));
  }
  const auto add = [&members](const char* name, const std::string& text) {
    if (!text.empty()) {
      members[name] = text;
    }
  };
  add("raw", request.raw.has_value() ? TextOf(*request.raw) : "");
  add("format", request.format);
  add("dicom_series", request.dicom_series);
  add("axes", request.axes);
  add("ignores_shear", std::string(request.ignores_shear ? kYes : ""));
  add("resamples", std::string(request.resamples ? kYes : ""));
  add("crop", request.crop.has_value() ? TextOf(*request.crop) : "");
  add("stride", request.stride != 1 ? absl::StrCat(request.stride) : "");
  add("fill", request.fill.has_value() ? absl::StrFormat("%.17g", *request.fill) : "");
  for (const std::string& field : request.fields) {
    if (absl::StrContains(field, '\n')) {
      return absl::InvalidArgumentError(
          absl::StrCat(request.path, ": a name of a field with a line break can't be recorded"));
    }
  }
  add("fields", absl::StrJoin(request.fields, "\n"));
  if (request.steps.has_value()) {
    const auto& [first, last, stride] = *request.steps;
    members["steps"] = absl::StrCat(first, ":", last, ":", stride);
  }
  return members;
}

absl::StatusOr<source::OpenRequest> DecodeSourceRequest(
    const std::map<std::string, std::string>& members, absl::string_view where) {
  source::OpenRequest request;
  for (const auto& [name, text] : members) {
    if (name == store::kFieldMember || name == store::kComponentMember ||
        name == store::kStepMember) {
      continue;
    }
    const std::optional<bool> is_good = ParseMember(name, text, &request);
    if (!is_good.has_value()) {
      return absl::FailedPreconditionError(
          absl::StrCat(where, ": its source is opened with \"", name,
                       "\", which this program does not know; use a newer program"));
    }
    if (!*is_good) {
      return absl::DataLossError(
          absl::StrCat(where, ": its source is opened with ", name, " \"", text,
                       "\", which is no value of it: the manifest is damaged"));
    }
  }
  return request;
}

absl::StatusOr<std::optional<SourceVolume>> DecodeSourceVolume(
    const std::map<std::string, std::string>& members, absl::string_view where) {
  const auto field = members.find(store::kFieldMember);
  const auto component = members.find(store::kComponentMember);
  const auto step = members.find(store::kStepMember);
  const auto count = members.count(store::kFieldMember) + members.count(store::kComponentMember) +
                     members.count(store::kStepMember);
  if (count == 0) {
    return std::nullopt;
  }
  SourceVolume volume;
  if (count != 3 || !absl::SimpleAtoi(component->second, &volume.component) ||
      volume.component < 0 || !absl::SimpleAtoi(step->second, &volume.step) || volume.step < 0) {
    return absl::DataLossError(absl::StrFormat(
        "%s: expected %s, %s and %s, a name and two numbers, of the volume in its source: the "
        "manifest is damaged",
        where, store::kFieldMember, store::kComponentMember, store::kStepMember));
  }
  volume.field = field->second;
  return volume;
}

}  // namespace isoscope::indexed
