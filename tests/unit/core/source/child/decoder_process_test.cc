// A handler (Do) that computes, dies, hangs, or takes memory, as the request says:
//
// - answers, and one child for all requests;
// - every kind of death: signals, exit, exceptions, limits of time and memory, wrong answers;
// - isolation: no output, no core file, no descriptors, no signal handlers of the parent;
// - no process is left, not even when the parent is killed.

#include "core/source/child/decoder_process.h"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <iostream>
#include <new>
#include <stdexcept>
#include <string>
#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>

#include "core/base/cancellation.h"
#include "core/base/process_interrupt.h"
#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;

constexpr auto kUnavailable = absl::StatusCode::kUnavailable;
constexpr std::size_t kSharedBytes = 100;

enum class Deed : std::int32_t {
  kAddOne,
  kAbort,
  kCrash,
  kExit,
  kThrow,
  kKillItself,
  kSpin,
  kSpinFor,  // until the process has used `number` milliseconds
  kSleep,
  kAllocate,
  kSpeak,
  kCountDescriptors,
  kRaiseTerminalSignals,
  kAnswerShort,
  kAnswerLong,
  kLimitOfCoreFiles,
  kIsDumpable,
};

struct Request {
  Deed deed = Deed::kAddOne;
  std::int64_t number = 0;
};
struct Answer {
  std::int64_t number = -1;
};

void Send(std::size_t size) {
  const std::string bytes(size, 'x');
  static_cast<void>(send(3, bytes.data(), bytes.size(), 0));
}

bool CanAllocate(std::int64_t bytes) {
  try {
    const std::string memory(static_cast<std::size_t>(bytes), 'x');
    return memory.back() == 'x';
  } catch (const std::bad_alloc&) {
    return false;
  }
}

std::int64_t CpuMilliseconds() {
  timespec used{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used);
  return std::int64_t{1000} * used.tv_sec + used.tv_nsec / 1'000'000;
}

std::int64_t CountDescriptors() {
  std::int64_t count = 0;
  for (int descriptor = 0; descriptor < 1024; ++descriptor) {
    count += fcntl(descriptor, F_GETFD) >= 0 ? 1 : 0;
  }
  return count;
}

std::int64_t LimitOfCoreFiles() {
  rlimit limit{.rlim_cur = 1, .rlim_max = 1};
  getrlimit(RLIMIT_CORE, &limit);
  return static_cast<std::int64_t>(limit.rlim_cur);
}

// Runs in the child.
std::int64_t Do(const Request& request) {
  switch (request.deed) {
    case Deed::kAddOne:
      return request.number + 1;
    case Deed::kAbort:
      std::abort();
    case Deed::kCrash:
      return std::raise(SIGSEGV);
    case Deed::kExit:
      _exit(static_cast<int>(request.number));
    case Deed::kThrow:
      throw std::runtime_error("Doe^Jane");
    case Deed::kKillItself:
      return kill(getpid(), SIGKILL);
    case Deed::kSpin:
      for (;;) {
        static_cast<void>(getppid());
      }
    case Deed::kSpinFor:
      while (CpuMilliseconds() < request.number) {
      }
      return CpuMilliseconds();
    case Deed::kSleep:
      for (;;) {
        pause();
      }
    case Deed::kAllocate:
      return CanAllocate(request.number) ? 1 : 0;
    case Deed::kSpeak:
      std::cout << "Doe^Jane" << std::endl;
      std::cerr << "Doe^Jane" << std::endl;
      return std::fflush(nullptr);
    case Deed::kCountDescriptors:
      return CountDescriptors();
    case Deed::kRaiseTerminalSignals:
      return std::raise(SIGINT) + std::raise(SIGTERM) + std::raise(SIGHUP) + std::raise(SIGQUIT);
    case Deed::kAnswerShort:
      Send(sizeof(Answer) - 1);
      return 0;
    case Deed::kAnswerLong:
      Send(sizeof(Answer) + 1);
      return 0;
    case Deed::kLimitOfCoreFiles:
      return LimitOfCoreFiles();
    case Deed::kIsDumpable:
      return prctl(PR_GET_DUMPABLE);
  }
  return -1;
}

void Handle(const void* request, void* answer, char* shared) {
  static_cast<Answer*>(answer)->number = Do(*static_cast<const Request*>(request));
  shared[kSharedBytes - 1] = static_cast<char>(static_cast<Answer*>(answer)->number);
}

class DecoderProcessTest : public ::testing::Test {
 protected:
  // The child's number, or the error.
  absl::StatusOr<std::int64_t> Ask(Deed deed, std::int64_t number = 0,
                                   const DecoderProcess::Limits& limits = {}) {
    Answer answer;
    const absl::Status status =
        process_.Ask(Request{.deed = deed, .number = number}, limits, &answer);
    if (!status.ok()) {
      return status;
    }
    return answer.number;
  }
  // Expects that the next request is answered, after any earlier one.
  void ExpectAnswers() { EXPECT_EQ(Ask(Deed::kAddOne, 41).value_or(-1), 42); }

