// Three-component vectors: plain data, operations by value.

#ifndef ISOSCOPE_CORE_MATH_VEC_H_
#define ISOSCOPE_CORE_MATH_VEC_H_

#include <cmath>
#include <cstdint>

namespace isoscope::math {

template <typename T>
struct Vec3 {
  T x{};
  T y{};
  T z{};

  constexpr T& operator[](int axis) { return axis == 0 ? x : axis == 1 ? y : z; }
  constexpr const T& operator[](int axis) const { return axis == 0 ? x : axis == 1 ? y : z; }

  friend constexpr bool operator==(const Vec3&, const Vec3&) = default;
};

using Vec3d = Vec3<double>;
using Vec3f = Vec3<float>;
// A position or a size in samples, cells or blocks.
using Index3 = Vec3<std::int64_t>;

template <typename T>
constexpr Vec3<T> operator+(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <typename T>
constexpr Vec3<T> operator-(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <typename T>
constexpr Vec3<T> operator-(const Vec3<T>& a) {
  return {-a.x, -a.y, -a.z};
}
template <typename T>
constexpr Vec3<T> operator*(const Vec3<T>& a, T s) {
  return {a.x * s, a.y * s, a.z * s};
}
template <typename T>
constexpr T Dot(const Vec3<T>& a, const Vec3<T>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <typename T>
constexpr Vec3<T> Cross(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <typename T>
T Length(const Vec3<T>& a) {
  return std::sqrt(Dot(a, a));
}
// REQUIRES: Length(a) > 0.
template <typename T>
Vec3<T> Normalized(const Vec3<T>& a) {
  return a * (T{1} / Length(a));
}
template <typename T>
bool IsFinite(const Vec3<T>& a) {
  return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z);
}
// The number of elements of a box with these dimensions.
constexpr std::int64_t Volume(const Index3& dims) { return dims.x * dims.y * dims.z; }

}  // namespace isoscope::math

#endif  // ISOSCOPE_CORE_MATH_VEC_H_
