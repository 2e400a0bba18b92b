// isoscope top --server HOST:PORT
//
// On a terminal the table fills the alternate screen, which preserves the previous content, and
// keys are read one by one (RawTerminal). Otherwise tables follow one another as plain text.
//
// Rates need two samples: samples_ keeps those of the last kRateWindow, and the screen compares the
// newest with the oldest (terminal/top_screen).

#include <poll.h>
#include <signal.h>  // NOLINT(modernize-deprecated-headers): SIGSTOP is POSIX, not <csignal>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"

#include "client-cli/commands/program.h"
#include "client-cli/session/connection_flags.h"
#include "client-cli/session/session.h"
#include "client-cli/terminal/raw_terminal.h"
#include "client-cli/terminal/terminal.h"
#include "client-cli/terminal/top_screen.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/monotonic_time.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "isoscope/v1/cluster_service.pb.h"
#include "rpc/host_port.h"

namespace isoscope::cli {
namespace {

constexpr absl::Duration kDefaultInterval = absl::Seconds(2);
constexpr absl::Duration kLeastInterval = absl::Milliseconds(100);
// Rates cover this time: several polls of the agents by the coordinator.
constexpr absl::Duration kRateWindow = absl::Seconds(4);
constexpr absl::Duration kDefaultTimeout = absl::Seconds(10);

struct TopFlags {
  std::optional<std::string> server;
  ConnectionFlags connection;
  std::optional<absl::Duration> interval;
  std::optional<absl::Duration> timeout;
  bool is_once = false;
};

constexpr absl::string_view kEnterScreen = "\x1b[?1049h\x1b[?25l";  // alternate screen, no cursor
constexpr absl::string_view kLeaveScreen = "\x1b[?25h\x1b[?1049l";

// Overwrites the old text without clearing, so that the screen does not flicker.
void Show(const std::vector<std::string>& lines, std::ostream* out) {
  std::string text = "\x1b[H";
  for (std::size_t i = 0; i < lines.size(); ++i) {
    absl::StrAppend(&text, i > 0 ? "\r\n" : "", lines[i], "\x1b[K");
  }
  *out << text << "\x1b[J" << std::flush;
}

class Top {
 public:
  Top(const TopFlags& flags, const Context& context) : flags_(flags), context_(context) {}

  absl::Status Run() {
    SessionFlags session_flags;
    session_flags.server = flags_.server;
    session_flags.connection = flags_.connection;
    ISOSCOPE_ASSIGN_OR_RETURN(session_,
                              Session::Open(session_flags, nullptr, std::nullopt, context_));
    ISOSCOPE_RETURN_IF_ERROR(Sample());  // a server that can't be reached is reported in plain text
    if (flags_.is_once) {
      Print();
      return absl::OkStatus();
    }
    if (SizeOfTerminal(STDOUT_FILENO)) {
      ISOSCOPE_ASSIGN_OR_RETURN(screen_,
                                RawTerminal::Enter(STDOUT_FILENO, kEnterScreen, kLeaveScreen));
    }
    has_keys_ = screen_ != nullptr && ::isatty(STDIN_FILENO) == 1;
    const TerminalSignals signals;
    const base::Cancellation::Callback on_interrupt(context_.interrupt->cancellation(),
                                                    [] { TerminalSignals::Wake(); });
    while (true) {
      Draw();
      ISOSCOPE_ASSIGN_OR_RETURN(const bool goes_on, Wait());
      if (!goes_on) {
        return absl::OkStatus();
      }
      error_ = Sample();
      if (context_.interrupt->cancellation().is_cancelled()) {
        return absl::OkStatus();
      }
    }
  }

 private:
  absl::Status Sample() {
    ISOSCOPE_ASSIGN_OR_RETURN(
        isoscope::v1::GetClusterStatusResponse status,
        session_->client().GetClusterStatus(flags_.timeout.value_or(kDefaultTimeout)));
    samples_.push_back({base::MonotonicNow(), absl::Now(), std::move(status)});
    while (samples_.size() > 2 && samples_.back().time - samples_[1].time >= kRateWindow) {
      samples_.pop_front();
    }
    return absl::OkStatus();
  }

  [[nodiscard]] std::vector<std::string> Lines(TopScreenOptions options) const {
    options.server = *flags_.server;
    const std::optional<ClusterSample> before =
        samples_.size() > 1 ? std::optional(samples_.front()) : std::nullopt;
    std::vector<std::string> lines = TopScreen(samples_.back(), before, options);
    if (!error_.ok()) {
      lines[0] = base::PrintableAscii(absl::StrCat("isoscope top: ", error_.message()))
                     .substr(0, options.width > 0 ? static_cast<std::size_t>(options.width)
                                                  : std::string::npos);
    }
    return lines;
  }

