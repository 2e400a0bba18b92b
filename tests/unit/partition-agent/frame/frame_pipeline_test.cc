
#include <algorithm>
#include <filesystem>
#include <iterator>
#include <set>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/random.h"
#include "core/image/normal_and_step.h"
#include "tests/support/reference_extractor.h"
#include "tests/unit/partition-agent/frame/frame_pipeline_fixture.h"

namespace isoscope::agent {
namespace {

using isoscope::testing::FlipBit;
using isoscope::testing::SmallDataset;
using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

TEST_F(FramePipelineTest, RenderAllDrawsEveryTriangleOfTheReference) {
  Open(3);
  const auto reference = isoscope::testing::ReferenceExtractor(
                             dataset_->geometry(), volume::ScalarType::kUint8, dataset_->samples())
                             .Extract(SmallDataset::kIsovalue);
  std::int64_t triangles = 0;
  std::int64_t vertices = 0;
  std::int64_t blocks = 0;
  for (const auto& shard : shards_) {
    frame::AgentStatistics statistics;
    RenderAll({shard}, dataset_->Request(), &statistics);
    triangles += statistics.triangle_count;
    vertices += statistics.unique_vertex_count;
    blocks += statistics.visible_block_count;
    EXPECT_EQ(statistics.visible_block_count, statistics.active_block_count);
    EXPECT_GT(statistics.read_bytes, 0);
    EXPECT_GT(statistics.index_page_read_count, 0);
    EXPECT_GT(statistics.busy_duration, absl::ZeroDuration());
    EXPECT_GE(statistics.busy_duration, statistics.extract_duration + statistics.render_duration);
  }
  EXPECT_EQ(triangles, static_cast<std::int64_t>(reference.triangles.size()));
  EXPECT_EQ(vertices, static_cast<std::int64_t>(reference.vertices.size()));
  EXPECT_EQ(blocks,
            shards_.front()->reader->ranges().ActiveBlocks(SmallDataset::kIsovalue).Count());
}

TEST_F(FramePipelineTest, StatisticsAddUp) {
  Open(1);
  Frame frame;
  RunAlone(task_, &frame);

  // Counted again from the definitions.
  const view::View view = dataset_->ViewOf(task_);
  const store::ShardReader& reader = *shards_.front()->reader;
  const volume::BlockSet active =
      reader.ranges().ActiveBlocks(task_.spec.surfaces[0].rule.isovalue);
  EXPECT_EQ(frame.selection.active, active.Ids());
  const auto drawn = static_cast<std::int64_t>(frame.visible_blocks.size()) +
                     static_cast<std::int64_t>(frame.occluding_blocks.size());
  std::int64_t off_screen = 0;
  for (const volume::BlockId id : frame.selection.active) {
    off_screen += view.FootprintOf(reader.layout(), id).rect.empty() ? 1 : 0;
  }
  // The scene shows all fates, or the test says nothing.
  EXPECT_GT(frame.visible_blocks.size(), 0U);
  EXPECT_GT(off_screen, 0);
  EXPECT_LT(drawn + off_screen, active.Count());
  EXPECT_EQ(frame.statistics.visible_block_count, drawn);
  EXPECT_EQ(frame.statistics.active_block_count, active.Count());
  EXPECT_EQ(frame.statistics.occluding_block_count,
            static_cast<std::int64_t>(frame.occluding_blocks.size()));

  // Selection reads the index alone; drawing reads blocks.
  EXPECT_EQ(frame.after_selection.triangle_count, 0);
  EXPECT_GT(frame.after_selection.index_page_read_count, 0);
  EXPECT_EQ(frame.after_selection.index_page_read_count, frame.statistics.index_page_read_count);
  EXPECT_GT(frame.statistics.read_bytes, frame.after_selection.read_bytes);
  EXPECT_GE(frame.statistics.busy_duration, frame.after_selection.busy_duration);
}

TEST_F(FramePipelineTest, EncodingIsPartOfTheBusyTime) {
  Open(1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards_, task_));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image, pipeline->RenderAll());
  const absl::Duration before = pipeline->statistics().busy_duration;
  ASSERT_FALSE(pipeline->Encode(image).empty());
  EXPECT_GT(pipeline->statistics().busy_duration, before);
}

