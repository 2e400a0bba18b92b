#include "core/extract/case_table.h"

#include <cstddef>
#include <limits>
#include <vector>

#include "core/base/check.h"

namespace isoscope::extract {
namespace {

constexpr int kEdgeCount = 12;
constexpr int kNone = -1;

int EdgeBetween(int corner_a, int corner_b) {
  for (int edge = 0; edge < kEdgeCount; ++edge) {
    const EdgeCorners corners = CornersOfEdge(edge);
    if ((corners.lower == corner_a && corners.upper == corner_b) ||
        (corners.lower == corner_b && corners.upper == corner_a)) {
      return edge;
    }
  }
  base::CheckFailed(__FILE__, __LINE__, "corners are not neighbours");
}

// The corners of the face `axis` = `side`, counter-clockwise seen from outside the cell.
std::array<int, 4> FaceCorners(int axis, int side) {
  const int u = 1 << (axis + 1) % 3;
  const int v = 1 << (axis + 2) % 3;
  const int base = side << axis;
  // u x v points along +axis, which is outwards on side 1.
  return side == 1 ? std::array<int, 4>{base, base | u, base | u | v, base | v}
                   : std::array<int, 4>{base, base | v, base | u | v, base | u};
}

bool ShareFace(int edge_a, int edge_b) {
  const EdgeCorners a = CornersOfEdge(edge_a);
  const EdgeCorners b = CornersOfEdge(edge_b);
  // On a face all four corners agree on the face's axis.
  const int same = ~(a.lower ^ a.upper) & ~(a.lower ^ b.lower) & ~(a.lower ^ b.upper);
  return (same & 7) != 0;
}

// Squared distance between the middles of two edges, in quarter cells.
int SquaredDistance(int edge_a, int edge_b) {
  const EdgeCorners a = CornersOfEdge(edge_a);
  const EdgeCorners b = CornersOfEdge(edge_b);
  int sum = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const int difference = (a.lower >> axis & 1) + (a.upper >> axis & 1) - (b.lower >> axis & 1) -
                           (b.upper >> axis & 1);
    sum += difference * difference;
  }
  return sum;
}

// next[e]: the crossed edge that follows e on the boundary of the surface, or kNone.
//
// On a face, walked counter-clockwise from outside, every run of inside corners is cut off by one
// segment, from the edge where the walk enters the run to the edge where it leaves it. Two runs
// (the ambiguous face) are cut off one by one: inside corners are never joined across a face. An
// edge is entered on one of its faces and left on the other, so the segments link up to closed
// loops.
std::array<int, kEdgeCount> LinkSegments(int case_number) {
  std::array<int, kEdgeCount> next{};
  next.fill(kNone);
  const auto inside = [&](int corner) { return (case_number >> corner & 1) != 0; };
  for (int axis = 0; axis < 3; ++axis) {
    for (int side = 0; side < 2; ++side) {
      const std::array<int, 4> corners = FaceCorners(axis, side);
      for (std::size_t i = 0; i < 4; ++i) {
        if (inside(corners[i]) || !inside(corners[(i + 1) % 4])) {
          continue;
        }
        std::size_t last = (i + 1) % 4;
        while (inside(corners[(last + 1) % 4])) {
          last = (last + 1) % 4;
        }
        const int enter = EdgeBetween(corners[i], corners[(i + 1) % 4]);
        const int leave = EdgeBetween(corners[last], corners[(last + 1) % 4]);
        next[static_cast<std::size_t>(enter)] = leave;
      }
    }
  }
  return next;
}

// Triangulates a loop so that no diagonal lies in a face of the cell and the sum of the squared
// diagonals is least. A diagonal in a face could also be one of the neighbour's: an edge with four
// triangles.
class LoopTriangulator {
 public:
  explicit LoopTriangulator(const std::vector<int>& loop)
      : loop_(loop), size_(loop.size()), cost_(size_ * size_, 0), split_(size_ * size_, 0) {
    for (std::size_t length = 2; length < size_; ++length) {
      for (std::size_t first = 0; first + length < size_; ++first) {
        Solve(first, first + length);
      }
    }
  }

  // Appends three edges for each triangle.
  void Append(std::vector<int>* triangles) const { Append(0, size_ - 1, triangles); }
  [[nodiscard]] bool is_possible() const { return cost_[size_ - 1] < kForbidden; }

 private:
  static constexpr int kForbidden = 1 << 20;

  int DiagonalCost(std::size_t a, std::size_t b) const {
    if (b - a == 1 || (a == 0 && b == size_ - 1)) {
      return 0;  // a segment of the loop itself
    }
    return ShareFace(loop_[a], loop_[b]) ? kForbidden : SquaredDistance(loop_[a], loop_[b]);
  }

  void Solve(std::size_t first, std::size_t last) {
    int best = std::numeric_limits<int>::max();
    for (std::size_t middle = first + 1; middle < last; ++middle) {
      const int cost = cost_[first * size_ + middle] + cost_[middle * size_ + last] +
                       DiagonalCost(first, middle) + DiagonalCost(middle, last);
      if (cost < best) {
        best = cost;
        split_[first * size_ + last] = middle;
      }
    }
    cost_[first * size_ + last] = best;
  }

  void Append(std::size_t first, std::size_t last, std::vector<int>* triangles) const {
    if (last - first < 2) {
      return;
    }
    const std::size_t middle = split_[first * size_ + last];
    triangles->insert(triangles->end(), {loop_[first], loop_[middle], loop_[last]});
    Append(first, middle, triangles);
    Append(middle, last, triangles);
  }

  const std::vector<int>& loop_;
  const std::size_t size_;
  std::vector<int> cost_;
  std::vector<std::size_t> split_;
};

CaseTable MakeCaseTable() {
  CaseTable table;
  for (int case_number = 0; case_number < 256; ++case_number) {
    std::array<int, kEdgeCount> next = LinkSegments(case_number);
    std::vector<int> triangles;
    for (std::size_t start = 0; start < kEdgeCount; ++start) {
      std::vector<int> loop;
      for (std::size_t edge = start; next[edge] != kNone;) {
        loop.push_back(static_cast<int>(edge));
        const auto following = static_cast<std::size_t>(next[edge]);
        next[edge] = kNone;
        edge = following;
      }
      if (!loop.empty()) {
        const LoopTriangulator triangulator(loop);
        ISOSCOPE_CHECK(triangulator.is_possible());
        triangulator.Append(&triangles);
      }
    }
    ISOSCOPE_CHECK_LE(triangles.size(), std::size_t{3 * kMaxTrianglesPerCell});
    const auto row = static_cast<std::size_t>(case_number);
    table.triangle_counts[row] = static_cast<std::uint8_t>(triangles.size() / 3);
    for (std::size_t i = 0; i < triangles.size(); ++i) {
      table.edges[row][i] = static_cast<std::uint8_t>(triangles[i]);
    }
  }
  return table;
}

}  // namespace

const CaseTable& GetCaseTable() {
  static const CaseTable kTable = MakeCaseTable();
  return kTable;
}

}  // namespace isoscope::extract
