// The screen is text, made of two answers of the coordinator: this one, and the one before it.
//
//   AppendHead     coordinator: uptime, memory, network, frames
//   AppendAgents   a line for each agent
//   AppendFrames   a line for each frame in work, as many as fit; the last line counts the others
//
// Rates are the growth of counters between the answers, by the clock of the process that counts. A
// process that has restarted counts from 0, and its rates are those since then.

#include "client-cli/terminal/top_screen.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/printable.h"
#include "core/base/units.h"
#include "core/cli/format.h"
#include "core/cli/table.h"
#include "wire/proto_convert.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

// "12.3", "1.2 k", "3.4 M".
std::string FormatRate(double per_second) {
  constexpr double kThousand = 1000;
  constexpr double kMillion = 1e6;
  return per_second >= kMillion    ? absl::StrFormat("%.1f M", per_second / kMillion)
         : per_second >= kThousand ? absl::StrFormat("%.1f k", per_second / kThousand)
                                   : absl::StrFormat("%.1f", per_second);
}

std::string FormatMebibytesPerSecond(double bytes_per_second) {
  return absl::StrFormat("%.1f MiB", bytes_per_second / static_cast<double>(base::kMiB));
}

std::string FormatMemory(std::int64_t bytes, std::int64_t limit_bytes) {
  return limit_bytes > 0
             ? absl::StrFormat("%d of %d MiB", bytes / base::kMiB, limit_bytes / base::kMiB)
             : absl::StrFormat("%d MiB", bytes / base::kMiB);
}

std::string FormatUptime(absl::Duration up) {
  const std::int64_t days = up / absl::Hours(24);
  return days > 0 ? absl::StrFormat("%d d %02d h", days, (up % absl::Hours(24)) / absl::Hours(1))
                  : FormatElapsed(up);
}

// The growth of a process's counters per second. The process's own clock measures the time: an
// agent's answer may be as old as the coordinator's last poll.
class Rates {
 public:
  // `before`: null if there is no earlier answer.
  template <typename Load>
  Rates(const Load& now, const Load* before) {
    absl::Duration span = wire::DurationFromProto(now.up_duration());
    // A restarted process has counted from 0.
    if (before != nullptr && span > wire::DurationFromProto(before->up_duration())) {
      is_since_before_ = true;
      span -= wire::DurationFromProto(before->up_duration());
    }
    seconds_ = std::max(absl::ToDoubleSeconds(span), 1e-3);
  }

  [[nodiscard]] double Of(double now, double before) const {
    return std::max(now - (is_since_before_ ? before : 0), 0.0) / seconds_;
  }
  [[nodiscard]] double Of(std::int64_t now, std::int64_t before) const {
    return Of(static_cast<double>(now), static_cast<double>(before));
  }

 private:
  bool is_since_before_ = false;
  double seconds_ = 1;
};

// "0-3,7".
std::string FormatIndices(std::vector<int> indices) {
  std::sort(indices.begin(), indices.end());
  std::vector<std::string> parts;
  for (std::size_t i = 0; i < indices.size();) {
    std::size_t end = i + 1;
    while (end < indices.size() && indices[end] == indices[end - 1] + 1) {
      ++end;
    }
    parts.push_back(end - i == 1 ? absl::StrCat(indices[i])
                                 : absl::StrCat(indices[i], "-", indices[end - 1]));
    i = end;
  }
  return absl::StrJoin(parts, ",");
}

std::string FormatShards(const v1::AgentStatus& agent) {
  std::map<std::string, std::vector<int>> by_dataset;
  for (const v1::ServedShard& shard : agent.shards()) {
    by_dataset[shard.dataset()].push_back(shard.shard_index());
  }
  std::vector<std::string> parts;
  for (const auto& [dataset, indices] : by_dataset) {
    parts.push_back(absl::StrCat(dataset, " ", FormatIndices(indices)));
  }
  return absl::StrJoin(parts, "; ");
}

