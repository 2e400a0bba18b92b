// Shards: objects that hold many chunks, and an index of where each one lies ("sharding_indexed" of
// Zarr 3).
//
//   [ index ] chunk chunk ... [ index ]     the index stands at one end, at which one the metadata
//                                           say
//   index: for each chunk of the shard, in C order, offset and size in bytes, each of 64 bits; both
//   2^64 - 1 if the chunk is not there. It has codecs of its own, which give it a fixed size.

#ifndef ISOSCOPE_CORE_SOURCE_CHUNKS_SHARD_LAYOUT_H_
#define ISOSCOPE_CORE_SOURCE_CHUNKS_SHARD_LAYOUT_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/types/span.h"

#include "core/source/chunks/chunk_box.h"
#include "core/source/chunks/chunk_codec.h"

namespace isoscope::source {

// The bytes of a chunk in its shard.
struct ShardEntry {
  std::int64_t offset = 0;
  std::int64_t size = -1;  // negative: it is not there

  [[nodiscard]] bool is_there() const { return size >= 0; }
};

class ShardLayout {
 public:
  // `shard`: what the codec encodes. INVALID_ARGUMENT: a configuration that makes no sense; chunks
  // that do not fill a shard; more than 4 Mi chunks a shard; an index without a fixed size; errors
  // of CodecChain::Make. The message is to follow a name and a colon.
  static absl::StatusOr<std::shared_ptr<const ShardLayout>> Make(const ChunkJson& configuration,
                                                                 const ChunkData& shard);

  [[nodiscard]] const ChunkGrid& grid() const { return grid_; }  // of a shard
  [[nodiscard]] const CodecChain& chunk_codecs() const { return chunk_codecs_; }
  [[nodiscard]] std::int64_t index_bytes() const { return index_codecs_.encoded().size_bytes; }
  [[nodiscard]] bool is_index_at_end() const { return is_index_at_end_; }
  // The most that a shard takes, if no byte of it is unused.
  [[nodiscard]] std::int64_t max_bytes() const;

  // DATA_LOSS: damaged; an entry with more bytes than a chunk can have, or at no place of a file.
  [[nodiscard]] absl::StatusOr<std::vector<ShardEntry>> DecodeIndex(
      absl::string_view encoded) const;

 private:
  ShardLayout(ChunkGrid grid, CodecChain chunk_codecs, CodecChain index_codecs,
              bool is_index_at_end);

  ChunkGrid grid_;
  CodecChain chunk_codecs_;
  CodecChain index_codecs_;
  bool is_index_at_end_;
};

// The codec that decodes a shard as a whole.
absl::Span<const CodecRow> ShardCodecs();

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHUNKS_SHARD_LAYOUT_H_
