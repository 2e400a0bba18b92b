// Reads all of a dataset and compares every checksum.

#ifndef ISOSCOPE_CORE_PARTITION_DATASET_VERIFIER_H_
#define ISOSCOPE_CORE_PARTITION_DATASET_VERIFIER_H_

#include <cstdint>
#include <functional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/store/sample_reader.h"

namespace isoscope::partition {

struct VerifyOptions {
  // Called for each damage, with a message that names file and place; may be null.
  std::function<void(const std::string& message)> damage;
  // Bytes of files; may be null.
  std::function<void(std::int64_t done_bytes, std::int64_t total_bytes)> progress;
  // Opens the source of an index-only dataset, whose blocks are read there, too; may be null.
  store::OpenSamples open_samples{};
};

struct VerifyReport {
  std::int64_t shard_count = 0;          // that were there
  std::int64_t missing_shard_count = 0;  // of the dataset; they may lie on other machines
  std::int64_t volume_count = 0;         // scalar volumes; 1 for a dataset of version 1
  std::int64_t block_count = 0;          // of all volumes, levels and shards
  std::int64_t file_bytes = 0;
  std::int64_t damage_count = 0;
};

// Verifies a dataset or one shard, of any format version: seals and contradictions of all
// manifests, range tables, block indices, each block, each page of the interval trees, histograms,
// and that what belongs together does; the same of all levels. Whatever is damaged, the rest is
// verified too.
//
// Memory: one disk run and 28 bytes a block of one shard of one volume.
//
// NOT_FOUND: no dataset. FAILED_PRECONDITION: a newer format version. CANCELLED. A source that can't be
// read is no damage: its error, with ErrorReason::kSourceUnreadable.
absl::StatusOr<VerifyReport> VerifyDataset(const std::string& directory,
                                           const VerifyOptions& options,
                                           const base::Cancellation& cancellation);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_DATASET_VERIFIER_H_