  // Returns options with the size of the terminal that standard output is, if it is one.
  static TopScreenOptions OptionsOfTerminal() {
    TopScreenOptions options;
    if (const std::optional<TerminalSize> size = SizeOfTerminal(STDOUT_FILENO)) {
      options.width = size->columns;
      options.height = size->rows;
    }
    return options;
  }

  void Draw() const {
    if (screen_ != nullptr) {
      Show(Lines(OptionsOfTerminal()), context_.out);
    } else {
      Print();
      *context_.out << std::endl;
    }
  }

  // Waits until the next sample is due. False if the program shall end: after an interrupt, or the
  // key q.
  absl::StatusOr<bool> Wait() {
    const base::MonotonicTime end =
        base::MonotonicNow() + flags_.interval.value_or(kDefaultInterval);
    for (base::MonotonicTime now = base::MonotonicNow(); now < end; now = base::MonotonicNow()) {
      pollfd waited[2] = {{.fd = TerminalSignals::wake_fd(), .events = POLLIN, .revents = 0},
                          {.fd = has_keys_ ? STDIN_FILENO : -1, .events = POLLIN, .revents = 0}};
      // Rounded up: a wait of 0 ms would return at once.
      const std::int64_t rest_ms = absl::ToInt64Milliseconds(end - now) + 1;
      ::poll(waited, 2, static_cast<int>(std::min<std::int64_t>(rest_ms, 60'000)));
      if (context_.interrupt->cancellation().is_cancelled()) {
        return false;
      }
      const TerminalSignals::Pending pending = TerminalSignals::Take();
      if (pending.is_suspended && screen_ == nullptr) {
        ::raise(SIGSTOP);
      } else if (pending.is_suspended) {
        ISOSCOPE_RETURN_IF_ERROR(screen_->Suspend());
      }
      if (screen_ != nullptr && (pending.is_suspended || pending.is_resized)) {
        Draw();
      }
      if (waited[1].revents != 0) {
        const absl::StatusOr<std::string> keys =
            ReadFromTerminal(STDIN_FILENO, absl::ZeroDuration());
        has_keys_ = keys.ok();  // else the terminal is gone
        if (keys.ok() && keys->find_first_of("qQ") != std::string::npos) {
          return false;
        }
      }
    }
    return true;
  }

  void Print() const {
    TopScreenOptions options = OptionsOfTerminal();
    options.height = 0;  // plain text scrolls
    for (const std::string& line : Lines(options)) {
      *context_.out << line << "\n";
    }
  }

  const TopFlags& flags_;
  const Context& context_;
  std::unique_ptr<Session> session_;
  std::unique_ptr<RawTerminal> screen_;  // null: the tables go to a file or a pipe
  bool has_keys_ = false;
  std::deque<ClusterSample> samples_;  // the newest last; rates refer to the oldest
  absl::Status error_;
};

absl::Status Run(const TopFlags& flags, const Context& context) {
  if (!flags.server) {
    return UsageError("--server HOST:PORT is missing: the coordinator to look at");
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.connection));
  if (flags.interval && *flags.interval < kLeastInterval) {
    return UsageError("--interval must be at least 0.1 seconds");
  }
  if (flags.is_once && flags.interval) {
    return UsageError("--interval can't be used with --once, which prints one table");
  }
  return Top(flags, context).Run();
}

Action RegisterTopFlags(FlagSet* set) {
  const auto flags = std::make_shared<TopFlags>();
  AddFlag(set, "--server", "HOST[:PORT]", &flags->server, rpc::ParseCoordinatorAddress,
          "a coordinator");
  AddConnectionFlags(set, &flags->connection);
  AddFlag(set, "--interval", "SECONDS", &flags->interval, client::ParseSeconds,
          "time between two looks, at least 0.1 (default: 2); agents tell their load every 2 "
          "seconds");
  set->AddSwitch("--once", &flags->is_once,
                 "print one table and end; its rates are those since each process began");
  AddFlag(set, "--timeout", "SECONDS", &flags->timeout, client::ParseSeconds,
          "how long to wait for the server (default: 10)");
  return [flags](const Context& context) { return Run(*flags, context); };
}

}  // namespace

Command TopCommand() {
  return {.name = "top",
          .summary = "Shows what a server's coordinator and agents do, live; q ends it",
          .usage = "--server HOST:PORT [--interval SECONDS] [--once]",
          .examples =
              "  isoscope top --server localhost:50051\n"
              "  isoscope top --server localhost:50051 --once\n",
          .register_flags = RegisterTopFlags};
}

}  // namespace isoscope::cli
