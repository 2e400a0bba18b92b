// The flags of effects on the drawn pixels: samples, and each effect of the proto.
//
// An effect is a field of RenderIsosurfaceRequest with effect_options. Its flag, limits and help come
// from the options (isoscope/v1/options.proto), so a new effect changes nothing here.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_EFFECT_FLAGS_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_EFFECT_FLAGS_H_

#include <cstdint>
#include <optional>

#include "core/cli/flag_set.h"
#include "core/view/camera.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::client {

struct EffectFlags {
  std::optional<std::int64_t> samples = std::nullopt;  // of a pixel: 1, 4, 9 or 16
  // The effects that are given. Values that are not given are unset: the server has defaults.
  isoscope::v1::RenderIsosurfaceRequest effects = {};

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
