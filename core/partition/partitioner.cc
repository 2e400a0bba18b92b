// Two orders meet here: blocks are read in the order of the volume, and files are written in the
// order of each shard. Records that know both are sorted on disk, so no table of all blocks is in
// memory.
//
//    1  ShardMap: the shard of each block
//                |
//    2  all blocks in the order of shards (BlocksInOrder): next ordinal and offset of the shard
//                |
//                |  Placement {position, shard, ordinal, offset}
//                v
//       placements_, sorted by position: the order in which blocks are cut
//                |
//    3  portion -> FillBatch -> CutBatch -> WriteBatch -> blocks.bin of each shard, at the offset
//                |
//                |  Entry {shard, ordinal, id, span, CRC-32C}
//                v
//       entries_, sorted by (shard, ordinal)
//                |
//    4  FinishShard, shard by shard: block_index.bin, interval_tree.bin, histogram.bin; then
//       CompressShard
//                |
//    5  ranges.bin, which grows along with 3; shard.json and manifest.json of each shard;
//       the dataset's manifest.json; at last the folder gets its name
//
// Example: blocks A, B, C of 100 stored bytes, in the order of shards, go to the shards 0, 1, 0.
// Their placements have the ordinals 0, 0, 1 and the offsets 0, 0, 100. If C is cut before B, its
// position is the lower one, and C is written first.
//
// The next portion is read, a batch is cut and the batch before it is written at the same time.
//
// Invariants: the placement taken next has the position that counts the blocks cut so far; the
// entries of a shard have the ordinals 0, 1, 2, ...; the bytes depend on source and options alone.
//
// Files: docs/format/dataset.md, docs/format/shard.md. Distributions: distribution.h.

#include "core/partition/partitioner.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <numeric>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"
#include "absl/types/span.h"
#include "oneapi/tbb/enumerable_thread_specific.h"
#include "oneapi/tbb/parallel_for.h"
#include "oneapi/tbb/task_group.h"

#include "core/base/check.h"
#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/extract/gradient_bound.h"
#include "core/index/interval_tree_builder.h"
#include "core/io/atomic_file.h"
#include "core/io/external_sorter.h"
#include "core/io/file.h"
#include "core/partition/block_cutter.h"
#include "core/partition/distribution.h"
#include "core/partition/histogram_builder.h"
#include "core/partition/partition_plan.h"
#include "core/partition/portion_reader.h"
#include "core/partition/samples_digest.h"
#include "core/store/block_order.h"
#include "core/store/histogram_file.h"
#include "core/store/shard_compressor.h"
#include "core/store/shard_format.h"
#include "core/store/shard_writer.h"
#include "core/volume/block_samples.h"
#include "core/volume/sample_histogram.h"

namespace isoscope::partition {
namespace {

constexpr std::uint32_t kBlocksBetweenChecks = 1 << 16;
// Blocks of a shard whose samples one task counts: enough that adding up its bins is little.
constexpr std::size_t kBlocksPerCount = 64;

std::string BaseName(const std::string& path) { return path.substr(path.rfind('/') + 1); }

// "a/b//" is "a/b".
std::string WithoutTrailingSlashes(std::string path) {
  while (path.size() > 1 && path.back() == '/') {
    path.pop_back();
  }
  return path;
}

absl::Status ValidateName(const std::string& name) {
  constexpr std::size_t kMaxNameBytes = 200;  // leaves room for ".partial-<pid>" in a file name
  const bool is_valid =
      !name.empty() && name.size() <= kMaxNameBytes &&
      (absl::ascii_isalnum(static_cast<unsigned char>(name[0])) || name[0] == '_') &&
      std::all_of(name.begin(), name.end(), [](char c) {
        return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '_' ||
               c == '-';
      });
  if (!is_valid) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "output folder \"%s\": its name becomes the dataset's name; expected 1 to %d letters, "
        "digits, '.', '_' and '-', starting with a letter, a digit or '_'",
        name, kMaxNameBytes));
  }
  return absl::OkStatus();
}

