// Opening a shard verifies it from the root of its checksums down, so that each file is trusted
// before the next is read:
//
//   1. manifest.json     its own seal
//   2. ranges.bin        CRC-32C of the file, from the manifest; or, if it is there,
//      span_tree.bin     CRC-32C of its head; pages when they are read
//   3. shard.json        its own seal; CRC-32C of the manifest, counts and sizes as in the manifest
//   4. interval_tree.bin size, and CRC-32C of its first 4096 bytes, from shard.json
//   5. block_index.bin   CRC-32C of the file, from the manifest; then each entry: id, encoding and
//                        sizes, and an offset that is the sum of the sizes before it
//   6. blocks.bin        size; each block's CRC-32C when it is read. That of an index-only shard has
//                        overhangs, and blocks are made of both (block_overhang.h). Its source is
//                        opened from step 2 on, by another thread, because it may be far away
//   7. histogram.bin     on request only: CRC-32C of the file, from shard.json
//
// Invariant: sizes are compared before memory is allocated for them.
//
// Blocks are read in disk runs. PlanDiskRuns sorts the gaps between the wanted blocks, and reads
// over the smallest ones, up to 18 % of the wanted bytes. A few more bytes cost less than another
// request. Example: of blocks of 100 bytes, ordinals 0 to 5, 7 to 9 and 14 are wanted: 1000 bytes,
// so gaps may sum up to 180. The gap of 100 (ordinal 6) is read over, that of 400 (10 to 13) is
// not: two disk runs, of 1000 and of 100 bytes.
//
// Layouts: docs/format/dataset.md, docs/format/shard.md.

#include "core/store/shard_reader.h"

#include <algorithm>
#include <cmath>
#include <future>
#include <iterator>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/crc32c.h"
#include "core/base/error_reason.h"
#include "core/base/status_macros.h"
#include "core/base/thread_interrupt.h"
#include "core/store/block_codec.h"
#include "core/store/block_overhang.h"
#include "core/store/directory_files.h"
#include "core/store/histogram_file.h"
#include "core/store/json_fields.h"
#include "core/store/sealed_json.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_format.h"
#include "core/store/source_blocks_file.h"
#include "core/store/span_tree_file.h"
#include "core/volume/block_set.h"

namespace isoscope::store {
namespace {

absl::Status CheckFileCrc32c(const std::string& path, absl::string_view bytes,
                             std::uint32_t expected, absl::string_view expected_by,
                             absl::string_view suspicion) {
  const std::uint32_t computed = base::Crc32c(bytes);
  return computed == expected ? absl::OkStatus()
                              : absl::DataLossError(absl::StrFormat(
                                    "%s: crc32c of the file 0x%08x, %s expects 0x%08x: it is %s",
                                    path, computed, expected_by, expected, suspicion));
}

// Opens the source of an index-only shard on a thread of its own, if there is one to be had.
class SamplesAhead {
 public:
  // Both outlive it.
  SamplesAhead(const Manifest& manifest, const OpenSamples& open_samples)
      : open_samples_(open_samples) {
    if (manifest.in_source.has_value() && open_samples != nullptr) {
      samples_ = std::async(std::launch::async | std::launch::deferred,
                            [&manifest, &open_samples] { return open_samples(manifest); });
    }
  }

  // Waits for that thread. For one call, of what was given to the constructor. This outlives it.
  [[nodiscard]] OpenSamples opener() {
    return samples_.valid() ? OpenSamples([this](const Manifest&) { return samples_.get(); })
                            : open_samples_;
  }

