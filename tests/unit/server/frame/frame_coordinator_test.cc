#include "server/frame/frame_coordinator.h"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <future>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <oneapi/tbb/global_control.h>
#include <sys/resource.h>

#include "core/base/memory_budget.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/composite/depth_composite.h"
#include "tests/support/enough_time.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/server/frame/frame_pieces.h"

namespace isoscope::server {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

// The message of step 3.
struct VisibleBlocks {
  Blocks blocks;
  std::string open_pixels;
};

// The test's record of one agent; outlives its link.
class Agent {
 public:
  Agent(int index, int replica, AgentListener* listener)
      : index_(index),
        identity_{absl::StrCat("agent-", index, replica == 0 ? "" : absl::StrCat(".", replica)),
                  {index}},
        listener_(listener) {}

  AgentListener& coordinator() { return *listener_; }
  [[nodiscard]] int index() const { return index_; }
  [[nodiscard]] std::string name() const { return identity_.address; }
  [[nodiscard]] const AgentIdentity& identity() const { return identity_; }

  // Wait for the coordinator's word; CANCELLED once the frame is cancelled.
  absl::StatusOr<Blocks> AwaitOccluders() { return Await(&occluders_); }
  absl::StatusOr<VisibleBlocks> AwaitVisible() { return Await(&visible_); }
  absl::Status AwaitCancel() {
    const base::MutexLock lock(&mutex_);
    changed_.Await(&mutex_, [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return cancelled_; });
    return absl::CancelledError("cancelled by the coordinator");
  }

  // As a stream, which ends only after its last read: a cancellation does not wake it.
  void AwaitRoom() {
    std::promise<void> room;
    listener_->WhenRoom([&room] { room.set_value(); });
    room.get_future().wait();
  }

  void SetOccluders(const Blocks& blocks) {
    const base::MutexLock lock(&mutex_);
    EXPECT_FALSE(occluders_.has_value()) << name() << ": occluders were sent twice";
    occluders_ = blocks;
    changed_.SignalAll();
  }
  void SetVisible(VisibleBlocks visible) {
    const base::MutexLock lock(&mutex_);
    EXPECT_FALSE(visible_.has_value()) << name() << ": visible blocks were sent twice";
    visible_ = std::move(visible);
    changed_.SignalAll();
  }
  void Cancel() {
    const base::MutexLock lock(&mutex_);
    cancelled_ = true;
    changed_.SignalAll();
  }

  [[nodiscard]] std::optional<Blocks> occluders() const {
    const base::MutexLock lock(&mutex_);
    return occluders_;
  }
  [[nodiscard]] std::optional<VisibleBlocks> visible() const {
    const base::MutexLock lock(&mutex_);
    return visible_;
  }
  [[nodiscard]] bool is_cancelled() const {
    const base::MutexLock lock(&mutex_);
    return cancelled_;
  }

 private:
  template <typename T>
  absl::StatusOr<T> Await(std::optional<T>* message) {
    const base::MutexLock lock(&mutex_);
    const auto arrived = [this, message]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
      return cancelled_ || message->has_value();
    };
    changed_.Await(&mutex_, arrived);
    if (cancelled_) {
      return absl::CancelledError("cancelled by the coordinator");
    }
    return **message;
  }

  const int index_;
  const AgentIdentity identity_;
  AgentListener* const listener_;
  mutable base::Mutex mutex_;
  base::CondVar changed_;
  std::optional<Blocks> occluders_ ABSL_GUARDED_BY(mutex_);
  std::optional<VisibleBlocks> visible_ ABSL_GUARDED_BY(mutex_);
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
};

frame::AgentStatistics MakeStatistics(const Agent& agent, const std::vector<int>& shard_indices) {
  frame::AgentStatistics statistics;
  statistics.agent_address = agent.name();
  statistics.shard_indices = shard_indices;
  statistics.active_block_count = 100 + shard_indices.front();
  return statistics;
}

// The actions of an agent; the result is the end of the stream.
using Script = std::function<absl::Status(Agent& self)>;

