#include "partition-agent/frame_pipeline.h"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/time/clock.h"
#include "gtest/gtest.h"

#include "core/composite/depth_composite.h"
#include "core/render/renderer_factory.h"
#include "core/view/view.h"
#include "core/visibility/occluder_selection.h"
#include "tests/support/reference_extractor.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using isoscope::testing::FlipBit;
using isoscope::testing::SmallDataset;
using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;
using Shards = std::vector<std::shared_ptr<const Shard>>;

// One whole frame of one agent: both images composited, and what it took.
struct Frame {
  std::vector<volume::BlockId> hits;
  image::FrameImage occluders;
  image::FrameImage image;
  AgentStatistics after_selection;
  AgentStatistics statistics;
};

class FramePipelineTest : public ::testing::Test {
 protected:
  void SetUp() override {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(renderer_,
                                  render::MakeRenderer({.kind = render::RendererKind::kCpu}));
  }

  absl::StatusOr<std::unique_ptr<FramePipeline>> Make(
      const Shards& shards, const FrameRequest& request,
      const base::Cancellation* cancellation = nullptr) {
    return FramePipeline::Make(shards, request, renderer_.get(), arena_.get(),
                               cancellation == nullptr ? &never_ : cancellation);
  }

  // The map that a coordinator makes of the occluders.
  static visibility::OcclusionMap MapOf(const image::FrameImage& occluders,
                                        const FrameRequest& request, const SmallDataset& dataset) {
    const view::View view = *view::View::Make(request.camera, request.viewport, dataset.geometry());
    return visibility::OcclusionMap::FromImage(occluders, visibility::DepthQuantizer(view),
                                               visibility::MapKind::kDepth, 0);
  }

  void RunAlone(const Shards& shards, const FrameRequest& request, const SmallDataset& dataset,
                Frame* frame) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards, request));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame->hits, pipeline->SelectOccluders());
    frame->after_selection = pipeline->statistics();
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(frame->occluders, pipeline->RenderOccluders(frame->hits));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        frame->image, pipeline->RenderVisible(MapOf(frame->occluders, request, dataset)));
    composite::CompositeInto(frame->occluders, &frame->image);
    frame->statistics = pipeline->statistics();
  }

  image::FrameImage RenderAll(const Shards& shards, const FrameRequest& request,
                              AgentStatistics* statistics = nullptr) {
    const auto pipeline = Make(shards, request);
    EXPECT_THAT(pipeline, isoscope::testing::IsOk());
    auto image = (*pipeline)->RenderAll();
    EXPECT_THAT(image, isoscope::testing::IsOk());
    if (statistics != nullptr) {
      *statistics = (*pipeline)->statistics();
    }
    return *std::move(image);
  }

  std::unique_ptr<render::Renderer> renderer_;
  std::unique_ptr<tbb::task_arena> arena_ = std::make_unique<tbb::task_arena>(2);
  const base::Cancellation never_;
};

