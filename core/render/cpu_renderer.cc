// The life of a pass:
//
// 1. Add, on any thread, keeps its meshes until they are shaded and gives each a range of primitive
//    ids. A range begins at a multiple of 64, so that a table finds the mesh of an id. Then Add
//    rasterises mesh by mesh into the thread's buffer of 4096 fragments.
// 2. Merge puts a full buffer into the picture. While a pass draws, a pixel is one word:
//    depth bits << 32 | primitive id. Of two words of different depth, the smaller one is the
//    nearer fragment. Merge holds the locks of the 64 x 64 pixel lock tiles that the buffer's
//    bounds meet, and notes in them which image tiles, and which rows of them, it may have touched.
// 3. Where two fragments have one depth, surface and then colour decide (docs/numerics.md, "Depth,
//    fragments and exact culling"). Merge keeps the later one in a list of its lock tile. Once the
//    tile's pixels are shaded, those of the list that still have the depth of their pixel are
//    shaded too, by the same kernel, and the first in the order stays. Most are hidden by then.
// 4. Finish goes through the touched rows, gathers the pixels that have a fragment, shades at most
//    512 at a time, and writes key and colour into the image. It leaves no fragment behind, so that
//    the buffers can serve the next pass.
//
// Early shading bounds memory. When the kept meshes exceed their limit, the pass is full. Whoever
// adds stops, and Shade shades every pixel that has a fragment and drops the meshes. A shaded pixel
// keeps its depth and has the primitive id kShaded; its key and colour are in the image. A nearer
// fragment replaces it as any other, and a tie with it is settled the next time. So the picture
// does not change.
//
// Locks, while meshes are added: lock tiles row by row, or meshes_mutex_. Shading holds none: a
// thread that waits for a parallel loop may take any other task of its arena, also one that wants
// the lock. The contract keeps Add and Shade apart, and adding_ notes who breaks it.

#include "core/render/cpu_renderer.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/types/span.h"
#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/image/normal_and_step.h"
#include "core/image/normal_code.h"
#include "core/image/tile_coverage.h"
#include "core/render/cpu_rasterizer.h"
#include "core/render/map_level.h"
#include "core/render/pass_resources.h"
#include "core/render/shade_kernel.h"
#include "core/render/surface_point.h"

namespace isoscope::render {
namespace {

void Prefetch(const mesh::TriangleVertices& triangles, std::size_t triangle) {
  if (triangles.small() != nullptr) {
    __builtin_prefetch(triangles.small() + 3 * triangle);
  } else {
    __builtin_prefetch(triangles.large() + 3 * triangle);
  }
}

// Of a lock tile.
constexpr std::size_t kMaxIdleTies = 256;

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
        sends_normals_(spec.sends_normals),
        sends_map_steps_(spec.sends_map_steps),
        map_scales_(MapScalesOf(spec)),
        rays_(MakePixelRays(view)),
        width_(view.image_size().width_px),
        height_(view.image_size().height_px),
        center_x_(static_cast<float>(view.region().x) + 0.5F),
        center_y_(static_cast<float>(view.region().y) + 0.5F),
        resources_(std::move(resources)),
        image_(resources_->TakeImage(width_, height_)),
        buffers_(resources_->TakeBuffers(width_, height_)) {
    for (const frame::Surface& surface : spec.surfaces) {
      shade_tables_.push_back(resources_->ShadeTableOf(surface.appearance));
    }
  }

  CpuPass(const CpuPass&) = delete;
  CpuPass& operator=(const CpuPass&) = delete;

