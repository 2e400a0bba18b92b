// Converts the surfaces of a frame between wire and core types: their rules, colours, materials
// and maps, the caps of their cuts, and the lights on them. All errors are INVALID_ARGUMENT; they
// name the field, its value and the allowed values. `path` is the field's name in messages.

#ifndef ISOSCOPE_WIRE_SURFACE_CONVERT_H_
#define ISOSCOPE_WIRE_SURFACE_CONVERT_H_

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "google/protobuf/repeated_field.h"

#include "core/frame/frame_spec.h"
#include "core/image/fragment.h"
#include "core/math/vec.h"
#include "core/volume/inside_rule.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "wire/color_range_convert.h"  // IWYU pragma: export

namespace isoscope::wire {

// Returns `value`. INVALID_ARGUMENT unless it lies in [min, max]; NaN does not.
absl::StatusOr<float> InRange(float value, float min, float max, absl::string_view path);
// The length must be neither 0 nor infinite.
absl::Status CheckLength(const math::Vec3d& v, const std::string& path);

// The rule of a surface, by its isovalue or its labels, of which those that are equal count once.
// `path` is put before the names of the fields.
absl::StatusOr<volume::InsideRule> InsideRuleFromProto(
    double isovalue, const google::protobuf::RepeatedField<double>& labels, bool smooths,
    const std::string& path);
// The rule of a set of labels.
absl::StatusOr<volume::InsideRule> LabelsFromProto(
    const google::protobuf::RepeatedField<double>& labels, bool smooths, const std::string& path);

// The surfaces that a request lists, or the one that its isovalue and base_color make.
//
// max_surfaces: INVALID_ARGUMENT above it
absl::StatusOr<std::vector<frame::Surface>> SurfacesFromProto(
    const isoscope::v1::RenderIsosurfaceRequest& request,
    std::size_t max_surfaces = frame::kMaxSurfaces);
// The surfaces of a list, 1 to max_surfaces.
absl::StatusOr<std::vector<frame::Surface>> SurfacesFromProto(
    const google::protobuf::RepeatedPtrField<isoscope::v1::Surface>& proto,
    std::size_t max_surfaces = frame::kMaxSurfaces);
absl::StatusOr<std::vector<frame::Light>> LightsFromProto(
    const google::protobuf::RepeatedPtrField<isoscope::v1::Light>& proto);
absl::StatusOr<frame::ClipCaps> ClipCapsFromProto(const isoscope::v1::ClipCaps& proto,
                                                  const std::string& path);
absl::StatusOr<frame::ColorBy> ColorByFromProto(const isoscope::v1::ColorBy& proto,
                                                absl::string_view path);
// FrameSpecFromProto gives the same back.
isoscope::v1::Surface ToProto(const frame::Surface& surface);
isoscope::v1::ColorBy ToProto(const frame::ColorBy& color_by);
isoscope::v1::ClipCaps ToProto(const frame::ClipCaps& caps);
isoscope::v1::Light ToProto(const frame::Light& light);

// The opaque colour of missing values.
absl::StatusOr<image::Rgba8> NanColorFromProto(const isoscope::v1::Color& proto);

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_SURFACE_CONVERT_H_
