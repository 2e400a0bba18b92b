// The pieces of a block's cells and of the cells around them, and how they join.
//
// Each side of a piece is joined with one side of another piece, which runs against it:
//
// * in the same cell, if two of its pieces have the side;
// * else across the faces between cells: the side is that of a polygon between two cells, and the
//   other cell has a piece on it. Where that is a polygon between cells again, the way goes on,
//   around the edge, through the solid. So where a solid touches itself along an edge, the pieces
//   of one wedge of it are joined.
//
// Two corners of a piece coincide if their places are equal. Such a piece is flat, and no mesh has
// it. A side that joins a flat piece is joined with the piece behind it.

#ifndef ISOSCOPE_CORE_SOLID_SOLID_COMPLEX_H_
#define ISOSCOPE_CORE_SOLID_SOLID_COMPLEX_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/math/vec.h"
#include "core/mesh/block_mesh.h"
#include "core/solid/block_field.h"
#include "core/solid/cell_pieces.h"
#include "core/solid/vertex_pool.h"

namespace isoscope::solid {

using PieceId = std::uint32_t;
// 3 * piece + i: the side from corner i to corner i + 1, or corner i.
using SideId = std::uint32_t;
using CornerId = std::uint32_t;

constexpr PieceId PieceOf(std::uint32_t id) { return id / 3; }
constexpr std::size_t NumberOf(std::uint32_t id) { return id % 3; }
constexpr std::uint32_t IdOf(PieceId piece, std::size_t number) {
  return 3 * piece + static_cast<std::uint32_t>(number % 3);
}

// Makes cells when they are asked for. Reused for many blocks. Thread-compatible.
class SolidComplex {
 public:
  SolidComplex(const BlockField* field, CellCutter cutter, VertexPool* pool)
      : field_(*field), cutter_(std::move(cutter)), pool_(*pool) {}

  // Forgets all cells. REQUIRES: field and pool are those of the block.
  void Begin();

  // Return the pieces of a cell: their ids follow each other. REQUIRES: the cell is present.
  struct PieceRange {
    PieceId begin = 0;
    PieceId end = 0;
  };
  PieceRange PiecesOf(const math::Index3& cell);
  // True if the cell is cut, has a piece without an area, or pieces that are not of the surface:
  // then its vertices may be joined with others, or be several.
  bool IsSpecial(const math::Index3& cell);

  [[nodiscard]] const Piece& piece(PieceId id) const { return pieces_[id]; }
  [[nodiscard]] math::Index3 CellOf(PieceId id) const {
    return field_.PositionOf(cells_[cell_of_piece_[id]].lowest);
  }
  [[nodiscard]] bool IsFlat(PieceId id) const { return shapes_[id] == Shape::kFlat; }
  // True if the corners lie on a line, apart from each other.
  [[nodiscard]] bool IsNeedle(PieceId id) const { return shapes_[id] == Shape::kNeedle; }
  [[nodiscard]] VertexId VertexOf(CornerId corner) const {
    return pieces_[PieceOf(corner)].corners[NumberOf(corner)];
  }

  // Returns the side that a side of a piece is joined with; kOpen if there is none, as where a
  // surface ends. REQUIRES: the piece is not flat.
  static constexpr SideId kOpen = 0xffffffff;
  SideId PartnerOf(SideId side);

 private:
  struct Cell {
    SampleIndex lowest = 0;
    PieceRange pieces;
    std::size_t first_portal = 0;
    std::size_t portal_count = 0;
    bool is_special = false;
  };
  enum class Shape : char { kTriangle, kFlat, kNeedle };
  static constexpr std::uint32_t kNone = 0xffffffff;
  static constexpr SideId kUnasked = 0xfffffffe;

  [[nodiscard]] Shape ShapeOfPiece(const Corners& corners) const;
  // Returns the index of the cell in cells_. REQUIRES: it is present.
  std::uint32_t Make(const math::Index3& cell);
  // Returns the side that joins one, flat pieces included.
  SideId NeighborOf(SideId side);
  // Returns the side of a piece of the cell from one vertex to another, or kOpen.
  [[nodiscard]] SideId FindSide(const Cell& cell, VertexId from, VertexId to) const;
  // Returns the face of the cell whose polygons have the side, or -1.
  [[nodiscard]] int FindPortal(const Cell& cell, VertexId from, VertexId to) const;

  const BlockField& field_;
  CellCutter cutter_;
  VertexPool& pool_;
  std::vector<std::uint32_t> cell_indices_;  // by lowest sample, or kNone
  std::vector<Cell> cells_;
  std::vector<Piece> pieces_;
  std::vector<std::uint32_t> cell_of_piece_;
  std::vector<Shape> shapes_;     // by piece
  std::vector<SideId> partners_;  // by side
  std::vector<Portal> portals_;
  CellPieces made_;
};

}  // namespace isoscope::solid

#endif  // ISOSCOPE_CORE_SOLID_SOLID_COMPLEX_H_
