// Blocks with colours are read in portions. For each portion:
//
//   1. The samples of the colour volumes are found in the cache, or read, and held.
//   2. The blocks of the drawn volume are read and visited as they arrive.
//
// The held samples take half of the bytes that a step may read with, the reads of either part the
// other half.

#include "partition-agent/supply/color_volumes.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/store/shard_reader.h"

namespace isoscope::agent {
namespace {

using SharedBytes = std::shared_ptr<const std::string>;

absl::Status Differs(const store::ShardReader& drawn, const store::ShardReader& color,
                     const std::string& drawn_value, const std::string& color_value) {
  return absl::FailedPreconditionError(absl::StrFormat(
      "dataset id %s has %s, dataset id %s whose samples colour its surfaces has %s: both must be "
      "cut alike",
      drawn.manifest().dataset_id, drawn_value, color.manifest().dataset_id, color_value));
}

absl::Status CheckCut(const store::ShardReader& drawn, const store::ShardReader& color) {
  const auto text = [](const math::Index3& v, const char* what) {
    return absl::StrFormat("%d x %d x %d %s", v.x, v.y, v.z, what);
  };
  const volume::BlockLayout& a = drawn.layout();
  const volume::BlockLayout& b = color.layout();
  if (!(a.sample_dims() == b.sample_dims())) {
    return Differs(drawn, color, text(a.sample_dims(), "samples"),
                   text(b.sample_dims(), "samples"));
  }
  if (!(a.block_cells() == b.block_cells())) {
    return Differs(drawn, color, "blocks of " + text(a.block_cells(), "cells"),
                   "blocks of " + text(b.block_cells(), "cells"));
  }
  const auto shard = [](const store::ShardReader& reader) {
    return absl::StrFormat("%d blocks in shard %d of %d", reader.block_count(),
                           reader.shard_index(), reader.manifest().shards.size());
  };
  if (shard(drawn) != shard(color)) {
    return Differs(drawn, color, shard(drawn), shard(color));
  }
  return absl::OkStatus();
}

// The samples of a portion of blocks in the colour volumes.
class HeldSamples {
 public:
  HeldSamples(const ColorVolumes& colors, std::span<const ColoredBlock> blocks)
      : colors_(colors), blocks_(blocks), held_(blocks.size() * colors.volume_count()) {}

  // Finds and reads all. Returns the bytes read.
  absl::StatusOr<std::int64_t> Fill(const AgentResources& resources,
                                    const base::Cancellation& cancellation) {
    struct Missing {
      BlockToRead block;  // its shard is one of ColorVolumes::shards()
      std::size_t place = 0;
    };
    std::vector<Missing> missing;
    ForEachWanted([&](std::size_t place, const BlockToRead& block) {
      held_[place] = resources.cache->FindSamples(ShardOf(block), block.ordinal);
      if (held_[place] == nullptr) {
        missing.push_back({block, place});
      }
    });
    std::sort(missing.begin(), missing.end(),
              [](const Missing& a, const Missing& b) { return a.block < b.block; });
    std::vector<BlockToRead> to_read;
    to_read.reserve(missing.size());
    for (const Missing& one : missing) {
      to_read.push_back(one.block);
    }
    if (resources.metrics != nullptr) {
      const auto missing_count = static_cast<std::int64_t>(missing.size());
      resources.metrics->sample_lookups.hits.Add(wanted_count_ - missing_count);
      resources.metrics->sample_lookups.misses.Add(missing_count);
    }
    BlockReads reads(colors_.shards(), to_read);
    ISOSCOPE_RETURN_IF_ERROR(reads.ForEach(
        resources, cancellation, [&](std::size_t i, const volume::BlockSamples& samples) {
          const Shard& shard = ShardOf(to_read[i]);
          held_[missing[i].place] = std::make_shared<const std::string>(
              samples.bytes,
              volume::StoredSizeBytes(shard.reader->layout(), samples.block_id, samples.type));
          resources.cache->OfferSamples(shard, to_read[i].ordinal, *held_[missing[i].place]);
          return absl::OkStatus();
        }));
    return reads.read_bytes();
  }

  // By volume.
  [[nodiscard]] std::vector<volume::BlockSamples> FieldsOf(std::size_t block) const {
    std::vector<volume::BlockSamples> fields(colors_.volume_count());
    for (std::size_t volume = 0; volume < fields.size(); ++volume) {
      const SharedBytes& bytes = held_[block * fields.size() + volume];
      if (bytes != nullptr) {
        const BlockToRead& at = blocks_[block].block;
        fields[volume] = SamplesOf(*colors_.shards()[colors_.IndexOf(volume, at.shard_index)],
                                   at.ordinal, *bytes);
      }
    }
    return fields;
  }

 private:
  template <typename Visit>
  void ForEachWanted(const Visit& visit) {
    for (std::size_t i = 0; i < blocks_.size(); ++i) {
      for (std::size_t volume = 0; volume < colors_.volume_count(); ++volume) {
        if (blocks_[i].volumes.test(volume)) {
          const BlockToRead& at = blocks_[i].block;
          ++wanted_count_;
          visit(i * colors_.volume_count() + volume,
                BlockToRead{static_cast<std::uint32_t>(colors_.IndexOf(volume, at.shard_index)),
                            at.ordinal});
        }
      }
    }
  }
  [[nodiscard]] const Shard& ShardOf(const BlockToRead& block) const {
    return *colors_.shards()[block.shard_index];
  }

