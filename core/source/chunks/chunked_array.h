// An array whose numbers are stored in chunks: what readers of Zarr make. Whoever reads it knows
// neither files nor codecs.

#ifndef ISOSCOPE_CORE_SOURCE_CHUNKS_CHUNKED_ARRAY_H_
#define ISOSCOPE_CORE_SOURCE_CHUNKS_CHUNKED_ARRAY_H_

#include <cstdint>
#include <string>
#include <utility>

#include "absl/status/status.h"

#include "core/base/cancellation.h"
#include "core/source/chunks/chunk_box.h"
#include "core/source/chunks/chunk_cache.h"
#include "core/source/chunks/number_type.h"

namespace isoscope::source {

struct ChunkedArrayInfo {
  std::string name;         // path and array, for messages
  ChunkIndex dims{};        // at least one axis, the slowest first
  ChunkIndex chunk_dims{};  // of what is decoded as one: an inner chunk of a shard
  NumberType type = NumberType::kUint8;
  std::int64_t memory_bytes = 0;  // while a box is read, beside the output and the cache
};

// Thread-safe.
class ChunkedArray {
 public:
  virtual ~ChunkedArray() = default;

  [[nodiscard]] const ChunkedArrayInfo& info() const { return info_; }

  // Reads a box into `out`, in C order, little-endian. Chunks are read many at a time, and decoded
  // on the threads of TBB's current arena. A `cache` gives chunks that it has, and is given those
  // of which the box has a part only; null: none.
  //
  // DATA_LOSS: damaged, with the chunk's key; an object that ends early. CANCELLED and
  // DEADLINE_EXCEEDED soon after the cancellation. Otherwise errors of ObjectStore.
  // REQUIRES: the box lies in the array, and is not empty.
  [[nodiscard]] virtual absl::Status ReadBox(const ChunkBox& box, char* out, ChunkCache* cache,
                                             const base::Cancellation& cancellation) const = 0;

 protected:
  explicit ChunkedArray(ChunkedArrayInfo info) : info_(std::move(info)) {}

 private:
  const ChunkedArrayInfo info_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHUNKS_CHUNKED_ARRAY_H_
