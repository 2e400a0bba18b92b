#include "clients/cpp/request/json_text.h"

#include <nlohmann/json.hpp>

#include "core/base/printable.h"

namespace isoscope::client {

std::string JsonText(const nlohmann::ordered_json& json) {
  constexpr int kIndent = 2;
  return base::PrintableJson(json.dump(kIndent, ' ', /*ensure_ascii=*/false,
                                       nlohmann::ordered_json::error_handler_t::replace)) +
         "\n";
}

}  // namespace isoscope::client
