// Tokens, grants and their users:
//
// 1. Identify reloads the file if it has changed, and finds the grant of the caller's token.
// 2. A Caller counts its frames, streams, exports and bytes in the grant, which all its copies
//    share.
// 3. Load keeps the grants of unchanged tokens, so their counts stay. It withdraws the other ones.
// 4. The watcher looks at the file between calls, and ends the users of withdrawn grants.
//
// No lock is held while users are ended: that may call back into AccessControl.

#include "server/access/access_control.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include <openssl/crypto.h>

#include "core/base/error_reason.h"
#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "rpc/transport.h"

namespace isoscope::server {
namespace {

constexpr std::int64_t kMaxFileBytes = 4 * base::kMiB;
constexpr absl::string_view kBearer = "Bearer ";

// Bytes that were not used during this time may be sent in one burst.
constexpr double kByteBurstSeconds = 10;
// A caller at its limit may retry after this delay: the time of a frame.
constexpr absl::Duration kUseDelay = absl::Milliseconds(500);

// In the order of the enumerators.
constexpr std::array<const char*, kTokenLimitCount> kTokenLimitNames = {
    "frame_rate", "frames", "streams", "exports", "bytes"};

struct UseLimit {
  TokenLimit limit = TokenLimit::kFrames;
  int most = 0;  // 0: no limit
  const char* noun = "";
  const char* member = "";
};

UseLimit LimitOf(const AccessToken& token, CallerUse use) {
  switch (use) {
    case CallerUse::kFrame:
      return {TokenLimit::kFrames, token.max_concurrent_frames, "frames", "max_concurrent_frames"};
    case CallerUse::kStream:
      return {TokenLimit::kStreams, token.max_streams, "interactive streams", "max_streams"};
    case CallerUse::kExport:
      return {TokenLimit::kExports, token.max_exports, "exports", "max_exports"};
  }
  return {};
}

absl::Status NothingShown() {
  return absl::UnauthenticatedError(
      "this service asks who calls: send a token (--token-file FILE or $ISOSCOPE_TOKEN), or show a "
      "certificate with the role client (--tls-cert, --tls-key)");
}

}  // namespace

AccessGrant::AccessGrant(AccessToken token, base::MonotonicTime now,
                         std::shared_ptr<TokenRefusals> refusals)
    : token_(std::move(token)), refusals_(std::move(refusals)) {
  if (token_.max_frames_per_second > 0) {
    frames_.emplace(token_.max_frames_per_second, std::max(2.0, token_.max_frames_per_second), now);
  }
  if (token_.max_bytes_per_second > 0) {
    bytes_.emplace(token_.max_bytes_per_second, token_.max_bytes_per_second * kByteBurstSeconds,
                   now);
  }
}

absl::Status AccessGrant::TakeFrame(int spared, base::MonotonicTime now) {
  const base::MutexLock lock(&mutex_);
  if (!frames_.has_value()) {
    return absl::OkStatus();
  }
  if (frames_->Level(now) >= 1 + spared) {
    frames_->Take(1);
    return absl::OkStatus();
  }
  refusals_->Count(TokenLimit::kFrameRate);
  const absl::Duration wait = frames_->TimeUntil(1 + spared, now);
  return base::WithReason(
      base::WithRetryDelay(
          absl::ResourceExhaustedError(
              absl::StrCat("token \"", token_.name, "\" may have ", token_.max_frames_per_second,
                           " frames a second: retry in ", absl::ToInt64Milliseconds(wait), " ms")),
          wait),
      base::ErrorReason::kRateLimited);
}

void AccessGrant::ReturnFrame() {
  const base::MutexLock lock(&mutex_);
  if (frames_.has_value()) {
    frames_->Take(-1);
  }
}

absl::Status AccessGrant::BeginUse(CallerUse use) {
  const UseLimit limit = LimitOf(token_, use);
  const base::MutexLock lock(&mutex_);
  int& count = uses_[static_cast<std::size_t>(use)];
  if (limit.most == 0 || count < limit.most) {
    ++count;
    return absl::OkStatus();
  }
  refusals_->Count(limit.limit);
  return base::WithReason(
      base::WithRetryDelay(
          absl::ResourceExhaustedError(absl::StrCat(
              "token \"", token_.name, "\" may have ", limit.most, " ", limit.noun,
              " at a time and has them: wait until one ends, or ask for a greater ", limit.member)),
          kUseDelay),
      base::ErrorReason::kRateLimited);
}

void AccessGrant::EndUse(CallerUse use) {
  const base::MutexLock lock(&mutex_);
  --uses_[static_cast<std::size_t>(use)];
}

absl::Status AccessGrant::CheckBytes(base::MonotonicTime now) {
  const base::MutexLock lock(&mutex_);
  if (!bytes_.has_value() || bytes_->Level(now) > 0) {
    return absl::OkStatus();
  }
  refusals_->Count(TokenLimit::kBytes);
  const double wanted = std::min(1.0, token_.max_bytes_per_second * kByteBurstSeconds);
  const absl::Duration wait = std::max(bytes_->TimeUntil(wanted, now), absl::Milliseconds(1));
  return base::WithReason(
      base::WithRetryDelay(
          absl::ResourceExhaustedError(
              absl::StrCat("token \"", token_.name, "\" may have ", token_.max_bytes_per_second,
                           " bytes a second and was sent more: retry in ",
                           absl::ToInt64Milliseconds(wait), " ms, or ask for smaller pictures")),
          wait),
      base::ErrorReason::kRateLimited);
}

void AccessGrant::CountBytes(std::size_t bytes, base::MonotonicTime now) {
  const base::MutexLock lock(&mutex_);
  if (bytes_.has_value()) {
    bytes_->Level(now);
    bytes_->Take(static_cast<double>(bytes));
  }
}

std::int64_t AccessGrant::AddUser(std::function<void()> end) {
  {
    const base::MutexLock lock(&mutex_);
    if (!must_users_end_) {
      users_.emplace(next_user_, std::move(end));
      return next_user_++;
    }
  }
  end();
  return 0;
}

void AccessGrant::ForgetUser(std::int64_t user) {
  std::function<void()> unused;  // destroyed without the lock
  const base::MutexLock lock(&mutex_);
  const auto it = users_.find(user);
  if (it != users_.end()) {
    unused = std::move(it->second);
    users_.erase(it);
  }
}

void AccessGrant::EndUsers() {
  std::map<std::int64_t, std::function<void()>> users;
  {
    const base::MutexLock lock(&mutex_);
    must_users_end_ = true;
    users.swap(users_);
  }
  for (const auto& [user, end] : users) {
    end();
  }
}

std::string Caller::QueueKey(const std::string& peer) const {
  return grant_ == nullptr ? absl::StrCat("peer ", peer) : absl::StrCat("token ", name());
}

std::string Caller::HostKey(const std::string& peer) const {
  const bool has_port = absl::StartsWith(peer, "ipv4:") || absl::StartsWith(peer, "ipv6:");
  return QueueKey(has_port ? peer.substr(0, peer.rfind(':')) : peer);
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
  return grant_ == nullptr ? absl::OkStatus()
                           : grant_->TakeFrame(is_moving ? 1 : 0, base::MonotonicNow());
}

void Caller::ReturnFrame() const {
  if (grant_ != nullptr) {
    grant_->ReturnFrame();
  }
}

absl::StatusOr<CallerSlot> Caller::Begin(CallerUse use) const {
  if (grant_ == nullptr) {
    return CallerSlot();
  }
  ISOSCOPE_RETURN_IF_ERROR(grant_->BeginUse(use));
  return CallerSlot(grant_, use);
}

absl::Status Caller::CheckBytes() const {
  return grant_ == nullptr ? absl::OkStatus() : grant_->CheckBytes(base::MonotonicNow());
}

void Caller::CountBytes(std::size_t bytes) const {
  if (grant_ != nullptr) {
    grant_->CountBytes(bytes, base::MonotonicNow());
  }
}

WithdrawalWatch Caller::WhenWithdrawn(std::function<void()> end) const {
  return grant_ == nullptr ? WithdrawalWatch()
                           : WithdrawalWatch(grant_, grant_->AddUser(std::move(end)));
}

absl::Status WithdrawnError() {
  return absl::UnauthenticatedError("the token was withdrawn or changed: connect again");
}

absl::StatusOr<std::unique_ptr<AccessControl>> AccessControl::Make(AccessOptions options) {
  std::unique_ptr<AccessControl> access(new AccessControl(std::move(options)));
  if (!access->options_.token_file.empty()) {
    const base::MutexLock lock(&access->mutex_);
    access->file_ = io::StampOf(access->options_.token_file);
    access->looked_ = base::MonotonicNow();
    ISOSCOPE_RETURN_IF_ERROR(access->Load());
    access->watcher_ = std::thread([watched = access.get()] { watched->Watch(); });
  }
  return access;
}

AccessControl::~AccessControl() {
  {
    const base::MutexLock lock(&mutex_);
    is_stopping_ = true;
    changed_.SignalAll();
  }
  if (watcher_.joinable()) {
    watcher_.join();
  }
}

void AccessControl::Watch() {
  while (true) {
    std::vector<std::shared_ptr<AccessGrant>> withdrawn;
    {
      base::MutexLock lock(&mutex_);
      if (!is_stopping_ && withdrawn_.empty()) {
        changed_.WaitUntil(&mutex_, looked_ + kReloadInterval);
      }
      if (is_stopping_) {
        return;
      }
      ReloadIfChanged();
      withdrawn.swap(withdrawn_);
    }
    // The lock is not held: ending a call may ask for its caller, which takes the lock.
    for (const std::shared_ptr<AccessGrant>& grant : withdrawn) {
      grant->EndUsers();
    }
  }
}

void AccessControl::AppendMetrics(std::vector<base::MetricFamily>* families) const {
  base::MetricFamily family{
      .name = "isoscope_token_refusals_total",
      .help = "Frames, streams and exports that a token's limit refused, by limit.",
      .type = base::MetricFamily::Type::kCounter,
      .samples = {}};
  for (std::size_t i = 0; i < kTokenLimitCount; ++i) {
    family.samples.push_back(
        base::MetricSample::Of(refusals_->counts[i], {{"limit", kTokenLimitNames[i]}}));
  }
  families->push_back(std::move(family));
}

absl::Status AccessControl::Load() {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text,
                            io::ReadWholeFile(options_.token_file, kMaxFileBytes));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<AccessToken> tokens,
                            ParseAccessTokens(text, options_.token_file));
  std::vector<std::shared_ptr<AccessGrant>> before = std::move(grants_);
  grants_.clear();
  const base::MonotonicTime now = base::MonotonicNow();
  for (AccessToken& token : tokens) {
    const auto same = std::find_if(before.begin(), before.end(),
                                   [&](const auto& grant) { return grant->token() == token; });
    grants_.push_back(same != before.end()
                          ? *same
                          : std::make_shared<AccessGrant>(std::move(token), now, refusals_));
  }
  for (const std::shared_ptr<AccessGrant>& grant : before) {
    if (std::find(grants_.begin(), grants_.end(), grant) == grants_.end()) {
      grant->Withdraw();
      withdrawn_.push_back(grant);
    }
  }
  changed_.SignalAll();
  base::LogInfo("tokens_read",
                {{"file", base::OwnText{options_.token_file}}, {"tokens", grants_.size()}});
  return absl::OkStatus();
}

void AccessControl::ReloadIfChanged() {
  const base::MonotonicTime now = base::MonotonicNow();
  if (options_.token_file.empty() || now - looked_ < kReloadInterval) {
    return;
  }
  looked_ = now;
  const io::FileStamp state = io::StampOf(options_.token_file);
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
  // All digests are compared, each in constant time, so that timing reveals nothing.
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
  return caller.grant_->is_withdrawn() ? WithdrawnError() : absl::OkStatus();
}

}  // namespace isoscope::server
