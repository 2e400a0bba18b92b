#include "server/access/access_control.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/clock.h"
#include <openssl/crypto.h>
#include <sys/stat.h>

#include "core/base/error_reason.h"
#include "core/base/log.h"
#include "core/base/retry_delay.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/rpc/transport.h"

namespace isoscope::server {
namespace {

constexpr std::int64_t kMaxFileBytes = 4 * base::kMiB;
constexpr absl::string_view kBearer = "Bearer ";

absl::Status NothingShown() {
  return absl::UnauthenticatedError(
      "this service asks who calls: send a token (--token-file FILE or $ISOSCOPE_TOKEN), or show a "
      "certificate with the role client (--tls-cert, --tls-key)");
}

}  // namespace

AccessGrant::AccessGrant(AccessToken token, absl::Time now)
    : token_(std::move(token)),
      burst_(std::max(2.0, token_.max_frames_per_second)),
      frames_(burst_),
      counted_(now) {}

absl::Status AccessGrant::TakeFrame(int spared, absl::Time now) {
  const double rate = token_.max_frames_per_second;
  if (rate == 0) {
    return absl::OkStatus();
  }
  const base::MutexLock lock(&mutex_);
  if (now > counted_) {
    frames_ = std::min(burst_, frames_ + rate * absl::ToDoubleSeconds(now - counted_));
    counted_ = now;
  }
  if (frames_ >= 1 + spared) {
    frames_ -= 1;
    return absl::OkStatus();
  }
  const double wait_ms = std::ceil((1 + spared - frames_) / rate * 1000);
  return base::WithReason(base::WithRetryDelay(absl::ResourceExhaustedError(absl::StrCat(
                                                   "token \"", token_.name, "\" may have ", rate,
                                                   " frames a second: retry in ", wait_ms, " ms")),
                                               absl::Milliseconds(wait_ms)),
                          base::ErrorReason::kRateLimited);
}

std::string Caller::QueueKey(const std::string& peer) const {
  return grant_ == nullptr ? absl::StrCat("peer ", peer) : absl::StrCat("token ", name());
}

bool Caller::MaySee(const std::string& dataset) const {
  return sees_all_datasets() || std::binary_search(grant_->token().datasets.begin(),
                                                   grant_->token().datasets.end(), dataset);
}

absl::Status Caller::CheckViewport(int width_px, int height_px) const {
  const int limit = grant_ == nullptr ? 0 : grant_->token().max_viewport_px;
  if (limit == 0 || (width_px <= limit && height_px <= limit)) {
    return absl::OkStatus();
  }
  return absl::PermissionDeniedError(absl::StrCat("viewport is ", width_px, " x ", height_px,
                                                  ": token \"", grant_->token().name,
                                                  "\" may have at most ", limit, " pixels a side"));
}

absl::Status Caller::TakeFrame(bool is_moving) const {
  return grant_ == nullptr ? absl::OkStatus() : grant_->TakeFrame(is_moving ? 1 : 0, absl::Now());
}

absl::StatusOr<std::unique_ptr<AccessControl>> AccessControl::Make(AccessOptions options) {
  std::unique_ptr<AccessControl> access(new AccessControl(std::move(options)));
  if (!access->options_.token_file.empty()) {
    const base::MutexLock lock(&access->mutex_);
    access->file_ = StateOf(access->options_.token_file);
    access->looked_ = absl::Now();
    ISOSCOPE_RETURN_IF_ERROR(access->Load());
  }
  return access;
}

AccessControl::FileState AccessControl::StateOf(const std::string& path) {
  struct stat found {};
  if (stat(path.c_str(), &found) != 0) {
    return {};
  }
  return {.inode = static_cast<std::int64_t>(found.st_ino),
          .size = static_cast<std::int64_t>(found.st_size),
          .seconds = static_cast<std::int64_t>(found.st_mtim.tv_sec),
          .nanoseconds = static_cast<std::int64_t>(found.st_mtim.tv_nsec)};
}

absl::Status AccessControl::Load() {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text,
                            io::ReadWholeFile(options_.token_file, kMaxFileBytes));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<AccessToken> tokens,
                            ParseAccessTokens(text, options_.token_file));
  std::vector<std::shared_ptr<AccessGrant>> before = std::move(grants_);
  grants_.clear();
  const absl::Time now = absl::Now();
  for (AccessToken& token : tokens) {
    const auto same = std::find_if(before.begin(), before.end(),
                                   [&](const auto& grant) { return grant->token() == token; });
    grants_.push_back(same != before.end() ? *same
                                           : std::make_shared<AccessGrant>(std::move(token), now));
  }
  for (const std::shared_ptr<AccessGrant>& grant : before) {
    if (std::find(grants_.begin(), grants_.end(), grant) == grants_.end()) {
      grant->Withdraw();
    }
  }
  base::LogInfo("tokens_read", {{"file", options_.token_file}, {"tokens", grants_.size()}});
  return absl::OkStatus();
}

