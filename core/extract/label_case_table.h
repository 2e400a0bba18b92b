// The marching cubes table of labels: as case_table.h, but with another rule for ambiguous faces,
// by which the surfaces of two labels that meet in a cell are the same triangles.
//
// An ambiguous face has two diagonals. The one that lacks the face's lowest corner is joined: its
// ends are connected across the face, be they inside or outside. So the segments of a face follow
// from its signs alone. If inside and outside change places, they stay where they are, with
// opposite directions. So do the triangles of a cell (docs/numerics.md, "Labels").

#ifndef ISOSCOPE_CORE_EXTRACT_LABEL_CASE_TABLE_H_
#define ISOSCOPE_CORE_EXTRACT_LABEL_CASE_TABLE_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/extract/case_table.h"

namespace isoscope::extract {

inline constexpr int kMaxLabelTrianglesPerCell = 6;

// Immutable; thread-safe.
struct LabelCaseTable {
  // The first kMaxTrianglesPerCell triangles of each case: all, except in 14 of the 256 cases.
  CaseTable first_triangles;
  // By case: whether there is one more, and its edges and lanes.
  std::array<bool, 256> has_last{};
  std::array<std::array<std::uint8_t, 3>, 256> last_edges{};
  std::array<std::array<std::uint8_t, 3>, 256> last_lanes{};

  // Returns the number of triangles of a case, and the edges of one of them.
  // REQUIRES: case_number < 256, triangle < TriangleCountOf(case_number).
  [[nodiscard]] std::size_t TriangleCountOf(std::size_t case_number) const {
    return std::size_t{first_triangles.triangle_counts[case_number]} +
           (has_last[case_number] ? 1 : 0);
  }
  [[nodiscard]] std::span<const std::uint8_t, 3> EdgesOf(std::size_t case_number,
                                                         std::size_t triangle) const {
    return triangle < kMaxTrianglesPerCell
               ? std::span<const std::uint8_t, 3>(
                     first_triangles.edges[case_number].data() + 3 * triangle, 3)
               : std::span<const std::uint8_t, 3>(last_edges[case_number]);
  }
};

// Returns the table, which is made on first use. Thread-safe.
const LabelCaseTable& GetLabelCaseTable();

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_LABEL_CASE_TABLE_H_
