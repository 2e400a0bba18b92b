// Both processes are the same program: a request is one packet, the limits and the bytes of the
// request, and an answer is another. A packet arrives whole or not at all (SOCK_SEQPACKET).
//
//   parent                                child
//   fork, close the child's end    ->     signals, descriptors, limits
//   send(limits, request)          ->     set the limits, run the handler
//   poll, recv                     <-     send(answer)
//   an interrupt: SIGKILL          ->
//   close                          ->     recv gives 0 bytes: _exit
//
// The parent notices a death as the end of the socket. It notices a hang by a limit of CPU time
// (SIGXCPU) or of the clock. The kernel may keep a killed child that waits for a disk: the parent
// does not wait for such a child for long. PR_SET_PDEATHSIG is not used: it fires when the thread
// that forked ends, not the process.

#include "core/source/child/decoder_process.h"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/time.h"
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>

#include "core/base/check.h"
#include "core/base/monotonic_time.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/io/mounted_file.h"

namespace isoscope::source {
namespace {

constexpr int kChildSocket = 3;  // behind the standard descriptors
constexpr int kFarSocket = 4;    // of FarFiles, if there are some

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kHasSanitizer = true;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
constexpr bool kHasSanitizer = true;
#else
constexpr bool kHasSanitizer = false;
#endif
#else
constexpr bool kHasSanitizer = false;
#endif

// Repeats a system call that a signal interrupted.
template <typename Call>
auto Retry(Call call) {
  auto result = call();
  while (result < 0 && errno == EINTR) {
    result = call();
  }
  return result;
}

// ---- The child. -------------------------------------------------------------------------------

// Bytes of address space in use; 0 if that can't be known.
std::int64_t AddressSpaceBytes() {
  std::array<char, 64> text{};
  const int file = open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
  if (file < 0) {
    return 0;
  }
  const ssize_t size = read(file, text.data(), text.size() - 1);
  close(file);
  return size > 0 ? std::strtoll(text.data(), nullptr, 10) * sysconf(_SC_PAGESIZE) : 0;
}

// Sets the soft limit of the process, never above its present one.
void SetLimit(decltype(RLIMIT_CORE) resource, rlim_t value) {
  rlimit limit{};
  if (getrlimit(resource, &limit) == 0) {
    limit.rlim_cur = std::min(value, limit.rlim_max);
    setrlimit(resource, &limit);
  }
}

void Limit(const DecoderProcess::Limits& limits, std::int64_t bytes_at_start) {
  timespec used{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used);
  SetLimit(RLIMIT_CPU, static_cast<rlim_t>(used.tv_sec + 1 + limits.cpu_seconds));
  if (bytes_at_start > 0 && !kHasSanitizer) {
    SetLimit(RLIMIT_AS, static_cast<rlim_t>(bytes_at_start + limits.memory_bytes));
  }
}

// Detaches the child from the parent: from its signals, its descriptors and its terminal.
// Sockets that are not there are below 0.
void BecomeChild(int socket, int far_socket) {
  for (int number = 1; number < NSIG; ++number) {
    std::signal(number, SIG_DFL);
  }
  // The child ignores the signals of a terminal. It ends when its parent is done.
  for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) {
    std::signal(number, SIG_IGN);
  }
  // Out of each other's way first.
  const int far_copy = far_socket < 0 ? -1 : fcntl(far_socket, F_DUPFD, kFarSocket + 1);
  if ((far_socket >= 0 && far_copy < 0) || dup2(socket, kChildSocket) < 0 ||
      (far_copy >= 0 && dup2(far_copy, kFarSocket) < 0)) {
    _exit(1);
  }
  closefrom(far_copy >= 0 ? kFarSocket + 1 : kChildSocket + 1);
  const int nowhere = open("/dev/null", O_RDWR);
  for (const int standard : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (nowhere < 0 || dup2(nowhere, standard) < 0) {
      _exit(1);  // rather than write fields of a patient somewhere
    }
  }
  if (nowhere > kFarSocket || (nowhere == kFarSocket && far_copy < 0)) {
    close(nowhere);
  }
  SetLimit(RLIMIT_CORE, 0);
  prctl(PR_SET_DUMPABLE, 0);  // nor to a program that collects core files
  sigset_t none;
  sigemptyset(&none);
  pthread_sigmask(SIG_SETMASK, &none, nullptr);
}

// An exception in here ends the child, and never leaves it.
[[noreturn]] void RunChild(int socket, const DecoderProcess::Job& job, char* shared,
                           const FarFiles* far_files) noexcept {
  BecomeChild(socket, far_files == nullptr ? -1 : far_files->child_socket());
  if (far_files != nullptr) {
    far_files->MountInChild(kFarSocket);
  }
  const std::int64_t bytes_at_start = AddressSpaceBytes();
  std::vector<char> packet(sizeof(DecoderProcess::Limits) + job.request_bytes);
  std::vector<char> answer(job.answer_bytes);
  while (true) {
    const ssize_t size = Retry([&] { return recv(kChildSocket, packet.data(), packet.size(), 0); });
    if (size != static_cast<ssize_t>(packet.size())) {
      _exit(0);  // the parent is gone, or done
    }
    DecoderProcess::Limits limits;
    std::memcpy(&limits, packet.data(), sizeof(limits));
    Limit(limits, bytes_at_start);
    std::fill(answer.begin(), answer.end(), '\0');
    job.handler(packet.data() + sizeof(limits), answer.data(), shared);
    if (Retry([&] { return send(kChildSocket, answer.data(), answer.size(), MSG_NOSIGNAL); }) < 0) {
      _exit(0);
    }
  }
}

// ---- The parent. ------------------------------------------------------------------------------

// Forks with all signals blocked, so that no handler of the parent runs in the child.
pid_t ForkQuietly() {
  sigset_t all;
  sigset_t before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  const pid_t pid = fork();
  const int fork_errno = errno;
  if (pid != 0) {
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
    errno = fork_errno;
  }
  return pid;
}

// Returns the error for errno.
absl::Status NoProcess(absl::string_view what) {
  return absl::ResourceExhaustedError(absl::StrCat(
      absl::ErrnoToStatus(errno, absl::StrCat(what, " for a process that decodes")).message(),
      "; free memory, or raise the limits of processes and open files (ulimit -u, ulimit -n)"));
}

enum class Wait { kReady, kLate, kInterrupted };

// Waits for the socket, at most `limit`, or until the process is interrupted. Time in which this
// process is stopped does not count.
Wait WaitForAnswer(int socket, absl::Duration limit) {
  constexpr absl::Duration kStep = absl::Milliseconds(100);  // heeds an interrupt
  for (absl::Duration waited; waited < limit;) {
    if (base::ProcessInterrupt().is_cancelled()) {
      return Wait::kInterrupted;
    }
    const base::MonotonicTime begin = base::MonotonicNow();
    pollfd entry{.fd = socket, .events = POLLIN, .revents = 0};
    const int count = poll(&entry, 1, static_cast<int>(absl::ToInt64Milliseconds(kStep)));
    if (count > 0 || (count < 0 && errno != EINTR)) {
      return Wait::kReady;
    }
    waited += std::clamp(base::MonotonicNow() - begin, absl::ZeroDuration(), kStep);
  }
  return Wait::kLate;
}

// Waits for the end of a killed child, and returns its status. 0 if the kernel keeps it.
int WaitForKilled(pid_t pid) {
  constexpr int kSteps = 500;
  constexpr timespec kStep{.tv_sec = 0, .tv_nsec = 1'000'000};
  int status = 0;
  for (int step = 0; step < kSteps; ++step) {
    if (Retry([&] { return waitpid(pid, &status, WNOHANG); }) != 0) {
      return status;
    }
    nanosleep(&kStep, nullptr);
  }
  return 0;
}

std::string NameOfSignal(int number) {
  const char* name = sigabbrev_np(number);
  return name != nullptr ? absl::StrCat("SIG", name) : absl::StrCat(number);
}

}  // namespace

