// The life of a pass:
//
// 1. Add, on any thread, keeps its meshes until they are shaded (mesh_register.h), which gives each
//    a range of primitive ids. Then Add rasterises mesh by mesh into the thread's buffer of 4096
//    fragments, and merges a full buffer into the plane of nearest fragments (fragment_plane.h).
// 2. Finish goes through the touched tiles, takes the fragments of their pixels, shades at most 512
//    at a time (fragment_shader.h), and writes key and colour into the image. Then it shades the
//    ties that still have the depth of their pixel, and the first in the order stays. Most are
//    hidden by then. No fragment is left, so that the buffers can serve the next pass.
//
// Early shading bounds memory. When the kept meshes exceed their limit, the pass is full. The
// adding threads stop, and Shade shades every pixel that has a fragment and drops the meshes. A
// shaded pixel keeps its depth and has the primitive id kShaded; its key and colour are in the
// image. A nearer fragment replaces it as any other, and a tie with it is settled the next time. So
// the picture does not change.
//
// Locks, while meshes are added: lock tiles row by row, or the register's mutex. Shading holds
// none: a thread that waits for a parallel loop may take any other task of its arena, also one that
// wants the lock. The contract keeps Add and Shade apart, and adding_ detects callers that break
// it.

#include "core/render/cpu_renderer.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/types/span.h"
#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/render/pass_resources.h"

namespace isoscope::render {
namespace {

class CpuPass final : public RenderPass {
 public:
  CpuPass(const view::View& view, const volume::BlockLayout& layout, const frame::FrameSpec& spec,
          const CpuRendererOptions& options, std::shared_ptr<PassResources> resources)
      : view_(view),
        layout_(layout),
        order_{.block_count = static_cast<std::uint32_t>(layout.block_count()),
               .ties = frame::TieRuleOf(frame::BackEnd::kCpu)},
        options_(options),
        clipper_(spec.clip, view.geometry()),
        clip_weights_(spec.caps.has_value() ? ClipWeights::kNearPixel : ClipWeights::kAtPixel),
        resources_(std::move(resources)),
        shader_(view, spec, order_, resources_.get()),
        image_(resources_->TakeImage(view.image_size().width_px, view.image_size().height_px)),
        buffers_(resources_->TakeBuffers(image_.width, image_.height)),
        plane_(buffers_->plane),
        meshes_(buffers_->meshes) {}

  CpuPass(const CpuPass&) = delete;
  CpuPass& operator=(const CpuPass&) = delete;

  ~CpuPass() override {
    if (!is_clean_) {
      plane_.Clear();
      meshes_.Clear();
    }
    resources_->GiveBack(std::move(buffers_));
  }

