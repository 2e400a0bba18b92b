// For each shard:
//
// 1. CapPainter::NeedOf tells of each block whether it has no caps, is inside as a whole, or must
// be
//    looked at sample by sample.
// 2. Blocks inside as a whole are painted from their span, and blocks with samples in the cache
// from
//    there, in parallel.
// 3. The others are read in disk runs and painted as they arrive; the cache is offered their
// samples.
//
// Each block's fragments go into the image in batches under one lock, by the order of fragments, so
// that the order of blocks cannot show.

#include "partition-agent/cap_drawing.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <limits>
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
#include "partition-agent/queued_reads.h"

namespace isoscope::agent {
namespace {

using render::CapFragment;
using render::CapPainter;

// The range of the map, if the request has none.
frame::ColorRange RangeOf(const volume::ScalarSpan& samples) {
  // So that the range is finite, whatever samples there are.
  constexpr double kLimit = std::numeric_limits<double>::max() / 4;
  frame::ColorRange range{.min = std::clamp(samples.min, -kLimit, kLimit),
                          .max = std::clamp(samples.max, -kLimit, kLimit)};
  if (!(range.max > range.min)) {
    range.max = std::nextafter(range.min, std::numeric_limits<double>::infinity());
  }
  return range;
}

render::SampleColor SampleColorOf(const frame::ClipCaps& caps, const store::Manifest& manifest) {
  if (!caps.map.has_value()) {
    return nullptr;
  }
  const picture::ColorMapTable* const table = &picture::ColorMapTableOf(*caps.map);
  const frame::ColorRange range = caps.range.value_or(RangeOf(manifest.value_range));
  return [table, range](double value) {
    // Infinities of both signs around a point leave it without a value.
    return (*table)[picture::ColorMapStepOf(std::isnan(value) ? range.max : value, range)];
  };
}

// Puts fragments into an image. Thread-safe.
class CapSink {
 public:
  static constexpr std::size_t kBatch = 4096;

  CapSink(const image::FragmentOrder& order, image::FrameImage* image)
      : order_(order), image_(*image) {}

  // Whether the pixel shows something nearer. It may miss what is being inserted.
  [[nodiscard]] bool IsHidden(int x, int y, float depth) {
    std::uint64_t& key = image_.keys[image_.IndexOf(x, y)];
    return image::DepthOf(std::atomic_ref(key).load(std::memory_order_relaxed)) < depth;
  }