TEST_F(FramePipelineTest, CulledPictureIsThatOfAllBlocks) {
  Open(2);
  Frame frame;
  RunAlone(task_, &frame);
  frame::AgentStatistics all;
  EXPECT_TRUE(frame.image == RenderAll(shards_, task_, &all));
  EXPECT_LT(frame.statistics.triangle_count, all.triangle_count);
}

TEST_F(FramePipelineTest, HitsOfThreeAgentsAreThoseOfOne) {
  Open(3);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto alone, Make(shards_, task_));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection one_selection, alone->SelectOccluders());
  const std::vector<volume::BlockId>& expected = one_selection.hits;
  ASSERT_FALSE(expected.empty());
  EXPECT_TRUE(std::is_sorted(expected.begin(), expected.end()));
  volume::BlockSet hits(dataset_->layout().block_count());
  std::vector<volume::BlockId> active;
  for (int i = 0; i < 3; ++i) {
    task_.agent_index = i;
    task_.agent_count = 3;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline,
                                  Make({shards_[static_cast<std::size_t>(i)]}, task_));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection own, pipeline->SelectOccluders());
    EXPECT_LT(own.hits.size(), expected.size()) << "agent " << i << " casts the others' rays too";
    hits.InsertAll(own.hits);
    EXPECT_TRUE(std::is_sorted(own.active.begin(), own.active.end()));
    active.insert(active.end(), own.active.begin(), own.active.end());
  }
  EXPECT_EQ(hits.Ids(), expected);
  // Each active block is reported by its own agent and by no other.
  std::sort(active.begin(), active.end());
  EXPECT_EQ(active, one_selection.active);
}

TEST_F(FramePipelineTest, ActiveBlocksAreReportedOnlyIfAskedFor) {
  Open(1);
  task_.report_active_blocks = false;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards_, task_));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection selection, pipeline->SelectOccluders());
  EXPECT_FALSE(selection.hits.empty());
  EXPECT_TRUE(selection.active.empty());
}

TEST_F(FramePipelineTest, BlocksThatAreNotItsOwnActiveOnesAreRefused) {
  Open(2);
  task_.spec.surfaces[0].rule.isovalue = 230;  // near the largest: not all blocks are active
  const volume::BlockId block_count =
      static_cast<volume::BlockId>(dataset_->layout().block_count());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto own, Make({shards_[0]}, task_));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection selection, own->SelectOccluders());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto others, Make({shards_[1]}, task_));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection other_selection, others->SelectOccluders());
  const volume::BlockSet active =
      shards_[0]->reader->ranges().ActiveBlocks(task_.spec.surfaces[0].rule.isovalue);
  volume::BlockId inactive = 0;
  while (inactive < block_count && active.Contains(inactive)) {
    ++inactive;
  }
  ASSERT_LT(inactive, block_count);
  const auto with = [&](volume::BlockId id) {
    std::vector<volume::BlockId> blocks = selection.active;
    blocks.push_back(id);
    std::sort(blocks.begin(), blocks.end());
    return blocks;
  };
  const volume::BlockId another_block = other_selection.active[other_selection.active.size() / 2];
  for (const std::vector<volume::BlockId>& blocks :
       {with(another_block), with(inactive), std::vector<volume::BlockId>{another_block},
        with(block_count), with(selection.active.front())}) {
    const auto is_refused = StatusIs(absl::StatusCode::kInvalidArgument,
                                     HasSubstr("1 of " + absl::StrCat(blocks.size())));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, Make({shards_[0]}, task_));
    ISOSCOPE_ASSERT_OK(second->SelectOccluders());
    EXPECT_THAT(second->RenderOccluders(blocks), is_refused);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto third, Make({shards_[0]}, task_));
    ISOSCOPE_ASSERT_OK(third->SelectOccluders());
    ISOSCOPE_ASSERT_OK(third->RenderOccluders({}));
    EXPECT_THAT(third->RenderVisible(blocks, ""), is_refused);
  }
}