absl::Status ValidateOutput(const std::string& output) {
  ISOSCOPE_RETURN_IF_ERROR(ValidateName(BaseName(output)));
  if (io::PathExists(output)) {
    return absl::AlreadyExistsError(absl::StrCat(
        "output ", output, " exists: remove it, or give a folder that does not exist yet"));
  }
  const std::size_t slash = output.rfind('/');
  const std::string parent = slash == std::string::npos ? "."
                             : slash == 0               ? "/"
                                                        : output.substr(0, slash);
  if (!io::IsDirectory(parent)) {
    return absl::NotFoundError(absl::StrFormat(
        "output %s: its parent folder %s does not exist: create it (mkdir -p)", output, parent));
  }
  return absl::OkStatus();
}

absl::Status ValidateShardCount(int shard_count, const volume::BlockLayout& layout) {
  const std::int64_t block_count = layout.block_count();
  const std::int64_t max = std::min<std::int64_t>(store::kMaxShardCount, block_count);
  if (shard_count < 1 || shard_count > max) {
    const math::Index3& cells = layout.block_cells();
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d shards for %d blocks of %d x %d x %d cells: expected 1 to %d; fewer shards, or "
        "smaller blocks",
        shard_count, block_count, cells.x, cells.y, cells.z, max));
  }
  return absl::OkStatus();
}

absl::Status CopyFile(const std::string& from, const std::string& to) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto in, io::OpenRandomAccessFile(from));
  ISOSCOPE_ASSIGN_OR_RETURN(const auto out, io::CreateWritableFile(to));
  std::string buffer(static_cast<std::size_t>(base::kMiB), '\0');
  for (std::int64_t offset = 0; offset < in->size_bytes();) {
    const auto size = static_cast<std::size_t>(
        std::min(in->size_bytes() - offset, static_cast<std::int64_t>(buffer.size())));
    ISOSCOPE_RETURN_IF_ERROR(in->ReadAt(offset, size, buffer.data()));
    ISOSCOPE_RETURN_IF_ERROR(out->Append({buffer.data(), size}));
    offset += static_cast<std::int64_t>(size);
  }
  return out->Close();
}

// A folder that is removed with everything in it unless it was kept.
class PartialDirectory {
 public:
  static absl::StatusOr<std::unique_ptr<PartialDirectory>> Create(const std::string& path) {
    // A killed process with the same id may have left one: ids repeat in containers.
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(path));
    ISOSCOPE_RETURN_IF_ERROR(io::CreateDirectory(path));
    return std::make_unique<PartialDirectory>(path);
  }
  explicit PartialDirectory(std::string path) : path_(std::move(path)) {}
  ~PartialDirectory() {
    if (!is_kept_) {
      const absl::Status removed = io::RemoveRecursively(path_);
      if (!removed.ok()) {
        base::LogWarning("partial_dataset_left", {{"path", path_}, {"status", removed}});
      }
    }
  }
  PartialDirectory(const PartialDirectory&) = delete;
  PartialDirectory& operator=(const PartialDirectory&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }
  void Keep() { is_kept_ = true; }

 private:
  std::string path_;
  bool is_kept_ = false;
};

// Where a block is written. Sorted by position: the order in which blocks are cut.
struct Placement {
  std::int64_t offset = 0;     // in its shard
  std::uint32_t position = 0;  // PositionInPortions
  std::uint32_t ordinal = 0;   // in its shard
  std::uint16_t shard = 0;

  friend bool operator<(const Placement& a, const Placement& b) { return a.position < b.position; }
};
static_assert(sizeof(Placement) == kPlacementBytesPerBlock);

// A block's data for the block index and the interval tree of its shard. Sorted by shard and
// ordinal.
struct Entry {
  volume::ScalarSpan span;
  volume::BlockId id = 0;
  std::uint32_t ordinal = 0;
  std::uint32_t crc32c = 0;
  std::uint16_t shard = 0;

  friend bool operator<(const Entry& a, const Entry& b) {
    return std::tie(a.shard, a.ordinal) < std::tie(b.shard, b.ordinal);
  }
};
static_assert(sizeof(Entry) == kEntryBytesPerBlock);

