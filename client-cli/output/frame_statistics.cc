// The statistics of frames for programs (StatisticsJson) and for people (DescribeStatistics):
//
//   blocks     a row a frame: counts of blocks in each step of culling, triangles, bytes
//   steps      a row a frame: duration of each step
//   agents     a row an agent, of the last frame
//   surfaces   a row a surface, of the last frame, if it was measured
//
// Times are protobuf durations; JSON has milliseconds, rounded to microseconds. These members of a
// frame are there only if they tell something: truncated_pixel_count, missing_shards with
// active_block_coverage, band_count (two or more), level with max_spacing_px and spacing (if the
// request has a choice of level), unresolved_block_count (of a level), surfaces (of two or more),
// notes, measures.

#include "client-cli/output/frame_statistics.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include <nlohmann/json.hpp>

#include "clients/cpp/request/json_text.h"
#include "clients/cpp/request/level_flags.h"
#include "core/cli/format.h"
#include "core/cli/table.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

double Milliseconds(const google::protobuf::Duration& duration) {
  return static_cast<double>(duration.seconds()) * 1e3 +
         static_cast<double>(duration.nanos()) * 1e-6;
}

double Rounded(double milliseconds) { return std::round(milliseconds * 1e3) / 1e3; }

nlohmann::ordered_json AgentToJson(const v1::AgentStatistics& agent) {
  nlohmann::ordered_json json;
  json["shard"] = agent.shard_indices().empty() ? -1 : agent.shard_indices(0);
  json["active_block_count"] = agent.active_block_count();
  json["triangle_count"] = agent.triangle_count();
  json["read_bytes"] = agent.read_bytes();
  json["extract_ms"] = Rounded(Milliseconds(agent.extract_duration()));
  json["render_ms"] = Rounded(Milliseconds(agent.render_duration()));
  json["busy_ms"] = Rounded(Milliseconds(agent.busy_duration()));
  json["shards"] = nlohmann::ordered_json::array();
  for (const int shard : agent.shard_indices()) {
    json["shards"].push_back(shard);
  }
  json["address"] = agent.agent_address();
  return json;
}

// "outside_range", in snake_case without the prefix of the message.
std::string NameOf(v1::SurfaceNote::Reason reason) {
  constexpr absl::string_view kPrefix = "REASON_";
  return absl::AsciiStrToLower(absl::StripPrefix(v1::SurfaceNote::Reason_Name(reason), kPrefix));
}

nlohmann::ordered_json FrameToJson(const FrameRecord& frame) {
  const v1::RenderStatistics& statistics = frame.statistics;
  const v1::StepDurations& durations = statistics.durations();
  nlohmann::ordered_json json;
  json["wall_ms"] = Rounded(frame.wall_ms);
  json["active_block_count"] = statistics.active_block_count();
  json["ray_hit_block_count"] = statistics.ray_hit_block_count();
  json["occluding_block_count"] = statistics.occluding_block_count();
  json["visible_block_count"] = statistics.visible_block_count();
  json["culled_block_count"] = statistics.culled_block_count();
  json["triangle_count"] = statistics.triangle_count();
  json["unique_vertex_count"] = statistics.unique_vertex_count();
  json["read_bytes"] = statistics.read_bytes();
  json["network_bytes"] = statistics.network_bytes();
  json["png_bytes"] = statistics.png_bytes();
  if (statistics.truncated_pixel_count() > 0) {
    json["truncated_pixel_count"] = statistics.truncated_pixel_count();
  }
  if (statistics.missing_shards_size() > 0) {
    json["missing_shards"] = nlohmann::ordered_json::array();
    for (const int shard : statistics.missing_shards()) {
      json["missing_shards"].push_back(shard);
    }
    json["active_block_coverage"] = statistics.active_block_coverage();
  }
  if (statistics.band_count() > 1) {
    json["band_count"] = statistics.band_count();
  }
  if (frame.drawn_level.has_value()) {
    const v1::DrawnLevel& drawn = *frame.drawn_level;
    json["level"] = drawn.level();
    json["max_spacing_px"] = drawn.max_spacing_px();
    json["spacing"] = {drawn.spacing().x(), drawn.spacing().y(), drawn.spacing().z()};
  }
  if (statistics.has_unresolved_block_count()) {
    json["unresolved_block_count"] = statistics.unresolved_block_count();
  }
  json["durations_ms"] = {
      {"occluder_selection", Rounded(Milliseconds(durations.occluder_selection_duration()))},
      {"occluder_rendering", Rounded(Milliseconds(durations.occluder_rendering_duration()))},
      {"visibility_culling", Rounded(Milliseconds(durations.visibility_culling_duration()))},
      {"composite", Rounded(Milliseconds(durations.composite_duration()))},
      {"encode", Rounded(Milliseconds(durations.encode_duration()))}};
  // For a single surface they equal the sums above.
  if (statistics.surfaces_size() > 1) {
    for (const v1::SurfaceStatistics& surface : statistics.surfaces()) {
      json["surfaces"].push_back({{"triangle_count", surface.triangle_count()},
                                  {"unique_vertex_count", surface.unique_vertex_count()}});
    }
  }
  for (const v1::SurfaceNote& note : frame.notes) {
    json["notes"].push_back({{"surface_index", note.surface_index()},
                             {"reason", NameOf(note.reason())},
                             {"message", note.message()}});
  }
  if (frame.measures.has_value()) {
    json["measures"] = MeasuresToJson(frame.measures->surfaces, frame.measures->length_unit);
  }
  json["agents"] = nlohmann::ordered_json::array();
  for (const v1::AgentStatistics& agent : statistics.agents()) {
    json["agents"].push_back(AgentToJson(agent));
  }
  return json;
}

