// 1. The extractor makes the mesh of the block. Most blocks are done then (IsWhole): nothing is cut
//    or closed, and no vertex is so near to a sample that it may coincide with another.
// 2. For the others, MakeMesh goes through the cells again. SolidComplex makes their pieces, and
//    those of the cells around the block as far as they are needed. Cells come in the order of the
//    extractor, and so do their triangles.
// 3. Pieces that are flat are left out. Each corner of the others becomes a vertex: that of the
//    extractor where all around is plain, else that of its fan (surface_fans.h).
//
// Pieces of smooth labels are made of the middles of edges, as those of others, and their vertices
// moved at the end. No vertex comes near to a sample, so nothing coincides that did not before.
//
// Blocks that share a vertex see the same cells around it, because blocks store a layer of ghost
// samples. So they agree on its position and its copy number.

#include "core/solid/block_surface.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>

#include "core/base/check.h"
#include "core/math/vec_conversion.h"
#include "core/solid/face_polygons.h"

namespace isoscope::solid {
namespace {

constexpr std::uint32_t kNoVertex = 0xffffffff;
// Middles and centers come after all vertices of cuts.
constexpr int kMeanRank = 1 << 20;

// The block's cells and those around, as far as the volume has them.
math::IndexBox CellsAround(const volume::BlockLayout& layout, volume::BlockId id) {
  math::IndexBox cells = layout.CellsOf(id);
  for (int axis = 0; axis < 3; ++axis) {
    cells.begin[axis] = std::max<std::int64_t>(cells.begin[axis] - 1, 0);
    cells.end[axis] = std::min(cells.end[axis] + 1, layout.sample_dims()[axis] - 1);
  }
  return cells;
}

// (0, 0, 0) stays.
math::Vec3f UnitOf(const math::Vec3d& v) {
  const double length = math::Length(v);
  return length > 0 ? math::FloatOf(v * (1 / length)) : math::Vec3f{};
}

bool TouchesBorder(const volume::BlockLayout& layout, volume::BlockId id) {
  const math::IndexBox cells = layout.CellsOf(id);
  for (int axis = 0; axis < 3; ++axis) {
    if (cells.begin[axis] == 0 || cells.end[axis] == layout.sample_dims()[axis] - 1) {
      return true;
    }
  }
  return false;
}

bool MayBeMissing(volume::ScalarType type) {
  return type == volume::ScalarType::kFloat32 || type == volume::ScalarType::kFloat64;
}

std::uint32_t* Slot(std::size_t index, std::vector<std::uint32_t>* table) {
  if (index >= table->size()) {
    table->resize(index + 1, kNoVertex);
  }
  return &(*table)[index];
}

}  // namespace

bool MayHaveSurface(const volume::BlockLayout& layout, volume::BlockId id,
                    volume::BlockSpans* spans, const volume::InsideRule& rule,
                    const view::Clipper& clipper) {
  const volume::ScalarSpan span = spans->Get(id);
  if (!rule.MayHaveInside(span)) {
    return false;
  }
  const view::Clipper::Side side = clipper.SideOf(CellsAround(layout, id));
  return side != view::Clipper::Side::kOutside &&
         (side == view::Clipper::Side::kCut || rule.IsActive(span) || MayBeMissing(spans->type()) ||
          TouchesBorder(layout, id));
}

BlockSurface::BlockSurface(const volume::GridGeometry& geometry, const volume::BlockLayout& layout,
                           std::shared_ptr<const extract::BlockShapes> shapes,
                           const SurfaceOptions& options)
    : layout_(layout),
      placement_(geometry),
      to_world_(geometry.world_gradient_from_index()),
      reference_(geometry.Bounds().min),
      is_mirrored_(math::Determinant(geometry.direction) < 0),
      clipper_(options.clip, geometry),
      closes_(options.closes),
      extractor_(geometry, layout, std::move(shapes)),
      field_(layout),
      pool_(placement_),
      complex_(&field_, CellCutter(&field_, &clipper_, closes_, &pool_), &pool_),
      seams_(&field_, &pool_, &complex_),
      fans_(&field_, &pool_, &complex_, &seams_) {}

void BlockSurface::Extract(const volume::BlockSamples& samples, const volume::InsideRule& rule,
                           mesh::BlockMesh* mesh, SurfaceSums* sums) {
  extractor_.ExtractWithEdgeKeys(samples, rule, mesh);
  mesh->copies.clear();
  const view::Clipper::Side side = clipper_.SideOf(CellsAround(layout_, samples.block_id));
  const bool has_surface = !mesh->indices.empty() || closes_;
  if (side == view::Clipper::Side::kOutside || !has_surface) {
    *mesh = mesh::BlockMesh();
    mesh->block_id = samples.block_id;
    return;
  }
  field_.Set(samples, rule);
  if (IsWhole(*mesh, side)) {
    open_side_count_ = sums != nullptr ? CountOpenSides() : 0;
  } else {
    MakeMesh(mesh);
  }
  mesh->edge_keys.clear();
  if (sums != nullptr) {
    AddSums(*mesh, sums);
  }
}

bool BlockSurface::IsWhole(const mesh::BlockMesh& mesh, view::Clipper::Side side) const {
  return side == view::Clipper::Side::kInside &&
         !(closes_ && (field_.touches_border() || field_.has_missing())) && !HasTies(mesh);
}

bool BlockSurface::HasTies(const mesh::BlockMesh& mesh) const {
  const double blur = placement_.blur();
  for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
    const auto coordinate =
        static_cast<double>(mesh.positions[i][static_cast<int>(mesh.edge_keys[i] % 3)]);
    const double above = coordinate - std::floor(coordinate);
    if (std::min(above, 1 - above) <= blur) {
      return true;
    }
  }
  return false;
}

