#include "clients/cpp/connection/connect.h"

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "rpc/channel.h"
#include "rpc/host_port.h"
#include "rpc/peer.h"

namespace isoscope::client {
namespace {

absl::StatusOr<std::string> TokenOf(const ConnectOptions& options) {
  if (!options.token.empty() && !options.token_file.empty()) {
    return absl::InvalidArgumentError("token and token_file exclude each other: set one of them");
  }
  std::string token = options.token;
  if (!options.token_file.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(token, rpc::ReadTokenFile(options.token_file));
  }
  if (token.empty()) {
    return token;
  }
  ISOSCOPE_RETURN_IF_ERROR(rpc::CheckTokenText(token));
  if (!MaySendToken(options.transport, options.address)) {
    return absl::InvalidArgumentError(
        absl::StrCat("the token would go to ", options.address,
                     " in plaintext: set transport.ca_file, or transport.is_insecure where the way "
                     "there is safe by other means"));
  }
  return token;
}

}  // namespace

bool MaySendToken(const rpc::TransportFlags& transport, absl::string_view address) {
  return transport.has_tls() || transport.is_insecure || rpc::IsLoopbackTarget(address);
}

absl::StatusOr<std::unique_ptr<ServiceClient>> Connect(const ConnectOptions& options,
                                                       cli::Interrupt* interrupt) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string address,
                            rpc::ParseCoordinatorAddress(options.address));
  ISOSCOPE_RETURN_IF_ERROR(rpc::CheckDialFlags(options.transport));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string token, TokenOf(options));
  ISOSCOPE_ASSIGN_OR_RETURN(const rpc::Dialing dialing,
                            rpc::MakeDialing(options.transport, /*own_role=*/""));
  return std::make_unique<ServiceClient>(rpc::MakeChannel(address, dialing), address, interrupt,
                                         token);
}

}  // namespace isoscope::client
