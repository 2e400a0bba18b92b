#include "server/cluster/agent_registry.h"

#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <fstream>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/frame/picture_revision.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/server/make_shard.h"
#include "wire/frame_convert.h"

namespace isoscope::server {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::MakeShard;
using testing::StatusIs;

using Shards = std::vector<isoscope::internal::v1::ShardDescription>;

constexpr char kOtherId[] = "ffffffffffffffffffffffffffffffff";

// A cluster without agents: what it answers for them is set by address. Thread-safe. The tests of
// the registry use it instead of gRPC, which ThreadSanitizer does not see through.
class FakeCluster {
 public:
  void Serve(const std::string& address, Shards shards) {
    const base::MutexLock lock(&mutex_);
    shards_[address] = std::move(shards);
  }
  void Stop(const std::string& address) {
    const base::MutexLock lock(&mutex_);
    shards_.erase(address);
  }
  void SetResolved(std::vector<std::string> addresses) {
    const base::MutexLock lock(&mutex_);
    resolved_ = std::move(addresses);
  }
  // The number of whole probes that have begun.
  int probe_count() {
    const base::MutexLock lock(&mutex_);
    return probe_count_;
  }
  // From now on no agent answers before the probe is cancelled.
  void Hang() {
    const base::MutexLock lock(&mutex_);
    hangs_ = true;
  }
  void WaitUntilOneHangs() {
    const base::MutexLock lock(&mutex_);
    changed_.Await(&mutex_,
                   [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return hanging_count_ > 0; });
  }

  // Polls so seldom that only what the registry does by itself counts.
  AgentRegistryOptions LazyOptions(const std::vector<std::string>& targets) {
    AgentRegistryOptions options;
    for (const std::string& target : targets) {
      options.endpoints.push_back({target, nullptr});
    }
    options.poll_interval = absl::Hours(1);
    options.resolve = [this](const DnsName& name) -> absl::StatusOr<std::vector<std::string>> {
      EXPECT_EQ(name.host, "agents");
      const base::MutexLock lock(&mutex_);
      if (resolved_.empty()) {
        return absl::UnavailableError("can't resolve agents:50052");
      }
      return resolved_;
    };
    options.probe = [this](absl::Span<AgentProbe> probes, const base::Cancellation& cancellation) {
      const absl::Status status = base::AwaitOrCancelled(
          cancellation, &mutex_, &changed_, [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
            hanging_count_ += hangs_ ? 1 : 0;
            changed_.SignalAll();
            return !hangs_;
          });
      const base::MutexLock lock(&mutex_);
      ++probe_count_;
      for (AgentProbe& probe : probes) {
        const auto found = shards_.find(probe.address);
        if (!status.ok()) {
          probe.answer = status;
        } else if (found == shards_.end()) {
          probe.answer = absl::UnavailableError("connection refused");
        } else {
          isoscope::internal::v1::DescribeShardsResponse answer;
          *answer.mutable_picture_revision() = wire::ToProto(frame::PictureRevision());
          answer.mutable_shards()->Assign(found->second.begin(), found->second.end());
          probe.answer = std::move(answer);
        }
      }
    };
    return options;
  }

 private:
  base::Mutex mutex_;
  base::CondVar changed_;
  std::map<std::string, Shards> shards_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::string> resolved_ ABSL_GUARDED_BY(mutex_);
  bool hangs_ ABSL_GUARDED_BY(mutex_) = false;
  int hanging_count_ ABSL_GUARDED_BY(mutex_) = 0;
  int probe_count_ ABSL_GUARDED_BY(mutex_) = 0;
};

// While it lives, writers to standard error block, as with a hung reader of the log.
class StuckLog {
 public:
  StuckLog() : saved_(dup(STDERR_FILENO)) {
    EXPECT_EQ(pipe(pipe_), 0);
    const int flags = fcntl(pipe_[1], F_GETFL);
    EXPECT_EQ(fcntl(pipe_[1], F_SETFL, flags | O_NONBLOCK), 0);
    const std::string bytes(4096, '.');
    while (write(pipe_[1], bytes.data(), bytes.size()) > 0) {
    }
    EXPECT_EQ(fcntl(pipe_[1], F_SETFL, flags), 0);
    EXPECT_GE(dup2(pipe_[1], STDERR_FILENO), 0);
    close(pipe_[1]);
  }
  StuckLog(const StuckLog&) = delete;
  StuckLog& operator=(const StuckLog&) = delete;
  // Writers see a broken pipe at worst.
  ~StuckLog() {
    std::signal(SIGPIPE, SIG_IGN);
    dup2(saved_, STDERR_FILENO);
    close(saved_);
    close(pipe_[0]);
  }

