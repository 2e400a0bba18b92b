#include "client-cli/output/label_json.h"

#include <cstddef>

#include "absl/strings/str_cat.h"
#include <nlohmann/json.hpp>

#include "core/base/printable.h"
#include "core/cli/table.h"

namespace isoscope::cli {
namespace {

constexpr std::size_t kMaxRows = 100;

}  // namespace

void AddLabels(const std::vector<volume::Label>& labels, Json* json) {
  for (const volume::Label& label : labels) {
    (*json)["labels"].push_back(
        {{"value", label.value},
         {"name", label.name},
         {"color", label.color.has_value() ? Json(volume::ToHex(*label.color)) : Json(nullptr)}});
  }
}

std::string DescribeLabels(const Json& json) {
  if (!json.contains("labels")) {
    return "";
  }
  const Json& labels = json.at("labels");
  Table table = Table::OfColumns({{.title = "label"},
                                  {.title = "colour", .is_left = true},
                                  {.title = "name", .is_left = true}});
  for (std::size_t i = 0; i < labels.size() && i < kMaxRows; ++i) {
    const Json& label = labels[i];
    const double value = label.at("value").get<double>();
    const Json& color = label.at("color");
    table.AddRow({absl::StrCat(value),
                  color.is_string()
                      ? color.get<std::string>()
                      : absl::StrCat("(", volume::ToHex(volume::DefaultLabelColor(value)), ")"),
                  base::Printable(label.at("name").get<std::string>())});
  }
  return absl::StrCat("\n", table.ToString(),
                      labels.size() > kMaxRows ? absl::StrCat("and ", labels.size() - kMaxRows,
                                                              " more: --json lists all\n")
                                               : "");
}

}  // namespace isoscope::cli
