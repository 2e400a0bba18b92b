// Draws block meshes into a FrameImage. Two back ends keep the same contract: EGL (OpenGL) and CPU
// (docs/architecture.md, "Renderers").
//
// These guarantees make culling exact:
//
// * A pixel shows the fragment that comes first in the frame's image::FragmentOrder, whose tie rule
//   is that of the back end (frame::TieRuleOf). Even depth 1 wins over the background.
// * Depth and colour of a fragment do not depend on other meshes, on their order, or on how meshes
//   are spread over passes.
// * A fragment's depth is clamped to [Footprint::nearest_depth of its block, 1], and fragments
//   outside Footprint::rect are dropped. So rounding can't break a conclusion from the footprint.

#ifndef ISOSCOPE_CORE_RENDER_RENDERER_H_
#define ISOSCOPE_CORE_RENDER_RENDERER_H_

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

#include "core/base/cancellation.h"
#include "core/frame/frame_spec.h"
#include "core/frame/picture_revision.h"
#include "core/image/frame_image.h"
#include "core/image/pixel_mask.h"
#include "core/mesh/compact_mesh.h"
#include "core/view/view.h"
#include "core/volume/block_layout.h"

namespace isoscope::render {

struct MeshToDraw {
  // Not null. Nothing changes the mesh any more. Has one normal for each position.
  std::shared_ptr<const mesh::CompactMesh> mesh;
  // The surface of the frame that the mesh is part of.
  std::uint32_t surface_index = 0;
  // Drops fragments at other pixels. Null: all pixels are open. Outlives the pass.
  const image::PixelMask* open = nullptr;
};

// The error of a back end that has no memory for a picture: RESOURCE_EXHAUSTED.
inline absl::Status NoMemoryFor(const view::Viewport& viewport) {
  return absl::ResourceExhaustedError(absl::StrCat("no memory for a picture of ", viewport.width_px,
                                                   " x ", viewport.height_px, " pixels"));
}

// One picture while it is drawn. Destroying the pass before Finish abandons the picture.
class RenderPass {
 public:
  virtual ~RenderPass() = default;

  // Draws meshes, now or by Finish(), in any order. A block comes at most once for a surface, and
  // may be empty. Runs no parallel loop. May wait until another thread has drawn earlier meshes.
  // INVALID_ARGUMENT if the layout has no such block, RESOURCE_EXHAUSTED if memory runs out.
  // Returns an error of earlier drawing, unless Finish() does. Thread-safe.
  virtual absl::Status Add(std::span<const MeshToDraw> meshes) = 0;
  absl::Status Add(std::shared_ptr<const mesh::CompactMesh> mesh,
                   const image::PixelMask* open = nullptr) {
    const MeshToDraw one{.mesh = std::move(mesh), .open = open};
    return Add(std::span(&one, 1));
  }

  // True if more is kept than the back end's limit. The caller then ends the loops that add, calls
  // Shade, and continues. So memory exceeds the limit by at most one Add of each thread.
  // Thread-safe.
  [[nodiscard]] virtual bool is_full() const { return false; }

  // Shades the added meshes in parallel, and drops them. The picture does not depend on when it is
  // called. REQUIRES: no Add is under way, and the caller holds no lock and is in no parallel loop.
  // Returns the error of `cancellation` if it fires, RESOURCE_EXHAUSTED if memory runs out.
  virtual absl::Status Shade(const base::Cancellation& /*cancellation*/) {
    return absl::OkStatus();
  }

  // Completes the picture. Call it once, as Shade. Returns the error of
  // `cancellation` if it fires, without waiting for draws under way. RESOURCE_EXHAUSTED if the
  // picture is too large for the back end, or memory runs out.
  virtual absl::StatusOr<image::FrameImage> Finish(const base::Cancellation& cancellation) = 0;
};

// Thread-safe; one for a process. Passes of several frames may be open at a time.
class Renderer {
 public:
  virtual ~Renderer() = default;

  // Begins a pass of the frame `spec`, with the spec's view and the layout of the volume's blocks.
  // Copies its arguments. RESOURCE_EXHAUSTED if there is no memory for the picture.
  // INVALID_ARGUMENT if the back end can't draw it: EGL a viewport above view::kMaxViewportPx, or
  // normals.
  // REQUIRES: frame::CheckOwners is OK for the surfaces and the layout.
  virtual absl::StatusOr<std::unique_ptr<RenderPass>> BeginPass(const view::View& view,
                                                                const volume::BlockLayout& layout,
                                                                const frame::FrameSpec& spec) = 0;

  // Allocates the memory of `pass_count` passes of this size and of `image_count` pictures, those
  // of the passes included. Touches its pages for the first frames. Stops at the limit for unused
  // memory. May do nothing.
  virtual void Prepare(const view::Viewport& /*viewport*/, int /*pass_count*/,
                       int /*image_count*/) {}

  // Returns the code and driver that decide its pixels.
  [[nodiscard]] virtual frame::PictureRevision picture_revision() const = 0;

  // For people: "cpu: software rasterizer, AVX2", "egl: llvmpipe (LLVM 15.0.6, 256 bits),
  // OpenGL 4.5 (Core Profile) Mesa 22.3.6".
  [[nodiscard]] virtual std::string description() const = 0;
};

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_RENDERER_H_