  void Insert(std::vector<CapFragment>* fragments) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    for (const CapFragment& fragment : *fragments) {
      const std::size_t pixel = image_.IndexOf(fragment.x, fragment.y);
      std::uint64_t& key = image_.keys[pixel];
      if (!order_.IsBefore(fragment.key, fragment.color, key, image_.colors[pixel])) {
        continue;
      }
      std::atomic_ref(key).store(fragment.key, std::memory_order_relaxed);
      image_.colors[pixel] = fragment.color;
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

// The blocks of a shard that have caps.
struct CapBlocks {
  std::vector<std::uint32_t> of_span;       // ordinals
  std::vector<std::uint32_t> with_samples;  // ascending
};

class Drawing {
 public:
  Drawing(const CapPainter& painter, const AgentResources& resources,
          const base::Cancellation& cancellation, CapSink* sink)
      : painter_(painter), resources_(resources), cancellation_(cancellation), sink_(*sink) {}

  // Returns the bytes read.
  absl::StatusOr<std::int64_t> Draw(const Shard& shard) {
    CapBlocks blocks = BlocksOf(shard);
    std::vector<char> is_kept(blocks.with_samples.size(), 0);
    base::RunIn(resources_.arena, [&] {
      tbb::parallel_for(std::size_t{0}, blocks.of_span.size(), [&](std::size_t i) {
        Paint(*shard.reader, shard.reader->block_id(blocks.of_span[i]), nullptr);
      });
      tbb::parallel_for(std::size_t{0}, blocks.with_samples.size(), [&](std::size_t i) {
        is_kept[i] = PaintKept(shard, blocks.with_samples[i]) ? 1 : 0;
      });
    });
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    std::vector<std::uint32_t> to_read;
    for (std::size_t i = 0; i < is_kept.size(); ++i) {
      if (is_kept[i] == 0) {
        to_read.push_back(blocks.with_samples[i]);
      }
    }
    return Read(shard, to_read);
  }

 private:
  [[nodiscard]] CapBlocks BlocksOf(const Shard& shard) const {
    const store::ShardReader& reader = *shard.reader;
    CapBlocks blocks;
    for (std::uint32_t ordinal = 0; ordinal < reader.block_count(); ++ordinal) {
      switch (painter_.NeedOf(reader.block_id(ordinal), reader.ranges())) {
        case CapPainter::Need::kNothing:
          break;
        case CapPainter::Need::kSpan:
          blocks.of_span.push_back(ordinal);
          break;
        case CapPainter::Need::kSamples:
          blocks.with_samples.push_back(ordinal);
          break;
      }
    }
    return blocks;
  }

  void Paint(const store::ShardReader& reader, volume::BlockId id,
             const volume::BlockSamples* samples) {
    if (cancellation_.is_cancelled()) {
      return;
    }
    std::vector<CapFragment> fragments;
    painter_.Paint(
        id, reader.ranges(), samples,
        [this](int x, int y, float depth) { return sink_.IsHidden(x, y, depth); },
        [&](const CapFragment& fragment) {
          fragments.push_back(fragment);
          if (fragments.size() == CapSink::kBatch) {
            sink_.Insert(&fragments);
          }
        });
    sink_.Insert(&fragments);
  }

  bool PaintKept(const Shard& shard, std::uint32_t ordinal) {
    const std::shared_ptr<const std::string> kept = resources_.cache->FindSamples(shard, ordinal);
    if (kept == nullptr) {
      return false;
    }
    const volume::BlockSamples samples{shard.reader->block_id(ordinal),
                                       shard.reader->manifest().scalar_type, kept->data()};
    Paint(*shard.reader, samples.block_id, &samples);
    return true;
  }

  absl::StatusOr<std::int64_t> Read(const Shard& shard,
                                    const std::vector<std::uint32_t>& ordinals) {
    const store::ShardReader& reader = *shard.reader;
    const std::vector<store::ShardReader::DiskRun> runs = reader.PlanDiskRuns(ordinals);
    std::int64_t read_bytes = 0;
    std::vector<io::ReadQueue::Read> reads;
    for (const store::ShardReader::DiskRun& run : runs) {
      read_bytes += run.size;
      reads.push_back(reader.RequestFor(run));
    }
    io::ReadQueue queue(std::move(reads), {.max_bytes = resources_.max_read_bytes});
    ISOSCOPE_RETURN_IF_ERROR(ForEachArrival(
        &queue, resources_.arena, cancellation_, [&](const io::ReadQueue::Arrival& arrival) {
          const store::ShardReader::DiskRun& run = runs[arrival.index()];
          std::size_t next = run.first;
          return reader.VisitDiskRun(run, ordinals, arrival.status(), arrival.data(),
                                     [&](const volume::BlockSamples& samples) {
                                       return PaintRead(shard, ordinals[next++], samples);
                                     });
        }));
    return read_bytes;
  }

  absl::Status PaintRead(const Shard& shard, std::uint32_t ordinal,
                         const volume::BlockSamples& samples) {
    Paint(*shard.reader, samples.block_id, &samples);
    resources_.cache->OfferSamples(
        shard, ordinal,
        {samples.bytes,
         volume::StoredSizeBytes(shard.reader->layout(), samples.block_id, samples.type)});
    return cancellation_.Check();
  }

  const CapPainter& painter_;
  const AgentResources& resources_;
  const base::Cancellation& cancellation_;
  CapSink& sink_;
};

}  // namespace

absl::StatusOr<std::int64_t> DrawCaps(const std::vector<std::shared_ptr<const Shard>>& shards,
                                      const view::View& view, const frame::FrameSpec& spec,
                                      frame::BackEnd drawn_by, const AgentResources& resources,
                                      const base::Cancellation& cancellation,
                                      image::FrameImage* image) {
  const store::ShardReader& first = *shards.front()->reader;
  const CapPainter painter(view, first.layout(), spec, drawn_by,
                           SampleColorOf(*spec.caps, first.manifest()));
  CapSink sink({.block_count = static_cast<std::uint32_t>(first.layout().block_count()),
                .ties = frame::TieRuleOf(drawn_by)},
               image);
  Drawing drawing(painter, resources, cancellation, &sink);
  std::int64_t read_bytes = 0;
  for (const std::shared_ptr<const Shard>& shard : shards) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t of_shard, drawing.Draw(*shard));
    read_bytes += of_shard;
  }
  return read_bytes;
}

}  // namespace isoscope::agent
