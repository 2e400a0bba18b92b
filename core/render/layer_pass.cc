// A mesh is rasterised into the thread's buffer of 4096 fragments (cpu_rasterizer.h). A full buffer
// is shaded 512 fragments at a time by the kernel of the opaque pass, and inserted into the layers
// with the lock of each row of tiles that it meets. Nothing is kept of a mesh.
//
// Most fragments of a translucent surface show, so shading them before it is known which do costs
// little.

#include "core/render/layer_pass.h"

#include <algorithm>
#include <array>
#include <new>
#include <utility>

#include "absl/base/thread_annotations.h"

#include "core/base/check.h"
#include "core/base/no_memory.h"
#include "core/image/normal_and_step.h"
#include "core/image/normal_code.h"
#include "core/render/surface_point.h"

namespace isoscope::render {
namespace {

constexpr int kTilePx = image::TileSet::kTilePx;

int XOf(std::uint32_t pixel) { return static_cast<int>(pixel & 0xffff); }
int YOf(std::uint32_t pixel) { return static_cast<int>(pixel >> 16); }

// Holds the locks of some rows of tiles. Threads take them row by row, so that none wait for each
// other in a circle.
class LockedRows {
 public:
  LockedRows(composite::RowLocks* locks, int first_row, int last_row) ABSL_NO_THREAD_SAFETY_ANALYSIS
      : locks_(*locks),
        first_row_(first_row),
        last_row_(last_row) {
    for (int row = first_row_; row <= last_row_; ++row) {
      locks_.OfTileRow(row).Lock();
    }
  }
  ~LockedRows() ABSL_NO_THREAD_SAFETY_ANALYSIS {
    for (int row = first_row_; row <= last_row_; ++row) {
      locks_.OfTileRow(row).Unlock();
    }
  }
  LockedRows(const LockedRows&) = delete;
  LockedRows& operator=(const LockedRows&) = delete;