DecoderProcess::~DecoderProcess() {
  Stop();
  if (shared_ != nullptr) {
    munmap(shared_, job_.shared_bytes);
  }
}

absl::Status DecoderProcess::Start() {
  if (pid_ >= 0) {
    return absl::OkStatus();
  }
  if (shared_ == nullptr && job_.shared_bytes > 0) {
    void* const memory = mmap(nullptr, job_.shared_bytes, PROT_READ | PROT_WRITE,
                              MAP_SHARED | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (memory == MAP_FAILED) {
      return NoProcess(absl::StrCat("no ", job_.shared_bytes, " bytes of memory"));
    }
    shared_ = static_cast<char*>(memory);
  }
  std::unique_ptr<FarFiles> far_files;
  if (std::vector<io::MountedFile> mounted = io::AllMounted(); !mounted.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(far_files, FarFiles::Make(std::move(mounted)));
  }
  std::array<int, 2> ends{};
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends.data()) != 0) {
    return NoProcess("no socket");
  }
  const pid_t pid = ForkQuietly();
  if (pid == 0) {
    RunChild(ends[1], job_, shared_, far_files.get());
  }
  absl::Status status = pid < 0 ? NoProcess("no fork") : absl::OkStatus();
  close(ends[1]);
  if (!status.ok()) {
    close(ends[0]);
    return status;
  }
  pid_ = pid;
  socket_ = ends[0];
  if (far_files != nullptr) {
    far_files->Serve();
  }
  far_files_ = std::move(far_files);
  return absl::OkStatus();
}

