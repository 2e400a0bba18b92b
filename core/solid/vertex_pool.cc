#include "core/solid/vertex_pool.h"

#include "core/extract/vertex_batch.h"
#include "core/math/vec_conversion.h"

namespace isoscope::solid {
namespace {

// Vertices that no mesh of the block has come after those that it has.
constexpr std::uint32_t kFirstOther = std::uint32_t{1} << 31;

}  // namespace

void VertexPool::Begin(const BlockField& field, const mesh::BlockMesh& mesh) {
  field_ = &field;
  mesh_ = &mesh;
  vertices_.clear();
  edge_of_vertex_.clear();
  on_cuts_.clear();
  mesh_vertices_.assign(3 * field.sample_count(), kNone);
  on_edges_.assign(3 * field.sample_count(), kNone);
  at_samples_.assign(field.sample_count(), kNone);
  for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
    mesh_vertices_[field.LocalEdge(mesh.edge_keys[i])] = static_cast<std::uint32_t>(i);
  }
}

VertexId VertexPool::Add(const math::Vec3f& position, const math::Vec3f& normal,
                         std::pair<int, std::uint32_t> order, std::uint32_t edge) {
  const auto id = static_cast<VertexId>(vertices_.size());
  vertices_.push_back({.position = position,
                       .place = placement_.PlaceOf(position),
                       .normal = normal,
                       .order = order});
  edge_of_vertex_.push_back(edge);
  return id;
}

math::Vec3f VertexPool::PositionOnEdge(SampleIndex lower, int axis) const {
  // As the extractor places it, bit for bit (docs/numerics.md, "Vertex position"); labels before they
  // are smoothed.
  double t = 0.5;
  if (!field_->rule().has_labels()) {
    const extract::Fraction fraction = extract::CarefulFraction(
        field_->ValueAt(lower), field_->ValueAt(lower + field_->StrideOf(axis)),
        field_->rule().isovalue);
    t = fraction.numerator / fraction.denominator;
  }
  const math::Index3 at = field_->PositionOf(lower);
  math::Vec3d position{static_cast<double>(at.x), static_cast<double>(at.y),
                       static_cast<double>(at.z)};
  position[axis] += t;
  return math::FloatOf(position);
}

VertexId VertexPool::OnEdge(SampleIndex lower, int axis) {
  const std::size_t edge = 3 * lower + static_cast<std::size_t>(axis);
  if (on_edges_[edge] == kNone) {
    const std::uint32_t mesh_vertex = mesh_vertices_[edge];
    const auto key = static_cast<std::uint32_t>(edge);
    // Edges of other blocks' cells have no smooth place here: their samples' neighbours are missing.
    const bool has_place = mesh_vertex != kNone && !field_->rule().smooths;
    const math::Vec3f position =
        has_place ? mesh_->positions[mesh_vertex] : PositionOnEdge(lower, axis);
    on_edges_[edge] = mesh_vertex != kNone
                          ? Add(position, mesh_->normals[mesh_vertex], {0, mesh_vertex}, key)
                          : Add(position, {}, {0, kFirstOther + key}, key);
  }
  return on_edges_[edge];
}

math::Vec3f VertexPool::MeshPositionOf(VertexId id) const {
  const std::uint32_t edge = edge_of_vertex_[id];
  if (!field_->rule().smooths || edge == kNoEdge || mesh_vertices_[edge] == kNone) {
    return vertices_[id].position;
  }
  return mesh_->positions[mesh_vertices_[edge]];
}

VertexId VertexPool::AtSample(SampleIndex sample) {
  if (at_samples_[sample] == kNone) {
    const math::Index3 at = field_->PositionOf(sample);
    at_samples_[sample] =
        Add({static_cast<float>(at.x), static_cast<float>(at.y), static_cast<float>(at.z)}, {},
            {0, kFirstOther + static_cast<std::uint32_t>(3 * sample)}, kNoEdge);
  }
  return at_samples_[sample];
}

VertexId VertexPool::OnCut(VertexId inside, VertexId outside, const view::HalfSpace& half_space,
                           int cut_rank) {
  const auto [entry, is_new] = on_cuts_.try_emplace({inside, outside}, kNone);
  if (!is_new) {
    return entry->second;
  }
  const SolidVertex& a = vertices_[inside];
  const SolidVertex& b = vertices_[outside];
  const double distance_a = view::Clipper::DistanceOf(half_space, a.position);
  const double distance_b = view::Clipper::DistanceOf(half_space, b.position);
  const double t = distance_a / (distance_a - distance_b);
  const auto between = [t](const math::Vec3f& from, const math::Vec3f& to) {
    return math::DoubleOf(from) + (math::DoubleOf(to) - math::DoubleOf(from)) * t;
  };
  const math::Vec3d normal = between(a.normal, b.normal);
  const double length = math::Length(normal);
  const math::Vec3f position = math::FloatOf(between(a.position, b.position));
  entry->second = Add(position, length > 0 ? math::FloatOf(normal * (1 / length)) : math::Vec3f{},
                      {cut_rank, static_cast<std::uint32_t>(vertices_.size())}, kNoEdge);
  return entry->second;
}

}  // namespace isoscope::solid
