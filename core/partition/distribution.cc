// Random: a hash of (seed, id) gives the shard, so no table is needed. One pass counts the blocks
// of each shard; the few blocks that have to move into empty shards are kept in a list by id.
// Example: 4 shards, and a hash whose high half is 0xC0000000: floor(4 * 0xC0000000 / 2^32) =
// shard 3.
//
// Greedy, in steps:
//
//   1. Cut the total span of the volume into bins. A block covers the bins from that of its min to
//      that of its max: its class. Blocks of a class are equal work at every isovalue.
//   2. Take the classes from the widest to single bins, because wide ones are the hardest to
//      balance.
//   3. Each shard gets the same number of blocks of a class. The blocks left over go one by one to
//      the shards whose histogram peaks lowest over the bins of the class.
//   4. Blocks that are never active go to the shards with the fewest blocks.
//
// Example: the span [0, 1000] in 128 bins puts 500 into bin 64. A class of 5 blocks and 2 shards:
// two blocks each, and the fifth goes to the shard with the lower peak.
//
// An index-only volume deals out units in place of blocks, by the same draw of the unit's number.
//
// Invariant of both: no shard is empty, and the result depends on the arguments alone.

#include "core/partition/distribution.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <queue>
#include <tuple>
#include <utility>

#include "core/base/check.h"
#include "core/base/random.h"
#include "core/volume/scalar_span.h"

namespace isoscope::partition {
namespace {

void CheckShardCount(std::int64_t block_count, int shard_count) {
  ISOSCOPE_CHECK_GE(shard_count, 1);
  ISOSCOPE_CHECK_LE(shard_count, 65536);
  ISOSCOPE_CHECK_LE(shard_count, block_count);
}

// Maps isovalues to bins over the finite part of a span.
class Bins {
 public:
  Bins(const volume::ScalarSpan& total, int count)
      : count_(count), low_(Half(total.min)), high_(Half(total.max)) {}

  [[nodiscard]] int count() const { return count_; }
  [[nodiscard]] int Of(double value) const {
    if (!(high_ > low_)) {
      return 0;
    }
    const double bin = (Half(value) - low_) / (high_ - low_) * count_;
    return std::clamp(static_cast<int>(bin), 0, count_ - 1);
  }

 private:
  // Halves a value, so that the difference of two does not overflow.
  static double Half(double value) {
    constexpr double kMax = std::numeric_limits<double>::max();
    return std::clamp(value, -kMax, kMax) / 2;
  }

  int count_;
  double low_;
  double high_;
};

// For each shard, the number of its blocks, and how many of them cover each bin.
class Loads {
 public:
  Loads(int shard_count, int bin_count)
      : bin_count_(static_cast<std::size_t>(bin_count)),
        block_counts_(static_cast<std::size_t>(shard_count)),
        histograms_(block_counts_.size() * bin_count_) {}

  [[nodiscard]] std::size_t shard_count() const { return block_counts_.size(); }
  [[nodiscard]] std::int64_t block_count(std::size_t shard) const { return block_counts_[shard]; }
  [[nodiscard]] std::int64_t Peak(std::size_t shard, std::size_t first, std::size_t last) const {
    const std::int64_t* histogram = histograms_.data() + shard * bin_count_;
    return *std::max_element(histogram + first, histogram + last + 1);
  }
  void Add(std::size_t shard, std::size_t first, std::size_t last, std::int64_t count) {
    std::int64_t* histogram = histograms_.data() + shard * bin_count_;
    for (std::size_t bin = first; bin <= last; ++bin) {
      histogram[bin] += count;
    }
    AddInactive(shard, count);
  }
  void AddInactive(std::size_t shard, std::int64_t count) { block_counts_[shard] += count; }

