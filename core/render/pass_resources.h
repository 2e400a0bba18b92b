// The memory of the passes of the CPU renderer, and its tables of shades.

#ifndef ISOSCOPE_CORE_RENDER_PASS_RESOURCES_H_
#define ISOSCOPE_CORE_RENDER_PASS_RESOURCES_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "absl/base/thread_annotations.h"
#include <oneapi/tbb/enumerable_thread_specific.h>

#include "core/base/mutex.h"
#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/render/cpu_rasterizer.h"
#include "core/render/fragment_plane.h"
#include "core/render/fragment_shader.h"
#include "core/render/mesh_register.h"
#include "core/view/view.h"
#include "core/volume/block_layout.h"

namespace isoscope::render {

// Returns the colour of each shade step, 0 to kShadeSteps, under the head light.
std::vector<image::Rgba8> MakeShadeTable(const frame::Appearance& appearance);

// The large memory of a pass. Between passes it has no fragment and no mesh, and no tile is
// touched.
struct PassBuffers {
  PassBuffers(int width, int height) : plane(width, height) {}
  [[nodiscard]] std::size_t size_bytes() const { return plane.size_bytes() + meshes.size_bytes(); }

  FragmentPlane plane;
  MeshRegister meshes;
};

// The memory that the passes of a CPU renderer share. A pass that ends gives its memory to the next
// one, so that a picture touches no fresh pages. Thread-safe.
class PassResources {
 public:
  // Scratch space of a thread.
  struct Scratch {
    CpuRasterizer rasterizer;
    // One element for each mesh of an Add.
    std::vector<ShadedMesh> meshes;
    std::vector<std::uint32_t> first_primitive_ids;
    std::vector<volume::BlockId> block_ids;
    std::vector<view::Footprint> footprints;
    ShadeList list;
  };

  // An image takes 12 bytes a pixel, its buffers 8.
  explicit PassResources(std::size_t max_unused_bytes)
      : max_unused_image_bytes_(max_unused_bytes / 5 * 3),
        max_unused_buffer_bytes_(max_unused_bytes / 5 * 2) {}

  // Returns buffers for a picture of this size, in their state between passes.
  std::unique_ptr<PassBuffers> TakeBuffers(int width, int height);
  // Keeps the buffers, and frees the least recently used ones beyond the limit. REQUIRES: their
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
  std::vector<ShadeTable> shade_tables_ ABSL_GUARDED_BY(mutex_);  // the newest is the last
};

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_PASS_RESOURCES_H_
