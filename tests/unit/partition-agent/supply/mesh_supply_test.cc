#include "partition-agent/supply/mesh_supply.h"

#include <map>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "gtest/gtest.h"

#include "core/base/mutex.h"
#include "core/base/task_arena.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using testing::SmallDataset;
using testing::StatusIs;

// Full after every `capacity` batches. Notes what was added, and breaches of the contract.
class CountingSink final : public MeshSink {
 public:
  explicit CountingSink(int capacity) : capacity_(capacity) {}

  absl::Status Add(std::span<const render::MeshToDraw> meshes) override {
    EXPECT_FALSE(is_draining_.load()) << "added during a drain";
    adding_.fetch_add(1);
    EXPECT_LE(meshes.size(), MeshWorker::kMaxBatchMeshes);
    {
      const base::MutexLock lock(&mutex_);
      for (const render::MeshToDraw& item : meshes) {
        ++times_added_[{item.surface_index, item.mesh->block_id}];
      }
      late_count_ += held_.load() >= capacity_ ? 1 : 0;
      most_late_ = std::max(most_late_, late_count_);
    }
    std::this_thread::yield();
    held_.fetch_add(1);
    adding_.fetch_sub(1);
    return absl::OkStatus();
  }
  [[nodiscard]] bool is_full() const override { return held_.load() >= capacity_; }
  absl::Status Drain() override {
    is_draining_ = true;
    EXPECT_EQ(adding_.load(), 0) << "drained while another thread adds";
    held_ = 0;
    ++drain_count_;
    {
      const base::MutexLock lock(&mutex_);
      late_count_ = 0;
    }
    is_draining_ = false;
    return failing_drain_ == drain_count_ ? absl::InternalError("no drain") : absl::OkStatus();
  }

  void FailAtDrain(int number) { failing_drain_ = number; }
  [[nodiscard]] int drain_count() const { return drain_count_; }
  [[nodiscard]] std::map<std::pair<std::uint32_t, volume::BlockId>, int> times_added() {
    const base::MutexLock lock(&mutex_);
    return times_added_;
  }
  // Returns the most batches between the sink being full and its drain.
  [[nodiscard]] int most_late() {
    const base::MutexLock lock(&mutex_);
    return most_late_;
  }

 private:
  const int capacity_;
  std::atomic<int> held_{0};
  std::atomic<int> adding_{0};
  std::atomic<bool> is_draining_{false};
  int drain_count_ = 0;  // only the thread of the supply drains
  int failing_drain_ = 0;
  base::Mutex mutex_;
  std::map<std::pair<std::uint32_t, volume::BlockId>, int> times_added_ ABSL_GUARDED_BY(mutex_);
  int late_count_ ABSL_GUARDED_BY(mutex_) = 0;
  int most_late_ ABSL_GUARDED_BY(mutex_) = 0;
};

class MeshSupplyTest : public ::testing::Test {
 protected:
  // Blocks of the dataset for two surfaces.
  SurfaceBlocks FindBlocks() {
    IndexCost cost;
    auto blocks = SurfaceBlocks::Find(dataset_.OpenShards(),
                                      {{.isovalue = SmallDataset::kIsovalue}, {.isovalue = 140.0}},
                                      nullptr, never_, &cost);
    ISOSCOPE_CHECK(blocks.ok());
    return *std::move(blocks);
  }
  absl::Status AddAll(const SurfaceBlocks& blocks, base::TaskArena* arena, MeshSink* sink) {
    MeshSupply supply(&blocks, cache_.BeginRound(++frame_number_),
                      {.arena = arena, .cache = &cache_}, &never_);
    return supply.AddMeshes(blocks.ChooseAll(), sink).status();
  }

  const SmallDataset dataset_{2};
  const base::Cancellation never_;
  BlockCache cache_{std::size_t{1} << 30};
  std::int64_t frame_number_ = 0;
};

TEST_F(MeshSupplyTest, EveryMeshIsAddedOnceHoweverOftenTheSinkIsFull) {
  const SurfaceBlocks blocks = FindBlocks();
  const std::size_t mesh_count = blocks.ChooseAll().size();
  ASSERT_GE(mesh_count, 100U);
  for (const int threads : {1, 2, 3, 8, 32}) {
    const std::shared_ptr<base::TaskArena> arena = std::make_shared<base::TaskArena>(threads);
    for (const int capacity : {1, 3, 1 << 30}) {
      SCOPED_TRACE(::testing::Message() << threads << " threads, full after " << capacity);
      cache_.SetMaxBytes(0);  // all meshes are read; then, with room, some are kept
      for (int frame = 0; frame < 3; ++frame) {
        CountingSink sink(capacity);
        ISOSCOPE_ASSERT_OK(AddAll(blocks, arena.get(), &sink));
        EXPECT_EQ(sink.times_added().size(), mesh_count);
        for (const auto& [mesh, times] : sink.times_added()) {
          EXPECT_EQ(times, 1) << "surface " << mesh.first << ", block " << mesh.second;
        }
        // The thread that filled it is not late, each other one may be once.
        EXPECT_LT(sink.most_late(), threads);
        EXPECT_EQ(sink.drain_count() > 0, capacity < 10);
        cache_.SetMaxBytes(std::size_t{1} << 30);
      }
    }
  }
}

TEST_F(MeshSupplyTest, ErrorOfADrainEndsTheSupply) {
  const SurfaceBlocks blocks = FindBlocks();
  const std::shared_ptr<base::TaskArena> arena = std::make_shared<base::TaskArena>(3);
  // From disk, then from the cache.
  for (int frame = 0; frame < 2; ++frame) {
    CountingSink sink(1);
    sink.FailAtDrain(2);
    EXPECT_THAT(AddAll(blocks, arena.get(), &sink), StatusIs(absl::StatusCode::kInternal));
    EXPECT_EQ(sink.drain_count(), 2);
    CountingSink ample(1 << 30);
    ISOSCOPE_ASSERT_OK(AddAll(blocks, arena.get(), &ample));
  }
}

}  // namespace
}  // namespace isoscope::agent
