// Block meshes of analytic surfaces for the tests of both back ends, made by marching tetrahedra
// (so that they do not depend on core/extract), and single triangles.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_RENDER_TEST_SCENES_H_
#define ISOSCOPE_TESTS_UNIT_CORE_RENDER_TEST_SCENES_H_

#include <functional>
#include <memory>
#include <vector>

#include "core/math/vec.h"
#include "core/mesh/compact_mesh.h"
#include "core/view/view.h"
#include "core/volume/block_layout.h"

namespace isoscope::render {

using MeshPtr = std::shared_ptr<const mesh::CompactMesh>;

// A cube of samples with its layout, and a camera on it.
struct Scene {
  volume::BlockLayout layout;
  volume::GridGeometry geometry;
  std::vector<MeshPtr> meshes;  // one for each block that has triangles, ascending ids
};

// The surface field(p) = 0 in a cube of `samples` samples an axis; p in index space, the inside
// where it is >= 0.
Scene MakeIsosurface(int samples, int block_cells,
                     const std::function<double(const math::Vec3d&)>& field);
// A sphere around the centre, `radius` in samples, with bumps of this height.
Scene MakeBumpySphere(int samples, int block_cells, double radius, double bump);

// As vtkRenderer::ResetCamera, turned by these angles.
view::View MakeView(const Scene& scene, int width, int height, double azimuth_degrees = 0,
                    double elevation_degrees = 0);
// Orthographic along -z; the image shows `view_height` samples from bottom to top, centred on
// `target`.
view::View MakeOrthographicView(const Scene& scene, int width, int height, double view_height,
                                const math::Vec3d& target);

// One triangle with one normal, as the mesh of `block_id`.
MeshPtr MakeTriangle(volume::BlockId block_id, const math::Vec3f& a, const math::Vec3f& b,
                     const math::Vec3f& c, const math::Vec3f& normal);

}  // namespace isoscope::render

#endif  // ISOSCOPE_TESTS_UNIT_CORE_RENDER_TEST_SCENES_H_
