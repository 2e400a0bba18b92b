// A digest of samples and grid (docs/format/dataset.md). It does not depend on blocks, shards, or
// the portions in which a volume passes through memory.

#ifndef ISOSCOPE_CORE_PARTITION_SAMPLES_DIGEST_H_
#define ISOSCOPE_CORE_PARTITION_SAMPLES_DIGEST_H_

#include <array>
#include <cstdint>
#include <memory>
#include <string>

#include "absl/strings/string_view.h"

#include "core/volume/grid_geometry.h"
#include "core/volume/scalar_type.h"

namespace isoscope::partition {

// A number below 2^256, lowest word first.
using DigestSum = std::array<std::uint64_t, 4>;

// Returns a + b modulo 2^256.
DigestSum SumOf(const DigestSum& a, const DigestSum& b);

// A sum of the digests of rows: rows may come in any order, and the sums of several threads may be
// added. Two different volumes have the same digest with a chance of 2^-128, unless somebody
// searches for such a pair. Thread-compatible.
class SamplesDigest {
 public:
  SamplesDigest();
  ~SamplesDigest();
  SamplesDigest(const SamplesDigest&) = delete;
  SamplesDigest& operator=(const SamplesDigest&) = delete;

  // Adds row (y, z): all its samples, x ascending, little-endian. Each row of the volume once.
  void AddRow(std::int64_t y, std::int64_t z, absl::string_view samples);
  // Adds the rows of `other`.
  void Add(const SamplesDigest& other);

  // The sum of the rows so far, and adding one.
  [[nodiscard]] const DigestSum& sum() const { return sum_; }
  void AddSum(const DigestSum& sum) { sum_ = SumOf(sum_, sum); }

  // 32 lower-case hex digits.
  [[nodiscard]] std::string Finish(const volume::GridGeometry& geometry,
                                   volume::ScalarType type) const;

 private:
  struct Hash;  // OpenSSL's

  DigestSum sum_{};
  std::unique_ptr<Hash> hash_;  // made for the first row
};

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_SAMPLES_DIGEST_H_
