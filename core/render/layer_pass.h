// Draws translucent meshes, for every back end: the CPU rasterises and shades all fragments and
// keeps the first few of each pixel. Colours then do not depend on an OpenGL driver, and a software
// OpenGL is no faster (docs/lab/experiments.md).

#ifndef ISOSCOPE_CORE_RENDER_LAYER_PASS_H_
#define ISOSCOPE_CORE_RENDER_LAYER_PASS_H_

#include <cstddef>
#include <memory>
#include <span>
#include <utility>

#include "absl/status/status.h"

#include "core/composite/pixel_codec.h"
#include "core/frame/frame_spec.h"
#include "core/image/layer_stack.h"
#include "core/render/fragment_shader.h"
#include "core/render/pass_resources.h"
#include "core/render/renderer.h"
#include "core/view/clip_region.h"
#include "core/view/view.h"
#include "core/volume/block_layout.h"

namespace isoscope::render {

// The resources that the layer passes of a process share. Thread-safe; outlives its passes' layers.
class LayerRenderer {
 public:
  // Bounds images that no pass uses.
  explicit LayerRenderer(std::size_t max_unused_bytes)
      : images_(image::FrameImagePool::Make(max_unused_bytes)), resources_(0) {}

 private:
  friend class LayerPass;
  const std::shared_ptr<image::FrameImagePool> images_;
  PassResources resources_;  // scratch and shade tables
};

// The layers of one picture while it is drawn. RenderPass defines fragments, and which of them are
// dropped.
class LayerPass {
 public:
  // Copies its arguments, except the renderer. Keeps one fragment more than spec.max_layers of each
  // pixel, so that the coordinator sees which pixels have more. REQUIRES: frame::CheckOwners is OK
  // for the surfaces and the layout.
  LayerPass(const view::View& view, const volume::BlockLayout& layout, const frame::FrameSpec& spec,
            LayerRenderer* renderer);

  // Draws meshes of translucent surfaces, at once. RESOURCE_EXHAUSTED if memory runs out: then some
  // fragments may be missing, and the pass must be abandoned. Thread-safe.
  absl::Status Add(std::span<const MeshToDraw> meshes);

  // Returns the layers. Call it once, after every Add has returned.
  image::LayerStack Finish() { return std::move(layers_); }

 private:
  void Draw(const MeshToDraw& item, PassResources::Scratch* scratch);
  void Insert(const FragmentBatch& batch, const ShadedMesh& mesh, ShadeList* list);

  const view::View view_;
  const volume::BlockLayout layout_;
  const view::Clipper clipper_;
  PassResources& resources_;
  image::LayerStack layers_;
  const FragmentShader shader_;
  composite::RowLocks row_locks_;  // of the layers
};

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_LAYER_PASS_H_