TEST_F(FramePipelineTest, FragmentsAtClosedPixelsAreDroppedAndNoOthers) {
  Open(1);
  const view::View view = dataset_->ViewOf(task_);
  // Each cell of each block's mask is open or not, as dice decide.
  std::vector<volume::BlockId> blocks;
  std::vector<image::PixelMask> masks;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, Make(shards_, task_));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection selection, first->SelectOccluders());
  for (const volume::BlockId id : selection.active) {
    const view::PixelRect rect = view.FootprintOf(dataset_->layout(), id).rect;
    blocks.push_back(id);
    masks.push_back(visibility::ClosedMaskOf(rect));
    const auto bits = static_cast<std::size_t>(masks.back().columns) *
                      static_cast<std::size_t>(masks.back().rows);
    for (std::size_t bit = 0; bit < bits; ++bit) {
      if (base::RandomUnit(id, bit) < 0.5) {
        masks.back().words[bit / 64] |= std::uint64_t{1} << (bit % 64);
      }
    }
  }
  image::FrameImage expected = EmptyImage(task_);
  std::int64_t dropped = 0;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const auto one = MakeSelected();
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image, one->RenderOccluders({blocks[i]}));
    image::FrameImage open(image.width, image.height);
    for (int y = 0; y < image.height; ++y) {
      for (int x = 0; x < image.width; ++x) {
        const std::size_t pixel = image.IndexOf(x, y);
        if (image.keys[pixel] == image::kBackgroundKey) {
          continue;
        }
        if (masks[i].Contains(x, y)) {
          open.Set(x, y, image.keys[pixel], image.colors[pixel]);
        } else {
          ++dropped;
        }
      }
    }
    composite::CompositeInto(open, kOrder, &expected);
  }
  EXPECT_GT(dropped, 1000);
  ISOSCOPE_ASSERT_OK(first->RenderOccluders({}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image,
                                first->RenderVisible(blocks, visibility::EncodeOpenPixels(masks)));
  EXPECT_TRUE(image == expected);
  // No masks: nothing is dropped (the paper's culling by mask).
  const auto unmasked = MakeWithoutOccluders();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage all, unmasked->RenderVisible(blocks, ""));
  EXPECT_TRUE(all == RenderAll(shards_, task_));
}

TEST_F(FramePipelineTest, DamagedOrForeignOpenPixelsAreDataLoss) {
  Open(1);
  Frame frame;
  RunAlone(task_, &frame);
  ASSERT_GT(frame.visible_blocks.size(), 1U);
  const std::string open_pixels =
      dataset_->VisibleOf(task_, frame.selection.active, frame.occluding_blocks, frame.occluders)
          .second;
  std::vector<std::string> bad = {"x", std::string(1000, '\xff'), open_pixels + "x"};
  for (std::size_t i = 0; i < open_pixels.size(); i += 1 + open_pixels.size() / 40) {
    bad.push_back(open_pixels);
    bad.back()[i] = static_cast<char>(bad.back()[i] ^ 16);
    if (i > 0) {
      bad.push_back(open_pixels.substr(0, i));
    }
  }
  // Pixels of other blocks: undamaged, but of other shapes.
  std::vector<volume::BlockId> fewer = frame.visible_blocks;
  fewer.pop_back();
  for (std::size_t i = 0; i <= bad.size(); ++i) {
    const auto pipeline = MakeWithoutOccluders();
    EXPECT_THAT(i < bad.size() ? pipeline->RenderVisible(frame.visible_blocks, bad[i])
                               : pipeline->RenderVisible(fewer, open_pixels),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("open pixels")))
        << i;
  }
}

