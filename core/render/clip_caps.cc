// The caps of one block (Paint), pixel by pixel in the block's rectangle:
//
// 1. Find where the pixel's ray enters and leaves the region (ClipCrossingFinder). Skip crossings
//    in cells of other blocks, and those that is_hidden hides.
// 2. Find the solid around the crossing (FillingAt): the first, in the order of solids_, whose
//    inside has the point. If there is none, try four rays beside it (FillingBeside).
// 3. Colour the fragment (FragmentOf): sample colour, step of the gradient's map, code of the
//    normal, or shade under the head light.
//
// NeedOf decides before that, from spans alone, whether a block has caps at all and whether Paint
// needs its samples. A block without active cells needs none if it is wholly inside one solid.

#include "core/render/clip_caps.h"

#include <algorithm>
#include <cmath>

#include "core/base/check.h"
#include "core/extract/cell_inside.h"
#include "core/image/normal_code.h"
#include "core/math/box.h"
#include "core/render/pass_resources.h"
#include "core/render/shade_kernel.h"
#include "core/volume/cell_samples.h"
#include "core/volume/field_gradient.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::render {
namespace {

// More than the distance by which snapping moves a vertex on either axis: 1/512 pixel with the CPU,
// at most 1/16 with OpenGL.
constexpr double kCpuMarginPx = 1.0 / 64;
constexpr double kEglMarginPx = 1.0 / 8;

bool IsFloat(volume::ScalarType type) {
  return type == volume::ScalarType::kFloat32 || type == volume::ScalarType::kFloat64;
}

}  // namespace

CapPainter::CapPainter(const view::View& view, const volume::BlockLayout& layout,
                       const frame::FrameSpec& spec, frame::BackEnd back_end,
                       SampleColor sample_color)
    : view_(view),
      layout_(layout),
      clipper_(spec.clip, view.geometry()),
      crossings_(view, clipper_),
      order_{.block_count = static_cast<std::uint32_t>(layout.block_count())},
      sends_normals_(spec.sends_normals),
      margin_px_(back_end == frame::BackEnd::kCpu ? kCpuMarginPx : kEglMarginPx),
      sample_color_(std::move(sample_color)),
      scales_(MapScalesOf(spec)),
      needs_values_(sample_color_ != nullptr || frame::ShowsValues(spec)),
      surface_count_(static_cast<std::uint32_t>(spec.surfaces.size())) {
  const bool is_shaded = !sends_normals_ && sample_color_ == nullptr;
  for (std::size_t i = 0; i < spec.surfaces.size(); ++i) {
    const frame::Surface& surface = spec.surfaces[i];
    if (!surface.is_translucent()) {
      solids_.push_back({.rule = surface.rule,
                         .surface_index = static_cast<std::uint32_t>(i),
                         .shows_field = surface.shows_field(),
                         .shade_table = is_shaded ? MakeShadeTable(surface.appearance)
                                                  : std::vector<image::Rgba8>()});
    }
  }
  std::stable_sort(solids_.begin(), solids_.end(), [](const Solid& a, const Solid& b) {
    if (a.rule.has_labels() != b.rule.has_labels()) {
      return a.rule.has_labels();
    }
    return !a.rule.has_labels() && a.rule.isovalue > b.rule.isovalue;
  });
  const math::Mat3d to_world = view.geometry().world_gradient_from_index();
  for (const view::HalfSpace& half_space : clipper_.half_spaces()) {
    // Points to the dropped side.
    const math::Vec3d normal = math::Normalized(-(to_world * half_space.normal));
    normals_.push_back(normal);
    normal_codes_.push_back(image::EncodeNormal({normal.x, normal.y, normal.z}));
  }
}

const CapPainter::Solid* CapPainter::SolidOfSpan(const volume::ScalarSpan& span) const {
  for (const Solid& solid : solids_) {
    const bool is_inside = solid.rule.has_labels()
                               ? span.min == span.max && solid.rule.IsInside(span.min)
                               : span.min >= solid.rule.isovalue && span.max >= solid.rule.isovalue;
    if (is_inside) {
      return &solid;
    }
  }
  return nullptr;
}

// Whether samples of a span may be inside of a solid.
bool CapPainter::MayHaveInside(const volume::ScalarSpan& span) const {
  return std::any_of(solids_.begin(), solids_.end(),
                     [&](const Solid& solid) { return solid.rule.MayHaveInside(span); });
}

