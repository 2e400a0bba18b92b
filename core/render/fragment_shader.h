// The colours of fragments whose triangles are known: one computation for the opaque pass of the
// CPU and for translucent layers.

#ifndef ISOSCOPE_CORE_RENDER_FRAGMENT_SHADER_H_
#define ISOSCOPE_CORE_RENDER_FRAGMENT_SHADER_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "core/frame/frame_spec.h"
#include "core/image/fragment.h"
#include "core/math/vec.h"
#include "core/mesh/compact_mesh.h"
#include "core/render/map_level.h"
#include "core/render/renderer.h"
#include "core/render/shade_kernel.h"
#include "core/render/surface_point.h"
#include "core/view/view.h"

namespace isoscope::render {

class PassResources;

// A mesh, with the data that decides the colours of its fragments.
struct ShadedMesh {
  const math::Vec3f* positions = nullptr;
  const mesh::CompactNormal* normals = nullptr;
  mesh::TriangleVertices triangles;
  std::uint32_t first_primitive_id = 0;       // of its triangles
  std::uint32_t owner = 0;                    // image::FragmentOrder::OwnerOf
  const image::Rgba8* shade_table = nullptr;  // of its surface
  const MapScale* map_scale = nullptr;        // of its surface; null: fragments carry no step
  std::shared_ptr<const mesh::CompactMesh> mesh;
};

// At most ShadeBatch::kCapacity fragments to shade; batch.count tells how many there are.
struct ShadeList {
  // Empties the list. Positions count from the first pixel of `region`.
  void Reset(const view::Region& region) {
    batch.count = 0;
    center_x = static_cast<float>(region.x) + 0.5F;
    center_y = static_cast<float>(region.y) + 0.5F;
  }
  // Appends a fragment at (x, y) of the picture. `pixel`: any id of the position.
  void Append(std::uint32_t pixel, std::uint32_t x, std::uint32_t y, std::uint32_t depth_bits,
              std::uint32_t primitive_id) {
    pixels[batch.count] = pixel;
    depths[batch.count] = depth_bits;
    primitive_ids[batch.count] = primitive_id;
    batch.x[batch.count] = static_cast<float>(x) + center_x;
    batch.y[batch.count] = static_cast<float>(y) + center_y;
    ++batch.count;
  }
  // The key of fragment i. REQUIRES: meshes[i] is set.
  [[nodiscard]] std::uint64_t KeyOf(std::size_t i) const {
    return std::uint64_t{depths[i]} << 32 | meshes[i]->owner;
  }

  ShadeBatch batch;
  float center_x = 0;  // of the picture's first pixel, in pixels of the whole
  float center_y = 0;
  std::array<std::uint32_t, ShadeBatch::kCapacity> pixels{};
  std::array<std::uint32_t, ShadeBatch::kCapacity> depths{};  // IEEE bits
  std::array<std::uint32_t, ShadeBatch::kCapacity> primitive_ids{};
  std::array<const ShadedMesh*, ShadeBatch::kCapacity> meshes{};
  std::array<std::array<std::uint32_t, 3>, ShadeBatch::kCapacity> corners{};  // scratch
  std::array<image::Rgba8, ShadeBatch::kCapacity> colors{};                   // the result
};

// Shades the fragments of one picture. Immutable; thread-safe.
class FragmentShader {
 public:
  // Copies its arguments, except the tables of the resources, which it shares.
  FragmentShader(const view::View& view, const frame::FrameSpec& spec,
                 const image::FragmentOrder& order, PassResources* resources);

  // REQUIRES: the mesh is of a surface of the frame, and has normals, and values if the surface
  // shows them. The result points into the shader.
  [[nodiscard]] ShadedMesh Prepare(const MeshToDraw& item) const;

  // Fills the colours of the list, or the codes of normals. A colour depends on triangle, view and
  // pixel alone. REQUIRES: each fragment has its mesh.
  void Shade(ShadeList* list) const;

 private:
  void FillMapLevels(ShadeList* list) const;
  void EncodeNormals(ShadeList* list) const;
  void LookUpColors(ShadeList* list) const;
  [[nodiscard]] SurfacePoint PointOf(const ShadeList& list, std::size_t i) const;

  const view::View view_;
  const image::FragmentOrder order_;
  const bool sends_normals_;
  const bool sends_map_steps_;
  const std::vector<std::optional<MapScale>> map_scales_;  // by surface
  const ShadeRays rays_;
  std::vector<std::shared_ptr<const std::vector<image::Rgba8>>> shade_tables_;  // by surface
};

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_FRAGMENT_SHADER_H_