  const ColorVolumes& colors_;
  const std::span<const ColoredBlock> blocks_;
  std::vector<SharedBytes> held_;  // by block, volume
  std::int64_t wanted_count_ = 0;
};

// The bytes of a block in the volumes that are wanted.
std::size_t WantedBytes(const Shards& shards, const ColorVolumes& colors,
                        const ColoredBlock& colored) {
  const store::ShardReader& reader = *shards[colored.block.shard_index]->reader;
  std::size_t bytes = 0;
  for (std::size_t volume = 0; volume < colors.volume_count(); ++volume) {
    if (colored.volumes.test(volume)) {
      bytes += volume::StoredSizeBytes(
          reader.layout(), reader.block_id(colored.block.ordinal),
          colors.shards()[colors.IndexOf(volume, 0)]->reader->manifest().scalar_type);
    }
  }
  return bytes;
}

std::vector<BlockToRead> DrawnBlocks(std::span<const ColoredBlock> blocks) {
  std::vector<BlockToRead> drawn;
  drawn.reserve(blocks.size());
  for (const ColoredBlock& colored : blocks) {
    drawn.push_back(colored.block);
  }
  return drawn;
}

}  // namespace

absl::StatusOr<ColorVolumes> ColorVolumes::Make(const Shards& shards,
                                                const std::vector<Shards>& by_surface) {
  ColorVolumes volumes;
  for (const Shards& surface_shards : by_surface) {
    std::optional<std::size_t>& volume = volumes.volume_of_.emplace_back();
    if (surface_shards.empty()) {
      continue;
    }
    ISOSCOPE_CHECK_EQ(surface_shards.size(), shards.size());
    for (std::size_t known = 0; known < volumes.volume_count_ && !volume.has_value(); ++known) {
      if (volumes.shards_[known * shards.size()] == surface_shards.front()) {
        volume = known;
      }
    }
    if (volume.has_value()) {
      continue;
    }
    for (std::size_t i = 0; i < shards.size(); ++i) {
      ISOSCOPE_RETURN_IF_ERROR(CheckCut(*shards[i]->reader, *surface_shards[i]->reader));
    }
    volume = volumes.volume_count_++;
    volumes.shards_.insert(volumes.shards_.end(), surface_shards.begin(), surface_shards.end());
  }
  return volumes;
}

absl::Status ColorVolumes::CheckBlock(std::size_t shard_index, std::uint32_t ordinal,
                                      volume::BlockId block_id) const {
  for (std::size_t volume = 0; volume < volume_count_; ++volume) {
    const store::ShardReader& reader = *shards_[IndexOf(volume, shard_index)]->reader;
    if (reader.block_id(ordinal) != block_id) {
      return absl::FailedPreconditionError(absl::StrFormat(
          "shard %d of dataset id %s, whose samples colour surfaces, has block %d where the drawn "
          "one has block %d: both must be cut alike, with one seed",
          reader.shard_index(), reader.manifest().dataset_id, reader.block_id(ordinal), block_id));
    }
  }
  return absl::OkStatus();
}

volume::BlockSamples SamplesOf(const Shard& shard, std::uint32_t ordinal,
                               const std::string& bytes) {
  return {shard.reader->block_id(ordinal), shard.reader->manifest().scalar_type, bytes.data()};
}

absl::StatusOr<std::int64_t> VisitColoredBlocks(const Shards& shards, const ColorVolumes& colors,
                                                const std::vector<ColoredBlock>& blocks,
                                                const AgentResources& resources,
                                                const base::Cancellation& cancellation,
                                                VisitColored visit, const Pauses& pauses) {
  if (colors.empty()) {
    BlockReads reads(shards, DrawnBlocks(blocks));
    ISOSCOPE_RETURN_IF_ERROR(reads.ForEach(
        resources, cancellation,
        [&](std::size_t i, const volume::BlockSamples& samples) { return visit(i, samples, {}); },
        pauses));
    return reads.read_bytes();
  }
  AgentResources half = resources;
  half.max_read_bytes = resources.max_read_bytes / 2;
  std::int64_t read_bytes = 0;
  for (std::size_t begin = 0; begin < blocks.size();) {
    std::size_t end = begin;
    for (std::size_t bytes = 0; end < blocks.size(); ++end) {
      bytes += WantedBytes(shards, colors, blocks[end]);
      if (end > begin && bytes > half.max_read_bytes) {
        break;
      }
    }
    const std::span<const ColoredBlock> portion = std::span(blocks).subspan(begin, end - begin);
    HeldSamples held(colors, portion);
    ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t color_bytes, held.Fill(half, cancellation));
    BlockReads reads(shards, DrawnBlocks(portion));
    ISOSCOPE_RETURN_IF_ERROR(reads.ForEach(
        half, cancellation,
        [&](std::size_t i, const volume::BlockSamples& samples) {
          return visit(begin + i, samples, held.FieldsOf(i));
        },
        pauses));
    read_bytes += color_bytes + reads.read_bytes();
    begin = end;
  }
  return read_bytes;
}

}  // namespace isoscope::agent