TEST_F(FramePipelineTest, RenderAllDrawsEveryTriangleOfTheReference) {
  const SmallDataset dataset(3);
  const auto reference = isoscope::testing::ReferenceExtractor(
                             dataset.geometry(), volume::ScalarType::kUint8, dataset.samples())
                             .Extract(SmallDataset::kIsovalue);
  std::int64_t triangles = 0;
  std::int64_t vertices = 0;
  std::int64_t blocks = 0;
  for (const auto& shard : dataset.OpenShards()) {
    AgentStatistics statistics;
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
  const FrameRequest request = dataset.Request();
  Frame frame;
  RunAlone(shards, request, dataset, &frame);

  // Counted again from the definitions.
  const view::View view = *view::View::Make(request.camera, request.viewport, dataset.geometry());
  const store::ShardReader& reader = *shards.front()->reader;
  const volume::BlockSet active = reader.ranges().ActiveBlocks(request.isovalue);
  const volume::BlockSet occluding =
      visibility::OccludingBlocks(frame.hits, reader.layout(), active);
  const visibility::OcclusionMap map = MapOf(frame.occluders, request, dataset);
  const visibility::DepthQuantizer quantizer(view);
  std::int64_t visible = 0;
  std::int64_t off_screen = 0;
  std::int64_t hidden = 0;
  for (volume::BlockId id = 0; id < reader.layout().block_count(); ++id) {
    if (!active.Contains(id)) {
      continue;
    }
    const view::Footprint footprint = view.FootprintOf(reader.layout(), id);
    if (footprint.rect.empty()) {
      ++off_screen;
    } else if (!occluding.Contains(id) && map.Hides(footprint, quantizer)) {
      ++hidden;
    } else {
      ++visible;
    }
  }
  // The scene shows all three fates, or the test says nothing.
  EXPECT_GT(visible, 0);
  EXPECT_GT(off_screen, 0);
  EXPECT_GT(hidden, 0);
  EXPECT_EQ(frame.statistics.visible_block_count, visible);
  EXPECT_EQ(frame.statistics.active_block_count, visible + off_screen + hidden);
  EXPECT_EQ(frame.statistics.active_block_count, active.Count());
  EXPECT_EQ(frame.statistics.occluding_block_count, occluding.Count());
  EXPECT_LE(frame.statistics.occluding_block_count, frame.statistics.active_block_count);

  // Selection reads the index alone; drawing reads blocks.
  EXPECT_EQ(frame.after_selection.triangle_count, 0);
  EXPECT_GT(frame.after_selection.index_page_read_count, 0);
  EXPECT_EQ(frame.after_selection.index_page_read_count, frame.statistics.index_page_read_count);
  EXPECT_GT(frame.statistics.read_bytes, frame.after_selection.read_bytes);
  EXPECT_GE(frame.statistics.busy_duration, frame.after_selection.busy_duration);
}

TEST_F(FramePipelineTest, CulledPictureIsThatOfAllBlocks) {
  const SmallDataset dataset(2);
  const Shards shards = dataset.OpenShards();
  const FrameRequest request = dataset.Request();
  Frame frame;
  RunAlone(shards, request, dataset, &frame);
  AgentStatistics all;
  EXPECT_TRUE(frame.image == RenderAll(shards, request, &all));
  EXPECT_LT(frame.statistics.triangle_count, all.triangle_count);
}

TEST_F(FramePipelineTest, HitsOfThreeAgentsAreThoseOfOne) {
  const SmallDataset dataset(3);
  const Shards shards = dataset.OpenShards();
  FrameRequest request = dataset.Request();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto alone, Make(shards, request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto expected, alone->SelectOccluders());
  ASSERT_FALSE(expected.empty());
  EXPECT_TRUE(std::is_sorted(expected.begin(), expected.end()));
  std::vector<volume::BlockId> hits;
  for (int i = 0; i < 3; ++i) {
    request.agent_index = i;
    request.agent_count = 3;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline,
                                  Make({shards[static_cast<std::size_t>(i)]}, request));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto own, pipeline->SelectOccluders());
    EXPECT_LT(own.size(), expected.size()) << "agent " << i << " casts the others' rays too";
    hits = visibility::UnionOfHits(hits, own);
  }
  EXPECT_EQ(hits, expected);
}

TEST_F(FramePipelineTest, TwoShardsInOnePipelineGiveThePictureOfTwoPipelines) {
  const SmallDataset dataset(2);
  const Shards shards = dataset.OpenShards();
  const FrameRequest request = dataset.Request();
  AgentStatistics both;
  const image::FrameImage expected = RenderAll(shards, request, &both);
  AgentStatistics first;
  AgentStatistics second;
  image::FrameImage image = RenderAll({shards[0]}, request, &first);
  EXPECT_FALSE(image == expected) << "the second shard shows nothing";
  composite::CompositeInto(RenderAll({shards[1]}, request, &second), &image);
  EXPECT_TRUE(image == expected);
  EXPECT_EQ(both.triangle_count, first.triangle_count + second.triangle_count);
  EXPECT_EQ(both.unique_vertex_count, first.unique_vertex_count + second.unique_vertex_count);
  EXPECT_EQ(both.active_block_count, first.active_block_count + second.active_block_count);
}

TEST_F(FramePipelineTest, ThreadCountDoesNotShow) {
  const SmallDataset dataset(2);
  const Shards shards = dataset.OpenShards();
  const FrameRequest request = dataset.Request();
  Frame expected;
  for (const int thread_count : {1, 2, 5}) {
    arena_ = std::make_unique<tbb::task_arena>(thread_count);
    Frame frame;
    RunAlone(shards, request, dataset, &frame);
    if (thread_count == 1) {
      expected = std::move(frame);
      continue;
    }
    EXPECT_EQ(frame.hits, expected.hits) << thread_count;
    EXPECT_TRUE(frame.occluders == expected.occluders) << thread_count;
    EXPECT_TRUE(frame.image == expected.image) << thread_count;
    EXPECT_EQ(frame.statistics.triangle_count, expected.statistics.triangle_count);
    EXPECT_EQ(frame.statistics.visible_block_count, expected.statistics.visible_block_count);
  }
}

