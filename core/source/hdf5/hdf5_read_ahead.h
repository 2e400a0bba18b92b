// Tells a far file (core/io/mounted_file.h) which chunks of a dataset will be read next, so that they are
// fetched at once and before. Calls the library: for the process that it runs in (walled_source.h).

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_HDF5_READ_AHEAD_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_HDF5_READ_AHEAD_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "absl/types/span.h"

#include "core/io/mounted_file.h"
#include "hdf5.h"

namespace isoscope::source {

// The library's cache of chunks for far files: a layer that fits is fetched once.
inline constexpr std::int64_t kFarChunkCacheBytes = std::int64_t{128} << 20;

// Of a volume in a dataset that is read in planes, which ascend. A layer has all chunks of the volume
// with one place on the axis of planes. Layers that the library's cache of chunks keeps are expected
// once, with one layer ahead of a reader that leaves no plane out; others for each read. Thread-compatible.
class Hdf5ReadAhead {
 public:
  // The volume is `count` elements from `start` on, by axis of the dataset; `plane_axis` is that of
  // planes. Does nothing for files that are not far, and for datasets without chunks. `dataset` outlives
  // it.
  Hdf5ReadAhead(hid_t dataset, std::vector<hsize_t> start, std::vector<hsize_t> count,
                std::size_t plane_axis, std::int64_t cache_bytes);

  // Before planes [begin, end) of the volume are read, all or a part of them.
  void BeforePlanes(std::int64_t begin, std::int64_t end);

 private:
  void ExpectLayers(hsize_t begin, hsize_t end);

  const hid_t dataset_;
  const std::vector<hsize_t> start_;
  const std::vector<hsize_t> count_;
  const std::size_t plane_axis_;
  std::vector<hsize_t> chunk_;  // none: nothing to do
  bool keeps_layer_ = false;
  hsize_t expected_begin_ = 0;  // layers of the dataset
  hsize_t expected_end_ = 0;
  std::int64_t last_end_ = 0;  // plane behind those of the last read
  std::function<void(absl::Span<const io::FileRange>)> expect_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_HDF5_READ_AHEAD_H_