const v1::AgentStatus* FindAgent(const std::optional<ClusterSample>& sample,
                                 const std::string& address) {
  if (sample.has_value()) {
    for (const v1::AgentStatus& agent : sample->status.agents()) {
      if (agent.address() == address) {
        return &agent;
      }
    }
  }
  return nullptr;
}

const char* NameOf(const v1::AgentStatus& agent) {
  switch (agent.state()) {
    case v1::AgentStatus::STATE_REACHABLE:
      return agent.damaged_shards().empty() ? "ok" : "damaged";
    case v1::AgentStatus::STATE_OPENING:
      return "opening";
    default:
      return "lost";
  }
}

std::vector<std::string> AgentCells(const v1::AgentStatus& agent, const v1::AgentStatus* before) {
  std::vector<std::string> cells = {base::PrintableAscii(agent.address()), NameOf(agent),
                                    base::PrintableAscii(FormatShards(agent))};
  if (agent.state() == v1::AgentStatus::STATE_UNREACHABLE || !agent.has_load()) {
    cells.insert(cells.end(), {"-", "-", "-", "-", "-", "-"});
    return cells;
  }
  const v1::AgentLoad& load = agent.load();
  const bool has_before = before != nullptr && before->has_load();
  const v1::AgentLoad empty;
  const v1::AgentLoad& old = has_before ? before->load() : empty;
  const Rates rates(load, has_before ? &old : nullptr);
  const double busy = rates.Of(absl::ToDoubleSeconds(wire::DurationFromProto(load.busy_duration())),
                               absl::ToDoubleSeconds(wire::DurationFromProto(old.busy_duration())));
  cells.push_back(absl::StrCat(load.working_frame_count()));
  cells.push_back(FormatRate(rates.Of(load.done_frame_count(), old.done_frame_count())));
  cells.push_back(absl::StrFormat("%.2f", busy));
  cells.push_back(FormatRate(rates.Of(load.triangle_count(), old.triangle_count())));
  cells.push_back(FormatMebibytesPerSecond(rates.Of(load.read_bytes(), old.read_bytes())));
  cells.push_back(FormatMemory(load.resident_bytes(), load.memory_limit_bytes()));
  return cells;
}

const char* NameOf(v1::FrameInWork::Step step) {
  switch (step) {
    case v1::FrameInWork::STEP_QUEUED:
      return "queued";
    case v1::FrameInWork::STEP_PREPARING:
      return "preparing";
    case v1::FrameInWork::STEP_OCCLUDER_SELECTION:
      return "1 rays";
    case v1::FrameInWork::STEP_OCCLUDER_RENDERING:
      return "2 occluders";
    case v1::FrameInWork::STEP_VISIBILITY_CULLING:
      return "3 visible";
    case v1::FrameInWork::STEP_FINISHING:
      return "finishing";
    default:
      return "?";
  }
}

void AppendHead(const ClusterSample& now, const std::optional<ClusterSample>& before,
                const TopScreenOptions& options, std::vector<std::string>* lines) {
  const v1::CoordinatorLoad& load = now.status.load();
  const bool has_before = before.has_value() && before->status.has_load();
  const v1::CoordinatorLoad empty;
  const v1::CoordinatorLoad& old = has_before ? before->status.load() : empty;
  const Rates rates(load, has_before ? &old : nullptr);
  lines->push_back(absl::StrCat("isoscope top: ", base::PrintableAscii(options.server), ", ",
                                absl::FormatTime("%H:%M:%S", now.date, absl::UTCTimeZone()),
                                " UTC"));
  if (!now.status.has_load()) {
    lines->push_back("the coordinator is older than this program: it does not tell its load");
    return;
  }
  lines->push_back(absl::StrCat(
      "coordinator: up ", FormatUptime(wire::DurationFromProto(load.up_duration())), ", memory ",
      FormatMemory(load.resident_bytes(), load.memory_limit_bytes()), ", network ",
      FormatMebibytesPerSecond(rates.Of(load.network_bytes(), old.network_bytes())), "/s"));
  lines->push_back(absl::StrCat(
      "frames: ", load.working_frame_count(), " in work, ", load.queued_frame_count(), " waiting; ",
      FormatRate(rates.Of(load.done_frame_count(), old.done_frame_count())), "/s done, ",
      FormatRate(rates.Of(load.failed_frame_count(), old.failed_frame_count())), "/s failed, ",
      FormatRate(rates.Of(load.refused_frame_count(), old.refused_frame_count())), "/s refused"));
}