  ~CpuPass() override {
    if (!is_clean_) {
      Clear();
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
      ISOSCOPE_CHECK_EQ(item.mesh->positions.size(), item.mesh->normals.size());
      ISOSCOPE_CHECK_LT(item.surface_index, shade_tables_.size());
      ISOSCOPE_CHECK(!map_scales_[item.surface_index].has_value() ||
                     item.mesh->gradient_magnitudes.size() == item.mesh->positions.size());
    }
    const AddInWork in_work(&adding_);
    try {
      PassResources::Scratch& scratch = resources_->LocalScratch();
      scratch.first_primitive_ids.clear();
      scratch.block_ids.clear();
      for (const MeshToDraw& item : meshes) {
        scratch.block_ids.push_back(item.mesh->block_id);
      }
      scratch.footprints.resize(meshes.size());
      view_.FootprintsOf(layout_, scratch.block_ids, absl::MakeSpan(scratch.footprints));
      {
        const base::MutexLock lock(&meshes_mutex_);
        for (const MeshToDraw& item : meshes) {
          scratch.first_primitive_ids.push_back(Keep(item));
        }
      }
      NoteFullness();
      for (std::size_t i = 0; i < meshes.size(); ++i) {
        DrawMesh(meshes[i], scratch.footprints[i], scratch.first_primitive_ids[i],
                 &scratch.rasterizer);
      }
    } catch (const std::bad_alloc&) {
      return NoMemoryFor(view_.image_size());
    }
    NoteFullness();  // ties have come
    return absl::OkStatus();
  }

  [[nodiscard]] bool is_full() const override { return is_full_.load(std::memory_order_relaxed); }

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

  // A lock tile with image tiles to shade, which are bits as in LockTile::touched.
  struct TileIndex {
    int lock_tile = 0;
    std::uint32_t touched = 0;  // in: the image tiles that may have fragments
    std::uint32_t drawn = 0;    // out: those that do
  };

  // Puts the fragments of a mesh into the picture. Keep has been called for it.
  void DrawMesh(const MeshToDraw& item, const view::Footprint& footprint,
                std::uint32_t first_primitive_id, CpuRasterizer* rasterizer) {
    const mesh::CompactMesh& mesh = *item.mesh;
    if (mesh.triangles.empty() || footprint.rect.empty()) {
      return;
    }
    const view::Clipper::Side side =
        clipper_.empty() ? view::Clipper::Side::kInside : clipper_.SideOf(layout_, mesh.block_id);
    if (side == view::Clipper::Side::kOutside) {
      return;
    }
    rasterizer->Rasterize(
        mesh, view_, footprint, item.open,
        side == view::Clipper::Side::kCut ? clipper_.half_spaces()
                                          : std::span<const view::HalfSpace>(),
        [&](const FragmentBatch& batch) { Merge(batch, first_primitive_id); }, clip_weights_);
  }

  void NoteFullness() {
    const std::size_t tie_bytes = tie_count_.load(std::memory_order_relaxed) * sizeof(TiedFragment);
    if (kept_bytes_.load(std::memory_order_relaxed) + tie_bytes > options_.max_kept_bytes ||
        kept_primitives_.load(std::memory_order_relaxed) > options_.max_kept_primitives) {
      is_full_.store(true, std::memory_order_relaxed);
    }
  }

  // Keeps a mesh until it is shaded. Returns the primitive id of its first triangle.
  std::uint32_t Keep(const MeshToDraw& item) ABSL_EXCLUSIVE_LOCKS_REQUIRED(meshes_mutex_) {
    const mesh::CompactMesh& mesh = *item.mesh;
    const auto units =
        static_cast<std::uint32_t>((mesh.triangles.size() + kPrimitiveUnit - 1) / kPrimitiveUnit);
    const std::uint64_t first = kept_primitives_.load(std::memory_order_relaxed);
    const auto first_primitive_id = static_cast<std::uint32_t>(first);
    // Several threads may find the pass not full and add meshes. There is room for all of them.
    const std::uint64_t end = first + std::uint64_t{units} * kPrimitiveUnit;
    ISOSCOPE_CHECK_LT(end, std::uint64_t{kShaded});
    kept_primitives_.store(end, std::memory_order_relaxed);
    kept_bytes_.fetch_add(mesh.size_bytes(), std::memory_order_relaxed);
    buffers_->mesh_of_unit.insert(buffers_->mesh_of_unit.end(), units,
                                  static_cast<std::uint32_t>(buffers_->meshes.size()));
    KeptMesh& kept = buffers_->meshes.emplace_back();
    kept.positions = mesh.positions.data();
    kept.normals = mesh.normals.data();
    kept.triangles = mesh.triangles;
    kept.first_primitive_id = first_primitive_id;
    kept.owner = order_.OwnerOf(item.surface_index, mesh.block_id);
    kept.shade_table = shade_tables_[item.surface_index]->data();
    if (const std::optional<MapScale>& scale = map_scales_[item.surface_index]; scale.has_value()) {
      kept.map_scale = &*scale;
    }
    kept.mesh = item.mesh;
    return first_primitive_id;
  }

