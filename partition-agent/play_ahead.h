// Plays of a series: guesses which step an agent's frames ask for next, and has it read ahead.
//
//   1. NoteFrame: PlayDetector guesses a step. It is queued, unless it is already.
//   2. A thread of the process opens its volumes, finds its blocks, and has the system read their
//      samples (StepAhead::ReadSamples), while frames draw.
//   3. Another one makes meshes, while no frame of the process is in work. A frame that begins
//      interrupts it.
//   4. The frame comes, and finds what was done so far: the step was used. Or a frame contradicts
//      the guess, or another step takes its place: it was wasted. Either ends the work on it.
//
// The thread that reads has a low priority. The other one has not: its tasks hold slots of the
// arena until their present block is done. At most kMaxSteps steps are read ahead, each of another
// play.

#ifndef ISOSCOPE_PARTITION_AGENT_PLAY_AHEAD_H_
#define ISOSCOPE_PARTITION_AGENT_PLAY_AHEAD_H_

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"
#include "google/protobuf/repeated_field.h"

#include "core/base/executor.h"
#include "core/base/mutex.h"
#include "core/frame/frame_spec.h"
#include "core/volume/block_layout.h"
#include "partition-agent/memory/agent_memory.h"
#include "partition-agent/memory/agent_resources.h"
#include "partition-agent/play/play_detector.h"
#include "partition-agent/play/step_ahead.h"
#include "partition-agent/shard_set.h"

namespace isoscope::agent {

// Thread-safe. The destructor ends the work and waits for it.
class PlayAhead {
 public:
  enum class Mode { kOff, kSamples, kMeshes };
  // As the environment variable ISOSCOPE_PLAY_AHEAD says: "off" or "samples"; else kMeshes.
  static Mode ModeOfEnvironment();

  // A frame that begins. References are used during the call alone.
  struct Frame {
    const std::string& dataset_id;  // of its volume
    const google::protobuf::RepeatedField<std::int32_t>& shard_indices;
    const google::protobuf::RepeatedPtrField<std::string>& color_ids;  // by surface, or empty
    const frame::FrameSpec& spec;  // of stored values, as FrameTask has it
    const Shards& volumes;         // all that it has open
    std::uint64_t cache_round = 0;
  };

  // idle_before_meshes: the time without frames before meshes are made. In a process that also
  //                     finishes the pictures, these need the threads.
  // resources:          arena, cache and max_read_bytes are used
  // The arguments outlive it.
  PlayAhead(const ShardSet* shards, AgentMemory* memory, AgentMetrics* metrics,
            const AgentResources& resources, absl::Duration idle_before_meshes, Mode mode);
  ~PlayAhead();
  PlayAhead(const PlayAhead&) = delete;
  PlayAhead& operator=(const PlayAhead&) = delete;

  // Notes a frame and reads ahead. Returns the name of its look, for NoteHidden; "" if it is of no
  // series. Does not block.
  std::string NoteFrame(const Frame& frame) ABSL_LOCKS_EXCLUDED(mutex_);
  // Notes the active blocks that a frame did not draw. The next frame of its look will not either.
  void NoteHidden(const std::string& look, std::vector<volume::BlockId> hidden)
      ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  struct Step;
  using StepPointer = std::shared_ptr<Step>;
  static constexpr std::size_t kMaxSteps = 2;
  static constexpr std::size_t kMaxLooks = 8;
  // Tasks of cancelled steps end soon. Until then no others are queued.
  static constexpr std::size_t kMaxTasks = 2 * kMaxSteps;

  [[nodiscard]] StepPointer MakeStep(const Frame& frame, const SeriesShard& series,
                                     const SeriesShard::Place& place, int position) const;
  void Replace(const std::string& look, const std::string& dataset_id,
               const PlayDetector::Guess& guess, StepPointer next, std::vector<StepPointer>* ended)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void End(StepPointer step, bool is_used, std::vector<StepPointer>* ended) const;
  [[nodiscard]] absl::StatusOr<ExpectedFrame> Open(const Step& step) const;
  absl::Status Read(const StepPointer& step);
  absl::Status MakeMeshes(Step* step) const;

  const ShardSet& shards_;
  AgentMemory& memory_;
  AgentMetrics& metrics_;
  const AgentResources resources_;
  const absl::Duration idle_before_meshes_;
  const Mode mode_;

  base::Mutex mutex_;
  PlayDetector detector_ ABSL_GUARDED_BY(mutex_);
  std::list<StepPointer> steps_ ABSL_GUARDED_BY(mutex_);  // the newest first
  // By look, the last used first.
  std::list<std::pair<std::string, std::vector<volume::BlockId>>> hidden_ ABSL_GUARDED_BY(mutex_);
  // Last: their tasks use the members above. Not set if there are no series.
  std::optional<base::ExecutorShare> making_;
  std::optional<base::ExecutorShare> reading_;  // after it, because its tasks queue others there
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_PLAY_AHEAD_H_
