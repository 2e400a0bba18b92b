// A chunked array whose chunks, or shards of chunks, are objects of a store.

#ifndef ISOSCOPE_CORE_SOURCE_CHUNKS_STORED_ARRAY_H_
#define ISOSCOPE_CORE_SOURCE_CHUNKS_STORED_ARRAY_H_

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/bytes/object_store.h"
#include "core/source/chunks/chunk_box.h"
#include "core/source/chunks/chunk_codec.h"
#include "core/source/chunks/chunked_array.h"
#include "core/source/chunks/number_type.h"

namespace isoscope::source {

// Metadata, whatever their format.
struct StoredArraySpec {
  std::string name;  // for messages
  ChunkIndex dims{};
  ChunkIndex chunk_dims{};  // of an object
  NumberType type = NumberType::kUint8;
  std::string fill{};               // one number, little-endian: those of chunks that are not there
  std::vector<CodecSpec> codecs{};  // in the order of encoding
  // The key of a chunk's object, by its index.
  std::function<std::string(const ChunkIndex&)> key_of{};
};

// The limits of what a stranger's metadata may ask for.
inline constexpr std::int64_t kMaxArrayNumbers = std::int64_t{1} << 62;
inline constexpr std::int64_t kMaxChunkBytes = std::int64_t{1} << 30;

// Reads nothing yet. Of shards only the index and the wanted chunks are read. Chunks that lie close
// to each other are read as one range.
// INVALID_ARGUMENT: no axes, or more than kMaxChunkAxes; sizes that are negative, or more numbers
// than kMaxArrayNumbers; chunks of no size, or of more than kMaxChunkBytes; as CodecChain::Make.
// The message begins with the name.
absl::StatusOr<std::unique_ptr<ChunkedArray>> OpenStoredArray(
    std::shared_ptr<const ObjectStore> store, StoredArraySpec spec);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHUNKS_STORED_ARRAY_H_