 private:
  const int saved_;
  int pipe_[2] = {-1, -1};
};

base::MonotonicTime Soon() { return base::MonotonicNow() + absl::Seconds(60); }

TEST(AgentRegistryTest, BadEndpointsAreRefused) {
  FakeCluster cluster;
  EXPECT_THAT(AgentRegistry::Start(cluster.LazyOptions({})),
              StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(AgentRegistry::Start(cluster.LazyOptions({"a:1", "a:1"})),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("twice")));
  EXPECT_THAT(AgentRegistry::Start(cluster.LazyOptions({"dns:///:1"})),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST(AgentRegistryTest, NamesAreFoundAndTheOnlyDatasetNeedsNone) {
  FakeCluster cluster;
  cluster.Serve("a:1", {MakeShard("head", 0, 1)});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(cluster.LazyOptions({"a:1"})));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  const base::Cancellation soon(Soon());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::shared_ptr<const DatasetState> found,
                                registry->FindComplete("", soon));
  EXPECT_EQ(found->dataset.name(), "head");
  EXPECT_THAT(registry->FindComplete("haed", soon),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("\"head\"")));
}

TEST(AgentRegistryTest, OneOfSeveralDatasetsMustBeNamed) {
  FakeCluster cluster;
  cluster.Serve("a:1", {MakeShard("foot", 0, 1, kOtherId), MakeShard("head", 0, 1)});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(cluster.LazyOptions({"a:1"})));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  EXPECT_THAT(registry->Find(""), StatusIs(absl::StatusCode::kInvalidArgument,
                                           AllOf(HasSubstr("\"foot\""), HasSubstr("\"head\""))));
}

TEST(AgentRegistryTest, AReturningAgentServesTheNextFrameAtOnce) {
  FakeCluster cluster;
  cluster.Serve("a:1", {MakeShard("head", 0, 1)});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(cluster.LazyOptions({"a:1"})));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));

  cluster.Stop("a:1");
  registry->ReportFailure("a:1");
  const base::Cancellation soon(Soon());
  EXPECT_THAT(registry->FindComplete("head", soon),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("a:1")));

  cluster.Serve("a:1", {MakeShard("head", 0, 1)});
  EXPECT_THAT(registry->FindComplete("head", soon), IsOk());
}

TEST(AgentRegistryTest, TheEndOfTheFirstProbeIsToldOnceWhateverTheAgentsAnswer) {
  FakeCluster cluster;  // nobody answers
  std::atomic<int> count{0};
  AgentRegistryOptions options = cluster.LazyOptions({"a:1"});
  options.on_first_probe = [&] { ++count; };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry, AgentRegistry::Start(options));
  while (count == 0) {
    absl::SleepFor(absl::Milliseconds(1));
  }
  const base::Cancellation soon(Soon());
  EXPECT_FALSE(registry->FindComplete("head", soon).ok());  // asks again
  cluster.Serve("a:1", {MakeShard("head", 0, 1)});
  EXPECT_THAT(registry->FindComplete("head", soon), IsOk());
  EXPECT_EQ(count, 1);
}

// The probe hangs: a frame that waited for it would get both agents.
TEST(AgentRegistryTest, ALostAgentWithAReplicaIsLeftOutAndNotWaitedFor) {
  FakeCluster cluster;
  cluster.Serve("a:1", {MakeShard("head", 0, 1)});
  cluster.Serve("b:1", {MakeShard("head", 0, 1)});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(cluster.LazyOptions({"a:1", "b:1"})));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  EXPECT_TRUE(registry->IsReachable("a:1"));
  EXPECT_FALSE(registry->IsReachable("x:1"));
  cluster.Hang();
  registry->ReportFailure("a:1");
  const base::Cancellation never;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::shared_ptr<const DatasetState> found,
                                registry->FindComplete("head", never));
  ASSERT_EQ(found->replica_sets.size(), 1u);
  ASSERT_EQ(found->replica_sets[0].agents.size(), 1u);
  EXPECT_EQ(found->replica_sets[0].agents[0].address, "b:1");
  cluster.WaitUntilOneHangs();  // the lost one is asked all the same
}

