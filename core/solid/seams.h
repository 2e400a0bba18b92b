// Pieces whose corners lie on one line have no area, either: needles. A mesh without them must join
// what lies on their sides.
//
// Needles that are joined lie on one line. Their border goes along the line and back. Each step of
// it, from one corner's place to the next on the line, is joined with the step that comes back: the
// border is zipped. So the side of a piece that was joined with a needle becomes several parts,
// each joined with a part of another side. Their ends are new corners of the piece.
//
// Example: a needle a m b, with m between a and b. The piece on its side a b gets the corner m; the
// part a m of its side is joined with the piece on the needle's side a m, the part m b likewise.

#ifndef ISOSCOPE_CORE_SOLID_SEAMS_H_
#define ISOSCOPE_CORE_SOLID_SEAMS_H_

#include <cstdint>
#include <tuple>
#include <vector>

#include "absl/container/flat_hash_map.h"

#include "core/solid/block_field.h"
#include "core/solid/solid_complex.h"
#include "core/solid/vertex_pool.h"

namespace isoscope::solid {

// A part of a side of a piece, and the corner at its start: 64 * side + its number on the side.
using PartId = std::uint64_t;
constexpr PartId FirstPartOf(SideId side) { return PartId{64} * side; }
constexpr SideId SideOfPart(PartId part) { return static_cast<SideId>(part / 64); }
constexpr std::size_t NumberOfPart(PartId part) { return part % 64; }

// Reused for many blocks. Thread-compatible.
class Seams {
 public:
  Seams(const BlockField* field, const VertexPool* pool, SolidComplex* complex)
      : field_(*field), pool_(*pool), complex_(*complex) {}

  void Begin();

  // True if a mesh does not have the piece: it is flat, or a needle.
  bool IsDropped(PieceId piece);

  // REQUIRES for all below: the piece of the side or part is not dropped.
  std::size_t PartCountOf(SideId side);
  VertexId VertexOf(PartId part);
  // The part that a part is joined with; kOpen if there is none.
  static constexpr PartId kOpen = 0xffffffffffffffff;
  PartId PartnerOf(PartId part);
  // The next part of the piece, around it, and the one before.
  PartId NextOf(PartId part);
  PartId BeforeOf(PartId part);

  // Orders parts of all blocks' pieces alike: by cell in the volume, tag, index, side, part.
  using Rank = std::tuple<std::int64_t, Tag, std::uint16_t, std::size_t, std::size_t>;
  [[nodiscard]] Rank RankOf(PartId part) const;

 private:
  enum class State : char { kUnasked, kKept, kDropped };
  // The parts that a seam makes of a side.
  struct Split {
    std::vector<VertexId> inner;   // corners between its ends
    std::vector<PartId> partners;  // of its parts
  };
  // A step of the border of needles along their line.
  struct Step {
    std::size_t from = 0;  // places in their order on the line
    std::size_t to = 0;
    std::size_t border = 0;  // the side of a needle that it belongs to
    std::size_t number = 0;  // on that side
  };

  // Drops a needle and all that are joined with it.
  void Drop(PieceId needle);
  // Zips one loop of sides of needles. `corners`: of the needles, by rank
  void Zip(const std::vector<SideId>& loop, const std::vector<CornerId>& corners);
  const Split* SplitOf(SideId side);

  const BlockField& field_;
  const VertexPool& pool_;
  SolidComplex& complex_;
  std::vector<State> states_;  // by piece
  absl::flat_hash_map<SideId, Split> splits_;
};

}  // namespace isoscope::solid

#endif  // ISOSCOPE_CORE_SOLID_SEAMS_H_
