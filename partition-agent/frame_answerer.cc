// A step of a frame, in Draw and AddPixels:
//
// 1. The coordinator's block ids are decoded and checked against the number of blocks.
// 2. ReserveMemory waits for the memory of the step: its image, its reads, and its bands.
// 3. FramePipeline draws.
// 4. AddPixels puts the image into the mailbox, or encodes it as bands. Full messages of bands are
//    sent at once; the last bands go into the answer.
//
// Invariant: the reservation lives until the bands are queued, or the coordinator has the image.

#include "partition-agent/frame_answerer.h"

#include <cstddef>
#include <string>

#include "absl/strings/str_cat.h"

#include "core/base/metrics.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "wire/frame_convert.h"
#include "wire/known_fields.h"
#include "wire/proto_convert.h"

namespace isoscope::agent {
namespace {

namespace v1 = isoscope::internal::v1;

// A message has at most this many bytes of bands, or one band.
constexpr std::size_t kMaxBandsBytes = 1 * base::kMiB;

// The coordinator sets the ranges that clients leave out.
absl::Status CheckMapSteps(const frame::FrameSpec& spec) {
  if (!spec.sends_map_steps) {
    return absl::OkStatus();
  }
  if (!spec.sends_normals) {
    return absl::InvalidArgumentError(
        "begin.frame.sends_map_steps is set: must be unset without begin.frame.sends_normals");
  }
  for (std::size_t i = 0; i < spec.surfaces.size(); ++i) {
    if (spec.surfaces[i].shows_values() && !spec.surfaces[i].color_by->range.has_value()) {
      return absl::InvalidArgumentError(absl::StrCat("begin.frame.surfaces[", i,
                                                     "].color_by.range is not set: required with "
                                                     "begin.frame.sends_map_steps"));
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<FrameTask> FrameTaskFromProto(const v1::BeginFrame& begin) {
  // A field that this agent does not know may decide pixels.
  ISOSCOPE_RETURN_IF_ERROR(wire::CheckKnownFields(begin));
  FrameTask task;
  task.frame_number = begin.frame_number();
  ISOSCOPE_ASSIGN_OR_RETURN(task.spec, wire::FrameSpecFromProto(begin.frame()));
  ISOSCOPE_RETURN_IF_ERROR(CheckMapSteps(task.spec));
  task.agent_index = begin.agent_index();
  task.agent_count = begin.agent_count();
  task.report_active_blocks = begin.report_active_blocks();
  if (task.agent_index < 0 || task.agent_index >= task.agent_count) {
    return absl::InvalidArgumentError(absl::StrCat("begin.agent_index is ", task.agent_index,
                                                   " of begin.agent_count ", task.agent_count,
                                                   ": must lie in [0, agent_count)"));
  }
  return task;
}

}  // namespace

absl::Status FrameAnswerer::Begin(const v1::BeginFrame& begin) {
  ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
  in_work_.emplace(agent_.options.memory->frames());
  ISOSCOPE_ASSIGN_OR_RETURN(const int level,
                            wire::LevelFromProto(begin.frame().level(), "begin.frame.level"));
  ISOSCOPE_ASSIGN_OR_RETURN(
      LevelShards drawn, agent_.shards.FindLevel(begin.dataset_id(), begin.shard_indices(), level));
  ISOSCOPE_ASSIGN_OR_RETURN(task_, FrameTaskFromProto(begin));
  if (begin.mailbox() != 0 && agent_.options.mailboxes == nullptr) {
    return absl::InvalidArgumentError(absl::StrCat(
        "mailbox is ", begin.mailbox(), ", but this agent shares no process with its coordinator"));
  }
  mailbox_ = begin.mailbox();
  shard_indices_.assign(begin.shard_indices().begin(), begin.shard_indices().end());
  block_count_ = drawn.shards.front()->reader->layout().block_count();
  ISOSCOPE_ASSIGN_OR_RETURN(
      task_.counted_blocks,
      wire::BlockListFromProto(begin.counted_blocks(), block_count_, "begin.counted_blocks"));
  ISOSCOPE_ASSIGN_OR_RETURN(task_.counted_layer_blocks,
                            wire::BlockListFromProto(begin.counted_layer_blocks(), block_count_,
                                                     "begin.counted_layer_blocks"));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<LevelShards> colors, FindColors(begin));
  ISOSCOPE_RETURN_IF_ERROR(CheckRoom());
  Shards volumes = drawn.shards;
  std::vector<Shards> color_shards;
  std::vector<double> color_scales;
  for (const LevelShards& color : colors) {
    volumes.insert(volumes.end(), color.shards.begin(), color.shards.end());
    color_shards.push_back(color.shards);
    color_scales.push_back(color.value_scale);
  }
  if (level > 0) {
    task_.whole = drawn.whole;
    task_.spec = frame::InStoredValues(std::move(task_.spec), drawn.value_scale, color_scales);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(pipeline_, FramePipeline::Make(std::move(drawn.shards), task_,
                                                           agent_.Resources(trace_.recorder()),
                                                           &cancellation_, color_shards));
  look_ = agent_.play.NoteFrame({.dataset_id = begin.dataset_id(),
                                 .shard_indices = begin.shard_indices(),
                                 .color_ids = begin.color_dataset_ids(),
                                 .spec = task_.spec,
                                 .volumes = volumes,
                                 .cache_round = pipeline_->cache_round()});
  drawn_ = volume::BlockSet(look_.empty() ? 0 : block_count_);
  return absl::OkStatus();
}

absl::StatusOr<std::vector<LevelShards>> FrameAnswerer::FindColors(
    const v1::BeginFrame& begin) const {
  const std::vector<frame::Surface>& surfaces = task_.spec.surfaces;
  const auto count = static_cast<std::size_t>(begin.color_dataset_ids_size());
  if (count != 0 && count != surfaces.size()) {
    return absl::InvalidArgumentError(absl::StrCat("begin.color_dataset_ids has ", count,
                                                   " elements: must have none, or one for each of ",
                                                   surfaces.size(), " surfaces"));
  }
  std::vector<LevelShards> found(count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::string& id = begin.color_dataset_ids(static_cast<int>(i));
    if (id.empty()) {
      continue;
    }
    if (!surfaces[i].shows_field()) {
      return absl::InvalidArgumentError(absl::StrCat("begin.color_dataset_ids[", i, "] is \"", id,
                                                     "\": must be empty, because surface ", i,
                                                     " shows no other field"));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(found[i],
                              agent_.shards.FindLevel(id, begin.shard_indices(), task_.spec.level));
  }
  return found;
}

absl::StatusOr<FrameAnswerer::Response> FrameAnswerer::SelectOccluders() {
  std::optional<base::OneThreadScope> alone;
  EnterOneThread(&alone);
  base::ScopedObservation select(&agent_.metrics.select_occluders);
  ISOSCOPE_ASSIGN_OR_RETURN(const RaySelection selection, pipeline_->SelectOccluders());
  select.End();
  Response answer;
  *answer.mutable_ray_hits()->mutable_hits() = wire::ToProto(selection.hits);
  *answer.mutable_ray_hits()->mutable_active_blocks() = wire::ToProto(selection.active);
  return answer;
}

absl::StatusOr<FrameAnswerer::Response> FrameAnswerer::RenderOccluders(
    const v1::Occluders& occluders) {
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::vector<volume::BlockId> blocks,
      wire::BlockListFromProto(occluders.blocks(), block_count_, "occluders.blocks"));
  if (!look_.empty()) {
    drawn_.InsertAll(blocks);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(Response answer, Draw(&agent_.metrics.render_occluders, [&] {
                              return pipeline_->RenderOccluders(blocks);
                            }));
  answer.mutable_occluders_done();
  return answer;
}

absl::StatusOr<FrameAnswerer::Response> FrameAnswerer::RenderVisible(
    const v1::VisibleBlocks& visible) {
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::vector<volume::BlockId> blocks,
      wire::BlockListFromProto(visible.blocks(), block_count_, "visible_blocks.blocks"));
  if (!look_.empty()) {
    drawn_.InsertAll(blocks);
    agent_.play.NoteHidden(look_, pipeline_->HiddenBlocks(drawn_));
  }
  return WithStatistics(Draw(&agent_.metrics.render_visible, [&] {
    return pipeline_->RenderVisible(blocks, visible.open_pixels());
  }));
}

absl::StatusOr<FrameAnswerer::Response> FrameAnswerer::RenderAll() {
  return WithStatistics(
      Draw(&agent_.metrics.render_visible, [&] { return pipeline_->RenderAll(); }));
}

// Enters `scope` if this step shall use one thread. Then other steps use the rest, if they have
// room.
void FrameAnswerer::EnterOneThread(std::optional<base::OneThreadScope>* scope) const {
  if (agent_.options.one_thread_a_step &&
      agent_.options.memory->RoomFor(DrawnViewport(), DrawnLayers()) >=
          static_cast<std::size_t>(agent_.options.arena->max_concurrency())) {
    scope->emplace();
  }
}

// Returns the viewport that a step draws. OpenGL draws a region into a picture of the whole.
view::Viewport FrameAnswerer::DrawnViewport() const {
  const bool draws_whole =
      frame::DrawnBy(task_.spec, agent_.options.renderer->picture_revision().back_end) ==
      frame::BackEnd::kEgl;
  return draws_whole ? task_.spec.viewport : frame::ImageSizeOf(task_.spec);
}

int FrameAnswerer::DrawnLayers() const {
  return frame::HasLayers(task_.spec) ? task_.spec.max_layers : 0;
}

// RESOURCE_EXHAUSTED if no step of the frame can ever fit the limit. The coordinator then asks for
// bands, and no rays are cast in vain.
absl::Status FrameAnswerer::CheckRoom() {
  if (agent_.options.memory->RoomFor(DrawnViewport(), DrawnLayers()) > 0) {
    return absl::OkStatus();
  }
  return ReserveMemory().status();
}

// Reserves the memory of one step: its image, and its bands until they are queued.
absl::StatusOr<base::MemoryBudget::Reservation> FrameAnswerer::ReserveMemory() {
  const base::TraceScope trace(trace_.recorder(), "memory");
  const base::ScopedObservation wait(&agent_.metrics.memory_wait);
  return agent_.options.memory->ReserveStep(DrawnViewport(), cancellation_, DrawnLayers());
}

absl::StatusOr<FrameAnswerer::Response> FrameAnswerer::Draw(
    base::DurationHistogram* duration,
    absl::FunctionRef<absl::StatusOr<image::FrameImage>()> draw) {
  std::optional<base::OneThreadScope> alone;
  EnterOneThread(&alone);
  ISOSCOPE_ASSIGN_OR_RETURN(auto reserved, ReserveMemory());
  base::ScopedObservation observation(duration);
  ISOSCOPE_ASSIGN_OR_RETURN(image::FrameImage image, draw());
  observation.End();
  Response last;
  ISOSCOPE_RETURN_IF_ERROR(AddPixels(std::move(image), std::move(reserved), &last));
  return last;
}

// Puts the pixels of a step into the mailbox, or sends the bands of the image, except the last
// ones. Those go into `last`, the message that ends the step, because a message costs more than its
// bytes.
absl::Status FrameAnswerer::AddPixels(image::FrameImage image,
                                      base::MemoryBudget::Reservation reserved, Response* last) {
  if (mailbox_ > 0) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    // It keeps its whole reservation: with more images under way each is colder in the caches. A
    // frame of 256 agents took half as long again without this.
    const bool is_open = agent_.options.mailboxes->Put(
        mailbox_,
        {.image = std::move(image),
         .layers = pipeline_->TakeLayers(),
         .memory = std::make_shared<const base::MemoryBudget::Reservation>(std::move(reserved))});
    last->set_pixels_are_in_mailbox(true);
    return is_open ? absl::OkStatus() : absl::CancelledError("the coordinator has left");
  }
  std::size_t bytes = 0;
  base::ScopedObservation encode(&agent_.metrics.encode);
  std::vector<std::string> bands = pipeline_->Encode(image);
  encode.End();
  for (std::string& band : bands) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    if (bytes > 0 && bytes + band.size() > kMaxBandsBytes) {
      ISOSCOPE_RETURN_IF_ERROR(send_(std::exchange(*last, {})));
      bytes = 0;
    }
    bytes += band.size();
    last->add_bands(std::move(band));
  }
  return absl::OkStatus();
}

absl::StatusOr<FrameAnswerer::Response> FrameAnswerer::WithStatistics(
    absl::StatusOr<Response> last) const {
  if (last.ok()) {
    isoscope::v1::AgentStatistics* proto = last->mutable_frame_done()->mutable_statistics();
    *proto = wire::ToProto(statistics());
    proto->mutable_shard_indices()->Assign(shard_indices_.begin(), shard_indices_.end());
  }
  return last;
}

}  // namespace isoscope::agent
