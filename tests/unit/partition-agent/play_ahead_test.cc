#include "partition-agent/play_ahead.h"

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/memory_info.h"
#include "core/base/task_arena.h"
#include "core/partition/series_partitioner.h"
#include "core/render/renderer_factory.h"
#include "core/store/shard_format.h"
#include "core/view/camera.h"
#include "partition-agent/frame/frame_pipeline.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/partition/series_fixture.h"

namespace isoscope::agent {
namespace {

using partition::FlowFields;
using partition::MemorySeries;

constexpr int kStepCount = 6;
constexpr double kIsovalue = 60;
// Far above what anything here takes.
constexpr absl::Duration kPatience = absl::Seconds(60);
constexpr std::size_t kAmpleBytes = std::size_t{1} << 30;

class PlayAheadTest : public ::testing::Test {
 protected:
  PlayAheadTest() {
    std::vector<double> times;
    for (int step = 0; step < kStepCount; ++step) {
      times.push_back(step);
    }
    MemorySeries source(FlowFields(), times);
    partition::SeriesPartitionOptions options;
    options.volume.output_directory = temp_.Sub("flow");
    options.volume.block_cells = math::Index3{4, 4, 4};
    options.volume.shard_count = 1;
    ISOSCOPE_EXPECT_OK(partition::PartitionSeries(source, options, never_).status());
    arena_ = std::make_shared<base::TaskArena>(2);
    auto renderer = render::MakeRenderer({.kind = render::RendererKind::kCpu, .arena = arena_});
    ISOSCOPE_EXPECT_OK(renderer.status());
    renderer_ = *std::move(renderer);
  }

  void Open(PlayAhead::Mode mode, std::size_t limit_bytes = kAmpleBytes) {
    play_.reset();
    memory_ = std::make_unique<AgentMemory>(limit_bytes);
    auto series =
        SeriesShard::Open(absl::StrCat(temp_.Sub("flow"), "/", store::ShardDirectoryName(0, 1)),
                          memory_->TakeOpenVolumes());
    ISOSCOPE_ASSERT_OK(series.status());
    shards_ = std::make_unique<ShardSet>(Shards(), SeriesShards{*std::move(series)});
    ISOSCOPE_ASSERT_OK(memory_->Settle());
    metrics_ = std::make_unique<AgentMetrics>();
    play_ = std::make_unique<PlayAhead>(shards_.get(), memory_.get(), metrics_.get(), Resources(),
                                        absl::ZeroDuration(), mode);
  }
  [[nodiscard]] AgentResources Resources() const {
    return {.renderer = renderer_.get(),
            .layers = memory_->layers(),
            .arena = arena_.get(),
            .cache = memory_->cache(),
            .max_read_bytes = memory_->read_bytes(),
            .frames = memory_->frames()};
  }
  [[nodiscard]] std::string IdOf(int field, int component, int step) const {
    return shards_->series().front()->IdOf({.field = field, .component = component, .step = step});
  }