TEST(AgentRegistryTest, WithoutSomeShardsADatasetIsFoundOnlyIfThatIsAllowed) {
  FakeCluster cluster;
  cluster.Serve("a:1", {MakeShard("head", 0, 2)});
  cluster.Serve("b:1", {MakeShard("head", 1, 2)});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(cluster.LazyOptions({"a:1", "b:1"})));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  cluster.Stop("a:1");
  registry->ReportFailure("a:1");
  const base::Cancellation soon(Soon());
  EXPECT_THAT(registry->FindComplete("head", soon),
              StatusIs(absl::StatusCode::kFailedPrecondition));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::shared_ptr<const DatasetState> found,
      registry->FindComplete("head", soon, Caller(), /*allow_partial=*/true));
  ASSERT_EQ(found->replica_sets.size(), 1u);
  EXPECT_EQ(found->replica_sets[0].shard_indices, std::vector<int>{1});
  cluster.Stop("b:1");
  registry->ReportFailure("b:1");
  EXPECT_THAT(registry->FindComplete("head", soon, Caller(), /*allow_partial=*/true),
              StatusIs(absl::StatusCode::kFailedPrecondition));
}

TEST(AgentRegistryTest, WaitsForAgentsThatComeLater) {
  FakeCluster cluster;
  cluster.Serve("a:1", {MakeShard("head", 0, 2)});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(cluster.LazyOptions({"a:1", "b:1"})));
  EXPECT_THAT(registry->WaitUntilReady(base::MonotonicNow() + absl::Milliseconds(20)),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("b:1")));
  std::thread starter([&] { cluster.Serve("b:1", {MakeShard("head", 1, 2)}); });
  ISOSCOPE_EXPECT_OK(registry->WaitUntilReady(Soon()));
  starter.join();
}

TEST(AgentRegistryTest, AnAgentThatLiesAboutItsDatasetIsNotUsed) {
  isoscope::internal::v1::ShardDescription bad = MakeShard("head", 0, 1);
  bad.mutable_dataset()->set_block_count(12345);
  FakeCluster cluster;
  cluster.Serve("a:1", {bad});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(cluster.LazyOptions({"a:1"})));
  EXPECT_THAT(registry->FindComplete("head", base::Cancellation(Soon())),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("block_count is 12345")));
}

TEST(AgentRegistryTest, EveryAddressBehindANameIsAnAgentAndThoseThatVanishAreDropped) {
  FakeCluster cluster;
  cluster.Serve("10.0.0.1:1", {MakeShard("head", 0, 2)});
  cluster.Serve("10.0.0.2:1", {MakeShard("head", 1, 2)});
  cluster.Serve("10.0.0.3:1", {MakeShard("head", 1, 2)});
  cluster.SetResolved({"10.0.0.1:1", "10.0.0.2:1"});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(cluster.LazyOptions({"dns:///agents:50052"})));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  EXPECT_EQ(registry->agents().size(), 2u);

  cluster.Stop("10.0.0.2:1");
  cluster.SetResolved({"10.0.0.1:1", "10.0.0.3:1"});
  registry->ReportFailure("10.0.0.2:1");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::shared_ptr<const DatasetState> found,
                                registry->FindComplete("head", base::Cancellation(Soon())));
  ASSERT_EQ(found->replica_sets.size(), 2u);
  EXPECT_EQ(found->replica_sets[1].agents.front().address, "10.0.0.3:1");
  for (const AgentState& agent : registry->agents()) {
    EXPECT_NE(agent.address, "10.0.0.2:1");
  }
}

TEST(AgentRegistryTest, AnAddressThatTheNameForgotStaysAsLongAsItAnswers) {
  FakeCluster cluster;
  cluster.Serve("10.0.0.1:1", {MakeShard("head", 0, 1)});
  cluster.SetResolved({"10.0.0.1:1"});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(cluster.LazyOptions({"dns:///agents:50052"})));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  const base::Cancellation soon(Soon());
  for (const std::vector<std::string>& resolved :
       {std::vector<std::string>{"10.0.0.2:1"}, std::vector<std::string>{}}) {
    cluster.SetResolved(resolved);
    registry->ReportFailure("10.0.0.1:1");
    EXPECT_THAT(registry->FindComplete("head", soon), IsOk());
  }
}

