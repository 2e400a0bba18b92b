#include "clients/cpp/mesh_file/mesh_field.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

#include "core/cli/format.h"

namespace isoscope::client {

std::vector<std::string> LinesOf(const MeshField& field) {
  std::vector<std::string> lines = {
      absl::StrCat("field ", field.name, field.component.empty() ? "" : ":", field.component)};
  if (!field.unit.empty()) {
    lines.push_back(absl::StrCat("unit ", field.unit));
  }
  if (field.step.has_value()) {
    lines.push_back(absl::StrCat("step ", *field.step));
  }
  if (field.time.has_value()) {
    lines.push_back(absl::StrCat("time ", cli::FormatShortest(*field.time),
                                 field.time_unit.empty() ? "" : " ", field.time_unit));
  }
  for (std::string& line : lines) {
    std::replace_if(
        line.begin(), line.end(),
        [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; }, '?');
  }
  return lines;
}

}  // namespace isoscope::client
