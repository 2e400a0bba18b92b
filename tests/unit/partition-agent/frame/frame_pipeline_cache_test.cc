// Following frames: what an agent keeps of samples and meshes changes no pixel, and is bounded.

#include <filesystem>
#include <thread>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/unit/partition-agent/frame/frame_pipeline_fixture.h"

namespace isoscope::agent {
namespace {

class FramePipelineCacheTest : public FramePipelineTest {};

using isoscope::testing::FlipBit;
using isoscope::testing::SmallDataset;
using isoscope::testing::StatusIs;

TEST_F(FramePipelineCacheTest, FollowingFramesReadNothingIfAllFits) {
  Open(2);
  FrameTask turned = task_;
  view::Azimuth(2.0, &*turned.spec.camera);
  FrameTask other = task_;
  other.spec.surfaces[0].rule.isovalue = SmallDataset::kIsovalue + 10;
  Frame cold;
  RunAlone(task_, &cold);
  EXPECT_GT(cold.statistics.read_bytes, 0);
  EXPECT_GT(cold.statistics.index_page_read_count, 0);
  Frame warm;
  RunAlone(task_, &warm);
  ExpectSameWork(warm, cold);
  EXPECT_EQ(warm.statistics.read_bytes, 0);
  EXPECT_EQ(warm.statistics.index_page_read_count, 0);

  // Another level: its index is read, and blocks that were not; then it is kept, and the first one
  // still is.
  RenderAll(shards_, task_);
  frame::AgentStatistics other_statistics;
  const image::FrameImage other_image = RenderAll(shards_, other, &other_statistics);
  EXPECT_GT(other_statistics.index_page_read_count, 0);
  for (const FrameTask& known : {task_, other, turned}) {
    frame::AgentStatistics statistics;
    const image::FrameImage image = RenderAll(shards_, known, &statistics);
    EXPECT_EQ(statistics.read_bytes, 0);
    // The same from nothing.
    std::unique_ptr<BlockCache> kept = std::exchange(cache_, std::make_unique<BlockCache>(0));
    frame::AgentStatistics cold_statistics;
    EXPECT_TRUE(image == RenderAll(shards_, known, &cold_statistics));
    EXPECT_EQ(statistics.triangle_count, cold_statistics.triangle_count);
    EXPECT_GT(cold_statistics.read_bytes, 0);
    EXPECT_EQ(cache_->size_bytes(), 0U);
    cache_ = std::move(kept);
  }
}

// A block that is read once may never be again: its samples are kept when it is read again.
TEST_F(FramePipelineCacheTest, SamplesAreReadTwiceAndThenKept) {
  Open(2);
  // Samples are whole numbers: the same blocks are active at all of these.
  const double isovalues[] = {128.25, 128.5, 128.75};
  std::vector<std::int64_t> block_bytes;
  for (const double isovalue : isovalues) {
    task_.spec.surfaces[0].rule.isovalue = isovalue;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards_, task_));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RaySelection selection, pipeline->SelectOccluders());
    const std::int64_t index_bytes = pipeline->statistics().read_bytes;
    EXPECT_GT(pipeline->statistics().index_page_read_count, 0) << "each isovalue asks the index";
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage occluders, pipeline->RenderOccluders({}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image,
                                  pipeline->RenderVisible(selection.active, ""));
    block_bytes.push_back(pipeline->statistics().read_bytes - index_bytes);
    // Kept samples and samples from the disk give the same image.
    std::unique_ptr<BlockCache> kept = std::exchange(cache_, std::make_unique<BlockCache>(0));
    EXPECT_TRUE(image == RenderAll(shards_, task_)) << isovalue;
    cache_ = std::move(kept);
  }
  EXPECT_GT(block_bytes[0], 0);
  EXPECT_EQ(block_bytes[1], block_bytes[0]) << "samples were kept the first time, or lost";
  EXPECT_EQ(block_bytes[2], 0) << "samples were not kept the second time";
}

TEST_F(FramePipelineCacheTest, ManyIsovaluesStayWithinTheBytesOfTheCache) {
  Open(2);
  constexpr int kIsovalueCount = 60;
  constexpr std::size_t kSmallCacheBytes = std::size_t{4} << 20;
  const auto request_of = [this](int i) {
    task_.spec.surfaces[0].rule.isovalue = 100.5 + i;
    return task_;
  };
  std::vector<image::FrameImage> expected;
  std::size_t ample_bytes = 0;
  cache_->Populate(kAmpleCacheBytes / 2);  // so that a moving isovalue recycles nothing
  for (int i = 0; i < kIsovalueCount; ++i) {
    expected.push_back(RenderAll(shards_, request_of(i)));
    ample_bytes = cache_->size_bytes();
  }
  EXPECT_GT(ample_bytes, 2 * kSmallCacheBytes) << "the cache is not too small for the test";
  EXPECT_LE(ample_bytes, kAmpleCacheBytes);
  cache_ = std::make_unique<BlockCache>(kSmallCacheBytes);
  for (int visit = 0; visit < 2; ++visit) {
    for (int i = 0; i < kIsovalueCount; ++i) {
      EXPECT_TRUE(RenderAll(shards_, request_of(i)) == expected[static_cast<std::size_t>(i)]) << i;
      EXPECT_LE(cache_->size_bytes(), kSmallCacheBytes) << i;
    }
  }
  EXPECT_GT(cache_->size_bytes(), kSmallCacheBytes / 4) << "the room is not used";
  // The last one is there.
  frame::AgentStatistics statistics;
  RenderAll(shards_, request_of(kIsovalueCount - 1), &statistics);
  EXPECT_EQ(statistics.read_bytes, 0);
}

