#include "core/cli/usage.h"

#include <algorithm>
#include <cstddef>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"

#include "core/base/printable.h"

namespace isoscope::cli {
namespace {

constexpr absl::string_view kUsagePayload = "isoscope.cli/wrong-usage";

// Levenshtein's distance: O(a * b).
std::size_t EditDistance(absl::string_view a, absl::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) {
    row[j] = j;
  }
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, replaced});
    }
  }
  return row[b.size()];
}

}  // namespace

absl::Status UsageError(absl::string_view message) {
  absl::Status status = absl::InvalidArgumentError(message);
  status.SetPayload(kUsagePayload, absl::Cord());
  return status;
}

absl::Status AsUsageError(const absl::Status& status) {
  return absl::IsInvalidArgument(status) ? UsageError(status.message()) : status;
}

bool IsUsageError(const absl::Status& status) {
  return status.GetPayload(kUsagePayload).has_value();
}

ExitCode ExitCodeOf(const absl::Status& status) {
  if (status.ok()) {
    return kExitDone;
  }
  return IsUsageError(status) ? kExitWrongUsage : kExitFailed;
}

std::string FormatError(absl::string_view program, absl::string_view command,
                        const absl::Status& status) {
  // One line, whatever the message of a library or a server looks like.
  const std::string message =
      base::Printable(absl::StrReplaceAll(status.message(), {{"\r\n", "; "}, {"\n", "; "}}));
  if (IsUsageError(status)) {
    const std::string typed = absl::StrCat(program, command.empty() ? "" : " ", command);
    return absl::StrCat(typed, ": ", message, " (see '", typed, " --help')");
  }
  return absl::StrCat(program, ": ", absl::StatusCodeToString(status.code()), ": ", message);
}

std::string NearestName(absl::string_view typed, const std::vector<std::string>& known) {
  // A single letter is near to any other. A stranger may send words longer than any name.
  constexpr std::size_t kMinLength = 2;
  constexpr std::size_t kMaxLength = 256;
  std::string nearest;
  if (typed.size() < kMinLength || typed.size() > kMaxLength) {
    return nearest;
  }
  // A word with more than a third of its letters wrong counts as another word.
  std::size_t best = std::max<std::size_t>(1, typed.size() / 3) + 1;
  for (const std::string& name : known) {
    if (name.size() >= typed.size() + best || typed.size() >= name.size() + best) {
      continue;
    }
    const std::size_t distance = EditDistance(typed, name);
    if (distance < best) {
      best = distance;
      nearest = name;
    }
  }
  return nearest;
}

}  // namespace isoscope::cli
