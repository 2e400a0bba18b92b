// Counter-based random numbers. The n-th value of a seed is a pure function of (seed, n), so
// neither the thread that draws it nor the order of drawing matters.

#ifndef ISOSCOPE_CORE_BASE_RANDOM_H_
#define ISOSCOPE_CORE_BASE_RANDOM_H_

#include <cstdint>

namespace isoscope::base {

// The finalizer of SplitMix64. Source: Steele, Lea, Flood 2014, "Fast splittable pseudorandom
// number generators".
constexpr std::uint64_t Mix64(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

// Returns the `counter`-th 64-bit value of `seed`.
constexpr std::uint64_t RandomBits(std::uint64_t seed, std::uint64_t counter) {
  return Mix64(Mix64(seed) ^ (counter * 0xd1342543de82ef95u));
}

// Returns the `counter`-th value of `seed`, uniform in [0, 1) with 53 bits.
constexpr double RandomUnit(std::uint64_t seed, std::uint64_t counter) {
  return static_cast<double>(RandomBits(seed, counter) >> 11) * 0x1.0p-53;
}

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_RANDOM_H_
