// Who calls a public service, and what that caller may: see datasets, ask for frames of a size and
// at a rate. docs/security.md has the rules:
//
//   a token of the file                        its datasets, its limits
//   a certificate with the role client         everything
//   a certificate with the role gateway        everything if there are no tokens; else only the
//                                              capabilities, until its user shows a token
//   neither                                    everything if there is neither TLS nor a token file;
//                                              else nothing
//
// A token counts for more than the certificate beside it, so that a gateway's users have no more
// rights than they brought.

#ifndef ISOSCOPE_SERVER_ACCESS_ACCESS_CONTROL_H_
#define ISOSCOPE_SERVER_ACCESS_ACCESS_CONTROL_H_

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/metrics.h"
#include "core/base/mutex.h"
#include "core/rpc/peer.h"
#include "server/access/access_tokens.h"

namespace isoscope::server {

// What the holder of a token may, and how much of it was used. Thread-safe.
class AccessGrant {
 public:
  AccessGrant(AccessToken token, absl::Time now);

  [[nodiscard]] const AccessToken& token() const { return token_; }
  // RESOURCE_EXHAUSTED says when to come again (retry_delay.h). `spared`: frames that must be left
  // afterwards.
  absl::Status TakeFrame(int spared, absl::Time now) ABSL_LOCKS_EXCLUDED(mutex_);
  void Withdraw() { is_withdrawn_.store(true); }
  [[nodiscard]] bool is_withdrawn() const { return is_withdrawn_.load(); }

 private:
  const AccessToken token_;
  const double burst_;  // frames that may come at once
  std::atomic<bool> is_withdrawn_{false};
  base::Mutex mutex_;
  double frames_ ABSL_GUARDED_BY(mutex_);  // that may come now
  absl::Time counted_ ABSL_GUARDED_BY(mutex_);
};

// One caller. Copies are cheap and share the count of frames. Thread-safe.
class Caller {
 public:
  // May do everything.
  Caller() = default;
  explicit Caller(std::shared_ptr<AccessGrant> grant) : grant_(std::move(grant)) {}

  // Of the token; empty without one.
  [[nodiscard]] std::string name() const { return grant_ == nullptr ? "" : grant_->token().name; }
  // Who it is in a line of clients: its token, else `peer`, the connection as gRPC names it.
  [[nodiscard]] std::string QueueKey(const std::string& peer) const;
  [[nodiscard]] bool sees_all_datasets() const {
    return grant_ == nullptr || grant_->token().sees_all_datasets;
  }
  [[nodiscard]] bool MaySee(const std::string& dataset) const;
  // PERMISSION_DENIED if a side of the viewport is longer than the token allows.
  [[nodiscard]] absl::Status CheckViewport(int width_px, int height_px) const;
  // Counts a frame. RESOURCE_EXHAUSTED if there were too many. A moving frame of a view leaves room
  // for the exact one that follows.
  [[nodiscard]] absl::Status TakeFrame(bool is_moving) const;

 private:
  friend class AccessControl;
  std::shared_ptr<AccessGrant> grant_;  // null: no limits
};

struct AccessOptions {
  bool has_tls = false;         // callers need a certificate or a token
  std::string token_file = {};  // empty: there are no tokens
};

// Thread-safe.
class AccessControl {
 public:
  // A changed file is noticed this long after it was last looked at.
  static constexpr absl::Duration kReloadInterval = absl::Seconds(1);

  // Errors of reading the file; as ParseAccessTokens.
  static absl::StatusOr<std::unique_ptr<AccessControl>> Make(AccessOptions options);

  // The caller, if it may do anything at all. UNAUTHENTICATED: it shows nothing, or what it shows
  // is not known. PERMISSION_DENIED: its certificate is for something else.
  absl::StatusOr<Caller> Identify(const rpc::Peer& peer) ABSL_LOCKS_EXCLUDED(mutex_);
  // Whether the caller may know the limits and the version of the service; errors as Identify.
  absl::Status CheckCapabilities(const rpc::Peer& peer);
  // For streams that are open for long: UNAUTHENTICATED once the token is gone from the file, or
  // has changed there.
  absl::Status CheckStillValid(const Caller& caller) ABSL_LOCKS_EXCLUDED(mutex_);
  // How often the file had changed and was wrong.
  [[nodiscard]] std::int64_t failed_reloads() const { return failed_reloads_.value(); }

 private:
  // Of a file, to see that it was replaced or written.
  struct FileState {
    std::int64_t inode = 0;
    std::int64_t size = 0;
    std::int64_t seconds = 0;
    std::int64_t nanoseconds = 0;
    friend bool operator==(const FileState&, const FileState&) = default;
  };

  explicit AccessControl(AccessOptions options) : options_(std::move(options)) {}
  static FileState StateOf(const std::string& path);
  absl::Status Load() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Reads the file again if it has changed; keeps what there is if the new one is wrong.
  void ReloadIfChanged() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<Caller> FindToken(const std::string& authorization) ABSL_LOCKS_EXCLUDED(mutex_);

  const AccessOptions options_;
  base::Counter failed_reloads_;
  base::Mutex mutex_;
  FileState file_ ABSL_GUARDED_BY(mutex_);
  absl::Time looked_ ABSL_GUARDED_BY(mutex_) = absl::InfinitePast();
  std::vector<std::shared_ptr<AccessGrant>> grants_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ACCESS_ACCESS_CONTROL_H_
