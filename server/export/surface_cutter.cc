// Sutherland and Hodgman's clipping, half-space after half-space over all triangles of a block:
//
//   distances of a triangle   what is left
//   none < 0                  the triangle
//   none > 0                  nothing
//   + - -    + 0 -            one triangle, with new vertices on the edges from + to -
//   + + -                     two triangles
//
// The mesh stays welded: a new vertex follows from the two ends of its edge and the half-space
// alone, and these are the same in every block that has the edge. Its key is that of the pair of
// ends. A cut edge has another end, and so another key, for the next half-space.
//
// Example: the edge from a (distance 3) to b (distance -1) gets a vertex at a + 3/4 (b - a). Both
// triangles of the edge use it, in whatever block they lie.
//
// Based on: Sutherland, Hodgman: Reentrant Polygon Clipping, Communications of the ACM 17 (1974).

#include "server/export/surface_cutter.h"

#include <algorithm>
#include <array>
#include <cstddef>

#include "core/base/check.h"
#include "core/math/vec.h"

namespace isoscope::server {
namespace {

math::Vec3d ToDouble(const math::Vec3f& v) {
  return {static_cast<double>(v.x), static_cast<double>(v.y), static_cast<double>(v.z)};
}
math::Vec3f ToFloat(const math::Vec3d& v) {
  return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}

}  // namespace

void SurfaceCutter::Cut(mesh::BlockMesh* block) {
  ISOSCOPE_CHECK_EQ(block->edge_keys.size(), block->positions.size());
  if (clipper_.SideOf(layout_, block->block_id) == view::Clipper::Side::kInside) {
    return;
  }
  made_.clear();
  for (const view::HalfSpace& half_space : clipper_.half_spaces()) {
    CutBy(half_space, block);
  }
  DropUnused(block);
}

void SurfaceCutter::CutBy(const view::HalfSpace& half_space, mesh::BlockMesh* block) {
  distances_.clear();
  for (const math::Vec3f& position : block->positions) {
    distances_.push_back(view::Clipper::DistanceOf(half_space, position));
  }
  indices_.clear();
  for (std::size_t i = 0; i + 2 < block->indices.size(); i += 3) {
    const std::array<std::uint32_t, 3> corners{block->indices[i], block->indices[i + 1],
                                               block->indices[i + 2]};
    const auto distance = [&](std::size_t k) { return distances_[corners[k % 3]]; };
    if (distance(0) >= 0 && distance(1) >= 0 && distance(2) >= 0) {
      indices_.insert(indices_.end(), corners.begin(), corners.end());
      continue;
    }
    if (!(distance(0) > 0 || distance(1) > 0 || distance(2) > 0)) {
      continue;
    }
    std::array<std::uint32_t, 4> polygon{};
    std::size_t size = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t from = corners[k];
      const std::uint32_t to = corners[(k + 1) % 3];
      if (distance(k) >= 0) {
        polygon[size++] = from;
      }
      if (distance(k) > 0 && distance(k + 1) < 0) {
        polygon[size++] = VertexOn(from, to, block);
      } else if (distance(k) < 0 && distance(k + 1) > 0) {
        polygon[size++] = VertexOn(to, from, block);
      }
    }
    for (std::size_t k = 2; k < size; ++k) {
      indices_.insert(indices_.end(), {polygon[0], polygon[k - 1], polygon[k]});
    }
  }
  block->indices.swap(indices_);
}

std::uint32_t SurfaceCutter::VertexOn(std::uint32_t inside, std::uint32_t outside,
                                      mesh::BlockMesh* block) {
  const std::int64_t next_key = -static_cast<std::int64_t>(keys_.size()) - 1;
  const std::int64_t key =
      keys_.try_emplace(Edge(block->edge_keys[inside], block->edge_keys[outside]), next_key)
          .first->second;
  const auto [entry, is_new] =
      made_.try_emplace(key, static_cast<std::uint32_t>(block->positions.size()));
  if (!is_new) {
    return entry->second;
  }
  const double t = distances_[inside] / (distances_[inside] - distances_[outside]);
  const auto between = [t](const math::Vec3f& a, const math::Vec3f& b) {
    return ToDouble(a) + (ToDouble(b) - ToDouble(a)) * t;
  };
  const math::Vec3d normal = between(block->normals[inside], block->normals[outside]);
  const double length = math::Length(normal);
  block->positions.push_back(ToFloat(between(block->positions[inside], block->positions[outside])));
  block->normals.push_back(length > 0 ? ToFloat(normal * (1 / length)) : math::Vec3f{});
  block->edge_keys.push_back(key);
  return entry->second;
}

void SurfaceCutter::DropUnused(mesh::BlockMesh* block) {
  new_index_.assign(block->positions.size(), 0);
  for (const std::uint32_t index : block->indices) {
    new_index_[index] = 1;
  }
  std::uint32_t count = 0;
  for (std::size_t i = 0; i < new_index_.size(); ++i) {
    if (new_index_[i] == 0) {
      continue;
    }
    block->positions[count] = block->positions[i];
    block->normals[count] = block->normals[i];
    block->edge_keys[count] = block->edge_keys[i];
    new_index_[i] = count++;
  }
  block->positions.resize(count);
  block->normals.resize(count);
  block->edge_keys.resize(count);
  for (std::uint32_t& index : block->indices) {
    index = new_index_[index];
  }
}

}  // namespace isoscope::server
