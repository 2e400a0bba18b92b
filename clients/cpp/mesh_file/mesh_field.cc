#include "clients/cpp/mesh_file/mesh_field.h"

#include <algorithm>
#include <array>
#include <charconv>

#include "absl/strings/str_cat.h"

namespace isoscope::client {

std::string ShortestText(double value) {
  std::array<char, 32> text;
  const std::to_chars_result end = std::to_chars(text.data(), text.data() + text.size(), value);
  return {text.data(), end.ptr};
}

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
    lines.push_back(absl::StrCat("time ", ShortestText(*field.time),
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
