// Marching tetrahedra, a block at a time:
//
// 1. Each cell is split into the six tetrahedra of Kuhn, whose faces match those of its neighbours.
// 2. A tetrahedron whose corners have different signs gives one or two triangles.
// 3. A vertex is computed from the lower to the higher end of its edge, so that all blocks get the
//    same bits.

#include "tests/unit/core/render/test_scenes.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <unordered_map>
#include <utility>

#include "core/base/check.h"
#include "core/view/camera.h"

namespace isoscope::render {
namespace {

using math::Index3;
using math::Vec3d;
using math::Vec3f;

// The paths from corner 0 to corner 7 of a cell along its edges: Kuhn's six tetrahedra. Corner
// bits: 1 = +x, 2 = +y, 4 = +z.
constexpr std::array<std::array<int, 4>, 6> kTetrahedra{
    {{0, 1, 3, 7}, {0, 1, 5, 7}, {0, 2, 3, 7}, {0, 2, 6, 7}, {0, 4, 5, 7}, {0, 4, 6, 7}}};

class Marcher {
 public:
  Marcher(int samples, const std::function<double(const Vec3d&)>& field) : samples_(samples) {
    const auto n = static_cast<std::size_t>(samples);
    values_.reserve(n * n * n);
    for (int z = 0; z < samples; ++z) {
      for (int y = 0; y < samples; ++y) {
        for (int x = 0; x < samples; ++x) {
          values_.push_back(static_cast<float>(
              field({static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)})));
        }
      }
    }
  }

  MeshPtr MeshOf(const volume::BlockLayout& layout, volume::BlockId id) {
    mesh_ = std::make_shared<mesh::BlockMesh>();
    mesh_->block_id = id;
    vertex_of_edge_.clear();
    const math::IndexBox cells = layout.CellsOf(id);
    for (std::int64_t z = cells.begin.z; z < cells.end.z; ++z) {
      for (std::int64_t y = cells.begin.y; y < cells.end.y; ++y) {
        for (std::int64_t x = cells.begin.x; x < cells.end.x; ++x) {
          MarchCell({x, y, z});
        }
      }
    }
    return mesh::Compact(*mesh_);
  }

 private:
  float ValueAt(const Index3& p) const {
    return values_[static_cast<std::size_t>(p.x + samples_ * (p.y + samples_ * p.z))];
  }
  std::int64_t Linear(const Index3& p) const { return p.x + samples_ * (p.y + samples_ * p.z); }

  Vec3d GradientAt(const Index3& p) const {
    Vec3d gradient;
    for (int axis = 0; axis < 3; ++axis) {
      Index3 low = p;
      Index3 high = p;
      low[axis] = std::max<std::int64_t>(p[axis] - 1, 0);
      high[axis] = std::min<std::int64_t>(p[axis] + 1, samples_ - 1);
      gradient[axis] = static_cast<double>(ValueAt(high) - ValueAt(low)) /
                       static_cast<double>(high[axis] - low[axis]);
    }
    return gradient;
  }

  void MarchCell(const Index3& cell) {
    std::array<Index3, 8> corners;
    int inside = 0;
    for (int i = 0; i < 8; ++i) {
      corners[static_cast<std::size_t>(i)] = {cell.x + (i & 1), cell.y + (i >> 1 & 1),
                                              cell.z + (i >> 2)};
      inside += ValueAt(corners[static_cast<std::size_t>(i)]) >= 0 ? 1 : 0;
    }
    if (inside == 0 || inside == 8) {
      return;
    }
    for (const auto& tetrahedron : kTetrahedra) {
      std::vector<Index3> in;
      std::vector<Index3> out;
      for (const int corner : tetrahedron) {
        const Index3& p = corners[static_cast<std::size_t>(corner)];
        (ValueAt(p) >= 0 ? in : out).push_back(p);
      }
      if (in.size() == 1) {
        AddTriangle(Vertex(in[0], out[0]), Vertex(in[0], out[1]), Vertex(in[0], out[2]));
      } else if (in.size() == 3) {
        AddTriangle(Vertex(in[0], out[0]), Vertex(in[1], out[0]), Vertex(in[2], out[0]));
      } else if (in.size() == 2) {
        AddTriangle(Vertex(in[0], out[0]), Vertex(in[0], out[1]), Vertex(in[1], out[1]));
        AddTriangle(Vertex(in[0], out[0]), Vertex(in[1], out[1]), Vertex(in[1], out[0]));
      }
    }
  }

