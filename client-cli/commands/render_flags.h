// The flags of `isoscope render`, and the rules for their combinations.

#ifndef ISOSCOPE_CLIENT_CLI_COMMANDS_RENDER_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_COMMANDS_RENDER_FLAGS_H_

#include <optional>
#include <string>

#include "absl/status/status.h"

#include "client-cli/output/picture_output.h"
#include "client-cli/output/plane_flags.h"
#include "client-cli/session/session.h"
#include "client-cli/terminal/show_picture.h"
#include "clients/cpp/picture_file/annotations.h"
#include "clients/cpp/request/effect_flags.h"
#include "clients/cpp/request/level_flags.h"
#include "clients/cpp/request/look_flags.h"
#include "clients/cpp/request/render_request.h"
#include "clients/cpp/request/sweep_flags.h"
#include "clients/cpp/request/view_flags.h"
#include "core/cli/command.h"
#include "core/cli/flag_set.h"
#include "core/view/camera.h"

namespace isoscope::cli {

struct RenderFlags {
  SessionFlags session;
  client::RequestFlags request;
  client::SweepFlags sweep;
  PlaneFlags planes;
  client::EffectFlags effects;
  client::ViewFlags view;
  client::LookFlags look;
  client::LevelFlags level;
  std::optional<std::string> output;
  std::optional<std::string> stats;
  std::optional<std::string> like;
  std::optional<ShowMode> show;
  std::optional<std::string> trace;
  bool has_no_metadata = false;
  bool has_no_measures = false;
  bool allow_partial = false;
  bool is_quiet = false;
  std::optional<std::string> dataset_id;
  client::Annotations annotations;

  // Whether the picture is the first look: no flag says anything of the camera.
  [[nodiscard]] bool shows_first_look() const {
    return !like && !client::HasCamera(view, request.camera);
  }
  // Returns true if the picture is drawn region by region.
  [[nodiscard]] bool is_poster() const;
  // The size of a poster's regions.
  [[nodiscard]] view::Viewport region_size() const;
  // The size of the frames that agents draw.
  [[nodiscard]] view::Viewport drawn_size() const;
  // The layers of these frames, if surfaces are translucent; else 0.
  [[nodiscard]] int drawn_layers() const;
  [[nodiscard]] bool is_jpeg() const;
  // The PNG goes to standard output.
  [[nodiscard]] bool is_to_stdout() const { return output == kStandardOutput; }
  // Standard output takes either the statistics or the picture.
  [[nodiscard]] ShowMode show_mode() const;
};

// `flags` must outlive the parsing.
void AddRenderFlags(FlagSet* set, RenderFlags* flags);

// UsageError for flags given to `set` that do not fit each other.
absl::Status CheckUsage(const RenderFlags& flags, const FlagSet& set, const Context& context);

// Fills in samples and material of the first look, where it is shown and no flag has them. Planes
// keep one sample, as do pictures that could not be drawn with more.
void FillFirstLook(RenderFlags* flags);

// Checks that the outputs can be written, before any work.
absl::Status CheckOutputs(const RenderFlags& flags);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_RENDER_FLAGS_H_