 private:
  std::size_t bin_count_;
  std::vector<std::int64_t> block_counts_;
  std::vector<std::int64_t> histograms_;  // [shard][bin]
};

// Returns the `count` shards whose histogram peaks lowest over bins [first, last], lowest first.
// Ties: fewest blocks, then lowest shard.
std::vector<std::size_t> LeastLoaded(const Loads& loads, std::size_t first, std::size_t last,
                                     std::size_t count) {
  std::vector<std::tuple<std::int64_t, std::int64_t, std::size_t>> order;
  order.reserve(loads.shard_count());
  for (std::size_t shard = 0; shard < loads.shard_count(); ++shard) {
    order.emplace_back(loads.Peak(shard, first, last), loads.block_count(shard), shard);
  }
  const auto end = order.begin() + static_cast<std::ptrdiff_t>(count);
  std::partial_sort(order.begin(), end, order.end());
  std::vector<std::size_t> shards;
  shards.reserve(count);
  for (auto entry = order.begin(); entry != end; ++entry) {
    shards.push_back(std::get<2>(*entry));
  }
  return shards;
}

// Deals each block that is never active to the shard with the fewest blocks.
void DealInactive(const std::vector<volume::BlockId>& blocks, Loads* loads,
                  std::vector<std::uint16_t>* shard_of_block) {
  using Entry = std::pair<std::int64_t, std::size_t>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> fewest;
  for (std::size_t shard = 0; shard < loads->shard_count(); ++shard) {
    fewest.emplace(loads->block_count(shard), shard);
  }
  for (const volume::BlockId id : blocks) {
    const auto [count, shard] = fewest.top();
    fewest.pop();
    (*shard_of_block)[id] = static_cast<std::uint16_t>(shard);
    loads->AddInactive(shard, 1);
    fewest.emplace(count + 1, shard);
  }
}

}  // namespace

BlockUnits::BlockUnits(const volume::BlockLayout& layout, const store::SourceSamples& samples)
    : layout_(layout) {
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<std::uint32_t>& units = units_[static_cast<std::size_t>(axis)];
    std::int64_t last = -1;
    std::uint32_t count = 0;
    for (std::int64_t block = 0; block < layout.block_dims()[axis]; ++block) {
      const std::int64_t unit = (block * layout.block_cells()[axis] - samples.unit_origin[axis]) /
                                samples.unit_dims[axis];
      count += unit != last ? 1 : 0;
      last = unit;
      units.push_back(count - 1);
    }
    dims_[axis] = count;
  }
}

std::uint32_t BlockUnits::UnitOf(volume::BlockId id) const {
  const math::Index3 index = layout_.IndexOf(id);
  const auto unit_on = [&](int axis) {
    return std::int64_t{
        units_[static_cast<std::size_t>(axis)][static_cast<std::size_t>(index[axis])]};
  };
  return static_cast<std::uint32_t>(unit_on(0) + dims_.x * (unit_on(1) + dims_.y * unit_on(2)));
}

ShardMap ShardMap::RandomUnits(BlockUnits units, int shard_count, std::uint64_t seed) {
  ShardMap map = Random(units.unit_count(), shard_count, seed);
  map.units_.push_back(std::move(units));
  return map;
}

ShardMap ShardMap::Random(std::int64_t block_count, int shard_count, std::uint64_t seed) {
  CheckShardCount(block_count, shard_count);
  ShardMap map(shard_count);
  map.seed_ = seed;
  if (shard_count == 1) {
    return map;
  }
  std::vector<std::int64_t> counts(static_cast<std::size_t>(shard_count));
  for (std::int64_t id = 0; id < block_count; ++id) {
    ++counts[map.Draw(static_cast<volume::BlockId>(id))];
  }
  volume::BlockId id = 0;
  for (std::size_t shard = 0; shard < counts.size(); ++shard) {
    if (counts[shard] > 0) {
      continue;
    }
    while (counts[map.Draw(id)] < 2) {
      ++id;
    }
    --counts[map.Draw(id)];
    counts[shard] = 1;
    map.moved_.emplace_back(id++, static_cast<std::uint16_t>(shard));
  }
  return map;
}