TEST(AgentRegistryTest, AgentsComeAndGoWithAListAndABadListChangesNothing) {
  const testing::TempDir directory;
  const std::string path = directory.Sub("agents");
  FakeCluster cluster;
  cluster.Serve("a:1", {MakeShard("head", 0, 1)});
  cluster.Serve("b:1", {MakeShard("head", 0, 1)});
  std::ofstream(path) << "a:1\n";
  AgentRegistryOptions options = cluster.LazyOptions({"file:" + path});
  options.poll_interval = absl::Milliseconds(1);
  options.check_target = [](const std::string& target) {
    return target == "evil:1" ? absl::InvalidArgumentError("in plaintext") : absl::OkStatus();
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry, AgentRegistry::Start(options));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  const auto await_agents = [&](const std::vector<std::string>& expected) {
    std::vector<std::string> addresses;
    const base::MonotonicTime limit = Soon();
    while (addresses != expected && base::MonotonicNow() < limit) {
      addresses.clear();
      for (const AgentState& agent : registry->agents()) {
        addresses.push_back(agent.address);
      }
    }
    EXPECT_EQ(addresses, expected);
  };
  await_agents({"a:1"});
  std::ofstream(path) << "a:1\nb:1\n";
  await_agents({"a:1", "b:1"});
  std::ofstream(path) << "b:1\n";
  await_agents({"b:1"});
  for (const char* bad : {"a:1 b:1\n", "evil:1\n"}) {
    std::ofstream(path) << bad;
    absl::SleepFor(absl::Milliseconds(20));
    await_agents({"b:1"});
  }
  EXPECT_THAT(registry->FindComplete("head", base::Cancellation(Soon())), IsOk());
}

TEST(AgentRegistryTest, ANameThatCannotBeResolvedIsReportedAsSuchUntilItCan) {
  FakeCluster cluster;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(cluster.LazyOptions({"dns:///agents:50052"})));
  const base::Cancellation soon(Soon());
  EXPECT_THAT(registry->FindComplete("", soon),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("can't resolve")));
  cluster.Serve("10.0.0.1:1", {MakeShard("head", 0, 1)});
  cluster.SetResolved({"10.0.0.1:1"});
  EXPECT_THAT(registry->FindComplete("", soon), IsOk());
  EXPECT_EQ(registry->agents().size(), 1u);
}

TEST(AgentRegistryTest, FramesShareTheDatasetAndKeepItWhenAgentsChange) {
  FakeCluster cluster;
  cluster.Serve("a:1", {MakeShard("head", 0, 1), MakeShard("foot", 0, 1, kOtherId)});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(cluster.LazyOptions({"a:1"})));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  AccessToken token;
  token.datasets = {"head"};
  const Caller restricted(std::make_shared<AccessGrant>(token, base::MonotonicNow()));
  const base::Cancellation soon(Soon());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, registry->FindComplete("head", soon));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, registry->FindComplete("", soon, restricted));
  EXPECT_EQ(first.get(), second.get()) << "it was copied";
  cluster.Stop("a:1");
  registry->ReportFailure("a:1");
  EXPECT_THAT(registry->FindComplete("head", soon),
              StatusIs(absl::StatusCode::kFailedPrecondition));
  ASSERT_EQ(first->replica_sets.size(), 1u);
  EXPECT_EQ(first->replica_sets[0].agents[0].address, "a:1");
}

TEST(AgentRegistryTest, AReaderOfTheLogThatHangsHoldsNoFrame) {
  FakeCluster cluster;
  cluster.Serve("a:1", {MakeShard("head", 0, 2)});
  cluster.Serve("b:1", {MakeShard("head", 1, 2)});
  AgentRegistryOptions options = cluster.LazyOptions({"a:1", "b:1"});
  options.poll_interval = absl::Milliseconds(1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry, AgentRegistry::Start(options));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  std::future<bool> has_seen_it;
  std::future_status status = std::future_status::timeout;
  {
    const StuckLog stuck;
    cluster.Stop("b:1");  // the registry has a line to write
    has_seen_it = std::async(std::launch::async, [&] {
      const base::MonotonicTime limit = Soon();
      while (base::MonotonicNow() < limit) {
        const auto found = registry->Find("head");
        if (found.ok() && !(*found)->status.ok()) {
          return true;
        }
      }
      return false;
    });
    status = has_seen_it.wait_for(std::chrono::seconds(60));
  }
  EXPECT_EQ(status, std::future_status::ready) << "Find waited for the log";
  EXPECT_TRUE(has_seen_it.get());
}