CapPainter::Need CapPainter::NeedOf(volume::BlockId id, volume::BlockSpans* spans) const {
  if (solids_.empty() || clipper_.SideOf(layout_, id) != view::Clipper::Side::kCut) {
    return Need::kNothing;
  }
  const volume::ScalarSpan span = spans->Get(id);
  if (MayHaveInside(span)) {
    const bool is_active = std::any_of(solids_.begin(), solids_.end(), [&](const Solid& solid) {
      return solid.rule.IsActive(span);
    });
    // A span does not tell whether samples are NaN.
    return is_active || needs_values_ || IsFloat(spans->type()) ? Need::kSamples : Need::kSpan;
  }
  // All cells are outside; but points beside the rays may lie in a block next to this one.
  const math::Index3 at = layout_.IndexOf(id);
  const math::Index3& dims = layout_.block_dims();
  for (std::int64_t z = std::max<std::int64_t>(at.z - 1, 0); z <= at.z + 1 && z < dims.z; ++z) {
    for (std::int64_t y = std::max<std::int64_t>(at.y - 1, 0); y <= at.y + 1 && y < dims.y; ++y) {
      for (std::int64_t x = std::max<std::int64_t>(at.x - 1, 0); x <= at.x + 1 && x < dims.x; ++x) {
        if (MayHaveInside(spans->Get(layout_.IdOf({x, y, z})))) {
          return Need::kSamples;
        }
      }
    }
  }
  return Need::kNothing;
}

// own_cell: that of the crossing. Smooth solids look there alone, at the point of it that is nearest:
// of a cell beside, the block may not have all samples that place its vertices.
std::optional<CapPainter::Filling> CapPainter::FillingAt(const volume::BlockSamples& samples,
                                                         const math::Index3& own_cell,
                                                         const math::Vec3d& position) const {
  const math::Index3 cell = volume::CellAt(layout_, position);
  const math::IndexBox stored = layout_.StoredSamplesOf(samples.block_id);
  const std::array<double, 8> corners = volume::SamplesOfCell(samples, stored, cell);
  for (const Solid& solid : solids_) {
    const bool is_inside =
        solid.rule.smooths
            ? extract::IsInsideSmoothCell(samples, stored, own_cell, position, solid.rule)
            : extract::IsInsideCell(corners, cell, position, solid.rule);
    if (is_inside) {
      return Filling{&solid,
                     sample_color_ == nullptr ? 0 : volume::ValueInCell(corners, cell, position)};
    }
  }
  return std::nullopt;
}

// Looks at the four rays around that of a point which is outside. Their cells are those of the
// point or next to it, so that the block has them, with its ghost layer.
std::optional<CapPainter::Filling> CapPainter::FillingBeside(const volume::BlockSamples& samples,
                                                             double x, double y,
                                                             const view::ClipCrossing& crossing,
                                                             bool is_entry) const {
  for (int corner = 0; corner < 4; ++corner) {
    const view::ClipCrossings beside =
        crossings_.At(x + (corner % 2 == 0 ? -margin_px_ : margin_px_),
                      y + (corner / 2 == 0 ? -margin_px_ : margin_px_));
    const std::optional<view::ClipCrossing>& other = is_entry ? beside.entry : beside.exit;
    if (!other.has_value()) {
      continue;
    }
    const math::Vec3d offset = other->position - crossing.position;
    if (std::max({std::abs(offset.x), std::abs(offset.y), std::abs(offset.z)}) > 1) {
      continue;
    }
    if (const std::optional<Filling> filling =
            FillingAt(samples, volume::CellAt(layout_, crossing.position), other->position)) {
      return filling;
    }
  }
  return std::nullopt;
}

bool CapPainter::ShowsField(std::size_t surface_index) const {
  return sample_color_ == nullptr && scales_[surface_index].has_value() &&
         std::any_of(solids_.begin(), solids_.end(), [&](const Solid& solid) {
           return solid.shows_field && solid.surface_index == surface_index;
         });
}

