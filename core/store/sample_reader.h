// Samples of a volume that its shards do not hold, because they lie in the source (docs/format/
// dataset.md, "Index-only datasets"). core/indexed reads them.

#ifndef ISOSCOPE_CORE_STORE_SAMPLE_READER_H_
#define ISOSCOPE_CORE_STORE_SAMPLE_READER_H_

#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/units.h"
#include "core/math/vec.h"
#include "core/volume/block_layout.h"

namespace isoscope::store {

// Where the samples of level 0 are.
struct SourceSamples {
  // How the source is opened, as text by name (core/indexed/source_request.h); "path" is one.
  std::map<std::string, std::string> request;
  // Samples are read and decoded in units, and blocks are dealt out by the unit of their first
  // sample. -unit_dims < unit_origin <= 0: the first sample of the first unit.
  math::Index3 unit_origin{0, 0, 0};
  math::Index3 unit_dims{1, 1, 1};

  friend bool operator==(const SourceSamples&, const SourceSamples&) = default;
};

// The most bytes of a unit, and the most members of a request and bytes of each.
inline constexpr std::int64_t kMaxUnitBytes = 64 * base::kMiB;
inline constexpr std::size_t kMaxRequestMembers = 64;
inline constexpr std::size_t kMaxRequestBytes = std::size_t{1} << 16;

// Thread-safe.
class SampleReader {
 public:
  virtual ~SampleReader() = default;

  // Writes those stored samples of a block that lie in its unit (PartInUnit, block_overhang.h) to their
  // places among all of them, volume::StoredSizeBytes, in `out`. The caller compares their checksum.
  // Errors are those of the source, and name it; that of `cancellation` soon after it fires.
  [[nodiscard]] virtual absl::Status ReadBlock(volume::BlockId id,
                                               const base::Cancellation& cancellation,
                                               char* out) const = 0;
  // Returns the unit that ReadBlock reads (UnitOfBlock).
  [[nodiscard]] virtual math::Index3 UnitOf(volume::BlockId id) const = 0;
  // Reads a unit into memory, where ReadBlock finds it as long as others leave it room. Errors as of
  // ReadBlock.
  [[nodiscard]] virtual absl::Status ReadUnit(const math::Index3& unit,
                                              const base::Cancellation& cancellation) const = 0;
  // Tells that a block which was read has another checksum than it had. Its unit and its source are not
  // kept, because the source may be back as it was later. Returns why there is no source to compare
  // any more, which says more than the checksum; OK if there is one.
  [[nodiscard]] virtual absl::Status Doubt(volume::BlockId id) const = 0;
  // Whether a unit is in memory, or being read.
  [[nodiscard]] virtual bool HasUnit(const math::Index3& unit) const = 0;
  // The number of units that may be read before they are used.
  [[nodiscard]] virtual std::size_t max_units_ahead() const = 0;
  // The path or address of the source, for messages.
  [[nodiscard]] virtual const std::string& name() const = 0;
  // Whether the source is so near that a thread that computes may read it.
  [[nodiscard]] virtual bool is_local() const = 0;
};

struct Manifest;

// Opens the source of an index-only volume. Errors name the source: NOT_FOUND, PERMISSION_DENIED
// (this process may not read it), DATA_LOSS (it is another volume).
using OpenSamples =
    std::function<absl::StatusOr<std::shared_ptr<const SampleReader>>(const Manifest& manifest)>;

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SAMPLE_READER_H_
