// HistogramOfShards:
//
//   1. Add up the sample counts that partitioning stored with the shards. Without them, the bins
//      follow from the range of values alone, and the answer has no counts.
//   2. Group the bins, as many as the answer may have.
//   3. Give each block's cost to the groups at whose centre it is active. Blocks are in memory as
//      spans, so no block is read.
//
// CostSums, for a block that is active at the centres 2 to 4 of 6 groups and costs c:
//
//   differences   0  0 +c  0  0 -c
//   sums          0  0  c  c  c  0

#include "partition-agent/shard/shard_histogram.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "core/volume/block_set.h"
#include "core/volume/block_spans.h"

namespace isoscope::agent {
namespace {

// The samples of all shards; not set if one was not counted.
absl::StatusOr<std::optional<volume::SampleHistogram>> SamplesOf(const Shards& shards) {
  std::optional<volume::SampleHistogram> sum;
  for (const std::shared_ptr<const Shard>& shard : shards) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::optional<volume::SampleHistogram> samples,
                              shard->reader->ReadHistogram());
    if (!samples.has_value()) {
      return std::nullopt;
    }
    if (!sum.has_value()) {
      sum = std::move(samples);
    } else if (sum->bins == samples->bins) {
      sum->Add(*samples);
    } else {
      return absl::DataLossError(
          absl::StrCat(shard->reader->directory(), "/", store::kHistogramFileName,
                       ": has other bins than the shards beside it: of another dataset"));
    }
  }
  return sum;
}

// The bins of a volume whose samples were not counted. Infinite samples hide the range of the
// finite ones in their blocks.
absl::StatusOr<volume::HistogramBins> BinsFromRanges(const store::ShardReader& reader) {
  const store::Manifest& manifest = reader.manifest();
  volume::ScalarSpan range = manifest.finite_range.value_or(manifest.value_range);
  if (!manifest.finite_range.has_value() && !volume::IsFinite(range)) {
    range = {};
    volume::BlockSpans spans = reader.Spans();
    for (std::int64_t id = 0; id < reader.layout().block_count(); ++id) {
      const volume::ScalarSpan span = spans.Get(static_cast<volume::BlockId>(id));
      for (const double end : {span.min, span.max}) {
        if (span.min <= span.max && std::isfinite(end)) {
          range.min = std::min(range.min, end);
          range.max = std::max(range.max, end);
        }
      }
    }
    ISOSCOPE_RETURN_IF_ERROR(spans.status());
  }
  return volume::BinsOf(manifest.scalar_type, range);
}

// Adds up costs by group. Each block counts for the groups whose centre it is active at. These are
// consecutive, so differences at both ends are enough.
class CostSums {
 public:
  explicit CostSums(const volume::BinGroups& groups) {
    sums_.fill(std::vector<std::int64_t>(static_cast<std::size_t>(groups.count) + 1));
    for (std::int64_t g = 0; g < groups.count; ++g) {
      centers_.push_back(groups.CenterOf(g));
    }
  }

  void Add(const volume::ScalarSpan& span, std::int64_t bytes, std::int64_t triangles) {
    // IsActive: min < centre <= max.
    const auto index_after = [this](double value) {
      return std::upper_bound(centers_.begin(), centers_.end(), value) - centers_.begin();
    };
    const auto begin = static_cast<std::size_t>(index_after(span.min));
    const auto end = static_cast<std::size_t>(index_after(span.max));
    if (begin < end) {
      const std::int64_t costs[] = {1, bytes, triangles};
      for (std::size_t i = 0; i < sums_.size(); ++i) {
        sums_[i][begin] += costs[i];
        sums_[i][end] -= costs[i];
      }
    }
  }

  void MoveTo(volume::HistogramPart* part) {
    for (std::vector<std::int64_t>& sum : sums_) {
      std::partial_sum(sum.begin(), sum.end(), sum.begin());
      sum.pop_back();
    }
    part->active_block_counts = std::move(sums_[0]);
    part->active_block_bytes = std::move(sums_[1]);
    part->estimated_triangle_counts = std::move(sums_[2]);
  }

