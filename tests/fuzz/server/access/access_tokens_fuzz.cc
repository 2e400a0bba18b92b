// The file of tokens: an accepted one has entries that are apart and limits that may be.

#include <cstddef>
#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "core/view/view.h"
#include "server/access/access_tokens.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

void Run(absl::string_view text) {
  const auto tokens = server::ParseAccessTokens(text, "t.json");
  if (!tokens.ok()) {
    RequireError(tokens.status(), {absl::StatusCode::kInvalidArgument}, "t.json");
    return;
  }
  Require(tokens->size() <= server::kMaxAccessTokens, "an accepted file has few tokens");
  std::set<std::string> names;
  std::set<std::string> digests;
  for (const server::AccessToken& token : *tokens) {
    Require(!token.name.empty() && names.insert(token.name).second, "names are unique");
    Require(token.digest.size() == 32 && digests.insert(token.digest).second,
            "digests are whole and unique");
    Require(token.max_viewport_px >= 0 && token.max_viewport_px <= view::kMaxViewportPx,
            "a limit of pixels may be");
    Require(token.max_frames_per_second >= 0 && token.max_frames_per_second <= 1e6,
            "a limit of frames may be");
    for (std::size_t i = 1; i < token.datasets.size(); ++i) {
      Require(token.datasets[i - 1] < token.datasets[i], "datasets ascend");
    }
  }
}

}  // namespace

std::vector<std::string> Seeds() {
  const std::string digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015a";
  return {R"({"tokens": []})",
          R"({"tokens": [{"name": "a", "sha256": ")" + digest + R"(d", "datasets": ["b", "a"],
              "max_viewport_px": 640, "max_frames_per_second": 0.5}]})",
          R"({"tokens": [{"name": "a", "sha256": ")" + digest + R"(d", "datasets": ["*"]},
              {"name": "b", "sha256": ")" +
              digest + R"(e", "datasets": []}]})"};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run({reinterpret_cast<const char*>(data), size});
  return 0;
}
