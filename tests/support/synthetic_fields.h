// Generated volumes: tests, benchmarks and demonstrations.

#ifndef ISOSCOPE_TESTS_SUPPORT_SYNTHETIC_FIELDS_H_
#define ISOSCOPE_TESTS_SUPPORT_SYNTHETIC_FIELDS_H_

#include <cstdint>
#include <functional>
#include <string>

#include "core/math/vec.h"
#include "core/volume/scalar_type.h"

namespace isoscope::testing {

// A field over the cube [-1, 1]^3; sample index i of n on an axis lies at -1 + 2 i / (n - 1).
using Field = std::function<double(const math::Vec3d&)>;

// radius - |p|: inside is >= 0.
Field SphereField(double radius);
// minor_radius minus the distance to the circle of major_radius in the z = 0 plane.
Field TorusField(double major_radius, double minor_radius);
// sin ax cos ay + sin ay cos az + sin az cos ax, with a = pi * periods.
Field GyroidField(double periods);
// Source: Marschner and Lobb 1994, "An evaluation of reconstruction filters for volume rendering".
Field MarschnerLobbField(double frequency, double alpha);
// A sum of `mode_count` random plane waves with wave numbers up to `max_wave_number` and amplitudes
// that fall with it: a smooth random field with many sheets. Seeded; the same on every machine up
// to the rounding of sin and cos.
Field RandomField(std::uint64_t seed, int mode_count, double max_wave_number);

// Samples `field` as [z][y][x], x fastest, of `type`: value = offset + scale * field, for integer
// types rounded to nearest and clamped. dims >= 2 on each axis.
std::string SampleField(const Field& field, const math::Index3& dims, volume::ScalarType type,
                        double scale, double offset);
// White noise over [0, max_value], of `type`; integer types get whole numbers, so ties are common.
std::string SampleNoise(std::uint64_t seed, const math::Index3& dims, volume::ScalarType type,
                        double max_value);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_SYNTHETIC_FIELDS_H_
