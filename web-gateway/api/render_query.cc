// Parameters of an address are the flags of the command line without their dashes, and are parsed
// by the same FlagSet:
//
//   ?isovalue=128&clip_plane=1,0,0,20  ->  --isovalue=128 --clip-plane=1,0,0,20
//
// Underscores count as dashes. Errors speak of flags; WithoutDashes makes them speak of parameters,
// but leaves commands in backticks as they are typed.

#include "web-gateway/api/render_query.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"

#include "clients/cpp/request/clip_flags.h"
#include "clients/cpp/request/effect_flags.h"
#include "clients/cpp/request/label_flags.h"
#include "clients/cpp/request/look_flags.h"
#include "clients/cpp/request/parse_value.h"
#include "clients/cpp/request/render_request.h"
#include "clients/cpp/request/selection_flags.h"
#include "clients/cpp/request/view_flags.h"
#include "core/base/status_macros.h"
#include "core/cli/command_description.h"
#include "core/cli/flag_set.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "web-gateway/http/url.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;
using OutputOptions = v1::OutputOptions;

enum class Format { kPng, kJpeg, kDepth };

absl::StatusOr<Format> ParseFormat(absl::string_view text) {
  return client::ParseChoice<Format>(
      text, {{"png", Format::kPng}, {"jpeg", Format::kJpeg}, {"depth", Format::kDepth}});
}

absl::StatusOr<std::int64_t> ParseQuality(absl::string_view text) {
  return client::ParseInteger(text, 1, 100);
}

// Turns "--clip-plane is ..." into "clip-plane is ...": names in an address have no dashes.
std::string WithoutDashes(absl::string_view message) {
  std::string plain;
  bool is_command = false;  // within `...`, which is typed as it is
  for (std::size_t i = 0; i < message.size(); ++i) {
    is_command = is_command != (message[i] == '`');
    const bool begins_word =
        !is_command &&
        (i == 0 || absl::string_view(" '(").find(message[i - 1]) != absl::string_view::npos);
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

absl::Status UnknownParameter(const std::string& name,
                              const std::vector<cli::FlagDescription>& parameters) {
  std::vector<std::string> names;
  for (const cli::FlagDescription& parameter : parameters) {
    names.push_back(std::string(absl::StripPrefix(parameter.names[0], "--")));
  }
  std::sort(names.begin(), names.end());
  const std::string nearest = cli::NearestName(name, names);
  return absl::InvalidArgumentError(
      absl::StrCat("there is no parameter ", Quoted(name),
                   nearest.empty() ? ";" : absl::StrCat(", did you mean '", nearest, "'?"),
                   " there are: ", absl::StrJoin(names, ", ")));
}

// Parses the parameters as flags of `set`. A switch needs no value. REQUIRES: each flag has one name.
absl::Status Parse(const QueryParameters& query, cli::FlagSet* set) {
  const std::vector<cli::FlagDescription> parameters = set->Describe();
  std::vector<std::string> arguments;
  for (const auto& [key, value] : query) {
    const std::string name = absl::StrReplaceAll(key, {{"_", "-"}});
    const auto parameter =
        std::find_if(parameters.begin(), parameters.end(),
                     [flag = absl::StrCat("--", name)](const cli::FlagDescription& known) {
                       return known.names[0] == flag;
                     });
    if (parameter == parameters.end()) {
      return UnknownParameter(name, parameters);
    }
    const auto is_same = [&](const auto& other) {
      return absl::StrReplaceAll(other.first, {{"_", "-"}}) == name;
    };
    const auto times = std::count_if(query.begin(), query.end(), is_same);
    if (times > 1 && !parameter->is_repeatable) {
      return absl::InvalidArgumentError(
          absl::StrCat("the parameter ", name, " is given ", times, " times: it may come once"));
    }
    const bool is_switch = parameter->value_name.empty();
    if (value.empty() && !parameter->has_optional_value && !is_switch) {
      return absl::InvalidArgumentError(absl::StrCat("the parameter ", name, " has no value"));
    }
    // "--name=" would take the next argument as its value.
    arguments.push_back(absl::StrCat("--", name, "=", value.empty() ? "true" : value));
  }
  return ParameterError(set->Parse(arguments));
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
  client::RequestFlags flags;
  client::ViewFlags view;
  client::LookFlags look;
  client::EffectFlags effects;
  std::optional<Format> format;
  std::optional<std::int64_t> quality;
  cli::FlagSet set({.has_help = false});
  client::AddRequestFlags(&set, &flags);
  client::AddNamedViewFlags(&set, &view);
  client::AddLookFlags(&set, &look);
  client::AddEffectFlags(&set, &effects);
  cli::AddFlag(&set, "--format", "png|jpeg|depth", &format, ParseFormat, "");
  cli::AddFlag(&set, "--quality", "N", &quality, ParseQuality, "");
  ISOSCOPE_RETURN_IF_ERROR(Parse(query, &set));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(CheckUsage(flags)));
  ISOSCOPE_RETURN_IF_ERROR(
      ParameterError(client::ResolveLabels(dataset, /*present=*/std::nullopt, &flags.label)));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(CheckUsage(flags)));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(CheckUsage(view, flags.camera)));
  ISOSCOPE_RETURN_IF_ERROR(
      ParameterError(CheckUsage(look, flags.surface_count(), flags.has_sample_caps())));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(client::CheckColorFields(look, dataset)));
  if (quality && format != Format::kJpeg) {
    return absl::InvalidArgumentError(
        absl::StrCat("quality is ", *quality, " without format=jpeg: only a JPEG has one"));
  }
  const absl::StatusOr<v1::Camera> camera = client::ResolveView(view, flags.camera, dataset);
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(camera.status()));
  ISOSCOPE_ASSIGN_OR_RETURN(v1::RenderIsosurfaceRequest request,
                            client::MakeRequest(flags, dataset.name(), *camera, view.fit));
  client::SetEffects(effects, &request);
  client::AddLook(look, &request);
  if (format.value_or(Format::kPng) != Format::kPng) {
    *request.mutable_output() = OutputOf(*format, quality);
  }
  return request;
}