TEST_F(FramePipelineCacheTest, CacheOfAnySizeChangesNothingAndIsBounded) {
  Open(2);
  std::vector<FrameTask> requests(3, dataset_->Request());
  requests[1].spec.surfaces[0].rule.isovalue += 10;
  view::Azimuth(0.5, &*requests[2].spec.camera);
  std::vector<Frame> expected(requests.size());
  cache_ = std::make_unique<BlockCache>(0);
  for (std::size_t i = 0; i < requests.size(); ++i) {
    RunAlone(requests[i], &expected[i]);
  }
  ForgetAll();
  for (const std::size_t max_bytes : kCacheSizes) {
    cache_ = std::make_unique<BlockCache>(max_bytes);
    for (int round = 0; round < 3; ++round) {
      for (std::size_t i = 0; i < requests.size(); ++i) {
        SCOPED_TRACE(absl::StrCat(max_bytes, " bytes, round ", round, ", request ", i));
        Frame frame;
        RunAlone(requests[i], &frame);
        ExpectSameWork(frame, expected[i]);
        EXPECT_LE(cache_->size_bytes(), max_bytes);
        if (max_bytes == kAmpleCacheBytes && round > 0) {
          EXPECT_EQ(frame.statistics.read_bytes, 0);
        }
        if (max_bytes == kCacheSizes[0]) {
          EXPECT_GT(frame.statistics.read_bytes, 0) << "the cache is not too small for the test";
        }
      }
    }
  }
}

TEST_F(FramePipelineCacheTest, PipelinesSideBySideOnOneCacheGiveTheirOwnPictures) {
  Open(2);
  std::vector<FrameTask> requests(4, dataset_->Request());
  requests[1].spec.surfaces[0].rule.isovalue += 10;
  view::Azimuth(0.5, &*requests[2].spec.camera);
  requests[3].spec.surfaces[0].rule.isovalue += 10;
  std::vector<image::FrameImage> expected;
  expected.reserve(requests.size());
  for (const FrameTask& request : requests) {
    expected.push_back(RenderAll(shards_, request));
  }
  for (const std::size_t max_bytes : kCacheSizes) {
    cache_ = std::make_unique<BlockCache>(max_bytes);
    std::vector<std::thread> threads;
    for (std::size_t i = 0; i < requests.size(); ++i) {
      threads.emplace_back([&, i] {
        for (int frame = 0; frame < 4; ++frame) {
          EXPECT_TRUE(RenderAll(shards_, requests[i]) == expected[i]) << "request " << i;
        }
      });
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
    EXPECT_LE(cache_->size_bytes(), max_bytes);
  }
}

TEST_F(FramePipelineCacheTest, WhatADamagedBlockLeftInTheCacheIsNeverAnotherPicture) {
  Open(1);
  const std::string path = dataset_->shard_directory(0) + "/" + store::kBlocksFileName;
  const auto size = static_cast<std::int64_t>(std::filesystem::file_size(path));
  const image::FrameImage expected = RenderAll(shards_, task_);
  ForgetAll();
  for (std::int64_t offset = 100; offset < size; offset += 5000) {
    FlipBit(path, offset);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pipeline, Make(shards_, task_));
  EXPECT_THAT(pipeline->RenderAll(), StatusIs(absl::StatusCode::kDataLoss));
  for (std::int64_t offset = 100; offset < size; offset += 5000) {
    FlipBit(path, offset);
  }
  EXPECT_TRUE(RenderAll(shards_, task_) == expected);
}

TEST_F(FramePipelineCacheTest, ABlockIsReadOnceForAllSurfaces) {
  Open(1);
  FrameTask one = dataset_->Request();
  frame::AgentStatistics one_statistics;
  RenderAll(shards_, one, &one_statistics);
  FrameTask twice = one;
  twice.spec.surfaces.push_back(one.spec.surfaces[0]);
  ForgetAll();
  frame::AgentStatistics twice_statistics;
  RenderAll(shards_, twice, &twice_statistics);
  EXPECT_GT(one_statistics.read_bytes, 0);
  // The tree is asked twice at most; blocks are most of the bytes.
  EXPECT_LT(twice_statistics.read_bytes, one_statistics.read_bytes + one_statistics.read_bytes / 4);
  EXPECT_EQ(twice_statistics.triangle_count, 2 * one_statistics.triangle_count);
  EXPECT_EQ(twice_statistics.visible_block_count, one_statistics.visible_block_count);
  ASSERT_EQ(twice_statistics.surfaces.size(), 2U);
  for (const frame::SurfaceStatistics& surface : twice_statistics.surfaces) {
    EXPECT_EQ(surface.triangle_count, one_statistics.triangle_count);
    EXPECT_EQ(surface.unique_vertex_count, one_statistics.unique_vertex_count);
  }
}

}  // namespace
}  // namespace isoscope::agent
