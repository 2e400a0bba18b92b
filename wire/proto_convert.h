// Converts between messages and core types. Values from the wire are checked in full: none that is
// not finite, or out of its range, gets past here.
//
// All From functions return an INVALID_ARGUMENT that names the field, its value and the allowed
// ones. `path` is the field's name in the request ("camera"); messages extend it ("camera.eye.x").
// Thread-safe.

#ifndef ISOSCOPE_WIRE_PROTO_CONVERT_H_
#define ISOSCOPE_WIRE_PROTO_CONVERT_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/frame/agent_statistics.h"
#include "core/frame/culling.h"
#include "core/image/frame_image.h"
#include "core/math/vec.h"
#include "core/store/manifest.h"
#include "core/view/camera.h"
#include "core/volume/block_layout.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/label.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/frame.pb.h"
#include "isoscope/v1/geometry.pb.h"

namespace isoscope::wire {

absl::Status CheckFinite(double value, absl::string_view path);

absl::StatusOr<math::Vec3d> VectorFromProto(const isoscope::v1::Vec3& proto,
                                            absl::string_view path);
isoscope::v1::Dimensions ToProto(const math::Index3& dims);
isoscope::v1::Vec3 ToProto(const math::Vec3d& vector);

// Degrees become radians; an unset `up` is (0, 1, 0). The same message gives the same bits on every
// machine.
absl::StatusOr<view::Camera> CameraFromProto(const isoscope::v1::Camera& proto,
                                             absl::string_view path);
// CameraFromProto(ToProto(camera)) == camera for a camera that came from a message, so that agents
// and a client's next request have the same bits. Otherwise it is within one rounding.
isoscope::v1::Camera ToProto(const view::Camera& camera);

absl::StatusOr<view::Viewport> ViewportFromProto(const isoscope::v1::Viewport& proto,
                                                 absl::string_view path,
                                                 int max_side_px = view::kMaxViewportPx);
isoscope::v1::Viewport ToProto(const view::Viewport& viewport);

// The region must lie inside the viewport.
absl::StatusOr<view::Region> RegionFromProto(const isoscope::v1::Region& proto,
                                             const view::Viewport& viewport,
                                             absl::string_view path);
isoscope::v1::Region ToProto(const view::Region& region);

// CULLING_UNSPECIFIED is kDepth.
absl::StatusOr<frame::Culling> CullingFromProto(isoscope::v1::Culling proto,
                                                absl::string_view path);
isoscope::v1::Culling ToProto(frame::Culling culling);

// Each channel is rounded to 8 bits.
absl::StatusOr<image::Rgba8> ColorFromProto(const isoscope::v1::Color& proto,
                                            absl::string_view path);
// ColorFromProto(ToProto(color)) == color.
isoscope::v1::Color ToProto(image::Rgba8 color);

absl::StatusOr<volume::GridGeometry> GeometryFromProto(const isoscope::v1::GridGeometry& proto,
                                                       absl::string_view path);
isoscope::v1::GridGeometry ToProto(const volume::GridGeometry& geometry);

isoscope::v1::SampleType ToProto(volume::ScalarType type);
absl::StatusOr<volume::ScalarType> ScalarTypeFromProto(isoscope::v1::SampleType proto,
                                                       absl::string_view path);

// Returns a dataset as clients see it, without missing_shards. Leaves out `value_range` if all
// samples are NaN.
isoscope::v1::Dataset ToProto(const store::Manifest& manifest);
isoscope::v1::Label ToProto(const volume::Label& label);
// Alpha is ignored. Errors also as volume::ValidateLabels.
absl::StatusOr<std::vector<volume::Label>> LabelsFromProto(
    const google::protobuf::RepeatedPtrField<isoscope::v1::Label>& proto, absl::string_view path);
// Checks an agent's description of its dataset: name, id, geometry, blocks, shard count, labels.
absl::Status Validate(const isoscope::v1::Dataset& dataset, absl::string_view path);

// `ids`: ascending, each once.
isoscope::internal::v1::BlockList ToProto(const std::vector<volume::BlockId>& ids);
// Ids must ascend strictly and lie in [0, block_count).
absl::StatusOr<std::vector<volume::BlockId>> BlockListFromProto(
    const isoscope::internal::v1::BlockList& proto, std::int64_t block_count,
    absl::string_view path);

// Strictly ascending and in [0, shard_count), at least one.
absl::StatusOr<std::vector<int>> ShardIndicesFromProto(
    const google::protobuf::RepeatedField<std::int32_t>& proto, int shard_count,
    absl::string_view path);

isoscope::v1::AgentStatistics ToProto(const frame::AgentStatistics& statistics);
isoscope::v1::SurfaceStatistics ToProto(const frame::SurfaceStatistics& statistics);
// Takes numbers as they are, and durations as DurationFromProto does.
frame::AgentStatistics AgentStatisticsFromProto(const isoscope::v1::AgentStatistics& proto);

google::protobuf::Duration ToProto(absl::Duration duration);
// Clamps durations to +-10000 years. For statistics only.
absl::Duration DurationFromProto(const google::protobuf::Duration& proto);

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_PROTO_CONVERT_H_
