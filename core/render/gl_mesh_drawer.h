// Draws block meshes with OpenGL into a FrameImage. It keeps the guarantees of renderer.h in three
// ways:
//
// * A fragment's colour and depth come from its triangle and the view alone: one program, vertex
//   positions relative to one point of the volume, no blending, dithering or multisampling.
// * The fragment shader writes the interpolated depth, clamped from below to the block's nearest
//   depth. It drops fragments outside the block's rectangle or mask.
// * The depth test is GL_LEQUAL, so of equal depths the last drawn stays. Meshes are drawn from the
//   highest owner (surface, then block) to the lowest, and triangles from the last to the first. So
//   image::TieRule::kOwner decides, and even depth 1 wins over the background.

#ifndef ISOSCOPE_CORE_RENDER_GL_MESH_DRAWER_H_
#define ISOSCOPE_CORE_RENDER_GL_MESH_DRAWER_H_

#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include <epoxy/gl.h>

#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/render/gl_mesh_chunk.h"
#include "core/render/gl_objects.h"
#include "core/view/clip_region.h"
#include "core/view/view.h"

namespace isoscope::render {

// GL thread only.
class GlMeshDrawer {
 public:
  // Makes a drawer whose pictures come from `images`.
  static absl::StatusOr<std::unique_ptr<GlMeshDrawer>> Make(
      std::shared_ptr<image::FrameImagePool> images);
  ~GlMeshDrawer();
  GlMeshDrawer(const GlMeshDrawer&) = delete;
  GlMeshDrawer& operator=(const GlMeshDrawer&) = delete;

  // Draws `items`, in any order, on an empty picture.
  //
  // surfaces: the surfaces of the frame; items have an index into them.
  // clipper: drops the fragments outside.
  // sends_normals: the picture has image::EncodeNormal in place of colours.
  // poll: called between draws; its error ends the work and is returned.
  // RESOURCE_EXHAUSTED if the picture or a mask is too large for the driver, or memory runs out.
  absl::StatusOr<image::FrameImage> Draw(const view::View& view,
                                         std::span<const frame::Surface> surfaces,
                                         const view::Clipper& clipper,
                                         const image::FragmentOrder& order, bool sends_normals,
                                         std::vector<DrawItem> items,
                                         absl::FunctionRef<absl::Status()> poll);

 private:
  GlMeshDrawer() = default;

  absl::Status UseProgram(const view::Clipper& clipper, bool sends_normals, const view::View& view);
  void SetView(const view::View& view, bool sends_normals);
  void SetRays(const view::View& view);
  void SetAppearance(const frame::Appearance& appearance);
  // Uploads and draws items of one surface that fit the buffers together, in their order.
  absl::Status DrawChunk(std::span<const DrawItem> items, const ChunkSize& size,
                         const image::FragmentOrder& order);

  std::shared_ptr<image::FrameImagePool> images_;
  // By whether they clip, then by whether they send normals; made when they are needed.
  std::array<std::array<std::unique_ptr<GlProgram>, 2>, 2> programs_;
  const GlProgram* program_ = nullptr;          // in use
  std::unique_ptr<GlFramebuffer> framebuffer_;  // of the last size
  std::unique_ptr<GlStreamBuffer> positions_;
  std::unique_ptr<GlStreamBuffer> normals_;
  std::unique_ptr<GlStreamBuffer> slots_;
  std::unique_ptr<GlStreamBuffer> indices_;
  std::unique_ptr<GlStreamBuffer> blocks_;  // behind blocks_texture_
  std::unique_ptr<GlStreamBuffer> masks_;   // behind masks_texture_
  GLuint blocks_texture_ = 0;
  GLuint masks_texture_ = 0;
  GLuint vertex_array_ = 0;
  std::size_t max_texels_ = 0;  // of a texture buffer
  GlReadback readback_;
};

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_GL_MESH_DRAWER_H_
