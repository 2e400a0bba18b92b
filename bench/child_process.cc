// RunChild, from start to end:
//
// 1. It makes two pipes, one for standard output and one for standard error. Standard input is
//    /dev/null.
// 2. The child starts in a process group of its own, whose number is its process id. No signal is
//    blocked in it, and SIGINT, SIGTERM and SIGPIPE have their default actions.
// 3. This process closes its write ends. Otherwise the read ends would never report an end.
// 4. It polls both pipes and reads them to their ends, so that the child never waits for a full
//    pipe.
// 5. It waits for the child with WNOWAIT, which keeps the process id in use. The callback that
//    sends SIGTERM ends before waitpid frees that id, so no other process gets the signal.
// Source: POSIX.1-2017, posix_spawn and waitid.

#include "bench/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>  // NOLINT(modernize-deprecated-headers): kill is POSIX, not <csignal>
#include <spawn.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include <sys/types.h>
#include <sys/wait.h>

#include "core/base/status_macros.h"
#include "core/io/file.h"

namespace isoscope::bench {
namespace {

constexpr std::size_t kReadBytes = 64 << 10;
constexpr int kSignalExitBase = 128;

// Both ends, closed when the object ends.
class Pipe {
 public:
  static absl::StatusOr<Pipe> Make() {
    std::array<int, 2> ends{};
    if (pipe2(ends.data(), O_CLOEXEC) != 0) {
      return io::ErrnoToStatus(errno, "can't make", "a pipe");
    }
    return Pipe(ends[0], ends[1]);
  }
  Pipe(Pipe&& other) noexcept
      : read_end_(std::exchange(other.read_end_, -1)),
        write_end_(std::exchange(other.write_end_, -1)) {}
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  Pipe& operator=(Pipe&&) = delete;
  ~Pipe() {
    CloseWriteEnd();
    if (read_end_ >= 0) {
      close(read_end_);
    }
  }

  [[nodiscard]] int read_end() const { return read_end_; }
  [[nodiscard]] int write_end() const { return write_end_; }
  void CloseWriteEnd() {
    if (write_end_ >= 0) {
      close(std::exchange(write_end_, -1));
    }
  }

 private:
  Pipe(int read_end, int write_end) : read_end_(read_end), write_end_(write_end) {}

  int read_end_;
  int write_end_;
};

// Starts the child in a process group of its own, with no signal blocked and with the default
// action for those that this process handles.
absl::StatusOr<pid_t> Spawn(const std::vector<std::string>& argv,
                            const std::string& working_directory, const Pipe& out,
                            const Pipe& err) {
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  const absl::Cleanup destroy_actions = [&] { posix_spawn_file_actions_destroy(&actions); };
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, out.write_end(), STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, err.write_end(), STDERR_FILENO);
  if (!working_directory.empty()) {
    posix_spawn_file_actions_addchdir_np(&actions, working_directory.c_str());
  }
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  const absl::Cleanup destroy_attributes = [&] { posix_spawnattr_destroy(&attributes); };
  sigset_t signals;
  sigemptyset(&signals);
  posix_spawnattr_setsigmask(&attributes, &signals);
  for (const int signal_number : {SIGINT, SIGTERM, SIGPIPE}) {
    sigaddset(&signals, signal_number);
  }
  posix_spawnattr_setsigdefault(&attributes, &signals);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setflags(&attributes,
                           POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  std::vector<char*> arguments;
  arguments.reserve(argv.size() + 1);
  for (const std::string& argument : argv) {
    arguments.push_back(const_cast<char*>(argument.c_str()));  // POSIX: not changed
  }
  arguments.push_back(nullptr);
  pid_t pid = -1;
  const int error =
      posix_spawnp(&pid, argv[0].c_str(), &actions, &attributes, arguments.data(), environ);
  if (error != 0) {
    return io::ErrnoToStatus(error, "can't run", argv[0]);
  }
  return pid;
}

// Reads both pipes to their ends.
void ReadAll(const Pipe& out, const Pipe& err, ChildResult* result) {
  std::array<pollfd, 2> polled{pollfd{out.read_end(), POLLIN, 0},
                               pollfd{err.read_end(), POLLIN, 0}};
  const std::array<std::string*, 2> texts{&result->out, &result->err};
  std::vector<char> buffer(kReadBytes);
  while (polled[0].fd >= 0 || polled[1].fd >= 0) {
    if (poll(polled.data(), polled.size(), -1) < 0) {
      continue;  // EINTR
    }
    for (std::size_t i = 0; i < polled.size(); ++i) {
      if (polled[i].fd < 0 || polled[i].revents == 0) {
        continue;
      }
      const ssize_t count = read(polled[i].fd, buffer.data(), buffer.size());
      if (count > 0) {
        texts[i]->append(buffer.data(), static_cast<std::size_t>(count));
      } else if (count == 0 || errno != EINTR) {
        polled[i].fd = -1;  // poll skips it
      }
    }
  }
}

}  // namespace

absl::StatusOr<ChildResult> RunChild(const std::vector<std::string>& argv,
                                     const std::string& working_directory,
                                     cli::Interrupt* interrupt) {
  ISOSCOPE_ASSIGN_OR_RETURN(Pipe out, Pipe::Make());
  ISOSCOPE_ASSIGN_OR_RETURN(Pipe err, Pipe::Make());
  ISOSCOPE_ASSIGN_OR_RETURN(const pid_t pid, Spawn(argv, working_directory, out, err));
  out.CloseWriteEnd();
  err.CloseWriteEnd();
  ChildResult result;
  {
    // The process is not reaped before the scope ends, so its number is not reused.
    const base::Cancellation::Callback on_interrupt(interrupt->cancellation(),
                                                    [pid] { kill(-pid, SIGTERM); });
    ReadAll(out, err, &result);
    siginfo_t info{};
    while (waitid(P_PID, static_cast<id_t>(pid), &info, WEXITED | WNOWAIT) != 0 && errno == EINTR) {
    }
  }
  int status = 0;
  while (waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  if (interrupt->cancellation().is_cancelled()) {
    return absl::CancelledError("interrupted");
  }
  result.exit_code = WIFSIGNALED(status) ? kSignalExitBase + WTERMSIG(status) : WEXITSTATUS(status);
  return result;
}

std::string LastLine(const std::string& text) {
  std::string last;
  for (const absl::string_view line : absl::StrSplit(text, '\n')) {
    const absl::string_view stripped = absl::StripAsciiWhitespace(line);
    if (!stripped.empty()) {
      last = absl::StrCat(stripped);
    }
  }
  return last;
}

}  // namespace isoscope::bench
