#include "web-gateway/render_query.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include <CLI/CLI.hpp>

#include "client-cli/clip_flags.h"
#include "client-cli/effect_flags.h"
#include "client-cli/flags.h"
#include "client-cli/look_flags.h"
#include "client-cli/parse_value.h"
#include "client-cli/render_request.h"
#include "client-cli/usage.h"
#include "client-cli/view_flags.h"
#include "core/base/status_macros.h"
#include "core/frame/frame_spec.h"
#include "core/rpc/proto_convert.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;
using OutputOptions = v1::OutputOptions;

enum class Format { kPng, kJpeg, kDepth };

absl::StatusOr<Format> ParseFormat(absl::string_view text) {
  return cli::ParseChoice<Format>(
      text, {{"png", Format::kPng}, {"jpeg", Format::kJpeg}, {"depth", Format::kDepth}});
}

absl::StatusOr<std::int64_t> ParseQuality(absl::string_view text) {
  return cli::ParseInteger(text, 1, 100);
}

// "--clip-plane is ..." as "clip-plane is ...": in an address, names have no dashes before them.
std::string WithoutDashes(absl::string_view message) {
  std::string plain;
  for (std::size_t i = 0; i < message.size(); ++i) {
    const bool begins_word =
        i == 0 || absl::string_view(" '(").find(message[i - 1]) != absl::string_view::npos;
    if (begins_word && message.substr(i, 2) == "--" && i + 2 < message.size() &&
        absl::ascii_isalpha(static_cast<unsigned char>(message[i + 2]))) {
      ++i;
      continue;
    }
    plain += message[i];
  }
  return plain;
}

absl::Status ParameterError(const absl::Status& status) {
  return status.ok() ? status : absl::InvalidArgumentError(WithoutDashes(status.message()));
}

// The names of all options, without dashes.
std::vector<std::string> NamesOf(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    for (const std::string& name : option->get_lnames()) {
      names.push_back(name);
    }
  }
  std::sort(names.begin(), names.end());
  return names;
}

absl::Status UnknownParameter(const std::string& name, const CLI::App& app) {
  constexpr std::size_t kMaxQuotedBytes = 64;
  const std::vector<std::string> names = NamesOf(app);
  const std::string nearest = cli::NearestName(name, names);
  std::string all;
  for (const std::string& known : names) {
    absl::StrAppend(&all, all.empty() ? "" : ", ", known);
  }
  return absl::InvalidArgumentError(
      absl::StrCat("there is no parameter '",
                   absl::CHexEscape(absl::string_view(name).substr(0, kMaxQuotedBytes)), "'",
                   nearest.empty() ? ";" : absl::StrCat(", did you mean '", nearest, "'?"),
                   " there are: ", all));
}

// Lets `app` read the parameters as flags.
absl::Status Parse(const QueryParameters& query, CLI::App* app) {
  app->set_help_flag("");
  std::vector<std::string> arguments;
  for (const auto& [key, value] : query) {
    std::string name = absl::StrReplaceAll(key, {{"_", "-"}});
    const CLI::Option* const option = app->get_option_no_throw(absl::StrCat("--", name));
    if (option == nullptr || name.empty()) {
      return UnknownParameter(name, *app);
    }
    const auto is_same = [&](const auto& other) {
      return absl::StrReplaceAll(other.first, {{"_", "-"}}) == name;
    };
    const auto times = std::count_if(query.begin(), query.end(), is_same);
    if (times > 1 && option->get_expected_max() <= 1) {
      return absl::InvalidArgumentError(
          absl::StrCat("the parameter ", name, " is given ", times, " times: it may come once"));
    }
    // A flag whose value may be left out has "true" then, as CLI11 itself says it.
    const bool may_be_empty = option->get_items_expected_min() == 0;
    arguments.push_back(
        absl::StrCat("--", name, "=", value.empty() && may_be_empty ? "true" : value));
    if (value.empty() && !may_be_empty) {
      return absl::InvalidArgumentError(absl::StrCat("the parameter ", name, " has no value"));
    }
  }
  // CLI11 takes the last argument first.
  std::reverse(arguments.begin(), arguments.end());
  try {
    app->parse(arguments);
  } catch (const CLI::ParseError& error) {
    return ParameterError(absl::InvalidArgumentError(error.what()));
  }
  return absl::OkStatus();
}