absl::StatusOr<MeshQuery> MeshQueryFromQuery(const QueryParameters& query,
                                             const v1::Dataset& dataset) {
  std::optional<double> isovalue;
  std::optional<frame::Color> color;
  std::vector<client::SurfaceValue> surfaces;
  client::LabelFlags label;
  client::ClipFlags clip;
  client::SelectionFlags selection;
  cli::FlagSet set({.has_help = false});
  cli::AddFlag(&set, "--isovalue", "V", &isovalue, client::ParseNumber, "");
  cli::AddFlag(&set, "--color", "COLOR", &color, client::ParseColor, "");
  cli::AddRepeatableFlag(&set, "--surface", "V[:COLOR]", &surfaces, client::ParseSurface, "");
  client::AddLabelFlags(&set, &label, /*has_opacity=*/false);
  client::AddClipFlags(&set, &clip);
  client::AddSelectionFlags(&set, &selection);
  ISOSCOPE_RETURN_IF_ERROR(Parse(query, &set));
  if ((isovalue.has_value() && !surfaces.empty()) ||
      (!isovalue.has_value() && surfaces.empty() && label.empty())) {
    return absl::InvalidArgumentError(
        "give isovalue=V, surface=V:COLOR for each surface, or label=SET:COLOR for each surface of "
        "labels");
  }
  ISOSCOPE_RETURN_IF_ERROR(
      ParameterError(client::ResolveLabels(dataset, /*present=*/std::nullopt, &label)));
  ISOSCOPE_RETURN_IF_ERROR(
      ParameterError(client::CheckSurfaces(isovalue, surfaces, /*color=*/std::nullopt, label)));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(CheckUsage(clip)));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(CheckUsage(selection)));
  MeshQuery mesh;
  mesh.request = client::MakeExportRequest(isovalue, surfaces, clip, dataset.name(), label);
  mesh.request.set_with_origin(true);
  if (const auto proto = ToProto(selection); proto) {
    *mesh.request.mutable_selection() = *proto;
  }
  if (isovalue) {
    mesh.surfaces = {{.isovalue = *isovalue, .color = color}};
  }
  for (const client::SurfaceValue& surface : surfaces) {
    mesh.surfaces.push_back({.isovalue = surface.isovalue, .color = surface.color});
    if (surface.color && surface.color->alpha != 1.0F) {
      mesh.surfaces.back().color->alpha = 1;  // meshes are opaque
    }
  }
  for (const client::LabelSurface& surface : label.surfaces) {
    mesh.surfaces.push_back({.color = surface.color, .name = surface.name});
    mesh.surfaces.back().color->alpha = 1;
  }
  return mesh;
}

absl::StatusOr<std::optional<v1::FieldSelection>> TakeSelection(QueryParameters* query) {
  client::SelectionFlags selection;
  cli::FlagSet set({.has_help = false});
  client::AddSelectionFlags(&set, &selection);
  const std::vector<cli::FlagDescription> parameters = set.Describe();
  const auto others = std::stable_partition(
      query->begin(), query->end(), [&](const std::pair<std::string, std::string>& one) {
        return std::any_of(parameters.begin(), parameters.end(), [&](const auto& parameter) {
          return parameter.names[0] == absl::StrCat("--", one.first);
        });
      });
  const QueryParameters taken(query->begin(), others);
  query->erase(query->begin(), others);
  ISOSCOPE_RETURN_IF_ERROR(Parse(taken, &set));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(CheckUsage(selection)));
  return ToProto(selection);
}

}  // namespace isoscope::gateway