TEST_F(FramePipelineTest, TwoShardsInOnePipelineGiveThePictureOfTwoPipelines) {
  Open(2);
  frame::AgentStatistics both;
  const image::FrameImage expected = RenderAll(shards_, task_, &both);
  frame::AgentStatistics first;
  frame::AgentStatistics second;
  image::FrameImage image = RenderAll({shards_[0]}, task_, &first);
  EXPECT_FALSE(image == expected) << "the second shard shows nothing";
  composite::CompositeInto(RenderAll({shards_[1]}, task_, &second), kOrder, &image);
  EXPECT_TRUE(image == expected);
  EXPECT_EQ(both.triangle_count, first.triangle_count + second.triangle_count);
  EXPECT_EQ(both.unique_vertex_count, first.unique_vertex_count + second.unique_vertex_count);
  EXPECT_EQ(both.active_block_count, first.active_block_count + second.active_block_count);
}

// Symptom: with three threads or more and a memory limit the program aborted, "Resource deadlock
// avoided". Shading ran a parallel loop under a lock, inside of the loops that add meshes.
TEST_F(FramePipelineTest, NeitherThreadCountNorMemoryLimitShows) {
  Open(2);
  // Many tiles are shaded side by side, while other threads draw.
  task_.spec.viewport = {240, 180};
  Use({.thread_count = 1});
  Frame expected;
  RunAlone(task_, &expected);
  for (const int thread_count : testing::kThreadCounts) {
    // The first two limits make the renderer shade early.
    for (const std::size_t memory_limit_bytes :
         {testing::kLeastMemoryLimitBytes, std::size_t{1} << 20, testing::Limits::kNoMemoryLimit}) {
      Use({.thread_count = thread_count, .memory_limit_bytes = memory_limit_bytes});
      ForgetAll();
      // From kept meshes, threads draw small tasks side by side.
      for (int i = 0; i < 4; ++i) {
        Frame frame;
        RunAlone(task_, &frame);
        ExpectSameWork(frame, expected);
      }
    }
  }
}

TEST_F(FramePipelineTest, PagesOfTheTreeAreReadWhileOtherStepsHaveAllThreads) {
  Open(1);
  base::TaskArena arena(1);
  arena.SetSharesThreads(true);
  AgentMetrics metrics;
  AgentResources resources = Resources();
  resources.arena = &arena;
  resources.metrics = &metrics;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline,
                                FramePipeline::Make(shards_, task_, resources, &never_));
  absl::Status selected = absl::UnknownError("has not ended");
  std::thread step;
  base::RunIn(&arena, [&] {
    step = std::thread([&] { selected = pipeline->SelectOccluders().status(); });
    const base::MonotonicTime deadline = base::MonotonicNow() + absl::Seconds(60);
    while (metrics.active_lookups.misses.value() == 0 && base::MonotonicNow() < deadline) {
      std::this_thread::yield();
    }
    EXPECT_GT(metrics.active_lookups.misses.value(), 0) << "the pages are not read";
  });
  step.join();
  EXPECT_THAT(selected, testing::IsOk());
}

TEST_F(FramePipelineTest, DamagedBlockIsDataLossThatSaysWhereAndNeverAPicture) {
  Open(2);
  const std::string path = dataset_->shard_directory(1) + "/" + store::kBlocksFileName;
  const auto size = static_cast<std::int64_t>(std::filesystem::file_size(path));
  // Blocks of the gyroid are active almost everywhere; count the places that hit an active one.
  int failures = 0;
  for (int part = 0; part < 8; ++part) {
    const std::int64_t offset = size * part / 8 + 100;
    FlipBit(path, offset);
    ForgetAll();
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards_, task_));
    const auto image = pipeline->RenderAll();
    FlipBit(path, offset);
    if (image.ok()) {
      continue;  // an inactive block: not read
    }
    ++failures;
    EXPECT_THAT(image,
                StatusIs(absl::StatusCode::kDataLoss,
                         AllOf(HasSubstr("dataset gyroid"), HasSubstr("shard 1 of 2"),
                               HasSubstr("block "), HasSubstr("at offset "), HasSubstr(path))));
  }
  EXPECT_GT(failures, 0);

  // In the steps of a culled frame too, even if only one block in use is damaged.
  for (std::int64_t offset = 100; offset < size; offset += 400) {
    FlipBit(path, offset);
  }
  ForgetAll();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards_, task_));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection selection, pipeline->SelectOccluders());
  EXPECT_THAT(pipeline->RenderOccluders(selection.active),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("shard 1 of 2")));
  const auto visible = MakeSelected();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage none, visible->RenderOccluders({}));
  EXPECT_TRUE(none == EmptyImage(task_));
  EXPECT_THAT(visible->RenderVisible(selection.active, ""),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("shard 1 of 2")));
}

