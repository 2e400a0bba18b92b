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

#include "clients/cpp/picture_file/annotation_flags.h"
#include "clients/cpp/request/clip_flags.h"
#include "clients/cpp/request/effect_flags.h"
#include "clients/cpp/request/label_flags.h"
#include "clients/cpp/request/level_flags.h"
#include "clients/cpp/request/look_flags.h"
#include "clients/cpp/request/parse_value.h"
#include "clients/cpp/request/render_request.h"
#include "clients/cpp/request/selection_flags.h"
#include "clients/cpp/request/sweep_flags.h"
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

enum class Format { kPng, kJpeg, kWebp, kDepth };

absl::StatusOr<Format> ParseFormat(absl::string_view text) {
  return client::ParseChoice<Format>(text, {{"png", Format::kPng},
                                            {"jpeg", Format::kJpeg},
                                            {"webp", Format::kWebp},
                                            {"depth", Format::kDepth}});
}

absl::StatusOr<std::int64_t> ParseQuality(absl::string_view text) {
  return client::ParseInteger(text, 1, 100);
}

absl::StatusOr<std::int64_t> ParseBinCount(absl::string_view text) {
  return client::ParseInteger(text, 1, 4096);
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
    case Format::kWebp:  // the gateway makes it of a PNG
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

// The flags of what a picture shows.
struct ViewedFlags {
  client::RequestFlags request;
  client::ViewFlags view;
  client::LookFlags look;
  client::EffectFlags effects;
  client::LevelFlags level;

  void Declare(cli::FlagSet* set) {
    client::AddRequestFlags(set, &request);
    client::AddNamedViewFlags(set, &view);
    client::AddLookFlags(set, &look);
    client::AddEffectFlags(set, &effects);
    client::AddLevelFlags(set, &level);
  }
};

// The flags of a picture.
struct PictureFlags {
  ViewedFlags viewed;
  PictureExtras extras;
  std::optional<Format> format;
  std::optional<std::int64_t> quality;

  void Declare(cli::FlagSet* set) {
    viewed.Declare(set);
    AddExtrasFlags(set, &extras);
    cli::AddFlag(
        set, "--format", "png|jpeg|webp|depth", &format, ParseFormat,
        "what the answer is: a PNG (default), a JPEG, a lossless WebP of the same pixels as "
        "the PNG, or the distance of each pixel as little-endian float32, row by row");
    cli::AddFlag(set, "--quality", "N", &quality, ParseQuality,
                 "of a JPEG, 1 to 100 (default: 90)");
  }
};

// The flags of a film.
struct FilmFlags {
  ViewedFlags viewed;
  client::SweepFlags sweep;
  client::Annotations annotations;

  void Declare(cli::FlagSet* set) {
    viewed.Declare(set);
    client::AddSweepFlags(set, &sweep, &viewed.request);
    client::AddAnnotationFlags(set, &annotations);
  }
};

// The flags of a mesh.
struct MeshFlags {
  std::optional<double> isovalue;
  std::optional<frame::Color> color;
  std::vector<client::SurfaceValue> surfaces;
  client::LabelFlags label;
  client::ClipFlags clip;
  client::SelectionFlags selection;
  std::optional<std::int64_t> level;

  void Declare(cli::FlagSet* set) {
    cli::AddFlag(set, "--isovalue", "V", &isovalue, client::ParseNumber,
                 "the isovalue, in field units");
    cli::AddFlag(set, "--color", "COLOR", &color, client::ParseColor,
                 "colour of the surface: a name of CSS as teal, #RRGGBB, or R,G,B from 0 to 1 "
                 "(default: none)");
    cli::AddRepeatableFlag(set, "--surface", "V[:COLOR]", &surfaces, client::ParseSurface,
                           "a surface: its isovalue and colour; instead of --isovalue and --color, "
                           "any number of times");
    client::AddLabelFlags(set, &label, /*has_opacity=*/false);
    client::AddClipFlags(set, &clip);
    client::AddSelectionFlags(set, &selection);
    client::AddMeshLevelFlag(set, &level);
  }
};

// The flags of a histogram.
struct HistogramFlags {
  std::optional<std::int64_t> bin_count;
  client::SelectionFlags selection;

  void Declare(cli::FlagSet* set) {
    cli::AddFlag(set, "--bins", "N", &bin_count, ParseBinCount,
                 "the most bins, 1 to 4096 (default: 256)");
    client::AddSelectionFlags(set, &selection);
  }
};

// The flags beside a posted request.
struct ExtrasFlags {
  PictureExtras extras;

  void Declare(cli::FlagSet* set) { AddExtrasFlags(set, &extras); }
};

// Reads the parameters into the flags that they declare.
template <typename Flags>
absl::Status ParseInto(const QueryParameters& query, Flags* flags) {
  cli::FlagSet set({.has_help = false});
  flags->Declare(&set);
  return Parse(query, &set);
}

template <typename Flags>
ParameterTable TableOf() {
  Flags flags;
  cli::FlagSet set({.has_help = false});
  flags.Declare(&set);
  return set.Describe();
}

// Returns the request of what a picture shows; resolves the names in the flags.
absl::StatusOr<v1::RenderIsosurfaceRequest> RequestOf(const v1::Dataset& dataset,
                                                      ViewedFlags* flags) {
  client::RequestFlags& asked = flags->request;
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(CheckUsage(asked)));
  ISOSCOPE_RETURN_IF_ERROR(
      ParameterError(client::ResolveLabels(dataset, /*present=*/std::nullopt, &asked.label)));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(CheckUsage(asked)));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(CheckUsage(flags->view, asked.camera)));
  ISOSCOPE_RETURN_IF_ERROR(
      ParameterError(CheckUsage(flags->look, asked.surface_count(), asked.has_sample_caps())));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(client::CheckColorFields(flags->look, dataset)));
  const absl::StatusOr<v1::Camera> camera = client::ResolveView(flags->view, asked.camera, dataset);
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(camera.status()));
  ISOSCOPE_ASSIGN_OR_RETURN(v1::RenderIsosurfaceRequest request,
                            client::MakeRequest(asked, dataset.name(), *camera, flags->view.fit));
  client::SetEffects(flags->effects, &request);
  client::AddLook(flags->look, &request);
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(client::CheckUsage(flags->level)));
  client::SetLevel(flags->level, &request);
  return request;
}

