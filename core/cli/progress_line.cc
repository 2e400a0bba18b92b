#include "core/cli/progress_line.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/monotonic_time.h"
#include "core/base/printable.h"
#include "core/cli/command.h"
#include "core/cli/format.h"

namespace isoscope::cli {
namespace {

constexpr int kBarWidth = 24;

}  // namespace

std::string FormatProgress(absl::string_view phase, std::int64_t done_bytes,
                           std::int64_t total_bytes, absl::Duration elapsed) {
  const double fraction =
      std::clamp(static_cast<double>(done_bytes) / static_cast<double>(total_bytes), 0.0, 1.0);
  std::string done = FormatMebibytes(done_bytes);
  done.erase(done.size() - 4);  // the unit stands behind the total
  std::string text =
      absl::StrFormat("%-16s %3d %%  %s of %s", phase, static_cast<int>(std::floor(fraction * 100)),
                      done, FormatMebibytes(total_bytes));
  const double seconds = absl::ToDoubleSeconds(elapsed);
  if (seconds > 0 && done_bytes > 0) {
    absl::StrAppend(
        &text, "  ",
        FormatMebibytes(static_cast<std::int64_t>(static_cast<double>(done_bytes) / seconds)),
        "/s  ", FormatElapsed(elapsed * ((1 - fraction) / fraction)), " left");
  }
  return text;
}

Context WithoutProgress(const Context& context) {
  thread_local QuietErr err(nullptr);  // commands of other threads have their own
  err.rdbuf(context.err->rdbuf());
  Context quiet = context;
  quiet.err = &err;
  quiet.err_is_terminal = false;
  return quiet;
}

ProgressLine::ProgressLine(std::ostream* err, bool is_terminal)
    : err_(err),
      is_terminal_(is_terminal),
      is_quiet_(dynamic_cast<const QuietErr*>(err) != nullptr),
      start_(base::MonotonicNow()),
      last_draw_(start_) {}

ProgressLine::~ProgressLine() {
  if (is_drawn_ && is_terminal_) {
    *err_ << "\r\x1b[K" << std::flush;
  }
}

bool ProgressLine::IsDue() {
  const base::MonotonicTime now = base::MonotonicNow();
  const absl::Duration interval = is_terminal_ ? absl::Milliseconds(100) : absl::Seconds(10);
  if (now - last_draw_ < interval) {
    return false;
  }
  last_draw_ = now;
  return true;
}

void ProgressLine::Draw(const std::string& any_text) {
  if (is_quiet_) {
    return;
  }
  const std::string text = base::Printable(any_text);
  if (is_terminal_) {
    *err_ << "\r" << text << "\x1b[K" << std::flush;
  } else {
    *err_ << text << std::endl;
  }
  is_drawn_ = true;
}

void ProgressLine::Update(absl::string_view phase, std::int64_t done_bytes,
                          std::int64_t total_bytes) {
  if (!IsDue()) {
    return;
  }
  std::string text = FormatProgress(phase, done_bytes, total_bytes, base::MonotonicNow() - start_);
  if (is_terminal_) {
    const auto filled = static_cast<std::size_t>(
        std::clamp(static_cast<double>(done_bytes) / static_cast<double>(total_bytes) * kBarWidth,
                   0.0, static_cast<double>(kBarWidth)));
    text = absl::StrCat("[", std::string(filled, '#'), std::string(kBarWidth - filled, '.'), "] ",
                        text);
  }
  Draw(text);
}

void ProgressLine::Update(absl::string_view text) {
  if (IsDue()) {
    Draw(absl::StrCat(text));
  }
}

}  // namespace isoscope::cli
