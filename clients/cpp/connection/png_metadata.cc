// The text is JSON in an uncompressed iTXt chunk, so that any program that lists a PNG's text can
// read it:
//
//   {"format": "isoscope-picture", "format_version": 1,
//    "picture_revision": "4 cpu",
//    "samples_digest": "4ea8...",
//    "request": {"isovalue": 60, "camera": {...}, "viewport": {...}},
//    "annotated": {"plain_png_sha256": "...", "boxes": [[x, y, width, height], ...]},
//    "drawn_level": {"level": 2, "max_spacing_px": 0.9, "spacing": {"x": 4, "y": 4, "z": 4}}}
//
// `request` is RenderIsosurfaceRequest in proto3's JSON with the names of the .proto, and with all
// its fields, including future ones. It holds the resolved camera, also if the request left it to
// the server. A level that the server chose is in it as a number; level 0 is left out, as
// `drawn_level` is then. Numbers are written so that reading restores the same bits.

#include "clients/cpp/connection/png_metadata.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "absl/strings/str_cat.h"
#include <google/protobuf/util/json_util.h>
#include <nlohmann/json.hpp>

#include "clients/cpp/picture_file/png_chunks.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/version.h"

namespace isoscope::client {
namespace {

using Json = nlohmann::ordered_json;

constexpr char kFormat[] = "isoscope-picture";
constexpr int kFormatVersion = 1;
// A record takes about a kilobyte.
constexpr std::size_t kMaxRecordBytes = std::size_t{1} << 20;
constexpr int kMaxDepth = 50;
constexpr int kMaxSidePx = 1 << 30;

absl::Status Malformed(absl::string_view what) {
  return absl::DataLossError(absl::StrCat("the picture's record is damaged: ", what));
}

absl::Status FromNewerVersion(absl::string_view what) {
  return absl::FailedPreconditionError(
      absl::StrCat("the picture's record has ", what, ", which this version (", base::Version(),
                   ") does not know: the picture was made by a newer one; use that"));
}

// Deeper JSON could exhaust the stack.
absl::Status CheckDepth(absl::string_view text) {
  int depth = 0;
  for (const char c : text) {
    depth += (c == '{' || c == '[') ? 1 : (c == '}' || c == ']') ? -1 : 0;
    if (depth > kMaxDepth) {
      return Malformed(absl::StrCat("JSON of more than ", kMaxDepth, " levels"));
    }
  }
  return absl::OkStatus();
}

// FAILED_PRECONDITION if `json` has a member outside of `known`.
absl::Status CheckMembers(const Json& json, absl::string_view prefix,
                          std::initializer_list<absl::string_view> known) {
  for (const auto& [name, value] : json.items()) {
    if (std::find(known.begin(), known.end(), name) == known.end()) {
      return FromNewerVersion(absl::StrCat("the member '", prefix, name, "'"));
    }
  }
  return absl::OkStatus();
}

absl::Status ReadText(const Json& json, const char* name, std::string* text) {
  const auto found = json.find(name);
  if (found == json.end() || !found->is_string()) {
    return Malformed(absl::StrCat("no text '", name, "'"));
  }
  *text = found->get<std::string>();
  return absl::OkStatus();
}

absl::StatusOr<view::PixelRect> ReadBox(const Json& json) {
  std::array<int, 4> values{};
  if (!json.is_array() || json.size() != values.size()) {
    return Malformed("a member of 'boxes' is not [x, y, width, height]");
  }
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (!json[k].is_number_unsigned() || json[k].get<std::uint64_t>() > kMaxSidePx) {
      return Malformed("a member of 'boxes' has no whole numbers");
    }
    values[k] = json[k].get<int>();
  }
  return view::PixelRect{.begin_x = values[0],
                         .begin_y = values[1],
                         .end_x = values[0] + values[2],
                         .end_y = values[1] + values[3]};
}

absl::StatusOr<AnnotatedPicture> ReadAnnotated(const Json& json) {
  AnnotatedPicture annotated;
  if (!json.is_object()) {
    return Malformed("'annotated' is no object");
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckMembers(json, "annotated.", {"plain_png_sha256", "boxes"}));
  ISOSCOPE_RETURN_IF_ERROR(ReadText(json, "plain_png_sha256", &annotated.plain_png_sha256));
  const auto boxes = json.find("boxes");
  if (boxes == json.end() || !boxes->is_array()) {
    return Malformed("no array 'annotated.boxes'");
  }
  for (const Json& box : *boxes) {
    ISOSCOPE_ASSIGN_OR_RETURN(const view::PixelRect rect, ReadBox(box));
    annotated.boxes.push_back(rect);
  }
  return annotated;
}

Json ToJson(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  std::string text;
  ISOSCOPE_CHECK(google::protobuf::util::MessageToJsonString(message, &text, options).ok());
  return Json::parse(text);
}

// Reads the member of that name.
absl::Status ReadMessage(const Json& parent, const char* name, google::protobuf::Message* message) {
  const Json json = parent.value(name, Json());
  if (!json.is_object()) {
    return Malformed(absl::StrCat("no object '", name, "'"));
  }
  const auto status = google::protobuf::util::JsonStringToMessage(json.dump(), message);
  if (!status.ok()) {
    const std::string error(status.message().data(), status.message().size());
    // The library's message is "Cannot find field" with the name.
    return error.find("annot find") != std::string::npos
               ? FromNewerVersion(absl::StrCat("a member in '", name, "' (", error, ")"))
               : Malformed(absl::StrCat("'", name, "': ", error));
  }
  return absl::OkStatus();
}

// Returns the text of a chunk if it is the record, else "".
absl::StatusOr<absl::string_view> RecordText(const PngChunk& chunk) {
  const absl::string_view data = chunk.data;
  const std::size_t end = data.find('\0');
  if ((chunk.type != "iTXt" && chunk.type != "tEXt" && chunk.type != "zTXt") ||
      data.substr(0, end) != kPictureRecordKeyword || end == absl::string_view::npos) {
    return absl::string_view();
  }
  if (chunk.type == "tEXt") {  // programs that copy text write it so
    return data.substr(end + 1);
  }
  // iTXt: compression flag and method, language and translated keyword, each ended by a zero.
  if (chunk.type == "zTXt" || data.size() < end + 3 || data[end + 1] != '\0') {
    return Malformed("it was compressed by another program; expected plain text");
  }
  std::size_t begin = end + 3;
  for (int i = 0; i < 2; ++i) {
    begin = data.find('\0', begin);
    if (begin == absl::string_view::npos) {
      return Malformed("its iTXt chunk ends early");
    }
    ++begin;
  }
  return data.substr(begin);
}

}  // namespace