  std::uint32_t Vertex(Index3 a, Index3 b) {
    if (Linear(b) < Linear(a)) {
      std::swap(a, b);  // the same arithmetic in every block
    }
    const std::int64_t key = Linear(a) * samples_ * samples_ * samples_ + Linear(b);
    const auto [entry, is_new] =
        vertex_of_edge_.try_emplace(key, static_cast<std::uint32_t>(mesh_->positions.size()));
    if (is_new) {
      const double va = static_cast<double>(ValueAt(a));
      const double vb = static_cast<double>(ValueAt(b));
      const double t = va / (va - vb);
      Vec3f position;
      Vec3d normal;
      const Vec3d ga = GradientAt(a);
      const Vec3d gb = GradientAt(b);
      for (int axis = 0; axis < 3; ++axis) {
        position[axis] = static_cast<float>(static_cast<double>(a[axis]) +
                                            t * static_cast<double>(b[axis] - a[axis]));
        normal[axis] = -(ga[axis] + t * (gb[axis] - ga[axis]));
      }
      normal = math::Normalized(normal);
      mesh_->positions.push_back(position);
      mesh_->normals.push_back({static_cast<float>(normal.x), static_cast<float>(normal.y),
                                static_cast<float>(normal.z)});
    }
    return entry->second;
  }

  void AddTriangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    const std::vector<Vec3f>& p = mesh_->positions;
    const Vec3f face = math::Cross(p[b] - p[a], p[c] - p[a]);
    const bool outward = math::Dot(face, mesh_->normals[a]) >= 0;
    mesh_->indices.insert(mesh_->indices.end(), {a, outward ? b : c, outward ? c : b});
  }

  const std::int64_t samples_;
  std::vector<float> values_;
  std::shared_ptr<mesh::BlockMesh> mesh_;
  std::unordered_map<std::int64_t, std::uint32_t> vertex_of_edge_;
};

view::View MakeViewOrDie(const view::Camera& camera, int width, int height,
                         const volume::GridGeometry& geometry) {
  auto view = view::View::Make(camera, {.width_px = width, .height_px = height}, geometry);
  ISOSCOPE_CHECK(view.ok());
  return *std::move(view);
}

}  // namespace

Scene MakeIsosurface(int samples, int block_cells,
                     const std::function<double(const Vec3d&)>& field) {
  Scene scene;
  const Index3 dims{samples, samples, samples};
  auto layout = volume::BlockLayout::Make(dims, {block_cells, block_cells, block_cells});
  ISOSCOPE_CHECK(layout.ok());
  scene.layout = *layout;
  scene.geometry.sample_dims = dims;
  Marcher marcher(samples, field);
  for (std::int64_t id = 0; id < scene.layout.block_count(); ++id) {
    MeshPtr mesh = marcher.MeshOf(scene.layout, static_cast<volume::BlockId>(id));
    if (!mesh->triangles.empty()) {
      scene.meshes.push_back(std::move(mesh));
    }
  }
  return scene;
}

Scene MakeBumpySphere(int samples, int block_cells, double radius, double bump) {
  const double center = 0.5 * (samples - 1);
  return MakeIsosurface(samples, block_cells, [=](const Vec3d& p) {
    const Vec3d d = p - Vec3d{center, center, center};
    const double wave = 12 * std::numbers::pi / radius;
    return radius - math::Length(d) +
           bump * std::sin(wave * d.x) * std::sin(wave * d.y) * std::sin(wave * d.z);
  });
}

view::View MakeView(const Scene& scene, int width, int height, double azimuth_degrees,
                    double elevation_degrees) {
  view::Camera camera = view::MakeDefaultCamera(scene.geometry.Bounds());
  view::Azimuth(azimuth_degrees * std::numbers::pi / 180, &camera);
  view::Elevation(elevation_degrees * std::numbers::pi / 180, &camera);
  return MakeViewOrDie(camera, width, height, scene.geometry);
}

view::View MakeOrthographicView(const Scene& scene, int width, int height, double view_height,
                                const Vec3d& target) {
  view::Camera camera = view::MakeDefaultCamera(scene.geometry.Bounds());
  camera.projection = view::Projection::kOrthographic;
  camera.view_height = view_height;
  camera.target = target;
  camera.eye = target + Vec3d{0, 0, 1000};
  return MakeViewOrDie(camera, width, height, scene.geometry);
}

MeshPtr MakeTriangle(volume::BlockId block_id, const Vec3f& a, const Vec3f& b, const Vec3f& c,
                     const Vec3f& normal) {
  auto mesh = std::make_shared<mesh::BlockMesh>();
  mesh->block_id = block_id;
  mesh->positions = {a, b, c};
  mesh->normals = {normal, normal, normal};
  mesh->indices = {0, 1, 2};
  return mesh::Compact(*mesh);
}

}  // namespace isoscope::render
