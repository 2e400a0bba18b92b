#include "tests/support/process.h"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <fstream>
#include <sstream>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include "core/base/check.h"
#include "core/base/monotonic_time.h"

namespace isoscope::testing {
namespace {

constexpr absl::Duration kPollInterval = absl::Milliseconds(5);
constexpr int kExecFailed = 127;
constexpr int kSignalBase = 128;

std::string ReadAll(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

// Fields 3 (state) and on of /proc/PID/stat; the name before them may hold anything.
std::vector<std::string> StatFields(pid_t pid) {
  const std::string stat = ReadAll(absl::StrCat("/proc/", pid, "/stat"));
  const std::size_t end_of_name = stat.rfind(')');
  if (end_of_name == std::string::npos) {
    return {};
  }
  return absl::StrSplit(stat.substr(end_of_name + 2), ' ');
}

std::vector<char*> Pointers(const std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  pointers.reserve(texts.size() + 1);
  for (const std::string& text : texts) {
    pointers.push_back(const_cast<char*>(text.c_str()));
  }
  pointers.push_back(nullptr);
  return pointers;
}

// The child between fork and exec: only calls that are safe there.
[[noreturn]] void Exec(char* const* argv, char* const* environment, const char* out_path,
                       const char* err_path, std::int64_t max_file_bytes) {
  setpgid(0, 0);
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  const int in = open("/dev/null", O_RDONLY | O_CLOEXEC);
  const int out = open(out_path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  const int err = open(err_path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
  if (in < 0 || out < 0 || err < 0 || dup2(in, STDIN_FILENO) < 0 || dup2(out, STDOUT_FILENO) < 0 ||
      dup2(err, STDERR_FILENO) < 0) {
    _exit(kExecFailed);
  }
  if (max_file_bytes >= 0) {
    signal(SIGXFSZ, SIG_IGN);  // survives exec: writes fail with EFBIG instead
    const rlimit limit{static_cast<rlim_t>(max_file_bytes), static_cast<rlim_t>(max_file_bytes)};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  execve(argv[0], argv, environment);
  constexpr std::array<char, 27> kMessage{"can't execute the program\n"};
  static_cast<void>(!write(STDERR_FILENO, kMessage.data(), kMessage.size() - 1));
  _exit(kExecFailed);
}

}  // namespace

absl::StatusOr<std::unique_ptr<Process>> Process::Start(const std::vector<std::string>& argv,
                                                        const ProcessOptions& options) {
  ISOSCOPE_CHECK(!argv.empty());
  std::unique_ptr<Process> process(new Process());
  const std::string out_path = process->captured_.Sub("out");
  const std::string err_path = process->captured_.Sub("err");
  std::vector<std::string> environment = options.environment;
  for (char** entry = environ; *entry != nullptr; ++entry) {
    environment.emplace_back(*entry);  // the first of several wins
  }
  const std::vector<char*> argv_pointers = Pointers(argv);
  const std::vector<char*> environment_pointers = Pointers(environment);
  const pid_t pid = fork();
  if (pid < 0) {
    return absl::UnavailableError(absl::StrCat("fork: ", std::strerror(errno)));
  }
  if (pid == 0) {
    Exec(argv_pointers.data(), environment_pointers.data(), out_path.c_str(), err_path.c_str(),
         options.max_file_bytes);
  }
  setpgid(pid, pid);  // whoever comes first; afterwards the group can be killed
  process->pid_ = pid;
  return process;
}

Process::~Process() { Kill(); }

void Process::Signal(int number) const {
  if (!exit_code_.has_value()) {
    kill(pid_, number);
  }
}

void Process::Stop() const {
  Signal(SIGSTOP);
  const base::MonotonicTime deadline = base::MonotonicNow() + kPatience;
  while (base::MonotonicNow() < deadline) {
    const std::vector<std::string> fields = StatFields(pid_);
    if (fields.empty() || fields[0] == "T" || fields[0] == "Z") {
      return;
    }
    absl::SleepFor(kPollInterval);
  }
}

void Process::Kill() {
  if (pid_ > 0 && !exit_code_.has_value()) {
    kill(-pid_, SIGKILL);
    TryReap(0);
  }
}

bool Process::TryReap(int flags) {
  if (exit_code_.has_value()) {
    return true;
  }
  int status = 0;
  pid_t reaped = 0;
  do {
    reaped = waitpid(pid_, &status, flags);
  } while (reaped < 0 && errno == EINTR);
  if (reaped != pid_) {
    return false;
  }
  exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : kSignalBase + WTERMSIG(status);
  return true;
}

absl::StatusOr<int> Process::Wait(absl::Duration timeout) {
  const base::MonotonicTime deadline = base::MonotonicNow() + timeout;
  while (!TryReap(WNOHANG)) {
    if (base::MonotonicNow() >= deadline) {
      return absl::DeadlineExceededError(absl::StrCat("process ", pid_, " still runs after ",
                                                      absl::FormatDuration(timeout),
                                                      "; it printed\n", out(), err()));
    }
    absl::SleepFor(kPollInterval);
  }
  return *exit_code_;
}

std::string Process::out() const { return ReadAll(captured_.Sub("out")); }
std::string Process::err() const { return ReadAll(captured_.Sub("err")); }

absl::StatusOr<std::string> Process::WaitForErrLine(absl::string_view text) {
  return WaitForLine(captured_.Sub("err"), text);
}
absl::StatusOr<std::string> Process::WaitForOutLine(absl::string_view text) {
  return WaitForLine(captured_.Sub("out"), text);
}

absl::StatusOr<std::string> Process::WaitForLine(const std::string& path, absl::string_view text) {
  const base::MonotonicTime deadline = base::MonotonicNow() + kPatience;
  while (true) {
    const bool has_ended = TryReap(WNOHANG);  // before reading: then nothing is missed
    const std::string printed = ReadAll(path);
    const std::size_t found = printed.find(text.data(), 0, text.size());
    const std::size_t end = printed.find('\n', found == std::string::npos ? 0 : found);
    if (found != std::string::npos && end != std::string::npos) {
      const std::size_t newline = printed.rfind('\n', found);
      const std::size_t begin = newline == std::string::npos ? 0 : newline + 1;
      return printed.substr(begin, end - begin);
    }
    if (has_ended) {
      return absl::FailedPreconditionError(absl::StrCat("the process ended with ", *exit_code_,
                                                        " without \"", text, "\"; it printed\n",
                                                        out(), err()));
    }
    if (base::MonotonicNow() >= deadline) {
      return absl::DeadlineExceededError(
          absl::StrCat("the process never printed \"", text, "\", but\n", out(), err()));
    }
    absl::SleepFor(kPollInterval);
  }
}

absl::Duration Process::CpuTime() const {
  // utime and stime, fields 14 and 15 of all.
  const std::vector<std::string> fields = StatFields(pid_);
  if (fields.size() < 13) {
    return absl::ZeroDuration();
  }
  const double ticks = std::stod(fields[11]) + std::stod(fields[12]);
  return absl::Seconds(ticks / static_cast<double>(sysconf(_SC_CLK_TCK)));
}

CommandResult RunCommand(const std::vector<std::string>& argv, const ProcessOptions& options) {
  CommandResult result;
  absl::StatusOr<std::unique_ptr<Process>> process = Process::Start(argv, options);
  if (!process.ok()) {
    result.err = process.status().ToString();
    return result;
  }
  const absl::StatusOr<int> exit_code = (*process)->Wait(kPatience);
  result.out = (*process)->out();
  result.err = exit_code.ok() ? (*process)->err() : exit_code.status().ToString();
  result.exit_code = exit_code.value_or(-1);
  return result;
}

}  // namespace isoscope::testing