  struct Drawn {
    image::FrameImage image;
    std::int64_t read_bytes = 0;
  };
  // Draws a step as FrameAnswerer does. `color`: shows the other field.
  Drawn Draw(int step, bool has_color = false) {
    const FramesInWork::Frame in_work(memory_->frames());
    FrameTask task;
    task.frame_number = ++frame_number_;
    task.spec.surfaces = {{.rule = {.isovalue = kIsovalue}, .appearance = {}}};
    task.spec.viewport = {90, 70};
    google::protobuf::RepeatedField<std::int32_t> indices;
    indices.Add(0);
    const std::string id = IdOf(0, 0, step);
    Shards shards = *shards_->Find(id, indices);
    task.spec.camera =
        view::MakeDefaultCamera(shards.front()->reader->manifest().geometry.Bounds());
    google::protobuf::RepeatedPtrField<std::string> color_ids;
    std::vector<Shards> colors;
    if (has_color) {
      task.spec.sends_normals = true;
      task.spec.sends_map_steps = true;
      task.spec.surfaces[0].color_by = frame::ColorBy{.quantity = frame::ColorBy::Quantity::kField,
                                                      .range = frame::ColorRange{0, 125}};
      *color_ids.Add() = IdOf(1, 0, step);
      colors = {*shards_->Find(color_ids[0], indices)};
    }
    auto pipeline = FramePipeline::Make(shards, task, Resources(), &never_, colors);
    EXPECT_THAT(pipeline, testing::IsOk());
    const std::string look = play_->NoteFrame({.dataset_id = id,
                                               .shard_indices = indices,
                                               .color_ids = color_ids,
                                               .spec = task.spec,
                                               .volumes = shards,
                                               .cache_round = (*pipeline)->cache_round()});
    auto image = (*pipeline)->RenderAll();
    EXPECT_THAT(image, testing::IsOk());
    play_->NoteHidden(look, hidden_);
    return {*std::move(image), (*pipeline)->statistics().read_bytes};
  }
  // Waits until the steps that are queued were read, and their meshes made.
  void AwaitAhead() {
    const AgentMemory::AheadThreads threads = memory_->TakeAheadThreads();
    for (const auto& executor : {threads.reading, threads.making}) {
      absl::Notification done;
      ASSERT_TRUE(executor->TrySchedule([&done] { done.Notify(); }));
      ASSERT_TRUE(done.WaitForNotificationWithTimeout(kPatience));
    }
  }
  [[nodiscard]] std::int64_t used() const { return metrics_->steps_ahead.used.value(); }
  [[nodiscard]] std::int64_t wasted() const { return metrics_->steps_ahead.wasted.value(); }