bool BlockSurface::HasPieces(const math::Index3& cell) const {
  if (field_.StateOfCell(cell) != CellState::kPresent) {
    return false;
  }
  const unsigned inside = field_.CaseOf(field_.IndexOf(cell));
  if (inside != 0xff || !closes_) {
    return inside != 0 && inside != 0xff;
  }
  if (clipper_.SideOf({cell, cell + math::Index3{1, 1, 1}}) == view::Clipper::Side::kCut) {
    return true;
  }
  for (std::size_t face = 0; face < kFaceCount; ++face) {
    if (field_.StateOfCell(CellBehind(cell, face)) == CellState::kAbsent) {
      return true;
    }
  }
  return false;
}

void BlockSurface::MakeMesh(mesh::BlockMesh* mesh) {
  pool_.Begin(field_, *mesh);
  complex_.Begin();
  seams_.Begin();
  fans_.Begin();
  vertices_.clear();
  indices_.clear();
  vertex_of_plain_.clear();
  vertex_of_fan_.clear();
  vertex_of_middle_.clear();
  open_side_count_ = 0;
  const math::IndexBox& cells = field_.cells();
  for (std::int64_t z = cells.begin.z; z < cells.end.z; ++z) {
    for (std::int64_t y = cells.begin.y; y < cells.end.y; ++y) {
      for (std::int64_t x = cells.begin.x; x < cells.end.x; ++x) {
        if (!HasPieces({x, y, z})) {
          continue;
        }
        const SolidComplex::PieceRange pieces = complex_.PiecesOf({x, y, z});
        for (PieceId piece = pieces.begin; piece < pieces.end; ++piece) {
          if (!seams_.IsDropped(piece)) {
            AddPiece(piece);
          }
        }
      }
    }
  }
  SortVertices(mesh);
}

void BlockSurface::AddPiece(PieceId piece) {
  corners_.clear();
  const PartId first = FirstPartOf(IdOf(piece, 0));
  PartId part = first;
  do {
    corners_.push_back({.vertex = VertexOf(part), .part = part});
    const bool is_open = seams_.PartnerOf(part) == Seams::kOpen;
    open_side_count_ += is_open ? 1 : 0;
    if (const std::optional<std::uint8_t> copy = fans_.MiddleOf(part); copy.has_value()) {
      corners_.push_back({.vertex = MiddleVertexOf(part, *copy), .part = std::nullopt});
      open_side_count_ += is_open ? 1 : 0;
    }
    part = seams_.NextOf(part);
  } while (part != first);
  if (corners_.size() == 3) {
    for (const Corner& corner : corners_) {
      indices_.push_back(corner.vertex);
    }
    return;
  }
  AddPolygon(piece);
}