TEST(AgentRegistryTest, NamesThatNobodyServesDoNotKeepAskingTheAgents) {
  FakeCluster cluster;
  cluster.Serve("a:1", {MakeShard("head", 0, 1)});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(cluster.LazyOptions({"a:1"})));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  const base::Cancellation never;
  const base::MonotonicTime start = base::MonotonicNow();
  const int before = cluster.probe_count();
  for (int i = 0; i < 100; ++i) {
    EXPECT_THAT(registry->FindComplete("haed", never), StatusIs(absl::StatusCode::kNotFound));
  }
  const auto intervals =
      static_cast<int>((base::MonotonicNow() - start) / AgentRegistry::kMissingNameInterval);
  EXPECT_LE(cluster.probe_count() - before, 1 + intervals);

  // One call looks again after the interval, and waits. The others don't.
  absl::SleepFor(AgentRegistry::kMissingNameInterval);
  cluster.Hang();
  base::Cancellation leaves;
  std::thread waiting([&] {
    EXPECT_THAT(registry->FindComplete("haed", leaves), StatusIs(absl::StatusCode::kCancelled));
  });
  cluster.WaitUntilOneHangs();
  EXPECT_THAT(registry->FindComplete("haed", never), StatusIs(absl::StatusCode::kNotFound));
  leaves.Cancel();
  waiting.join();
}

TEST(AgentRegistryTest, ANewDatasetIsFoundWithinTheInterval) {
  FakeCluster cluster;
  cluster.Serve("a:1", {MakeShard("head", 0, 1)});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry,
                                AgentRegistry::Start(cluster.LazyOptions({"a:1"})));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  const base::Cancellation soon(Soon());
  EXPECT_THAT(registry->FindComplete("foot", soon), StatusIs(absl::StatusCode::kNotFound));
  cluster.Serve("a:1", {MakeShard("head", 0, 1), MakeShard("foot", 0, 1, kOtherId)});
  absl::SleepFor(AgentRegistry::kMissingNameInterval);
  EXPECT_THAT(registry->FindComplete("foot", soon), IsOk());
}

// Without a deadline of their own: what is not woken would wait for kMaxFrameWait or hang.
TEST(AgentRegistryTest, ACancelledFrameAndTheEndDoNotWaitForAgentsThatHang) {
  FakeCluster cluster;
  cluster.Hang();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto registry, AgentRegistry::Start(cluster.LazyOptions({"a:1"})));
  cluster.WaitUntilOneHangs();
  base::Cancellation cancellation;
  std::thread frame([&] {
    EXPECT_THAT(registry->FindComplete("head", cancellation),
                StatusIs(absl::StatusCode::kCancelled));
  });
  cancellation.Cancel();
  frame.join();
  registry.reset();
}

TEST(AgentRegistryTest, FramesFailuresAndQuestionsMeet) {
  FakeCluster cluster;
  cluster.Serve("a:1", {MakeShard("head", 0, 2)});
  cluster.Serve("b:1", {MakeShard("head", 1, 2)});
  AgentRegistryOptions options = cluster.LazyOptions({"a:1", "b:1"});
  options.poll_interval = absl::Milliseconds(1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto registry, AgentRegistry::Start(options));
  ISOSCOPE_ASSERT_OK(registry->WaitUntilReady(Soon()));
  std::vector<std::thread> threads;
  for (int i = 0; i < 3; ++i) {
    threads.emplace_back([&registry, i] {
      for (int round = 0; round < 30; ++round) {
        registry->ReportFailure(round % 2 == 0 ? "a:1" : "b:1");
        const base::Cancellation soon(Soon());
        EXPECT_THAT(registry->FindComplete(i == 0 ? "" : "head", soon), IsOk());
        EXPECT_EQ(registry->agents().size(), 2u);
        EXPECT_EQ(registry->datasets().size(), 1u);
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

}  // namespace
}  // namespace isoscope::server
