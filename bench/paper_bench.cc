// The order of the measurements: figures 6, 8, 9 and 7 first, which share the dataset of one shard,
// then figure 1, which makes a dataset for each distribution and number of agents.
//
//   figure 6   one agent, by isovalue: the three ways of culling in turn
//   figure 8   the blocks of each stage, drawn alone, and compared with the whole surface
//   figure 9   what the front view extracted, seen from the side; the rest of the surface in red
//   figure 7   one agent and P agents in turn, by P
//   figure 1   all agents, nothing culled, by distribution, P and isovalue; and theorem 2.2
//
// Every time is the least of run_count, because disturbances only add time. Frames that are
// compared with each other alternate within a run.
//
// Theorem 2.2, with c = 1: if W > alpha w P ln P, alpha = 2 / (ln 4 - 1), then no agent has more
// than 2 W / P triangles with a probability of at least 1 - P (e/4)^(W / (w P)). Example: W =
// 1,000,000 triangles, w = 200 of the largest block, P = 8. The premise is 17,225 triangles, so the
// theorem applies: no agent has more than 250,000.

#include "bench/paper_bench.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <map>
#include <memory>
#include <numbers>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "bench/sample_statistics.h"
#include "core/base/status_macros.h"
#include "core/composite/depth_composite.h"
#include "core/image/png_codec.h"

namespace isoscope::bench {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180;
constexpr image::Rgba8 kWhite{255, 255, 255, 255};
// The paper's colour for blocks that are not extracted.
constexpr image::Rgba8 kRed{214, 39, 40, 255};
// Theorem 2.2 has free constants; these give the weakest useful claim.
constexpr double kTheoremC = 1;

// The whole evaluation, once.
class Bench {
 public:
  Bench(const PaperBenchPlan& plan, PartitionInto partition, render::Renderer* renderer,
        PaperProgress progress, const base::Cancellation& cancellation)
      : plan_(plan),
        partition_(partition),
        renderer_(renderer),
        progress_(progress),
        cancellation_(cancellation) {}

  absl::StatusOr<PaperBenchResult> Run() {
    ISOSCOPE_RETURN_IF_ERROR(OpenWhole());
    ISOSCOPE_RETURN_IF_ERROR(CountTriangles());
    ISOSCOPE_RETURN_IF_ERROR(MeasureSweep());
    ISOSCOPE_RETURN_IF_ERROR(DrawStages());
    ISOSCOPE_RETURN_IF_ERROR(DrawSideViews());
    ISOSCOPE_RETURN_IF_ERROR(MeasureSpeedup());
    ISOSCOPE_RETURN_IF_ERROR(MeasureBalance());
    return std::move(result_);
  }

 private:
  absl::StatusOr<std::unique_ptr<IsolatedCluster>> Open(store::Distribution distribution,
                                                        int agent_count) {
    progress_(
        absl::StrFormat("partitioning: %s, %d agents", store::NameOf(distribution), agent_count));
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string directory, partition_(distribution, agent_count));
    return IsolatedCluster::Open(directory, renderer_);
  }

  // Makes the dataset with one shard: for all but figures 1 and 7.
  absl::Status OpenWhole() {
    ISOSCOPE_ASSIGN_OR_RETURN(whole_, Open(store::Distribution::kRandom, 1));
    result_.manifest = whole_->manifest();
    const volume::ScalarSpan& range = result_.manifest.value_range;
    if (range.min > range.max) {
      return absl::InvalidArgumentError("no sample of the volume is a number");
    }
    result_.isovalues =
        plan_.isovalues.empty() ? EvenIsovalues(range, plan_.isovalue_count) : plan_.isovalues;
    ISOSCOPE_ASSIGN_OR_RETURN(
        camera_, client::ResolveCamera(plan_.camera, result_.manifest.geometry.Bounds()));
    picture_isovalues_ = plan_.picture_isovalues;
    if (picture_isovalues_.empty()) {
      picture_isovalues_ = {result_.isovalues[result_.isovalues.size() / 2]};
    }
    result_.speedup_isovalue = picture_isovalues_.front();
    return absl::OkStatus();
  }

  // Returns the view of all figures.
  [[nodiscard]] frame::FrameSpec MakeSpec(double isovalue, frame::Culling culling) const {
    frame::FrameSpec spec;
    spec.surfaces = {{.rule = {.isovalue = isovalue}, .appearance = {}}};
    spec.culling = culling;
    spec.viewport = {plan_.side_px, plan_.side_px};
    spec.camera = camera_;
    return spec;
  }

