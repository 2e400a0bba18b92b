// Generated fields of any size, row by row: test volumes for `isoscope generate`.

#ifndef ISOSCOPE_CORE_SYNTHETIC_VOLUME_GENERATOR_H_
#define ISOSCOPE_CORE_SYNTHETIC_VOLUME_GENERATOR_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "absl/status/statusor.h"

#include "core/math/vec.h"
#include "core/synthetic/generated_regions.h"
#include "core/volume/label.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// The known fields. Coordinates: the longest axis spans [-1, 1], the others a part of it around 0,
// so that a sample is as wide as it is high.
enum class GeneratedField {
  kRandom,         // a sum of random plane waves whose energy falls with the wave number
  kGyroid,         // sin ax cos ay + sin ay cos az + sin az cos ax, a = pi * periods
  kMarschnerLobb,  // Marschner and Lobb 1994, "An evaluation of reconstruction filters ..."
  kShells,         // (1 - cos 2 pi n r) / 2 within the unit ball, 0 outside: nested spheres
  kMixing,         // two fluids, one above the other, stirred where they meet: bubbles and spikes
  kLabels,         // a ball of labelled regions that touch each other (GeneratedRegions)
};

struct GeneratorParameters {
  GeneratedField field = GeneratedField::kRandom;
  std::uint64_t seed = 1;  // random, mixing, labels

  // Random, mixing: plane waves of wave numbers (half-periods over the longest axis) from 2 to
  // max_wave_number, spread evenly over their logarithm, with energy E(k) ~ k^-spectrum_exponent.
  int wave_count = 64;           // 1 .. kMaxWaves
  double max_wave_number = 24;   // >= 2
  double spectrum_exponent = 3;  // finite

  double periods = 8;      // gyroid
  double frequency = 6;    // marschner-lobb
  double alpha = 0.25;     // marschner-lobb, > 0
  int shell_count = 8;     // shells, >= 1: 2 * n nested spheres at the middle value
  double thickness = 0.4;  // mixing, > 0: half the height of the stirred layer
  int region_count = 12;   // labels, 2 .. GeneratedRegions::kMaxRegions

  static constexpr int kMaxWaves = 4096;
};

// A generated value f lies in [0, 1] (beyond it is clamped) and is scaled to the sample type:
// floats hold f, integers lowest + f * (highest - lowest), rounded to nearest. Random and gyroid
// are 0.5 where the sum of waves is 0; f = 0.5 + sum / 7 with a sum of unit variance, 0.5 + g / 3.
// Labels are not scaled: samples of every type are 0, 1, ... region_count.
//
// The same bytes for the same parameters for any number of threads and order of calls (on one
// machine; another may round sines differently). Immutable, thread-safe.
class VolumeGenerator {
 public:
  // INVALID_ARGUMENT: parameters out of range, dims below 2 or more samples than a file holds.
  // Memory: 8 * wave_count bytes for each sample of the three axes' sum, half a MiB otherwise.
  static absl::StatusOr<std::unique_ptr<VolumeGenerator>> Make(
      const GeneratorParameters& parameters, const math::Index3& dims, volume::ScalarType type);

  [[nodiscard]] const math::Index3& dims() const { return dims_; }
  [[nodiscard]] volume::ScalarType type() const { return type_; }
  // Names and colours of the values; empty for fields other than labels.
  [[nodiscard]] std::vector<volume::Label> labels() const;
  // Rows of the volume: row = z * dims.y + y.
  [[nodiscard]] std::int64_t row_count() const { return dims_.y * dims_.z; }

  // Writes rows [begin, end), x fastest, little-endian, to `out`.
  // REQUIRES: 0 <= begin <= end <= row_count().
  void FillRows(std::int64_t begin, std::int64_t end, char* out) const;

 private:
  // One wave on one axis: the cosine and sine of its phase at each sample.
  struct Phases {
    std::vector<float> cosine;  // [wave][sample]
    std::vector<float> sine;
  };

  VolumeGenerator(const GeneratorParameters& parameters, const math::Index3& dims,
                  volume::ScalarType type);

  void MakeWaves();
  void MakeRadialTable();
  [[nodiscard]] double Coordinate(int axis, std::int64_t i) const;

  // Each fills `count` values of rows [row, row + count), dims_.x floats each.
  void FillValues(std::int64_t row, std::int64_t count, float* values) const;
  void FillWaves(std::int64_t row, std::int64_t count, float* values) const;
  void FillMixing(std::int64_t row, std::int64_t count, float* values) const;
  void FillGyroid(std::int64_t row, float* values) const;
  void FillRadial(std::int64_t row, float* values) const;
  void FillLabels(std::int64_t row, float* values) const;
  [[nodiscard]] float AtRadius(float radius) const;

  const GeneratorParameters parameters_;
  const math::Index3 dims_;
  const volume::ScalarType type_;

  Phases along_x_;
  Phases along_y_;  // amplitude included
  Phases along_z_;
  std::vector<float> radial_;  // by radius, kRadialSteps + 2 of them
  std::optional<GeneratedRegions> regions_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SYNTHETIC_VOLUME_GENERATOR_H_
