// Reads datasets: the description in a dataset directory, and the blocks of a shard directory
// (docs/format/dataset.md, shard.md).

#ifndef ISOSCOPE_CORE_STORE_SHARD_READER_H_
#define ISOSCOPE_CORE_STORE_SHARD_READER_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/types/span.h"

#include "core/base/units.h"
#include "core/io/file.h"
#include "core/io/read_queue.h"
#include "core/store/manifest.h"
#include "core/store/sample_reader.h"
#include "core/store/shard_format.h"
#include "core/store/volume_ranges.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/block_set.h"
#include "core/volume/block_spans.h"
#include "core/volume/block_tree.h"
#include "core/volume/inside_rule.h"
#include "core/volume/range_table.h"
#include "core/volume/sample_histogram.h"
#include "core/volume/scalar_span.h"

namespace isoscope::store {

// The description of a dataset, from its dataset directory.
struct DatasetDescription {
  Manifest manifest;
  volume::RangeTable ranges;
  std::vector<std::string> shard_directories;  // by shard index; "" where it does not exist
};
// Reads the description. NOT_FOUND if `directory` holds no finished dataset, FAILED_PRECONDITION if
// it is a shard directory, a series (OpenSeries) or has a newer format version, DATA_LOSS if it is
// damaged.
absl::StatusOr<DatasetDescription> OpenDataset(const std::string& directory);

// True if `directory` looks like a dataset directory / a shard directory, of a series or not.
bool IsDatasetDirectory(const std::string& directory);
bool IsShardDirectory(const std::string& directory);

// An open shard. Holds 24 bytes for each of its blocks, and shares the range table, or the pages of
// it that are in use, with the other shards of its volume in this process. Immutable after Open;
// thread-safe.
class ShardReader {
 public:
  // Opens a shard and verifies manifest, range table, shard file and block index: their checksums,
  // their sizes, and that they belong together. Blocks are verified as they are read.
  //
  // open_file:    opens each file; tests inject faults here
  // open_samples: opens the source of an index-only shard, and may be empty: no other needs it
  //
  // NOT_FOUND: there is no shard. FAILED_PRECONDITION: the shard was never finished, has a newer
  // format version, or is index-only and nothing opens its source. DATA_LOSS: it is damaged; the
  // message names file and offset. Errors of open_samples.
  using OpenFile =
      std::function<absl::StatusOr<std::unique_ptr<io::RandomAccessFile>>(const std::string& path)>;
  static absl::StatusOr<std::unique_ptr<ShardReader>> Open(
      const std::string& directory, const OpenFile& open_file = io::OpenRandomAccessFile,
      const OpenSamples& open_samples = nullptr);

