#include "partition-agent/frame_pipeline.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <iterator>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/composite/depth_composite.h"
#include "core/render/renderer_factory.h"
#include "core/view/view.h"
#include "core/visibility/occluder_selection.h"
#include "core/visibility/occlusion_map.h"
#include "core/visibility/open_pixels.h"
#include "tests/support/reference_extractor.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/frame_pipeline_fixture.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using isoscope::testing::FlipBit;
using isoscope::testing::SmallDataset;
using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

TEST_F(FramePipelineTest, RenderAllDrawsEveryTriangleOfTheReference) {
  const SmallDataset dataset(3);
  const auto reference = isoscope::testing::ReferenceExtractor(
                             dataset.geometry(), volume::ScalarType::kUint8, dataset.samples())
                             .Extract(SmallDataset::kIsovalue);
  std::int64_t triangles = 0;
  std::int64_t vertices = 0;
  std::int64_t blocks = 0;
  for (const auto& shard : dataset.OpenShards()) {
    frame::AgentStatistics statistics;
    RenderAll({shard}, dataset.Request(), &statistics);
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
  const auto shards = dataset.OpenShards();
  EXPECT_EQ(blocks, shards.front()->reader->ranges().ActiveBlocks(SmallDataset::kIsovalue).Count());
}

TEST_F(FramePipelineTest, StatisticsAddUp) {
  const SmallDataset dataset(1);
  const Shards shards = dataset.OpenShards();
  const FrameTask request = dataset.Request();
  Frame frame;
  RunAlone(shards, request, dataset, &frame);

  // Counted again from the definitions.
  const view::View view =
      *view::View::Make(*request.spec.camera, request.spec.viewport, dataset.geometry());
  const store::ShardReader& reader = *shards.front()->reader;
  const volume::BlockSet active = reader.ranges().ActiveBlocks(request.spec.surfaces[0].isovalue);
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
  const SmallDataset dataset(1);
  const FrameTask request = dataset.Request();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(dataset.OpenShards(), request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image, pipeline->RenderAll());
  const absl::Duration before = pipeline->statistics().busy_duration;
  ASSERT_FALSE(pipeline->Encode(image).empty());
  EXPECT_GT(pipeline->statistics().busy_duration, before);
}

TEST_F(FramePipelineTest, CulledPictureIsThatOfAllBlocks) {
  const SmallDataset dataset(2);
  const Shards shards = dataset.OpenShards();
  const FrameTask request = dataset.Request();
  Frame frame;
  RunAlone(shards, request, dataset, &frame);
  frame::AgentStatistics all;
  EXPECT_TRUE(frame.image == RenderAll(shards, request, &all));
  EXPECT_LT(frame.statistics.triangle_count, all.triangle_count);
}

TEST_F(FramePipelineTest, HitsOfThreeAgentsAreThoseOfOne) {
  const SmallDataset dataset(3);
  const Shards shards = dataset.OpenShards();
  FrameTask request = dataset.Request();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto alone, Make(shards, request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection of_one, alone->SelectOccluders());
  const std::vector<volume::BlockId>& expected = of_one.hits;
  ASSERT_FALSE(expected.empty());
  EXPECT_TRUE(std::is_sorted(expected.begin(), expected.end()));
  volume::BlockSet hits(dataset.layout().block_count());
  std::vector<volume::BlockId> active;
  for (int i = 0; i < 3; ++i) {
    request.agent_index = i;
    request.agent_count = 3;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline,
                                  Make({shards[static_cast<std::size_t>(i)]}, request));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection own, pipeline->SelectOccluders());
    EXPECT_LT(own.hits.size(), expected.size()) << "agent " << i << " casts the others' rays too";
    hits.InsertAll(own.hits);
    EXPECT_TRUE(std::is_sorted(own.active.begin(), own.active.end()));
    active.insert(active.end(), own.active.begin(), own.active.end());
  }
  EXPECT_EQ(hits.Ids(), expected);
  // Each active block is reported by its own agent and by no other.
  std::sort(active.begin(), active.end());
  EXPECT_EQ(active, of_one.active);
}

TEST_F(FramePipelineTest, ActiveBlocksAreReportedOnlyIfAskedFor) {
  const SmallDataset dataset(1);
  FrameTask request = dataset.Request();
  request.report_active_blocks = false;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(dataset.OpenShards(), request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection selection, pipeline->SelectOccluders());
  EXPECT_FALSE(selection.hits.empty());
  EXPECT_TRUE(selection.active.empty());
}