  using RenderPass::Add;
  absl::Status Add(std::span<const MeshToDraw> meshes) override {
    for (const MeshToDraw& item : meshes) {
      if (std::int64_t{item.mesh->block_id} >= layout_.block_count()) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "block %d: the layout has %d blocks", item.mesh->block_id, layout_.block_count()));
      }
    }
    const AddInWork in_work(&adding_);
    try {
      PassResources::Scratch& scratch = resources_->LocalScratch();
      scratch.meshes.clear();
      scratch.block_ids.clear();
      scratch.first_primitive_ids.clear();
      for (const MeshToDraw& item : meshes) {
        scratch.meshes.push_back(shader_.Prepare(item));
        scratch.block_ids.push_back(item.mesh->block_id);
      }
      scratch.footprints.resize(meshes.size());
      view_.FootprintsOf(layout_, scratch.block_ids, absl::MakeSpan(scratch.footprints));
      meshes_.Keep(scratch.meshes, &scratch.first_primitive_ids);
      for (std::size_t i = 0; i < meshes.size(); ++i) {
        Draw(meshes[i], scratch.footprints[i], scratch.first_primitive_ids[i], &scratch.rasterizer);
      }
    } catch (const std::bad_alloc&) {
      return NoMemoryFor(view_.image_size());
    }
    return absl::OkStatus();
  }

  [[nodiscard]] bool is_full() const override {
    return meshes_.kept_bytes() + plane_.tie_bytes() > options_.max_kept_bytes ||
           meshes_.primitive_count() > options_.max_kept_primitives;
  }

  absl::Status Shade(const base::Cancellation& cancellation) override {
    return ShadeInArena(/*is_last=*/false, cancellation);
  }

  absl::StatusOr<image::FrameImage> Finish(const base::Cancellation& cancellation) override {
    ISOSCOPE_RETURN_IF_ERROR(ShadeInArena(/*is_last=*/true, cancellation));
    is_clean_ = true;
    return std::move(image_);
  }

 private:
  // Counts an Add for as long as it runs.
  class AddInWork {
   public:
    explicit AddInWork(std::atomic<int>* count) : count_(*count) {
      count_.fetch_add(1, std::memory_order_relaxed);
    }
    ~AddInWork() { count_.fetch_sub(1, std::memory_order_relaxed); }
    AddInWork(const AddInWork&) = delete;
    AddInWork& operator=(const AddInWork&) = delete;

   private:
    std::atomic<int>& count_;
  };

  // A lock tile, and its image tiles to shade, as bits. They become those that had fragments.
  struct TileToShade {
    std::size_t lock_tile = 0;
    std::uint32_t image_tiles = 0;
  };

  // Puts the fragments of a mesh, which is kept, into the plane.
  void Draw(const MeshToDraw& item, const view::Footprint& footprint,
            std::uint32_t first_primitive_id, CpuRasterizer* rasterizer) {
    if (item.mesh->triangles.empty() || footprint.rect.empty()) {
      return;
    }
    if (const auto cuts = CutsOf(clipper_, layout_, item.mesh->block_id); cuts.has_value()) {
      rasterizer->Rasterize(
          *item.mesh, view_, footprint, item.open, *cuts,
          [&](const FragmentBatch& batch) { plane_.Merge(batch, first_primitive_id); },
          clip_weights_);
    }
  }

  // ShadeKept in the arena, with its errors as a status.
  absl::Status ShadeInArena(bool is_last, const base::Cancellation& cancellation) {
    ISOSCOPE_CHECK_EQ(adding_.load(std::memory_order_relaxed), 0);
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    try {
      const auto shade = [&] { ShadeKept(is_last, cancellation); };
      if (options_.arena != nullptr) {
        base::RunIn(options_.arena.get(), shade);
      } else {
        shade();
      }
    } catch (const std::bad_alloc&) {
      return NoMemoryFor(view_.image_size());
    }
    return cancellation.Check();
  }

  // Shades every pixel whose triangle is kept, and drops the meshes. The last call of a pass also
  // takes the fragments out of the plane. If `cancellation` fires, it stops between lock tiles and
  // leaves the rest. REQUIRES: no call of Add is running.
  void ShadeKept(bool is_last, const base::Cancellation& cancellation) {
    std::vector<TileToShade> tiles;
    for (std::size_t i = 0; i < plane_.lock_tile_count(); ++i) {
      if (const std::uint32_t touched = plane_.TouchedOf(i); touched != 0) {
        tiles.push_back({.lock_tile = i, .image_tiles = touched});
      }
    }
    tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t i) {
      if (cancellation.is_cancelled()) {
        tiles[i].image_tiles = 0;
      } else {
        ShadeTile(&tiles[i], is_last);
      }
    });
    for (const TileToShade& tile : tiles) {
      plane_.ForEachImageTile(tile.lock_tile, tile.image_tiles, [&](const auto& drawn) {
        image_.touched.Insert(drawn.column, drawn.row);
      });
    }
    plane_.EndShading(is_last);
    meshes_.Clear();
  }

  // With many agents an image tile holds few pixels, so one list takes several of them.
  void ShadeTile(TileToShade* tile, bool is_last) {
    ShadeList& list = resources_->LocalScratch().list;
    list.Reset(view_.region());  // an earlier pass may have run out of memory in the middle
    std::uint32_t drawn = 0;
    plane_.ForEachImageTile(tile->lock_tile, tile->image_tiles, [&](const auto& image_tile) {
      if (list.batch.count + FragmentPlane::kTilePixels > ShadeBatch::kCapacity) {
        ShadePixels(&list);
      }
      const image::TileMask taken = plane_.TakeFragments(image_tile, is_last, image_, &list);
      if (taken != image::TileMask{}) {
        drawn |= image_tile.bit;
        image::UniteInto(taken, &image_.CoveredOf(image_tile.column, image_tile.row));
      }
    });
    tile->image_tiles = drawn;
    ShadePixels(&list);
    SettleTies(plane_.TiesOf(tile->lock_tile), &list);
    plane_.EndTile(tile->lock_tile, is_last);
  }

  // Shades the list, writes it into the image, and empties it.
  void ShadePixels(ShadeList* list) {
    if (list->batch.count == 0) {
      return;
    }
    meshes_.FindMeshes(list);
    shader_.Shade(list);
    for (std::size_t i = 0; i < list->batch.count; ++i) {
      image_.keys[list->pixels[i]] = list->KeyOf(i);
      image_.colors[list->pixels[i]] = list->colors[i];
    }
    list->batch.count = 0;
  }

  // Decides the ties of a lock tile whose pixels are shaded: of the fragments that have the depth
  // of their pixel, the first in the order stays. Most have been hidden since they came.
  void SettleTies(std::span<const FragmentPlane::Tie> ties, ShadeList* list) {
    const auto width = static_cast<std::uint32_t>(image_.width);
    for (std::size_t next = 0; next < ties.size();) {
      for (; next < ties.size() && list->batch.count < ShadeBatch::kCapacity; ++next) {
        const auto [fragment, pixel] = ties[next];
        if (image::HaveEqualDepth(image_.keys[pixel], fragment)) {
          list->Append(pixel, pixel % width, pixel / width,
                       static_cast<std::uint32_t>(fragment >> 32),
                       static_cast<std::uint32_t>(fragment));
        }
      }
      meshes_.FindMeshes(list);
      shader_.Shade(list);
      for (std::size_t i = 0; i < list->batch.count; ++i) {
        const std::uint32_t pixel = list->pixels[i];
        order_.KeepFirst(list->KeyOf(i), list->colors[i], &image_.keys[pixel],
                         &image_.colors[pixel]);
      }
      list->batch.count = 0;
    }
  }

  const view::View view_;
  const volume::BlockLayout layout_;
  const image::FragmentOrder order_;
  const CpuRendererOptions options_;
  const view::Clipper clipper_;
  const ClipWeights clip_weights_;
  const std::shared_ptr<PassResources> resources_;
  const FragmentShader shader_;
  // Holds keys and colours of the pixels that are shaded. Only shading writes it.
  image::FrameImage image_;
  std::unique_ptr<PassBuffers> buffers_;
  FragmentPlane& plane_;        // of the buffers
  MeshRegister& meshes_;        // of the buffers
  bool is_clean_ = false;       // the buffers are empty
  std::atomic<int> adding_{0};  // calls of Add under way
};

