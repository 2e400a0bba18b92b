// Compresses a shard after it was written.

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
#include "core/volume/scalar_type.h"

namespace isoscope::store {

struct CompressOptions {
  BlockEncoding encoding = BlockEncoding::kLz4;  // not kRaw
  // Raw bytes that are compressed at a time, at least one block; memory is some three times as
  // much.
  std::size_t batch_bytes = 8 * static_cast<std::size_t>(base::kMiB);
  // Makes each file: tests inject faults.
  ShardWriter::CreateFile create_file = io::CreateWritableFile;
};

// Calls task(i) for each i in [0, count), in any order and from any threads, and returns when all
// have returned.
using ParallelFor =
    absl::FunctionRef<void(std::size_t count, absl::FunctionRef<void(std::size_t)> task)>;

// Replaces the raw blocks.bin and block_index.bin of a shard of `type` that has no descriptions yet
// by compressed ones, blocks in the same order, and returns the new summary. Blocks that do not
// become smaller stay raw. Needs disk space for both. `raw`: what ShardWriter::Finish returned.
// DATA_LOSS if the directory holds something else; after any error it is left for the caller to
// remove. Blocks.
absl::StatusOr<ShardSummary> CompressShard(const std::string& directory, volume::ScalarType type,
                                           const ShardSummary& raw, const CompressOptions& options,
                                           ParallelFor parallel_for,
                                           const base::Cancellation& cancellation);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SHARD_COMPRESSOR_H_