TEST_F(FramePipelineTest, BlocksThatAreNotItsOwnActiveOnesAreRefused) {
  const SmallDataset dataset(2);
  const Shards shards = dataset.OpenShards();
  FrameTask request = dataset.Request();
  request.spec.surfaces[0].isovalue = 230;  // near the largest: not all blocks are active
  const volume::BlockId block_count = static_cast<volume::BlockId>(dataset.layout().block_count());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto own, Make({shards[0]}, request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection selection, own->SelectOccluders());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto others, Make({shards[1]}, request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection other_selection, others->SelectOccluders());
  const volume::BlockSet active =
      shards[0]->reader->ranges().ActiveBlocks(request.spec.surfaces[0].isovalue);
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
  const volume::BlockId of_another = other_selection.active[other_selection.active.size() / 2];
  for (const std::vector<volume::BlockId>& blocks :
       {with(of_another), with(inactive), std::vector<volume::BlockId>{of_another},
        with(block_count), with(selection.active.front())}) {
    const auto is_refused = StatusIs(absl::StatusCode::kInvalidArgument,
                                     HasSubstr("1 of " + absl::StrCat(blocks.size())));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, Make({shards[0]}, request));
    ISOSCOPE_ASSERT_OK(second->SelectOccluders());
    EXPECT_THAT(second->RenderOccluders(blocks), is_refused);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto third, Make({shards[0]}, request));
    ISOSCOPE_ASSERT_OK(third->SelectOccluders());
    ISOSCOPE_ASSERT_OK(third->RenderOccluders({}));
    EXPECT_THAT(third->RenderVisible(blocks, ""), is_refused);
  }
}

TEST_F(FramePipelineTest, FragmentsAtClosedPixelsAreDroppedAndNoOthers) {
  const SmallDataset dataset(1);
  const Shards shards = dataset.OpenShards();
  const FrameTask request = dataset.Request();
  const view::View view =
      *view::View::Make(*request.spec.camera, request.spec.viewport, dataset.geometry());
  // Each cell of each block's mask is open or not, as dice decide.
  std::vector<volume::BlockId> blocks;
  std::vector<image::PixelMask> masks;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, Make(shards, request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection selection, first->SelectOccluders());
  for (const volume::BlockId id : selection.active) {
    const view::PixelRect rect = view.FootprintOf(dataset.layout(), id).rect;
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
  image::FrameImage expected(request.spec.viewport.width_px, request.spec.viewport.height_px);
  std::int64_t dropped = 0;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto one, Make(shards, request));
    ISOSCOPE_ASSERT_OK(one->SelectOccluders());
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
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto unmasked, Make(shards, request));
  ISOSCOPE_ASSERT_OK(unmasked->SelectOccluders());
  ISOSCOPE_ASSERT_OK(unmasked->RenderOccluders({}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage all, unmasked->RenderVisible(blocks, ""));
  EXPECT_TRUE(all == RenderAll(shards, request));
}

TEST_F(FramePipelineTest, DamagedOrForeignOpenPixelsAreDataLoss) {
  const SmallDataset dataset(1);
  const Shards shards = dataset.OpenShards();
  const FrameTask request = dataset.Request();
  Frame frame;
  RunAlone(shards, request, dataset, &frame);
  ASSERT_GT(frame.visible_blocks.size(), 1U);
  const std::string open_pixels = VisibleOf(frame, request, dataset).second;
  std::vector<std::string> bad = {"x", std::string(1000, '\xff'), open_pixels + "x"};
  for (std::size_t i = 0; i < open_pixels.size(); i += 1 + open_pixels.size() / 40) {
    bad.push_back(open_pixels);
    bad.back()[i] = static_cast<char>(bad.back()[i] ^ 16);
    if (i > 0) {
      bad.push_back(open_pixels.substr(0, i));
    }
  }
  // Of other blocks: sound, but of other shapes.
  std::vector<volume::BlockId> fewer = frame.visible_blocks;
  fewer.pop_back();
  for (std::size_t i = 0; i <= bad.size(); ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards, request));
    ISOSCOPE_ASSERT_OK(pipeline->SelectOccluders());
    ISOSCOPE_ASSERT_OK(pipeline->RenderOccluders({}));
    EXPECT_THAT(i < bad.size() ? pipeline->RenderVisible(frame.visible_blocks, bad[i])
                               : pipeline->RenderVisible(fewer, open_pixels),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("open pixels")))
        << i;
  }
}

