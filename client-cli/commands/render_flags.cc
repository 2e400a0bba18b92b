// CheckUsage returns the error of the first rule that is broken:
//
//   every picture    session, the input if no surface is named, surfaces (not with --like),
//                    --no-measures, standard output (CheckShow), format of the picture
//                    (CheckFormat)
//   without --like   camera, planes, colours, rules of a single picture, poster, sweep
//   with --like      no mask culling, one PNG, no flag that decides a pixel
//
// A poster is a picture too large for one frame: it is drawn region by region into one PNG
// (CheckPoster). CheckOutputs asks whether each output can be written, before the frame is drawn.

#include "client-cli/commands/render_flags.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

#include "client-cli/output/frame_name.h"
#include "client-cli/output/picture_output.h"
#include "client-cli/output/sweep.h"
#include "clients/cpp/connection/like_picture.h"
#include "clients/cpp/picture_file/animation_writer.h"
#include "clients/cpp/picture_file/annotation_flags.h"
#include "clients/cpp/picture_file/poster.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/frame/frame_spec.h"
#include "core/image/jpeg_codec.h"
#include "core/io/atomic_file.h"
#include "wire/first_look.h"

namespace isoscope::cli {
namespace {

bool HasSurfaces(const client::RequestFlags& request) {
  return request.isovalue || !request.surfaces.empty() || !request.label.empty();
}

// UsageError if the output's format does not fit the other flags.
absl::Status CheckFormat(const RenderFlags& flags) {
  if (!flags.output) {
    return absl::OkStatus();
  }
  if (!flags.is_jpeg()) {
    return CheckPicturePath(*flags.output, flags.request.image_size());
  }
  if (flags.annotations.any()) {
    return UsageError(
        "annotations are drawn on pictures without loss: --output must not be a JPEG");
  }
  return absl::OkStatus();
}

// UsageError for flags that a picture drawn region by region can't have.
absl::Status CheckPoster(const RenderFlags& flags) {
  if (!flags.is_poster()) {
    return absl::OkStatus();
  }
  const std::string picture = absl::StrCat("a picture of ", flags.request.viewport().width_px,
                                           " x ", flags.request.viewport().height_px, " pixels");
  const std::string in_regions = absl::StrCat(picture, " is drawn in regions");
  const std::string limit = absl::StrCat(client::kMaxSinglePixels, " pixels");
  const struct {
    bool is_broken;
    std::string message;
  } rules[] = {
      {!flags.output,
       absl::StrCat("--output FILE.png is missing: ", picture, " is written while it is drawn")},
      {flags.is_to_stdout(),
       absl::StrCat(in_regions, " into a file: name one, or ask for at most ", limit)},
      {flags.is_jpeg(), absl::StrCat(in_regions, " into a PNG: --output must end in .png")},
      {flags.planes.files.any_plane(),
       absl::StrCat(in_regions, " into a PNG: planes are written of a --region of it")},
      {flags.sweep.frame_count() > 1,
       absl::StrCat(in_regions, ", one picture at a time: leave ",
                    flags.sweep.is_isovalue_sweep() ? "the sweep of --isovalue" : "--repeat",
                    " out, or ask for at most ", limit)},
      {flags.view.save_camera_file.has_value(),
       absl::StrCat(in_regions, ": --save-camera is for pictures of at most ", limit)},
      {flags.trace.has_value(),
       absl::StrCat(in_regions, ": --trace is for one frame, as a --region of it is")},
      {flags.allow_partial, absl::StrCat(in_regions,
                                         ", of which each could lack other shards: leave "
                                         "--allow-partial out")},
      {flags.annotations.any(),
       absl::StrCat(in_regions, ": annotations are drawn on pictures of at most ", limit)},
  };
  for (const auto& rule : rules) {
    if (rule.is_broken) {
      return UsageError(rule.message);
    }
  }
  return absl::OkStatus();
}

absl::Status CheckShow(const RenderFlags& flags, const Context& context) {
  const ShowMode mode = flags.show_mode();
  if (flags.stats == "-" && mode != ShowMode::kNever) {
    return UsageError("--show and --stats - both write to standard output: leave one out");
  }
  if (flags.is_to_stdout()) {
    if (flags.stats == "-" || mode != ShowMode::kNever) {
      return UsageError(absl::StrCat("--output - and ", flags.stats == "-" ? "--stats -" : "--show",
                                     " both write to standard output: leave one out"));
    }
    if (context.out_columns > 0) {
      return UsageError(
          "--output - writes a PNG to standard output, which is this terminal: redirect it, or "
          "leave --output out to see the picture");
    }
  }
  const bool may_show = IsFormat(mode) || (mode == ShowMode::kAuto && context.out_columns > 0);
  if (!flags.output && (flags.like || (!flags.planes.files.any_plane() && !may_show))) {
    return UsageError("--output FILE.png is missing: the picture to write");
  }
  return absl::OkStatus();
}

int LongerSide(const view::Viewport& size) { return std::max(size.width_px, size.height_px); }

// The strips of a poster are encoded in the process that draws them, which --memory-limit bounds.
std::int64_t MaxStripBytes(const SessionFlags& session) {
  constexpr std::int64_t kStripShare = 48;  // of the limit, with its copies a sixteenth
  return session.memory_limit_bytes.has_value()
             ? std::clamp(*session.memory_limit_bytes / kStripShare, std::int64_t{1},
                          client::kMaxStripBytes)
             : client::kMaxStripBytes;
}

// Whether the picture, or a poster's regions, can have the samples of `effects`.
bool CanDraw(const RenderFlags& flags, const client::EffectFlags& effects) {
  // The mask's culling draws no bands.
  const bool is_one_view = flags.request.culling == frame::Culling::kMask && !flags.is_poster();
  return LongerSide(effects.drawn_size(flags.request.viewport())) <= view::kMaxWholeViewportPx &&
         (!is_one_view || LongerSide(flags.request.image_size()) <= effects.max_region_side_px());
}

}  // namespace

bool RenderFlags::is_poster() const {
  return !request.region && client::NeedsRegions(request.viewport());
}

view::Viewport RenderFlags::region_size() const {
  return client::RegionSizeOf(request.viewport(), effects.max_region_side_px(),
                              MaxStripBytes(session));
}

view::Viewport RenderFlags::drawn_size() const {
  return effects.drawn_size(is_poster() ? region_size() : request.image_size());
}

int RenderFlags::drawn_layers() const {
  const bool is_translucent =
      std::any_of(request.surfaces.begin(), request.surfaces.end(),
                  [](const client::SurfaceValue& surface) {
                    return surface.color.has_value() && surface.color->alpha < 1;
                  }) ||
      std::any_of(request.label.sets.begin(), request.label.sets.end(),
                  [](const client::LabelValue& label) {
                    return label.opacity.has_value() && *label.opacity < 1;
                  });
  return is_translucent ? static_cast<int>(request.max_layers.value_or(frame::kDefaultLayers)) : 0;
}

bool RenderFlags::is_jpeg() const { return output && IsJpegName(FrameFileName(*output, 0)); }

ShowMode RenderFlags::show_mode() const {
  return show.value_or(stats == "-" || is_to_stdout() ? ShowMode::kNever : ShowMode::kAuto);
}

void AddRenderFlags(FlagSet* set, RenderFlags* flags) {
  AddSessionFlags(set, &flags->session, kRenderFlagNames);
  AddRendererFlag(set, &flags->session);
  AddFlag(set, "-o,--output", "FILE.png", &flags->output, ParseText,
          "the picture: a PNG, or a JPEG if it ends in .jpg; with %d or %03d in its name one for "
          "each frame, numbered from 0, else the last one; all "
          "frames as one animation if it ends in .apng or .webp; - is a PNG on standard output");
  client::AddRequestFlags(set, &flags->request);
  client::AddSweepFlags(set, &flags->sweep, &flags->request);
  AddPlaneFlags(set, &flags->planes);
  client::AddEffectFlags(set, &flags->effects);
  client::AddViewFlags(set, &flags->view);
  client::AddLookFlags(set, &flags->look);
  client::AddLevelFlags(set, &flags->level);
  AddShowFlag(set, &flags->show,
              "show the picture in the terminal: auto (default) where standard output is one that "
              "can, or in a format whatever it is; --output may then be left out");
  AddFlag(
      set, "--stats", "FILE|-", &flags->stats, ParseText,
      "write statistics as JSON (- is standard output), and print them as tables; they have the "
      "area and the enclosed volume of each surface at level 0, whatever level is drawn, in the "
      "time of an export of it");
  set->AddSwitch("--no-measures", &flags->has_no_measures,
                 "write the statistics of --stats without areas and volumes, which are of level 0 "
                 "and take as long as an export, and without what a level hides");
  AddFlag(set, "--trace", "FILE.json", &flags->trace, ParseText,
          "write the times of the frame in coordinator and agents, for ui.perfetto.dev");
  AddFlag(set, "--like", "FILE.png", &flags->like, ParseText,
          "make the picture in FILE.png again, from the record that render keeps in its pictures, "
          "and compare; takes no flag that decides a pixel");
  set->AddSwitch("--no-metadata", &flags->has_no_metadata,
                 "write pictures without a record of how they were made");
  set->AddSwitch("--allow-partial", &flags->allow_partial,
                 "draw what there is if some shards are not served, and say what is missing; else "
                 "that is an error");
  AddFlag(set, "--dataset-id", "ID", &flags->dataset_id, ParseText,
          "fail if the dataset under that name has another id; `isoscope info` prints it");
  client::AddAnnotationFlags(set, &flags->annotations);
  AddQuietFlag(set, &flags->is_quiet);
}

absl::Status CheckUsage(const RenderFlags& flags, const FlagSet& set, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  if (!flags.like) {
    if (!HasSurfaces(flags.request)) {
      ISOSCOPE_RETURN_IF_ERROR(CheckInputExists(flags.session));
    }
    ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.request));
  }
  if (flags.has_no_measures && !flags.stats) {
    return UsageError("--no-measures is for --stats: give that too");
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckShow(flags, context));
  ISOSCOPE_RETURN_IF_ERROR(CheckFormat(flags));
  if (!flags.like) {
    ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.view, flags.request.camera));
    ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.level));
    ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.planes, flags.output));
    ISOSCOPE_RETURN_IF_ERROR(
        CheckUsage(flags.look, flags.request.surface_count(), flags.request.has_sample_caps()));
    const bool has_frames = flags.sweep.frame_count() > 1 || flags.sweep.is_step_sweep();
    if (flags.planes.files.any_plane() && has_frames) {
      return UsageError("planes are written of one picture: leave --repeat and sweeps out");
    }
    if (flags.trace && has_frames) {
      return UsageError("--trace is for one frame: leave --repeat and sweeps out");
    }
    if (flags.annotations.has_legend && flags.look.color_by.empty() &&
        !flags.request.has_sample_caps()) {
      return UsageError(
          "--legend shows what the colours of --color-by and of --caps MAP mean: give one of them");
    }
    ISOSCOPE_RETURN_IF_ERROR(CheckPoster(flags));
    return CheckUsage(flags.sweep, flags.request.selection, flags.output.value_or(""));
  }
  if (flags.request.culling == frame::Culling::kMask) {
    return UsageError("--culling mask can't be used with --like: it is approximate");
  }
  if (client::IsAnimationName(*flags.output) || flags.is_jpeg()) {
    return UsageError("--like makes one picture again: --output must end in .png");
  }
  return client::CheckOnlyFlagsBesideLike(set);
}

void FillFirstLook(RenderFlags* flags) {
  if (!flags->shows_first_look()) {
    return;
  }
  if (!flags->look.material) {
    flags->look.material = client::MaterialChoice::kSoft;
  }
  const bool has_picture = flags->output || !flags->planes.files.any_plane();
  if (!flags->effects.samples && has_picture) {  // planes have one sample
    client::EffectFlags finer = flags->effects;
    finer.samples = wire::GetFirstLook().samples();
    if (CanDraw(*flags, finer)) {
      flags->effects = finer;
    }
  }
}

absl::Status CheckOutputs(const RenderFlags& flags) {
  if (flags.output && !flags.is_to_stdout()) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(FrameFileName(*flags.output, 0)));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckWritable(flags.planes));
  if (flags.view.save_camera_file) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(*flags.view.save_camera_file));
  }
  if (flags.trace) {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(*flags.trace));
  }
  return flags.stats && *flags.stats != "-" ? io::CheckWritable(*flags.stats) : absl::OkStatus();
}

}  // namespace isoscope::cli