ShardMap ShardMap::Greedy(const volume::RangeTable& ranges, int shard_count) {
  ShardMap map(shard_count);
  map.table_ = DistributeGreedily(ranges, shard_count);
  return map;
}

std::uint16_t ShardMap::Draw(volume::BlockId id) const {
  // floor(shard_count * h / 2^32) for the high half h of a hash: uniform up to 2^-16 even for 65536
  // shards.
  return static_cast<std::uint16_t>(
      (base::RandomBits(seed_, id) >> 32) * static_cast<std::uint64_t>(shard_count_) >> 32);
}

std::uint16_t ShardMap::ShardOf(volume::BlockId id) const {
  if (!table_.empty()) {
    return table_[id];
  }
  if (shard_count_ == 1) {
    return 0;
  }
  if (!units_.empty()) {
    id = units_.front().UnitOf(id);
  }
  const auto moved =
      std::lower_bound(moved_.begin(), moved_.end(), std::pair(id, std::uint16_t{0}));
  return moved != moved_.end() && moved->first == id ? moved->second : Draw(id);
}

std::vector<std::uint16_t> DistributeRandomly(std::int64_t block_count, int shard_count,
                                              std::uint64_t seed) {
  const ShardMap map = ShardMap::Random(block_count, shard_count, seed);
  std::vector<std::uint16_t> shard_of_block(static_cast<std::size_t>(block_count));
  for (std::size_t id = 0; id < shard_of_block.size(); ++id) {
    shard_of_block[id] = map.ShardOf(static_cast<volume::BlockId>(id));
  }
  return shard_of_block;
}

std::vector<std::uint16_t> DistributeGreedily(const volume::RangeTable& ranges, int shard_count) {
  CheckShardCount(ranges.block_count(), shard_count);
  const Bins bins(ranges.Total(), shard_count > 1024 ? 32 : 128);
  const auto bin_count = static_cast<std::size_t>(bins.count());
  std::vector<std::vector<volume::BlockId>> classes(bin_count * bin_count);  // [first][last]
  std::vector<volume::BlockId> inactive;
  for (std::int64_t i = 0; i < ranges.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const volume::ScalarSpan span = ranges.Get(id);
    if (span.min < span.max) {
      const auto first = static_cast<std::size_t>(bins.Of(span.min));
      classes[first * bin_count + static_cast<std::size_t>(bins.Of(span.max))].push_back(id);
    } else {
      inactive.push_back(id);
    }
  }
  std::vector<std::uint16_t> shard_of_block(static_cast<std::size_t>(ranges.block_count()));
  Loads loads(shard_count, bins.count());
  const std::size_t shards = loads.shard_count();
  for (std::size_t width = bin_count; width >= 1; --width) {
    for (std::size_t first = 0; first + width <= bin_count; ++first) {
      const std::size_t last = first + width - 1;
      const std::vector<volume::BlockId>& blocks = classes[first * bin_count + last];
      if (blocks.empty()) {
        continue;
      }
      const std::size_t even_share = blocks.size() / shards;
      for (std::size_t shard = 0; even_share > 0 && shard < shards; ++shard) {
        loads.Add(shard, first, last, static_cast<std::int64_t>(even_share));
      }
      for (std::size_t i = 0; i < even_share * shards; ++i) {
        shard_of_block[blocks[i]] = static_cast<std::uint16_t>(i % shards);
      }
      std::size_t next = even_share * shards;
      for (const std::size_t shard : LeastLoaded(loads, first, last, blocks.size() - next)) {
        shard_of_block[blocks[next++]] = static_cast<std::uint16_t>(shard);
        loads.Add(shard, first, last, 1);
      }
    }
  }
  DealInactive(inactive, &loads, &shard_of_block);
  return shard_of_block;
}

}  // namespace isoscope::partition
