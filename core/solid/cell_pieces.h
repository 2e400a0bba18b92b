// The border of the solid in one cell, cut by the clip region: triangles that a mesh has, and the
// sides of the polygons between this cell and the next, which it does not have.
//
//   surface        the triangles of marching cubes
//   closing faces  what is inside on a face of the cell behind which there is no cell
//   caps           what is inside on the border of a half-space
//
// A solid that is closed has all three; else the mesh has the surface alone.

#ifndef ISOSCOPE_CORE_SOLID_CELL_PIECES_H_
#define ISOSCOPE_CORE_SOLID_CELL_PIECES_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/solid/block_field.h"
#include "core/solid/face_polygons.h"
#include "core/solid/polygon_cutter.h"
#include "core/solid/vertex_pool.h"
#include "core/view/clip_region.h"

namespace isoscope::solid {

// The part of a solid that a triangle belongs to: the surface, a closing face, a cap.
using Tag = std::uint8_t;
inline constexpr Tag kSurfaceTag = 0;
// Faces are numbered 2 * axis + side; half-spaces as in view::Clipper.
constexpr Tag ClosingTag(std::size_t face) { return static_cast<Tag>(1 + face); }
constexpr Tag CapTag(std::size_t half_space) { return static_cast<Tag>(7 + half_space); }

struct Piece {
  Corners corners{};  // counter-clockwise seen from outside the solid
  Tag tag = kSurfaceTag;
  std::uint16_t index = 0;  // of the piece among those of its tag in the cell
};

// A directed side of a polygon between this cell and the one behind a face.
struct Portal {
  VertexId from = 0;
  VertexId to = 0;
  std::uint8_t face = 0;
};

struct CellPieces {
  std::vector<Piece> pieces;
  std::vector<Portal> portals;
  bool is_cut = false;  // by a half-space
};

// Makes the pieces of cells. Thread-compatible.
class CellCutter {
 public:
  // field, pool: of the current block; clipper: must outlive it
  // closes: whether there are closing faces and caps
  CellCutter(const BlockField* field, const view::Clipper* clipper, bool closes, VertexPool* pool)
      : field_(*field), clipper_(*clipper), closes_(closes), pool_(*pool) {}

  // Replaces `cell` by the pieces of a cell, in an order that follows from the cell's samples and
  // neighbours. REQUIRES: the cell is present.
  void Make(const math::Index3& at, CellPieces* cell);

 private:
  // The polygons of a face, counter-clockwise seen from the end of its axis.
  struct Face {
    std::vector<Points> polygons;
    CellState behind = CellState::kPresent;
  };

  void AddSurface(SampleIndex lowest, unsigned inside);
  void AddFace(SampleIndex lowest, std::size_t face);
  void CutBy(std::size_t half_space);
  void Collect(CellPieces* cell);

  const BlockField& field_;
  const view::Clipper& clipper_;
  const bool closes_;
  VertexPool& pool_;
  // State of the cell in work.
  std::vector<Points> surface_;  // triangles
  std::array<Face, kFaceCount> faces_;
  std::vector<std::vector<Points>> caps_;  // by half-space
  std::vector<PlaneSide> sides_;
  std::vector<Points> kept_;
};

}  // namespace isoscope::solid

#endif  // ISOSCOPE_CORE_SOLID_CELL_PIECES_H_
