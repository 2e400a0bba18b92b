// 1. CapPainter::NeedOf classifies a block: it has no caps, is wholly inside, or needs its samples.
// 2. Blocks wholly inside are painted from their span, and blocks with cached samples from the
//    cache, in parallel.
// 3. The others are read in disk runs and painted as they arrive; their samples are offered to the
//    cache.
//
// Each block's fragments enter the image in batches under one lock, by the order of fragments, so
// that the result does not depend on the order of blocks.

#include "partition-agent/frame/cap_drawing.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include <oneapi/tbb/parallel_for.h>

#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/picture/color_map.h"
#include "core/render/clip_caps.h"
#include "core/store/shard_reader.h"
#include "partition-agent/supply/block_reads.h"

namespace isoscope::agent {
namespace {

using render::CapFragment;
using render::CapPainter;

render::SampleColor SampleColorOf(const frame::ClipCaps& caps) {
  if (!caps.map.has_value()) {
    return nullptr;
  }
  const picture::ColorMapTable* const table = &picture::ColorMapTableOf(*caps.map);
  const frame::ColorRange range = caps.range.value();
  return [table, range](double value) {
    // Infinities of both signs around a point leave it without a value.
    return std::isnan(value) ? picture::kNoSample : (*table)[picture::ColorMapStepOf(value, range)];
  };
}

// Puts fragments into an image. Thread-safe.
class CapSink {
 public:
  static constexpr std::size_t kBatch = 4096;

  CapSink(const image::FragmentOrder& order, image::FrameImage* image)
      : order_(order), image_(*image) {}

  // Returns true if the pixel shows something nearer. It may miss concurrent insertions.
  [[nodiscard]] bool IsHidden(int x, int y, float depth) {
    std::uint64_t& key = image_.keys[image_.IndexOf(x, y)];
    return image::DepthOf(std::atomic_ref(key).load(std::memory_order_relaxed)) < depth;
  }

  void Insert(std::vector<CapFragment>* fragments) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    for (const CapFragment& fragment : *fragments) {
      const std::size_t pixel = image_.IndexOf(fragment.x, fragment.y);
      std::uint64_t first = image_.keys[pixel];
      order_.KeepFirst(fragment.key, fragment.color, &first, &image_.colors[pixel]);
      std::atomic_ref(image_.keys[pixel]).store(first, std::memory_order_relaxed);
      // If the fragment does not come first, its pixel is marked already.
      constexpr int kTilePx = image::TileSet::kTilePx;
      const int column = fragment.x / kTilePx;
      const int row = fragment.y / kTilePx;
      image_.touched.Insert(column, row);
      image_.CoveredOf(column, row)[static_cast<std::size_t>(fragment.y % kTilePx)] |=
          static_cast<std::uint16_t>(1U << (fragment.x % kTilePx));
    }
    fragments->clear();
  }

 private:
  const image::FragmentOrder order_;
  image::FrameImage& image_;
  base::Mutex mutex_;
};

class Drawing {
 public:
  Drawing(const Shards& shards, const ColorVolumes& colors, const CapPainter& painter,
          std::size_t surface_count, const AgentResources& resources,
          const base::Cancellation& cancellation, CapSink* sink)
      : shards_(shards),
        colors_(colors),
        painter_(painter),
        resources_(resources),
        cancellation_(cancellation),
        sink_(*sink),
        shown_volumes_(surface_count) {
    for (std::size_t i = 0; i < surface_count; ++i) {
      if (painter.ShowsField(i)) {
        shown_volumes_[i] = colors.VolumeOf(i);
      }
    }
  }

  // Returns the bytes read.
  absl::StatusOr<std::int64_t> Draw() {
    ISOSCOPE_RETURN_IF_ERROR(ChooseBlocks());
    std::vector<char> is_painted(with_samples_.size(), 0);
    base::RunIn(resources_.arena, [&] {
      tbb::parallel_for(std::size_t{0}, whole_.size(), [&](std::size_t i) {
        Paint(whole_[i].block, whole_[i].span, nullptr, {});
      });
      tbb::parallel_for(std::size_t{0}, with_samples_.size(), [&](std::size_t i) {
        is_painted[i] = PaintCached(with_samples_[i]) ? 1 : 0;
      });
    });
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    VolumeSet volumes;
    for (const std::optional<std::size_t>& volume : shown_volumes_) {
      if (volume.has_value()) {
        volumes.set(*volume);
      }
    }
    std::vector<ColoredBlock> to_read;
    for (std::size_t i = 0; i < is_painted.size(); ++i) {
      if (is_painted[i] == 0) {
        to_read.push_back({with_samples_[i], volumes});
      }
    }
    return VisitColoredBlocks(
        shards_, volumes.none() ? ColorVolumes() : colors_, to_read, resources_, cancellation_,
        [&](std::size_t i, const volume::BlockSamples& samples,
            std::span<const volume::BlockSamples> fields) {
          const BlockToRead& block = to_read[i].block;
          Paint(block, {}, &samples, fields);
          resources_.cache->OfferSamples(ShardOf(block), block.ordinal, samples);
          return cancellation_.Check();
        });
  }