TEST_F(FramePipelineTest, CancelledFrameStopsInEachStep) {
  Open(2);
  for (int step = 0; step < 4; ++step) {
    SCOPED_TRACE(step);
    base::Cancellation cancellation;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards_, task_, &cancellation));
    RaySelection selection;
    if (step == 1 || step == 2) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(selection, pipeline->SelectOccluders());
    }
    if (step == 2) {
      ISOSCOPE_ASSERT_OK(pipeline->RenderOccluders({}));
    }
    cancellation.Cancel();
    const absl::Status status = step == 0   ? pipeline->SelectOccluders().status()
                                : step == 1 ? pipeline->RenderOccluders(selection.active).status()
                                : step == 2 ? pipeline->RenderVisible(selection.active, "").status()
                                            : pipeline->RenderAll().status();
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kCancelled));
    EXPECT_EQ(pipeline->statistics().triangle_count, 0);
  }
  const base::Cancellation late(base::MonotonicNow() - absl::Seconds(1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards_, task_, &late));
  EXPECT_THAT(pipeline->SelectOccluders(), StatusIs(absl::StatusCode::kDeadlineExceeded));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto all, Make(shards_, task_, &late));
  EXPECT_THAT(all->RenderAll(), StatusIs(absl::StatusCode::kDeadlineExceeded));
}

// Stops the frame while its first block is drawn.
class CancellingRenderer final : public render::Renderer {
 public:
  CancellingRenderer(render::Renderer* renderer, base::Cancellation* cancellation)
      : renderer_(renderer), cancellation_(cancellation) {}
  absl::StatusOr<std::unique_ptr<render::RenderPass>> BeginPass(
      const view::View& view, const volume::BlockLayout& layout,
      const frame::FrameSpec& spec) override {
    auto pass = renderer_->BeginPass(view, layout, spec);
    if (!pass.ok()) {
      return pass.status();
    }
    return std::make_unique<Pass>(*std::move(pass), cancellation_);
  }
  [[nodiscard]] frame::PictureRevision picture_revision() const override {
    return renderer_->picture_revision();
  }
  [[nodiscard]] std::string description() const override { return renderer_->description(); }

 private:
  class Pass final : public render::RenderPass {
   public:
    Pass(std::unique_ptr<render::RenderPass> pass, base::Cancellation* cancellation)
        : pass_(std::move(pass)), cancellation_(cancellation) {}
    absl::Status Add(std::span<const render::MeshToDraw> meshes) override {
      cancellation_->Cancel();
      return pass_->Add(meshes);
    }
    [[nodiscard]] bool is_full() const override { return pass_->is_full(); }
    absl::Status Shade(const base::Cancellation& cancellation) override {
      return pass_->Shade(cancellation);
    }
    absl::StatusOr<image::FrameImage> Finish(const base::Cancellation& cancellation) override {
      ADD_FAILURE() << "a cancelled frame was drawn to its end";
      return pass_->Finish(cancellation);
    }

   private:
    std::unique_ptr<render::RenderPass> pass_;
    base::Cancellation* const cancellation_;
  };

  render::Renderer* const renderer_;
  base::Cancellation* const cancellation_;
};