  [[nodiscard]] const std::string& directory() const { return directory_; }
  [[nodiscard]] const Manifest& manifest() const { return manifest_; }
  [[nodiscard]] int shard_index() const { return shard_index_; }
  // Whether the samples are read from the source.
  [[nodiscard]] bool is_index_only() const { return manifest_.in_source.has_value(); }
  // The path or address of the source then, else "".
  [[nodiscard]] const std::string& source_name() const {
    return samples_ == nullptr ? no_source_ : samples_->name();
  }
  // What reads the source then, else null.
  [[nodiscard]] const SampleReader* samples() const { return samples_.get(); }
  [[nodiscard]] const volume::BlockLayout& layout() const { return layout_; }
  // The whole table: of a span_tree.bin it is read at the first call, and kept (VolumeRanges::table).
  // Spans and ActiveTree do without.
  [[nodiscard]] const volume::RangeTable& ranges() const { return ranges_->table(); }
  // As ranges().ActiveBlocks(rule), of all shards of the volume in this process.
  [[nodiscard]] std::shared_ptr<const volume::BlockSet> ActiveBlocks(
      const volume::InsideRule& rule) const {
    return ranges_->ActiveBlocks(rule);
  }
  // The same as a tree, for volumes with more than volume::kMaxDenseBlocks blocks. Errors are those of
  // pages of span_tree.bin.
  [[nodiscard]] absl::StatusOr<std::shared_ptr<const volume::BlockTree>> ActiveTree(
      const volume::InsideRule& rule) const {
    return ranges_->ActiveTree(rule);
  }
  // Returns the spans of single blocks of the volume, of a span_tree.bin by its pages. This must
  // outlive them.
  [[nodiscard]] volume::BlockSpans Spans() const { return ranges_->Spans(); }
  // Returns the span of a block of the volume, without reading the table of a span_tree.bin.
  [[nodiscard]] absl::StatusOr<volume::ScalarSpan> SpanOf(volume::BlockId id) const {
    return ranges_->SpanOf(id);
  }
  // Whether the ranges are in a span_tree.bin. Of one, the number of pages of the volume whose span an
  // isovalue meets.
  [[nodiscard]] bool has_span_tree() const { return ranges_->is_in_file(); }
  [[nodiscard]] std::int64_t CountActivePages(double isovalue) const {
    return ranges_->CountActivePages(isovalue);
  }
  // Reads and verifies all of this shard's span_tree.bin, and its ranges.bin beside it. OK if there is
  // none: then Open has verified ranges.bin.
  [[nodiscard]] absl::Status VerifySpans() const;
  [[nodiscard]] std::int64_t block_count() const;
  // REQUIRES: ordinal < block_count().
  [[nodiscard]] volume::BlockId block_id(std::uint32_t ordinal) const;
  // ManifestCrc32c of manifest.json. Equal in all shards of a dataset, with levels or without.
  [[nodiscard]] std::uint32_t manifest_crc32c() const { return manifest_crc32c_; }
  // The bytes of a block that are read; of an index-only shard raw. REQUIRES: ordinal < block_count().
  [[nodiscard]] std::int64_t stored_bytes(std::uint32_t ordinal) const;

  // Reads and verifies the histogram of the samples that belong to the shard's blocks
  // (volume::CountedSamplesOf). Not set if partitioning wrote none (earlier versions).
  // O(block_count()). DATA_LOSS if it is damaged or missing, or does not belong to the shard.
  [[nodiscard]] absl::StatusOr<std::optional<volume::SampleHistogram>> ReadHistogram() const;

  // A disk run: blocks that lie near each other in blocks.bin and are read with one request.
  struct DiskRun {
    std::int64_t offset = 0;  // in blocks.bin, bytes
    std::int64_t size = 0;    // bytes, gaps between the blocks included
    std::size_t first = 0;    // index into the ordinals that were planned
    std::size_t count = 0;    // blocks
  };
  // Groups ordinals into disk runs of at most kMaxDiskRunBytes, or one block if that is larger. Of
  // an index-only shard no gap is read over, and the blocks of a run begin in one unit of the source.
  // Small gaps are read over, the smallest first, as long as all of them are at most kMaxGapShare
  // of the blocks' bytes. O(n log n).
  //
  // ordinals: ascending, each < block_count()
  [[nodiscard]] std::vector<DiskRun> PlanDiskRuns(absl::Span<const std::uint32_t> ordinals) const;
  static constexpr std::int64_t kMaxDiskRunBytes = base::kMiB;
  static constexpr double kMaxGapShare = 0.18;

  // Reads one disk run, then verifies, decodes and visits its blocks in order. Thread-safe.
  //
  // run, ordinals: as PlanDiskRuns returned and took them
  // buffer:        run.size bytes, overwritten
  // visit:         called once for each block; the samples are valid during the call
  //
  // DATA_LOSS names dataset, shard, block, file and offset. An error of `visit` is returned at
  // once.
  absl::Status ReadDiskRun(
      const DiskRun& run, absl::Span<const std::uint32_t> ordinals, char* buffer,
      absl::FunctionRef<absl::Status(const volume::BlockSamples&)> visit) const;

