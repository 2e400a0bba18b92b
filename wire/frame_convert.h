// Converts frames between wire and core types. A new parameter of a frame is checked and converted
// here and in surface_convert.h, and nowhere else: from requests of clients, and to and from the
// internal message that agents get.

#ifndef ISOSCOPE_WIRE_FRAME_CONVERT_H_
#define ISOSCOPE_WIRE_FRAME_CONVERT_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/frame/frame_spec.h"
#include "core/frame/picture_revision.h"
#include "core/math/box.h"
#include "core/view/camera.h"
#include "core/view/clip_region.h"
#include "core/view/level_choice.h"
#include "core/volume/patient_frame.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "wire/surface_convert.h"  // IWYU pragma: export

namespace isoscope::wire {

// Converts a request. Checks everything that does not depend on the dataset, also for unknown
// fields. The camera stays unset if the request has none. The same message gives the same bits on
// every machine. INVALID_ARGUMENT names the field, its value and the allowed values.
absl::StatusOr<frame::FrameSpec> FrameSpecFromProto(
    const isoscope::v1::RenderIsosurfaceRequest& request);

// Converts the part of a frame that agents draw: all but nan_color, output, effects and sources of
// ranges. FrameSpecFromProto gives the same bits back, if the camera came from a message.
isoscope::internal::v1::FrameSpec ToProto(const frame::FrameSpec& spec);
// Checks the members as those of a request. The camera stays unset if the message has none.
absl::StatusOr<frame::FrameSpec> FrameSpecFromProto(const isoscope::internal::v1::FrameSpec& proto);

// A request for a frame: the frame, and what is no part of it.
struct AskedFrame {
  frame::FrameSpec spec;
  std::string dataset;     // as the request names it
  std::string dataset_id;  // that it must have; empty: any
  std::optional<isoscope::v1::FieldSelection> selection;
  isoscope::v1::CameraFit fit = isoscope::v1::CAMERA_FIT_VOLUME;  // never unspecified
  view::Viewport fit_viewport;  // of the request: pictures in motion may be drawn smaller
  std::optional<view::LevelChoice> level;  // not set: level 0, and the answer does not name it
  bool with_trace = false;
  bool allow_partial = false;
  bool with_notes = false;
  bool with_unresolved_count = false;
  bool with_all_fields = false;  // the agents must have the volumes of all fields
};
// Converts a request, as FrameSpecFromProto. Nothing reads the message after that.
absl::StatusOr<AskedFrame> AskedFrameFromProto(
    const isoscope::v1::RenderIsosurfaceRequest& request);

// Converts a clip region. INVALID_ARGUMENT names the field below `path`, its value and the allowed
// values.
absl::StatusOr<view::ClipRegion> ClipRegionFromProto(const isoscope::v1::ClipRegion& proto,
                                                     const std::string& path);
isoscope::v1::ClipRegion ToProto(const view::ClipRegion& clip);

// Converts the choice of a level. INVALID_ARGUMENT names the field below `path`, its value and the
// allowed values.
absl::StatusOr<view::LevelChoice> LevelChoiceFromProto(const isoscope::v1::LevelChoice& proto,
                                                       const std::string& path);
isoscope::v1::LevelChoice ToProto(const view::LevelChoice& choice);
// Returns the number of a level. INVALID_ARGUMENT outside of 0 to volume::kMaxLevel.
absl::StatusOr<int> LevelFromProto(std::int32_t level, absl::string_view path);

// The most surfaces of one export: as many as a dataset has names of labels.
inline constexpr std::size_t kMaxExportedSurfaces = 65536;

// A request for a mesh, in core types.
struct ExportSpec {
  std::vector<volume::InsideRule> rules;  // of the surfaces, 1 to kMaxExportedSurfaces
  view::ClipRegion clip;
  bool closes = false;
  bool with_origin = false;
  bool with_measures = false;
  bool without_mesh = false;
  int level = 0;
};
// Converts a request. Surfaces and clip region are checked as those of a frame, also for unknown
// fields. INVALID_ARGUMENT if neither a mesh nor measures are wanted, or measures of a level.
absl::StatusOr<ExportSpec> ExportSpecFromProto(
    const isoscope::v1::ExportIsosurfaceRequest& request);

// Gives a frame without a camera the default one of `bounds`. With `surface_bounds`
// (CAMERA_FIT_SURFACE) the camera is moved from the one box to the other. A new camera is as a
// message has it, so that agents and the client's next request have the same bits.
absl::Status ResolveCamera(const math::Box3d& bounds, frame::FrameSpec* spec,
                           const std::optional<math::Box3d>& surface_bounds = std::nullopt);

// Does the same for CAMERA_FIT_CELLS. A frame without a camera gets that of FirstLook.
//
// cells: the box of the active cells; not set: there are none
absl::Status ResolveCellsCamera(const math::Box3d& bounds, const std::optional<math::Box3d>& cells,
                                const std::optional<volume::PatientFrame>& patient_frame,
                                const view::Viewport& viewport, frame::FrameSpec* spec);

// INVALID_ARGUMENT if this program does not know the back end, or the number is below 1.
absl::StatusOr<frame::PictureRevision> PictureRevisionFromProto(
    const isoscope::internal::v1::PictureRevision& proto, absl::string_view path);
isoscope::internal::v1::PictureRevision ToProto(const frame::PictureRevision& revision);

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_FRAME_CONVERT_H_
