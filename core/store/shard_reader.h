// Reads one shard directory.

#ifndef ISOSCOPE_CORE_STORE_SHARD_READER_H_
#define ISOSCOPE_CORE_STORE_SHARD_READER_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"

#include "core/base/units.h"
#include "core/io/file.h"
#include "core/io/read_queue.h"
#include "core/store/manifest.h"
#include "core/store/shard_format.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/range_table.h"

namespace isoscope::store {

// A dataset directory's own description (not a shard's).
struct DatasetDescription {
  Manifest manifest;
  volume::RangeTable ranges;
  std::vector<std::string> shard_directories;  // by shard index; those that exist, else ""
};
// NOT_FOUND if `directory` holds no finished dataset, FAILED_PRECONDITION if it is a shard
// directory or of a newer format version, DATA_LOSS if it is damaged.
absl::StatusOr<DatasetDescription> OpenDataset(const std::string& directory);

// True if `directory` looks like a dataset directory / a shard directory.
bool IsDatasetDirectory(const std::string& directory);
bool IsShardDirectory(const std::string& directory);

// Immutable after Open; thread-safe.
class ShardReader {
 public:
  // Verifies manifest, range table, shard file and block index (checksums, sizes, and that they
  // belong together). Blocks are verified as they are read.
  // NOT_FOUND: no shard there. FAILED_PRECONDITION: a shard that was never finished, or of a newer
  // format version. DATA_LOSS: damaged; the message names file and offset. `open_file` opens each
  // file: tests inject faults.
  using OpenFile =
      std::function<absl::StatusOr<std::unique_ptr<io::RandomAccessFile>>(const std::string& path)>;
  static absl::StatusOr<std::unique_ptr<ShardReader>> Open(
      const std::string& directory, const OpenFile& open_file = io::OpenRandomAccessFile);

  [[nodiscard]] const std::string& directory() const { return directory_; }
  [[nodiscard]] const Manifest& manifest() const { return manifest_; }
  [[nodiscard]] int shard_index() const { return shard_index_; }
  [[nodiscard]] const volume::BlockLayout& layout() const { return layout_; }
  [[nodiscard]] const volume::RangeTable& ranges() const { return ranges_; }
  [[nodiscard]] std::int64_t block_count() const;
  // The block at a place in the shard. REQUIRES: ordinal < block_count().
  [[nodiscard]] volume::BlockId block_id(std::uint32_t ordinal) const;
  // Of manifest.json: what its member "crc32c" says. Equal in all shards of a dataset.
  [[nodiscard]] std::uint32_t manifest_crc32c() const { return manifest_crc32c_; }

  // One run of neighbouring blocks on disk: read with one request.
  struct Run {
    std::int64_t offset = 0;
    std::int64_t size = 0;
    std::size_t first = 0;  // index into the ordinals that were planned
    std::size_t count = 0;
  };
  // Groups ascending `ordinals`, all < block_count(), into runs of at most kMaxRunBytes. The
  // smallest gaps are read over, as many as together are at most kMaxGapShare of the blocks' bytes.
  [[nodiscard]] std::vector<Run> PlanRuns(absl::Span<const std::uint32_t> ordinals) const;
  static constexpr std::int64_t kMaxRunBytes = base::kMiB;
  static constexpr double kMaxGapShare = 0.18;

  // Reads one run of `ordinals` into `buffer`, run.size bytes, checks each block's CRC-32C and
  // calls `visit` in order; the samples are valid during that call. DATA_LOSS names dataset, shard,
  // block, file and offset; an error of `visit` is returned at once. Thread-safe.
  absl::Status ReadRun(const Run& run, absl::Span<const std::uint32_t> ordinals, char* buffer,
                       absl::FunctionRef<absl::Status(const volume::BlockSamples&)> visit) const;

  // The same in two steps: what to read, for a io::ReadQueue; and, with what that answered and
  // the bytes it read, the rest.
  [[nodiscard]] io::ReadQueue::Read RequestFor(const Run& run) const;
  absl::Status VisitRun(const Run& run, absl::Span<const std::uint32_t> ordinals,
                        const absl::Status& read_status, const char* bytes,
                        absl::FunctionRef<absl::Status(const volume::BlockSamples&)> visit) const;

 private:
  ShardReader() = default;

  absl::Status ReadShardFile(const OpenFile& open_file);
  absl::Status ReadBlockIndex(const OpenFile& open_file);
  // "dataset NAME (ID), shard 3 of 16".
  [[nodiscard]] std::string Where() const;

  struct Entry {
    volume::BlockId block_id = 0;
    std::uint32_t size = 0;
    std::int64_t offset = 0;
    std::uint32_t crc32c = 0;
    BlockEncoding encoding = BlockEncoding::kRaw;
  };

  std::string directory_;
  Manifest manifest_;
  std::uint32_t manifest_crc32c_ = 0;
  int shard_index_ = 0;
  volume::BlockLayout layout_;
  volume::RangeTable ranges_;
  std::vector<Entry> entries_;  // by ordinal
  std::unique_ptr<io::RandomAccessFile> blocks_file_;
};

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SHARD_READER_H_
