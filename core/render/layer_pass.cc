// A mesh is rasterised into the thread's buffer of 4096 fragments (cpu_rasterizer.h). The kernel of
// the opaque pass shades a full buffer, 512 fragments at a time. They are inserted into the layers
// under the lock of each row of tiles that they meet. Nothing is kept of a mesh.
//
// Most fragments of a translucent surface show, so shading them before it is known which do costs
// little.

#include "core/render/layer_pass.h"

#include <algorithm>
#include <new>

#include "absl/base/thread_annotations.h"

#include "core/base/check.h"
#include "core/base/no_memory.h"

namespace isoscope::render {
namespace {

constexpr int kTilePx = image::TileSet::kTilePx;

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
      resources_(renderer->resources_),
      layers_(view.image_size().width_px, view.image_size().height_px, spec.max_layers + 1,
              {.block_count = static_cast<std::uint32_t>(layout.block_count())},
              renderer->images_.get()),
      shader_(view, spec, layers_.order(), &resources_),
      row_locks_(view.image_size().height_px) {}

absl::Status LayerPass::Add(std::span<const MeshToDraw> meshes) {
  try {
    PassResources::Scratch& scratch = resources_.LocalScratch();
    for (const MeshToDraw& item : meshes) {
      ISOSCOPE_CHECK_LT(std::int64_t{item.mesh->block_id}, layout_.block_count());
      Draw(item, &scratch);
    }
  } catch (const std::bad_alloc&) {
    return base::OrNoMemory("layers", [&] { return NoMemoryFor(view_.image_size()); });
  }
  return absl::OkStatus();
}

void LayerPass::Draw(const MeshToDraw& item, PassResources::Scratch* scratch) {
  const ShadedMesh mesh = shader_.Prepare(item);
  const view::Footprint footprint = view_.FootprintOf(layout_, item.mesh->block_id);
  if (mesh.triangles.empty() || footprint.rect.empty()) {
    return;
  }
  if (const auto cuts = CutsOf(clipper_, layout_, item.mesh->block_id); cuts.has_value()) {
    scratch->rasterizer.Rasterize(
        *item.mesh, view_, footprint, item.open, *cuts,
        [&](const FragmentBatch& batch) { Insert(batch, mesh, &scratch->list); });
  }
}

// The locks are given back even if there is no memory for another layer image.
void LayerPass::Insert(const FragmentBatch& batch, const ShadedMesh& mesh, ShadeList* list) {
  for (std::size_t begin = 0; begin < batch.pixels.size(); begin += ShadeBatch::kCapacity) {
    const std::size_t count = std::min(ShadeBatch::kCapacity, batch.pixels.size() - begin);
    list->Reset(view_.region());
    for (std::size_t i = begin; i < begin + count; ++i) {
      const std::uint32_t pixel = batch.pixels[i];
      list->Append(pixel, pixel & 0xffff, pixel >> 16, batch.depths[i], batch.triangles[i]);
    }
    std::fill_n(list->meshes.begin(), count, &mesh);
    shader_.Shade(list);
    const LockedRows locked(&row_locks_, batch.bounds.begin_y / kTilePx,
                            (batch.bounds.end_y - 1) / kTilePx);
    for (std::size_t i = 0; i < count; ++i) {
      layers_.Insert(static_cast<int>(list->pixels[i] & 0xffff),
                     static_cast<int>(list->pixels[i] >> 16), list->KeyOf(i), list->colors[i]);
    }
  }
}

}  // namespace isoscope::render
