// isoscope top --server HOST:PORT
//
// On a terminal the table fills the alternate screen, which leaves what was there before as it was.
// The keys come unbuffered and unechoed. A destructor restores the terminal, also after an error,
// an interrupt (Ctrl-C, SIGTERM) or q. Elsewhere one table follows the other as plain text.

#include <poll.h>
#include <termios.h>
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
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <sys/eventfd.h>
#include <sys/ioctl.h>

#include "client-cli/command.h"
#include "client-cli/connection_flags.h"
#include "client-cli/flags.h"
#include "client-cli/parse_value.h"
#include "client-cli/service_client.h"
#include "client-cli/session.h"
#include "client-cli/top_screen.h"
#include "client-cli/usage.h"
#include "core/base/status_macros.h"

namespace isoscope::cli {
namespace {

constexpr absl::Duration kDefaultInterval = absl::Seconds(2);
constexpr absl::Duration kLeastInterval = absl::Milliseconds(100);
// Rates look back so far: over some of the questions that the coordinator asks its agents.
constexpr absl::Duration kRateWindow = absl::Seconds(4);
constexpr absl::Duration kDefaultTimeout = absl::Seconds(10);

struct TopFlags {
  std::optional<std::string> server;
  ConnectionFlags connection;
  std::optional<absl::Duration> interval;
  std::optional<absl::Duration> timeout;
  bool is_once = false;
};

bool IsTerminal() { return ::isatty(STDOUT_FILENO) == 1; }

// The size of the terminal; that of old ones if it tells none.
void SetSize(TopScreenOptions* options) {
  winsize size{};
  if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 && size.ws_row > 0) {
    options->width = size.ws_col;
    options->height = size.ws_row;
  } else {
    options->width = 80;
    options->height = 24;
  }
}

// The terminal while the table is on it.
class LiveScreen {
 public:
  explicit LiveScreen(std::ostream* out) : out_(out) {
    has_keys_ = ::isatty(STDIN_FILENO) == 1 && ::tcgetattr(STDIN_FILENO, &before_) == 0;
    if (has_keys_) {
      termios raw = before_;
      raw.c_lflag &= static_cast<tcflag_t>(~(ICANON | ECHO));
      raw.c_cc[VMIN] = 0;
      raw.c_cc[VTIME] = 0;
      ::tcsetattr(STDIN_FILENO, TCSANOW, &raw);
    }
    *out_ << "\x1b[?1049h\x1b[?25l" << std::flush;  // the alternate screen, no cursor
  }
  ~LiveScreen() {
    *out_ << "\x1b[?25h\x1b[?1049l" << std::flush;
    if (has_keys_) {
      ::tcsetattr(STDIN_FILENO, TCSANOW, &before_);
    }
  }
  LiveScreen(const LiveScreen&) = delete;
  LiveScreen& operator=(const LiveScreen&) = delete;

  // Writes over what is there, so that nothing flickers.
  void Show(const std::vector<std::string>& lines) {
    std::string text = "\x1b[H";
    for (std::size_t i = 0; i < lines.size(); ++i) {
      absl::StrAppend(&text, i > 0 ? "\r\n" : "", lines[i], "\x1b[K");
    }
    *out_ << text << "\x1b[J" << std::flush;
  }

  [[nodiscard]] bool has_keys() const { return has_keys_; }

 private:
  std::ostream* const out_;
  termios before_{};
  bool has_keys_ = false;
};

// Waits for time, a key and an interrupt at once.
class Waiter {
 public:
  explicit Waiter(const base::Cancellation& cancellation) : event_(::eventfd(0, EFD_CLOEXEC)) {
    on_cancel_.emplace(cancellation, [this] {
      const std::uint64_t one = 1;
      [[maybe_unused]] const ssize_t written = ::write(event_, &one, sizeof(one));
    });
  }
  ~Waiter() {
    // The callback may be writing: it ends before the descriptor does.
    on_cancel_.reset();
    if (event_ >= 0) {
      ::close(event_);
    }
  }
  Waiter(const Waiter&) = delete;
  Waiter& operator=(const Waiter&) = delete;