  // Returns a frame whose times are the least over the runs.
  absl::StatusOr<IsolatedFrame> Measure(IsolatedCluster* cluster, const frame::FrameSpec& spec) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::vector<IsolatedFrame> least, MeasureInTurn({{cluster, spec}}));
    return std::move(least.front());
  }

  // Frames to compare alternate, so that a temporary slowdown of the machine affects all of them.
  struct FrameToMeasure {
    IsolatedCluster* cluster;
    frame::FrameSpec spec;
  };
  absl::StatusOr<std::vector<IsolatedFrame>> MeasureInTurn(
      const std::vector<FrameToMeasure>& frames) {
    std::vector<IsolatedFrame> least;
    for (int run = 0; run < plan_.run_count; ++run) {
      for (std::size_t f = 0; f < frames.size(); ++f) {
        ISOSCOPE_ASSIGN_OR_RETURN(IsolatedFrame frame,
                                  frames[f].cluster->Render(frames[f].spec, cancellation_));
        if (run == 0) {
          least.push_back(std::move(frame));
          continue;
        }
        for (std::size_t i = 0; i < frame.agents.size(); ++i) {
          double& busy_ms = least[f].agents[i].busy_ms;
          busy_ms = std::min(busy_ms, frame.agents[i].busy_ms);
        }
        least[f].other_ms = std::min(least[f].other_ms, frame.other_ms);
      }
    }
    return least;
  }

  absl::Status CountTriangles() {
    for (const double isovalue : result_.isovalues) {
      progress_(absl::StrFormat("counting triangles: isovalue %g", isovalue));
      ISOSCOPE_ASSIGN_OR_RETURN(block_triangles_[isovalue],
                                whole_->TriangleCounts(isovalue, cancellation_));
    }
    return absl::OkStatus();
  }

  // Figure 6.
  absl::Status MeasureSweep() {
    constexpr std::array kCullings = {frame::Culling::kNone, frame::Culling::kDepth,
                                      frame::Culling::kMask};
    std::array<std::vector<SweepRow>, kCullings.size()> rows;
    for (const double isovalue : result_.isovalues) {
      progress_(absl::StrFormat("figure 6: isovalue %g", isovalue));
      std::vector<FrameToMeasure> frames;
      frames.reserve(kCullings.size());
      for (const frame::Culling culling : kCullings) {
        frames.push_back({whole_.get(), MakeSpec(isovalue, culling)});
      }
      ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<IsolatedFrame> measured, MeasureInTurn(frames));
      for (std::size_t i = 0; i < kCullings.size(); ++i) {
        const IsolatedFrame& frame = measured[i];
        rows[i].push_back({.isovalue = isovalue,
                           .culling = kCullings[i],
                           .active_block_count = frame.active_block_count(),
                           .drawn_block_count = frame.drawn_block_count(),
                           .triangle_count = frame.triangle_count(),
                           .busy_ms = frame.agents.front().busy_ms,
                           .other_ms = frame.other_ms});
      }
    }
    for (const std::vector<SweepRow>& culling_rows : rows) {
      result_.sweep.insert(result_.sweep.end(), culling_rows.begin(), culling_rows.end());
    }
    return absl::OkStatus();
  }

  void AddPicture(std::string name, image::FrameImage image) {
    composite::FlattenOver(kWhite, &image);
    result_.pictures.push_back(
        {std::move(name), image::EncodePng(image.width, image.height, image.colors)});
  }

  static std::int64_t CountDifferingPixels(const image::FrameImage& a, const image::FrameImage& b) {
    std::int64_t count = 0;
    for (std::size_t i = 0; i < a.pixel_count(); ++i) {
      count += a.keys[i] != b.keys[i] || a.colors[i] != b.colors[i] ? 1 : 0;
    }
    return count;
  }

  // Returns the blocks that own a pixel, ascending.
  static std::vector<volume::BlockId> OwnersOfPixels(const image::FrameImage& image) {
    std::vector<volume::BlockId> owners;
    for (const std::uint64_t key : image.keys) {
      if (key != image::kBackgroundKey) {
        owners.push_back(image::OwnerOf(key));
      }
    }
    std::sort(owners.begin(), owners.end());
    owners.erase(std::unique(owners.begin(), owners.end()), owners.end());
    return owners;
  }

  // Figure 8.
  absl::Status DrawStages() {
    for (const double isovalue : picture_isovalues_) {
      progress_(absl::StrFormat("figure 8: isovalue %g", isovalue));
      const frame::FrameSpec spec = MakeSpec(isovalue, frame::Culling::kDepth);
      ISOSCOPE_ASSIGN_OR_RETURN(const IsolatedFrame frame, whole_->Render(spec, cancellation_));
      ISOSCOPE_ASSIGN_OR_RETURN(
          IsolatedFrame whole,
          whole_->Render(MakeSpec(isovalue, frame::Culling::kNone), cancellation_));
      const struct {
        const char* name;
        const char* file_name;
        const std::vector<volume::BlockId>& blocks;
      } stages[] = {{"ray hits", "1_ray_hits", frame.ray_hits},
                    {"with neighbours", "2_with_neighbours", frame.occluding},
                    {"final", "3_final", frame.drawn}};
      const std::int64_t all = whole.triangle_count();
      for (const auto& stage : stages) {
        ISOSCOPE_ASSIGN_OR_RETURN(BlocksPicture picture,
                                  whole_->DrawBlocks(spec, stage.blocks, cancellation_));
        result_.stages.push_back(
            {.isovalue = isovalue,
             .stage = stage.name,
             .picture_name = absl::StrFormat("figure8_%g_%s", isovalue, stage.file_name),
             .block_count = static_cast<std::int64_t>(stage.blocks.size()),
             .triangle_count = picture.triangle_count,
             .triangle_share =
                 all > 0 ? static_cast<double>(picture.triangle_count) / static_cast<double>(all)
                         : 0,
             .differing_pixel_count = CountDifferingPixels(picture.image, whole.image)});
        AddPicture(result_.stages.back().picture_name, std::move(picture.image));
      }
      result_.stages.push_back({.isovalue = isovalue,
                                .stage = "whole",
                                .picture_name = absl::StrFormat("figure8_%g_4_whole", isovalue),
                                .block_count = whole.active_block_count(),
                                .triangle_count = all,
                                .triangle_share = all > 0 ? 1.0 : 0.0});
      const std::vector<volume::BlockId> owners = OwnersOfPixels(whole.image);
      ISOSCOPE_ASSIGN_OR_RETURN(const BlocksPicture owned,
                                whole_->DrawBlocks(spec, owners, cancellation_));
      result_.stages.push_back(
          {.isovalue = isovalue,
           .stage = "own a pixel",
           .picture_name = "",
           .block_count = static_cast<std::int64_t>(owners.size()),
           .triangle_count = owned.triangle_count,
           .triangle_share =
               all > 0 ? static_cast<double>(owned.triangle_count) / static_cast<double>(all) : 0,
           .differing_pixel_count = CountDifferingPixels(owned.image, whole.image)});
      AddPicture(result_.stages[result_.stages.size() - 2].picture_name, std::move(whole.image));
    }
    return absl::OkStatus();
  }

  // Figure 9: the blocks of the front view from the side; the rest of the surface in red.
  absl::Status DrawSideViews() {
    const double isovalue = result_.speedup_isovalue;
    progress_(absl::StrFormat("figure 9: isovalue %g", isovalue));
    const frame::FrameSpec spec = MakeSpec(isovalue, frame::Culling::kDepth);
    ISOSCOPE_ASSIGN_OR_RETURN(IsolatedFrame culled, whole_->Render(spec, cancellation_));
    ISOSCOPE_ASSIGN_OR_RETURN(
        IsolatedFrame whole,
        whole_->Render(MakeSpec(isovalue, frame::Culling::kNone), cancellation_));
    frame::FrameSpec side = spec;
    view::Azimuth(plan_.side_view_degrees * kRadiansPerDegree, &*side.camera);
    ISOSCOPE_ASSIGN_OR_RETURN(BlocksPicture seen,
                              whole_->DrawBlocks(side, culled.drawn, cancellation_));
    std::vector<volume::BlockId> left_out;
    const std::vector<volume::BlockId> active = whole_->ActiveBlocks(isovalue);
    std::set_difference(active.begin(), active.end(), culled.drawn.begin(), culled.drawn.end(),
                        std::back_inserter(left_out));
    side.surfaces[0].appearance.base_color = kRed;
    ISOSCOPE_ASSIGN_OR_RETURN(const BlocksPicture rest,
                              whole_->DrawBlocks(side, left_out, cancellation_));
    result_.side_views.push_back(
        {.isovalue = isovalue,
         .extracted_triangle_count = seen.triangle_count,
         .left_out_triangle_count = rest.triangle_count,
         .differing_pixel_count = CountDifferingPixels(culled.image, whole.image)});
    AddPicture("figure9_a_whole", std::move(whole.image));
    AddPicture("figure9_b_culled", std::move(culled.image));
    composite::CompositeInto(rest.image, whole_->fragment_order(), &seen.image);
    AddPicture("figure9_c_side", std::move(seen.image));
    return absl::OkStatus();
  }

  // Returns false, with a note, if the volume has fewer blocks.
  bool HasBlocksFor(int agent_count) {
    const std::int64_t block_count = whole_->layout().block_count();
    if (agent_count <= block_count) {
      return true;
    }
    result_.notes.push_back(absl::StrFormat("%d agents were left out: the volume has %d blocks",
                                            agent_count, block_count));
    return false;
  }

  // Figure 7.
  absl::Status MeasureSpeedup() {
    result_.speedup_distribution = plan_.speedup_distribution;
    std::vector<int> agent_counts = plan_.speedup_agent_counts;
    agent_counts.insert(agent_counts.begin(), 1);
    std::sort(agent_counts.begin(), agent_counts.end());
    agent_counts.erase(std::unique(agent_counts.begin(), agent_counts.end()), agent_counts.end());
    for (const int agent_count : agent_counts) {
      if (!HasBlocksFor(agent_count)) {
        continue;
      }
      const frame::FrameSpec spec = MakeSpec(result_.speedup_isovalue, frame::Culling::kDepth);
      std::unique_ptr<IsolatedCluster> cluster;
      std::vector<FrameToMeasure> in_turn{{whole_.get(), spec}};
      if (agent_count > 1) {
        ISOSCOPE_ASSIGN_OR_RETURN(cluster, Open(plan_.speedup_distribution, agent_count));
        in_turn.push_back({cluster.get(), spec});
      }
      progress_(absl::StrFormat("figure 7: %d agents", agent_count));
      ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<IsolatedFrame> frames, MeasureInTurn(in_turn));
      const IsolatedFrame& alone = frames.front();
      const IsolatedFrame& frame = frames.back();
      for (std::size_t i = 0; i < frame.agents.size(); ++i) {
        result_.agents.push_back({.agent_count = agent_count,
                                  .agent = static_cast<int>(i),
                                  .triangle_count = frame.agents[i].triangle_count,
                                  .busy_ms = frame.agents[i].busy_ms});
      }
      const std::vector<double> busy_ms = frame.busy_ms();
      SpeedupRow row{.agent_count = agent_count,
                     .max_busy_ms = *std::max_element(busy_ms.begin(), busy_ms.end()),
                     .sum_busy_ms = Sum(busy_ms),
                     .other_ms = frame.other_ms,
                     .alone_busy_ms = alone.agents.front().busy_ms};
      row.agent_speedup = row.alone_busy_ms / row.max_busy_ms;
      row.frame_speedup = (row.alone_busy_ms + alone.other_ms) / (row.max_busy_ms + row.other_ms);
      result_.speedups.push_back(row);
    }
    return absl::OkStatus();
  }

  // Figure 1.
  absl::Status MeasureBalance() {
    for (const store::Distribution distribution :
         {store::Distribution::kGreedy, store::Distribution::kRandom}) {
      for (const int agent_count : plan_.balance_agent_counts) {
        if (!HasBlocksFor(agent_count)) {
          continue;
        }
        ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<IsolatedCluster> cluster,
                                  Open(distribution, agent_count));
        ISOSCOPE_RETURN_IF_ERROR(MeasureBalanceOf(distribution, cluster.get()));
      }
    }
    std::sort(result_.notes.begin(), result_.notes.end());
    result_.notes.erase(std::unique(result_.notes.begin(), result_.notes.end()),
                        result_.notes.end());
    return absl::OkStatus();
  }

  absl::Status MeasureBalanceOf(store::Distribution distribution, IsolatedCluster* cluster) {
    const auto agent_count = static_cast<int>(cluster->manifest().shards.size());
    std::vector<BalanceRow> rows;
    for (const double isovalue : result_.isovalues) {
      progress_(absl::StrFormat("figure 1: %s, %d agents, isovalue %g", store::NameOf(distribution),
                                agent_count, isovalue));
      ISOSCOPE_ASSIGN_OR_RETURN(const IsolatedFrame frame,
                                Measure(cluster, MakeSpec(isovalue, frame::Culling::kNone)));
      for (std::size_t i = 0; i < frame.agents.size(); ++i) {
        const IsolatedAgent& agent = frame.agents[i];
        rows.push_back({.distribution = distribution,
                        .agent_count = agent_count,
                        .agent = static_cast<int>(i),
                        .isovalue = isovalue,
                        .active_block_count = agent.active_block_count,
                        .triangle_count = agent.triangle_count,
                        .busy_ms = agent.busy_ms});
      }
      result_.bounds.push_back(
          MakeBoundRow(distribution, isovalue, frame.agents, block_triangles_[isovalue]));
    }
    // Order by curve.
    std::stable_sort(rows.begin(), rows.end(),
                     [](const BalanceRow& a, const BalanceRow& b) { return a.agent < b.agent; });
    result_.balance.insert(result_.balance.end(), rows.begin(), rows.end());
    return absl::OkStatus();
  }

  const PaperBenchPlan& plan_;
  const PartitionInto partition_;
  render::Renderer* const renderer_;
  const PaperProgress progress_;
  const base::Cancellation& cancellation_;
  std::unique_ptr<IsolatedCluster> whole_;
  view::Camera camera_;
  std::vector<double> picture_isovalues_;
  std::map<double, std::vector<std::int64_t>> block_triangles_;  // by isovalue
  PaperBenchResult result_;
};

}  // namespace