// Returns the surfaces that a file has. Meshes are opaque.
std::vector<client::MeshSurface> SurfacesOf(client::MeshFormat format, const MeshFlags& flags) {
  std::vector<client::MeshSurface> surfaces;
  if (flags.isovalue) {
    surfaces.push_back({.isovalue = *flags.isovalue, .color = flags.color});
  }
  for (const client::SurfaceValue& surface : flags.surfaces) {
    surfaces.push_back({.isovalue = surface.isovalue, .color = surface.color});
  }
  for (const client::LabelSurface& surface : flags.label.surfaces) {
    surfaces.push_back({.color = surface.color, .name = surface.name});
    if (format == client::MeshFormat::kStl && !surface.is_color_given) {
      surfaces.back().color.reset();  // nobody asked for one, and the file can't have it
    }
  }
  for (client::MeshSurface& surface : surfaces) {
    if (surface.color) {
      surface.color->alpha = 1;
    }
  }
  return surfaces;
}

}  // namespace

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

absl::StatusOr<PictureQuery> PictureQueryFromQuery(const QueryParameters& query,
                                                   const v1::Dataset& dataset) {
  PictureFlags flags;
  ISOSCOPE_RETURN_IF_ERROR(ParseInto(query, &flags));
  if (flags.quality && flags.format != Format::kJpeg) {
    return absl::InvalidArgumentError(
        absl::StrCat("quality is ", *flags.quality, " without format=jpeg: only a JPEG has one"));
  }
  PictureQuery picture;
  ISOSCOPE_ASSIGN_OR_RETURN(picture.request, RequestOf(dataset, &flags.viewed));
  picture.extras = flags.extras;
  picture.extras.is_webp = flags.format == Format::kWebp;
  if (flags.format == Format::kJpeg || flags.format == Format::kDepth) {
    *picture.request.mutable_output() = OutputOf(*flags.format, flags.quality);
  }
  return picture;
}

