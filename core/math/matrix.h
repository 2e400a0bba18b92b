// 3x3 and 4x4 matrices of doubles, column-major, acting on column vectors. A matrix is named after
// its spaces, output first: clip_from_world * world_from_index = clip_from_index.

#ifndef ISOSCOPE_CORE_MATH_MATRIX_H_
#define ISOSCOPE_CORE_MATH_MATRIX_H_

#include <array>
#include <cstddef>

#include "core/math/vec.h"

namespace isoscope::math {

struct Vec4d {
  double x = 0, y = 0, z = 0, w = 0;
};

// columns[c][r].
struct Mat3d {
  std::array<Vec3d, 3> columns{Vec3d{1, 0, 0}, Vec3d{0, 1, 0}, Vec3d{0, 0, 1}};

  friend constexpr bool operator==(const Mat3d&, const Mat3d&) = default;
};

constexpr Vec3d operator*(const Mat3d& m, const Vec3d& v) {
  return m.columns[0] * v.x + m.columns[1] * v.y + m.columns[2] * v.z;
}
constexpr double Determinant(const Mat3d& m) {
  return Dot(m.columns[0], Cross(m.columns[1], m.columns[2]));
}
constexpr Mat3d Transposed(const Mat3d& m) {
  const auto& c = m.columns;
  return {{Vec3d{c[0].x, c[1].x, c[2].x}, Vec3d{c[0].y, c[1].y, c[2].y},
           Vec3d{c[0].z, c[1].z, c[2].z}}};
}
// REQUIRES: Determinant(m) != 0.
constexpr Mat3d Inverted(const Mat3d& m) {
  const auto& c = m.columns;
  const double scale = 1.0 / Determinant(m);
  return Transposed(
      {{Cross(c[1], c[2]) * scale, Cross(c[2], c[0]) * scale, Cross(c[0], c[1]) * scale}});
}

struct Mat4d {
  // m[column * 4 + row].
  std::array<double, 16> m{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

  constexpr double& At(std::size_t row, std::size_t column) { return m[column * 4 + row]; }
  [[nodiscard]] constexpr double At(std::size_t row, std::size_t column) const {
    return m[column * 4 + row];
  }

  friend constexpr bool operator==(const Mat4d&, const Mat4d&) = default;
};

constexpr Mat4d operator*(const Mat4d& a, const Mat4d& b) {
  Mat4d product;
  for (std::size_t column = 0; column < 4; ++column) {
    for (std::size_t row = 0; row < 4; ++row) {
      double sum = 0;
      for (std::size_t k = 0; k < 4; ++k) {
        sum += a.At(row, k) * b.At(k, column);
      }
      product.At(row, column) = sum;
    }
  }
  return product;
}

constexpr Vec4d operator*(const Mat4d& m, const Vec4d& v) {
  return {m.At(0, 0) * v.x + m.At(0, 1) * v.y + m.At(0, 2) * v.z + m.At(0, 3) * v.w,
          m.At(1, 0) * v.x + m.At(1, 1) * v.y + m.At(1, 2) * v.z + m.At(1, 3) * v.w,
          m.At(2, 0) * v.x + m.At(2, 1) * v.y + m.At(2, 2) * v.z + m.At(2, 3) * v.w,
          m.At(3, 0) * v.x + m.At(3, 1) * v.y + m.At(3, 2) * v.z + m.At(3, 3) * v.w};
}

// Transforms a point by a matrix whose last row is (0, 0, 0, 1).
constexpr Vec3d TransformPoint(const Mat4d& m, const Vec3d& p) {
  const Vec4d out = m * Vec4d{p.x, p.y, p.z, 1};
  return {out.x, out.y, out.z};
}
// Transforms a direction (no translation).
constexpr Vec3d TransformVector(const Mat4d& m, const Vec3d& v) {
  const Vec4d out = m * Vec4d{v.x, v.y, v.z, 0};
  return {out.x, out.y, out.z};
}
// The affine matrix x -> linear * x + offset.
constexpr Mat4d MakeAffine(const Mat3d& linear, const Vec3d& offset) {
  Mat4d m;
  for (std::size_t column = 0; column < 3; ++column) {
    m.At(0, column) = linear.columns[column].x;
    m.At(1, column) = linear.columns[column].y;
    m.At(2, column) = linear.columns[column].z;
  }
  m.At(0, 3) = offset.x;
  m.At(1, 3) = offset.y;
  m.At(2, 3) = offset.z;
  return m;
}

}  // namespace isoscope::math

#endif  // ISOSCOPE_CORE_MATH_MATRIX_H_