// Blocks that are cut together and then written together.
struct Batch {
  std::vector<volume::BlockId> ids;
  std::vector<Placement> placements;
  std::vector<volume::ScalarSpan> spans;
  std::vector<volume::ScalarSpan> finite_spans;  // without infinite samples
  std::vector<double> gradient_magnitudes;       // of each block, or of those before if longer
  std::vector<std::uint32_t> crcs;
  std::vector<std::size_t> offsets;  // of each block in `bytes`, and the end
  std::vector<std::uint32_t> order;  // indices into `ids`, sorted by shard and ordinal
  std::vector<char> bytes;
};

// One call of Partition.
class Partitioner {
 public:
  Partitioner(source::VolumeSource* source, const PartitionOptions& options,
              volume::BlockLayout layout, const PartitionPlan& plan,
              const base::Cancellation& cancellation)
      : source_(*source),
        options_(options),
        cancellation_(cancellation),
        layout_(layout),
        type_(source->scalar_type()),
        world_gradient_from_index_(source->geometry().world_gradient_from_index()),
        plan_(plan),
        pass_bytes_(math::Volume(layout.sample_dims()) *
                    static_cast<std::int64_t>(volume::SizeOf(type_))) {
    progress_.total_bytes =
        pass_bytes_ * (options.distribution == store::Distribution::kGreedy ? 2 : 1);
  }

  // Writes the whole dataset into `directory`, which exists.
  absl::StatusOr<store::Manifest> Run(const std::string& directory, const std::string& name) {
    PortionReader reader(&source_, layout_, plan_, directory, &cancellation_);
    ISOSCOPE_ASSIGN_OR_RETURN(const ShardMap shards, DealOut(&reader));
    progress_.phase = "writing blocks";
    ISOSCOPE_RETURN_IF_ERROR(CreateShards(directory, shards));
    ISOSCOPE_ASSIGN_OR_RETURN(range_writer_,
                              store::RangeTableWriter::Create(
                                  absl::StrCat(directory, "/", store::kRangeTableFileName), type_));
    entries_.emplace(directory, plan_.entry_bytes);
    histograms_.emplace(layout_, type_, options_.shard_count);
    ISOSCOPE_RETURN_IF_ERROR(ForEachPortion(&reader, [&](const Slab& slab, const Portion& portion) {
      AddToDigest(slab, portion);
      return WriteBlocks(slab, portion);
    }));
    batches_ = {};
    placements_.reset();
    progress_.phase = "building index";
    Report();
    return Finish(directory, name);
  }

 private:
  // Passes over the volume once. The next portion is read while `visit` works on this one.
  template <typename Visit>  // absl::Status(const Slab&, const Portion&)
  absl::Status ForEachPortion(PortionReader* reader, const Visit& visit) {
    const std::int64_t done_before = progress_.done_bytes;
    const std::int64_t count = PortionCount(layout_, plan_);
    const std::size_t buffer_count = plan_.is_double_buffered ? 2 : 1;
    for (std::size_t buffer = 0; buffer < buffer_count; ++buffer) {
      portions_[buffer].resize(static_cast<std::size_t>(plan_.portion_bytes));
    }
    ISOSCOPE_RETURN_IF_ERROR(reader->Read(0, nullptr, portions_[0].data()));
    for (std::int64_t i = 0; i < count; ++i) {
      const char* current = portions_[static_cast<std::size_t>(i) % buffer_count].data();
      char* next = portions_[static_cast<std::size_t>(i + 1) % buffer_count].data();
      absl::Status read;
      const auto read_next = [&] { read = reader->Read(i + 1, current, next); };
      const Portion portion = PortionAt(layout_, plan_, i);
      const math::IndexBox box = SamplesOfPortion(layout_, portion);
      const Slab slab{.samples = current,
                      .begin_z = box.begin.z,
                      .begin_y = box.begin.y,
                      .rows = box.end.y - box.begin.y};
      absl::Status visited;
      {
        tbb::task_group ahead;
        if (buffer_count > 1 && i + 1 < count) {
          ahead.run(read_next);
        }
        visited = visit(slab, portion);
        ahead.wait();
      }
      ISOSCOPE_RETURN_IF_ERROR(visited);
      if (buffer_count == 1 && i + 1 < count) {
        read_next();
      }
      ISOSCOPE_RETURN_IF_ERROR(read);
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      progress_.done_bytes =
          done_before +
          static_cast<std::int64_t>(static_cast<double>(pass_bytes_) *
                                    (static_cast<double>(i + 1) / static_cast<double>(count)));
      Report();
    }
    portions_ = {};
    progress_.done_bytes = done_before + pass_bytes_;
    Report();
    return absl::OkStatus();
  }