// A triangle with more corners on its sides becomes several. Its diagonals must be no edges of
// other pieces; else all triangles meet in its center.
void BlockSurface::AddPolygon(PieceId piece) {
  const Corners& corners = complex_.piece(piece).corners;
  const math::Vec3d outward = math::Cross(pool_[corners[1]].place - pool_[corners[0]].place,
                                          pool_[corners[2]].place - pool_[corners[0]].place);
  const std::size_t size = corners_.size();
  const auto shape = [&](std::size_t i, std::size_t k, std::size_t j) {
    const auto place = [&](std::size_t corner) {
      return placement_.PlaceOf(vertices_[corners_[corner].vertex].position);
    };
    return ShapeOf({place(i), place(k), place(j)}, outward);
  };
  const std::vector<std::array<std::size_t, 3>> triangles = SplitByQuality(size, shape);
  const auto is_taken = [&](std::size_t i, std::size_t j) {
    const bool is_side = (i + 1) % size == j || (j + 1) % size == i;
    return !is_side && corners_[i].part.has_value() && corners_[j].part.has_value() &&
           fans_.MeetElsewhere(*corners_[i].part, *corners_[j].part);
  };
  const bool has_taken =
      std::any_of(triangles.begin(), triangles.end(), [&](const std::array<std::size_t, 3>& t) {
        return is_taken(t[0], t[1]) || is_taken(t[1], t[2]) || is_taken(t[2], t[0]);
      });
  if (!has_taken) {
    for (const std::array<std::size_t, 3>& triangle : triangles) {
      for (const std::size_t corner : triangle) {
        indices_.push_back(corners_[corner].vertex);
      }
    }
    return;
  }
  const std::uint32_t center = CenterVertexOf(piece);
  for (std::size_t i = 0; i < size; ++i) {
    indices_.insert(indices_.end(), {corners_[i].vertex, corners_[(i + 1) % size].vertex, center});
  }
}

// The mean of some vertices.
BlockSurface::MeshVertex BlockSurface::MeanOf(std::initializer_list<std::uint32_t> vertices,
                                              std::uint8_t copy) const {
  math::Vec3d position;
  math::Vec3d normal;
  for (const std::uint32_t vertex : vertices) {
    position = position + math::DoubleOf(vertices_[vertex].position);
    normal = normal + math::DoubleOf(vertices_[vertex].normal);
  }
  MeshVertex mean;
  mean.position = math::FloatOf(position * (1 / static_cast<double>(vertices.size())));
  mean.normal = UnitOf(normal);
  mean.order = {kMeanRank, static_cast<std::uint32_t>(vertices_.size())};
  mean.copy = copy;
  return mean;
}

std::uint32_t BlockSurface::CenterVertexOf(PieceId piece) {
  const auto part = [&](std::size_t number) { return FirstPartOf(IdOf(piece, number)); };
  std::size_t near = 0;
  while (fans_.IsPlain(seams_.VertexOf(part(near)))) {
    ++near;
  }
  vertices_.push_back(MeanOf({VertexOf(part(0)), VertexOf(part(1)), VertexOf(part(2))},
                             fans_.CenterOf(part(near))));
  return static_cast<std::uint32_t>(vertices_.size() - 1);
}

std::uint32_t BlockSurface::VertexOf(PartId corner) {
  const VertexId vertex = seams_.VertexOf(corner);
  if (fans_.IsPlain(vertex)) {
    std::uint32_t* const slot = Slot(vertex, &vertex_of_plain_);
    if (*slot == kNoVertex) {
      *slot = static_cast<std::uint32_t>(vertices_.size());
      const SolidVertex& plain = pool_[vertex];
      vertices_.push_back(
          {.position = pool_.MeshPositionOf(vertex), .normal = plain.normal, .order = plain.order});
    }
    return *slot;
  }
  const FanId fan = fans_.FanOf(corner);
  if (*Slot(fan, &vertex_of_fan_) == kNoVertex) {
    vertices_.push_back(VertexOfFan(fan));
    *Slot(fan, &vertex_of_fan_) = static_cast<std::uint32_t>(vertices_.size() - 1);
  }
  return *Slot(fan, &vertex_of_fan_);
}

// The normal is that of the surface, if the fan has pieces of it; else that of the first plane. It
// comes from the block's own cells, whose normals are known.
BlockSurface::MeshVertex BlockSurface::VertexOfFan(FanId fan) {
  const auto rank = [this](PartId corner) {
    return std::pair(complex_.piece(PieceOf(SideOfPart(corner))).tag,
                     pool_[seams_.VertexOf(corner)].order);
  };
  std::optional<PartId> first;
  for (const PartId corner : fans_.CornersOf(fan)) {
    if (field_.cells().Contains(complex_.CellOf(PieceOf(SideOfPart(corner)))) &&
        (!first.has_value() || rank(corner) < rank(*first))) {
      first = corner;
    }
  }
  ISOSCOPE_CHECK(first.has_value());
  const VertexId id = seams_.VertexOf(*first);
  const SolidVertex vertex = pool_[id];
  const Tag tag = complex_.piece(PieceOf(SideOfPart(*first))).tag;
  return {.position = field_.rule().smooths ? pool_.MeshPositionOf(id) : fans_.PositionOf(fan),
          .normal = tag == kSurfaceTag ? vertex.normal : NormalOfTag(tag),
          .order = vertex.order,
          .copy = fans_.CopyOf(fan)};
}