std::vector<double> EvenIsovalues(const volume::ScalarSpan& range, int count) {
  std::vector<double> levels;
  for (int i = 1; i <= count; ++i) {
    levels.push_back(range.min + (range.max - range.min) * i / (count + 1));
  }
  return levels;
}

BoundRow MakeBoundRow(store::Distribution distribution, double isovalue,
                      const std::vector<IsolatedAgent>& agents,
                      const std::vector<std::int64_t>& block_triangles) {
  BoundRow row{.distribution = distribution,
               .agent_count = static_cast<int>(agents.size()),
               .isovalue = isovalue};
  for (const std::int64_t count : block_triangles) {
    row.total_triangle_count += count;
    row.max_block_triangle_count = std::max(row.max_block_triangle_count, count);
  }
  std::vector<double> blocks;
  std::vector<double> triangles;
  std::vector<double> busy_ms;
  for (const IsolatedAgent& agent : agents) {
    blocks.push_back(static_cast<double>(agent.active_block_count));
    triangles.push_back(static_cast<double>(agent.triangle_count));
    busy_ms.push_back(agent.busy_ms);
    row.max_triangle_count = std::max(row.max_triangle_count, agent.triangle_count);
  }
  const auto total = static_cast<double>(row.total_triangle_count);
  const auto largest = static_cast<double>(row.max_block_triangle_count);
  const auto agent_count = static_cast<double>(row.agent_count);
  const double log_4_over_e = std::log(4.0) - 1;
  const double alpha = (kTheoremC + 1) / log_4_over_e;
  row.premise_triangle_count = alpha * largest * agent_count * std::log(agent_count);
  row.does_premise_hold = total > row.premise_triangle_count;
  row.bound_triangle_count = 2 * total / agent_count;
  if (largest > 0) {
    row.probability_bound =
        std::max(0.0, 1 - agent_count * std::exp(-log_4_over_e * total / (largest * agent_count)));
  }
  row.max_over_mean_blocks = MaxOverMean(blocks);
  row.max_over_mean_triangles = MaxOverMean(triangles);
  row.max_over_mean_busy = MaxOverMean(busy_ms);
  return row;
}

absl::StatusOr<PaperBenchResult> RunPaperBench(const PaperBenchPlan& plan, PartitionInto partition,
                                               render::Renderer* renderer, PaperProgress progress,
                                               const base::Cancellation& cancellation) {
  return Bench(plan, partition, renderer, progress, cancellation).Run();
}

}  // namespace isoscope::bench