 private:
  composite::RowLocks& locks_;
  const int first_row_;
  const int last_row_;
};

}  // namespace

LayerPass::LayerPass(const view::View& view, const volume::BlockLayout& layout,
                     const frame::FrameSpec& spec, LayerRenderer* renderer)
    : view_(view),
      layout_(layout),
      clipper_(spec.clip, view.geometry()),
      sends_normals_(spec.sends_normals),
      map_scales_(MapScalesOf(spec)),
      rays_(MakePixelRays(view)),
      resources_(renderer->resources_),
      layers_(view.image_size().width_px, view.image_size().height_px, spec.max_layers + 1,
              {.block_count = static_cast<std::uint32_t>(layout.block_count())},
              renderer->images_.get()),
      row_locks_(view.image_size().height_px) {
  for (const frame::Surface& surface : spec.surfaces) {
    shade_tables_.push_back(resources_.ShadeTableOf(surface.appearance));
  }
}

absl::Status LayerPass::Add(std::span<const MeshToDraw> meshes) {
  try {
    PassResources::Scratch& scratch = resources_.LocalScratch();
    for (const MeshToDraw& item : meshes) {
      ISOSCOPE_CHECK_LT(std::int64_t{item.mesh->block_id}, layout_.block_count());
      ISOSCOPE_CHECK_LT(item.surface_index, shade_tables_.size());
      ISOSCOPE_CHECK(!map_scales_[item.surface_index].has_value() ||
                     item.mesh->gradient_magnitudes.size() == item.mesh->positions.size());
      Draw(item, &scratch);
    }
  } catch (const std::bad_alloc&) {
    return base::OrNoMemory("layers", [&] { return NoMemoryFor(view_.image_size()); });
  }
  return absl::OkStatus();
}

void LayerPass::Draw(const MeshToDraw& item, PassResources::Scratch* scratch) {
  const view::Footprint footprint = view_.FootprintOf(layout_, item.mesh->block_id);
  if (item.mesh->triangles.empty() || footprint.rect.empty()) {
    return;
  }
  const view::Clipper::Side side = clipper_.empty() ? view::Clipper::Side::kInside
                                                    : clipper_.SideOf(layout_, item.mesh->block_id);
  if (side == view::Clipper::Side::kOutside) {
    return;
  }
  scratch->rasterizer.Rasterize(*item.mesh, view_, footprint, item.open,
                                side == view::Clipper::Side::kCut
                                    ? clipper_.half_spaces()
                                    : std::span<const view::HalfSpace>(),
                                [&](const FragmentBatch& batch) { Insert(batch, item, scratch); });
}

// The locks are given back even if there is no memory for another level.
void LayerPass::Insert(const FragmentBatch& batch, const MeshToDraw& item,
                       PassResources::Scratch* scratch) {
  const std::uint64_t owner = layers_.order().OwnerOf(item.surface_index, item.mesh->block_id);
  for (std::size_t begin = 0; begin < batch.pixels.size(); begin += ShadeBatch::kCapacity) {
    const std::size_t count = std::min(ShadeBatch::kCapacity, batch.pixels.size() - begin);
    const auto pixels = batch.pixels.subspan(begin, count);
    Shade(item, batch.triangles.subspan(begin, count), pixels, scratch);
    const LockedRows locked(&row_locks_, batch.bounds.begin_y / kTilePx,
                            (batch.bounds.end_y - 1) / kTilePx);
    for (std::size_t i = 0; i < count; ++i) {
      layers_.Insert(XOf(pixels[i]), YOf(pixels[i]),
                     std::uint64_t{batch.depths[begin + i]} << 32 | owner, scratch->colors[i]);
    }
  }
}

// Fills scratch->colors with the colours of the fragments, or the codes of their normals.
void LayerPass::Shade(const MeshToDraw& item, std::span<const std::uint32_t> triangles,
                      std::span<const std::uint32_t> pixels,
                      PassResources::Scratch* scratch) const {
  const mesh::CompactMesh& mesh = *item.mesh;
  const std::optional<MapScale>& scale = map_scales_[item.surface_index];
  ShadeBatch& batch = scratch->batch;
  batch.count = pixels.size();
  for (std::size_t i = 0; i < batch.count; ++i) {
    batch.x[i] = static_cast<float>(XOf(pixels[i]) + view_.region().x) + 0.5F;
    batch.y[i] = static_cast<float>(YOf(pixels[i]) + view_.region().y) + 0.5F;
    const std::array<std::uint32_t, 3> corners = mesh.triangles[triangles[i]];
    for (std::size_t c = 0; c < 3; ++c) {
      const math::Vec3f& position = mesh.positions[corners[c]];
      const mesh::CompactNormal& normal = mesh.normals[corners[c]];
      batch.position[3 * c][i] = position.x;
      batch.position[3 * c + 1][i] = position.y;
      batch.position[3 * c + 2][i] = position.z;
      batch.normal[3 * c][i] = normal.x;
      batch.normal[3 * c + 1][i] = normal.y;
      batch.normal[3 * c + 2][i] = normal.z;
      if (scale.has_value()) {
        batch.level[c][i] = scale->LevelOf(mesh.gradient_magnitudes[corners[c]]);
      }
    }
  }
  batch.keeps_normals = sends_normals_;
  batch.keeps_levels = scale.has_value();
  ComputeShadeSteps(rays_, &batch);
  for (std::size_t i = 0; i < batch.count && sends_normals_; ++i) {
    scratch->colors[i] = image::EncodeNormal({static_cast<double>(batch.mixed_normal[0][i]),
                                              static_cast<double>(batch.mixed_normal[1][i]),
                                              static_cast<double>(batch.mixed_normal[2][i])});
  }
  for (std::size_t k = 0; k < batch.inexact_count; ++k) {
    const std::uint32_t i = batch.inexact[k];
    const int x = XOf(pixels[i]);
    const int y = YOf(pixels[i]);
    if (sends_normals_) {
      const math::Vec3d normal = SurfacePointAt(view_, mesh, triangles[i], x, y).normal;
      scratch->colors[i] = image::EncodeNormal({normal.x, normal.y, normal.z});
    } else {
      batch.step[i] = ShadeStepAt(view_, mesh, triangles[i], x, y);
    }
  }
  if (scale.has_value()) {
    AddMapSteps(mesh, triangles, pixels, scratch);
  }
  const std::vector<image::Rgba8>& shade_table = *shade_tables_[item.surface_index];
  for (std::size_t i = 0; i < batch.count && !sends_normals_; ++i) {
    scratch->colors[i] = shade_table[batch.step[i]];
  }
  batch.count = 0;
}

// Replaces the codes of normals by those with a step.
void LayerPass::AddMapSteps(const mesh::CompactMesh& mesh, std::span<const std::uint32_t> triangles,
                            std::span<const std::uint32_t> pixels,
                            PassResources::Scratch* scratch) const {
  ShadeBatch& batch = scratch->batch;
  for (std::size_t k = 0; k < batch.inexact_count; ++k) {
    const std::uint32_t i = batch.inexact[k];
    const SurfacePoint point =
        SurfacePointAt(view_, mesh, triangles[i], XOf(pixels[i]), YOf(pixels[i]));
    batch.mixed_level[i] =
        MixLevels(point, {batch.level[0][i], batch.level[1][i], batch.level[2][i]});
  }
  for (std::size_t i = 0; i < batch.count; ++i) {
    scratch->colors[i] =
        image::EncodeNormalAndStep(scratch->colors[i], MapStepOf(batch.mixed_level[i]));
  }
}

}  // namespace isoscope::render