  void Report() const {
    if (options_.progress) {
      options_.progress(progress_);
    }
  }

  // Step 1 assigns blocks to shards. The greedy distribution takes a pass of its own.
  absl::StatusOr<ShardMap> DealOut(PortionReader* reader) {
    if (options_.distribution != store::Distribution::kGreedy) {
      return ShardMap::Random(layout_.block_count(), options_.shard_count, options_.seed);
    }
    progress_.phase = "reading ranges";
    volume::RangeTable ranges(type_, layout_.block_count());
    ISOSCOPE_RETURN_IF_ERROR(ForEachPortion(reader, [&](const Slab& slab, const Portion& portion) {
      FindSpans(slab, portion, &ranges);
      return absl::OkStatus();
    }));
    return ShardMap::Greedy(ranges, options_.shard_count);
  }

  void FindSpans(const Slab& slab, const Portion& portion, volume::RangeTable* ranges) const {
    const math::Index3& dims = layout_.block_dims();
    const std::int64_t rows = portion.end_row - portion.begin_row;
    tbb::parallel_for(
        std::int64_t{0}, (portion.end_layer - portion.begin_layer) * rows, [&](std::int64_t row) {
          math::Index3 index{0, portion.begin_row + row % rows, portion.begin_layer + row / rows};
          for (; index.x < dims.x; ++index.x) {
            const volume::BlockId id = layout_.IdOf(index);
            ranges->Set(id, SpanOfBlock(layout_, type_, slab, id));
          }
        });
  }

  // Step 2 finds the placement of every block, and creates the shards' writers.
  absl::Status CreateShards(const std::string& directory, const ShardMap& shards) {
    placements_.emplace(directory, plan_.placement_bytes);
    // By shard: the placement of its next block.
    std::vector<Placement> next(static_cast<std::size_t>(options_.shard_count));
    for (store::BlocksInOrder blocks({.begin = {}, .end = layout_.block_dims()});
         !blocks.is_at_end(); blocks.Next()) {
      const volume::BlockId id = layout_.IdOf(blocks.index());
      const std::uint16_t shard = shards.ShardOf(id);
      Placement& placement = next[shard];
      placement.shard = shard;
      placement.position =
          static_cast<std::uint32_t>(PositionInPortions(layout_, plan_, blocks.index()));
      ISOSCOPE_RETURN_IF_ERROR(placements_->Add(placement));
      ++placement.ordinal;
      placement.offset += static_cast<std::int64_t>(volume::StoredSizeBytes(layout_, id, type_));
    }
    ISOSCOPE_RETURN_IF_ERROR(placements_->Finish());
    for (int shard = 0; shard < options_.shard_count; ++shard) {
      shard_directories_.push_back(
          absl::StrCat(directory, "/", store::ShardDirectoryName(shard, options_.shard_count)));
      ISOSCOPE_ASSIGN_OR_RETURN(
          std::unique_ptr<store::ShardWriter> writer,
          store::ShardWriter::Create(shard_directories_.back(), layout_, type_,
                                     [this](const std::string& path) {
                                       return io::CreateBufferedFile(
                                           path, static_cast<std::size_t>(plan_.file_buffer_bytes));
                                     }));
      writers_.push_back(std::move(writer));
    }
    return absl::OkStatus();
  }