  template <typename Fn>
  void ForEachLockTile(const view::PixelRect& rect, const Fn& fn) {
    const int end_row = (rect.end_y - 1) / kLockTilePx;
    const int end_column = (rect.end_x - 1) / kLockTilePx;
    for (int row = rect.begin_y / kLockTilePx; row <= end_row; ++row) {
      for (int column = rect.begin_x / kLockTilePx; column <= end_column; ++column) {
        fn(row, column,
           buffers_->lock_tiles[static_cast<std::size_t>(row) *
                                    static_cast<std::size_t>(buffers_->lock_columns) +
                                static_cast<std::size_t>(column)]);
      }
    }
  }

  // Marks the image tiles of a lock tile that `rect` meets.
  static void Touch(const view::PixelRect& rect, int row, int column, LockTile* tile) {
    constexpr int kTilePx = image::TileSet::kTilePx;
    const auto clip = [](int px, int lock_tile) {
      return std::clamp(px - lock_tile * kLockTilePx, 0, kLockTilePx);
    };
    const int begin_column = clip(rect.begin_x, column) / kTilePx;
    const int end_column = (clip(rect.end_x, column) + kTilePx - 1) / kTilePx;
    const int begin_y = clip(rect.begin_y, row);
    const int end_y = clip(rect.end_y, row);
    const std::uint32_t columns = (1U << end_column) - (1U << begin_column);
    for (int r = begin_y / kTilePx; r * kTilePx < end_y; ++r) {
      tile->touched |= columns << (r * kImageTileColumns);
      const int begin = std::max(begin_y - r * kTilePx, 0);
      const int end = std::min(end_y - r * kTilePx, kTilePx);
      const auto rows = static_cast<std::uint16_t>((1U << end) - (1U << begin));
      for (int c = begin_column; c < end_column; ++c) {
        tile->touched_rows[static_cast<std::size_t>(r) * kImageTileColumns +
                           static_cast<std::size_t>(c)] |= rows;
      }
    }
  }

  // Holds the lock tiles that a rectangle meets, and notes in them what it touches. Every thread
  // takes them row by row, so that no threads wait for each other in a circle.
  class LockedTiles {
   public:
    LockedTiles(CpuPass* pass, const view::PixelRect& rect) : pass_(*pass), rect_(rect) {
      pass_.ForEachLockTile(rect_, [&](int row, int column, LockTile& tile) {
        tile.Lock();
        Touch(rect_, row, column, &tile);
      });
    }
    ~LockedTiles() {
      pass_.ForEachLockTile(rect_, [](int, int, LockTile& tile) { tile.Unlock(); });
    }
    LockedTiles(const LockedTiles&) = delete;
    LockedTiles& operator=(const LockedTiles&) = delete;

   private:
    CpuPass& pass_;
    const view::PixelRect rect_;
  };