class FrameCoordinatorTest : public ::testing::Test {
 protected:
  class Link final : public AgentLink {
   public:
    Link(std::shared_ptr<Agent> agent, const Script& script, FrameCoordinatorTest* test)
        : agent_(std::move(agent)), test_(test), thread_([this, script] {
            absl::Status status = script(*agent_);
            agent_->coordinator().OnEnd(std::move(status));
          }) {
      ++test_->live_links_;
    }
    ~Link() override {
      agent_->Cancel();
      thread_.join();
      --test_->live_links_;
    }
    void SendOccluders(const Blocks& blocks) override { agent_->SetOccluders(blocks); }
    void SendVisibleBlocks(const Blocks& blocks, std::string open_pixels) override {
      agent_->SetVisible({blocks, std::move(open_pixels)});
    }
    void Cancel() override { agent_->Cancel(); }
    [[nodiscard]] const AgentIdentity& agent() const override { return agent_->identity(); }
    [[nodiscard]] std::int64_t network_bytes() const override {
      return std::int64_t{1000} << agent_->index();
    }

   private:
    const std::shared_ptr<Agent> agent_;
    FrameCoordinatorTest* const test_;
    std::thread thread_;  // last: it uses what is above
  };

  absl::StatusOr<FrameResult> Run(frame::Culling culling, const std::vector<Script>& scripts) {
    std::vector<std::vector<Script>> parts;
    for (const Script& script : scripts) {
      parts.push_back({script});
    }
    absl::StatusOr<FrameResult> result = RunParts(culling, parts);
    EXPECT_TRUE(report_.failures.empty() || !result.ok());
    return result;
  }

  // The scripts of each part's replicas.
  absl::StatusOr<FrameResult> RunParts(frame::Culling culling,
                                       const std::vector<std::vector<Script>>& parts) {
    agents_.clear();
    const auto begin = [&](int index, int replica,
                           AgentListener* listener) -> absl::StatusOr<std::unique_ptr<AgentLink>> {
      if (index == failing_begin_) {
        return absl::FailedPreconditionError("agent-1 serves another dataset");
      }
      agents_.push_back(std::make_shared<Agent>(index, replica, listener));
      return std::make_unique<Link>(
          agents_.back(), parts[static_cast<std::size_t>(index)][static_cast<std::size_t>(replica)],
          this);
    };
    frame::FrameSpec spec;
    spec.surfaces.resize(1);
    spec.culling = culling;
    FrameSetup setup;
    setup.spec = &spec;
    setup.view = &view_;
    setup.layout = &layout_;
    for (const std::vector<Script>& replicas : parts) {
      setup.replica_counts.push_back(static_cast<int>(replicas.size()));
    }
    setup.is_lost = is_lost_;
    setup.may_hedge = may_hedge_;
    setup.active = known_active_;
    setup.max_waiting_bytes = max_waiting_bytes_;
    setup.images = images_.get();
    setup.arena = used_arena_;
    FrameOutcome outcome = RunFrame(setup, begin, *cancellation_);
    EXPECT_EQ(live_links_, 0) << "a link outlived the frame";
    report_ = outcome;
    lost_parts_ = outcome.lost_parts;
    if (!outcome.status.ok()) {
      return outcome.status;
    }
    return std::move(outcome.result);
  }

  // All pixels of a step: in shuffled bands, or at once as an agent of this process does.
  static void SendPixels(const image::FrameImage& image, std::uint64_t seed, Agent* self) {
    if (seed % 2 == 0) {
      self->coordinator().OnDrawnPixels({.image = image, .layers = {}, .memory = nullptr});
      return;
    }
    for (std::string& band : ShuffledBands(image, seed)) {
      self->coordinator().OnPixels({std::move(band)});
      self->AwaitRoom();
    }
  }