math::Vec3f BlockSurface::NormalOfTag(Tag tag) const {
  const math::Vec3d outward =
      tag < CapTag(0) ? OutwardOf(static_cast<std::size_t>(tag - ClosingTag(0)))
                      : -clipper_.half_spaces()[static_cast<std::size_t>(tag - CapTag(0))].normal;
  return UnitOf(to_world_ * outward);
}

std::uint32_t BlockSurface::MiddleVertexOf(PartId part, std::uint8_t copy) {
  const PartId key = std::min(part, seams_.PartnerOf(part));
  if (const auto found = vertex_of_middle_.find(key); found != vertex_of_middle_.end()) {
    return found->second;
  }
  // A sum of two does not depend on their order.
  vertices_.push_back(MeanOf({VertexOf(part), VertexOf(seams_.NextOf(part))}, copy));
  return vertex_of_middle_[key] = static_cast<std::uint32_t>(vertices_.size() - 1);
}

void BlockSurface::SortVertices(mesh::BlockMesh* mesh) {
  std::vector<std::uint32_t> sorted(vertices_.size());
  std::iota(sorted.begin(), sorted.end(), std::uint32_t{0});
  std::stable_sort(sorted.begin(), sorted.end(), [this](std::uint32_t a, std::uint32_t b) {
    return vertices_[a].order < vertices_[b].order;
  });
  std::vector<std::uint32_t> new_index(vertices_.size());
  const volume::BlockId block_id = mesh->block_id;
  *mesh = mesh::BlockMesh();
  mesh->block_id = block_id;
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    const MeshVertex& vertex = vertices_[sorted[i]];
    new_index[sorted[i]] = static_cast<std::uint32_t>(i);
    mesh->positions.push_back(vertex.position);
    mesh->normals.push_back(vertex.normal);
    mesh->copies.push_back(vertex.copy);
  }
  if (std::all_of(mesh->copies.begin(), mesh->copies.end(), [](auto copy) { return copy == 0; })) {
    mesh->copies.clear();
  }
  mesh->indices.reserve(indices_.size());
  for (const std::uint32_t index : indices_) {
    mesh->indices.push_back(new_index[index]);
  }
}

std::int64_t BlockSurface::CountOpenSides() const {
  if (!field_.touches_border() && !field_.has_missing()) {
    return 0;
  }
  std::int64_t count = 0;
  const math::IndexBox& cells = field_.cells();
  for (std::int64_t z = cells.begin.z; z < cells.end.z; ++z) {
    for (std::int64_t y = cells.begin.y; y < cells.end.y; ++y) {
      for (std::int64_t x = cells.begin.x; x < cells.end.x; ++x) {
        count += CountOpenSidesOf({x, y, z});
      }
    }
  }
  return count;
}

std::int64_t BlockSurface::CountOpenSidesOf(const math::Index3& cell) const {
  if (field_.StateOfCell(cell) != CellState::kPresent) {
    return 0;
  }
  const unsigned inside = field_.CaseOf(field_.IndexOf(cell));
  std::int64_t count = 0;
  for (std::size_t face = 0; face < kFaceCount && inside != 0 && inside != 0xff; ++face) {
    if (field_.StateOfCell(CellBehind(cell, face)) == CellState::kAbsent) {
      // Labels have as many.
      const FacePolygons& polygons = FacePolygonsOf(InsideOfFace(inside, face), false);
      for (std::size_t i = 0; i < polygons.count; ++i) {
        count += polygons.polygons[i].points[0] >= FacePolygon::kFirstEdge ? 1 : 0;
      }
    }
  }
  return count;
}

void BlockSurface::AddSums(const mesh::BlockMesh& mesh, SurfaceSums* sums) {
  places_.clear();
  for (const math::Vec3f& position : mesh.positions) {
    places_.push_back(placement_.PositionOf(position) - reference_);
  }
  for (std::size_t i = 0; i + 2 < mesh.indices.size(); i += 3) {
    // In a mirrored grid, counter-clockwise in index space is clockwise in the world.
    sums->AddTriangle({places_[mesh.indices[i]], places_[mesh.indices[i + (is_mirrored_ ? 2 : 1)]],
                       places_[mesh.indices[i + (is_mirrored_ ? 1 : 2)]]});
  }
  sums->open_side_count += open_side_count_;
}

}  // namespace isoscope::solid