bool DecoderProcess::HasMemoryLimit() { return !kHasSanitizer; }

int DecoderProcess::Stop() {
  if (pid_ < 0) {
    return 0;
  }
  close(socket_);
  int status = 0;
  // A child that is gone already keeps its status. If SIGCHLD is ignored, no process can wait for
  // children, and the id may belong to another process by now.
  const pid_t ended = Retry([&] { return waitpid(pid_, &status, WNOHANG); });
  if (ended == 0) {
    kill(pid_, SIGKILL);
    status = WaitForKilled(pid_);
  }
  pid_ = -1;
  socket_ = -1;
  far_files_ = nullptr;
  return status;
}

DecoderProcess::Outcome DecoderProcess::AskChild(const Limits& limits, void* answer) {
  // The socket of a child that waits for its next request has room.
  const ssize_t sent = Retry(
      [&] { return send(socket_, packet_.data(), packet_.size(), MSG_NOSIGNAL | MSG_DONTWAIT); });
  if (sent != static_cast<ssize_t>(packet_.size())) {
    return Outcome::kEnded;
  }
  const Wait wait = WaitForAnswer(socket_, absl::Seconds(limits.clock_seconds));
  if (wait != Wait::kReady) {
    return wait == Wait::kLate ? Outcome::kLate : Outcome::kInterrupted;
  }
  const ssize_t size =
      Retry([&] { return recv(socket_, answer, job_.answer_bytes, MSG_DONTWAIT | MSG_TRUNC); });
  return size <= 0                                         ? Outcome::kEnded
         : size == static_cast<ssize_t>(job_.answer_bytes) ? Outcome::kAnswered
                                                           : Outcome::kWrongAnswer;
}

absl::Status DecoderProcess::AskBytes(const void* request, std::size_t request_bytes,
                                      const Limits& limits, void* answer,
                                      std::size_t answer_bytes) {
  ISOSCOPE_CHECK_EQ(request_bytes, job_.request_bytes);
  ISOSCOPE_CHECK_EQ(answer_bytes, job_.answer_bytes);
  ISOSCOPE_CHECK(limits.cpu_seconds >= 1 && limits.clock_seconds >= 1);
  packet_.resize(sizeof(limits) + request_bytes);
  std::memcpy(packet_.data(), &limits, sizeof(limits));
  std::memcpy(packet_.data() + sizeof(limits), request, request_bytes);
  for (bool is_first = true;; is_first = false) {
    ISOSCOPE_RETURN_IF_ERROR(Start());
    const Outcome outcome = AskChild(limits, answer);
    if (outcome == Outcome::kAnswered) {
      return absl::OkStatus();
    }
    const int status = Stop();
    if (outcome == Outcome::kInterrupted) {
      return absl::CancelledError("interrupted");
    }
    if (outcome == Outcome::kLate) {
      return absl::DeadlineExceededError(absl::StrFormat(
          "the process that reads it did not answer for %d s: its disk does not answer or is very "
          "slow, or the machine is overloaded; try again, or copy the file to another disk",
          limits.clock_seconds));
    }
    if (outcome == Outcome::kWrongAnswer) {
      return absl::UnavailableError("its answer is of a wrong size");
    }
    const bool is_killed = WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL;
    if (!is_killed || !is_first) {
      return absl::UnavailableError(
          WIFSIGNALED(status) ? absl::StrCat("it was ended by ", NameOfSignal(WTERMSIG(status)))
                              : absl::StrCat("it ended with code ", WEXITSTATUS(status)));
    }
  }
}

}  // namespace isoscope::source