  DecoderProcess process_{{.handler = Handle,
                           .request_bytes = sizeof(Request),
                           .answer_bytes = sizeof(Answer),
                           .shared_bytes = kSharedBytes}};
};

TEST_F(DecoderProcessTest, OneChildAnswersAllRequestsInItsOwnProcessAndSharesMemory) {
  EXPECT_EQ(process_.pid(), -1) << "there is none before it is needed";
  for (std::int64_t i = 0; i < 50; ++i) {
    EXPECT_EQ(Ask(Deed::kAddOne, i).value_or(-1), i + 1);
    EXPECT_EQ(process_.shared()[kSharedBytes - 1], i + 1);
  }
  const pid_t child = process_.pid();
  EXPECT_NE(child, getpid());
  ISOSCOPE_EXPECT_OK(process_.Start());
  EXPECT_EQ(process_.pid(), child);
}

TEST_F(DecoderProcessTest, DeathOfTheChildIsAnErrorThatSaysHowAndTheNextRequestIsAnswered) {
  EXPECT_THAT(Ask(Deed::kAbort).status(), StatusIs(kUnavailable, HasSubstr("SIGABRT")));
  ExpectAnswers();
  EXPECT_THAT(Ask(Deed::kCrash).status(), StatusIs(kUnavailable, HasSubstr("SIGSEGV")));
  EXPECT_THAT(Ask(Deed::kExit, 7).status(), StatusIs(kUnavailable, HasSubstr("code 7")));
  ExpectAnswers();
  EXPECT_THAT(Ask(Deed::kThrow).status(), StatusIs(kUnavailable, HasSubstr("SIGABRT")))
      << "an exception ends the child, and never runs on into the parent's code";
  ExpectAnswers();
  EXPECT_THAT(Ask(Deed::kKillItself).status(), StatusIs(kUnavailable, HasSubstr("SIGKILL")));
  ExpectAnswers();
}

TEST_F(DecoderProcessTest, ChildThatIsKilledBetweenRequestsIsReplaced) {
  for (int i = 0; i < 3; ++i) {
    ExpectAnswers();
    const pid_t child = process_.pid();
    ASSERT_EQ(kill(child, SIGKILL), 0);
    ExpectAnswers();
    EXPECT_NE(process_.pid(), child);
  }
}

TEST_F(DecoderProcessTest, HangsEndByCpuTimeAndByTheClock) {
  const DecoderProcess::Limits by_cpu{.cpu_seconds = 1};
  EXPECT_THAT(Ask(Deed::kSpin, 0, by_cpu).status(), StatusIs(kUnavailable, HasSubstr("SIGXCPU")));
  ExpectAnswers();
  const DecoderProcess::Limits by_clock{.clock_seconds = 1};
  EXPECT_THAT(Ask(Deed::kSleep, 0, by_clock).status(),
              StatusIs(absl::StatusCode::kDeadlineExceeded, HasSubstr("did not answer for 1 s")))
      << "a disk may be slow: nothing is known of the file";
  ExpectAnswers();
}

// The interrupt of the process, which fires 20 ms after the child has begun.
class InterruptedSoon {
 public:
  InterruptedSoon() {
    base::SetProcessInterrupt(&interrupt_);
    thread_ = std::thread([this] {
      absl::SleepFor(absl::Milliseconds(20));
      interrupt_.Cancel();
    });
  }
  ~InterruptedSoon() {
    thread_.join();
    base::SetProcessInterrupt(nullptr);
  }

 private:
  base::Cancellation interrupt_;
  std::thread thread_;
};

TEST_F(DecoderProcessTest, AnInterruptEndsTheWaitForAChildThatDoesNotAnswerAndKillsIt) {
  {
    const InterruptedSoon interrupted;
    EXPECT_THAT(Ask(Deed::kSleep).status(),
                StatusIs(absl::StatusCode::kCancelled, HasSubstr("interrupted")));
    EXPECT_EQ(process_.pid(), -1);
    EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1) << "no process is left";
  }
  ExpectAnswers();
}

TEST_F(DecoderProcessTest, AnInterruptEndsTheWaitForAChildThatIsStopped) {
  ISOSCOPE_ASSERT_OK(process_.Start());
  ASSERT_EQ(kill(process_.pid(), SIGSTOP), 0);
  const InterruptedSoon interrupted;
  EXPECT_THAT(Ask(Deed::kAddOne).status(), StatusIs(absl::StatusCode::kCancelled, _));
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1) << "no process is left";
}

TEST_F(DecoderProcessTest, CpuTimeIsOfOneRequestNotOfAll) {
  const DecoderProcess::Limits limits{.cpu_seconds = 1};
  for (const std::int64_t used_ms : {700, 1400, 2100}) {
    EXPECT_GE(Ask(Deed::kSpinFor, used_ms, limits).value_or(-1), used_ms);
  }
}