  // ReadDiskRun in two steps, for an io::ReadQueue: RequestFor returns the request; VisitDiskRun
  // takes the status and the bytes that the queue delivered, and does the rest.
  [[nodiscard]] io::ReadQueue::Read RequestFor(const DiskRun& run) const;
  // The file of RequestFor whose reads end soon after `cancellation` fires. The shard and it outlive
  // the file. REQUIRES: is_index_only().
  [[nodiscard]] std::unique_ptr<io::RandomAccessFile> OpenSourceBlocks(
      const base::Cancellation& cancellation) const;
  absl::Status VisitDiskRun(
      const DiskRun& run, absl::Span<const std::uint32_t> ordinals, const absl::Status& read_status,
      const char* bytes, absl::FunctionRef<absl::Status(const volume::BlockSamples&)> visit) const;

 private:
  ShardReader() = default;

  absl::Status OpenRanges(const OpenFile& open_file);
  absl::Status ReadShardFile(const OpenFile& open_file);
  absl::Status ReadBlockIndex(const OpenFile& open_file, const OpenSamples& open_samples);
  // Fills entries_ from the verified bytes of the block index and checks each entry. `path` is
  // named in errors.
  absl::Status DecodeEntries(const std::string& path, absl::string_view bytes);
  // Opens blocks.bin and checks its size. REQUIRES: entries_ is filled.
  absl::Status OpenBlocks(const OpenFile& open_file, const OpenSamples& open_samples);
  // Returns the raw blocks of an index-only shard as a file. cancellation: null if nothing ends its
  // reads
  [[nodiscard]] std::unique_ptr<io::RandomAccessFile> MakeSourceFile(
      const base::Cancellation* cancellation) const;
  // Makes a block of an index-only shard of its unit and its overhang, and verifies both.
  absl::Status ReadSourceBlock(std::uint32_t ordinal, const base::Cancellation& cancellation,
                               char* out) const;
  // Returns "dataset NAME (ID), shard 3 of 16".
  [[nodiscard]] std::string Where() const;

  struct Entry {
    volume::BlockId block_id = 0;
    std::uint32_t size = 0;
    std::int64_t offset = 0;
    std::uint32_t crc32c = 0;
    BlockEncoding encoding = BlockEncoding::kRaw;
  };
  struct BlockBuffers {
    std::string samples;
    std::string scratch;
  };
  // Compares the checksum of the stored bytes of a block. file: has them
  [[nodiscard]] absl::Status CheckStored(const Entry& entry, absl::string_view stored,
                                         const io::RandomAccessFile& file) const;
  // Returns the samples of the block that lies at `stored`: these bytes, or decoded ones in
  // `buffers`. DATA_LOSS if its checksum is wrong, or if it can't be decoded.
  absl::StatusOr<const char*> VerifyAndDecode(const Entry& entry, const char* stored,
                                              BlockBuffers* buffers) const;

  std::string directory_;
  Manifest manifest_;
  std::uint32_t manifest_crc32c_ = 0;
  int shard_index_ = 0;
  volume::BlockLayout layout_;
  std::shared_ptr<VolumeRanges> ranges_;
  // By ordinal. Those of an index-only shard are of raw blocks, which no file has.
  std::vector<Entry> entries_;
  std::vector<Entry> overhangs_;                   // as they are stored, of an index-only shard
  OpenFile open_file_;                             // of Open, for what is read later
  std::optional<std::uint32_t> histogram_crc32c_;  // of the whole file; not set: there is none
  std::int64_t histogram_bytes_ = 0;
  std::unique_ptr<io::RandomAccessFile> overhangs_file_;  // blocks.bin of an index-only shard
  std::unique_ptr<io::RandomAccessFile> blocks_file_;
  std::shared_ptr<const SampleReader> samples_;  // of an index-only shard
  std::string no_source_;
};

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SHARD_READER_H_