  const base::Cancellation never_;
  const testing::TempDir temp_;
  std::shared_ptr<base::TaskArena> arena_;
  std::unique_ptr<render::Renderer> renderer_;
  std::unique_ptr<AgentMemory> memory_;
  std::unique_ptr<ShardSet> shards_;
  std::unique_ptr<AgentMetrics> metrics_;
  std::vector<volume::BlockId> hidden_;
  std::int64_t frame_number_ = 0;
  std::unique_ptr<PlayAhead> play_;  // last: its threads use the others
};

TEST_F(PlayAheadTest, AFrameOfAPlayFindsItsMeshesAndHasTheSamePicture) {
  for (const bool has_color : {false, true}) {
    Open(PlayAhead::Mode::kOff);
    std::vector<image::FrameImage> expected;
    for (int step = 0; step < kStepCount; ++step) {
      Drawn drawn = Draw(step, has_color);
      EXPECT_GT(drawn.read_bytes, 0);
      expected.push_back(std::move(drawn.image));
    }
    for (const PlayAhead::Mode mode : {PlayAhead::Mode::kSamples, PlayAhead::Mode::kMeshes}) {
      Open(mode);
      for (int step = 0; step < kStepCount; ++step) {
        const Drawn drawn = Draw(step, has_color);
        EXPECT_TRUE(drawn.image == expected[static_cast<std::size_t>(step)]) << step;
        // Two frames make a play.
        EXPECT_EQ(drawn.read_bytes == 0, mode == PlayAhead::Mode::kMeshes && step >= 2)
            << "step " << step << ", colour " << has_color;
        AwaitAhead();
      }
      EXPECT_EQ(used(), kStepCount - 2);
      EXPECT_EQ(wasted(), 0);
    }
  }
}

TEST_F(PlayAheadTest, BlocksThatTheLastFrameDidNotDrawAreLeftOut) {
  Open(PlayAhead::Mode::kMeshes);
  hidden_ = {0, 1, 2};
  Draw(0);
  AwaitAhead();
  Draw(1);
  AwaitAhead();
  const std::int64_t read_bytes = Draw(2).read_bytes;
  EXPECT_GT(read_bytes, 0);
  constexpr std::int64_t kBlockBytes = 7 * 7 * 7 * 4;  // with the samples around it
  EXPECT_LE(read_bytes, 3 * kBlockBytes);
}

struct Waste {
  const char* name;
  std::vector<int> frames;
  int used;
  int wasted;
};
std::ostream& operator<<(std::ostream& out, const Waste& waste) { return out << waste.name; }

TEST_F(PlayAheadTest, APlayThatEndsOrTurnsWastesOneStep) {
  for (const Waste& play :
       {Waste{"stops", {0, 1, 2}, 1, 0}, Waste{"turns", {0, 1, 2, 1, 0}, 2, 1},
        Waste{"jumps", {0, 1, 2, 5, 0}, 1, 1},
        Waste{"moves the camera", {0, 1, 1, 1, 2, 2, 3}, 2, 0}, Waste{"loops", {4, 5, 0, 1}, 2, 0},
        Waste{"jumps about", {0, 3, 1, 5}, 0, 0}}) {
    Open(PlayAhead::Mode::kMeshes);
    for (const int step : play.frames) {
      Draw(step);
      AwaitAhead();
    }
    EXPECT_EQ(used(), play.used) << play;
    EXPECT_EQ(wasted(), play.wasted) << play;
  }
}

TEST_F(PlayAheadTest, ADatasetOfAnotherAgentIsNoPlay) {
  Open(PlayAhead::Mode::kMeshes);
  const google::protobuf::RepeatedField<std::int32_t> indices;
  const google::protobuf::RepeatedPtrField<std::string> no_colors;
  const frame::FrameSpec spec;
  const Shards none;
  EXPECT_EQ(play_->NoteFrame({.dataset_id = "0123456789abcdef0123456789abcdef",
                              .shard_indices = indices,
                              .color_ids = no_colors,
                              .spec = spec,
                              .volumes = none}),
            "");
}

// Meshes are made only while no frame is in work, and a frame does not wait for them.
TEST_F(PlayAheadTest, FramesGoFirst) {
  Open(PlayAhead::Mode::kMeshes);
  Draw(0);
  Draw(1);
  const std::size_t before = memory_->cache()->mesh_bytes();
  {
    const FramesInWork::Frame other(memory_->frames());
    Draw(1);
    absl::SleepFor(absl::Milliseconds(50));
    EXPECT_LE(memory_->cache()->mesh_bytes(), before + (std::size_t{2} << 20));
    const auto reserved = memory_->ReserveStep({90, 70}, never_);
    ISOSCOPE_EXPECT_OK(reserved.status());
  }
  AwaitAhead();
  EXPECT_EQ(Draw(2).read_bytes, 0);
}

// What earlier tests left in this process counts against the limit: more of it where the system
// gives large pages. AddressSanitizer keeps all freed memory.
std::size_t LeastBytes() {
#ifdef __SANITIZE_ADDRESS__
  return std::size_t{1} << 30;
#else
  return std::max(AgentMemory::kMinLimitBytes, 2 * base::ResidentBytes());
#endif
}

// With the least memory, and more frames than have room: all are drawn.
TEST_F(PlayAheadTest, TheLeastMemoryIsEnough) {
  const std::size_t least_bytes = LeastBytes();
  Open(PlayAhead::Mode::kOff, least_bytes);
  std::vector<image::FrameImage> expected;
  for (int step = 0; step < kStepCount; ++step) {
    expected.push_back(Draw(step).image);
  }
  Open(PlayAhead::Mode::kMeshes, least_bytes);
  for (int round = 0; round < 3; ++round) {
    for (int step = 0; step < kStepCount; ++step) {
      EXPECT_TRUE(Draw(step).image == expected[static_cast<std::size_t>(step)]) << step;
    }
  }
}

TEST_F(PlayAheadTest, EndsWhileStepsAreQueued) {
  for (int i = 0; i < 20; ++i) {
    Open(PlayAhead::Mode::kMeshes);
    Draw(0);
    Draw(1);
    const FramesInWork::Frame in_work(memory_->frames());  // so that making meshes waits
    play_.reset();
  }
}

}  // namespace
}  // namespace isoscope::agent
