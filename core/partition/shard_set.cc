#include "core/partition/shard_set.h"

#include <algorithm>
#include <array>
#include <memory>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/types/span.h"
#include "oneapi/tbb/parallel_for.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/index/interval_tree_builder.h"
#include "core/io/file.h"
#include "core/store/block_codec.h"
#include "core/store/block_overhang.h"
#include "core/store/histogram_file.h"

namespace isoscope::partition {
namespace {

// Blocks may be copied meanwhile, 14 MB of 16-bit samples in blocks of 16^3 cells.
constexpr std::uint32_t kBlocksBetweenChecks = 1 << 10;
// Smaller writes past the page cache take longer than copies into it.
constexpr std::int64_t kMinDirectBytes = 256 * base::kKiB;

}  // namespace

ShardSet::ShardSet(const std::string& directory, const volume::BlockLayout& layout,
                   volume::ScalarType type, const PartitionPlan& plan,
                   store::BlockEncoding encoding,
                   const std::optional<store::SourceSamples>& in_source)
    : directory_(directory),
      layout_(layout),
      type_(type),
      plan_(plan),
      encoding_(in_source.has_value() ? store::BlockEncoding::kOverhang : encoding),
      in_source_(in_source),
      entries_(directory, plan.entry_bytes) {}

absl::Status ShardSet::Create(int shard_count, bool is_direct) {
  const auto buffer_bytes = static_cast<std::size_t>(plan_.file_buffer_bytes);
  const bool are_blocks_direct = is_direct && plan_.file_buffer_bytes >= kMinDirectBytes;
  const auto create_file =
      [=](const std::string& path) -> absl::StatusOr<std::unique_ptr<io::WritableFile>> {
    const bool is_of_blocks = absl::EndsWith(path, store::kBlocksFileName);
    return are_blocks_direct && is_of_blocks ? io::CreateDirectFile(path, buffer_bytes)
                                             : io::CreateBufferedFile(path, buffer_bytes);
  };
  for (int shard = 0; shard < shard_count; ++shard) {
    directories_.push_back(
        absl::StrCat(directory_, "/", store::ShardDirectoryName(shard, shard_count)));
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::unique_ptr<store::ShardWriter> writer,
        store::ShardWriter::Create(directories_.back(), layout_, type_, create_file));
    writers_.push_back(std::move(writer));
  }
  return absl::OkStatus();
}

absl::Status ShardSet::Write(BlockBatch* batch) {
  if (encoding_ != store::BlockEncoding::kRaw) {
    EncodeBlocks(batch);
  }
  std::vector<std::size_t> begins;  // the first block of each shard, and the end
  for (std::size_t i = 0; i < batch->blocks.size(); ++i) {
    if (i == 0 || batch->ShardAt(i) != batch->ShardAt(i - 1)) {
      begins.push_back(i);
    }
  }
  begins.push_back(batch->blocks.size());
  std::vector<absl::Status> statuses(begins.size() - 1);
  tbb::parallel_for(std::size_t{0}, statuses.size(), [&](std::size_t k) {
    statuses[k] = encoding_ == store::BlockEncoding::kRaw
                      ? WriteOfShard(begins[k], begins[k + 1], batch)
                      : AppendToShard(begins[k], begins[k + 1], batch);
  });
  for (const absl::Status& status : statuses) {
    ISOSCOPE_RETURN_IF_ERROR(status);
  }
  for (std::size_t i = 0; i < batch->blocks.size(); ++i) {
    const auto& [placement, id] = batch->blocks[i];
    const store::BlockIndexEntry& stored = batch->entries[i];
    ISOSCOPE_RETURN_IF_ERROR(
        entries_.Add({.span = batch->spans[i],
                      .offset = stored.offset,
                      .size = stored.size,
                      .crc32c = stored.crc32c,
                      .id = id,
                      .ordinal = placement.ordinal,
                      .shard = placement.shard,
                      .encoding = static_cast<std::uint16_t>(stored.encoding)}));
  }
  return absl::OkStatus();
}

