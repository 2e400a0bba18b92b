#include "core/solid/solid_complex.h"

#include <algorithm>

#include "core/base/check.h"

namespace isoscope::solid {
namespace {

// A way around an edge passes at most four cells; one along flat pieces, few edges.
constexpr int kMaxCellsAroundEdge = 8;
constexpr int kMaxFlatPieces = 4096;

}  // namespace

void SolidComplex::Begin() {
  cell_indices_.assign(field_.sample_count(), kNone);
  cells_.clear();
  pieces_.clear();
  cell_of_piece_.clear();
  shapes_.clear();
  partners_.clear();
  portals_.clear();
}

SolidComplex::Shape SolidComplex::ShapeOfPiece(const Corners& corners) const {
  const auto [a, b, c] = corners;
  if (pool_.Coincide(a, b) || pool_.Coincide(b, c) || pool_.Coincide(c, a)) {
    return Shape::kFlat;
  }
  const math::Vec3d area =
      math::Cross(pool_[b].place - pool_[a].place, pool_[c].place - pool_[a].place);
  return area == math::Vec3d{} ? Shape::kNeedle : Shape::kTriangle;
}

std::uint32_t SolidComplex::Make(const math::Index3& at) {
  const SampleIndex lowest = field_.IndexOf(at);
  if (cell_indices_[lowest] != kNone) {
    return cell_indices_[lowest];
  }
  cutter_.Make(at, &made_);
  const auto index = static_cast<std::uint32_t>(cells_.size());
  cell_indices_[lowest] = index;
  Cell cell{.lowest = lowest,
            .pieces = {.begin = static_cast<PieceId>(pieces_.size()), .end = 0},
            .first_portal = portals_.size(),
            .portal_count = made_.portals.size(),
            .is_special = made_.is_cut};
  for (const Piece& piece : made_.pieces) {
    const Shape shape = ShapeOfPiece(piece.corners);
    cell.is_special = cell.is_special || shape != Shape::kTriangle || piece.tag != kSurfaceTag;
    pieces_.push_back(piece);
    cell_of_piece_.push_back(index);
    shapes_.push_back(shape);
  }
  partners_.resize(3 * pieces_.size(), kUnasked);
  cell.pieces.end = static_cast<PieceId>(pieces_.size());
  portals_.insert(portals_.end(), made_.portals.begin(), made_.portals.end());
  cells_.push_back(cell);
  return index;
}

SolidComplex::PieceRange SolidComplex::PiecesOf(const math::Index3& cell) {
  return cells_[Make(cell)].pieces;
}

bool SolidComplex::IsSpecial(const math::Index3& cell) { return cells_[Make(cell)].is_special; }

SideId SolidComplex::FindSide(const Cell& cell, VertexId from, VertexId to) const {
  for (PieceId piece = cell.pieces.begin; piece < cell.pieces.end; ++piece) {
    const Corners& corners = pieces_[piece].corners;
    for (std::size_t i = 0; i < 3; ++i) {
      if (corners[i] == from && corners[(i + 1) % 3] == to) {
        return IdOf(piece, i);
      }
    }
  }
  return kOpen;
}

int SolidComplex::FindPortal(const Cell& cell, VertexId from, VertexId to) const {
  const auto begin = portals_.begin() + static_cast<std::ptrdiff_t>(cell.first_portal);
  const auto end = begin + static_cast<std::ptrdiff_t>(cell.portal_count);
  const auto portal =
      std::find_if(begin, end, [&](const Portal& p) { return p.from == from && p.to == to; });
  return portal == end ? -1 : portal->face;
}

SideId SolidComplex::NeighborOf(SideId side) {
  const Piece& piece = pieces_[PieceOf(side)];
  const VertexId from = piece.corners[(NumberOf(side) + 1) % 3];
  const VertexId to = piece.corners[NumberOf(side)];
  std::uint32_t cell = cell_of_piece_[PieceOf(side)];
  for (int i = 0; i < kMaxCellsAroundEdge; ++i) {
    const SideId found = FindSide(cells_[cell], from, to);
    if (found != kOpen) {
      return found;
    }
    const int face = FindPortal(cells_[cell], from, to);
    if (face < 0) {
      return kOpen;
    }
    const math::Index3 behind =
        CellBehind(field_.PositionOf(cells_[cell].lowest), static_cast<std::size_t>(face));
    if (field_.StateOfCell(behind) != CellState::kPresent) {
      return kOpen;
    }
    cell = Make(behind);
  }
  return kOpen;
}

SideId SolidComplex::PartnerOf(SideId side) {
  if (partners_[side] != kUnasked) {
    return partners_[side];
  }
  SideId at = NeighborOf(side);
  for (int i = 0; at != kOpen && IsFlat(PieceOf(at)); ++i) {
    ISOSCOPE_CHECK_LT(i, kMaxFlatPieces);
    // The two ends of the side differ. So the third corner coincides with one of them, and of the
    // other two sides one joins the same places.
    const Corners& corners = pieces_[PieceOf(at)].corners;
    const std::size_t number = NumberOf(at);
    const bool is_at_start = pool_.Coincide(corners[(number + 2) % 3], corners[number]);
    at = NeighborOf(IdOf(PieceOf(at), is_at_start ? number + 1 : number + 2));
  }
  partners_[side] = at;
  if (at != kOpen) {
    partners_[at] = side;
  }
  return at;
}

}  // namespace isoscope::solid
