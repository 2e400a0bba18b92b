// The order of execution, for 2 runs of cases A and B beside a peer:
//
//   A once, B once                  not counted: brings the files into the page cache
//   peer, A: 6 frames, B: 6 frames  run 1, each in a process of its own
//   peer, A: 6 frames, B: 6 frames  run 2
//
// So a temporary slowdown of the machine affects all of them. A process is `isoscope render --stats
// -`; its pictures go to /dev/null.
//
// `first` is the median over runs of frame 0, the cold one; `following` is that of each run's
// median over the other frames. Each figure is a separate median, so the steps need not add up to
// the wall time.

#include "bench/frame_bench.h"

#include <algorithm>
#include <functional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <nlohmann/json.hpp>

#include "bench/child_process.h"
#include "bench/sample_statistics.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/cli/progress_line.h"

namespace isoscope::bench {
namespace {

using AnyJson = nlohmann::json;

// Reads numbers by name and records the first that is missing.
class NumberReader {
 public:
  double Get(const AnyJson& object, const char* key) {
    if (object.is_object() && object.contains(key) && object[key].is_number()) {
      return object[key].get<double>();
    }
    if (missing_.empty()) {
      missing_ = key;
    }
    return 0;
  }
  [[nodiscard]] const std::string& missing() const { return missing_; }