 private:
  std::vector<double> centers_;
  std::array<std::vector<std::int64_t>, 3> sums_;  // differences: blocks, bytes, triangles
};

}  // namespace

absl::StatusOr<volume::HistogramPart> HistogramOfShards(
    const Shards& shards, std::int64_t max_bin_count,
    const std::optional<volume::ScalarSpan>& range) {
  ISOSCOPE_CHECK(!shards.empty());
  volume::HistogramPart part;
  part.value_range = shards.front()->reader->manifest().value_range;
  ISOSCOPE_ASSIGN_OR_RETURN(part.samples, SamplesOf(shards));
  volume::HistogramBins bins;
  if (part.samples.has_value()) {
    bins = part.samples->bins;
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(bins, BinsFromRanges(*shards.front()->reader));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(part.groups, volume::GroupBins(bins, max_bin_count, range));
  CostSums sums(part.groups);
  for (const std::shared_ptr<const Shard>& shard : shards) {
    const store::ShardReader& reader = *shard->reader;
    volume::BlockSpans spans = reader.Spans();
    for (std::uint32_t ordinal = 0; ordinal < reader.block_count(); ++ordinal) {
      const volume::BlockId id = reader.block_id(ordinal);
      sums.Add(spans.Get(id), reader.stored_bytes(ordinal),
               volume::EstimateTriangles(reader.layout().CellsOf(id).dims()));
    }
    ISOSCOPE_RETURN_IF_ERROR(spans.status());
  }
  sums.MoveTo(&part);
  return part;
}

namespace {

ActiveBox BoxAround(const volume::BlockLayout& layout, const std::vector<volume::BlockId>& ids) {
  ActiveBox box;
  for (const volume::BlockId id : ids) {
    const math::IndexBox cells = layout.CellsOf(id);
    for (int axis = 0; axis < 3; ++axis) {
      box.cells.begin[axis] = box.block_count == 0
                                  ? cells.begin[axis]
                                  : std::min(box.cells.begin[axis], cells.begin[axis]);
      box.cells.end[axis] = std::max(box.cells.end[axis], cells.end[axis]);
    }
    ++box.block_count;
  }
  return box;
}

}  // namespace

ActiveBox ActiveBoxOf(const volume::BlockLayout& layout, const volume::RangeTable& ranges,
                      const std::vector<volume::InsideRule>& rules, const view::Clipper& clipper) {
  volume::BlockSet active(layout.block_count());
  for (const volume::InsideRule& rule : rules) {
    active.UnionWith(ranges.ActiveBlocks(rule));
  }
  clipper.EraseOutside(layout, &active);
  return BoxAround(layout, active.Ids());
}

absl::StatusOr<ActiveBox> ActiveBoxOf(const store::ShardReader& reader,
                                      const std::vector<volume::InsideRule>& rules,
                                      const view::Clipper& clipper, std::int64_t max_dense_blocks) {
  const volume::BlockLayout& layout = reader.layout();
  if (layout.block_count() <= max_dense_blocks) {
    return ActiveBoxOf(layout, reader.ranges(), rules, clipper);
  }
  volume::BlockTree active(layout.block_dims(), absl::Span<const volume::BlockTree::Brick>());
  for (const volume::InsideRule& rule : rules) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const volume::BlockTree> tree,
                              reader.ActiveTree(rule));
    active = volume::BlockTree::Union({&active, tree.get()});
  }
  if (!clipper.empty()) {
    active = active.Filtered([&](const math::Index3& index) {
      return clipper.SideOf(layout, layout.IdOf(index)) != view::Clipper::Side::kOutside;
    });
  }
  return BoxAround(layout, active.Ids());
}

}  // namespace isoscope::agent