TEST_F(FramePipelineTest, TwoShardsInOnePipelineGiveThePictureOfTwoPipelines) {
  const SmallDataset dataset(2);
  const Shards shards = dataset.OpenShards();
  const FrameTask request = dataset.Request();
  frame::AgentStatistics both;
  const image::FrameImage expected = RenderAll(shards, request, &both);
  frame::AgentStatistics first;
  frame::AgentStatistics second;
  image::FrameImage image = RenderAll({shards[0]}, request, &first);
  EXPECT_FALSE(image == expected) << "the second shard shows nothing";
  composite::CompositeInto(RenderAll({shards[1]}, request, &second), kOrder, &image);
  EXPECT_TRUE(image == expected);
  EXPECT_EQ(both.triangle_count, first.triangle_count + second.triangle_count);
  EXPECT_EQ(both.unique_vertex_count, first.unique_vertex_count + second.unique_vertex_count);
  EXPECT_EQ(both.active_block_count, first.active_block_count + second.active_block_count);
}

// Symptom: with three threads or more and a memory limit the program aborted, "Resource deadlock
// avoided". Shading ran a parallel loop under a lock, inside of the loops that deliver meshes.
TEST_F(FramePipelineTest, NeitherThreadCountNorMemoryLimitShows) {
  const SmallDataset dataset(2);
  const Shards shards = dataset.OpenShards();
  FrameTask request = dataset.Request();
  // Many tiles are shaded side by side, while other threads draw.
  request.spec.viewport = {240, 180};
  Use({.thread_count = 1});
  Frame expected;
  RunAlone(shards, request, dataset, &expected);
  for (const int thread_count : testing::kThreadCounts) {
    // Of these, the first two make the renderer shade early.
    for (const std::size_t memory_limit_bytes :
         {testing::kLeastMemoryLimitBytes, std::size_t{1} << 20, testing::Limits::kNoMemoryLimit}) {
      Use({.thread_count = thread_count, .memory_limit_bytes = memory_limit_bytes});
      ForgetAll();
      // From kept meshes, threads draw small tasks side by side.
      for (int i = 0; i < 4; ++i) {
        Frame frame;
        RunAlone(shards, request, dataset, &frame);
        ExpectSameWork(frame, expected);
      }
    }
  }
}

TEST_F(FramePipelineTest, DamagedBlockIsDataLossThatSaysWhereAndNeverAPicture) {
  const SmallDataset dataset(2);
  const std::string path = dataset.shard_directory(1) + "/" + store::kBlocksFileName;
  const auto size = static_cast<std::int64_t>(std::filesystem::file_size(path));
  const Shards shards = dataset.OpenShards();
  const FrameTask request = dataset.Request();
  // Blocks of the gyroid are active almost everywhere; count the places that hit an active one.
  int failures = 0;
  for (int part = 0; part < 8; ++part) {
    const std::int64_t offset = size * part / 8 + 100;
    FlipBit(path, offset);
    ForgetAll();
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards, request));
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
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards, request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection selection, pipeline->SelectOccluders());
  EXPECT_THAT(pipeline->RenderOccluders(selection.active),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("shard 1 of 2")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto visible, Make(shards, request));
  ISOSCOPE_ASSERT_OK(visible->SelectOccluders());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage none, visible->RenderOccluders({}));
  EXPECT_TRUE(none ==
              image::FrameImage(request.spec.viewport.width_px, request.spec.viewport.height_px));
  EXPECT_THAT(visible->RenderVisible(selection.active, ""),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("shard 1 of 2")));
}

