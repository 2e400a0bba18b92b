// The vertices of a mesh that is a manifold: one for each fan.
//
// A fan is the ring of pieces around a vertex, joined side by side; at the end of a surface it is
// a part of a ring. Vertices of flat pieces coincide, and their fans are joined to one. Where a
// surface touches itself, several fans have one place: each has a vertex of its own, and copy
// numbers tell them apart.
//
// Two fans may be joined by several edges: two parts of a solid that touch along an edge, whose
// ends the surface goes around. All but the first of these edges get a vertex in their middle. So
// each edge of the mesh has two triangles.
//
// All of this follows from the cells around a vertex. So blocks that share a vertex agree on it.

#ifndef ISOSCOPE_CORE_SOLID_SURFACE_FANS_H_
#define ISOSCOPE_CORE_SOLID_SURFACE_FANS_H_

#include <array>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_map.h"

#include "core/math/vec.h"
#include "core/solid/block_field.h"
#include "core/solid/seams.h"
#include "core/solid/solid_complex.h"
#include "core/solid/vertex_pool.h"

namespace isoscope::solid {

using FanId = std::uint32_t;

// Reused for many blocks. Thread-compatible.
class SurfaceFans {
 public:
  SurfaceFans(const BlockField* field, const VertexPool* pool, SolidComplex* complex, Seams* seams)
      : field_(*field), pool_(*pool), complex_(*complex), seams_(*seams) {}

  void Begin();

  // True if nothing near the vertex is special: then it is a vertex of the mesh, as it is.
  bool IsPlain(VertexId vertex);

  // Returns the fan of a corner, the start of a part. REQUIRES: its piece is not dropped.
  FanId FanOf(PartId corner);
  // The corners of a fan, in order around the vertex.
  [[nodiscard]] const std::vector<PartId>& CornersOf(FanId fan) const { return fans_[fan].corners; }
  // The position of the fan's vertex, in index space: that of its first corner, by the order of
  // cells.
  math::Vec3f PositionOf(FanId fan);
  // The number among the fans of one position, from 0.
  std::uint8_t CopyOf(FanId fan);

  // Returns the copy number of the vertex in the middle of a part; not set if it has none.
  // REQUIRES: the part's piece is not dropped, and belongs to one of the block's own cells.
  static constexpr std::uint8_t kFirstMiddle = 128;
  std::optional<std::uint8_t> MiddleOf(PartId part);

  // True if another piece has the vertices of both corners, too. REQUIRES: as MiddleOf, for two
  // corners of one piece; one of them at least is not plain.
  bool MeetElsewhere(PartId a, PartId b);
  // Returns the copy number of a vertex at the center of the piece of a corner, which its block
  // alone has. REQUIRES: the corner is not plain.
  static constexpr std::uint8_t kFirstCenter = 192;
  std::uint8_t CenterOf(PartId corner);

 private:
  using Rank = Seams::Rank;
  // A vertex of the mesh: 0 and a vertex, or 1 and a fan.
  using Final = std::pair<int, std::uint32_t>;
  using Position = std::array<float, 3>;

  struct Fan {
    std::vector<PartId> corners;
    bool is_closed = false;
    PartId first = 0;  // of the lowest rank
    int copy = -1;     // -1: not asked for
  };

  Rank EdgeRankOf(PartId part);
  Final FinalOf(PartId corner);
  // Returns the fans whose position this is, by the rank of their first corners.
  const std::vector<FanId>& FansAt(math::Vec3f position);
  // Returns the present cells that have a position in them or on their border.
  [[nodiscard]] std::vector<math::Index3> CellsAt(const math::Vec3f& position) const;
  // Returns the outgoing parts of a fan, each with the corner at its other end; of an open fan also
  // the part that ends it.
  std::vector<std::pair<PartId, PartId>> SpokesOf(FanId fan);

  // The sum of the places of a piece's corners.
  math::Vec3d TriplePlaceOf(PieceId piece);
  // Returns the edges between fans at a position and a place, by rank, but for the first of those
  // that join the same two fans.
  std::vector<Rank> LaterEdges(const math::Vec3f& near, const math::Vec3d& far);

  const BlockField& field_;
  const VertexPool& pool_;
  SolidComplex& complex_;
  Seams& seams_;
  std::vector<Fan> fans_;
  absl::flat_hash_map<PartId, FanId> fan_of_corner_;
  std::vector<char> plain_;  // by vertex: 0 not asked for, 1 plain, 2 not
  absl::flat_hash_map<Position, std::vector<FanId>> fans_at_;
};

}  // namespace isoscope::solid

#endif  // ISOSCOPE_CORE_SOLID_SURFACE_FANS_H_
