// Joins pieces of a shard, which several processes have cut, into the shard.

#ifndef ISOSCOPE_CORE_STORE_SHARD_JOINER_H_
#define ISOSCOPE_CORE_STORE_SHARD_JOINER_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/units.h"
#include "core/store/manifest.h"
#include "core/store/part_file.h"
#include "core/volume/block_layout.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::store {

// The folder of a piece, and what its record says of it. It has blocks.
struct PieceOfShard {
  std::string directory;
  ShardPiece piece;
};

// Memory that joining takes.
inline constexpr std::int64_t kJoinBytes = 11 * base::kMiB;

// A block on its way.
struct JoinedBlock {
  volume::BlockId id = 0;
  std::uint32_t ordinal = 0;  // in the shard
  volume::ScalarSpan span;
};

// Writes blocks.bin and block_index.bin of a shard into `directory`, which exists: the blocks of
// all pieces, one piece after the other, and returns the summary. Calls visit(block) for each block
// by ordinal. Verifies all checksums of the pieces.
//
// pieces:    in the order of their slabs; at least one
// is_direct: blocks.bin is written past the page cache (io::CreateDirectFile)
// is_index_only: the samples are in the source; the pieces have no blocks.bin, nor gets the shard one
//
// DATA_LOSS names the piece and what is wrong; CANCELLED; the errors of the files and of `visit`.
absl::StatusOr<ShardSummary> JoinShard(const std::vector<PieceOfShard>& pieces,
                                       const volume::BlockLayout& layout, volume::ScalarType type,
                                       const std::string& directory, bool is_direct,
                                       bool is_index_only,
                                       absl::FunctionRef<absl::Status(const JoinedBlock&)> visit,
                                       const base::Cancellation& cancellation);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SHARD_JOINER_H_