TEST_F(FramePipelineTest, CancelledFrameStopsInEachStep) {
  const SmallDataset dataset(2);
  const Shards shards = dataset.OpenShards();
  const FrameTask request = dataset.Request();
  for (int step = 0; step < 4; ++step) {
    SCOPED_TRACE(step);
    base::Cancellation cancellation;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards, request, &cancellation));
    const auto is_cancelled = StatusIs(absl::StatusCode::kCancelled);
    if (step == 3) {
      cancellation.Cancel();
      EXPECT_THAT(pipeline->RenderAll(), is_cancelled);
      EXPECT_EQ(pipeline->statistics().triangle_count, 0);
      continue;
    }
    if (step == 0) {
      cancellation.Cancel();
      EXPECT_THAT(pipeline->SelectOccluders(), is_cancelled);
      continue;
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection selection, pipeline->SelectOccluders());
    if (step == 1) {
      cancellation.Cancel();
      EXPECT_THAT(pipeline->RenderOccluders(selection.active), is_cancelled);
      continue;
    }
    ISOSCOPE_ASSERT_OK(pipeline->RenderOccluders({}));
    cancellation.Cancel();
    EXPECT_THAT(pipeline->RenderVisible(selection.active, ""), is_cancelled);
  }
  const base::Cancellation late(absl::Now() - absl::Seconds(1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards, request, &late));
  EXPECT_THAT(pipeline->SelectOccluders(), StatusIs(absl::StatusCode::kDeadlineExceeded));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto all, Make(shards, request, &late));
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
  const SmallDataset dataset(1);
  base::Cancellation cancellation;
  CancellingRenderer renderer(renderer_.get(), &cancellation);
  AgentResources resources = Resources();
  resources.renderer = &renderer;
  // From the disk, and from what that run may have left in the cache.
  for (int run = 0; run < 2; ++run) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto pipeline,
        FramePipeline::Make(dataset.OpenShards(), dataset.Request(), resources, &cancellation));
    EXPECT_THAT(pipeline->RenderAll(), StatusIs(absl::StatusCode::kCancelled));
  }
}

TEST_F(FramePipelineTest, PictureDoesNotDependOnTheReadsUnderWay) {
  const SmallDataset dataset(2);
  std::vector<image::FrameImage> images;
  for (const std::size_t max_read_bytes : {AgentResources().max_read_bytes, std::size_t{1}}) {
    AgentResources resources = Resources();
    resources.max_read_bytes = max_read_bytes;  // 1: one run at a time
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        auto pipeline,
        FramePipeline::Make(dataset.OpenShards(), dataset.Request(), resources, &never_));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(image::FrameImage image, pipeline->RenderAll());
    EXPECT_GT(pipeline->statistics().read_bytes, 0);
    images.push_back(std::move(image));
    pipeline.reset();
    ForgetAll();
  }
  EXPECT_TRUE(images[0] == images[1]);
}