void AccessControl::ReloadIfChanged() {
  const absl::Time now = absl::Now();
  if (options_.token_file.empty() || now - looked_ < kReloadInterval) {
    return;
  }
  looked_ = now;
  const FileState state = StateOf(options_.token_file);
  if (state == file_) {
    return;
  }
  file_ = state;
  const absl::Status status = Load();
  if (!status.ok()) {
    failed_reloads_.Add();
    base::LogWarning("tokens_not_read", {{"status", status}, {"note", "the old ones stay"}});
  }
}

absl::StatusOr<Caller> AccessControl::FindToken(const std::string& authorization) {
  const absl::string_view text = authorization;
  if (!absl::StartsWithIgnoreCase(text, kBearer)) {
    return absl::UnauthenticatedError("authorization must be 'Bearer TOKEN'");
  }
  const std::string digest = DigestOfToken(absl::StripAsciiWhitespace(text.substr(kBearer.size())));
  const base::MutexLock lock(&mutex_);
  ReloadIfChanged();
  // All are compared, each in the same time, so that the time tells nothing.
  std::shared_ptr<AccessGrant> found;
  for (const std::shared_ptr<AccessGrant>& grant : grants_) {
    if (CRYPTO_memcmp(grant->token().digest.data(), digest.data(), digest.size()) == 0) {
      found = grant;
    }
  }
  if (found == nullptr) {
    return absl::UnauthenticatedError(
        "the token is not known here: it is wrong, or was withdrawn (--tokens)");
  }
  return Caller(std::move(found));
}

absl::StatusOr<Caller> AccessControl::Identify(const rpc::Peer& peer) {
  const bool has_tokens = !options_.token_file.empty();
  if (has_tokens && !peer.authorization.empty()) {
    return FindToken(peer.authorization);
  }
  if (!has_tokens && !options_.has_tls) {
    return Caller();
  }
  if (!peer.has_certificate) {
    return NothingShown();
  }
  if (peer.HasRole(rpc::kClientRole) || (peer.HasRole(rpc::kGatewayRole) && !has_tokens)) {
    return Caller();
  }
  if (peer.HasRole(rpc::kGatewayRole)) {
    return absl::UnauthenticatedError(
        "this service asks who the gateway calls for: give a token, as token=... in the address or "
        "as 'Authorization: Bearer TOKEN'");
  }
  return absl::PermissionDeniedError(absl::StrCat(
      "only clients and gateways may call this, or whoever has a token; ", rpc::Describe(peer)));
}

absl::Status AccessControl::CheckCapabilities(const rpc::Peer& peer) {
  return peer.HasRole(rpc::kGatewayRole) && peer.authorization.empty() ? absl::OkStatus()
                                                                       : Identify(peer).status();
}

absl::Status AccessControl::CheckStillValid(const Caller& caller) {
  if (caller.grant_ == nullptr) {
    return absl::OkStatus();
  }
  {
    const base::MutexLock lock(&mutex_);
    ReloadIfChanged();
  }
  return caller.grant_->is_withdrawn()
             ? absl::UnauthenticatedError("the token was withdrawn or changed: connect again")
             : absl::OkStatus();
}

}  // namespace isoscope::server