// Sanitizers reserve more address space than there is memory.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST_F(DecoderProcessTest, MemoryEndsAtItsLimitOfEachRequest) {
  ASSERT_TRUE(DecoderProcess::HasMemoryLimit());
  constexpr std::int64_t kMiB = std::int64_t{1} << 20;
  EXPECT_EQ(Ask(Deed::kAllocate, 256 * kMiB, {.memory_bytes = 64 * kMiB}).value_or(-1), 0);
  EXPECT_EQ(Ask(Deed::kAllocate, 256 * kMiB, {.memory_bytes = 512 * kMiB}).value_or(-1), 1);
}
#endif

TEST_F(DecoderProcessTest, AnswersOfAWrongSizeAreErrors) {
  for (const Deed deed : {Deed::kAnswerShort, Deed::kAnswerLong}) {
    EXPECT_THAT(Ask(deed).status(), StatusIs(kUnavailable, HasSubstr("wrong size")));
    ExpectAnswers();
  }
}

TEST_F(DecoderProcessTest, ChildIsSilentLeavesNoCoreFileAndHasNoDescriptorOfOurs) {
  const int ours = open("/dev/null", O_RDONLY);
  ASSERT_GE(ours, 0);
  ::testing::internal::CaptureStdout();
  ::testing::internal::CaptureStderr();
  EXPECT_EQ(Ask(Deed::kSpeak).value_or(-1), 0);
  EXPECT_EQ(Ask(Deed::kThrow).status().code(), kUnavailable);
  EXPECT_EQ(::testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(Ask(Deed::kCountDescriptors).value_or(-1), 4) << "three standard ones and its socket";
  EXPECT_EQ(Ask(Deed::kLimitOfCoreFiles).value_or(-1), 0);
  EXPECT_EQ(Ask(Deed::kIsDumpable).value_or(-1), 0);
  close(ours);
}

TEST_F(DecoderProcessTest, OurSignalHandlersAreNotTheChilds) {
  const auto before = std::signal(SIGABRT, [](int) { _exit(99); });
  const absl::Status status = Ask(Deed::kAbort).status();
  std::signal(SIGABRT, before);
  EXPECT_THAT(status, StatusIs(kUnavailable, HasSubstr("SIGABRT")));
  EXPECT_EQ(Ask(Deed::kRaiseTerminalSignals).value_or(-1), 0)
      << "a terminal's signals do not end it";
}

TEST_F(DecoderProcessTest, NoProcessIsLeftBehind) {
  for (const bool is_dead : {false, true}) {
    DecoderProcess other({Handle, sizeof(Request), sizeof(Answer), kSharedBytes});
    ISOSCOPE_ASSERT_OK(other.Start());
    if (is_dead) {
      kill(other.pid(), SIGKILL);
    }
  }
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
  EXPECT_EQ(errno, ECHILD);
}

TEST_F(DecoderProcessTest, WithoutAProcessToBeHadTheErrorSaysSo) {
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit none{.rlim_cur = 0, .rlim_max = before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &none), 0);
  const absl::Status status = process_.Start();
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &before), 0);
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("ulimit")));
  ExpectAnswers();
}

// A process with two children of this kind, which ends without telling them.
[[noreturn]] void LeaveChildren(int pipe_end) {
  DecoderProcess first({Handle, sizeof(Request), sizeof(Answer), kSharedBytes});
  DecoderProcess second({Handle, sizeof(Request), sizeof(Answer), kSharedBytes});
  Answer answer;
  const bool is_ok =
      first.Ask(Request{}, {}, &answer).ok() && second.Ask(Request{}, {}, &answer).ok();
  const std::array<pid_t, 2> children{first.pid(), second.pid()};
  const bool is_told = write(pipe_end, children.data(), sizeof(children)) == sizeof(children);
  _exit(is_ok && is_told ? 0 : 1);
}

TEST_F(DecoderProcessTest, ChildEndsWithAParentThatIsGone) {
  ASSERT_EQ(prctl(PR_SET_CHILD_SUBREAPER, 1), 0);  // its orphans become ours
  std::array<int, 2> ends{};
  ASSERT_EQ(pipe(ends.data()), 0);
  const pid_t parent = fork();
  ASSERT_GE(parent, 0);
  if (parent == 0) {
    LeaveChildren(ends[1]);
  }
  close(ends[1]);
  std::array<pid_t, 2> children{};
  EXPECT_EQ(read(ends[0], children.data(), sizeof(children)), sizeof(children));
  close(ends[0]);
  int status = -1;
  EXPECT_EQ(waitpid(parent, &status, 0), parent);
  EXPECT_EQ(status, 0);
  for (const pid_t child : children) {
    EXPECT_EQ(waitpid(child, &status, 0), child);
    EXPECT_EQ(status, 0) << "it ended by itself";
  }
}

}  // namespace
}  // namespace isoscope::source
