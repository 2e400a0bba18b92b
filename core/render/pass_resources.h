// The memory of the passes of the CPU renderer, and the word that stands for a pixel.

#ifndef ISOSCOPE_CORE_RENDER_PASS_RESOURCES_H_
#define ISOSCOPE_CORE_RENDER_PASS_RESOURCES_H_

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include <oneapi/tbb/enumerable_thread_specific.h>

#include "core/base/large_pages.h"
#include "core/base/mutex.h"
#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/math/vec.h"
#include "core/mesh/compact_mesh.h"
#include "core/render/cpu_rasterizer.h"
#include "core/render/map_level.h"
#include "core/render/shade_kernel.h"
#include "core/view/view.h"
#include "core/volume/block_layout.h"

namespace isoscope::render {

// Each lock guards the pixels of a square of this side.
inline constexpr int kLockTilePx = 64;
// Columns of image tiles in a lock tile; it has as many rows.
inline constexpr int kImageTileColumns = kLockTilePx / image::TileSet::kTilePx;

// A pixel while a pass draws: depth bits << 32 | primitive id. The nearer of two fragments is the
// smaller word. Primitive ids count the triangles of all kept meshes, in the order in which the
// meshes came.
using Fragment = std::uint64_t;
inline constexpr Fragment kNoFragment = std::numeric_limits<Fragment>::max();
// The primitive id of a fragment whose owner and colour are in the image already.
inline constexpr std::uint32_t kShaded = std::numeric_limits<std::uint32_t>::max();
// The primitive ids of a mesh begin at a multiple of this, so that a table finds the mesh of an id.
inline constexpr std::uint32_t kPrimitiveUnit = 64;

constexpr std::uint32_t PrimitiveIdOf(Fragment fragment) {
  return static_cast<std::uint32_t>(fragment);
}

// Returns the colour of each shade step, 0 to kShadeSteps, under the head light.
std::vector<image::Rgba8> MakeShadeTable(const frame::Appearance& appearance);

// A fragment whose colour must be compared with that of its pixel, an index of the image's planes.
struct TiedFragment {
  Fragment fragment = kNoFragment;
  std::uint32_t pixel = 0;
};

// A square of pixels that one thread at a time draws into. A thread holds it for well under a
// microsecond, so waiting is spinning. A waiter yields in case the holder has lost its core.
class alignas(64) LockTile {
 public:
  void Lock() {
    for (int tries = 0; is_locked_.test_and_set(std::memory_order_acquire); ++tries) {
      if (tries >= 64) {
        std::this_thread::yield();
      }
    }
  }
  void Unlock() { is_locked_.clear(std::memory_order_release); }

  // Fragments that came to a pixel with the depth of the one that was there. The lock guards it.
  std::vector<TiedFragment> ties;
  // Bit column + row * kImageTileColumns is set for each image tile that may have fragments.
  // touched_rows has a bit for each of its rows of pixels that may. The lock guards both.
  std::uint32_t touched = 0;
  std::array<std::uint16_t, std::size_t{kImageTileColumns} * kImageTileColumns> touched_rows{};

 private:
  std::atomic_flag is_locked_;
};

// A mesh whose pixels are not shaded yet.
struct KeptMesh {
  const math::Vec3f* positions = nullptr;
  const mesh::CompactNormal* normals = nullptr;
  mesh::TriangleVertices triangles;
  std::uint32_t first_primitive_id = 0;
  std::uint32_t owner = 0;                    // image::FragmentOrder::OwnerOf
  const image::Rgba8* shade_table = nullptr;  // of its surface
  const MapScale* map_scale = nullptr;        // of its surface; null: fragments carry no step
  std::shared_ptr<const mesh::CompactMesh> mesh;
};

// The large vectors of a pass. Between passes there is no fragment, no mesh, and nothing touched.
struct PassBuffers {
  PassBuffers(int buffer_width, int buffer_height)
      : width(buffer_width),
        height(buffer_height),
        lock_columns((width + kLockTilePx - 1) / kLockTilePx),
        lock_rows((height + kLockTilePx - 1) / kLockTilePx),
        fragments(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), kNoFragment),
        lock_tiles(static_cast<std::size_t>(lock_columns) * static_cast<std::size_t>(lock_rows)) {}

