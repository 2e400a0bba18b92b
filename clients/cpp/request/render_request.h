// The flags of a frame, and the request that they make.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_RENDER_REQUEST_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_RENDER_REQUEST_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "clients/cpp/request/camera_flags.h"
#include "clients/cpp/request/clip_flags.h"
#include "clients/cpp/request/label_flags.h"
#include "clients/cpp/request/parse_value.h"
#include "clients/cpp/request/selection_flags.h"
#include "core/cli/flag_set.h"
#include "core/frame/appearance.h"
#include "core/frame/culling.h"
#include "core/view/camera.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::client {

struct RequestFlags {
  std::optional<double> isovalue = std::nullopt;
  std::optional<std::int64_t> width = std::nullopt;
  std::optional<std::int64_t> height = std::nullopt;
  std::optional<view::Region> region = std::nullopt;  // of the viewport
  CameraFlags camera = {};
  std::optional<frame::Culling> culling = std::nullopt;
  std::optional<frame::Color> base_color = std::nullopt;
  std::optional<frame::Color> background_color = std::nullopt;
  std::vector<SurfaceValue> surfaces = {};
  LabelFlags label = {};  // their surfaces follow those of isovalues
  std::optional<std::int64_t> max_layers = std::nullopt;
  ClipFlags clip = {};
  std::optional<frame::ClipCaps> caps = std::nullopt;
  SelectionFlags selection = {};

  // The levels of all surfaces that have one, in their order.
  [[nodiscard]] std::vector<double> isovalues() const;
  [[nodiscard]] std::size_t surface_count() const {
    return isovalues().size() + label.surface_count();
  }

  // Whether cuts show samples through a colour map.
  [[nodiscard]] bool has_sample_caps() const { return caps && caps->map; }

  [[nodiscard]] view::Viewport viewport() const {
    return {.width_px = static_cast<int>(width.value_or(view::kCommonViewport.width_px)),
            .height_px = static_cast<int>(height.value_or(view::kCommonViewport.height_px))};
  }
  // The size of the picture.
  [[nodiscard]] view::Viewport image_size() const { return view::ImageSizeOf(viewport(), region); }
};

// `flags` must outlive the parsing.
void AddRequestFlags(cli::FlagSet* set, RequestFlags* flags);

// UsageError.
absl::Status CheckUsage(const RequestFlags& flags);
// UsageError unless --isovalue is given, or --surface without --isovalue and --color, or labels
// beside either or alone, and no more surfaces than `max_surfaces`.
absl::Status CheckSurfaces(const std::optional<double>& isovalue,
                           const std::vector<SurfaceValue>& surfaces,
                           const std::optional<frame::Color>& color, const LabelFlags& label = {},
                           std::size_t max_surfaces = frame::kMaxSurfaces);

// REQUIRES: CheckUsage(flags) is OK, and flags.label is resolved.
isoscope::v1::RenderIsosurfaceRequest MakeRequest(const RequestFlags& flags,
                                                  const std::string& dataset,
                                                  const view::Camera& camera);
// Does the same with exactly this camera, for instance from ResolveView or a file, and with the
// fit. INVALID_ARGUMENT for an invalid camera.
absl::StatusOr<isoscope::v1::RenderIsosurfaceRequest> MakeRequest(
    const RequestFlags& flags, const std::string& dataset, const isoscope::v1::Camera& camera,
    const std::optional<isoscope::v1::CameraFit>& fit = std::nullopt);
// Returns the request of a mesh. REQUIRES: CheckSurfaces is OK, and `label` is resolved.
isoscope::v1::ExportIsosurfaceRequest MakeExportRequest(const std::optional<double>& isovalue,
                                                        const std::vector<SurfaceValue>& surfaces,
                                                        const ClipFlags& clip,
                                                        const std::string& dataset,
                                                        const LabelFlags& label = {});

// Makes the only surface of a request, by its isovalue, the first of `surfaces`, which have all others
// that requests have. Does nothing if there are surfaces.
void PromoteIsovalue(isoscope::v1::RenderIsosurfaceRequest* request);
void PromoteIsovalue(isoscope::v1::ExportIsosurfaceRequest* request);

isoscope::v1::Color ToProto(const frame::Color& color);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_RENDER_REQUEST_H_