  // An agent that behaves: its hits and active blocks, then images.
  static Script Behave(const Blocks& hits, const Blocks& active, const image::FrameImage& occluders,
                       const image::FrameImage& rest, std::uint64_t seed = 1) {
    return [=](Agent& self) -> absl::Status {
      self.coordinator().OnRayHits(hits, active);
      if (const auto all = self.AwaitOccluders(); !all.ok()) {
        return all.status();
      }
      SendPixels(occluders, seed, &self);
      self.coordinator().OnOccludersDone();
      if (const auto visible = self.AwaitVisible(); !visible.ok()) {
        return visible.status();
      }
      SendPixels(rest, seed, &self);
      self.coordinator().OnFrameDone(MakeStatistics(self, {self.index()}));
      return absl::OkStatus();
    };
  }
  static Script BehaveWithoutPixels() {
    return Behave({3}, {}, image::FrameImage(kWidth, kHeight), image::FrameImage(kWidth, kHeight));
  }
  static Script Wait() {
    return [](Agent& self) { return self.AwaitCancel(); };
  }

  const view::View view_ = MakeView();
  const volume::BlockLayout layout_ = *volume::BlockLayout::Make(kDims, {4, 4, 4});
  const std::shared_ptr<image::FrameImagePool> images_ = image::FrameImagePool::Make(1 << 20);
  base::TaskArena arena_{2};
  base::TaskArena* used_arena_ = &arena_;
  const image::FragmentOrder order_{
      .block_count = static_cast<std::uint32_t>(layout_.block_count()),
      .ties = image::TieRule::kColor};
  std::shared_ptr<const ActiveBlocks> known_active_;
  std::function<bool(int, int)> is_lost_;
  std::function<bool(int, int)> may_hedge_;
  AgentReport report_;  // of the last frame
  std::vector<std::size_t> lost_parts_;
  std::unique_ptr<base::Cancellation> cancellation_ = std::make_unique<base::Cancellation>();
  std::vector<std::shared_ptr<Agent>> agents_;
  std::atomic<int> live_links_{0};
  int failing_begin_ = -1;
  std::size_t max_waiting_bytes_ = std::numeric_limits<std::size_t>::max();
};

TEST_F(FrameCoordinatorTest, KnownActiveBlocksReplaceTheReportAndGiveTheSameFrame) {
  const std::vector<Blocks> active = {Every(2, 0), Every(2, 1)};
  const image::FrameImage rest = RandomImage(4, 0.3);
  const auto run = [&](bool reports) {
    const Blocks none;
    return Run(frame::Culling::kDepth, {Behave({9, 30}, reports ? active[0] : none, Wall(), rest),
                                        Behave({8}, reports ? active[1] : none, rest, Wall())});
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameResult first, run(true));
  const auto first_agents = agents_;
  known_active_ = first.active;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameResult second, run(false));
  EXPECT_EQ(second.active, known_active_);
  EXPECT_TRUE(second.image == first.image);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_FALSE(agents_[i]->occluders()->empty());
    EXPECT_FALSE(agents_[i]->visible()->blocks.empty());
    EXPECT_EQ(agents_[i]->occluders(), first_agents[i]->occluders());
    EXPECT_EQ(agents_[i]->visible()->blocks, first_agents[i]->visible()->blocks);
    EXPECT_TRUE(agents_[i]->visible()->open_pixels == first_agents[i]->visible()->open_pixels);
  }
}

TEST_F(FrameCoordinatorTest, ImageIsTheCompositeInAnyOrderOfArrival) {
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    SCOPED_TRACE(seed);
    const auto culling = seed % 2 == 0 ? frame::Culling::kDepth : frame::Culling::kMask;
    image::FrameImage occluders(kWidth, kHeight);
    std::vector<Script> scripts;
    std::vector<image::FrameImage> rest;
    for (std::uint64_t agent = 0; agent < 5; ++agent) {
      const image::FrameImage first = RandomImage(100 * seed + 2 * agent, 0.15);
      rest.push_back(RandomImage(100 * seed + 2 * agent + 1, 0.15));
      composite::CompositeInto(first, order_, &occluders);
      scripts.push_back(Behave({}, {}, first, rest.back(), 100 * seed + agent));
    }
    image::FrameImage expected = occluders;
    for (const image::FrameImage& image : rest) {
      composite::CompositeInto(image, order_, &expected);
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameResult result, Run(culling, scripts));
    EXPECT_TRUE(result.image == expected);
  }
}

