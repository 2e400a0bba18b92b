// Small closed meshes for the tests of mesh files and filters.

#ifndef ISOSCOPE_TESTS_UNIT_CLIENTS_CPP_MESH_FILE_TEST_MESHES_H_
#define ISOSCOPE_TESTS_UNIT_CLIENTS_CPP_MESH_FILE_TEST_MESHES_H_

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "clients/cpp/mesh_file/mesh_piece.h"
#include "core/math/vec.h"

namespace isoscope::client {

// A sphere: an octahedron whose triangles are divided `level` times: 8 * 4^level triangles,
// counter-clockwise from outside. Vertex indices begin at `first_vertex`.
inline MeshPiece MakeSphere(int level, const math::Vec3d& center, double radius,
                            std::uint32_t first_vertex = 0) {
  std::vector<math::Vec3d> vertices{{1, 0, 0},  {-1, 0, 0}, {0, 1, 0},
                                    {0, -1, 0}, {0, 0, 1},  {0, 0, -1}};
  std::vector<std::array<std::uint32_t, 3>> triangles{{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4},
                                                      {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (int i = 0; i < level; ++i) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [found, is_new] =
          middles.try_emplace(std::minmax(a, b), static_cast<std::uint32_t>(vertices.size()));
      if (is_new) {
        vertices.push_back(math::Normalized(vertices[a] + vertices[b]));
      }
      return found->second;
    };
    std::vector<std::array<std::uint32_t, 3>> divided;
    for (const auto& [a, b, c] : triangles) {
      const std::uint32_t ab = middle(a, b);
      const std::uint32_t bc = middle(b, c);
      const std::uint32_t ca = middle(c, a);
      for (const std::array<std::uint32_t, 3>& part : std::array<std::array<std::uint32_t, 3>, 4>{
               {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}}}) {
        divided.push_back(part);
      }
    }
    triangles = std::move(divided);
  }
  MeshPiece mesh;
  for (const math::Vec3d& n : vertices) {
    const math::Vec3d p = center + n * radius;
    for (const double v : {p.x, p.y, p.z}) {
      mesh.positions.push_back(static_cast<float>(v));
    }
    for (const double v : {n.x, n.y, n.z}) {
      mesh.normals.push_back(static_cast<float>(v));
    }
  }
  for (const auto& triangle : triangles) {
    for (const std::uint32_t corner : triangle) {
      mesh.triangles.push_back(first_vertex + corner);
    }
  }
  return mesh;
}

// True if every edge has exactly one triangle on each side, turned alike.
inline bool IsClosed(const std::vector<std::uint32_t>& triangles) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    ++edges[{triangles[i], triangles[i % 3 == 2 ? i - 2 : i + 1]}];
  }
  return std::all_of(edges.begin(), edges.end(), [&](const auto& edge) {
    return edge.second == 1 && edges.count({edge.first.second, edge.first.first}) == 1;
  });
}

// The volume inside; positive if triangles turn counter-clockwise from outside.
inline double VolumeOf(const std::vector<float>& positions,
                       const std::vector<std::uint32_t>& triangles) {
  double volume = 0;
  for (std::size_t i = 0; i < triangles.size(); i += 3) {
    math::Vec3d p[3];
    for (std::size_t k = 0; k < 3; ++k) {
      const float* const at = positions.data() + 3 * std::size_t{triangles[i + k]};
      p[k] = {double{at[0]}, double{at[1]}, double{at[2]}};
    }
    volume += math::Dot(p[0], math::Cross(p[1], p[2])) / 6;
  }
  return volume;
}

// A sink that keeps everything.
class MemorySink : public MeshSink {
 public:
  absl::Status Add(const MeshPiece& piece) override {
    mesh.positions.insert(mesh.positions.end(), piece.positions.begin(), piece.positions.end());
    mesh.normals.insert(mesh.normals.end(), piece.normals.begin(), piece.normals.end());
    mesh.triangles.insert(mesh.triangles.end(), piece.triangles.begin(), piece.triangles.end());
    return absl::OkStatus();
  }
  absl::Status Finish() override { return absl::OkStatus(); }

  MeshPiece mesh;
};

}  // namespace isoscope::client

#endif  // ISOSCOPE_TESTS_UNIT_CLIENTS_CPP_MESH_FILE_TEST_MESHES_H_