// Encoded blocks are not larger than their samples.
void ShardSet::EncodeBlocks(BlockBatch* batch) const {
  tbb::parallel_for(std::size_t{0}, batch->blocks.size(), [&](std::size_t i) {
    const volume::BlockId id = batch->blocks[i].id;
    char* const bytes = batch->bytes.data() + batch->offsets[i];
    const absl::string_view samples(bytes, batch->offsets[i + 1] - batch->offsets[i]);
    std::string stored;
    const store::BlockEncoding encoding =
        in_source_.has_value()
            ? store::EncodeOverhang(layout_, *in_source_, type_, id, samples, &stored)
            : store::EncodeBlock(encoding_, type_, layout_.StoredSamplesOf(id).dims(), samples,
                                 &stored);
    stored.copy(bytes, stored.size());
    batch->entries[i] = {.block_id = id,
                         .encoding = static_cast<std::uint32_t>(encoding),
                         .size = static_cast<std::uint32_t>(stored.size()),
                         .crc32c = base::Crc32c(stored)};
  });
}

absl::Status ShardSet::AppendToShard(std::size_t begin, std::size_t end, BlockBatch* batch) {
  store::ShardWriter& writer = *writers_[batch->ShardAt(begin)];
  for (std::size_t i = begin; i < end; ++i) {
    store::BlockIndexEntry& entry = batch->entries[i];
    ISOSCOPE_ASSIGN_OR_RETURN(
        entry.offset,
        writer.AppendBlock(entry.block_id, {batch->bytes.data() + batch->offsets[i], entry.size}));
  }
  return absl::OkStatus();
}

// Blocks with successive ordinals are neighbours in the batch and in the file: one write for them.
absl::Status ShardSet::WriteOfShard(std::size_t begin, std::size_t end, BlockBatch* batch) {
  store::ShardWriter& writer = *writers_[batch->ShardAt(begin)];
  for (std::size_t first = begin; first < end;) {
    std::size_t last = first;
    std::vector<volume::BlockId> ids;
    do {
      ids.push_back(batch->blocks[last].id);
      ++last;
    } while (last < end && batch->blocks[last].placement.ordinal ==
                               batch->blocks[last - 1].placement.ordinal + 1);
    std::vector<std::uint32_t> crcs(ids.size());
    ISOSCOPE_RETURN_IF_ERROR(
        writer.WriteBlocks(ids, batch->blocks[first].placement.offset,
                           absl::string_view(batch->bytes.data() + batch->offsets[first],
                                             batch->offsets[last] - batch->offsets[first]),
                           absl::MakeSpan(crcs)));
    for (std::size_t i = first; i < last; ++i) {
      batch->entries[i] = {
          .block_id = batch->blocks[i].id,
          .offset = batch->blocks[i].placement.offset,
          .size = static_cast<std::uint32_t>(batch->offsets[i + 1] - batch->offsets[i]),
          .crc32c = crcs[i - first]};
    }
    first = last;
  }
  return absl::OkStatus();
}

store::BlockIndexEntry ShardSet::IndexEntryOf(const Entry& entry) {
  return {.block_id = entry.id,
          .encoding = entry.encoding,
          .offset = entry.offset,
          .size = entry.size,
          .crc32c = entry.crc32c};
}

absl::StatusOr<std::vector<store::ShardSummary>> ShardSet::Finish(
    const HistogramBuilder& histograms, const base::Cancellation& cancellation) {
  ISOSCOPE_RETURN_IF_ERROR(entries_.Finish());
  std::vector<store::ShardSummary> summaries;
  for (std::size_t shard = 0; shard < directories_.size(); ++shard) {
    ISOSCOPE_ASSIGN_OR_RETURN(store::ShardSummary summary,
                              FinishShard(shard, histograms, cancellation));
    summaries.push_back(summary);
  }
  return summaries;
}