 private:
  const OpenSamples& open_samples_;
  std::future<absl::StatusOr<std::shared_ptr<const SampleReader>>> samples_;
};

}  // namespace

absl::StatusOr<DatasetDescription> OpenDataset(const std::string& directory) {
  if (!io::PathExists(PathIn(directory, kManifestFileName))) {
    return absl::NotFoundError(absl::StrCat(
        directory, ": no ", kManifestFileName,
        " in it: no dataset, or one whose partitioning did not finish; run `isoscope partition`"));
  }
  if (IsShardDirectory(directory)) {
    return absl::FailedPreconditionError(absl::StrCat(
        directory, ": is one shard of a dataset, expected the dataset directory that holds it"));
  }
  if (IsSeriesDirectory(directory)) {
    return absl::FailedPreconditionError(
        absl::StrCat(directory,
                     ": is a series, a dataset with fields or time steps: expected one of a single "
                     "field and step"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(Descriptions descriptions,
                            ReadDescriptions(directory, io::OpenRandomAccessFile));
  DatasetDescription dataset;
  const auto shard_count = static_cast<int>(descriptions.manifest.shards.size());
  for (int shard = 0; shard < shard_count; ++shard) {
    std::string path = PathIn(directory, ShardDirectoryName(shard, shard_count));
    dataset.shard_directories.push_back(io::IsDirectory(path) ? std::move(path) : "");
  }
  dataset.manifest = std::move(descriptions.manifest);
  dataset.ranges = std::move(descriptions.ranges);
  return dataset;
}

bool IsDatasetDirectory(const std::string& directory) {
  return io::PathExists(PathIn(directory, kManifestFileName)) && !IsShardDirectory(directory);
}

bool IsShardDirectory(const std::string& directory) {
  return io::PathExists(PathIn(directory, kShardFileName)) ||
         io::PathExists(PathIn(directory, kSeriesShardFileName));
}

absl::StatusOr<std::unique_ptr<ShardReader>> ShardReader::Open(const std::string& directory,
                                                               const OpenFile& open_file,
                                                               const OpenSamples& open_samples) {
  const bool has_manifest = io::PathExists(PathIn(directory, kManifestFileName));
  if (!has_manifest && io::PathExists(PathIn(directory, kBlocksFileName))) {
    return absl::FailedPreconditionError(
        absl::StrCat(directory, ": a shard without ", kManifestFileName,
                     ": its partitioning or copying did not finish; do it again"));
  }
  if (!has_manifest) {
    return absl::NotFoundError(
        absl::StrCat(directory, ": no ", kManifestFileName,
                     " in it, expected a shard directory; copy it again or partition anew"));
  }
  if (!IsShardDirectory(directory) && !io::PathExists(PathIn(directory, kBlocksFileName))) {
    return absl::NotFoundError(absl::StrCat(
        directory, ": no ", kShardFileName,
        " in it, expected a shard directory (a dataset directory holds them as shard-*-of-*)"));
  }
  auto reader = std::unique_ptr<ShardReader>(new ShardReader);
  reader->directory_ = directory;
  reader->open_file_ = open_file;
  // 1: manifest.
  ISOSCOPE_ASSIGN_OR_RETURN(Descriptions descriptions, ReadManifest(directory, open_file));
  reader->manifest_ = std::move(descriptions.manifest);
  reader->manifest_crc32c_ = descriptions.manifest_crc32c;
  reader->layout_ = descriptions.layout;
  SamplesAhead samples(reader->manifest_, open_samples);
  ISOSCOPE_RETURN_IF_ERROR(reader->OpenRanges(open_file));
  ISOSCOPE_RETURN_IF_ERROR(reader->ReadShardFile(open_file));
  ISOSCOPE_RETURN_IF_ERROR(reader->ReadBlockIndex(open_file, samples.opener()));
  return reader;
}

absl::Status ShardReader::OpenRanges(const OpenFile& open_file) {
  // 2: ranges.
  if (!io::PathExists(PathIn(directory_, kSpanTreeFileName))) {
    ISOSCOPE_ASSIGN_OR_RETURN(volume::RangeTable table,
                              ReadRangeTable(directory_, manifest_, layout_, open_file));
    ranges_ = VolumeRanges::Share(layout_.block_dims(), std::move(table));
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(volume::SpanOctree octree,
                            OpenSpanTree(directory_, manifest_, layout_, open_file));
  ranges_ = VolumeRanges::Share(
      absl::StrFormat("%s/%08x/%dx%dx%d", manifest_.dataset_id, manifest_.range_table_crc32c,
                      layout_.block_dims().x, layout_.block_dims().y, layout_.block_dims().z),
      std::move(octree),
      // Later: what `open_file` refers to may be gone by then.
      [directory = directory_, manifest = manifest_, layout = layout_] {
        return ReadRangeTable(directory, manifest, layout, io::OpenRandomAccessFile);
      });
  return absl::OkStatus();
}

absl::Status ShardReader::VerifySpans() const {
  if (!has_span_tree()) {
    return absl::OkStatus();
  }
  // Shards of a volume share the pages of one of them: here it is this shard's.
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::SpanOctree octree,
                            OpenSpanTree(directory_, manifest_, layout_, open_file_));
  ISOSCOPE_RETURN_IF_ERROR(VerifySpanTree(octree, PathIn(directory_, kSpanTreeFileName)));
  return ReadRangeTable(directory_, manifest_, layout_, open_file_).status();
}

absl::Status ShardReader::ReadShardFile(const OpenFile& open_file) {
  // 3: shard.json.
  const std::string path = PathIn(directory_, kShardFileName);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                            ReadRequiredJson(path, kMaxShardFileBytes, open_file));
  ISOSCOPE_RETURN_IF_ERROR(VerifySeal(bytes, path).status());
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const Json> json,
                            ParseJsonFile(bytes, path, kShardFormat, kFormatVersion));
  JsonFields fields(*json, path);
  std::string dataset_id;
  fields.Read("dataset_id", &dataset_id);
  const auto manifest_shard_count = static_cast<std::int64_t>(manifest_.shards.size());
  std::int64_t shard_count = 0;
  fields.Read("shard_count", 1, kMaxShardCount, &shard_count);
  std::int64_t shard_index = 0;
  fields.Read("shard_index", 0, manifest_shard_count - 1, &shard_index);
  std::uint32_t manifest_crc32c = 0;
  fields.ReadCrc32c("manifest_crc32c", &manifest_crc32c);
  ShardSummary summary;
  fields.ReadCrc32c("block_index_crc32c", &summary.block_index_crc32c);
  fields.Read("blocks_bytes", 0, kMaxInt64, &summary.block_bytes);
  std::int64_t tree_bytes = 0;
  fields.Read("interval_tree_bytes", 0, kMaxInt64, &tree_bytes);
  std::uint32_t tree_head_crc32c = 0;
  fields.ReadCrc32c("interval_tree_head_crc32c", &tree_head_crc32c);
  if (fields.Has("histogram_crc32c")) {
    fields.ReadCrc32c("histogram_crc32c", &histogram_crc32c_.emplace());
    fields.Read("histogram_bytes", 0, kMaxHistogramFileBytes, &histogram_bytes_);
  }
  ISOSCOPE_RETURN_IF_ERROR(fields.status());
  shard_index_ = static_cast<int>(shard_index);

  const ShardSummary& expected = manifest_.shards[static_cast<std::size_t>(shard_index)];
  summary.block_count = expected.block_count;
  if (dataset_id != manifest_.dataset_id || shard_count != manifest_shard_count ||
      manifest_crc32c != manifest_crc32c_ || summary != expected) {
    return absl::DataLossError(absl::StrFormat(
        "%s: describes shard %d of %d of dataset %s, manifest crc32c 0x%08x; the manifest beside "
        "it is of dataset %s with %d shards, crc32c 0x%08x: files of different datasets are mixed",
        path, shard_index, shard_count, dataset_id, manifest_crc32c, manifest_.dataset_id,
        manifest_shard_count, manifest_crc32c_));
  }

  // 4: the head of the interval tree.
  const std::string tree_path = PathIn(directory_, kIntervalTreeFileName);
  ISOSCOPE_ASSIGN_OR_RETURN(const auto tree_file, OpenRequired(tree_path, open_file));
  if (tree_file->size_bytes() != tree_bytes) {
    return absl::DataLossError(absl::StrFormat("%s: %d bytes, expected %d", tree_path,
                                               tree_file->size_bytes(), tree_bytes));
  }
  std::string head(static_cast<std::size_t>(std::min(tree_bytes, kIntervalTreeHeadBytes)), '\0');
  ISOSCOPE_RETURN_IF_ERROR(tree_file->ReadAt(0, head.size(), head.data()));
  if (const std::uint32_t computed = base::Crc32c(head); computed != tree_head_crc32c) {
    return absl::DataLossError(
        absl::StrFormat("%s: %d bytes at offset 0: crc32c 0x%08x stored in %s, 0x%08x computed",
                        tree_path, head.size(), tree_head_crc32c, path, computed));
  }
  return absl::OkStatus();
}

absl::Status ShardReader::ReadBlockIndex(const OpenFile& open_file,
                                         const OpenSamples& open_samples) {
  const ShardSummary& expected = manifest_.shards[static_cast<std::size_t>(shard_index_)];
  const std::string path = PathIn(directory_, kBlockIndexFileName);
  const std::int64_t size = static_cast<std::int64_t>(kBinaryHeaderBytes) +
                            static_cast<std::int64_t>(kBlockIndexEntryBytes) * expected.block_count;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes, ReadRequired(path, size, open_file));
  ISOSCOPE_ASSIGN_OR_RETURN(const BinaryHeader header,
                            DecodeBinaryFile(kBlockIndexMagic, bytes, path));
  ISOSCOPE_RETURN_IF_ERROR(CheckFileCrc32c(path, bytes, expected.block_index_crc32c, "the manifest",
                                           "of another shard"));
  if (header.scalar_type != static_cast<std::uint32_t>(manifest_.scalar_type) ||
      header.entry_size != kBlockIndexEntryBytes || header.count != expected.block_count ||
      header.data_size != expected.block_bytes) {
    return absl::DataLossError(absl::StrFormat(
        "%s: header states %d entries of %d bytes, sample type %d, %d bytes of blocks; expected "
        "%d, %d, %d, %d",
        path, header.count, header.entry_size, header.scalar_type, header.data_size,
        expected.block_count, kBlockIndexEntryBytes, static_cast<int>(manifest_.scalar_type),
        expected.block_bytes));
  }
  ISOSCOPE_RETURN_IF_ERROR(DecodeEntries(path, bytes));
  return OpenBlocks(open_file, open_samples);
}

absl::Status ShardReader::DecodeEntries(const std::string& path, absl::string_view bytes) {
  entries_.reserve((bytes.size() - kBinaryHeaderBytes) / kBlockIndexEntryBytes);
  // Blocks may come in any order, because other writers may use another one.
  volume::BlockSet seen(layout_.block_count());
  std::int64_t offset = 0;
  std::int64_t raw_offset = 0;
  for (std::size_t at = kBinaryHeaderBytes; at < bytes.size(); at += kBlockIndexEntryBytes) {
    const BlockIndexEntry entry = DecodeBlockIndexEntry(bytes.data() + at);
    if (entry.encoding > static_cast<std::uint32_t>(kLastBlockEncoding)) {
      return absl::FailedPreconditionError(absl::StrFormat(
          "%s: offset %d: block %d is stored in encoding %d, this program reads 0 to %d; use a "
          "newer program",
          path, at, entry.block_id, entry.encoding,
          static_cast<std::uint32_t>(kLastBlockEncoding)));
    }
    if (entry.block_id >= layout_.block_count() || seen.Contains(entry.block_id)) {
      return absl::DataLossError(
          absl::StrFormat("%s: offset %d: block %d, expected ids below %d, each once", path, at,
                          entry.block_id, layout_.block_count()));
    }
    seen.Insert(entry.block_id);
    const std::size_t raw_size =
        volume::StoredSizeBytes(layout_, entry.block_id, manifest_.scalar_type);
    const auto encoding = static_cast<BlockEncoding>(entry.encoding);
    const bool is_expected = encoding == BlockEncoding::kRaw ||
                             (encoding == BlockEncoding::kOverhang) == is_index_only();
    const bool has_right_size = encoding == BlockEncoding::kRaw
                                    ? entry.size == raw_size
                                    : is_expected && entry.size > 0 && entry.size < raw_size;
    if (!has_right_size || entry.raw_size != raw_size || entry.offset != offset) {
      return absl::DataLossError(absl::StrFormat(
          "%s: offset %d: block %d of %d stored (%s) and %d raw bytes at %d, expected %d raw bytes "
          "at %d, fewer if compressed",
          path, at, entry.block_id, entry.size, NameOf(encoding), entry.raw_size, entry.offset,
          raw_size, offset));
    }
    const Entry stored{.block_id = entry.block_id,
                       .size = entry.size,
                       .offset = offset,
                       .crc32c = entry.crc32c,
                       .encoding = encoding};
    offset += entry.size;
    if (is_index_only()) {
      overhangs_.push_back(stored);
      entries_.push_back({.block_id = entry.block_id,
                          .size = static_cast<std::uint32_t>(raw_size),
                          .offset = raw_offset});
      raw_offset += static_cast<std::int64_t>(raw_size);
    } else {
      entries_.push_back(stored);
    }
  }
  return absl::OkStatus();
}

absl::Status ShardReader::OpenBlocks(const OpenFile& open_file, const OpenSamples& open_samples) {
  const std::int64_t manifest_bytes =
      manifest_.shards[static_cast<std::size_t>(shard_index_)].block_bytes;
  const std::vector<Entry>& stored = is_index_only() ? overhangs_ : entries_;
  const std::int64_t index_bytes =
      stored.empty() ? 0 : stored.back().offset + std::int64_t{stored.back().size};
  const std::string path = PathIn(directory_, kBlocksFileName);
  ISOSCOPE_ASSIGN_OR_RETURN(blocks_file_, OpenRequired(path, open_file));
  blocks_file_->ExpectScatteredReads();
  if (index_bytes != manifest_bytes || blocks_file_->size_bytes() != index_bytes) {
    return absl::DataLossError(
        absl::StrFormat("%s: %d bytes, the manifest expects %d and the block index %d", path,
                        blocks_file_->size_bytes(), manifest_bytes, index_bytes));
  }
  if (is_index_only()) {
    if (open_samples == nullptr) {
      return absl::FailedPreconditionError(absl::StrFormat(
          "%s: an index-only dataset: its samples are in %s, and this program may read no source",
          directory_, manifest_.in_source->request.at("path")));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(samples_, open_samples(manifest_));
    overhangs_file_ = std::move(blocks_file_);
    blocks_file_ = MakeSourceFile(nullptr);
  }
  return absl::OkStatus();
}

std::unique_ptr<io::RandomAccessFile> ShardReader::MakeSourceFile(
    const base::Cancellation* cancellation) const {
  const auto find = [this](std::int64_t offset) {
    const auto behind =
        std::upper_bound(entries_.begin(), entries_.end(), offset,
                         [](std::int64_t at, const Entry& entry) { return at < entry.offset; });
    const auto entry = std::prev(behind);
    return BlockPlace{.ordinal = static_cast<std::uint32_t>(entry - entries_.begin()),
                      .offset = entry->offset,
                      .size = entry->size};
  };
  const auto read = [this](std::uint32_t ordinal, const base::Cancellation& ends, char* out) {
    return ReadSourceBlock(ordinal, ends, out);
  };
  const std::int64_t size_bytes =
      entries_.empty() ? 0 : entries_.back().offset + std::int64_t{entries_.back().size};
  return MakeSourceBlocksFile(overhangs_file_->path(), size_bytes,
                              {.find = find, .read = read, .is_local = samples_->is_local()},
                              cancellation);
}

absl::Status ShardReader::ReadSourceBlock(std::uint32_t ordinal,
                                          const base::Cancellation& cancellation, char* out) const {
  const Entry& stored = overhangs_[ordinal];
  const Entry& entry = entries_[ordinal];
  std::string bytes(stored.size, '\0');
  ISOSCOPE_RETURN_IF_ERROR(overhangs_file_->ReadAt(stored.offset, bytes.size(), bytes.data()));
  ISOSCOPE_RETURN_IF_ERROR(CheckStored(stored, bytes, *overhangs_file_));
  if (stored.encoding == BlockEncoding::kRaw) {
    bytes.copy(out, bytes.size());
    return absl::OkStatus();
  }
  const auto in_block = [&](const absl::Status& status) {
    return base::WithPrefix(
        absl::StrCat("block ", entry.block_id, " of ", overhangs_file_->path(), ": "), status);
  };
  if (absl::Status status = samples_->ReadBlock(entry.block_id, cancellation, out); !status.ok()) {
    return in_block(status);
  }
  const absl::StatusOr<std::uint32_t> expected = DecodeOverhang(
      layout_, *manifest_.in_source, manifest_.scalar_type, entry.block_id, bytes, out);
  if (!expected.ok()) {
    return in_block(expected.status());
  }
  const std::uint32_t computed = base::ExtendCrc32c(0, out, entry.size);
  if (computed != *expected) {
    const base::ThreadInterrupt interrupt(cancellation);
    if (const absl::Status status = samples_->Doubt(entry.block_id); !status.ok()) {
      return in_block(status);
    }
    return in_block(absl::DataLossError(absl::StrFormat(
        "its samples in %s are not those that were partitioned (crc32c 0x%08x, now 0x%08x): the "
        "source has changed; bring it back as it was, or partition it anew",
        source_name(), *expected, computed)));
  }
  return absl::OkStatus();
}

absl::Status ShardReader::CheckStored(const Entry& entry, absl::string_view stored,
                                      const io::RandomAccessFile& file) const {
  const std::uint32_t computed = base::Crc32c(stored);
  return computed == entry.crc32c
             ? absl::OkStatus()
             : absl::DataLossError(absl::StrFormat(
                   "%s: block %d: %d bytes at offset %d of %s: crc32c 0x%08x stored, 0x%08x "
                   "computed; copy the shard again or partition anew",
                   Where(), entry.block_id, entry.size, entry.offset, file.path(), entry.crc32c,
                   computed));
}

std::unique_ptr<io::RandomAccessFile> ShardReader::OpenSourceBlocks(
    const base::Cancellation& cancellation) const {
  ISOSCOPE_CHECK(is_index_only());
  return MakeSourceFile(&cancellation);
}

std::int64_t ShardReader::block_count() const { return static_cast<std::int64_t>(entries_.size()); }

volume::BlockId ShardReader::block_id(std::uint32_t ordinal) const {
  ISOSCOPE_CHECK_LT(ordinal, entries_.size());
  return entries_[ordinal].block_id;
}

std::int64_t ShardReader::stored_bytes(std::uint32_t ordinal) const {
  ISOSCOPE_CHECK_LT(ordinal, entries_.size());
  return entries_[ordinal].size;
}

absl::StatusOr<std::optional<volume::SampleHistogram>> ShardReader::ReadHistogram() const {
  if (!histogram_crc32c_.has_value()) {
    return std::nullopt;
  }
  const std::string path = PathIn(directory_, kHistogramFileName);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                            ReadRequired(path, histogram_bytes_, open_file_));
  ISOSCOPE_RETURN_IF_ERROR(CheckFileCrc32c(path, bytes, *histogram_crc32c_, kShardFileName,
                                           "damaged or of another shard"));
  ISOSCOPE_ASSIGN_OR_RETURN(volume::SampleHistogram histogram,
                            DecodeHistogram(bytes, manifest_.scalar_type, path));
  // Infinite samples do not count for the range of the bins.
  const volume::ScalarSpan range = manifest_.finite_range.value_or(manifest_.value_range);
  if ((volume::IsFinite(range) || manifest_.finite_range.has_value()) &&
      !(histogram.bins == volume::BinsOf(manifest_.scalar_type, range))) {
    return absl::DataLossError(absl::StrFormat(
        "%s: %d bins of 2^%d from %d on, expected those of the samples' range, %g to %g", path,
        histogram.bins.count, histogram.bins.exponent, histogram.bins.first, range.min, range.max));
  }
  std::int64_t sample_count = 0;
  for (const Entry& entry : entries_) {
    sample_count += math::Volume(volume::CountedSamplesOf(layout_, entry.block_id).dims());
  }
  if (histogram.TotalCount() != sample_count) {
    return absl::DataLossError(absl::StrFormat("%s: counts %d samples, the shard's blocks have %d",
                                               path, histogram.TotalCount(), sample_count));
  }
  return histogram;
}

std::string ShardReader::Where() const {
  return absl::StrFormat("dataset %s (%s), shard %d of %d", manifest_.name, manifest_.dataset_id,
                         shard_index_, manifest_.shards.size());
}

std::vector<ShardReader::DiskRun> ShardReader::PlanDiskRuns(
    absl::Span<const std::uint32_t> ordinals) const {
  std::vector<std::int64_t> gaps;
  std::int64_t useful_bytes = 0;
  for (std::size_t i = 0; i < ordinals.size(); ++i) {
    ISOSCOPE_CHECK_LT(ordinals[i], entries_.size());
    ISOSCOPE_DCHECK(i == 0 || ordinals[i - 1] < ordinals[i]);
    const Entry& entry = entries_[ordinals[i]];
    useful_bytes += entry.size;
    if (i > 0) {
      const Entry& before = entries_[ordinals[i - 1]];
      if (const std::int64_t gap = entry.offset - (before.offset + before.size); gap > 0) {
        gaps.push_back(gap);
      }
    }
  }
  // Find the largest gap that is read over. Only the first `ties_left` gaps of that size are read
  // over.
  std::sort(gaps.begin(), gaps.end());
  auto budget = is_index_only()
                    ? std::int64_t{0}
                    : static_cast<std::int64_t>(kMaxGapShare * static_cast<double>(useful_bytes));
  std::int64_t largest_gap = 0;
  std::int64_t ties_left = 0;
  for (const std::int64_t gap : gaps) {
    budget -= gap;
    if (budget < 0) {
      break;
    }
    ties_left = gap == largest_gap ? ties_left + 1 : 1;
    largest_gap = gap;
  }

  std::vector<DiskRun> runs;
  math::Index3 unit{-1, -1, -1};
  for (std::size_t i = 0; i < ordinals.size(); ++i) {
    const Entry& entry = entries_[ordinals[i]];
    const std::int64_t end = entry.offset + entry.size;
    const math::Index3 last_unit = unit;
    if (is_index_only()) {
      unit = samples_->UnitOf(entry.block_id);
    }
    if (!runs.empty() && unit == last_unit) {
      DiskRun& run = runs.back();
      const std::int64_t gap = entry.offset - (run.offset + run.size);
      if ((gap == 0 || gap < largest_gap || (gap == largest_gap && ties_left > 0)) &&
          end - run.offset <= kMaxDiskRunBytes) {
        ties_left -= gap == largest_gap ? 1 : 0;
        run.size = end - run.offset;
        ++run.count;
        continue;
      }
    }
    runs.push_back({.offset = entry.offset, .size = entry.size, .first = i, .count = 1});
  }
  return runs;
}

absl::Status ShardReader::ReadDiskRun(
    const DiskRun& run, absl::Span<const std::uint32_t> ordinals, char* buffer,
    absl::FunctionRef<absl::Status(const volume::BlockSamples&)> visit) const {
  const auto size = static_cast<std::size_t>(run.size);
  return VisitDiskRun(run, ordinals, blocks_file_->ReadAt(run.offset, size, buffer), buffer, visit);
}

io::ReadQueue::Read ShardReader::RequestFor(const DiskRun& run) const {
  return {
      .file = blocks_file_.get(), .offset = run.offset, .size = static_cast<std::size_t>(run.size)};
}

absl::Status ShardReader::VisitDiskRun(
    const DiskRun& run, absl::Span<const std::uint32_t> ordinals, const absl::Status& read_status,
    const char* bytes, absl::FunctionRef<absl::Status(const volume::BlockSamples&)> visit) const {
  ISOSCOPE_CHECK_LE(run.first + run.count, ordinals.size());
  if (!read_status.ok()) {
    return base::WithPrefix(absl::StrCat(Where(), ": "), read_status);
  }
  BlockBuffers buffers;
  for (const std::uint32_t ordinal : ordinals.subspan(run.first, run.count)) {
    ISOSCOPE_CHECK_LT(ordinal, entries_.size());
    const Entry& entry = entries_[ordinal];
    ISOSCOPE_CHECK_GE(entry.offset, run.offset);
    ISOSCOPE_CHECK_LE(entry.offset + entry.size, run.offset + run.size);
    ISOSCOPE_ASSIGN_OR_RETURN(
        const char* const samples,
        VerifyAndDecode(entry, bytes + (entry.offset - run.offset), &buffers));
    ISOSCOPE_RETURN_IF_ERROR(
        visit({.block_id = entry.block_id, .type = manifest_.scalar_type, .bytes = samples}));
  }
  return absl::OkStatus();
}

absl::StatusOr<const char*> ShardReader::VerifyAndDecode(const Entry& entry, const char* stored,
                                                         BlockBuffers* buffers) const {
  if (is_index_only()) {
    return stored;  // ReadSourceBlock has verified it
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckStored(entry, {stored, entry.size}, *blocks_file_));
  if (entry.encoding == BlockEncoding::kRaw) {
    return stored;
  }
  buffers->samples.resize(volume::StoredSizeBytes(layout_, entry.block_id, manifest_.scalar_type));
  const absl::Status status = DecodeBlock(
      entry.encoding, manifest_.scalar_type, layout_.StoredSamplesOf(entry.block_id).dims(),
      {stored, entry.size}, &buffers->scratch, buffers->samples.data());
  if (!status.ok()) {
    return absl::DataLossError(absl::StrFormat("%s: block %d at offset %d of %s: %s", Where(),
                                               entry.block_id, entry.offset, blocks_file_->path(),
                                               status.message()));
  }
  return buffers->samples.data();
}

}  // namespace isoscope::store