 private:
  std::string missing_;
};

// The level is told only if one was asked for.
double LevelFromJson(const AnyJson& frame) {
  const AnyJson level = frame.value("level", AnyJson());
  return level.is_number() ? level.get<double>() : 0;
}

FrameFigures FrameFromJson(const AnyJson& frame, NumberReader* reader) {
  FrameFigures figures;
  figures.wall_ms = reader->Get(frame, "wall_ms");
  figures.level = LevelFromJson(frame);
  figures.active_block_count = reader->Get(frame, "active_block_count");
  figures.visible_block_count = reader->Get(frame, "visible_block_count");
  figures.triangle_count = reader->Get(frame, "triangle_count");
  figures.read_bytes = reader->Get(frame, "read_bytes");
  figures.network_bytes = reader->Get(frame, "network_bytes");
  figures.png_bytes = reader->Get(frame, "png_bytes");
  const AnyJson durations = frame.value("durations_ms", AnyJson::object());
  for (std::size_t i = 0; i < kFrameSteps.size(); ++i) {
    figures.step_ms[i] = reader->Get(durations, kFrameSteps[i]);
  }
  for (const AnyJson& agent : frame.value("agents", AnyJson::array())) {
    figures.busy_ms.push_back(reader->Get(agent, "busy_ms"));
  }
  return figures;
}

// Returns the median over all frames of the figure that `get` reads.
double MedianOf(const std::vector<FrameFigures>& frames,
                const std::function<double(const FrameFigures&)>& get) {
  std::vector<double> values;
  values.reserve(frames.size());
  for (const FrameFigures& frame : frames) {
    values.push_back(get(frame));
  }
  return Median(std::move(values));
}

const BenchDataset& DatasetOf(const FrameBenchPlan& plan, const FrameCase& of) {
  return *std::find_if(
      plan.datasets.begin(), plan.datasets.end(),
      [&](const BenchDataset& dataset) { return dataset.shard_count == of.shard_count; });
}

// Runs `isoscope render` in a separate process, and discards its pictures.
absl::StatusOr<std::vector<FrameFigures>> RenderFrames(const FrameBenchPlan& plan,
                                                       const FrameCase& of, int frame_count,
                                                       cli::Interrupt* interrupt) {
  std::vector<std::string> argv = {plan.program,
                                   "render",
                                   DatasetOf(plan, of).directory,
                                   "--isovalue",
                                   absl::StrFormat("%.17g", of.isovalue),
                                   "--azimuth",
                                   absl::StrFormat("%.17g", plan.azimuth_degrees),
                                   "--elevation",
                                   absl::StrFormat("%.17g", plan.elevation_degrees),
                                   "--width",
                                   absl::StrCat(plan.width_px),
                                   "--height",
                                   absl::StrCat(plan.height_px),
                                   "--culling",
                                   of.culling,
                                   "--renderer",
                                   of.renderer,
                                   "--output",
                                   "/dev/null",
                                   "--stats",
                                   "-",
                                   "--no-measures"};
  if (frame_count > 1) {
    argv.insert(argv.end(), {"--repeat", absl::StrCat(frame_count), "--orbit",
                             absl::StrFormat("%.17g", plan.orbit_degrees)});
  }
  if (plan.thread_count) {
    argv.insert(argv.end(), {"--threads", absl::StrCat(*plan.thread_count)});
  }
  if (plan.level) {
    argv.insert(argv.end(), {"--level", absl::StrCat(*plan.level)});
  }
  if (plan.max_spacing_px) {
    argv.insert(argv.end(), {"--max-spacing", absl::StrFormat("%.17g", *plan.max_spacing_px)});
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const ChildResult child, RunChild(argv, "", interrupt));
  if (child.exit_code != 0) {
    return absl::InternalError(absl::StrCat("the process that renders ended with exit code ",
                                            child.exit_code, ": ", LastLine(child.err)));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<FrameFigures> frames, FramesFromJson(child.out));
  if (frames.size() != static_cast<std::size_t>(frame_count)) {
    return absl::InternalError(absl::StrCat("the process that renders told of ", frames.size(),
                                            " frames, expected ", frame_count));
  }
  return frames;
}

std::vector<FrameCase> CasesOf(const FrameBenchPlan& plan) {
  std::vector<FrameCase> cases;
  for (const double isovalue : plan.isovalues) {
    for (const std::string& renderer : plan.renderers) {
      for (const std::string& culling : plan.cullings) {
        for (const BenchDataset& dataset : plan.datasets) {
          cases.push_back({.isovalue = isovalue,
                           .shard_count = dataset.shard_count,
                           .culling = culling,
                           .renderer = renderer});
        }
      }
    }
  }
  return cases;
}

PeerFigures MedianOfRuns(const std::vector<PeerFigures>& runs) {
  std::vector<double> cold;
  std::vector<double> following;
  for (const PeerFigures& run : runs) {
    cold.push_back(run.cold_ms);
    following.push_back(run.following_ms);
  }
  return {.cold_ms = Median(std::move(cold)),
          .following_ms = Median(std::move(following)),
          .triangle_count = runs.front().triangle_count};
}

// The figures of a case's bench runs so far.
struct CaseRuns {
  std::vector<FrameFigures> firsts;
  std::vector<FrameFigures> followings;
};

}  // namespace

absl::StatusOr<std::vector<FrameFigures>> FramesFromJson(absl::string_view text) {
  const AnyJson json = AnyJson::parse(text.begin(), text.end(), /*cb=*/nullptr,
                                      /*allow_exceptions=*/false);
  if (!json.is_object() || !json.contains("frames") || !json["frames"].is_array()) {
    return absl::InternalError("statistics of frames: not a JSON object with an array \"frames\"");
  }
  std::vector<FrameFigures> frames;
  NumberReader reader;
  for (const AnyJson& frame : json["frames"]) {
    frames.push_back(FrameFromJson(frame.is_object() ? frame : AnyJson::object(), &reader));
  }
  if (!reader.missing().empty()) {
    return absl::InternalError(
        absl::StrCat("statistics of frames: there is no number \"", reader.missing(), "\""));
  }
  return frames;
}

FrameFigures MedianOf(const std::vector<FrameFigures>& frames) {
  FrameFigures median;
  for (double FrameFigures::*const figure :
       {&FrameFigures::wall_ms, &FrameFigures::level, &FrameFigures::active_block_count,
        &FrameFigures::visible_block_count, &FrameFigures::triangle_count,
        &FrameFigures::read_bytes, &FrameFigures::network_bytes, &FrameFigures::png_bytes}) {
    median.*figure =
        MedianOf(frames, [figure](const FrameFigures& frame) { return frame.*figure; });
  }
  for (std::size_t i = 0; i < kFrameSteps.size(); ++i) {
    median.step_ms[i] =
        MedianOf(frames, [i](const FrameFigures& frame) { return frame.step_ms[i]; });
  }
  median.busy_ms.resize(frames.front().busy_ms.size());
  for (std::size_t i = 0; i < median.busy_ms.size(); ++i) {
    median.busy_ms[i] =
        MedianOf(frames, [i](const FrameFigures& frame) { return frame.busy_ms.at(i); });
  }
  return median;
}

const PeerCase* FrameBenchResult::PeerAt(double isovalue) const {
  const auto found = std::find_if(peers.begin(), peers.end(), [isovalue](const PeerCase& peer) {
    return peer.isovalue == isovalue;
  });
  return found == peers.end() ? nullptr : &*found;
}

absl::StatusOr<FrameBenchResult> RunFrameBench(const FrameBenchPlan& plan,
                                               const cli::Context& context) {
  ISOSCOPE_CHECK(plan.frame_count >= 2);
  FrameBenchResult result;
  result.cases = CasesOf(plan);
  if (plan.peer) {
    for (const double isovalue : plan.isovalues) {
      result.peers.push_back({.isovalue = isovalue});
    }
  }
  cli::ProgressLine line(context.err, context.err_is_terminal);
  for (const FrameCase& of : result.cases) {
    line.Update(absl::StrFormat("warming up  isovalue %g, %d agents, %s", of.isovalue,
                                of.shard_count, of.culling));
    ISOSCOPE_RETURN_IF_ERROR(RenderFrames(plan, of, 1, context.interrupt).status());
  }
  std::vector<CaseRuns> runs(result.cases.size());
  for (int run = 0; run < plan.run_count; ++run) {
    for (PeerCase& peer : result.peers) {
      line.Update(absl::StrFormat("run %d of %d  peer, isovalue %g", run + 1, plan.run_count,
                                  peer.isovalue));
      ISOSCOPE_ASSIGN_OR_RETURN(PeerFigures figures,
                                RunPeer(*plan.peer, peer.isovalue, context.interrupt));
      peer.runs.push_back(figures);
    }
    for (std::size_t i = 0; i < result.cases.size(); ++i) {
      FrameCase& of = result.cases[i];
      line.Update(absl::StrFormat("run %d of %d  isovalue %g, %d agents, %s, %s", run + 1,
                                  plan.run_count, of.isovalue, of.shard_count, of.culling,
                                  of.renderer));
      ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<FrameFigures> frames,
                                RenderFrames(plan, of, plan.frame_count, context.interrupt));
      runs[i].firsts.push_back(frames.front());
      runs[i].followings.push_back(
          MedianOf(std::vector<FrameFigures>(frames.begin() + 1, frames.end())));
      std::vector<double>& wall_ms = of.wall_ms.emplace_back();
      for (const FrameFigures& frame : frames) {
        wall_ms.push_back(frame.wall_ms);
      }
    }
  }
  for (std::size_t i = 0; i < result.cases.size(); ++i) {
    result.cases[i].first = MedianOf(runs[i].firsts);
    result.cases[i].following = MedianOf(runs[i].followings);
  }
  for (PeerCase& peer : result.peers) {
    peer.figures = MedianOfRuns(peer.runs);
  }
  return result;
}

}  // namespace isoscope::bench
