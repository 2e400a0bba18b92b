// Finds the bytes of a dataset's chunks in its file. Calls the library: for the process that it runs
// in (walled_source.h).

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_HDF5_CHUNK_FINDER_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_HDF5_CHUNK_FINDER_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"

namespace isoscope::source {

// Bytes of a file that hold a chunk, as its filters left them.
struct Hdf5Chunk {
  std::int64_t offset = 0;  // from the start of the file
  std::int64_t size = 0;
  std::uint32_t skipped_filters = 0;  // bit i: the i-th filter was left out

  friend bool operator==(const Hdf5Chunk&, const Hdf5Chunk&) = default;
};

// Each chunk costs a look-up in the library's index, whatever kind of index the file has. The
// library's own functions that tell offsets walk over all chunks for each one.
class Hdf5ChunkFinder {
 public:
  // Opens the dataset a second time, by its address in the file that holds it. INVALID_ARGUMENT,
  // DATA_LOSS: the library can't open it. `name` is for messages. REQUIRES: a dataset in chunks.
  static absl::StatusOr<Hdf5ChunkFinder> Open(hid_t dataset, const std::string& name);

  // Finds the chunk whose first element has these indexes; not set: it was never written.
  // DATA_LOSS: the index is damaged, or a chunk has more bytes than any may have.
  absl::StatusOr<std::optional<Hdf5Chunk>> Find(const std::vector<hsize_t>& first);

 private:
  Hdf5ChunkFinder(std::string name, Hdf5Handle file, Hdf5Handle dataset)
      : name_(std::move(name)), file_(std::move(file)), dataset_(std::move(dataset)) {}

  std::string name_;
  Hdf5Handle file_;
  Hdf5Handle dataset_;
  std::unique_ptr<char[]> room_;  // that the library could write to
  std::size_t room_bytes_ = 0;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_HDF5_CHUNK_FINDER_H_
