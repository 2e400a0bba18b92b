#include "web-gateway/api/picture_answer.h"

#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"
#include "google/protobuf/io/coded_stream.h"
#include "google/protobuf/io/zero_copy_stream_impl_lite.h"

#include "clients/cpp/picture_file/webp_writer.h"
#include "core/base/status_macros.h"
#include "web-gateway/api/json.h"
#include "web-gateway/api/served_selection.h"
#include "web-gateway/http/etag.h"
#include "wire/field_selection.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;
using OutputOptions = v1::OutputOptions;

// Returns bytes that depend on the content of the message alone.
std::string Serialize(const google::protobuf::Message& message) {
  std::string bytes;
  google::protobuf::io::StringOutputStream stream(&bytes);
  google::protobuf::io::CodedOutputStream coded(&stream);
  coded.SetSerializationDeterministic(true);
  message.SerializeToCodedStream(&coded);
  coded.Trim();
  return bytes;
}

// Returns the type and the bytes of the requested output.
std::pair<const char*, std::string*> OutputOf(const OutputOptions& output,
                                              v1::RenderIsosurfaceResponse* response) {
  static constexpr char kBytes[] = "application/octet-stream";
  switch (output.image_format()) {
    case OutputOptions::IMAGE_FORMAT_JPEG:
      return {"image/jpeg", response->mutable_jpeg()};
    case OutputOptions::IMAGE_FORMAT_RGBA8:
      return {kBytes, response->mutable_rgba8()};
    case OutputOptions::IMAGE_FORMAT_NONE:
      return {kBytes, output.depth()           ? response->mutable_depth()
                      : output.surface_index() ? response->mutable_surface_index()
                      : output.position()      ? response->mutable_position()
                      : output.normal()        ? response->mutable_normal()
                                               : response->mutable_depth_bounds()};
    default:
      return {"image/png", response->mutable_png()};
  }
}

// The ranges of the colour maps, {"0":[0,2.5],"caps":[10,110]}: by surface, and that of caps that show
// samples; empty: there is no map. At most some 50 bytes a surface.
std::string ColorRangesOf(const v1::RenderIsosurfaceResponse& rendered) {
  std::vector<std::string> ranges;
  const auto add = [&](absl::string_view name, const v1::ColorRange& range) {
    ranges.push_back(
        absl::StrCat("\"", name, "\":[", ToJson(range.min()), ",", ToJson(range.max()), "]"));
  };
  for (const v1::SurfaceColoring& coloring : rendered.colorings()) {
    if (coloring.color_by().has_range()) {
      add(absl::StrCat(coloring.surface_index()), coloring.color_by().range());
    }
  }
  if (rendered.caps_coloring().caps().has_range()) {
    add("caps", rendered.caps_coloring().caps().range());
  }
  return ranges.empty() ? "" : absl::StrCat("{", absl::StrJoin(ranges, ","), "}");
}

// The levels that a choice is among: they may be added and dropped while the id stays. Empty: the
// request is of level 0, whatever there is.
std::string LevelsOf(const v1::RenderIsosurfaceRequest& request, const v1::Dataset& dataset) {
  if (!request.has_level() ||
      (request.level().choice_case() == v1::LevelChoice::kLevel && request.level().level() == 0)) {
    return "";
  }
  std::string levels = "levels";
  for (const v1::DatasetLevel& level : dataset.levels()) {
    absl::StrAppend(&levels, " ", level.level(), ":", static_cast<int>(level.filter()));
  }
  return levels;
}

PictureCaching NoCaching() { return {.etag = "", .headers = {{"Cache-Control", "no-store"}}}; }

}  // namespace

absl::Status CheckAnswerable(const v1::RenderIsosurfaceRequest& request) {
  const OutputOptions& output = request.output();
  const int plane_count = static_cast<int>(output.depth()) +
                          static_cast<int>(output.surface_index()) +
                          static_cast<int>(output.position()) + static_cast<int>(output.normal()) +
                          static_cast<int>(output.depth_bounds());
  const bool has_image = output.image_format() != OutputOptions::IMAGE_FORMAT_NONE;
  if (plane_count + static_cast<int>(has_image) != 1) {
    return absl::InvalidArgumentError(
        absl::StrCat("output asks for ", has_image ? "a picture and " : "", plane_count,
                     " planes: an answer is one picture, or with IMAGE_FORMAT_NONE one plane"));
  }
  if (request.with_trace()) {
    return absl::InvalidArgumentError(
        "withTrace is true: an answer over HTTP has no trace; ask the coordinator for one");
  }
  if (request.allow_partial()) {
    return absl::InvalidArgumentError(
        "allowPartial is true: a picture over HTTP can't say what is missing in it; ask the "
        "coordinator");
  }
  if (request.with_unresolved_count()) {
    return absl::InvalidArgumentError(
        "withUnresolvedCount is true: a picture over HTTP has no statistics; ask the coordinator, "
        "or /v1/interact");
  }
  if (request.with_notes()) {
    return absl::InvalidArgumentError(
        "withNotes is true: a picture over HTTP has no notes on surfaces; ask the coordinator, or "
        "/v1/interact");
  }
  return absl::OkStatus();
}