TEST_F(FramePipelineTest, CancellationInTheMiddleOfDrawingStopsIt) {
  Open(1);
  base::Cancellation cancellation;
  CancellingRenderer renderer(renderer_.get(), &cancellation);
  AgentResources resources = Resources();
  resources.renderer = &renderer;
  // From the disk, and from what that run may have left in the cache.
  for (int run = 0; run < 2; ++run) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto pipeline,
        FramePipeline::Make(shards_, dataset_->Request(), resources, &cancellation));
    EXPECT_THAT(pipeline->RenderAll(), StatusIs(absl::StatusCode::kCancelled));
  }
}

TEST_F(FramePipelineTest, PictureDoesNotDependOnTheReadsUnderWay) {
  Open(2);
  std::vector<image::FrameImage> images;
  for (const std::size_t max_read_bytes : {AgentResources().max_read_bytes, std::size_t{1}}) {
    AgentResources resources = Resources();
    resources.max_read_bytes = max_read_bytes;  // 1: one run at a time
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        auto pipeline, FramePipeline::Make(shards_, dataset_->Request(), resources, &never_));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(image::FrameImage image, pipeline->RenderAll());
    EXPECT_GT(pipeline->statistics().read_bytes, 0);
    images.push_back(std::move(image));
    pipeline.reset();
    ForgetAll();
  }
  EXPECT_TRUE(images[0] == images[1]);
}

TEST_F(FramePipelineTest, BadRequestIsRefused) {
  Open(1);
  task_.spec.viewport.width_px = 0;
  EXPECT_THAT(Make(shards_, task_), StatusIs(absl::StatusCode::kInvalidArgument));
  task_ = dataset_->Request();
  task_.spec.camera->eye = task_.spec.camera->target;
  EXPECT_THAT(Make(shards_, task_), StatusIs(absl::StatusCode::kInvalidArgument));
  task_.spec.camera.reset();
  EXPECT_THAT(Make(shards_, task_),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("camera")));
  task_ = dataset_->Request();
  task_.spec.caps = frame::ClipCaps{.map = frame::ColorMap::kViridis};
  EXPECT_THAT(Make(shards_, task_),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("range")));
  task_.spec.caps->range = frame::ColorRange{0, 1};
  ISOSCOPE_EXPECT_OK(Make(shards_, task_));
}

// Planes show the same surfaces without colours: their frames name no samples of other fields.
TEST_F(FramePipelineTest, AFieldIsReadIfPixelsCarryStepsAndOnlyThen) {
  Open(2);
  task_.spec.surfaces[0].color_by = frame::ColorBy{
      .quantity = frame::ColorBy::Quantity::kField,
      .range = frame::ColorRange{SmallDataset::kIsovalue - 10.5, SmallDataset::kIsovalue + 245.5}};
  task_.spec.sends_normals = true;
  ISOSCOPE_EXPECT_OK(Make(shards_, task_));
  task_.spec.sends_map_steps = true;
  EXPECT_THAT(Make(shards_, task_), StatusIs(absl::StatusCode::kInvalidArgument,
                                             HasSubstr("surface 0 shows another field")));
  EXPECT_THAT(Make(shards_, task_, nullptr, {{}}), StatusIs(absl::StatusCode::kInvalidArgument));
  // The field that is drawn has the isovalue at every vertex.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards_, task_, nullptr, {shards_}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image, pipeline->RenderAll());
  int count = 0;
  for (std::size_t i = 0; i < image.keys.size(); ++i) {
    if (image.keys[i] != image::kBackgroundKey) {
      ++count;
      ASSERT_TRUE(image::HasStep(image.colors[i])) << i;
      ASSERT_EQ(image::StepOf(image.colors[i]), 10) << i;
    }
  }
  EXPECT_GT(count, 1000);
}

TEST_F(FramePipelineTest, IsovalueOutsideTheDataGivesAnEmptyPicture) {
  Open(2);
  task_.spec.surfaces[0].rule.isovalue = 1000;
  Frame frame;
  RunAlone(task_, &frame);
  EXPECT_TRUE(frame.selection.hits.empty());
  EXPECT_EQ(frame.statistics.active_block_count, 0);
  EXPECT_TRUE(frame.image == EmptyImage(task_));
}

