// Converts a pick between wire and core types: the smallest frame that holds its pixels.

#ifndef ISOSCOPE_WIRE_PICK_CONVERT_H_
#define ISOSCOPE_WIRE_PICK_CONVERT_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/math/vec.h"
#include "core/volume/block_layout.h"
#include "core/volume/inside_rule.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "wire/frame_convert.h"

namespace isoscope::wire {

// A pixel of the whole viewport.
struct PixelPosition {
  int x = 0;
  int y = 0;

  friend bool operator==(const PixelPosition&, const PixelPosition&) = default;
};

inline constexpr int kMaxPickedPixels = 1000;

struct PickSpec {
  // The frame of the request without its look, with the region around all pixels, normals and exact
  // culling.
  AskedFrame asked;
  std::vector<PixelPosition> pixels;  // 1 to kMaxPickedPixels, all in the region
};

// Checks everything that does not depend on the dataset, also for unknown fields. INVALID_ARGUMENT
// names the field, its value and the allowed values.
absl::StatusOr<PickSpec> PickSpecFromProto(const isoscope::v1::PickSurfaceRequest& proto);

// Converts the points of a request to an agent. INVALID_ARGUMENT if there are more than
// kMaxPickedPixels, or one is not finite.
absl::StatusOr<std::vector<math::Vec3d>> PickedPointsFromProto(
    const isoscope::internal::v1::GetGradientsRequest& proto);

// Converts the blocks that show these points: one for each point, or none of them; not set: no
// block. INVALID_ARGUMENT if there are as many neither as points nor none, or one is not in
// [-1, block_count).
absl::StatusOr<std::vector<std::optional<volume::BlockId>>> PickedBlocksFromProto(
    const isoscope::internal::v1::GetGradientsRequest& proto, std::int64_t block_count);

// The surface that shows a point.
struct PickedSurface {
  volume::InsideRule rule;
  bool is_on_cap = false;
};
// Returns the surface of each point, or nothing if a request asks neither for values nor for
// labels. INVALID_ARGUMENT if the values are of no or too many volumes, if not all of isovalues,
// label set indices, caps and block_ids are as many as points, or if an isovalue, a label or an
// index is wrong.
absl::StatusOr<std::vector<PickedSurface>> PickedSurfacesFromProto(
    const isoscope::internal::v1::GetGradientsRequest& proto);
inline constexpr int kMaxPickedVolumes = 1000;

// Assigns the gradients of one agent's answer to their points. INVALID_ARGUMENT if a point is none
// of the request's, or a gradient is not finite.
//
// gradients: one for each point
absl::Status AddGradients(const isoscope::internal::v1::GetGradientsResponse& proto,
                          std::vector<std::optional<math::Vec3d>>* gradients);

// Assigns the shards of one agent's answer to their points. INVALID_ARGUMENT if a point is none of
// the request's, or a shard none of those that the agent was asked for.
//
// asked:  ascending
// shards: one for each point
absl::Status AddPointShards(const isoscope::internal::v1::GetGradientsResponse& proto,
                            const std::vector<int>& asked, std::vector<std::optional<int>>* shards);

// Assigns the values of one agent's answer to their points. INVALID_ARGUMENT if a point is none of
// the request's, or if not each volume has a value.
//
// values: by point, by volume; a point that nobody answered has none
absl::Status AddPointValues(const isoscope::internal::v1::GetGradientsResponse& proto,
                            std::size_t volume_count, std::vector<std::vector<double>>* values);

// Assigns the labels of one agent's answer to their points. INVALID_ARGUMENT if a point is none of
// the request's, or a label none of its surface's.
//
// rules:  of the surface of each point
// labels: one for each point; not set: nobody answered
absl::Status AddPointLabels(const isoscope::internal::v1::GetGradientsResponse& proto,
                            const std::vector<volume::InsideRule>& rules,
                            std::vector<std::optional<double>>* labels);

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_PICK_CONVERT_H_
