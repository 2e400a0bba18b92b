// The header "traceparent": an accepted identity is one that W3C allows, and survives a hop.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/base/trace_context.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

bool IsLowerHex(char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); }

void Run(absl::string_view text) {
  const auto identity = base::TraceContext::Parse(text);
  Require(base::TraceContext::ParseOrRandom(text).request_id().size() == 32,
          "every request has an identity");
  if (!identity) {
    return;
  }
  const std::string& id = identity->request_id();
  Require(id.size() == 32 && std::all_of(id.begin(), id.end(), IsLowerHex) &&
              id.find_first_not_of('0') != std::string::npos,
          "an identity is 32 hexadecimal digits, not all 0");
  const std::string sent = identity->MakeTraceparent();
  const auto next = base::TraceContext::Parse(sent);
  Require(sent.size() == 55 && next && next->request_id() == id, "an identity survives a hop");
}

}  // namespace

std::vector<std::string> Seeds() {
  return {"00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
          "01-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-00-more",
          "ff-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
          "00-00000000000000000000000000000000-00f067aa0ba902b7-01"};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run({reinterpret_cast<const char*>(data), size});
  return 0;
}
