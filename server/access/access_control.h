// Identifies the caller of a public service and its rights: datasets, size and rate of frames.
// docs/security.md has the rules:
//
//   a token of the file                        its datasets, its limits
//   a certificate with the role client         everything
//   a certificate with the role gateway        everything if there are no tokens; else only the
//                                              capabilities, until its user shows a token
//   neither                                    everything if there is neither TLS nor a token file;
//                                              else nothing
//
// A token takes precedence over the certificate of the same call. So users of a gateway have only
// the rights of their own tokens.

#ifndef ISOSCOPE_SERVER_ACCESS_ACCESS_CONTROL_H_
#define ISOSCOPE_SERVER_ACCESS_ACCESS_CONTROL_H_

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/metrics.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/io/file_stamp.h"
#include "rpc/peer.h"
#include "server/access/access_tokens.h"
#include "server/access/rate_bucket.h"

namespace isoscope::server {

// Uses whose number at a time is limited for the holder of a token.
enum class CallerUse { kFrame, kStream, kExport };

// Limits of a token (docs/security.md) that refuse calls.
enum class TokenLimit { kFrameRate, kFrames, kStreams, kExports, kBytes };
inline constexpr std::size_t kTokenLimitCount = 5;

// Counts the calls that the limits of all tokens refused. Thread-safe.
struct TokenRefusals {
  void Count(TokenLimit limit) { counts[static_cast<std::size_t>(limit)].Add(); }

  std::array<base::Counter, kTokenLimitCount> counts;
};

// Rights of the holder of a token, and how much of them is used. Thread-safe.
class AccessGrant {
 public:
  AccessGrant(AccessToken token, base::MonotonicTime now,
              std::shared_ptr<TokenRefusals> refusals = std::make_shared<TokenRefusals>());

  [[nodiscard]] const AccessToken& token() const { return token_; }
  // The errors of these three are RESOURCE_EXHAUSTED with a retry delay (retry_delay.h). `spared`:
  // frames of the rate that must be left afterwards.
  absl::Status TakeFrame(int spared, base::MonotonicTime now) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::Status BeginUse(CallerUse use) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::Status CheckBytes(base::MonotonicTime now) ABSL_LOCKS_EXCLUDED(mutex_);
  // Returns a frame to the rate, because it was not drawn.
  void ReturnFrame() ABSL_LOCKS_EXCLUDED(mutex_);
  void EndUse(CallerUse use) ABSL_LOCKS_EXCLUDED(mutex_);
  void CountBytes(std::size_t bytes, base::MonotonicTime now) ABSL_LOCKS_EXCLUDED(mutex_);

  // Marks the grant: its token was removed from the file or changed.
  void Withdraw() { is_withdrawn_.store(true); }
  [[nodiscard]] bool is_withdrawn() const { return is_withdrawn_.load(); }
  // Calls `end` once when the users of a withdrawn grant must end, at once if it is withdrawn
  // already. Returns the number for ForgetUser.
  std::int64_t AddUser(std::function<void()> end) ABSL_LOCKS_EXCLUDED(mutex_);
  void ForgetUser(std::int64_t user) ABSL_LOCKS_EXCLUDED(mutex_);
  void EndUsers() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  static constexpr std::size_t kUseCount = 3;

  const AccessToken token_;
  const std::shared_ptr<TokenRefusals> refusals_;
  std::atomic<bool> is_withdrawn_{false};
  base::Mutex mutex_;
  std::optional<RateBucket> frames_ ABSL_GUARDED_BY(mutex_);  // none: no limit
  std::optional<RateBucket> bytes_ ABSL_GUARDED_BY(mutex_);
  std::array<int, kUseCount> uses_ ABSL_GUARDED_BY(mutex_) = {};
  bool must_users_end_ ABSL_GUARDED_BY(mutex_) = false;
  std::int64_t next_user_ ABSL_GUARDED_BY(mutex_) = 1;
  std::map<std::int64_t, std::function<void()>> users_ ABSL_GUARDED_BY(mutex_);
};

// One counted use of a caller; destroying it ends the use.
class CallerSlot {
 public:
  CallerSlot() = default;
  CallerSlot(std::shared_ptr<AccessGrant> grant, CallerUse use)
      : grant_(std::move(grant)), use_(use) {}
  CallerSlot(CallerSlot&& other) noexcept : grant_(std::move(other.grant_)), use_(other.use_) {}
  CallerSlot& operator=(CallerSlot&&) = delete;
  ~CallerSlot() {
    if (grant_ != nullptr) {
      grant_->EndUse(use_);
    }
  }

 private:
  std::shared_ptr<AccessGrant> grant_;  // null: nothing is counted
  CallerUse use_ = CallerUse::kFrame;
};

// Notifies a call when its token is withdrawn, as long as the watch lives.
class WithdrawalWatch {
 public:
  WithdrawalWatch() = default;
  WithdrawalWatch(std::shared_ptr<AccessGrant> grant, std::int64_t user)
      : grant_(std::move(grant)), user_(user) {}
  WithdrawalWatch(WithdrawalWatch&& other) noexcept
      : grant_(std::move(other.grant_)), user_(other.user_) {}
  WithdrawalWatch& operator=(WithdrawalWatch&&) = delete;
  ~WithdrawalWatch() {
    if (grant_ != nullptr) {
      grant_->ForgetUser(user_);
    }
  }

