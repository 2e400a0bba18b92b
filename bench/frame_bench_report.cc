// Tables and JSON have the same figures (frame_bench.cc tells how they are measured). Derived ones:
//
//   cold x, next x   time of the peer / ours: 2.00 if the peer takes twice as long
//   x fewest P       network bytes / those of the same isovalue, culling and renderer with the
//                    fewest agents
//   max/mean         busiest agent / mean of the agents: 1 if all work equally long
//
// A ratio is 0 if its divisor is 0. Tables have kB of 1000 bytes, JSON has bytes.

#include "bench/frame_bench_report.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <nlohmann/json.hpp>

#include "bench/sample_statistics.h"
#include "clients/cpp/request/json_text.h"
#include "core/cli/format.h"
#include "core/cli/table.h"

namespace isoscope::bench {
namespace {

using Json = nlohmann::ordered_json;

std::string FormatWhole(double value) {
  return cli::FormatCount(static_cast<std::int64_t>(std::llround(value)));
}
std::string FormatKilobytes(double bytes) { return FormatWhole(bytes / 1e3); }
std::string FormatRatio(double ratio) { return absl::StrFormat("%.2f", ratio); }

// Returns the same case with the fewest agents.
const FrameCase& FewestAgents(const FrameBenchResult& result, const FrameCase& of) {
  const FrameCase* fewest = &of;
  for (const FrameCase& other : result.cases) {
    if (other.isovalue == of.isovalue && other.culling == of.culling &&
        other.renderer == of.renderer && other.shard_count < fewest->shard_count) {
      fewest = &other;
    }
  }
  return *fewest;
}

double NetworkGrowth(const FrameBenchResult& result, const FrameCase& of) {
  const double least = FewestAgents(result, of).first.network_bytes;
  return least > 0 ? of.first.network_bytes / least : 0;
}

double Over(double a, double b) { return b > 0 ? a / b : 0; }

// Returns the cells that identify a case.
std::vector<std::string> NamesOf(absl::string_view volume, const FrameCase& of) {
  return {absl::StrCat(volume), absl::StrFormat("%g", of.isovalue), absl::StrCat(of.shard_count),
          of.culling, of.renderer};
}

bool HasLevels(const FrameBenchResult& result) {
  return std::any_of(result.cases.begin(), result.cases.end(), [](const FrameCase& of) {
    return of.first.level > 0 || of.following.level > 0;
  });
}

cli::Table FrameTable(absl::string_view volume, const FrameBenchResult& result) {
  const bool has_peer = !result.peers.empty();
  const bool has_levels = HasLevels(result);
  std::vector<std::string> header = {"volume",   "isovalue", "P",           "culling",
                                     "renderer", "cold ms",  "following ms"};
  if (has_peer) {
    header.insert(header.end(), {"peer cold", "peer next", "cold x", "next x"});
  }
  header.insert(header.end(), {"triangles", "read kB", "network kB", "x fewest P", "following kB",
                               "busy sum ms", "max/mean"});
  if (has_levels) {
    header.emplace_back("level");
  }
  cli::Table table(header);
  for (const FrameCase& of : result.cases) {
    std::vector<std::string> row = NamesOf(volume, of);
    row.insert(row.end(), {cli::FormatMilliseconds(of.first.wall_ms),
                           cli::FormatMilliseconds(of.following.wall_ms)});
    if (has_peer) {
      const PeerFigures& peer = result.PeerAt(of.isovalue)->figures;
      row.insert(row.end(),
                 {cli::FormatMilliseconds(peer.cold_ms), cli::FormatMilliseconds(peer.following_ms),
                  FormatRatio(Over(peer.cold_ms, of.first.wall_ms)),
                  FormatRatio(Over(peer.following_ms, of.following.wall_ms))});
    }
    row.insert(row.end(),
               {FormatWhole(of.first.triangle_count), FormatKilobytes(of.first.read_bytes),
                FormatKilobytes(of.first.network_bytes), FormatRatio(NetworkGrowth(result, of)),
                FormatKilobytes(of.following.network_bytes),
                cli::FormatMilliseconds(Sum(of.first.busy_ms)),
                FormatRatio(MaxOverMean(of.first.busy_ms))});
    if (has_levels) {
      row.push_back(absl::StrFormat("%g", of.following.level));
    }
    table.AddRow(std::move(row));
  }
  return table;
}

cli::Table StepTable(absl::string_view volume, const FrameBenchResult& result) {
  cli::Table table({"volume", "isovalue", "P", "culling", "renderer", "frame",
                    "occluder selection ms", "occluder rendering ms", "visibility culling ms",
                    "composite ms", "encode ms", "busy sum ms"});
  for (const FrameCase& of : result.cases) {
    for (const FrameFigures* figures : {&of.first, &of.following}) {
      std::vector<std::string> row = NamesOf(volume, of);
      row.emplace_back(figures == &of.first ? "first" : "following");
      for (const double step_ms : figures->step_ms) {
        row.push_back(cli::FormatMilliseconds(step_ms));
      }
      row.push_back(cli::FormatMilliseconds(Sum(figures->busy_ms)));
      table.AddRow(std::move(row));
    }
  }
  return table;
}

Json ToJson(const FrameFigures& figures) {
  Json steps;
  for (std::size_t i = 0; i < kFrameSteps.size(); ++i) {
    steps[kFrameSteps[i]] = Rounded(figures.step_ms[i]);
  }
  Json busy = Json::array();
  for (const double busy_ms : figures.busy_ms) {
    busy.push_back(Rounded(busy_ms));
  }
  return {{"wall_ms", Rounded(figures.wall_ms)},
          {"level", figures.level},
          {"active_block_count", figures.active_block_count},
          {"visible_block_count", figures.visible_block_count},
          {"triangle_count", figures.triangle_count},
          {"read_bytes", figures.read_bytes},
          {"network_bytes", figures.network_bytes},
          {"png_bytes", figures.png_bytes},
          {"durations_ms", std::move(steps)},
          {"busy_ms", std::move(busy)},
          {"busy_sum_ms", Rounded(Sum(figures.busy_ms))},
          {"busy_max_over_mean", Rounded(MaxOverMean(figures.busy_ms))}};
}

Json ToJson(const PeerFigures& figures) {
  return {{"cold_ms", figures.cold_ms},
          {"following_ms", figures.following_ms},
          {"triangle_count", figures.triangle_count}};
}

}  // namespace

std::string DescribeFrameBench(absl::string_view volume, const FrameBenchResult& result) {
  return absl::StrCat(FrameTable(volume, result).ToString(), "\n",
                      StepTable(volume, result).ToString());
}

std::string FrameBenchJson(const Occasion& occasion, const FrameBenchPlan& plan,
                           const FrameBenchResult& result) {
  Json json = JsonHead(occasion);
  json["volume"] = occasion.volume;
  json["width"] = plan.width_px;
  json["height"] = plan.height_px;
  json["frames"] = plan.frame_count;
  json["runs"] = plan.run_count;
  json["orbit"] = plan.orbit_degrees;
  json["azimuth"] = plan.azimuth_degrees;
  json["elevation"] = plan.elevation_degrees;
  if (plan.level) {
    json["level"] = *plan.level;
  }
  if (plan.max_spacing_px) {
    json["max_spacing_px"] = *plan.max_spacing_px;
  }
  json["cases"] = Json::array();
  for (const FrameCase& of : result.cases) {
    json["cases"].push_back({{"isovalue", of.isovalue},
                             {"agents", of.shard_count},
                             {"culling", of.culling},
                             {"renderer", of.renderer},
                             {"first", ToJson(of.first)},
                             {"following", ToJson(of.following)},
                             {"network_growth", Rounded(NetworkGrowth(result, of))},
                             {"wall_ms", of.wall_ms}});
  }
  json["peers"] = Json::array();
  for (const PeerCase& peer : result.peers) {
    Json of = ToJson(peer.figures);
    of["isovalue"] = peer.isovalue;
    of["runs"] = Json::array();
    for (const PeerFigures& run : peer.runs) {
      of["runs"].push_back(ToJson(run));
    }
    json["peers"].push_back(std::move(of));
  }
  return client::JsonText(json);
}

}  // namespace isoscope::bench