class CpuRenderer final : public Renderer {
 public:
  explicit CpuRenderer(const CpuRendererOptions& options)
      : options_(options), resources_(std::make_shared<PassResources>(options.max_unused_bytes)) {}

  absl::StatusOr<std::unique_ptr<RenderPass>> BeginPass(const view::View& view,
                                                        const volume::BlockLayout& layout,
                                                        const frame::FrameSpec& spec) override {
    try {
      return std::make_unique<CpuPass>(view, layout, spec, options_, resources_);
    } catch (const std::bad_alloc&) {
      return NoMemoryFor(view.image_size());
    }
  }

  void Prepare(const view::Viewport& viewport, int pass_count, int image_count) override {
    resources_->ShadeTableOf({});
    const auto prepare = [&] {
      tbb::parallel_for(0, std::max(pass_count, image_count), [&](int i) {
        try {
          if (i < image_count) {
            resources_->PrepareImage(viewport.width_px, viewport.height_px);
          }
          if (i < pass_count) {
            resources_->PrepareBuffers(viewport.width_px, viewport.height_px);
          }
        } catch (const std::bad_alloc&) {
          // BeginPass reports it.
        }
      });
    };
    if (options_.arena != nullptr) {
      base::RunIn(options_.arena.get(), prepare);
    } else {
      prepare();
    }
  }

  [[nodiscard]] frame::PictureRevision picture_revision() const override {
    return {.back_end = frame::BackEnd::kCpu, .driver = ""};
  }

  [[nodiscard]] std::string description() const override {
    return absl::StrCat("cpu: software rasterizer, ", RasterInstructionSet());
  }

 private:
  const CpuRendererOptions options_;
  const std::shared_ptr<PassResources> resources_;
};

}  // namespace

std::unique_ptr<Renderer> MakeCpuRenderer(const CpuRendererOptions& options) {
  ISOSCOPE_CHECK_LE(options.max_kept_primitives, std::uint64_t{1} << 31);
  return std::make_unique<CpuRenderer>(options);
}

}  // namespace isoscope::render
