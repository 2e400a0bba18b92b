// The OpenGL back end: a context without a window system (egl_context.h) on a thread of its own,
// which draws for all frames in turn.

#ifndef ISOSCOPE_CORE_RENDER_EGL_RENDERER_H_
#define ISOSCOPE_CORE_RENDER_EGL_RENDERER_H_

#include <cstddef>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/render/gl_thread.h"
#include "core/render/renderer.h"

namespace isoscope::render {

class GlMeshDrawer;

struct EglRendererOptions {
  // An index of ListEglDevices. -1: the first device that works.
  int egl_device = -1;
  // A pass draws its collected meshes once they have this size. A larger batch costs memory (each
  // open pass can hold about two), a smaller one costs more read-backs of the picture.
  std::size_t batch_bytes = std::size_t{256} << 20;
  // Bounds images that no pass uses.
  std::size_t max_unused_bytes = std::size_t{256} << 20;
};

// Thread-safe. Passes must not outlive it.
class EglRenderer : public Renderer {
 public:
  // Returns the errors of EglContext::Make, or INTERNAL if the driver refuses the shaders.
  static absl::StatusOr<std::unique_ptr<EglRenderer>> Make(const EglRendererOptions& options);
  ~EglRenderer() override;

  EglRenderer(const EglRenderer&) = delete;
  EglRenderer& operator=(const EglRenderer&) = delete;

  absl::StatusOr<std::unique_ptr<RenderPass>> BeginPass(const view::View& view,
                                                        const volume::BlockLayout& layout,
                                                        const frame::FrameSpec& spec) override;
  // Also draws a triangle, so that the driver compiles its programs for pictures of this size.
  void Prepare(const view::Viewport& viewport, int pass_count, int image_count) override;
  [[nodiscard]] frame::PictureRevision picture_revision() const override;
  [[nodiscard]] std::string description() const override { return thread_->description(); }
  // Returns true if a GPU draws.
  [[nodiscard]] bool is_hardware() const { return thread_->is_hardware(); }

 private:
  EglRenderer() = default;

  std::size_t batch_bytes_ = 0;
  std::size_t max_unused_bytes_ = 0;
  std::shared_ptr<image::FrameImagePool> images_;
  std::unique_ptr<GlThread> thread_;
  std::unique_ptr<GlMeshDrawer> drawer_;  // used, and freed, on thread_
};

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_EGL_RENDERER_H_