// Symptom: with four agents in one process and an arena of one thread no frame came to its end. The
// last agents waited for the memory of pixels that the arena had no thread to composite.
TEST_F(FrameCoordinatorTest, ImageIsTheSameHoweverFewPixelsMayWait) {
  const image::FrameImage none(kWidth, kHeight);
  std::vector<Script> scripts;
  for (std::uint64_t agent = 0; agent < 12; ++agent) {
    scripts.push_back(Behave({}, {}, RandomImage(agent, 0.3), RandomImage(100 + agent, 0.5), 1));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameResult expected, Run(frame::Culling::kDepth, scripts));
  for (const std::size_t max_waiting_bytes :
       {std::size_t{0}, std::size_t{100}, std::size_t{10000}}) {
    max_waiting_bytes_ = max_waiting_bytes;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameResult result, Run(frame::Culling::kDepth, scripts));
    EXPECT_TRUE(result.image == expected.image) << max_waiting_bytes << " bytes";
  }
}

// A frame that ends early leaves pixels without compositing them. They must not block its streams.
TEST_F(FrameCoordinatorTest, AgentsThatWaitForRoomEndWithAFrameThatFails) {
  max_waiting_bytes_ = 0;
  std::atomic<int> sending = 0;
  const Script send = [&](Agent& self) {
    const std::vector<std::string> bands = ShuffledBands(RandomImage(1, 0.5), 1);
    ++sending;
    for (int i = 0; i < 1000 && !self.is_cancelled(); ++i) {
      self.coordinator().OnPixels(bands);
      self.AwaitRoom();
    }
    return self.AwaitCancel();
  };
  const Script fail = [&](Agent&) {
    while (sending < 8) {
      std::this_thread::yield();
    }
    return absl::DataLossError("block 7 damaged");
  };
  std::vector<Script> scripts(8, send);
  scripts.push_back(fail);
  EXPECT_THAT(Run(frame::Culling::kNone, scripts),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("block 7")));
}

TEST_F(FrameCoordinatorTest, AgentsThatWaitForTheMemoryOfQueuedPixelsGoOnWithoutASpareThread) {
  const tbb::global_control no_workers(tbb::global_control::max_allowed_parallelism, 1);
  for (const int arena_width : {1, 2}) {
    for (const frame::Culling culling : {frame::Culling::kDepth, frame::Culling::kNone}) {
      SCOPED_TRACE(absl::StrCat("arena of ", arena_width, ", culling ", static_cast<int>(culling)));
      base::TaskArena arena(arena_width);
      used_arena_ = &arena;
      // A frame that hangs fails then.
      cancellation_ =
          std::make_unique<base::Cancellation>(base::MonotonicNow() + absl::Seconds(60));
      base::MemoryBudget budget(2);
      const auto send = [&](const image::FrameImage& image, Agent* self) -> absl::Status {
        ISOSCOPE_ASSIGN_OR_RETURN(auto reserved, budget.Reserve(1, *cancellation_));
        self->coordinator().OnDrawnPixels(
            {.image = image,
             .layers = {},
             .memory =
                 std::make_shared<const base::MemoryBudget::Reservation>(std::move(reserved))});
        return absl::OkStatus();
      };
      image::FrameImage expected(kWidth, kHeight);
      std::vector<Script> scripts;
      for (std::uint64_t agent = 0; agent < 8; ++agent) {
        const image::FrameImage occluders = RandomImage(2 * agent, 0.15);
        const image::FrameImage rest = RandomImage(2 * agent + 1, 0.15);
        if (culling != frame::Culling::kNone) {
          composite::CompositeInto(occluders, order_, &expected);
        }
        composite::CompositeInto(rest, order_, &expected);
        scripts.push_back([=](Agent& self) -> absl::Status {
          if (culling != frame::Culling::kNone) {
            self.coordinator().OnRayHits({}, {});
            ISOSCOPE_RETURN_IF_ERROR(self.AwaitOccluders().status());
            ISOSCOPE_RETURN_IF_ERROR(send(occluders, &self));
            self.coordinator().OnOccludersDone();
            ISOSCOPE_RETURN_IF_ERROR(self.AwaitVisible().status());
          }
          ISOSCOPE_RETURN_IF_ERROR(send(rest, &self));
          self.coordinator().OnFrameDone(MakeStatistics(self, {self.index()}));
          return absl::OkStatus();
        });
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameResult result, Run(culling, scripts));
      EXPECT_TRUE(result.image == expected);
      EXPECT_EQ(budget.reserved_bytes(), 0U);
    }
  }
}

