// The audit log: one JSON object a line for each call of a public service, refused calls included.
// docs/operations.md lists the members.

#ifndef ISOSCOPE_SERVER_ACCESS_AUDIT_LOG_H_
#define ISOSCOPE_SERVER_ACCESS_AUDIT_LOG_H_

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include <sys/types.h>

#include "core/base/metrics.h"
#include "core/base/mutex.h"
#include "core/base/printable.h"
#include "rpc/peer.h"

namespace isoscope::server {

// One call, apart from how it ended.
struct AuditRecord {
  base::ForeignText caller = {};  // name of the token; empty without one, or if it is not known
  base::ForeignText certificate = {};  // name in the certificate; empty without one
  base::ForeignText peer = {};         // the connection as gRPC names it
  base::ForeignText dataset = {};      // name that was asked for, or found
  base::ForeignText dataset_id = {};   // of the dataset that was found; empty before that
};

// Fills in certificate and peer; `address`: the connection as gRPC names it.
AuditRecord RecordOf(const rpc::Peer& peer, absl::string_view address);

// Returns the line of a call, with its line feed.
std::string FormatAuditLine(absl::Time time, absl::string_view method, const AuditRecord& record,
                            absl::string_view request_id, const absl::Status& status);

// Thread-safe. A line is written before the caller has its answer, but not synced to the disk.
class AuditLog {
 public:
  // path: a file to append to, created for owner and group only; "-": standard output. A file that
  // was moved away is created again, so logrotate needs no signal. Returns errors of opening.
  static absl::StatusOr<std::unique_ptr<AuditLog>> Open(const std::string& path);
  ~AuditLog();

  AuditLog(const AuditLog&) = delete;
  AuditLog& operator=(const AuditLog&) = delete;

  // Writes a line. If that fails, the failure is counted and logged, and the call continues.
  void Write(absl::string_view method, const AuditRecord& record, absl::string_view request_id,
             const absl::Status& status) ABSL_LOCKS_EXCLUDED(mutex_);

  [[nodiscard]] std::int64_t written_lines() const { return written_lines_.value(); }
  [[nodiscard]] std::int64_t failed_lines() const { return failed_lines_.value(); }

 private:
  explicit AuditLog(std::string path) : path_(std::move(path)) {}
  absl::Status Reopen() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status WriteLine(absl::string_view line) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const std::string path_;
  base::Counter written_lines_;
  base::Counter failed_lines_;
  base::Mutex mutex_;
  int file_ ABSL_GUARDED_BY(mutex_) = -1;
  dev_t device_ ABSL_GUARDED_BY(mutex_) = 0;
  ino_t inode_ ABSL_GUARDED_BY(mutex_) = 0;
  bool is_failing_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ACCESS_AUDIT_LOG_H_