  // Puts fragments of one mesh into the picture.
  void Merge(const FragmentBatch& batch, std::uint32_t first_primitive_id) {
    const LockedTiles locked(this, batch.bounds);
    Fragment* fragments = buffers_->fragments.data();
    const auto width = static_cast<std::uint32_t>(width_);
    for (std::size_t i = 0; i < batch.pixels.size(); ++i) {
      const std::uint32_t pixel = batch.pixels[i];
      Fragment& old = fragments[std::size_t{(pixel >> 16) * width + (pixel & 0xffff)}];
      const Fragment fragment =
          Fragment{batch.depths[i]} << 32 | (first_primitive_id + batch.triangles[i]);
      if ((old ^ fragment) >> 32 != 0) [[likely]] {
        old = std::min(old, fragment);
      } else {
        AddTie(fragment, pixel);
      }
    }
  }

  // Keeps a fragment whose pixel has another one of its depth. The lock of its tile is held.
  void AddTie(Fragment fragment, std::uint32_t pixel) {
    const int x = static_cast<int>(pixel & 0xffff);
    const int y = static_cast<int>(pixel >> 16);
    const int lock_tile = y / kLockTilePx * buffers_->lock_columns + x / kLockTilePx;
    buffers_->lock_tiles[static_cast<std::size_t>(lock_tile)].ties.push_back(
        {fragment, static_cast<std::uint32_t>(image_.IndexOf(x, y))});
    tie_count_.fetch_add(1, std::memory_order_relaxed);
  }

  // Decides the ties of a lock tile whose pixels are shaded: of the fragments that have the depth
  // of their pixel, the first in the order stays. Most have been hidden since they came.
  void SettleTies(std::vector<TiedFragment>* ties, PassResources::Scratch* scratch) {
    for (std::size_t begin = 0; begin < ties->size();) {
      std::size_t end = begin;
      for (; end < ties->size() && scratch->batch.count < ShadeBatch::kCapacity; ++end) {
        const TiedFragment& tied = (*ties)[end];
        if (image::HaveEqualDepth(image_.keys[tied.pixel], tied.fragment)) {
          AddToBatch(tied.pixel, tied.fragment, scratch);
        }
      }
      ComputeColors(scratch);
      for (std::size_t i = 0; i < scratch->batch.count; ++i) {
        const std::uint64_t key =
            (scratch->fragments[i] >> 32 << 32) | std::uint64_t{scratch->meshes[i]->owner};
        const std::uint32_t pixel = scratch->pixels[i];
        if (order_.IsBefore(key, scratch->colors[i], image_.keys[pixel], image_.colors[pixel])) {
          image_.keys[pixel] = key;
          image_.colors[pixel] = scratch->colors[i];
        }
      }
      scratch->batch.count = 0;
      begin = end;
    }
    ties->clear();
    // Buffers that no pass uses must not hold what one frame with many ties needed.
    if (ties->capacity() > kMaxIdleTies) {
      ties->shrink_to_fit();
    }
  }