 private:
  std::shared_ptr<AccessGrant> grant_;  // null: there is no token
  std::int64_t user_ = 0;
};

// One caller. Copies are cheap and share the counts. Thread-safe.
class Caller {
 public:
  // A caller with all rights.
  Caller() = default;
  explicit Caller(std::shared_ptr<AccessGrant> grant) : grant_(std::move(grant)) {}

  // Name of the token; empty without one.
  [[nodiscard]] std::string name() const { return grant_ == nullptr ? "" : grant_->token().name; }
  // Identity in a queue of clients: the token, else `peer`, the connection as gRPC names it.
  [[nodiscard]] std::string QueueKey(const std::string& peer) const;
  // Identity for streams: the token, else the host, so that all connections of a host are one
  // caller.
  [[nodiscard]] std::string HostKey(const std::string& peer) const;
  [[nodiscard]] bool sees_all_datasets() const {
    return grant_ == nullptr || grant_->token().sees_all_datasets;
  }
  [[nodiscard]] bool MaySee(const std::string& dataset) const;
  // PERMISSION_DENIED if a side of the viewport is longer than the token allows.
  [[nodiscard]] absl::Status CheckViewport(int width_px, int height_px) const;
  // Counts a frame. RESOURCE_EXHAUSTED if there were too many. A moving frame of a view leaves room
  // for the exact one that follows.
  [[nodiscard]] absl::Status TakeFrame(bool is_moving) const;
  // Returns the frame to the rate, because something else refused it.
  void ReturnFrame() const;
  // RESOURCE_EXHAUSTED if the caller is at its limit of this use.
  [[nodiscard]] absl::StatusOr<CallerSlot> Begin(CallerUse use) const;
  // RESOURCE_EXHAUSTED if the bytes sent so far exceed the token's rate.
  [[nodiscard]] absl::Status CheckBytes() const;
  // Counts bytes that are sent.
  void CountBytes(std::size_t bytes) const;
  // Calls `end` once, on another thread, if the token is withdrawn. `end` must own its data: it may
  // still run when the watch is destroyed.
  [[nodiscard]] WithdrawalWatch WhenWithdrawn(std::function<void()> end) const;

 private:
  friend class AccessControl;
  std::shared_ptr<AccessGrant> grant_;  // null: no limits
};

// Status of a call whose token was withdrawn.
absl::Status WithdrawnError();

struct AccessOptions {
  bool has_tls = false;         // callers need a certificate or a token
  std::string token_file = {};  // empty: there are no tokens
};

// Thread-safe.
class AccessControl {
 public:
  // A change of the file is noticed within this time, even without calls.
  static constexpr absl::Duration kReloadInterval = absl::Seconds(1);

  // Errors of reading the file; as ParseAccessTokens.
  static absl::StatusOr<std::unique_ptr<AccessControl>> Make(AccessOptions options);
  ~AccessControl();

  AccessControl(const AccessControl&) = delete;
  AccessControl& operator=(const AccessControl&) = delete;

  // Returns the caller if it has any rights. UNAUTHENTICATED: it has no credential, or an unknown
  // one. PERMISSION_DENIED: its certificate has another role.
  absl::StatusOr<Caller> Identify(const rpc::Peer& peer) ABSL_LOCKS_EXCLUDED(mutex_);
  // Checks that the caller may know the limits and the version of the service; errors as
  // Identify.
  absl::Status CheckCapabilities(const rpc::Peer& peer);
  // Checks the caller of a stream that is open for long. UNAUTHENTICATED once its token is gone
  // from the file, or has changed there.
  absl::Status CheckStillValid(const Caller& caller) ABSL_LOCKS_EXCLUDED(mutex_);
  // Number of reloads that failed because the changed file was wrong.
  [[nodiscard]] std::int64_t failed_reloads() const { return failed_reloads_.value(); }
  // Adds the refusals of calls by limits of tokens.
  void AppendMetrics(std::vector<base::MetricFamily>* families) const;

 private:
  explicit AccessControl(AccessOptions options) : options_(std::move(options)) {}
  absl::Status Load() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Reads the file again if it has changed. Keeps the present tokens if the new file is wrong.
  void ReloadIfChanged() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<Caller> FindToken(const std::string& authorization) ABSL_LOCKS_EXCLUDED(mutex_);
  // Watches the file between calls, and ends the users of withdrawn tokens.
  void Watch() ABSL_LOCKS_EXCLUDED(mutex_);

  const AccessOptions options_;
  const std::shared_ptr<TokenRefusals> refusals_ = std::make_shared<TokenRefusals>();
  base::Counter failed_reloads_;
  base::Mutex mutex_;
  base::CondVar changed_;  // tokens were withdrawn, or all stops
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::shared_ptr<AccessGrant>> withdrawn_ ABSL_GUARDED_BY(mutex_);  // not ended yet
  io::FileStamp file_ ABSL_GUARDED_BY(mutex_);
  base::MonotonicTime looked_ ABSL_GUARDED_BY(mutex_) = base::MonotonicTime::InfinitePast();
  std::vector<std::shared_ptr<AccessGrant>> grants_ ABSL_GUARDED_BY(mutex_);
  std::thread watcher_;  // runs if there is a token file
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ACCESS_ACCESS_CONTROL_H_