 private:
  [[nodiscard]] const Shard& ShardOf(const BlockToRead& block) const {
    return *shards_[block.shard_index];
  }

  // A block that is inside as a whole.
  struct WholeBlock {
    BlockToRead block;
    volume::ScalarSpan span;
  };

  absl::Status ChooseBlocks() {
    for (std::uint32_t shard = 0; shard < shards_.size(); ++shard) {
      const store::ShardReader& reader = *shards_[shard]->reader;
      volume::BlockSpans spans = reader.Spans();
      for (std::uint32_t ordinal = 0; ordinal < reader.block_count(); ++ordinal) {
        const volume::BlockId id = reader.block_id(ordinal);
        const CapPainter::Need need = painter_.NeedOf(id, &spans);
        if (need == CapPainter::Need::kNothing) {
          continue;
        }
        ISOSCOPE_RETURN_IF_ERROR(colors_.CheckBlock(shard, ordinal, id));
        if (need == CapPainter::Need::kSpan) {
          whole_.push_back({{shard, ordinal}, spans.Get(id)});
        } else {
          with_samples_.push_back({shard, ordinal});
        }
      }
      ISOSCOPE_RETURN_IF_ERROR(spans.status());
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    }
    return absl::OkStatus();
  }

  // span:    only of a block that is inside as a whole
  // samples: null if the block is inside as a whole
  // fields:  by volume of `colors_`
  void Paint(const BlockToRead& block, const volume::ScalarSpan& span,
             const volume::BlockSamples* samples, std::span<const volume::BlockSamples> fields) {
    if (cancellation_.is_cancelled()) {
      return;
    }
    std::vector<volume::BlockSamples> by_surface(shown_volumes_.size());
    for (std::size_t i = 0; i < by_surface.size() && !fields.empty(); ++i) {
      if (shown_volumes_[i].has_value()) {
        by_surface[i] = fields[*shown_volumes_[i]];
      }
    }
    const store::ShardReader& reader = *ShardOf(block).reader;
    std::vector<CapFragment> fragments;
    painter_.Paint(
        reader.block_id(block.ordinal), span, samples, by_surface,
        [this](int x, int y, float depth) { return sink_.IsHidden(x, y, depth); },
        [&](const CapFragment& fragment) {
          fragments.push_back(fragment);
          if (fragments.size() == CapSink::kBatch) {
            sink_.Insert(&fragments);
          }
        });
    sink_.Insert(&fragments);
  }

  bool PaintCached(const BlockToRead& block) {
    const Shard& shard = ShardOf(block);
    const std::shared_ptr<const std::string> cached =
        resources_.cache->FindSamples(shard, block.ordinal);
    if (cached == nullptr) {
      return false;
    }
    std::vector<std::shared_ptr<const std::string>> held;
    std::vector<volume::BlockSamples> fields(colors_.volume_count());
    for (const std::optional<std::size_t>& volume : shown_volumes_) {
      if (!volume.has_value()) {
        continue;
      }
      const Shard& field_shard = *colors_.shards()[colors_.IndexOf(*volume, block.shard_index)];
      held.push_back(resources_.cache->FindSamples(field_shard, block.ordinal));
      if (held.back() == nullptr) {
        return false;
      }
      fields[*volume] = SamplesOf(field_shard, block.ordinal, *held.back());
    }
    const volume::BlockSamples samples = SamplesOf(shard, block.ordinal, *cached);
    Paint(block, {}, &samples, fields);
    return true;
  }

  const Shards& shards_;
  const ColorVolumes& colors_;
  const CapPainter& painter_;
  const AgentResources& resources_;
  const base::Cancellation& cancellation_;
  CapSink& sink_;
  std::vector<std::optional<std::size_t>> shown_volumes_;  // by surface: that its caps show
  std::vector<WholeBlock> whole_;
  std::vector<BlockToRead> with_samples_;  // ascending
};

}  // namespace

absl::StatusOr<std::int64_t> DrawCaps(const Shards& shards, const ColorVolumes& colors,
                                      const view::View& view, const frame::FrameSpec& spec,
                                      frame::BackEnd drawn_by, const AgentResources& resources,
                                      const base::Cancellation& cancellation,
                                      image::FrameImage* image) {
  const store::ShardReader& first = *shards.front()->reader;
  const CapPainter painter(view, first.layout(), spec, drawn_by, SampleColorOf(*spec.caps));
  CapSink sink({.block_count = static_cast<std::uint32_t>(first.layout().block_count()),
                .ties = frame::TieRuleOf(drawn_by)},
               image);
  AgentResources untold = resources;  // the caller counts the bytes
  untold.metrics = nullptr;
  untold.trace = nullptr;
  return Drawing(shards, colors, painter, spec.surfaces.size(), untold, cancellation, &sink).Draw();
}

}  // namespace isoscope::agent