TEST_F(FrameCoordinatorTest, WithoutCullingNoAgentIsSentAnything) {
  image::FrameImage expected(kWidth, kHeight);
  std::vector<Script> scripts;
  for (std::uint64_t agent = 0; agent < 3; ++agent) {
    const image::FrameImage image = RandomImage(agent, 0.4);
    composite::CompositeInto(image, order_, &expected);
    scripts.push_back([image, agent](Agent& self) {
      for (std::string& band : ShuffledBands(image, agent)) {
        self.coordinator().OnPixels({std::move(band)});
      }
      self.coordinator().OnFrameDone({});
      return absl::OkStatus();
    });
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameResult result, Run(frame::Culling::kNone, scripts));
  EXPECT_TRUE(result.image == expected);
  EXPECT_EQ(result.ray_hit_block_count, 0);
  EXPECT_EQ(result.active, nullptr) << "would be kept as if no block were active";
  EXPECT_EQ(result.occluder_selection_duration, absl::ZeroDuration());
  EXPECT_EQ(result.occluder_rendering_duration, absl::ZeroDuration());
  for (const auto& agent : agents_) {
    EXPECT_FALSE(agent->occluders().has_value());
    EXPECT_FALSE(agent->visible().has_value());
  }
}

TEST_F(FrameCoordinatorTest, StatisticsAreSortedAndBytesSummed) {
  std::vector<Script> scripts;
  const std::vector<std::vector<int>> shards = {{7}, {0, 9}, {10}, {1, 2}};
  for (const std::vector<int>& indices : shards) {
    scripts.push_back([indices](Agent& self) {
      self.coordinator().OnFrameDone(MakeStatistics(self, indices));
      return absl::OkStatus();
    });
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameResult result, Run(frame::Culling::kNone, scripts));
  ASSERT_EQ(result.agents.size(), 4U);
  std::vector<std::string> names;
  for (const frame::AgentStatistics& agent : result.agents) {
    names.push_back(agent.agent_address);
    EXPECT_EQ(agent.active_block_count, 100 + agent.shard_indices.front());
  }
  EXPECT_THAT(names, ElementsAre("agent-1", "agent-3", "agent-0", "agent-2"));
  EXPECT_EQ(result.network_bytes, 1000 + 2000 + 4000 + 8000);
}

TEST_F(FrameCoordinatorTest, DamagedBandIsDataLossThatNamesTheAgent) {
  const Script damaged = [](Agent& self) {
    std::string band = ShuffledBands(RandomImage(5, 0.5), 1).front();
    band[band.size() / 2] = static_cast<char>(band[band.size() / 2] ^ 0x10);
    self.coordinator().OnPixels({band});
    return self.AwaitCancel();
  };
  EXPECT_THAT(Run(frame::Culling::kNone, {Wait(), damaged, Wait()}),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("agent-1")));
  const Script truncated = [](Agent& self) {
    std::string band = ShuffledBands(RandomImage(5, 0.5), 1).front();
    band.pop_back();
    self.coordinator().OnPixels({band});
    return self.AwaitCancel();
  };
  EXPECT_THAT(Run(frame::Culling::kNone, {Wait(), Wait(), truncated}),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("agent-2")));
}

TEST_F(FrameCoordinatorTest, FailingToBeginOneAgentCancelsThoseThatBegan) {
  failing_begin_ = 1;
  EXPECT_THAT(Run(frame::Culling::kDepth, {Wait(), Wait(), Wait()}),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("another dataset")));
  ASSERT_EQ(agents_.size(), 1U) << "agents after the failing one were begun";
  EXPECT_TRUE(agents_[0]->is_cancelled());
}

