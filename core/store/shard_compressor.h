// Compresses the blocks of a raw shard. Partitioning does it after all blocks are written, because
// a block's offset is known beforehand only while blocks are raw.

#ifndef ISOSCOPE_CORE_STORE_SHARD_COMPRESSOR_H_
#define ISOSCOPE_CORE_STORE_SHARD_COMPRESSOR_H_

#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/units.h"
#include "core/store/manifest.h"
#include "core/store/shard_format.h"
#include "core/store/shard_writer.h"
#include "core/volume/block_layout.h"
#include "core/volume/scalar_type.h"

namespace isoscope::store {

struct CompressOptions {
  BlockEncoding encoding = BlockEncoding::kLz4;  // not kRaw
  // Raw bytes of a batch, at least one block. More bytes keep more threads busy; the memory taken
  // is about three times as much.
  std::size_t batch_bytes = 8 * static_cast<std::size_t>(base::kMiB);
  // Creates each file; tests inject faults here.
  ShardWriter::CreateFile create_file = io::CreateWritableFile;
};

// Calls task(i) for each i in [0, count), in any order and from any threads, and returns when all
// calls have returned.
using ParallelFor =
    absl::FunctionRef<void(std::size_t count, absl::FunctionRef<void(std::size_t)> task)>;

// Replaces the raw blocks.bin and block_index.bin of a shard by compressed ones, with the blocks in
// the same order, and returns the new summary. Blocks that would not become smaller stay raw. The
// disk must have room for both versions.
//
// directory:    a shard that Finish has written and WriteDescriptions has not described
// layout, type: of the volume
// raw:          the summary that ShardWriter::Finish returned
// parallel_for: runs the encoding of a batch
//
// DATA_LOSS if the directory does not hold that raw shard, CANCELLED, or the files' errors; after
// an error the caller removes the directory.
absl::StatusOr<ShardSummary> CompressShard(const std::string& directory,
                                           const volume::BlockLayout& layout,
                                           volume::ScalarType type, const ShardSummary& raw,
                                           const CompressOptions& options, ParallelFor parallel_for,
                                           const base::Cancellation& cancellation);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SHARD_COMPRESSOR_H_