TEST_F(FramePipelineTest, DamagedBlockIsDataLossThatSaysWhereAndNeverAPicture) {
  const SmallDataset dataset(2);
  const std::string path = dataset.shard_directory(1) + "/" + store::kBlocksFileName;
  const auto size = static_cast<std::int64_t>(std::filesystem::file_size(path));
  const Shards shards = dataset.OpenShards();
  const FrameRequest request = dataset.Request();
  // Blocks of the gyroid are active almost everywhere; count the places that hit an active one.
  int failures = 0;
  for (int part = 0; part < 8; ++part) {
    const std::int64_t offset = size * part / 8 + 100;
    FlipBit(path, offset);
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
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards, request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto hits, pipeline->SelectOccluders());
  EXPECT_THAT(pipeline->RenderOccluders(hits),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("shard 1 of 2")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto visible, Make(shards, request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto again, visible->SelectOccluders());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage none, visible->RenderOccluders({}));
  EXPECT_TRUE(none == image::FrameImage(request.viewport.width_px, request.viewport.height_px));
  EXPECT_THAT(visible->RenderVisible(visibility::OcclusionMap()),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("shard 1 of 2")));
}

TEST_F(FramePipelineTest, CancelledFrameStopsInEachStep) {
  const SmallDataset dataset(2);
  const Shards shards = dataset.OpenShards();
  const FrameRequest request = dataset.Request();
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
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto hits, pipeline->SelectOccluders());
    if (step == 1) {
      cancellation.Cancel();
      EXPECT_THAT(pipeline->RenderOccluders(hits), is_cancelled);
      continue;
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto image, pipeline->RenderOccluders(hits));
    cancellation.Cancel();
    EXPECT_THAT(pipeline->RenderVisible(MapOf(image, request, dataset)), is_cancelled);
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
      const render::Appearance& appearance) override {
    auto pass = renderer_->BeginPass(view, layout, appearance);
    if (!pass.ok()) {
      return pass.status();
    }
    return std::make_unique<Pass>(*std::move(pass), cancellation_);
  }
  [[nodiscard]] std::string description() const override { return renderer_->description(); }

 private:
  class Pass final : public render::RenderPass {
   public:
    Pass(std::unique_ptr<render::RenderPass> pass, base::Cancellation* cancellation)
        : pass_(std::move(pass)), cancellation_(cancellation) {}
    absl::Status Add(std::shared_ptr<const mesh::BlockMesh> mesh) override {
      cancellation_->Cancel();
      return pass_->Add(std::move(mesh));
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
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto pipeline, FramePipeline::Make(dataset.OpenShards(), dataset.Request(), &renderer,
                                               arena_.get(), &cancellation));
  EXPECT_THAT(pipeline->RenderAll(), StatusIs(absl::StatusCode::kCancelled));
}

TEST_F(FramePipelineTest, BadRequestIsRefused) {
  const SmallDataset dataset(1);
  const Shards shards = dataset.OpenShards();
  FrameRequest request = dataset.Request();
  request.viewport.width_px = 0;
  EXPECT_THAT(Make(shards, request), StatusIs(absl::StatusCode::kInvalidArgument));
  request = dataset.Request();
  request.camera.eye = request.camera.target;
  EXPECT_THAT(Make(shards, request), StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST_F(FramePipelineTest, IsovalueOutsideTheDataGivesAnEmptyPicture) {
  const SmallDataset dataset(2);
  FrameRequest request = dataset.Request();
  request.isovalue = 1000;
  Frame frame;
  RunAlone(dataset.OpenShards(), request, dataset, &frame);
  EXPECT_TRUE(frame.hits.empty());
  EXPECT_EQ(frame.statistics.active_block_count, 0);
  EXPECT_TRUE(frame.image ==
              image::FrameImage(request.viewport.width_px, request.viewport.height_px));
}

}  // namespace
}  // namespace isoscope::agent
