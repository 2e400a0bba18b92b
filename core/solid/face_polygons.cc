#include "core/solid/face_polygons.h"

#include "core/base/check.h"

namespace isoscope::solid {
namespace {

constexpr std::size_t kCorners = 4;

void AddPoint(std::size_t point, FacePolygon* polygon) {
  polygon->points[polygon->size++] = static_cast<std::uint8_t>(point);
}

FacePolygons MakePolygons(unsigned inside, bool has_labels) {
  FacePolygons face;
  const auto is_inside = [&](std::size_t corner) { return (inside >> corner % kCorners & 1) != 0; };
  if (inside == 0xf) {
    face.count = 1;
    face.polygons[0] = {.size = kCorners, .points = {0, 1, 2, 3}};
    return face;
  }
  // Two diagonal inside corners are joined if the face's lowest corner is none of them: one
  // polygon around both.
  const bool is_joined = has_labels && inside == 0b1010;
  for (std::size_t i = 0; i < kCorners; ++i) {
    if (is_inside(i) || !is_inside(i + 1)) {
      continue;
    }
    FacePolygon& polygon = face.polygons[is_joined ? 0 : face.count];
    face.count = is_joined ? 1 : face.count + 1;
    AddPoint(FacePolygon::kFirstEdge + i, &polygon);
    std::size_t corner = i + 1;
    for (; is_inside(corner); ++corner) {
      AddPoint(corner % kCorners, &polygon);
    }
    AddPoint(FacePolygon::kFirstEdge + (corner - 1) % kCorners, &polygon);
  }
  return face;
}

std::array<std::array<FacePolygons, 16>, 2> MakeAllPolygons() {
  std::array<std::array<FacePolygons, 16>, 2> all;
  for (unsigned inside = 0; inside < 16; ++inside) {
    all[0][inside] = MakePolygons(inside, /*has_labels=*/false);
    all[1][inside] = MakePolygons(inside, /*has_labels=*/true);
  }
  return all;
}

}  // namespace

const FacePolygons& FacePolygonsOf(unsigned inside, bool has_labels) {
  ISOSCOPE_DCHECK(inside < 16);
  static const auto all = MakeAllPolygons();
  return all[has_labels ? 1 : 0][inside];
}

unsigned InsideOfFace(unsigned cell_case, std::size_t face) {
  const std::size_t axis = face / 2;
  const unsigned u = 1U << (axis + 1) % 3;
  const unsigned v = 1U << (axis + 2) % 3;
  const unsigned base = static_cast<unsigned>(face % 2) << axis;
  return (cell_case >> base & 1) | (cell_case >> (base | u) & 1) << 1 |
         (cell_case >> (base | u | v) & 1) << 2 | (cell_case >> (base | v) & 1) << 3;
}

}  // namespace isoscope::solid
