// The solid of a cell is a closed polyhedron: the triangles of marching cubes, and on each face the
// polygons of what is inside there. All sides fit, because the segments of a face follow from its
// signs alone.
//
//   1. AddSurface, AddFace: the polyhedron.
//   2. CutBy: each half-space cuts all polygons. A polygon that loses a part has one new side on
//      the plane. LinkSides makes caps of these sides, so that the polyhedron is closed again.
//   3. Collect: triangles for the mesh; for the faces between two cells their sides alone, which
//      tell how the pieces of both cells join (surface_fans.h).
//
// Both cells of a face cut the same polygons in the same direction, so they agree on every vertex.
//
// Example: a cell with all corners inside, cut by x >= 0.3: four faces lose a part and have one
// side on the plane each; face x = 0 is gone. The four sides make one cap.

#include "core/solid/cell_pieces.h"

#include <algorithm>

#include "core/extract/case_table.h"
#include "core/extract/label_case_table.h"
#include "core/solid/face_polygons.h"

namespace isoscope::solid {
namespace {

Points Reversed(const Points& points) { return {points.rbegin(), points.rend()}; }

}  // namespace

void CellCutter::Make(const math::Index3& at, CellPieces* cell) {
  cell->pieces.clear();
  cell->portals.clear();
  cell->is_cut = false;
  const view::Clipper::Side side = clipper_.SideOf({at, at + math::Index3{1, 1, 1}});
  if (side == view::Clipper::Side::kOutside) {
    cell->is_cut = true;
    return;
  }
  cell->is_cut = side == view::Clipper::Side::kCut;
  const SampleIndex lowest = field_.IndexOf(at);
  surface_.clear();
  AddSurface(lowest, field_.CaseOf(lowest));
  for (std::size_t face = 0; face < faces_.size(); ++face) {
    faces_[face].behind = field_.StateOfCell(CellBehind(at, face));
    faces_[face].polygons.clear();
    AddFace(lowest, face);
  }
  caps_.assign(clipper_.half_spaces().size(), {});
  if (cell->is_cut) {
    for (std::size_t i = 0; i < clipper_.half_spaces().size(); ++i) {
      CutBy(i);
    }
  }
  Collect(cell);
}

void CellCutter::AddSurface(SampleIndex lowest, unsigned inside) {
  const auto add = [&](const auto& edges) {
    Points corners;
    for (std::size_t i = 0; i < 3; ++i) {
      const int edge = edges[i];
      const auto lower = static_cast<std::size_t>(extract::CornersOfEdge(edge).lower);
      corners.push_back(pool_.OnEdge(lowest + (lower & 1) + field_.StrideOf(1) * (lower >> 1 & 1) +
                                         field_.StrideOf(2) * (lower >> 2),
                                     edge / 4));
    }
    surface_.push_back(std::move(corners));
  };
  if (field_.rule().has_labels()) {
    const extract::LabelCaseTable& table = extract::GetLabelCaseTable();
    for (std::size_t i = 0; i < table.TriangleCountOf(inside); ++i) {
      add(table.EdgesOf(inside, i));
    }
    return;
  }
  const extract::CaseTable& table = extract::GetCaseTable();
  for (std::size_t i = 0; i < table.triangle_counts[inside]; ++i) {
    add(table.edges[inside].data() + 3 * i);
  }
}

void CellCutter::AddFace(SampleIndex lowest, std::size_t face) {
  const auto axis = static_cast<int>(face / 2);
  const int u = (axis + 1) % 3;
  const int v = (axis + 2) % 3;
  const SampleIndex base = lowest + (face % 2 == 0 ? 0 : field_.StrideOf(axis));
  const std::array<SampleIndex, 4> corners{base, base + field_.StrideOf(u),
                                           base + field_.StrideOf(u) + field_.StrideOf(v),
                                           base + field_.StrideOf(v)};
  const FacePolygons& polygons =
      FacePolygonsOf(InsideOfFace(field_.CaseOf(lowest), face), field_.rule().has_labels());
  for (std::size_t i = 0; i < polygons.count; ++i) {
    const FacePolygon& polygon = polygons.polygons[i];
    Points points;
    for (std::size_t k = 0; k < polygon.size; ++k) {
      const std::size_t point = polygon.points[k];
      if (point < FacePolygon::kFirstEdge) {
        points.push_back(pool_.AtSample(corners[point]));
        continue;
      }
      // Edges 0 and 2 run along u, 1 and 3 along v; edges 2 and 3 begin at their upper end.
      const std::size_t edge = point - FacePolygon::kFirstEdge;
      const SampleIndex lower = edge < 2 ? corners[edge] : corners[(edge + 1) % 4];
      points.push_back(pool_.OnEdge(lower, edge % 2 == 0 ? u : v));
    }
    faces_[face].polygons.push_back(std::move(points));
  }
}

void CellCutter::CutBy(std::size_t half_space) {
  const Cut cut{.half_space = &clipper_.half_spaces()[half_space],
                .rank = static_cast<int>(half_space) + 1,
                .on_border = closes_ ? Cut::OnBorder::kInside : Cut::OnBorder::kBorder};
  sides_.clear();
  kept_.clear();
  for (const Points& triangle : surface_) {
    CutPolygon(triangle, cut, &pool_, &kept_, &sides_);
  }
  surface_.clear();
  for (const Points& polygon : kept_) {  // of three or four corners
    for (std::size_t i = 2; i < polygon.size(); ++i) {
      surface_.push_back({polygon[0], polygon[i - 1], polygon[i]});
    }
  }
  for (std::size_t face = 0; face < faces_.size(); ++face) {
    const std::size_t first_side = sides_.size();
    kept_.clear();
    for (const Points& polygon : faces_[face].polygons) {
      CutPolygon(polygon, cut, &pool_, &kept_, &sides_);
    }
    faces_[face].polygons.swap(kept_);
    for (std::size_t i = first_side; i < sides_.size() && face % 2 == 0; ++i) {
      std::swap(sides_[i].from, sides_[i].to);  // seen from the other side
    }
  }
  if (!closes_) {
    return;
  }
  for (std::size_t i = 0; i < half_space; ++i) {
    kept_.clear();
    for (const Points& polygon : caps_[i]) {
      CutPolygon(polygon, cut, &pool_, &kept_, &sides_);
    }
    caps_[i].swap(kept_);
  }
  caps_[half_space] = LinkSides(std::move(sides_));
  // A cap need not be convex: triangles are cut at most twice.
  std::vector<Corners> triangles;
  for (const Points& polygon : caps_[half_space]) {
    SplitPolygon(polygon, -cut.half_space->normal, pool_, &triangles);
  }
  caps_[half_space].clear();
  for (const Corners& corners : triangles) {
    caps_[half_space].emplace_back(corners.begin(), corners.end());
  }
  sides_ = {};
}

void CellCutter::Collect(CellPieces* cell) {
  std::vector<Corners> triangles;
  const auto add = [&](Tag tag) {
    for (std::size_t i = 0; i < triangles.size(); ++i) {
      cell->pieces.push_back(
          {.corners = triangles[i], .tag = tag, .index = static_cast<std::uint16_t>(i)});
    }
    triangles.clear();
  };
  for (const Points& corners : surface_) {
    triangles.push_back({corners[0], corners[1], corners[2]});
  }
  add(kSurfaceTag);
  for (std::size_t face = 0; face < faces_.size(); ++face) {
    for (const Points& polygon : faces_[face].polygons) {
      const Points points = face % 2 == 0 ? Reversed(polygon) : polygon;
      if (faces_[face].behind == CellState::kAbsent) {
        if (closes_) {
          SplitPolygon(points, OutwardOf(face), pool_, &triangles);
        }
        continue;
      }
      for (std::size_t i = 0; i < points.size(); ++i) {
        cell->portals.push_back({.from = points[i],
                                 .to = points[(i + 1) % points.size()],
                                 .face = static_cast<std::uint8_t>(face)});
      }
    }
    add(ClosingTag(face));
  }
  for (std::size_t i = 0; i < caps_.size(); ++i) {
    for (const Points& polygon : caps_[i]) {
      SplitPolygon(polygon, -clipper_.half_spaces()[i].normal, pool_, &triangles);
    }
    add(CapTag(i));
  }
}

}  // namespace isoscope::solid