// At the point itself, of whose cell the block has all that gradients need.
double CapPainter::ShownValueAt(const Solid& solid, const volume::BlockSamples& samples,
                                std::span<const volume::BlockSamples> fields,
                                const math::Vec3d& position) const {
  if (!solid.shows_field) {
    const math::Vec3d gradient = volume::GradientAt(view_.geometry(), layout_, samples, position);
    return static_cast<double>(static_cast<float>(math::Length(gradient)));
  }
  const volume::BlockSamples& field = fields[solid.surface_index];
  const math::Index3 cell = volume::CellAt(layout_, position);
  return volume::ValueInCell(
      volume::SamplesOfCell(field, layout_.StoredSamplesOf(field.block_id), cell), cell, position);
}

CapFragment CapPainter::FragmentOf(int x, int y, volume::BlockId id,
                                   const view::ClipCrossing& crossing,
                                   const Filling& filling) const {
  std::uint32_t surface = filling.solid->surface_index;
  CapFragment fragment{.x = x, .y = y, .color = normal_codes_[crossing.half_space]};
  if (sample_color_ != nullptr) {
    fragment.color = sample_color_(filling.value);
    surface += sends_normals_ ? surface_count_ : 0;
  } else if (const std::optional<MapScale>& scale = scales_[surface]; scale.has_value()) {
    fragment.color = CodeOf(fragment.color, scale->MapLevelOf(filling.value));
  } else if (!sends_normals_) {
    const math::Vec3d ray =
        crossings_.DirectionAt(x + view_.region().x + 0.5, y + view_.region().y + 0.5);
    const double cosine =
        std::abs(math::Dot(normals_[crossing.half_space], ray)) / std::sqrt(math::Dot(ray, ray));
    fragment.color = filling.solid->shade_table[static_cast<std::size_t>(
        std::lround(std::min(cosine, 1.0) * kShadeSteps))];
  }
  fragment.key = image::FragmentKey(crossing.depth, order_.OwnerOf(surface, id));
  return fragment;
}

void CapPainter::Paint(volume::BlockId id, const volume::ScalarSpan& span,
                       const volume::BlockSamples* samples,
                       std::span<const volume::BlockSamples> fields,
                       absl::FunctionRef<bool(int, int, float)> is_hidden,
                       absl::FunctionRef<void(const CapFragment&)> visit) const {
  const Solid* const all_inside = samples == nullptr ? SolidOfSpan(span) : nullptr;
  ISOSCOPE_CHECK(samples != nullptr || all_inside != nullptr);
  const math::IndexBox cells = layout_.CellsOf(id);
  const auto is_here = [&](const math::Vec3d& position) {
    const math::Index3 cell = volume::CellAt(layout_, position);
    return cell.x >= cells.begin.x && cell.x < cells.end.x && cell.y >= cells.begin.y &&
           cell.y < cells.end.y && cell.z >= cells.begin.z && cell.z < cells.end.z;
  };
  const view::PixelRect rect = view_.FootprintOf(layout_, id).rect;
  for (int y = rect.begin_y; y < rect.end_y; ++y) {
    for (int x = rect.begin_x; x < rect.end_x; ++x) {
      const double center_x = x + view_.region().x + 0.5;
      const double center_y = y + view_.region().y + 0.5;
      const view::ClipCrossings crossings = crossings_.At(center_x, center_y);
      for (const bool is_entry : {true, false}) {
        const std::optional<view::ClipCrossing>& crossing =
            is_entry ? crossings.entry : crossings.exit;
        if (!crossing.has_value() || !is_here(crossing->position) ||
            is_hidden(x, y, crossing->depth)) {
          continue;
        }
        std::optional<Filling> filling;
        if (samples == nullptr) {
          filling = Filling{.solid = all_inside};
        } else {
          filling =
              FillingAt(*samples, volume::CellAt(layout_, crossing->position), crossing->position);
          if (!filling.has_value()) {
            filling = FillingBeside(*samples, center_x, center_y, *crossing, is_entry);
          }
        }
        if (filling.has_value()) {
          const Solid& solid = *filling->solid;
          if (scales_[solid.surface_index].has_value() &&
              (!solid.shows_field || sample_color_ == nullptr)) {
            filling->value = ShownValueAt(solid, *samples, fields, crossing->position);
          }
          visit(FragmentOf(x, y, id, *crossing, *filling));
        }
      }
    }
  }
}

}  // namespace isoscope::render