  // Adds a pixel and its fragment to the batch.
  void AddToBatch(std::uint32_t pixel_index, Fragment fragment,
                  PassResources::Scratch* scratch) const {
    const auto width = static_cast<std::uint32_t>(width_);
    const std::uint32_t x = pixel_index % width;
    const std::uint32_t y = pixel_index / width;
    ShadeBatch& batch = scratch->batch;
    scratch->pixels[batch.count] = pixel_index;
    scratch->fragments[batch.count] = fragment;
    batch.x[batch.count] = static_cast<float>(x) + center_x_;
    batch.y[batch.count] = static_cast<float>(y) + center_y_;
    ++batch.count;
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
  // takes the fragments out of the buffers. If `cancellation` fires, it stops between lock tiles
  // and leaves the rest. Nobody adds meanwhile.
  void ShadeKept(bool is_last, const base::Cancellation& cancellation) {
    std::vector<TileIndex> tiles;
    for (std::size_t i = 0; i < buffers_->lock_tiles.size(); ++i) {
      LockTile& tile = buffers_->lock_tiles[i];
      if (tile.touched != 0) {
        tiles.push_back({.lock_tile = static_cast<int>(i), .touched = tile.touched});
      }
    }
    tbb::parallel_for(std::size_t{0}, tiles.size(), [&](std::size_t i) {
      if (cancellation.is_cancelled()) {
        return;
      }
      PassResources::Scratch& scratch = resources_->LocalScratch();
      scratch.batch.count = 0;  // an earlier pass may have run out of memory in the middle
      LockTile& tile = buffers_->lock_tiles[static_cast<std::size_t>(tiles[i].lock_tile)];
      const int first_column = tiles[i].lock_tile % buffers_->lock_columns * kImageTileColumns;
      const int first_row = tiles[i].lock_tile / buffers_->lock_columns * kImageTileColumns;
      for (std::uint32_t rest = tiles[i].touched; rest != 0; rest &= rest - 1) {
        const int bit = std::countr_zero(rest);
        if (const std::uint32_t later = rest & (rest - 1); later != 0) {
          const int next = std::countr_zero(later);
          PrefetchFragments(first_column + next % kImageTileColumns,
                            first_row + next / kImageTileColumns,
                            tile.touched_rows[static_cast<std::size_t>(next)]);
        }
        if (GatherTile(first_column + bit % kImageTileColumns, first_row + bit / kImageTileColumns,
                       tile.touched_rows[static_cast<std::size_t>(bit)], is_last, &scratch)) {
          tiles[i].drawn |= 1U << bit;
        }
      }
      ShadePixels(&scratch);
      if (!tile.ties.empty()) {
        SettleTies(&tile.ties, &scratch);
      }
      if (is_last) {
        tile.touched = 0;
        tile.touched_rows = {};
      }
    });
    for (const TileIndex& tile : tiles) {
      const int first_column = tile.lock_tile % buffers_->lock_columns * kImageTileColumns;
      const int first_row = tile.lock_tile / buffers_->lock_columns * kImageTileColumns;
      for (std::uint32_t rest = tile.drawn; rest != 0; rest &= rest - 1) {
        const int bit = std::countr_zero(rest);
        image_.touched.Insert(first_column + bit % kImageTileColumns,
                              first_row + bit / kImageTileColumns);
      }
    }
    has_shaded_ = true;
    DropMeshes();
  }

  // Nobody adds meanwhile.
  void DropMeshes() {
    buffers_->meshes.clear();
    buffers_->mesh_of_unit.clear();
    kept_bytes_.store(0, std::memory_order_relaxed);
    kept_primitives_.store(0, std::memory_order_relaxed);
    tie_count_.store(0, std::memory_order_relaxed);
    is_full_.store(false, std::memory_order_relaxed);
  }

  // Prefetches the fragments of an image tile in the given rows of pixels. The rows are too far
  // apart for the processor to guess.
  void PrefetchFragments(int column, int row, std::uint16_t rows) const {
    constexpr int kTilePx = image::TileSet::kTilePx;
    constexpr std::size_t kLineFragments = 64 / sizeof(Fragment);
    for (std::uint32_t rest = rows; rest != 0; rest &= rest - 1) {
      const int y = row * kTilePx + std::countr_zero(rest);
      const Fragment* const fragments =
          buffers_->fragments.data() + image_.IndexOf(column * kTilePx, y);
      for (std::size_t x = 0; x < kTilePx; x += kLineFragments) {
        __builtin_prefetch(fragments + x);
      }
    }
  }

  // Adds the pixels of an image tile that have a fragment to the batch. Returns false if there are
  // none. `touched` has a bit for each row of pixels to look at. With many agents a tile holds few
  // pixels, so one batch takes several tiles.
  bool GatherTile(int column, int row, std::uint16_t touched, bool is_last,
                  PassResources::Scratch* scratch) {
    constexpr int kTilePx = image::TileSet::kTilePx;
    constexpr std::size_t kTilePixels = std::size_t{kTilePx} * kTilePx;
    static_assert(kTilePixels <= ShadeBatch::kCapacity);
    if (scratch->batch.count + kTilePixels > ShadeBatch::kCapacity) {
      ShadePixels(scratch);
    }
    const int begin_x = column * kTilePx;
    const int begin_y = row * kTilePx;
    const int columns = std::min(kTilePx, width_ - begin_x);
    const int rows = std::min(kTilePx, height_ - begin_y);
    const std::size_t first = image_.IndexOf(begin_x, begin_y);
    // With the ignored bits set, a shaded pixel and a pixel without fragment look the same.
    const image::TileMask unshaded =
        image::CoverageOf(buffers_->fragments.data() + first, static_cast<std::size_t>(width_),
                          columns, touched, kNoFragment, ~Fragment{kShaded});
    ShadeBatch& batch = scratch->batch;
    std::size_t count = batch.count;
    for (int y = 0; y < rows; ++y) {
      const std::uint32_t of_row = unshaded[static_cast<std::size_t>(y)];
      const std::size_t begin = image_.IndexOf(begin_x, begin_y + y);
      Fragment* fragments = buffers_->fragments.data() + begin;
      if (of_row != 0) {
        // The image comes from a pool; its planes have left the processor's cache.
        for (int x = 0; x < columns; x += 8) {
          __builtin_prefetch(&image_.keys[begin + static_cast<std::size_t>(x)], 1);
        }
        __builtin_prefetch(&image_.colors[begin], 1);
      }
      for (std::uint32_t rest = of_row; rest != 0; rest &= rest - 1) {
        const auto x = static_cast<std::uint32_t>(std::countr_zero(rest));
        const Fragment fragment = fragments[x];
        scratch->pixels[count] = static_cast<std::uint32_t>(begin) + x;
        scratch->fragments[count] = fragment;
        batch.x[count] = static_cast<float>(begin_x) + static_cast<float>(x) + center_x_;
        batch.y[count] = static_cast<float>(begin_y + y) + center_y_;
        ++count;
        fragments[x] = is_last ? kNoFragment : fragment | kShaded;
      }
      if (is_last && has_shaded_) {
        std::fill_n(fragments, columns, kNoFragment);
      }
    }
    if (count == batch.count) {
      return false;
    }
    batch.count = count;
    image::UniteInto(unshaded, &image_.CoveredOf(column, row));
    return true;
  }

  // Shades the batch, writes it into the image, and empties it.
  void ShadePixels(PassResources::Scratch* scratch) {
    ShadeBatch& batch = scratch->batch;
    if (batch.count == 0) {
      return;
    }
    ComputeColors(scratch);
    for (std::size_t i = 0; i < batch.count; ++i) {
      image_.keys[scratch->pixels[i]] =
          (scratch->fragments[i] >> 32 << 32) | std::uint64_t{scratch->meshes[i]->owner};
      image_.colors[scratch->pixels[i]] = scratch->colors[i];
    }
    batch.count = 0;
  }

  // Fills `colors` for the pixels and fragments of the batch.
  void ComputeColors(PassResources::Scratch* scratch) const {
    ShadeBatch& batch = scratch->batch;
    // The meshes have left the processor's cache since they were drawn, so everything is prefetched
    // one loop before it is used.
    for (std::size_t i = 0; i < batch.count; ++i) {
      const std::uint32_t primitive_id = PrimitiveIdOf(scratch->fragments[i]);
      const KeptMesh& mesh = MeshOf(primitive_id);
      scratch->meshes[i] = &mesh;
      Prefetch(mesh.triangles, primitive_id - mesh.first_primitive_id);
    }
    for (std::size_t i = 0; i < batch.count; ++i) {
      const KeptMesh& mesh = *scratch->meshes[i];
      scratch->corners[i] =
          mesh.triangles[PrimitiveIdOf(scratch->fragments[i]) - mesh.first_primitive_id];
      for (const std::uint32_t vertex : scratch->corners[i]) {
        __builtin_prefetch(&mesh.positions[vertex]);
        __builtin_prefetch(&mesh.normals[vertex]);
      }
    }
    for (std::size_t i = 0; i < batch.count; ++i) {
      const KeptMesh& mesh = *scratch->meshes[i];
      const std::array<std::uint32_t, 3>& corners = scratch->corners[i];
      for (std::size_t c = 0; c < 3; ++c) {
        const math::Vec3f& position = mesh.positions[corners[c]];
        const mesh::CompactNormal& normal = mesh.normals[corners[c]];
        batch.position[3 * c][i] = position.x;
        batch.position[3 * c + 1][i] = position.y;
        batch.position[3 * c + 2][i] = position.z;
        batch.normal[3 * c][i] = normal.x;
        batch.normal[3 * c + 1][i] = normal.y;
        batch.normal[3 * c + 2][i] = normal.z;
      }
    }
    batch.keeps_normals = sends_normals_;
    batch.keeps_levels = sends_map_steps_;
    if (sends_map_steps_) {
      FillLevels(scratch);
    }
    ComputeShadeSteps(rays_, &batch);
    if (sends_normals_) {
      ComputeNormals(scratch);
      if (sends_map_steps_) {
        AddMapSteps(scratch);
      }
      return;
    }
    for (std::size_t k = 0; k < batch.inexact_count; ++k) {
      const std::uint32_t i = batch.inexact[k];
      const KeptMesh& mesh = *scratch->meshes[i];
      batch.step[i] = ShadeStepAt(
          view_, *mesh.mesh, PrimitiveIdOf(scratch->fragments[i]) - mesh.first_primitive_id,
          static_cast<int>(scratch->pixels[i] % static_cast<std::uint32_t>(width_)),
          static_cast<int>(scratch->pixels[i] / static_cast<std::uint32_t>(width_)));
    }
    for (std::size_t i = 0; i < batch.count; ++i) {
      scratch->colors[i] = scratch->meshes[i]->shade_table[batch.step[i]];
    }
  }

  // Fills the levels of the batch; 0 where a fragment carries no step.
  static void FillLevels(PassResources::Scratch* scratch) {
    for (std::size_t i = 0; i < scratch->batch.count; ++i) {
      const KeptMesh& mesh = *scratch->meshes[i];
      for (std::size_t c = 0; c < 3; ++c) {
        scratch->batch.level[c][i] =
            mesh.map_scale == nullptr
                ? 0.0F
                : mesh.map_scale->LevelOf(mesh.mesh->gradient_magnitudes[scratch->corners[i][c]]);
      }
    }
  }

  // Replaces codes of normals by those with a step, where fragments carry one.
  void AddMapSteps(PassResources::Scratch* scratch) const {
    ShadeBatch& batch = scratch->batch;
    for (std::size_t k = 0; k < batch.inexact_count; ++k) {
      const std::uint32_t i = batch.inexact[k];
      batch.mixed_level[i] =
          MixLevels(PointOf(scratch, i), {batch.level[0][i], batch.level[1][i], batch.level[2][i]});
    }
    for (std::size_t i = 0; i < batch.count; ++i) {
      if (scratch->meshes[i]->map_scale != nullptr) {
        scratch->colors[i] =
            image::EncodeNormalAndStep(scratch->colors[i], MapStepOf(batch.mixed_level[i]));
      }
    }
  }

  // The point of a fragment of the batch, in doubles.
  [[nodiscard]] SurfacePoint PointOf(PassResources::Scratch* scratch, std::size_t i) const {
    const KeptMesh& mesh = *scratch->meshes[i];
    const auto width = static_cast<std::uint32_t>(width_);
    return SurfacePointAt(
        view_, *mesh.mesh, PrimitiveIdOf(scratch->fragments[i]) - mesh.first_primitive_id,
        static_cast<int>(scratch->pixels[i] % width), static_cast<int>(scratch->pixels[i] / width));
  }

  // Fills `colors` with the codes of the normals that ComputeShadeSteps has mixed.
  void ComputeNormals(PassResources::Scratch* scratch) const {
    ShadeBatch& batch = scratch->batch;
    for (std::size_t i = 0; i < batch.count; ++i) {
      scratch->colors[i] = image::EncodeNormal({static_cast<double>(batch.mixed_normal[0][i]),
                                                static_cast<double>(batch.mixed_normal[1][i]),
                                                static_cast<double>(batch.mixed_normal[2][i])});
    }
    for (std::size_t k = 0; k < batch.inexact_count; ++k) {
      const std::uint32_t i = batch.inexact[k];
      const SurfacePoint point = PointOf(scratch, i);
      scratch->colors[i] = image::EncodeNormal({point.normal.x, point.normal.y, point.normal.z});
    }
  }

  [[nodiscard]] const KeptMesh& MeshOf(std::uint32_t primitive_id) const {
    return buffers_->meshes[buffers_->mesh_of_unit[primitive_id / kPrimitiveUnit]];
  }

  // Takes the fragments and meshes of an abandoned pass out of the buffers.
  void Clear() {
    for (int row = 0; row < buffers_->lock_rows; ++row) {
      for (int column = 0; column < buffers_->lock_columns; ++column) {
        LockTile& tile = buffers_->lock_tiles[static_cast<std::size_t>(row) *
                                                  static_cast<std::size_t>(buffers_->lock_columns) +
                                              static_cast<std::size_t>(column)];
        if (tile.touched == 0) {
          continue;
        }
        tile.ties.clear();
        tile.touched = 0;
        tile.touched_rows = {};
        const int begin_x = column * kLockTilePx;
        const int width = std::min(kLockTilePx, width_ - begin_x);
        const int end_y = std::min((row + 1) * kLockTilePx, height_);
        for (int y = row * kLockTilePx; y < end_y; ++y) {
          std::fill_n(
              buffers_->fragments.begin() + static_cast<std::ptrdiff_t>(y) * width_ + begin_x,
              width, kNoFragment);
        }
      }
    }
    DropMeshes();
  }

  const view::View view_;
  const volume::BlockLayout layout_;
  const image::FragmentOrder order_;
  const CpuRendererOptions options_;
  const view::Clipper clipper_;
  const ClipWeights clip_weights_;
  const bool sends_normals_;
  const bool sends_map_steps_;
  const std::vector<std::optional<MapScale>> map_scales_;  // by surface
  const PixelRays rays_;
  const int width_;
  const int height_;
  const float center_x_;  // of the picture's first pixel, in pixels of the whole
  const float center_y_;
  const std::shared_ptr<PassResources> resources_;
  std::vector<std::shared_ptr<const std::vector<image::Rgba8>>> shade_tables_;  // by surface
  // Holds keys and colours of the pixels whose primitive id is kShaded. Only shading writes it.
  image::FrameImage image_;
  // While meshes are added, lock tiles guard the fragments, and meshes_mutex_ the meshes.
  std::unique_ptr<PassBuffers> buffers_;
  base::Mutex meshes_mutex_;
  bool is_clean_ = false;
  bool has_shaded_ = false;     // only shading uses it
  std::atomic<int> adding_{0};  // calls of Add under way
  // Since the meshes were dropped. meshes_mutex_ orders the writers of the first two.
  std::atomic<std::uint64_t> kept_primitives_{0};
  std::atomic<std::size_t> kept_bytes_{0};
  std::atomic<std::size_t> tie_count_{0};
  std::atomic<bool> is_full_{false};
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
      options_.arena->execute(prepare);
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