  // Adds the rows of samples that belong to this portion and to no other: those of its blocks'
  // cells, and the last ones of the volume.
  void AddToDigest(const Slab& slab, const Portion& portion) {
    const math::Index3& dims = layout_.sample_dims();
    const math::Index3& cells = layout_.block_cells();
    const auto end_of = [](std::int64_t blocks, std::int64_t all_blocks, std::int64_t edge,
                           std::int64_t samples) {
      return blocks == all_blocks ? samples : blocks * edge;
    };
    const std::int64_t begin_y = portion.begin_row * cells.y;
    const std::int64_t end_y = end_of(portion.end_row, layout_.block_dims().y, cells.y, dims.y);
    const std::int64_t end_z = end_of(portion.end_layer, layout_.block_dims().z, cells.z, dims.z);
    const std::int64_t slab_rows = slab.rows == 0 ? dims.y : slab.rows;
    const auto row_bytes = static_cast<std::size_t>(dims.x) * volume::SizeOf(type_);
    tbb::enumerable_thread_specific<SamplesDigest> digests;
    tbb::parallel_for(portion.begin_layer * cells.z, end_z, [&](std::int64_t z) {
      SamplesDigest& digest = digests.local();
      for (std::int64_t y = begin_y; y < end_y; ++y) {
        const std::int64_t row = (z - slab.begin_z) * slab_rows + y - slab.begin_y;
        digest.AddRow(y, z, {slab.samples + static_cast<std::size_t>(row) * row_bytes, row_bytes});
      }
    });
    for (const SamplesDigest& digest : digests) {
      samples_digest_.Add(digest);
    }
  }

  // Step 3 cuts and writes the blocks of a portion in batches: one batch is cut, in parallel, while
  // the one before is written.
  absl::Status WriteBlocks(const Slab& slab, const Portion& portion) {
    store::BlocksInOrder blocks(BlocksOfPortion(layout_, portion));
    // The ids of a portion's blocks are consecutive.
    const volume::BlockId first_id = layout_.IdOf({0, portion.begin_row, portion.begin_layer});
    volume::RangeTable ranges(type_, (portion.end_layer - portion.begin_layer) *
                                         (portion.end_row - portion.begin_row) *
                                         layout_.block_dims().x);
    absl::Status written;
    tbb::task_group writing;
    for (std::size_t turn = 0; !blocks.is_at_end(); turn = 1 - turn) {
      Batch& batch = batches_[turn];
      absl::Status status = cancellation_.Check();
      if (status.ok()) {
        status = FillBatch(&blocks, &batch);
      }
      if (status.ok()) {
        CutBatch(slab, &batch);
        CountSamples(slab, batch);
        for (std::size_t i = 0; i < batch.ids.size(); ++i) {
          ranges.Set(batch.ids[i] - first_id, batch.spans[i]);
          max_gradient_magnitude_ = std::max(max_gradient_magnitude_, batch.gradient_magnitudes[i]);
        }
      }
      writing.wait();  // also before an error is returned
      ISOSCOPE_RETURN_IF_ERROR(status);
      ISOSCOPE_RETURN_IF_ERROR(written);
      writing.run([this, &written, &batch] { written = WriteBatch(&batch); });
    }
    writing.wait();
    ISOSCOPE_RETURN_IF_ERROR(written);
    const volume::ScalarSpan total = ranges.Total();
    value_range_.min = std::min(value_range_.min, total.min);
    value_range_.max = std::max(value_range_.max, total.max);
    return range_writer_->Append(ranges);
  }

  // Takes the next blocks and their placements, as many as fit a batch.
  absl::Status FillBatch(store::BlocksInOrder* blocks, Batch* batch) {
    batch->bytes.resize(static_cast<std::size_t>(plan_.batch_bytes));
    batch->ids.clear();
    batch->placements.clear();
    batch->offsets.assign(1, 0);
    for (; !blocks->is_at_end() && static_cast<std::int64_t>(batch->ids.size()) < kMaxBatchBlocks;
         blocks->Next()) {
      const volume::BlockId id = layout_.IdOf(blocks->index());
      const std::size_t end = batch->offsets.back() + volume::StoredSizeBytes(layout_, id, type_);
      if (end > batch->bytes.size()) {
        break;
      }
      ISOSCOPE_CHECK(!placements_->is_at_end());
      ISOSCOPE_CHECK_EQ(placements_->current().position, next_position_);
      ++next_position_;
      batch->ids.push_back(id);
      batch->placements.push_back(placements_->current());
      batch->offsets.push_back(end);
      ISOSCOPE_RETURN_IF_ERROR(placements_->Advance());
    }
    return absl::OkStatus();
  }

