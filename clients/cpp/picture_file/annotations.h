// Annotations: orientation axes, a scale bar, a legend and a caption, drawn by Cairo over a
// received picture. The server's pictures have none.

#ifndef ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_ANNOTATIONS_H_
#define ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_ANNOTATIONS_H_

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/frame/appearance.h"
#include "core/image/png_codec.h"
#include "core/view/camera.h"
#include "core/view/view.h"
#include "core/volume/patient_frame.h"

namespace isoscope::client {

// The requested annotations.
struct Annotations {
  bool has_axes = false;
  bool has_scale_bar = false;
  bool has_legend = false;
  // "{isovalue}" in it becomes the frame's, or the name of a label, several with commas between;
  // "{time}" its time with unit; "\n" (two letters) begins a new line.
  std::optional<std::string> caption = std::nullopt;

  [[nodiscard]] bool any() const { return has_axes || has_scale_bar || has_legend || caption; }
};

// The colouring of a surface: a part of the legend.
struct SurfaceColoring {
  std::size_t surface_index = 0;
  frame::ColorBy color_by;       // with its range, if it has a map
  std::string field_title = {};  // of a colour by a field, with its unit
  // The colour of missing values, if the picture shows it.
  std::optional<image::Rgba8> nan_color = std::nullopt;
};

// The colouring of caps that show samples: likewise.
struct CapsColoring {
  frame::ColorMap map = frame::ColorMap::kViridis;
  frame::ColorRange range;
  std::string title;
  std::optional<image::Rgba8> nan_color = std::nullopt;
};

// The properties of a frame that annotations depend on.
struct AnnotationScene {
  view::Camera camera;
  int viewport_height_px = 0;     // spanned by the camera's angle or height
  std::vector<double> isovalues;  // of the surfaces, in their order
  // Names of the surfaces of labels, by surface; empty or missing: the isovalue is the name.
  std::vector<std::string> label_names{};
  bool is_background_light = false;  // dark ink is needed
  std::array<std::string, 3> axis_names{"X", "Y", "Z"};
  // Names of the opposite ends; empty: these have no arm.
  std::array<std::string, 3> opposite_names{};
  std::vector<SurfaceColoring> colorings;  // ascending surfaces
  std::optional<CapsColoring> caps_coloring = std::nullopt;
  std::string length_unit = {};  // of world space; empty: not known
  std::string time = {};         // with its unit; empty: none
};

// Names the axes by the sides of a patient.
void NameAxes(const volume::PatientFrame& frame, AnnotationScene* scene);

// Returns the multiples of a round number (1, 2 or 5 times a power of ten) that lie in the range,
// ascending. The round number is the least one that gives at most `max_count` (>= 2) multiples.
// There is at least one.
std::vector<double> LegendTicks(const frame::ColorRange& range, int max_count);
// The text of a tick, with enough digits to tell it from those `step` before and behind it.
std::string TickLabel(double value, double step);

// A scale bar: a round number of world units and its length in the picture.
struct ScaleBar {
  double world_length = 0;  // 1, 2 or 5 times a power of ten
  double length_px = 0;
  std::string label;
};

// Returns the longest bar of at most `max_px` pixels. It is exact for an orthographic camera. For a
// perspective one it is valid at the target's distance, and the label says so.
ScaleBar MakeScaleBar(const AnnotationScene& scene, double max_px);

// Returns the screen directions of the world's axes x, y, z: components to the right, up and away
// from the eye, together of unit length.
std::array<math::Vec3d, 3> AxisDirections(const view::Camera& camera);

struct Annotated {
  image::RgbaImage picture;
  // Pixels outside of these are unchanged.
  std::vector<view::PixelRect> boxes;
};

// Draws over the picture. The result is the same on one machine; another one may have another font.
// INVALID_ARGUMENT if the caption is not UTF-8, or has more than 16384 bytes with its isovalues and
// times, or if a legend is requested and neither a surface nor caps show a quantity;
// FAILED_PRECONDITION if there is no font. Thread-safe.
absl::StatusOr<Annotated> Annotate(const Annotations& annotations, const AnnotationScene& scene,
                                   image::RgbaImage picture);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_ANNOTATIONS_H_