// Takes the entries of the shard, which come next.
absl::StatusOr<store::ShardSummary> ShardSet::FinishShard(std::size_t shard,
                                                          const HistogramBuilder& histograms,
                                                          const base::Cancellation& cancellation) {
  index::IntervalTreeBuilder tree({.scratch_directory = directories_[shard],
                                   .memory_bytes = plan_.tree_bytes,
                                   .cancellation = &cancellation});
  store::ShardWriter& writer = *writers_[shard];
  for (std::uint32_t ordinal = 0; !entries_.is_at_end() && entries_.current().shard == shard;
       ++ordinal) {
    const Entry& entry = entries_.current();
    ISOSCOPE_CHECK_EQ(entry.ordinal, ordinal);
    if (ordinal % kBlocksBetweenChecks == 0) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    }
    ISOSCOPE_RETURN_IF_ERROR(writer.AppendIndexEntry(IndexEntryOf(entry)));
    ISOSCOPE_RETURN_IF_ERROR(
        tree.Add({.span = entry.span, .block_id = entry.id, .ordinal = ordinal}));
    ISOSCOPE_RETURN_IF_ERROR(entries_.Advance());
  }
  ISOSCOPE_ASSIGN_OR_RETURN(store::ShardSummary summary, writer.Finish());
  writers_[shard].reset();  // frees its buffers
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::unique_ptr<io::WritableFile> file,
      io::CreateWritableFile(absl::StrCat(directories_[shard], "/", store::kIntervalTreeFileName)));
  ISOSCOPE_RETURN_IF_ERROR(tree.Finish(file.get()));
  ISOSCOPE_RETURN_IF_ERROR(
      io::WriteWholeFile(absl::StrCat(directories_[shard], "/", store::kHistogramFileName),
                         store::EncodeHistogram(type_, histograms.Get(static_cast<int>(shard)))));
  return summary;
}

absl::StatusOr<std::vector<store::ShardPiece>> ShardSet::FinishPieces(
    const HistogramBuilder& histograms, const base::Cancellation& cancellation) {
  ISOSCOPE_RETURN_IF_ERROR(entries_.Finish());
  std::vector<store::ShardPiece> pieces;
  for (std::size_t shard = 0; shard < directories_.size(); ++shard) {
    ISOSCOPE_ASSIGN_OR_RETURN(store::ShardPiece piece,
                              FinishPiece(shard, histograms, cancellation));
    if (piece.summary.block_count > 0) {
      ISOSCOPE_RETURN_IF_ERROR(io::SyncDirectory(directories_[shard]));
    }
    pieces.push_back(piece);
  }
  return pieces;
}

// Takes the entries of the shard, which come next.
absl::StatusOr<store::ShardPiece> ShardSet::FinishPiece(std::size_t shard,
                                                        const HistogramBuilder& histograms,
                                                        const base::Cancellation& cancellation) {
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  if (entries_.is_at_end() || entries_.current().shard != shard) {
    writers_[shard].reset();
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(directories_[shard]));
    return store::ShardPiece{};
  }
  store::ShardPiece piece;
  store::ShardWriter& writer = *writers_[shard];
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::unique_ptr<io::WritableFile> spans,
      io::CreateWritableFile(absl::StrCat(directories_[shard], "/", store::kSpansFileName)));
  for (std::uint32_t i = 0; !entries_.is_at_end() && entries_.current().shard == shard; ++i) {
    const Entry& entry = entries_.current();
    if (i % kBlocksBetweenChecks == 0) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    }
    ISOSCOPE_RETURN_IF_ERROR(writer.AppendIndexEntry(IndexEntryOf(entry)));
    std::array<char, store::kSpanBytes> span{};
    base::StoreLittleEndian(entry.span.min, span.data());
    base::StoreLittleEndian(entry.span.max, span.data() + sizeof(double));
    piece.spans_crc32c = base::ExtendCrc32c(piece.spans_crc32c, span.data(), span.size());
    ISOSCOPE_RETURN_IF_ERROR(spans->Append({span.data(), span.size()}));
    ISOSCOPE_RETURN_IF_ERROR(entries_.Advance());
  }
  ISOSCOPE_RETURN_IF_ERROR(spans->Close());
  ISOSCOPE_ASSIGN_OR_RETURN(piece.summary, writer.Finish());
  writers_[shard].reset();  // frees its buffers
  const std::string histogram =
      store::EncodeHistogram(type_, histograms.Get(static_cast<int>(shard)));
  piece.histogram_crc32c = base::Crc32c(histogram);
  ISOSCOPE_RETURN_IF_ERROR(io::WriteWholeFile(
      absl::StrCat(directories_[shard], "/", store::kHistogramFileName), histogram));
  return piece;
}

}  // namespace isoscope::partition