  [[nodiscard]] std::size_t size_bytes() const {
    return fragments.capacity() * sizeof(Fragment) + meshes.capacity() * sizeof(KeptMesh) +
           mesh_of_unit.capacity() * sizeof(std::uint32_t);
  }

  const int width;
  const int height;
  const int lock_columns;
  const int lock_rows;
  base::LargePageVector<Fragment> fragments;
  std::vector<LockTile> lock_tiles;
  std::vector<KeptMesh> meshes;
  std::vector<std::uint32_t>
      mesh_of_unit;  // by primitive id / kPrimitiveUnit, an index of `meshes`
};

// The memory that the passes of a CPU renderer share. A pass that ends gives its memory to the next
// one, so that a picture touches no fresh pages. Thread-safe.
class PassResources {
 public:
  // Scratch space of a thread.
  struct Scratch {
    CpuRasterizer rasterizer;
    // One element for each mesh of an Add.
    std::vector<std::uint32_t> first_primitive_ids;
    std::vector<volume::BlockId> block_ids;
    std::vector<view::Footprint> footprints;
    ShadeBatch batch;
    std::array<std::uint32_t, ShadeBatch::kCapacity> pixels{};
    std::array<Fragment, ShadeBatch::kCapacity> fragments{};
    std::array<const KeptMesh*, ShadeBatch::kCapacity> meshes{};
    std::array<std::array<std::uint32_t, 3>, ShadeBatch::kCapacity> corners{};
    std::array<image::Rgba8, ShadeBatch::kCapacity> colors{};
  };

  // An image takes 12 bytes a pixel, its buffers 8.
  explicit PassResources(std::size_t max_unused_bytes)
      : max_unused_image_bytes_(max_unused_bytes / 5 * 3),
        max_unused_buffer_bytes_(max_unused_bytes / 5 * 2) {}

  // Returns buffers for a picture of this size, in their state between passes.
  std::unique_ptr<PassBuffers> TakeBuffers(int width, int height);
  // Keeps the buffers, and forgets those unused longest where that is too much. REQUIRES: their
  // state is that between passes.
  void GiveBack(std::unique_ptr<PassBuffers> buffers);
  image::FrameImage TakeImage(int width, int height) { return images_->Take(width, height); }
  // Adds an unused image, or unused buffers, and touches their pages. Does nothing if they are too
  // large to keep.
  void PrepareImage(int width, int height) { images_->Prepare(width, height); }
  void PrepareBuffers(int width, int height);

  // Returns the colour of each shade step. Keeps the tables of the last few appearances.
  std::shared_ptr<const std::vector<image::Rgba8>> ShadeTableOf(
      const frame::Appearance& appearance);
  // Returns the scratch space of the calling thread.
  Scratch& LocalScratch() { return scratch_.local(); }

 private:
  const std::size_t max_unused_image_bytes_;
  const std::size_t max_unused_buffer_bytes_;
  const std::shared_ptr<image::FrameImagePool> images_ =
      image::FrameImagePool::Make(max_unused_image_bytes_);
  tbb::enumerable_thread_specific<Scratch> scratch_;
  base::Mutex mutex_;
  std::vector<std::unique_ptr<PassBuffers>> unused_ ABSL_GUARDED_BY(mutex_);
  std::size_t unused_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  struct ShadeTable {
    frame::Appearance appearance;
    std::shared_ptr<const std::vector<image::Rgba8>> colors;
  };
  std::vector<ShadeTable> shade_tables_ ABSL_GUARDED_BY(mutex_);  // the last made is the last
};

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_PASS_RESOURCES_H_
