#include "core/source/bytes/part_path.h"

#include <algorithm>
#include <cstddef>

#include "absl/strings/match.h"

namespace isoscope::source {

bool HasEnding(const std::string& path, absl::string_view ending) {
  return absl::EndsWithIgnoreCase(path, ending) &&
         (absl::StartsWith(ending, ".") || path.size() == ending.size() ||
          path[path.size() - ending.size() - 1] == '/');
}

bool SplitPartPath(const std::string& path, const std::vector<std::string>& endings,
                   PartPath* parts) {
  const auto is_file = [&](const std::string& name) {
    return std::any_of(endings.begin(), endings.end(),
                       [&](const std::string& ending) { return HasEnding(name, ending); });
  };
  if (is_file(path)) {
    *parts = {path, ""};
    return true;
  }
  for (std::size_t colon = path.find(':'); colon != std::string::npos;
       colon = path.find(':', colon + 1)) {
    if (colon + 1 < path.size() && is_file(path.substr(0, colon))) {
      *parts = {path.substr(0, colon), path.substr(colon + 1)};
      return true;
    }
  }
  return false;
}

}  // namespace isoscope::source