std::string FormatStep(const google::protobuf::Duration& duration) {
  return FormatMilliseconds(Milliseconds(duration));
}

// What the level of a frame hides, behind its name; "" if that is not known.
std::string UnresolvedText(const v1::RenderStatistics& statistics) {
  return statistics.has_unresolved_block_count()
             ? absl::StrCat("; active blocks of level 0 that it does not resolve: ",
                            FormatCount(statistics.unresolved_block_count()))
             : "";
}

}  // namespace

std::string StatisticsJson(const std::vector<FrameRecord>& frames) {
  nlohmann::ordered_json json;
  json["frames"] = nlohmann::ordered_json::array();
  for (const FrameRecord& frame : frames) {
    json["frames"].push_back(FrameToJson(frame));
  }
  return client::JsonText(json);
}

std::string DescribeMissingShards(const v1::RenderStatistics& statistics) {
  if (statistics.missing_shards().empty()) {
    return "";
  }
  return absl::StrFormat("%s %s %s missing: the picture shows %.1f %% of the active blocks",
                         statistics.missing_shards_size() == 1 ? "shard" : "shards",
                         absl::StrJoin(statistics.missing_shards(), ", "),
                         statistics.missing_shards_size() == 1 ? "is" : "are",
                         100 * statistics.active_block_coverage());
}

std::string DescribeBands(const std::vector<FrameRecord>& frames) {
  std::int64_t least = 0;
  std::int64_t most = 0;
  std::size_t count = 0;
  for (const FrameRecord& frame : frames) {
    if (const std::int64_t bands = frame.statistics.band_count(); bands > 1) {
      least = count == 0 ? bands : std::min(least, bands);
      most = std::max(most, bands);
      ++count;
    }
  }
  if (count == 0) {
    return "";
  }
  const std::string bands = least == most
                                ? FormatCount(most)
                                : absl::StrCat(FormatCount(least), " to ", FormatCount(most));
  return absl::StrCat("\n",
                      frames.size() == 1 ? "The frame was"
                      : count == 1       ? "One frame was"
                                         : absl::StrCat(count, " frames were"),
                      " drawn in ", bands, " bands: the whole does not fit the memory limit\n");
}

std::string DescribeLevels(const std::vector<FrameRecord>& frames) {
  std::map<std::int32_t, std::size_t> counts;
  for (const FrameRecord& frame : frames) {
    if (frame.drawn_level.has_value()) {
      ++counts[frame.drawn_level->level()];
    }
  }
  if (counts.empty()) {
    return "";
  }
  if (counts.size() == 1) {
    return absl::StrCat("\nDrawn from ", client::TextOfLevel(*frames.back().drawn_level),
                        UnresolvedText(frames.back().statistics), "\n");
  }
  return absl::StrCat("\nDrawn from ",
                      absl::StrJoin(counts, ", ",
                                    [](std::string* out, const auto& count) {
                                      absl::StrAppend(out, "level ", count.first, " (",
                                                      count.second, " frames)");
                                    }),
                      "\n");
}

std::string DescribeStatistics(const std::vector<FrameRecord>& frames, int max_width) {
  Table blocks({"frame", "wall ms", "active blocks", "hit by rays", "occluding", "drawn", "culled",
                "triangles", "read", "network", "png"});
  Table steps({"frame", "occluder selection ms", "occluder rendering ms", "visibility culling ms",
               "composite ms", "encode ms"});
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const v1::RenderStatistics& statistics = frames[i].statistics;
    const v1::StepDurations& durations = statistics.durations();
    blocks.AddRow(
        {absl::StrCat(i), FormatMilliseconds(frames[i].wall_ms),
         FormatCount(statistics.active_block_count()),
         FormatCount(statistics.ray_hit_block_count()),
         FormatCount(statistics.occluding_block_count()),
         FormatCount(statistics.visible_block_count()),
         FormatCount(statistics.culled_block_count()), FormatCount(statistics.triangle_count()),
         FormatMebibytes(statistics.read_bytes()), FormatMebibytes(statistics.network_bytes()),
         FormatMebibytes(statistics.png_bytes())});
    steps.AddRow({absl::StrCat(i), FormatStep(durations.occluder_selection_duration()),
                  FormatStep(durations.occluder_rendering_duration()),
                  FormatStep(durations.visibility_culling_duration()),
                  FormatStep(durations.composite_duration()),
                  FormatStep(durations.encode_duration())});
  }
  std::string text = absl::StrCat(blocks.ToString(max_width), "\n", steps.ToString(max_width),
                                  DescribeBands(frames), DescribeLevels(frames));
  if (!frames.empty() && !frames.back().statistics.agents().empty()) {
    Table agents({"agent", "shards", "active blocks", "drawn", "triangles", "read", "extract ms",
                  "render ms", "busy ms"});
    for (const v1::AgentStatistics& agent : frames.back().statistics.agents()) {
      agents.AddRow({agent.agent_address(), absl::StrJoin(agent.shard_indices(), ","),
                     FormatCount(agent.active_block_count()),
                     FormatCount(agent.visible_block_count()), FormatCount(agent.triangle_count()),
                     FormatMebibytes(agent.read_bytes()), FormatStep(agent.extract_duration()),
                     FormatStep(agent.render_duration()), FormatStep(agent.busy_duration())});
    }
    absl::StrAppend(&text, "\n", frames.size() > 1 ? "Agents of the last frame:\n" : "",
                    agents.ToString(max_width));
  }
  if (!frames.empty() && frames.back().measures.has_value()) {
    const FrameMeasures& measures = *frames.back().measures;
    absl::StrAppend(&text, "\n", frames.size() > 1 ? "Surfaces of the last frame:\n" : "",
                    MeasuresTable(measures.surfaces, measures.length_unit, max_width));
  }
  return text;
}

}  // namespace isoscope::cli