PictureCaching CachingOf(const v1::Dataset& dataset, absl::string_view picture_revision,
                         bool is_by_id, bool is_private, absl::string_view extras_key,
                         v1::RenderIsosurfaceRequest* request) {
  if (request->culling() == v1::CULLING_MASK || picture_revision.empty()) {
    return NoCaching();  // approximate, or drawn by unknown code
  }
  const bool may_change = DependsOnLaterSteps(request->selection(), dataset);
  std::string digest;
  if (!dataset.fields().empty()) {
    const auto selection = wire::ResolveSelection(request->selection(), dataset);
    if (!selection.ok()) {
      return NoCaching();  // the coordinator says what there is
    }
    *request->mutable_selection() = *selection;
    digest = DigestOfStep(*selection, dataset);
  }
  const std::string bytes = Serialize(*request);
  const std::string levels = LevelsOf(*request, dataset);
  const std::string ranges = RangesOfColors(*request, dataset);
  std::vector<absl::string_view> parts = {dataset.dataset_id(), picture_revision, bytes};
  if (!ranges.empty()) {
    parts.emplace_back(ranges);
  }
  if (!digest.empty()) {
    parts.emplace_back(digest);
  }
  if (!levels.empty()) {
    parts.emplace_back(levels);
  }
  // Annotations show names and units of the dataset, which its id does not tell.
  const std::string described = extras_key.empty() ? "" : Serialize(dataset);
  if (!extras_key.empty()) {
    parts.emplace_back(extras_key);
    parts.emplace_back(described);
  }
  const std::string etag = MakeEtag(parts);
  // The id of a dataset names its first step alone.
  const bool is_named = request->selection().time_step() == 0;
  const bool is_immutable =
      is_by_id && is_named && !may_change && ranges.empty() && levels.empty() && extras_key.empty();
  return {.etag = etag,
          .headers = {{"ETag", etag},
                      {"Cache-Control",
                       absl::StrCat(is_private ? "private, " : "public, ",
                                    is_immutable ? "max-age=31536000, immutable" : "no-cache")}}};
}

HttpResponse PictureResponse(const v1::RenderIsosurfaceRequest& request,
                             std::vector<std::pair<std::string, std::string>> headers,
                             v1::RenderIsosurfaceResponse rendered) {
  HttpResponse response;
  response.headers = std::move(headers);
  response.headers.emplace_back("X-Isoscope-Extent", absl::StrCat(rendered.extent().width_px(), "x",
                                                                  rendered.extent().height_px()));
  response.headers.emplace_back("X-Isoscope-Camera", ToJson(rendered.camera()));
  if (rendered.has_selection()) {
    response.headers.emplace_back("X-Isoscope-Selection", ToAsciiJson(rendered.selection()));
  }
  if (rendered.has_time()) {
    response.headers.emplace_back("X-Isoscope-Time", ToJson(rendered.time()));
  }
  if (rendered.has_drawn_level()) {
    response.headers.emplace_back("X-Isoscope-Level", ToJson(rendered.drawn_level()));
  }
  if (std::string ranges = ColorRangesOf(rendered); !ranges.empty()) {
    response.headers.emplace_back("X-Isoscope-Color-Ranges", std::move(ranges));
  }
  const auto [type, output] = OutputOf(request.output(), &rendered);
  response.content_type = type;
  response.body = std::move(*output);
  return response;
}

absl::Status ConvertToWebp(HttpResponse* picture) {
  ISOSCOPE_ASSIGN_OR_RETURN(picture->body, client::WebpOfPng(picture->body));
  picture->content_type = "image/webp";
  return absl::OkStatus();
}

}  // namespace isoscope::gateway
