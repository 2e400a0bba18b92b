#include "server/cluster/agent_list.h"

#include <cstddef>
#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "rpc/host_port.h"

namespace isoscope::server {
namespace {

constexpr std::size_t kMaxListBytes = std::size_t{1} << 20;

}  // namespace

absl::StatusOr<std::optional<std::string>> ParseAgentListTarget(absl::string_view target) {
  absl::string_view path = target;
  if (!absl::ConsumePrefix(&path, "file:")) {
    return std::nullopt;
  }
  if (path.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("agent target \"", target, "\": must be file:PATH, of a list of agents"));
  }
  return std::string(path);
}

absl::StatusOr<std::vector<std::string>> ReadAgentList(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, io::ReadWholeFile(path, kMaxListBytes));
  std::set<std::string> targets;
  int number = 0;
  for (absl::string_view line : absl::StrSplit(text, '\n')) {
    ++number;
    line = absl::StripAsciiWhitespace(line.substr(0, line.find('#')));
    if (line.empty()) {
      continue;
    }
    if (line.find_first_of(" \t") != absl::string_view::npos || absl::StartsWith(line, "dns:///") ||
        absl::StartsWith(line, "file:")) {
      return absl::InvalidArgumentError(absl::StrCat(path, ", line ", number, ": \"", line,
                                                     "\" is not the HOST[:PORT] of one agent"));
    }
    targets.insert(rpc::WithDefaultPort(line, rpc::kAgentPort));
  }
  if (targets.empty()) {  // or a program has not finished writing it
    return absl::InvalidArgumentError(absl::StrCat(path, " names no agent"));
  }
  return std::vector<std::string>(targets.begin(), targets.end());
}

}  // namespace isoscope::server
