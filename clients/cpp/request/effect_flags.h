// The flags of effects on the drawn pixels: samples, ambient occlusion, silhouettes.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_EFFECT_FLAGS_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_EFFECT_FLAGS_H_

#include <cstdint>
#include <optional>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "clients/cpp/request/parse_value.h"
#include "core/cli/flag_set.h"
#include "core/view/camera.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::client {

// Unset members get the server's defaults.
struct AmbientOcclusionValue {
  std::optional<std::int64_t> radius_px;
  std::optional<double> strength;

  friend bool operator==(const AmbientOcclusionValue&, const AmbientOcclusionValue&) = default;
};
// "", "RADIUS" or "RADIUS,STRENGTH".
absl::StatusOr<AmbientOcclusionValue> ParseAmbientOcclusion(absl::string_view text);

struct SilhouetteValue {
  std::optional<std::int64_t> width_px;
  std::optional<frame::Color> color;

  friend bool operator==(const SilhouetteValue&, const SilhouetteValue&) = default;
};
// "", "WIDTH" or "WIDTH:R,G,B".
absl::StatusOr<SilhouetteValue> ParseSilhouette(absl::string_view text);

struct EffectFlags {
  std::optional<std::int64_t> samples = std::nullopt;  // of a pixel: 1, 4, 9 or 16
  std::optional<AmbientOcclusionValue> ambient_occlusion = std::nullopt;
  std::optional<SilhouetteValue> silhouette = std::nullopt;

  // Returns the size at which a picture of `size` is drawn, without the margin of a region.
  [[nodiscard]] view::Viewport drawn_size(const view::Viewport& size) const;
  // Returns the largest side of a region.
  [[nodiscard]] int max_region_side_px() const;

 private:
  [[nodiscard]] int samples_per_side() const;
};

// `flags` must outlive the parsing.
void AddEffectFlags(cli::FlagSet* set, EffectFlags* flags);

// Writes the flags into the request.
void SetEffects(const EffectFlags& flags, isoscope::v1::RenderIsosurfaceRequest* request);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_EFFECT_FLAGS_H_