// Sanitizers need address space of their own.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST_F(FrameCoordinatorTest, PictureWithoutMemoryIsResourceExhaustedAndNoAgentIsAsked) {
  const view::View huge =
      *view::View::Make(view::MakeDefaultCamera({{0, 0, 0}, {16, 16, 16}}),
                        {view::kMaxViewportPx, view::kMaxViewportPx}, view_.geometry());
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_AS, &before), 0);
  const rlimit none{.rlim_cur = 1 << 20, .rlim_max = before.rlim_max};
  frame::FrameSpec spec;
  spec.surfaces.resize(1);
  FrameSetup setup;
  setup.spec = &spec;
  setup.view = &huge;
  setup.layout = &layout_;
  setup.replica_counts = {1};
  setup.images = images_.get();
  setup.arena = &arena_;
  bool was_begun = false;
  ASSERT_EQ(setrlimit(RLIMIT_AS, &none), 0);
  const absl::Status status =
      RunFrame(
          setup,
          [&](int, int, AgentListener*) -> absl::StatusOr<std::unique_ptr<AgentLink>> {
            was_begun = true;
            return absl::CancelledError();
          },
          *cancellation_)
          .status;
  ASSERT_EQ(setrlimit(RLIMIT_AS, &before), 0);
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("16384 x 16384")));
  EXPECT_FALSE(was_begun);
}
#endif

TEST_F(FrameCoordinatorTest, DeadlineDoesNotNameAgentsWhoseAnswersHadCome) {
  testing::WithEnoughTime(absl::Milliseconds(300), [this](absl::Duration time) {
    const base::MonotonicTime begin = base::MonotonicNow();
    std::atomic<int> early_count{0};
    const Script answers = [&](Agent& self) {
      self.coordinator().OnRayHits({1}, {});
      early_count += base::MonotonicNow() - begin < time / 2 ? 1 : 0;
      return self.AwaitCancel();
    };
    cancellation_ = std::make_unique<base::Cancellation>(begin + time);
    const absl::Status status = Run(frame::Culling::kDepth, {answers, Wait(), answers}).status();
    if (early_count < 2) {
      return false;
    }
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kDeadlineExceeded,
                                 EndsWith("not answered: agent agent-1 (shard 1)")));
    return true;
  });
}

// A frame of three parts. The middle one has replicas: `first` is tried before one that behaves.
class ReplicaTest : public FrameCoordinatorTest {
 protected:
  ReplicaTest() {
    for (std::uint64_t part = 0; part < 3; ++part) {
      scripts_.push_back(Behave({9 + static_cast<volume::BlockId>(part)},
                                Every(3, static_cast<volume::BlockId>(part)),
                                RandomImage(10 + part, 0.3), RandomImage(20 + part, 0.3), part));
    }
  }

  absl::StatusOr<FrameResult> RunWith(const std::vector<Script>& replicas) {
    return RunParts(frame::Culling::kDepth, {{scripts_[0]}, replicas, {scripts_[2]}});
  }