  // Cuts the blocks of a batch, finds their spans and longest gradients, and sorts them by shard
  // and ordinal.
  void CutBatch(const Slab& slab, Batch* batch) const {
    batch->spans.resize(batch->ids.size());
    batch->finite_spans.resize(batch->ids.size());
    batch->gradient_magnitudes.resize(batch->ids.size());
    tbb::parallel_for(std::size_t{0}, batch->ids.size(), [&](std::size_t i) {
      const volume::BlockId id = batch->ids[i];
      const volume::ScalarSpan span = SpanOfBlock(layout_, type_, slab, id);
      batch->spans[i] = span;
      batch->finite_spans[i] = std::isfinite(span.min) && std::isfinite(span.max)
                                   ? span
                                   : FiniteSpanOfBlock(layout_, type_, slab, id);
      char* const bytes = batch->bytes.data() + batch->offsets[i];
      CutBlock(layout_, type_, slab, id, bytes);
      // Each sample counts in one block alone.
      batch->gradient_magnitudes[i] = extract::MaxGradientMagnitude(
          layout_, world_gradient_from_index_, {.block_id = id, .type = type_, .bytes = bytes},
          volume::CountedSamplesOf(layout_, id), max_gradient_magnitude_);
    });
    batch->order.resize(batch->ids.size());
    std::iota(batch->order.begin(), batch->order.end(), std::uint32_t{0});
    const auto key_of = [&](std::uint32_t i) {
      const Placement& placement = batch->placements[i];
      return std::pair(placement.shard, placement.ordinal);
    };
    std::sort(batch->order.begin(), batch->order.end(),
              [&](std::uint32_t a, std::uint32_t b) { return key_of(a) < key_of(b); });
  }

  // Counts the samples of a batch that was cut, some blocks of one shard at a time.
  void CountSamples(const Slab& slab, const Batch& batch) {
    std::vector<volume::BlockId> ids(batch.order.size());  // in their order
    std::vector<std::size_t> begins;                       // of the tasks, and the end
    for (std::size_t i = 0; i < ids.size(); ++i) {
      ids[i] = batch.ids[batch.order[i]];
      histograms_->Cover(batch.finite_spans[i]);
      if (i == 0 || i - begins.back() == kBlocksPerCount ||
          batch.placements[batch.order[i]].shard != batch.placements[batch.order[i - 1]].shard) {
        begins.push_back(i);
      }
    }
    begins.push_back(ids.size());
    tbb::parallel_for(std::size_t{0}, begins.size() - 1, [&](std::size_t task) {
      histograms_->Count(
          batch.placements[batch.order[begins[task]]].shard,
          absl::MakeConstSpan(ids).subspan(begins[task], begins[task + 1] - begins[task]), slab);
    });
  }

  // Writes the blocks of a batch, those of a shard by one thread in the order of its file, so that
  // neighbours are written together. Adds their entries.
  absl::Status WriteBatch(Batch* batch) {
    const auto shard_at = [&](std::size_t i) { return batch->placements[batch->order[i]].shard; };
    std::vector<std::size_t>
        shard_begins;  // in `order`: the first block of each shard, and the end
    for (std::size_t i = 0; i < batch->order.size(); ++i) {
      if (i == 0 || shard_at(i) != shard_at(i - 1)) {
        shard_begins.push_back(i);
      }
    }
    shard_begins.push_back(batch->order.size());
    batch->crcs.resize(batch->ids.size());
    std::vector<absl::Status> statuses(shard_begins.size() - 1);
    tbb::parallel_for(std::size_t{0}, statuses.size(), [&](std::size_t k) {
      store::ShardWriter& writer = *writers_[shard_at(shard_begins[k])];
      for (std::size_t i = shard_begins[k]; i < shard_begins[k + 1] && statuses[k].ok(); ++i) {
        const std::size_t at = batch->order[i];
        const absl::StatusOr<std::uint32_t> crc32c =
            writer.WriteBlock(batch->ids[at], batch->placements[at].offset,
                              absl::string_view(batch->bytes.data() + batch->offsets[at],
                                                batch->offsets[at + 1] - batch->offsets[at]));
        statuses[k] = crc32c.status();
        batch->crcs[at] = crc32c.value_or(0);
      }
    });
    for (const absl::Status& status : statuses) {
      ISOSCOPE_RETURN_IF_ERROR(status);
    }
    for (std::size_t i = 0; i < batch->ids.size(); ++i) {
      ISOSCOPE_RETURN_IF_ERROR(entries_->Add({.span = batch->spans[i],
                                              .id = batch->ids[i],
                                              .ordinal = batch->placements[i].ordinal,
                                              .crc32c = batch->crcs[i],
                                              .shard = batch->placements[i].shard}));
    }
    return absl::OkStatus();
  }

