// Flags of `render` for lights, and for the quantities that colours show.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_LOOK_FLAGS_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_LOOK_FLAGS_H_

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/cli/flag_set.h"
#include "core/frame/appearance.h"
#include "core/frame/color.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::client {

// Parses "X,Y,Z[:INTENSITY[:R,G,B]]": the direction to the light, not (0, 0, 0), in the view's
// space.
absl::StatusOr<frame::Light> ParseLight(absl::string_view text);

// "x|y|z|gradient[:MAP[:MIN,MAX[:OPACITY,OPACITY]]]", "normal", or "none" for a surface that keeps
// its colour. Every other text is a field of the dataset: "FIELD[:COMPONENT][:MAP[...]]", whose
// name may have colons, too; it ends before the last word that is a map. MIN,MAX may be empty
// before opacities.
struct ColorByValue {
  std::optional<frame::ColorBy> color_by;  // of a field, all but its quantity
  std::string field = {};                  // with the component, as FieldValue; empty: none
  std::string component = {};              // once ResolveNames has split them

  friend bool operator==(const ColorByValue&, const ColorByValue&) = default;
};
absl::StatusOr<ColorByValue> ParseColorBy(absl::string_view text);

// Parses "" or "MAP[:MIN,MAX]": caps with the surface's colour, or with the samples.
absl::StatusOr<frame::ClipCaps> ParseCaps(absl::string_view text);

// How surfaces reflect the light of the eye.
enum class MaterialChoice {
  kGlossy,  // as the server's default: a white highlight where they face the eye
  kSoft,    // that of the first look, which burns no colour out
};

// Parses "LOW,HIGH", percent with 0 <= LOW < HIGH <= 100, or "none".
struct CapWindow {
  std::optional<frame::Percentiles> percentiles;  // none: the range of the samples

  friend bool operator==(const CapWindow&, const CapWindow&) = default;
};
absl::StatusOr<CapWindow> ParseCapWindow(absl::string_view text);

struct LookFlags {
  std::vector<frame::Light> lights = {};
  std::optional<frame::Light::Space> light_space = std::nullopt;  // of all lights
  // One value for all surfaces, or one for each.
  std::vector<ColorByValue> color_by = {};
  std::optional<frame::Color> nan_color = std::nullopt;  // of missing values
  std::optional<MaterialChoice> material = std::nullopt;
  // Of maps without a range of their own, that of caps included.
  std::optional<frame::RangeSource> color_range = std::nullopt;
  std::optional<CapWindow> cap_window = std::nullopt;  // of the samples on caps; before color_range
};

// `flags` must outlive the parsing.
void AddLookFlags(cli::FlagSet* set, LookFlags* flags);

// UsageError. `has_sample_caps`: cuts show samples through a map.
absl::Status CheckUsage(const LookFlags& flags, std::size_t surface_count, bool has_sample_caps);
// INVALID_ARGUMENT if a surface is to be coloured by a field, and the dataset has none.
absl::Status CheckColorFields(const LookFlags& flags, const isoscope::v1::Dataset& dataset);

// Adds the flags to a request. If its single isovalue is to be coloured, or gets a material, it becomes
// a surface.
// REQUIRES: CheckUsage is OK.
void AddLook(const LookFlags& flags, isoscope::v1::RenderIsosurfaceRequest* request);

// Gives caps that show samples the window that clients ask for by themselves, 2 to 98 percent of the
// samples, unless a flag or the caps say otherwise. Only for servers with the feature `color_ranges`.
void AddCommonCapWindow(const LookFlags& flags, isoscope::v1::RenderIsosurfaceRequest* request);

// Whether a request has a range of what is visible.
bool HasVisibleRange(const isoscope::v1::RenderIsosurfaceRequest& request);
// Gives a request the numbers that the answer to a like one has, where it asks for percentiles or for
// what is visible: so the colours of a film, and of the regions of a picture, mean the same.
void KeepRanges(const isoscope::v1::RenderIsosurfaceResponse& answer,
                isoscope::v1::RenderIsosurfaceRequest* request);

// Returns the name of a map for --color-by: "cool-warm".
std::string NameOf(frame::ColorMap map);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_LOOK_FLAGS_H_