ParameterTable PictureParameters() { return TableOf<PictureFlags>(); }

absl::StatusOr<FilmQuery> FilmQueryFromQuery(const QueryParameters& query,
                                             const v1::Dataset& dataset) {
  FilmFlags flags;
  ISOSCOPE_RETURN_IF_ERROR(ParseInto(query, &flags));
  ISOSCOPE_RETURN_IF_ERROR(
      ParameterError(client::CheckUsage(flags.sweep, flags.viewed.request.selection)));
  FilmQuery film;
  ISOSCOPE_ASSIGN_OR_RETURN(film.first, RequestOf(dataset, &flags.viewed));
  film.sweep = flags.sweep;
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(client::ResolveSteps(dataset, &film.sweep)));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(client::SetFrame(film.sweep, /*i=*/0, &film.first)));
  film.annotations = flags.annotations;
  if (film.sweep.is_step_sweep() && !film.annotations.caption) {
    film.annotations.caption = "{time}";
  }
  return film;
}

ParameterTable FilmParameters() { return TableOf<FilmFlags>(); }

absl::StatusOr<PictureExtras> ExtrasFromQuery(const QueryParameters& query) {
  ExtrasFlags flags;
  ISOSCOPE_RETURN_IF_ERROR(ParseInto(query, &flags));
  return flags.extras;
}

ParameterTable ExtrasParameters() { return TableOf<ExtrasFlags>(); }

absl::StatusOr<MeshQuery> MeshQueryFromQuery(client::MeshFormat format,
                                             const QueryParameters& query,
                                             const v1::Dataset& dataset) {
  MeshFlags flags;
  ISOSCOPE_RETURN_IF_ERROR(ParseInto(query, &flags));
  if ((flags.isovalue.has_value() && !flags.surfaces.empty()) ||
      (!flags.isovalue.has_value() && flags.surfaces.empty() && flags.label.empty())) {
    return absl::InvalidArgumentError(
        "give isovalue=V, surface=V:COLOR for each surface, or label=SET:COLOR for each surface of "
        "labels");
  }
  ISOSCOPE_RETURN_IF_ERROR(
      ParameterError(client::ResolveLabels(dataset, /*present=*/std::nullopt, &flags.label)));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(
      client::CheckSurfaces(flags.isovalue, flags.surfaces, /*color=*/std::nullopt, flags.label)));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(CheckUsage(flags.clip)));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(CheckUsage(flags.selection)));
  MeshQuery mesh;
  mesh.request = client::MakeExportRequest(flags.isovalue, flags.surfaces, flags.clip,
                                           dataset.name(), flags.label);
  mesh.request.set_with_origin(true);
  mesh.request.set_level(static_cast<std::int32_t>(flags.level.value_or(0)));
  if (const auto proto = ToProto(flags.selection); proto) {
    *mesh.request.mutable_selection() = *proto;
  }
  mesh.surfaces = SurfacesOf(format, flags);
  ISOSCOPE_RETURN_IF_ERROR(
      ParameterError(client::Validate({.path = "", .format = format, .surfaces = mesh.surfaces})));
  return mesh;
}

ParameterTable MeshParameters() { return TableOf<MeshFlags>(); }

absl::StatusOr<v1::GetHistogramRequest> HistogramRequestFromQuery(const QueryParameters& query,
                                                                  const v1::Dataset& dataset) {
  HistogramFlags flags;
  ISOSCOPE_RETURN_IF_ERROR(ParseInto(query, &flags));
  ISOSCOPE_RETURN_IF_ERROR(ParameterError(CheckUsage(flags.selection)));
  v1::GetHistogramRequest request;
  request.set_dataset(dataset.name());
  request.set_max_bin_count(static_cast<std::int32_t>(flags.bin_count.value_or(0)));
  if (const auto proto = ToProto(flags.selection); proto) {
    *request.mutable_selection() = *proto;
  }
  return request;
}

ParameterTable HistogramParameters() { return TableOf<HistogramFlags>(); }

}  // namespace isoscope::gateway