  // Step 4 writes the block index, the interval tree and the histogram of the next shard in
  // `entries_`.
  absl::StatusOr<store::ShardSummary> FinishShard(std::size_t shard) {
    index::IntervalTreeBuilder tree({.scratch_directory = shard_directories_[shard],
                                     .memory_bytes = plan_.tree_bytes,
                                     .cancellation = &cancellation_});
    store::ShardWriter& writer = *writers_[shard];
    for (std::uint32_t ordinal = 0; !entries_->is_at_end() && entries_->current().shard == shard;
         ++ordinal) {
      const Entry& entry = entries_->current();
      ISOSCOPE_CHECK_EQ(entry.ordinal, ordinal);
      if (ordinal % kBlocksBetweenChecks == 0) {
        ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      }
      ISOSCOPE_RETURN_IF_ERROR(writer.AppendIndexEntry(entry.id, entry.crc32c));
      ISOSCOPE_RETURN_IF_ERROR(
          tree.Add({.span = entry.span, .block_id = entry.id, .ordinal = ordinal}));
      ISOSCOPE_RETURN_IF_ERROR(entries_->Advance());
    }
    ISOSCOPE_ASSIGN_OR_RETURN(store::ShardSummary summary, writer.Finish());
    writers_[shard].reset();  // frees its buffers
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::WritableFile> file,
                              io::CreateWritableFile(absl::StrCat(shard_directories_[shard], "/",
                                                                  store::kIntervalTreeFileName)));
    ISOSCOPE_RETURN_IF_ERROR(tree.Finish(file.get()));
    ISOSCOPE_RETURN_IF_ERROR(io::WriteWholeFile(
        absl::StrCat(shard_directories_[shard], "/", store::kHistogramFileName),
        store::EncodeHistogram(type_, histograms_->Get(static_cast<int>(shard)))));
    return summary;
  }

  // Compresses the shard's blocks, in the memory that its tree was built in.
  absl::StatusOr<store::ShardSummary> Compress(std::size_t shard, const store::ShardSummary& raw) {
    store::CompressOptions options{.encoding = options_.compression};
    options.batch_bytes =
        std::min(options.batch_bytes, static_cast<std::size_t>(plan_.tree_bytes) / 3);
    return store::CompressShard(
        shard_directories_[shard], type_, raw, options,
        [](std::size_t count, absl::FunctionRef<void(std::size_t)> task) {
          tbb::parallel_for(std::size_t{0}, count, task);
        },
        cancellation_);
  }

  // Steps 4 and 5 finish all shards, then write range tables and manifests.
  absl::StatusOr<store::Manifest> Finish(const std::string& directory, const std::string& name) {
    store::Manifest manifest;
    ISOSCOPE_RETURN_IF_ERROR(entries_->Finish());
    for (std::size_t shard = 0; shard < shard_directories_.size(); ++shard) {
      ISOSCOPE_ASSIGN_OR_RETURN(store::ShardSummary summary, FinishShard(shard));
      if (options_.compression != store::BlockEncoding::kRaw) {
        ISOSCOPE_ASSIGN_OR_RETURN(summary, Compress(shard, summary));
      }
      manifest.shards.push_back(summary);
    }
    entries_.reset();
    ISOSCOPE_ASSIGN_OR_RETURN(manifest.range_table_crc32c, range_writer_->Finish());
    const bool is_random = options_.distribution == store::Distribution::kRandom;
    manifest.name = name;
    manifest.source = BaseName(source_.name());
    manifest.geometry = source_.geometry();
    manifest.patient_frame = source_.patient_frame();
    manifest.scalar_type = type_;
    manifest.value_range = value_range_;
    manifest.max_gradient_magnitude = max_gradient_magnitude_;
    manifest.block_cells = layout_.block_cells();
    manifest.distribution = options_.distribution;
    manifest.seed = is_random ? options_.seed : 0;
    manifest.samples_digest = samples_digest_.Finish(manifest.geometry, type_);
    manifest.dataset_id = store::ComputeDatasetId(manifest);
    for (std::size_t shard = 0; shard < shard_directories_.size(); ++shard) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      ISOSCOPE_RETURN_IF_ERROR(
          CopyFile(absl::StrCat(directory, "/", store::kRangeTableFileName),
                   absl::StrCat(shard_directories_[shard], "/", store::kRangeTableFileName)));
      ISOSCOPE_RETURN_IF_ERROR(
          store::WriteDescriptions(shard_directories_[shard], manifest, static_cast<int>(shard)));
      ISOSCOPE_RETURN_IF_ERROR(io::SyncDirectory(shard_directories_[shard]));
    }
    ISOSCOPE_RETURN_IF_ERROR(store::WriteDescriptions(directory, manifest, -1));
    ISOSCOPE_RETURN_IF_ERROR(io::SyncDirectory(directory));
    return manifest;
  }

  source::VolumeSource& source_;
  const PartitionOptions& options_;
  const base::Cancellation& cancellation_;
  const volume::BlockLayout layout_;
  const volume::ScalarType type_;
  const math::Mat3d world_gradient_from_index_;
  const PartitionPlan plan_;
  const std::int64_t pass_bytes_;

  PartitionProgress progress_;
  std::array<std::vector<char>, 2> portions_;
  std::array<Batch, 2> batches_;
  volume::ScalarSpan value_range_;     // of the portions so far
  SamplesDigest samples_digest_;       // of the portions so far
  double max_gradient_magnitude_ = 0;  // of the blocks so far
  std::unique_ptr<store::RangeTableWriter> range_writer_;
  std::optional<HistogramBuilder> histograms_;
  std::optional<io::ExternalSorter<Placement>> placements_;
  std::uint32_t next_position_ = 0;  // of placements_
  std::optional<io::ExternalSorter<Entry>> entries_;
  std::vector<std::string> shard_directories_;
  std::vector<std::unique_ptr<store::ShardWriter>> writers_;
};

}  // namespace