// The bands of a picture share blocks, and these count once.
TEST_F(FramePipelineTest, MeshesThatABandBeforeHasCountedAreDrawnAndNotCounted) {
  for (const bool has_layers : {false, true}) {
    Open(2);
    task_.spec.surfaces.push_back(task_.spec.surfaces[0]);
    task_.spec.surfaces[1].rule.isovalue += 25;
    task_.spec.surfaces[1].opacity = has_layers ? 0.5F : 1;
    Frame alone;
    RunAlone(task_, &alone);
    const std::vector<frame::SurfaceStatistics> all = alone.statistics.surfaces;
    ASSERT_EQ(all.size(), 2U);
    ASSERT_GT(all[0].triangle_count, 0);
    ASSERT_GT(all[1].triangle_count, 0);
    // Those of step 3 have translucent meshes; with layers, they include those of step 2.
    std::vector<volume::BlockId> opaque;
    std::set_union(alone.occluding_blocks.begin(), alone.occluding_blocks.end(),
                   alone.visible_blocks.begin(), alone.visible_blocks.end(),
                   std::back_inserter(opaque));
    const auto count = [&](std::vector<volume::BlockId> of_opaque,
                           std::vector<volume::BlockId> of_layers) {
      FrameTask task = task_;
      task.counted_blocks = std::move(of_opaque);
      task.counted_layer_blocks = std::move(of_layers);
      Frame frame;
      RunAlone(task, &frame);
      EXPECT_TRUE(frame.image == alone.image);
      EXPECT_EQ(frame.statistics.visible_block_count, alone.statistics.visible_block_count);
      return frame.statistics;
    };
    EXPECT_EQ(count(opaque, opaque).triangle_count, 0);
    EXPECT_EQ(count(opaque, opaque).unique_vertex_count, 0);
    const frame::AgentStatistics only_layers = count(opaque, {});
    EXPECT_EQ(only_layers.surfaces[0].triangle_count, 0);
    EXPECT_EQ(only_layers.surfaces[1].triangle_count, has_layers ? all[1].triangle_count : 0);
    const frame::AgentStatistics only_opaque = count({}, opaque);
    EXPECT_EQ(only_opaque.surfaces[0], all[0]);
    EXPECT_EQ(only_opaque.surfaces[1].triangle_count, has_layers ? 0 : all[1].triangle_count);
    // Two bands that have counted one half each.
    std::vector<volume::BlockId> even;
    std::vector<volume::BlockId> odd;
    std::partition_copy(opaque.begin(), opaque.end(), std::back_inserter(even),
                        std::back_inserter(odd), [](volume::BlockId id) { return id % 2 == 0; });
    const frame::AgentStatistics of_odd = count(even, even);
    const frame::AgentStatistics of_even = count(odd, odd);
    EXPECT_GT(of_odd.triangle_count, 0);
    EXPECT_EQ(of_odd.triangle_count + of_even.triangle_count, alone.statistics.triangle_count);
    EXPECT_EQ(of_odd.unique_vertex_count + of_even.unique_vertex_count,
              alone.statistics.unique_vertex_count);
  }
}