TEST_F(FramePipelineTest, BadRequestIsRefused) {
  const SmallDataset dataset(1);
  const Shards shards = dataset.OpenShards();
  FrameTask request = dataset.Request();
  request.spec.viewport.width_px = 0;
  EXPECT_THAT(Make(shards, request), StatusIs(absl::StatusCode::kInvalidArgument));
  request = dataset.Request();
  request.spec.camera->eye = request.spec.camera->target;
  EXPECT_THAT(Make(shards, request), StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST_F(FramePipelineTest, IsovalueOutsideTheDataGivesAnEmptyPicture) {
  const SmallDataset dataset(2);
  FrameTask request = dataset.Request();
  request.spec.surfaces[0].isovalue = 1000;
  Frame frame;
  RunAlone(dataset.OpenShards(), request, dataset, &frame);
  EXPECT_TRUE(frame.selection.hits.empty());
  EXPECT_EQ(frame.statistics.active_block_count, 0);
  EXPECT_TRUE(frame.image ==
              image::FrameImage(request.spec.viewport.width_px, request.spec.viewport.height_px));
}

// A frame of several surfaces is the composite of frames of each, and reads a block once.
TEST_F(FramePipelineTest, SeveralSurfacesAreTheCompositeOfEach) {
  const SmallDataset dataset{2};
  const Shards shards = dataset.OpenShards();
  const std::vector<double> isovalues{SmallDataset::kIsovalue, SmallDataset::kIsovalue + 25,
                                      SmallDataset::kIsovalue - 25};
  const auto block_count = static_cast<std::uint32_t>(dataset.layout().block_count());
  const image::FragmentOrder order{.block_count = block_count, .ties = image::TieRule::kColor};
  FrameTask task = dataset.Request();
  task.spec.surfaces.clear();
  image::FrameImage expected(task.spec.viewport.width_px, task.spec.viewport.height_px);
  frame::AgentStatistics sum;
  std::set<volume::BlockId> active;
  for (std::uint32_t i = 0; i < isovalues.size(); ++i) {
    FrameTask alone = dataset.Request();
    alone.spec.surfaces[0].isovalue = isovalues[i];
    alone.spec.surfaces[0].appearance.base_color = {static_cast<std::uint8_t>(80 + 60 * i), 90, 70,
                                                    255};
    task.spec.surfaces.push_back(alone.spec.surfaces[0]);
    ForgetAll();
    frame::AgentStatistics statistics;
    image::FrameImage image = RenderAll(shards, alone, &statistics);
    for (std::uint64_t& key : image.keys) {
      if (key != image::kBackgroundKey) {
        key = image::FragmentKey(image::DepthOf(key), order.OwnerOf(i, image::OwnerOf(key)));
      }
    }
    composite::CompositeInto(image, order, &expected);
    sum.triangle_count += statistics.triangle_count;
    sum.unique_vertex_count += statistics.unique_vertex_count;
    sum.read_bytes = std::max(sum.read_bytes, statistics.read_bytes);
    for (const volume::BlockId id : shards[0]->reader->ranges().ActiveBlocks(isovalues[i]).Ids()) {
      active.insert(id);
    }
  }
  ForgetAll();
  frame::AgentStatistics statistics;
  EXPECT_TRUE(RenderAll(shards, task, &statistics) == expected);
  EXPECT_EQ(statistics.triangle_count, sum.triangle_count);
  EXPECT_EQ(statistics.unique_vertex_count, sum.unique_vertex_count);
  EXPECT_EQ(statistics.active_block_count, static_cast<std::int64_t>(active.size()));
  EXPECT_EQ(statistics.visible_block_count, static_cast<std::int64_t>(active.size()));
  // The steps with culling give the same picture.
  Frame frame;
  task.spec.culling = frame::Culling::kDepth;
  RunAlone(shards, task, dataset, &frame);
  EXPECT_TRUE(frame.image == expected);
}

TEST_F(FramePipelineTest, BlocksThatAreWhollyClippedAreNeitherReadNorDrawn) {
  const SmallDataset dataset{1};
  const Shards shards = dataset.OpenShards();
  FrameTask task = dataset.Request();
  task.report_active_blocks = true;
  frame::AgentStatistics whole;
  RenderAll(shards, task, &whole);
  const math::Box3d bounds = dataset.geometry().Bounds();
  task.spec.clip.half_spaces = {{{1, 0, 0}, bounds.min.x + 0.75 * (bounds.max.x - bounds.min.x)}};
  const view::Clipper clipper(task.spec.clip, dataset.geometry());
  std::vector<volume::BlockId> shown;
  const std::vector<volume::BlockId> active =
      shards[0]->reader->ranges().ActiveBlocks(SmallDataset::kIsovalue).Ids();
  for (const volume::BlockId id : active) {
    if (clipper.SideOf(dataset.layout(), id) != view::Clipper::Side::kOutside) {
      shown.push_back(id);
    }
  }
  ASSERT_GT(shown.size(), 0U);
  ASSERT_LT(shown.size(), active.size() / 2);
  ForgetAll();
  frame::AgentStatistics clipped;
  RenderAll(shards, task, &clipped);
  EXPECT_EQ(clipped.active_block_count, static_cast<std::int64_t>(shown.size()));
  EXPECT_EQ(clipped.visible_block_count, static_cast<std::int64_t>(shown.size()));
  EXPECT_LT(clipped.read_bytes, whole.read_bytes * 3 / 4);
  // The coordinator keeps the active blocks for frames with another region.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards, task));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection selection, pipeline->SelectOccluders());
  EXPECT_EQ(selection.active, active);
  std::vector<volume::BlockId> outside;
  std::set_difference(active.begin(), active.end(), shown.begin(), shown.end(),
                      std::back_inserter(outside));
  EXPECT_THAT(pipeline->RenderOccluders({outside.front()}),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST_F(FramePipelineTest, AFrameWithoutACameraIsRefused) {
  const SmallDataset dataset{1};
  FrameTask task = dataset.Request();
  task.spec.camera.reset();
  EXPECT_THAT(Make(dataset.OpenShards(), task),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("camera")));
}

TEST_F(FramePipelineTest, AStepOutOfOrderEndsTheProcess) {
  const SmallDataset dataset{1};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(dataset.OpenShards(), dataset.Request()));
  EXPECT_DEATH(pipeline->RenderOccluders({}).IgnoreError(), "next_step_");
  EXPECT_DEATH(pipeline->RenderVisible({}, "").IgnoreError(), "next_step_");
}

}  // namespace
}  // namespace isoscope::agent
