#include "rpc/peer.h"

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <memory>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include <grpc/grpc_security_constants.h>

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "rpc/transport.h"

namespace isoscope::rpc {
namespace {

constexpr char kAuthorization[] = "authorization";

std::string ToString(const grpc::string_ref& text) { return {text.data(), text.size()}; }

}  // namespace

bool Peer::HasRole(absl::string_view role) const {
  return std::find(roles.begin(), roles.end(), role) != roles.end();
}

Peer PeerOf(const grpc::AuthContext& context) {
  Peer peer;
  peer.has_certificate = !context.FindPropertyValues(GRPC_X509_PEM_CERT_PROPERTY_NAME).empty();
  if (!peer.has_certificate) {
    return peer;
  }
  for (const grpc::string_ref& name : context.FindPropertyValues(GRPC_X509_CN_PROPERTY_NAME)) {
    peer.name = ToString(name);
  }
  std::vector<std::string> uris;
  for (const grpc::string_ref& uri : context.FindPropertyValues(GRPC_PEER_URI_PROPERTY_NAME)) {
    uris.push_back(ToString(uri));
  }
  peer.roles = RolesOf(uris);
  return peer;
}

Peer PeerOf(const grpc::ServerContextBase& context) {
  const std::shared_ptr<const grpc::AuthContext> auth = context.auth_context();
  Peer peer = auth == nullptr ? Peer() : PeerOf(*auth);
  const auto [begin, end] = context.client_metadata().equal_range(kAuthorization);
  if (begin != end && std::next(begin) == end) {
    peer.authorization = ToString(begin->second);
  }
  return peer;
}

std::string Describe(const Peer& peer) {
  if (!peer.has_certificate) {
    return "this caller shows no certificate";
  }
  return absl::StrCat("this caller's certificate, ", base::Quoted(peer.name), ", has ",
                      peer.roles.empty()
                          ? absl::StrCat("no role (no alternative name URI:", kRolePrefix, "...)")
                          : absl::StrCat("the role ", absl::StrJoin(peer.roles, ", ")));
}

std::vector<std::string> RolesOf(const std::vector<std::string>& uris) {
  std::vector<std::string> roles;
  for (absl::string_view uri : uris) {
    if (absl::ConsumePrefix(&uri, kRolePrefix) && !uri.empty()) {
      roles.push_back(base::Escaped(base::CutText(uri)));
    }
  }
  return roles;
}

absl::Status CheckTokenText(absl::string_view token) {
  if (token.empty()) {
    return absl::InvalidArgumentError("the token is empty");
  }
  if (token.size() > kMaxTokenBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("the token has ", token.size(), " bytes: at most ", kMaxTokenBytes));
  }
  const bool is_clean = std::all_of(token.begin(), token.end(), [](char c) {
    return absl::ascii_isalnum(static_cast<unsigned char>(c)) ||
           absl::string_view("-._~+/=").find(c) != absl::string_view::npos;
  });
  return is_clean ? absl::OkStatus()
                  : absl::InvalidArgumentError(
                        "the token has characters other than letters, digits and -._~+/=");
}

absl::StatusOr<std::string> ReadTokenFile(const std::string& path) {
  constexpr std::int64_t kMaxFileBytes = 4096;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, io::ReadWholeFile(path, kMaxFileBytes));
  std::string token(absl::StripAsciiWhitespace(text));
  const absl::Status checked = CheckTokenText(token);
  if (!checked.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", checked.message()));
  }
  return token;
}

void SendToken(const std::string& token, grpc::ClientContext* context) {
  if (!token.empty()) {
    context->AddMetadata(kAuthorization, absl::StrCat("Bearer ", token));
  }
}

}  // namespace isoscope::rpc