// A frame of several surfaces is the composite of frames of each, and reads a block once.
TEST_F(FramePipelineTest, SeveralSurfacesAreTheCompositeOfEach) {
  Open(2);
  const std::vector<double> isovalues{SmallDataset::kIsovalue, SmallDataset::kIsovalue + 25,
                                      SmallDataset::kIsovalue - 25};
  const auto block_count = static_cast<std::uint32_t>(dataset_->layout().block_count());
  const image::FragmentOrder order{.block_count = block_count, .ties = image::TieRule::kColor};
  task_.spec.surfaces.clear();
  image::FrameImage expected = EmptyImage(task_);
  frame::AgentStatistics sum;
  std::set<volume::BlockId> active;
  for (std::uint32_t i = 0; i < isovalues.size(); ++i) {
    FrameTask alone = dataset_->Request();
    alone.spec.surfaces[0].rule.isovalue = isovalues[i];
    alone.spec.surfaces[0].appearance.base_color = {static_cast<std::uint8_t>(80 + 60 * i), 90, 70,
                                                    255};
    task_.spec.surfaces.push_back(alone.spec.surfaces[0]);
    ForgetAll();
    frame::AgentStatistics statistics;
    image::FrameImage image = RenderAll(shards_, alone, &statistics);
    for (std::uint64_t& key : image.keys) {
      if (key != image::kBackgroundKey) {
        key = image::FragmentKey(image::DepthOf(key), order.OwnerOf(i, image::OwnerOf(key)));
      }
    }
    composite::CompositeInto(image, order, &expected);
    sum.triangle_count += statistics.triangle_count;
    sum.unique_vertex_count += statistics.unique_vertex_count;
    sum.read_bytes = std::max(sum.read_bytes, statistics.read_bytes);
    for (const volume::BlockId id : shards_[0]->reader->ranges().ActiveBlocks(isovalues[i]).Ids()) {
      active.insert(id);
    }
  }
  ForgetAll();
  frame::AgentStatistics statistics;
  EXPECT_TRUE(RenderAll(shards_, task_, &statistics) == expected);
  EXPECT_EQ(statistics.triangle_count, sum.triangle_count);
  EXPECT_EQ(statistics.unique_vertex_count, sum.unique_vertex_count);
  EXPECT_EQ(statistics.active_block_count, static_cast<std::int64_t>(active.size()));
  EXPECT_EQ(statistics.visible_block_count, static_cast<std::int64_t>(active.size()));
  // The steps with culling give the same picture.
  Frame frame;
  task_.spec.culling = frame::Culling::kDepth;
  RunAlone(task_, &frame);
  EXPECT_TRUE(frame.image == expected);
}

TEST_F(FramePipelineTest, BlocksThatAreWhollyClippedAreNeitherReadNorDrawn) {
  Open(1);
  task_.report_active_blocks = true;
  frame::AgentStatistics whole;
  RenderAll(shards_, task_, &whole);
  const math::Box3d bounds = dataset_->geometry().Bounds();
  task_.spec.clip.half_spaces = {{{1, 0, 0}, bounds.min.x + 0.75 * (bounds.max.x - bounds.min.x)}};
  const view::Clipper clipper(task_.spec.clip, dataset_->geometry());
  std::vector<volume::BlockId> shown;
  const std::vector<volume::BlockId> active =
      shards_[0]->reader->ranges().ActiveBlocks(SmallDataset::kIsovalue).Ids();
  for (const volume::BlockId id : active) {
    if (clipper.SideOf(dataset_->layout(), id) != view::Clipper::Side::kOutside) {
      shown.push_back(id);
    }
  }
  ASSERT_GT(shown.size(), 0U);
  ASSERT_LT(shown.size(), active.size() / 2);
  ForgetAll();
  frame::AgentStatistics clipped;
  RenderAll(shards_, task_, &clipped);
  EXPECT_EQ(clipped.active_block_count, static_cast<std::int64_t>(shown.size()));
  EXPECT_EQ(clipped.visible_block_count, static_cast<std::int64_t>(shown.size()));
  EXPECT_LT(clipped.read_bytes, whole.read_bytes * 3 / 4);
  // The coordinator keeps the active blocks for frames with another region.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards_, task_));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection selection, pipeline->SelectOccluders());
  EXPECT_EQ(selection.active, active);
  std::vector<volume::BlockId> outside;
  std::set_difference(active.begin(), active.end(), shown.begin(), shown.end(),
                      std::back_inserter(outside));
  EXPECT_THAT(pipeline->RenderOccluders({outside.front()}),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST_F(FramePipelineTest, AStepOutOfOrderEndsTheProcess) {
  Open(1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards_, dataset_->Request()));
  EXPECT_DEATH(pipeline->RenderOccluders({}).IgnoreError(), "next_step_");
  EXPECT_DEATH(pipeline->RenderVisible({}, "").IgnoreError(), "next_step_");
}

}  // namespace
}  // namespace isoscope::agent