  // Expects the frame of three agents that behave, with the middle part done by `winner`.
  void ExpectTheSameFrame(const FrameResult& result, const std::string& winner) {
    const AgentReport report = report_;
    const auto agents = agents_;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameResult plain, RunWith({scripts_[1]}));
    EXPECT_TRUE(result.image == plain.image);
    EXPECT_EQ(result.ray_hit_block_count, plain.ray_hit_block_count);
    EXPECT_EQ(result.active->ids, plain.active->ids);
    ASSERT_EQ(result.agents.size(), 3u) << "a part counts once, or not at all";
    EXPECT_EQ(result.agents[1].agent_address, winner);
    EXPECT_EQ(result.agents[1].active_block_count, plain.agents[1].active_block_count);
    EXPECT_EQ(result.network_bytes, plain.network_bytes);
    report_ = report;
    agents_ = agents;
  }

  [[nodiscard]] const Agent& AgentOfName(const std::string& name) const {
    for (const auto& agent : agents_) {
      if (agent->name() == name) {
        return *agent;
      }
    }
    ADD_FAILURE() << name << " was not asked";
    return *agents_.front();
  }

  // Does what the middle part does up to a word, then `end`.
  [[nodiscard]] Script UpTo(int word, const std::function<absl::Status(Agent&)>& end) const {
    return [=](Agent& self) -> absl::Status {
      if (word == 0) {
        return end(self);
      }
      self.coordinator().OnRayHits({10}, Every(3, 1));
      if (word == 1) {
        return end(self);
      }
      if (const auto all = self.AwaitOccluders(); !all.ok()) {
        return all.status();
      }
      const std::vector<std::string> bands = ShuffledBands(RandomImage(11, 0.3), 1);
      for (std::size_t i = 0; i < (word == 2 ? bands.size() / 2 : bands.size()); ++i) {
        self.coordinator().OnPixels({bands[i]});
      }
      if (word == 2) {
        return end(self);
      }
      self.coordinator().OnOccludersDone();
      if (word == 3) {
        return end(self);
      }
      if (const auto visible = self.AwaitVisible(); !visible.ok()) {
        return visible.status();
      }
      self.coordinator().OnPixels({ShuffledBands(RandomImage(21, 0.3), 1).front()});
      return end(self);
    };
  }
  static constexpr int kWordCount = 5;

  std::vector<Script> scripts_;
};

TEST_F(ReplicaTest, AnAgentLostAtAnyStepIsReplacedAndTheFrameIsTheSame) {
  const std::vector<absl::Status> ends = {
      absl::UnavailableError("connection reset"), absl::DataLossError("block 7 damaged"),
      absl::FailedPreconditionError("serves other content"), absl::InternalError("a bug"),
      absl::ResourceExhaustedError("too many frames")};
  for (int word = 0; word < kWordCount; ++word) {
    for (const absl::Status& end : ends) {
      SCOPED_TRACE(absl::StrCat(word, " ", end.ToString()));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          const FrameResult result,
          RunWith({UpTo(word, [&](Agent&) { return end; }), scripts_[1]}));
      ExpectTheSameFrame(result, "agent-1.1");
      ASSERT_EQ(report_.failures.size(), 1u);
      EXPECT_EQ(report_.failures[0].agent.address, "agent-1");
      EXPECT_EQ(report_.failures[0].status, end);
      EXPECT_THAT(lost_parts_, IsEmpty());
      EXPECT_TRUE(report_.lost_hedges.empty());
    }
  }
}

TEST_F(ReplicaTest, WhenTheLastReplicaFailsTheFrameEndsWithItsErrorAndSaysHowManyThereWere) {
  const auto fails = [](Agent& self) {
    return absl::UnavailableError(absl::StrCat("no way to ", self.name()));
  };
  EXPECT_THAT(RunWith({UpTo(2, fails), UpTo(1, fails)}),
              StatusIs(absl::StatusCode::kUnavailable,
                       AllOf(HasSubstr("no way to agent-1.1"),
                             HasSubstr("the last of 2 agents that serve it"))));
  EXPECT_EQ(report_.failures.size(), 2u);
  EXPECT_THAT(lost_parts_, ElementsAre(1u));
  EXPECT_TRUE(AgentOfName("agent-0").is_cancelled());
}

TEST_F(ReplicaTest, DamagedPixelsAreSentAgainByAReplicaAlsoAfterTheAgentWasDone) {
  const auto damaged = [](Agent& self) {
    std::string band = ShuffledBands(RandomImage(5, 0.5), 1).front();
    band[band.size() / 2] = static_cast<char>(band[band.size() / 2] ^ 0x10);
    self.coordinator().OnPixels({band});
  };
  for (const bool is_done : {false, true}) {
    SCOPED_TRACE(is_done);
    const Script script = UpTo(4, [&](Agent& self) -> absl::Status {
      damaged(self);
      if (!is_done) {
        return self.AwaitCancel();
      }
      self.coordinator().OnFrameDone(MakeStatistics(self, {1}));
      return absl::OkStatus();
    });
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameResult result, RunWith({script, scripts_[1]}));
    ExpectTheSameFrame(result, "agent-1.1");
    ASSERT_EQ(report_.failures.size(), 1u);
    EXPECT_THAT(report_.failures[0].status, StatusIs(absl::StatusCode::kDataLoss));
  }
}

