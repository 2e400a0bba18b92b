// 1. NoteFrame is called as a frame begins. LookOf names its play: series, field, surfaces and what
//    colours them. PlayDetector guesses the next step from the steps of this look.
// 2. MakeStep describes that step. Replace ends the steps that the frame used or contradicts, and
//    queues the new one.
// 3. Read, on a thread of low priority, opens the step's volumes and reads the samples of the
//    blocks that the frame will need.
// 4. MakeMeshes waits until the agent is idle. A frame that begins interrupts it; it then starts
//    again, and finds the meshes that it has made in the cache.
//
// Locks: mutex_ guards steps_ and the detector. Steps are cancelled without it, because their
// callbacks run in Cancel.

#include "partition-agent/play_ahead.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstdlib>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

#include "core/base/cancellation.h"
#include "core/base/no_memory.h"
#include "core/base/status_macros.h"
#include "partition-agent/memory/low_priority.h"

namespace isoscope::agent {
namespace {

// Names what frames of one play have in common: the field, and what decides meshes.
std::string LookOf(const SeriesShard& series, const SeriesShard::Place& place,
                   const std::vector<std::optional<store::ScalarVolumeKey>>& colors,
                   const frame::FrameSpec& spec) {
  std::string look = absl::StrCat(series.served()->manifest.dataset_id, " ", place.key.field, ".",
                                  place.key.component, " level ", spec.level);
  for (std::size_t i = 0; i < spec.surfaces.size(); ++i) {
    const volume::InsideRule& rule = spec.surfaces[i].rule;
    absl::StrAppend(&look, " ", absl::Hex(std::bit_cast<std::uint64_t>(rule.isovalue)));
    for (const double label : rule.labels) {
      absl::StrAppend(&look, "|", absl::Hex(std::bit_cast<std::uint64_t>(label)));
    }
    absl::StrAppend(&look, rule.smooths ? "~" : "");
    if (i < colors.size() && colors[i].has_value()) {
      absl::StrAppend(&look, ":", colors[i]->field, ".", colors[i]->component);
    }
  }
  return look;
}

}  // namespace

// A step that is read ahead.
struct PlayAhead::Step {
  std::string look;
  std::string dataset_id;
  google::protobuf::RepeatedField<std::int32_t> shard_indices;
  int level = 0;
  std::vector<std::string> color_ids;  // by surface; "": none
  ExpectedFrame frame;                 // without its volumes, which are opened when they are used
  base::Cancellation cancellation;
  std::atomic<bool> is_begun{false};
};

PlayAhead::Mode PlayAhead::ModeOfEnvironment() {
  const char* const value = std::getenv("ISOSCOPE_PLAY_AHEAD");
  const absl::string_view mode = value == nullptr ? "" : value;
  return mode == "off" ? Mode::kOff : mode == "samples" ? Mode::kSamples : Mode::kMeshes;
}

PlayAhead::PlayAhead(const ShardSet* shards, AgentMemory* memory, AgentMetrics* metrics,
                     const AgentResources& resources, absl::Duration idle_before_meshes, Mode mode)
    : shards_(*shards),
      memory_(*memory),
      metrics_(*metrics),
      resources_{.arena = resources.arena,
                 .cache = resources.cache,
                 .max_read_bytes = resources.max_read_bytes},
      idle_before_meshes_(idle_before_meshes),
      mode_(shards_.series().empty() ? Mode::kOff : mode) {
  if (mode_ != Mode::kOff) {
    const AgentMemory::AheadThreads threads = memory_.TakeAheadThreads();
    reading_.emplace(threads.reading, kMaxTasks);
    making_.emplace(threads.making, kMaxTasks);
  }
}

PlayAhead::~PlayAhead() {
  std::vector<StepPointer> ended;
  {
    const base::MutexLock lock(&mutex_);
    ended.assign(steps_.begin(), steps_.end());
    steps_.clear();
  }
  for (const StepPointer& step : ended) {
    step->cancellation.Cancel();
  }
}

std::string PlayAhead::NoteFrame(const Frame& frame) {
  if (mode_ == Mode::kOff) {
    return "";
  }
  for (const std::shared_ptr<SeriesShard>& series : shards_.series()) {
    const std::optional<SeriesShard::Place> place = series->PlaceOf(frame.dataset_id);
    if (!place.has_value()) {
      continue;
    }
    std::vector<std::optional<store::ScalarVolumeKey>> colors;
    for (const std::string& id : frame.color_ids) {
      const std::optional<SeriesShard::Place> color = series->PlaceOf(id);
      colors.push_back(color.has_value() ? std::optional(color->key) : std::nullopt);
    }
    const std::string look = LookOf(*series, *place, colors, frame.spec);
    std::vector<StepPointer> ended;
    {
      const base::MutexLock lock(&mutex_);
      const PlayDetector::Guess guess = detector_.Note(look, static_cast<int>(place->position),
                                                       static_cast<int>(place->steps.size()));
      StepPointer next;
      if (guess.next.has_value() && memory_.open_volumes().HasRoomForAnother(frame.volumes)) {
        next = MakeStep(frame, *series, *place, *guess.next);
      }
      if (next != nullptr) {
        next->look = look;
        for (const auto& [name, hidden] : hidden_) {
          next->frame.hidden = name == look ? hidden : next->frame.hidden;
        }
      }
      Replace(look, frame.dataset_id, guess, std::move(next), &ended);
    }
    for (const StepPointer& step : ended) {
      step->cancellation.Cancel();
    }
    return look;
  }
  return "";
}

// Null if a volume of the step is not served.
PlayAhead::StepPointer PlayAhead::MakeStep(const Frame& frame, const SeriesShard& series,
                                           const SeriesShard::Place& place, int position) const {
  const int number = place.steps[static_cast<std::size_t>(position)];
  const auto id_of = [&](store::ScalarVolumeKey key) {
    key.step = number;
    return series.IdOf(key);
  };
  auto step = std::make_shared<Step>();
  step->dataset_id = id_of(place.key);
  step->shard_indices = frame.shard_indices;
  step->level = frame.spec.level;
  for (const std::string& id : frame.color_ids) {
    if (!frame.spec.sends_map_steps) {
      break;
    }
    const std::optional<SeriesShard::Place> color = series.PlaceOf(id);
    if (!id.empty() && (!color.has_value() || id_of(color->key).empty())) {
      return nullptr;
    }
    step->color_ids.push_back(id.empty() ? "" : id_of(color->key));
  }
  step->frame.rules = frame::RulesOf(frame.spec);
  for (const frame::Surface& surface : frame.spec.surfaces) {
    step->frame.with_magnitudes.push_back(frame.spec.sends_map_steps && surface.shows_gradient());
  }
  step->frame.clip = frame.spec.clip;
  step->frame.cache_round = frame.cache_round;
  return step->dataset_id.empty() ? nullptr : step;
}

// Ends the steps that the frame used or contradicts, and queues the next one.
void PlayAhead::Replace(const std::string& look, const std::string& dataset_id,
                        const PlayDetector::Guess& guess, StepPointer next,
                        std::vector<StepPointer>* ended) {
  for (auto at = steps_.begin(); at != steps_.end();) {
    const StepPointer step = *at;
    const bool is_used = step->look == look && step->dataset_id == dataset_id;
    if (step->look == look && next != nullptr && step->dataset_id == next->dataset_id) {
      next = nullptr;  // it is on its way
    } else if (is_used || (step->look == look && guess.follows_last)) {
      at = steps_.erase(at);
      End(step, is_used, ended);
      continue;
    }
    ++at;
  }
  if (next == nullptr) {
    return;
  }
  if (steps_.size() == kMaxSteps) {
    End(std::move(steps_.back()), /*is_used=*/false, ended);
    steps_.pop_back();
  }
  const bool is_queued = reading_->TrySchedule([this, next] {
    LowerPriorityOfThisThread();
    // The frame reports the error, if it is one.
    base::OrNoMemory("a step ahead", [&] { return Read(next); }).IgnoreError();
  });
  if (is_queued) {
    steps_.push_front(std::move(next));
  }
}

void PlayAhead::End(StepPointer step, bool is_used, std::vector<StepPointer>* ended) const {
  if (step->is_begun.load()) {
    (is_used ? metrics_.steps_ahead.used : metrics_.steps_ahead.wasted).Add();
  }
  ended->push_back(std::move(step));
}

void PlayAhead::NoteHidden(const std::string& look, std::vector<volume::BlockId> hidden) {
  if (look.empty()) {
    return;
  }
  const base::MutexLock lock(&mutex_);
  hidden_.remove_if([&](const auto& known) { return known.first == look; });
  hidden_.emplace_front(look, std::move(hidden));
  hidden_.resize(std::min(hidden_.size(), kMaxLooks));
}

absl::StatusOr<ExpectedFrame> PlayAhead::Open(const Step& step) const {
  ExpectedFrame frame = step.frame;
  const auto find = [&](const std::string& dataset_id) {
    return shards_.FindLevel(dataset_id, step.shard_indices, step.level,
                             SeriesShard::Opening::kAhead);
  };
  ISOSCOPE_ASSIGN_OR_RETURN(LevelShards drawn, find(step.dataset_id));
  frame.shards = std::move(drawn.shards);
  std::vector<Shards> by_surface(step.frame.rules.size());
  for (std::size_t i = 0; i < step.color_ids.size(); ++i) {
    if (!step.color_ids[i].empty()) {
      ISOSCOPE_ASSIGN_OR_RETURN(LevelShards color, find(step.color_ids[i]));
      by_surface[i] = std::move(color.shards);
    }
  }
  ISOSCOPE_ASSIGN_OR_RETURN(frame.colors, ColorVolumes::Make(frame.shards, by_surface));
  return frame;
}

absl::Status PlayAhead::Read(const StepPointer& step) {
  ISOSCOPE_RETURN_IF_ERROR(step->cancellation.Check());
  step->is_begun.store(true);
  {
    ISOSCOPE_ASSIGN_OR_RETURN(const ExpectedFrame frame, Open(*step));
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<StepAhead> ahead,
                              StepAhead::Make(frame, resources_, &step->cancellation));
    ISOSCOPE_RETURN_IF_ERROR(ahead->ReadSamples(memory_.frames()));
  }
  const bool is_queued = mode_ == Mode::kMeshes && making_->TrySchedule([this, step] {
    base::OrNoMemory("a step ahead", [&] { return MakeMeshes(step.get()); }).IgnoreError();
  });
  return is_queued ? absl::OkStatus() : absl::UnavailableError("samples alone are read");
}

absl::Status PlayAhead::MakeMeshes(Step* step) const {
  while (true) {
    ISOSCOPE_RETURN_IF_ERROR(memory_.frames()->AwaitIdle(step->cancellation, idle_before_meshes_));
    base::Cancellation attempt;
    const base::Cancellation::Callback ends_with_step(step->cancellation,
                                                      [&attempt] { attempt.Cancel(); });
    const FramesInWork::Interruption interruption(memory_.frames(), &attempt);
    const auto make = [&]() -> absl::Status {
      ISOSCOPE_ASSIGN_OR_RETURN(const auto reserved, memory_.ReserveReads(attempt));
      ISOSCOPE_ASSIGN_OR_RETURN(const ExpectedFrame frame, Open(*step));
      ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<StepAhead> ahead,
                                StepAhead::Make(frame, resources_, &attempt));
      return ahead->MakeMeshes();
    };
    if (absl::Status status = make(); !absl::IsCancelled(status)) {
      return status;
    }
  }
}

}  // namespace isoscope::agent