isoscope::v1::RenderIsosurfaceRequest DecidingPart(
    const isoscope::v1::RenderIsosurfaceRequest& request) {
  isoscope::v1::RenderIsosurfaceRequest deciding = request;
  deciding.clear_dataset();
  deciding.clear_culling();
  deciding.clear_ray_seed();
  deciding.clear_output();
  deciding.clear_with_trace();
  deciding.clear_allow_partial();
  deciding.clear_with_notes();
  deciding.clear_with_unresolved_count();
  deciding.clear_dataset_id();
  return deciding;
}

std::string EncodePictureRecord(const PictureRecord& record) {
  Json json;
  json["format"] = kFormat;
  json["format_version"] = kFormatVersion;
  json["picture_revision"] = record.picture_revision;
  json["samples_digest"] = record.samples_digest;
  json["request"] = ToJson(DecidingPart(record.request));
  if (record.annotated) {
    Json boxes = Json::array();
    for (const view::PixelRect& box : record.annotated->boxes) {
      boxes.push_back({box.begin_x, box.begin_y, box.end_x - box.begin_x, box.end_y - box.begin_y});
    }
    json["annotated"] = {{"plain_png_sha256", record.annotated->plain_png_sha256},
                         {"boxes", boxes}};
  }
  if (record.drawn_level) {
    json["drawn_level"] = ToJson(*record.drawn_level);
  }
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

absl::StatusOr<PictureRecord> DecodePictureRecord(absl::string_view text) {
  if (text.size() > kMaxRecordBytes) {
    return Malformed(absl::StrCat(text.size(), " bytes, more than ", kMaxRecordBytes));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckDepth(text));
  const Json json = Json::parse(text.begin(), text.end(), nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || json.value("format", Json()) != kFormat) {
    return Malformed(absl::StrCat("no JSON object with \"format\": \"", kFormat, "\""));
  }
  if (json.value("format_version", Json()) != kFormatVersion) {
    return FromNewerVersion(
        absl::StrCat("format_version ", json.value("format_version", Json()).dump()));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckMembers(json, "",
                                        {"format", "format_version", "picture_revision",
                                         "samples_digest", "request", "annotated", "drawn_level"}));
  PictureRecord record;
  ISOSCOPE_RETURN_IF_ERROR(ReadText(json, "picture_revision", &record.picture_revision));
  ISOSCOPE_RETURN_IF_ERROR(ReadText(json, "samples_digest", &record.samples_digest));
  ISOSCOPE_RETURN_IF_ERROR(ReadMessage(json, "request", &record.request));
  record.request = DecidingPart(record.request);
  if (const auto annotated = json.find("annotated"); annotated != json.end()) {
    ISOSCOPE_ASSIGN_OR_RETURN(record.annotated, ReadAnnotated(*annotated));
  }
  if (json.contains("drawn_level")) {
    ISOSCOPE_RETURN_IF_ERROR(ReadMessage(json, "drawn_level", &record.drawn_level.emplace()));
  }
  return record;
}

absl::StatusOr<std::string> AddPictureRecord(absl::string_view png, const PictureRecord& record) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<PngChunk> chunks, ParsePngChunks(png));
  const auto first_idat = std::find_if(chunks.begin(), chunks.end(),
                                       [](const PngChunk& chunk) { return chunk.type == "IDAT"; });
  if (first_idat == chunks.end()) {
    return absl::DataLossError("the PNG has no pixels (IDAT)");
  }
  const auto before = static_cast<std::size_t>(first_idat->bytes.data() - png.data());
  constexpr absl::string_view kPlainNoLanguage("\0\0\0\0\0", 5);
  return absl::StrCat(png.substr(0, before),
                      MakePngChunk("iTXt", absl::StrCat(kPictureRecordKeyword, kPlainNoLanguage,
                                                        EncodePictureRecord(record))),
                      png.substr(before));
}

absl::StatusOr<RecordedPng> SplitRecordedPng(absl::string_view png) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<PngChunk> chunks, ParsePngChunks(png));
  RecordedPng split;
  split.plain_png = std::string(kPngSignature);
  absl::string_view text;
  for (const PngChunk& chunk : chunks) {
    ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view found, RecordText(chunk));
    if (found.empty()) {
      absl::StrAppend(&split.plain_png, chunk.bytes);
    } else {
      text = found;
    }
  }
  if (text.empty()) {
    return absl::NotFoundError(
        "the picture carries no record of how it was made: it was written with --no-metadata or "
        "by another program, or a program that saved it again has dropped the text");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(split.record, DecodePictureRecord(text));
  return split;
}

}  // namespace isoscope::client