absl::StatusOr<store::Manifest> Partition(source::VolumeSource& source,
                                          const PartitionOptions& options,
                                          const base::Cancellation& cancellation) {
  const std::string output = WithoutTrailingSlashes(options.output_directory);
  ISOSCOPE_RETURN_IF_ERROR(volume::Validate(source.geometry()));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const volume::BlockLayout layout,
      volume::BlockLayout::Make(
          source.geometry().sample_dims,
          options.block_cells.value_or(volume::DefaultBlockCells(source.geometry().sample_dims))));
  ISOSCOPE_RETURN_IF_ERROR(ValidateShardCount(options.shard_count, layout));
  const std::int64_t source_bytes =
      options.reserved_bytes + source.memory_bytes() +
      (source.is_seekable() ? 0 : PortionReader::StagingBytes(source));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const PartitionPlan plan,
      PlanPartition(layout, source.scalar_type(), options.shard_count, options.distribution,
                    source_bytes, options.memory_limit_bytes));
  ISOSCOPE_RETURN_IF_ERROR(ValidateOutput(output));
  const std::string name = options.name.empty() ? BaseName(output) : options.name;
  ISOSCOPE_RETURN_IF_ERROR(ValidateName(name));
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());

  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<PartialDirectory> partial,
                            PartialDirectory::Create(io::PartialName(output)));
  // Declared after `partial`, so that its files are closed before `partial` is removed.
  Partitioner partitioner(&source, options, layout, plan, cancellation);
  ISOSCOPE_ASSIGN_OR_RETURN(store::Manifest manifest, partitioner.Run(partial->path(), name));
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  ISOSCOPE_RETURN_IF_ERROR(io::RenamePath(partial->path(), output));
  partial->Keep();
  return manifest;
}

}  // namespace isoscope::partition
