// Caps: the cuts of a clip region through the inside of opaque surfaces, as fragments.
//
// Each ray that crosses the border of the region inside the volume has up to two points on it
// (view::ClipCrossingFinder). A point that lies in the solid of a surface, as the triangles of its
// cell bound it (extract::IsInsideCell), is a fragment of that surface. If there are several, it is
// of the earliest one of labels; without one, of that of the highest isovalue. It belongs to the
// block that has the point's cell. It depends only on pixel, view, region, and the samples of that
// cell and its neighbours. So culling, agents and blocks treat caps as any other fragments
// (docs/numerics.md, "Caps").
//
// No gap opens between a cap and the clipped triangles. Rasterising moves the edge of a triangle by
// a part of a pixel. So a point that is outside still counts if a ray beside it, a small margin
// away, is inside.

#ifndef ISOSCOPE_CORE_RENDER_CLIP_CAPS_H_
#define ISOSCOPE_CORE_RENDER_CLIP_CAPS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"

#include "core/frame/frame_spec.h"
#include "core/frame/picture_revision.h"
#include "core/image/fragment.h"
#include "core/math/vec.h"
#include "core/render/map_level.h"
#include "core/view/clip_crossings.h"
#include "core/view/clip_region.h"
#include "core/view/view.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/block_spans.h"
#include "core/volume/inside_rule.h"
#include "core/volume/scalar_span.h"

namespace isoscope::render {

// A fragment of a cap, at pixel (x, y) of the picture.
struct CapFragment {
  int x = 0;
  int y = 0;
  std::uint64_t key = 0;
  image::Rgba8 color;
};

// The colour of a sample on a cut.
using SampleColor = std::function<image::Rgba8(double value)>;

// The caps of one frame. Immutable; thread-safe.
class CapPainter {
 public:
  // spec:         has caps; sends_normals decides whether colours are normals
  // back_end:     draws the triangles, and decides the margin
  // sample_color: the colour map of caps; null: caps have the look of their surface
  CapPainter(const view::View& view, const volume::BlockLayout& layout,
             const frame::FrameSpec& spec, frame::BackEnd back_end, SampleColor sample_color);

  // The data that Paint needs of a block.
  enum class Need {
    kNothing,  // it has no caps
    kSpan,     // its cells are all inside of one surface: no samples
    kSamples,
  };
  // spans: of the volume; this reads those of the block and of its neighbours
  [[nodiscard]] Need NeedOf(volume::BlockId id, volume::BlockSpans* spans) const;

  // Whether caps of a surface show the field that colours it.
  [[nodiscard]] bool ShowsField(std::size_t surface_index) const;

  // Calls `visit` with each fragment of the block's caps that `is_hidden` does not hide.
  //
  // span:      of the block; unused if there are samples
  // samples:   null for Need::kSpan
  // fields:    by surface, the samples of the field that it shows, of the same block; may be empty
  //            if ShowsField is false for all
  // is_hidden: whether the pixel shows something nearer than a depth already
  void Paint(volume::BlockId id, const volume::ScalarSpan& span,
             const volume::BlockSamples* samples, std::span<const volume::BlockSamples> fields,
             absl::FunctionRef<bool(int x, int y, float depth)> is_hidden,
             absl::FunctionRef<void(const CapFragment&)> visit) const;

 private:
  // An opaque surface.
  struct Solid {
    volume::InsideRule rule;
    std::uint32_t surface_index = 0;
    bool shows_field = false;
    std::vector<image::Rgba8> shade_table;  // if colours are those of the head light
  };
  // The solid that a point is inside of.
  struct Filling {
    const Solid* solid = nullptr;
    // The sample, the length of the gradient or the value of the field there, if the cap shows it.
    double value = 0;
  };

  [[nodiscard]] std::optional<Filling> FillingAt(const volume::BlockSamples& samples,
                                                 const math::Index3& own_cell,
                                                 const math::Vec3d& position) const;
  [[nodiscard]] std::optional<Filling> FillingBeside(const volume::BlockSamples& samples, double x,
                                                     double y, const view::ClipCrossing& crossing,
                                                     bool is_entry) const;
  [[nodiscard]] double ShownValueAt(const Solid& solid, const volume::BlockSamples& samples,
                                    std::span<const volume::BlockSamples> fields,
                                    const math::Vec3d& position) const;
  [[nodiscard]] const Solid* SolidOfSpan(const volume::ScalarSpan& span) const;
  [[nodiscard]] bool MayHaveInside(const volume::ScalarSpan& span) const;
  [[nodiscard]] CapFragment FragmentOf(int x, int y, volume::BlockId id,
                                       const view::ClipCrossing& crossing,
                                       const Filling& filling) const;

  const view::View view_;
  const volume::BlockLayout layout_;
  const view::Clipper clipper_;
  const view::ClipCrossingFinder crossings_;
  const image::FragmentOrder order_;
  const bool sends_normals_;
  const double margin_px_;
  const SampleColor sample_color_;
  const std::vector<std::optional<MapScale>> scales_;  // by surface
  const bool needs_values_;
  std::uint32_t surface_count_ = 0;
  // Those of labels in the order of surfaces; then the highest isovalue first, then the first
  // surface.
  std::vector<Solid> solids_;
  std::vector<math::Vec3d> normals_;  // of caps, by half-space: world space, unit length
  std::vector<image::Rgba8> normal_codes_;
};

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_CLIP_CAPS_H_
