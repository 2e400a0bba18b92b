// The library's caches of decoded chunks under a virtual dataset. Each of its sources has one, of the
// size that the virtual dataset was opened with. They live until that is closed.

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_SOURCE_CACHES_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_SOURCE_CACHES_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/source/grid/axis_order.h"
#include "hdf5.h"

namespace isoscope::source {

// The sources of one volume in a virtual dataset. Says how large their caches are, and when they must
// be given up so that all together stay within a bound. Thread-compatible. Calls the library only
// while it is made.
class Hdf5SourceCaches {
 public:
  // A part of the volume that a source has, within these planes and rows.
  struct Mapping {
    std::size_t source = 0;
    std::int64_t begin_z = 0;
    std::int64_t end_z = 0;
    std::int64_t begin_y = 0;
    std::int64_t end_y = 0;
  };
  // Chunks of one source.
  struct Chunks {
    double chunk_bytes = 0;  // decoded
    double plane_bytes = 0;  // of those that a plane needs
  };

  // The volume is `count` elements from `start` on, by axis of the dataset. Not set: it is no virtual
  // dataset, or caches are no help: its sources have no chunks, or those of a plane don't fit; or it
  // is not known which sources there are (names with a number, sources of sources, too many).
  //
  // max_bytes: of all caches, where that keeps a plane; at most kMaxHdf5SourceCacheBytes otherwise
  static std::optional<Hdf5SourceCaches> Find(hid_t dataset, const std::vector<hsize_t>& start,
                                              const std::vector<hsize_t>& count,
                                              const AxisOrder& axes, std::int64_t max_bytes);
  // For Find, and for tests.
  static std::optional<Hdf5SourceCaches> Plan(std::vector<Mapping> mappings, const Chunks& chunks,
                                              std::int64_t max_bytes);

  // Of each source.
  [[nodiscard]] std::int64_t cache_bytes() const { return cache_bytes_; }
  // Of all sources at a time, at most.
  [[nodiscard]] std::int64_t max_bytes() const;

  struct Step {
    std::int64_t end_z = 0;    // the planes up to there may be read at once; at least one
    bool must_reopen = false;  // before: all caches are given up, as the dataset is closed
  };
  // Plans the read of rows [begin_y, end_y) of planes [begin_z, end_z), or of the first ones.
  Step Next(std::int64_t begin_z, std::int64_t end_z, std::int64_t begin_y, std::int64_t end_y);

 private:
  Hdf5SourceCaches(std::vector<Mapping> mappings, std::size_t source_count,
                   std::int64_t cache_bytes, std::size_t max_full);

  std::vector<Mapping> mappings_;
  std::int64_t cache_bytes_;
  std::size_t max_full_;        // caches
  std::vector<bool> is_full_;   // by source: its cache may be
  std::size_t full_count_ = 0;  // of is_full_
};

// Of the caches of all sources that one plane needs.
inline constexpr std::int64_t kMaxHdf5SourceCacheBytes = std::int64_t{128} << 20;

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_SOURCE_CACHES_H_