OutputOptions OutputOf(Format format, const std::optional<std::int64_t>& quality) {
  OutputOptions output;
  switch (format) {
    case Format::kPng:
      break;
    case Format::kJpeg:
      output.set_image_format(OutputOptions::IMAGE_FORMAT_JPEG);
      output.set_jpeg_quality(static_cast<std::int32_t>(quality.value_or(0)));
      break;
    case Format::kDepth:
      output.set_image_format(OutputOptions::IMAGE_FORMAT_NONE);
      output.set_depth(true);
      break;
  }
  return output;
}

}  // namespace

absl::StatusOr<v1::RenderIsosurfaceRequest> RenderRequestFromQuery(const QueryParameters& query,
                                                                   const v1::Dataset& dataset) {
  cli::RequestFlags flags;
  cli::ViewFlags view;
  cli::LookFlags look;
  cli::EffectFlags effects;
  std::optional<Format> format;
  std::optional<std::int64_t> quality;
  CLI::App app;
  cli::AddRequestFlags(&app, &flags);
  cli::AddNamedViewFlags(&app, &view);
  cli::AddLookFlags(&app, &look);
  cli::AddEffectFlags(&app, &effects);
  cli::AddFlag(&app, "--format", "png|jpeg|depth", &format, ParseFormat, "");
  cli::AddFlag(&app, "--quality", "N", &quality, ParseQuality, "");
  ISOSCOPE_RETURN_IF_ERROR(Parse(query, &app));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(cli::CheckUsage(flags)));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(cli::CheckUsage(view, flags.camera)));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(cli::CheckUsage(look, flags.isovalues().size())));
  if (quality && format != Format::kJpeg) {
    return absl::InvalidArgumentError(
        absl::StrCat("quality is ", *quality, " without format=jpeg: only a JPEG has one"));
  }
  const absl::StatusOr<v1::Camera> camera = cli::ResolveView(view, flags.camera, dataset);
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(camera.status()));
  ISOSCOPE_ASSIGN_OR_RETURN(const view::Camera checked, rpc::CameraFromProto(*camera, "camera"));
  v1::RenderIsosurfaceRequest request = cli::MakeRequest(flags, dataset.name(), checked);
  *request.mutable_camera() = *camera;
  if (view.fit) {
    request.set_camera_fit(*view.fit);
  }
  cli::SetEffects(effects, &request);
  cli::AddLook(look, &request);
  if (format.value_or(Format::kPng) != Format::kPng) {
    *request.mutable_output() = OutputOf(*format, quality);
  }
  return request;
}

absl::StatusOr<MeshQuery> MeshQueryFromQuery(const QueryParameters& query,
                                             const v1::Dataset& dataset) {
  std::optional<double> isovalue;
  std::optional<frame::Color> color;
  std::vector<cli::SurfaceValue> surfaces;
  cli::ClipFlags clip;
  CLI::App app;
  cli::AddFlag(&app, "--isovalue", "V", &isovalue, cli::ParseNumber, "");
  cli::AddFlag(&app, "--color", "R,G,B", &color, cli::ParseColor, "");
  cli::AddRepeatableFlag(&app, "--surface", "V[:R,G,B]", &surfaces, cli::ParseSurface, "");
  cli::AddClipFlags(&app, &clip);
  ISOSCOPE_RETURN_IF_ERROR(Parse(query, &app));
  if (isovalue.has_value() != surfaces.empty()) {
    return absl::InvalidArgumentError("give isovalue=V, or surface=V:R,G,B for each surface");
  }
  if (surfaces.size() > frame::kMaxSurfaces) {
    return absl::InvalidArgumentError(absl::StrCat("surface is given ", surfaces.size(),
                                                   " times: at most ", frame::kMaxSurfaces,
                                                   " are allowed"));
  }
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(cli::CheckUsage(clip)));
  MeshQuery mesh;
  mesh.request.set_dataset(dataset.name());
  mesh.request.set_isovalue(isovalue.value_or(0));
  if (surfaces.empty()) {
    mesh.surfaces = {{.isovalue = *isovalue, .color = color}};
  }
  for (const cli::SurfaceValue& surface : surfaces) {
    mesh.request.add_surfaces()->set_isovalue(surface.isovalue);
    mesh.surfaces.push_back({.isovalue = surface.isovalue, .color = surface.color});
    if (surface.color && surface.color->alpha != 1.0F) {
      mesh.surfaces.back().color->alpha = 1;  // meshes are opaque
    }
  }
  if (!clip.empty()) {
    *mesh.request.mutable_clip() = cli::ToProto(clip);
  }
  return mesh;
}

}  // namespace isoscope::gateway