TEST_F(ReplicaTest, APartWhoseAgentNoLongerAnswersIsTriedBesideItAtAnyStep) {
  is_lost_ = [](int part, int replica) { return part == 1 && replica == 0; };
  for (int word = 0; word < kWordCount; ++word) {
    SCOPED_TRACE(word);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const FrameResult result,
        RunWith({UpTo(word, [](Agent& self) { return self.AwaitCancel(); }), scripts_[1]}));
    EXPECT_TRUE(AgentOfName("agent-1").is_cancelled());
    EXPECT_EQ(report_.lost_hedges, (std::vector<AgentIdentity>{{"agent-1", {1}}}));
    ExpectTheSameFrame(result, "agent-1.1");
    EXPECT_TRUE(report_.failures.empty());
  }
}

TEST_F(ReplicaTest, ASlowPartIsHedgedIfThatIsAllowed) {
  // Without hedging, an error rather than a hang.
  cancellation_ = std::make_unique<base::Cancellation>(base::MonotonicNow() + absl::Seconds(60));
  may_hedge_ = [&](int part, int replica) { return part == 1 && replica == 1; };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const FrameResult result,
      RunWith({UpTo(2, [](Agent& self) { return self.AwaitCancel(); }), scripts_[1]}));
  EXPECT_EQ(report_.lost_hedges.size(), 1u);
  EXPECT_EQ(report_.hedge_count, 1);
  cancellation_ = std::make_unique<base::Cancellation>();
  may_hedge_ = nullptr;
  ExpectTheSameFrame(result, "agent-1.1");
}

TEST_F(ReplicaTest, AnErrorOrACancellationAtAnyStepEndsTheFrameAndCancelsTheOthers) {
  const absl::Status error = absl::DataLossError("dataset head, shard 1: block 7 damaged");
  for (int word = 0; word < kWordCount; ++word) {
    SCOPED_TRACE(word);
    EXPECT_EQ(
        RunWith({UpTo(word, [&](Agent&) { return error; })}).status(),
        absl::DataLossError("agent agent-1 (shard 1): dataset head, shard 1: block 7 damaged"));
    ASSERT_EQ(report_.failures.size(), 1U);  // as data, for who repeats the agent's part
    EXPECT_EQ(report_.failures[0].agent, (AgentIdentity{"agent-1", {1}}));
    EXPECT_EQ(report_.failures[0].status, error);
    EXPECT_TRUE(AgentOfName("agent-0").is_cancelled());
    EXPECT_TRUE(AgentOfName("agent-2").is_cancelled());

    const Script cancels = UpTo(word, [&](Agent& self) {
      std::thread user([&] { cancellation_->Cancel(); });
      user.join();
      return self.AwaitCancel();
    });
    EXPECT_THAT(RunWith({cancels, Wait()}),
                StatusIs(absl::StatusCode::kCancelled, Not(HasSubstr("agent-"))));
    EXPECT_EQ(agents_.size(), 3u) << "a replica was asked";
    EXPECT_TRUE(AgentOfName("agent-0").is_cancelled());
    cancellation_ = std::make_unique<base::Cancellation>();
  }
}

TEST_F(FrameCoordinatorTest, ManyAgentsAtOnceGiveOneFrame) {
  const std::vector<Script> scripts(32, BehaveWithoutPixels());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameResult result, Run(frame::Culling::kDepth, scripts));
  ASSERT_EQ(result.agents.size(), 32U);
  for (int i = 0; i < 32; ++i) {
    EXPECT_THAT(result.agents[static_cast<std::size_t>(i)].shard_indices, ElementsAre(i));
  }
}

}  // namespace
}  // namespace isoscope::server