  // Returns false if the program is to end: after an interrupt, or the key q.
  bool Wait(absl::Duration duration, bool has_keys) {
    const absl::Time end = absl::Now() + duration;
    while (true) {
      pollfd waited[2] = {{.fd = event_, .events = POLLIN, .revents = 0},
                          {.fd = has_keys ? STDIN_FILENO : -1, .events = POLLIN, .revents = 0}};
      const std::int64_t rest = absl::ToInt64Milliseconds(end - absl::Now());
      const int ready =
          ::poll(waited, 2, static_cast<int>(std::clamp<std::int64_t>(rest, 0, 60'000)));
      if ((waited[0].revents & POLLIN) != 0) {
        return false;
      }
      char key = 0;
      if (ready > 0 && waited[1].revents != 0) {
        const ssize_t count = ::read(STDIN_FILENO, &key, 1);
        if (count == 0) {
          has_keys = false;  // the other side of the terminal is gone
        } else if (count == 1 && (key == 'q' || key == 'Q')) {
          return false;
        }
      }
      if (absl::Now() >= end) {
        return true;
      }
    }
  }

 private:
  const int event_;
  std::optional<base::Cancellation::Callback> on_cancel_;
};

class Top {
 public:
  Top(const TopFlags& flags, const Context& context) : flags_(flags), context_(context) {}

  absl::Status Run() {
    SessionFlags session_flags;
    session_flags.server = flags_.server;
    session_flags.connection = flags_.connection;
    ISOSCOPE_ASSIGN_OR_RETURN(session_, Session::Open(session_flags, std::nullopt, context_));
    ISOSCOPE_RETURN_IF_ERROR(Sample());  // a server that is not there is told in plain text
    if (flags_.is_once) {
      Print();
      return absl::OkStatus();
    }
    std::optional<LiveScreen> screen;
    if (IsTerminal()) {
      screen.emplace(context_.out);
    }
    Waiter waiter(context_.interrupt->cancellation());
    while (true) {
      if (screen.has_value()) {
        ShowOn(&*screen);
      } else {
        Print();
        *context_.out << std::endl;
      }
      if (!waiter.Wait(flags_.interval.value_or(kDefaultInterval),
                       screen.has_value() && screen->has_keys())) {
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
    samples_.push_back({absl::Now(), std::move(status)});
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
      lines[0] = absl::StrCat("isoscope top: ", error_.message())
                     .substr(0, options.width > 0 ? static_cast<std::size_t>(options.width)
                                                  : std::string::npos);
    }
    return lines;
  }

  void Print() const {
    TopScreenOptions options;
    if (IsTerminal()) {
      SetSize(&options);
      options.height = 0;  // it scrolls
    }
    for (const std::string& line : Lines(options)) {
      *context_.out << line << "\n";
    }
  }

  void ShowOn(LiveScreen* screen) const {
    TopScreenOptions options;
    SetSize(&options);
    screen->Show(Lines(options));
  }

  const TopFlags& flags_;
  const Context& context_;
  std::unique_ptr<Session> session_;
  std::deque<ClusterSample> samples_;  // the newest last; the oldest is what rates refer to
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

Action RegisterFlags(CLI::App* app) {
  const auto flags = std::make_shared<TopFlags>();
  AddFlag(app, "--server", "HOST:PORT", &flags->server, ParseHostPort, "a coordinator");
  AddConnectionFlags(app, &flags->connection);
  AddFlag(app, "--interval", "SECONDS", &flags->interval, ParseSeconds,
          "time between two looks, at least 0.1 (default: 2); agents tell their load every 2 "
          "seconds");
  app->add_flag("--once", flags->is_once,
                "print one table and end; its rates are those since each process began");
  AddFlag(app, "--timeout", "SECONDS", &flags->timeout, ParseSeconds,
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
          .register_flags = RegisterFlags};
}

}  // namespace isoscope::cli
