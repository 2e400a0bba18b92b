// Fuzzes the claims of a peer: the roles among its certificate's URIs, and its token.

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_split.h"

#include "rpc/peer.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

bool IsPrintable(absl::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return byte >= 0x20 && byte != 0x7f;
  });
}

// URIs with a byte 0xff between them.
void ReadRoles(absl::string_view text) {
  const std::vector<std::string> uris = absl::StrSplit(std::string(text), '\xff');
  const std::vector<std::string> roles = rpc::RolesOf(uris);
  Require(roles.size() <= uris.size(), "a URI names one role at most");
  for (const std::string& role : roles) {
    Require(!role.empty() && IsPrintable(role), "a role never breaks a log line");
  }
  rpc::Peer peer;
  peer.has_certificate = true;
  peer.name = uris.front();
  peer.roles = roles;
  Require(IsPrintable(rpc::Describe(peer)), "the description of a peer never breaks a log line");
  for (const char* role : {"agent", "coordinator", "client", "gateway"}) {
    const bool is_named = std::any_of(uris.begin(), uris.end(), [&](const std::string& uri) {
      return uri == std::string("isoscope:role:") + role;
    });
    Require(peer.HasRole(role) == is_named, "a peer has the roles that its certificate names");
  }
}

void ReadToken(absl::string_view text) {
  const absl::Status status = rpc::CheckTokenText(text);
  const bool may_travel = !text.empty() && text.size() <= rpc::kMaxTokenBytes &&
                          std::all_of(text.begin(), text.end(), [](char c) {
                            return std::isalnum(static_cast<unsigned char>(c)) != 0 ||
                                   absl::StrContains("-._~+/=", std::string(1, c));
                          });
  Require(status.ok() == may_travel, "a token has the characters that a header may carry");
  if (!status.ok()) {
    RequireError(status, {absl::StatusCode::kInvalidArgument});
    // Same length, and as wrong: an equal message does not depend on the token's text.
    const std::string other(text.size(), ' ');
    Require(status == rpc::CheckTokenText(other), "a message never repeats a token");
  }
}

}  // namespace

std::vector<std::string> Seeds() {
  return {std::string(1, '\0') + "isoscope:role:agent\xffisoscope:role:client",
          std::string(1, '\0') + "spiffe://x/y\xffisoscope:role:\xffisoscope:role:a\nb",
          "\1aZ09-._~+/=", "\1" + std::string(257, 'a'), "\1with space"};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Input input(data, size);
  if (input.Byte() % 2 == 0) {
    isoscope::fuzz::ReadRoles(input.Rest());
  } else {
    isoscope::fuzz::ReadToken(input.Rest());
  }
  return 0;
}