// Appends an empty line, and the table.
void AppendTable(const Table& table, const TopScreenOptions& options,
                 std::vector<std::string>* lines) {
  lines->push_back("");
  for (std::string& line : table.CutLines(static_cast<std::size_t>(options.width))) {
    lines->push_back(std::move(line));
  }
}

void AppendAgents(const ClusterSample& now, const std::optional<ClusterSample>& before,
                  const TopScreenOptions& options, std::vector<std::string>* lines) {
  Table table = Table::OfColumns({{"AGENT", true, true},
                                  {"STATE", true},
                                  {"SHARDS", true, true},
                                  {"FRAMES"},
                                  {"DONE/s"},
                                  {"BUSY"},
                                  {"TRIANGLES/s"},
                                  {"READ/s"},
                                  {"MEMORY"}});
  for (const v1::AgentStatus& agent : now.status.agents()) {
    table.AddRow(AgentCells(agent, FindAgent(before, agent.address())));
  }
  AppendTable(table, options, lines);
}

void AppendFrames(const ClusterSample& now, const TopScreenOptions& options,
                  std::vector<std::string>* lines) {
  if (now.status.frames().empty()) {
    return;
  }
  const int rest = options.height - static_cast<int>(lines->size()) - 2;  // empty line, titles
  int shown = now.status.frames_size();
  if (options.height > 0 && shown > rest) {
    shown = std::max(rest - 1, 0);  // the last line has the number of the others
  }
  Table table = Table::OfColumns({{"REQUEST", true, true},
                                  {"CLIENT", true, true},
                                  {"DATASET", true, true},
                                  {"PIXELS"},
                                  {"STEP", true},
                                  {"AGE"}});
  for (int i = 0; i < shown; ++i) {
    const v1::FrameInWork& frame = now.status.frames(i);
    table.AddRow({base::PrintableAscii(frame.request_id()), base::PrintableAscii(frame.client()),
                  frame.dataset().empty() ? "-" : base::PrintableAscii(frame.dataset()),
                  absl::StrCat(frame.extent().width_px(), "x", frame.extent().height_px()),
                  NameOf(frame.step()),
                  absl::StrFormat("%.1f s", absl::ToDoubleSeconds(
                                                wire::DurationFromProto(frame.age_duration())))});
  }
  AppendTable(table, options, lines);
  if (shown < now.status.frames_size()) {
    lines->push_back(absl::StrCat("and ", now.status.frames_size() - shown, " more"));
  }
}

}  // namespace

std::vector<std::string> TopScreen(const ClusterSample& now,
                                   const std::optional<ClusterSample>& before,
                                   const TopScreenOptions& options) {
  std::vector<std::string> lines;
  AppendHead(now, before, options, &lines);
  AppendAgents(now, before, options, &lines);
  for (const v1::AgentStatus& agent : now.status.agents()) {
    if (!agent.message().empty()) {
      lines.push_back(base::PrintableAscii(absl::StrCat(agent.address(), ": ", agent.message())));
    }
    for (const v1::DamagedShard& damaged : agent.damaged_shards()) {
      lines.push_back(base::PrintableAscii(
          absl::StrCat(agent.address(), ": shard ", damaged.shard_index(), " of ",
                       damaged.dataset(), " is damaged: ", damaged.message())));
    }
  }
  AppendFrames(now, options, &lines);
  if (options.height > 0 && lines.size() > static_cast<std::size_t>(options.height)) {
    lines.resize(static_cast<std::size_t>(options.height));
  }
  for (std::string& line : lines) {
    if (options.width > 0) {
      line = CutText(std::move(line), static_cast<std::size_t>(options.width));
    }
  }
  return lines;
}

}  // namespace isoscope::cli
