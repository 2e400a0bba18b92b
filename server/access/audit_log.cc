#include "server/access/audit_log.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include <sys/stat.h>

#include "core/base/error_reason.h"
#include "core/base/log.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"

namespace isoscope::server {
namespace {

constexpr char kStandardOutput[] = "-";
constexpr mode_t kMode = 0640;

absl::Status ErrorOf(const std::string& path, const char* what) {
  const int number = errno;
  return absl::ErrnoToStatus(
      number, absl::StrCat("can't ", what, " the audit log ", path, " (--audit-log)"));
}

}  // namespace

AuditRecord RecordOf(const rpc::Peer& peer, absl::string_view address) {
  return {.certificate = peer.name, .peer = address};
}

std::string FormatAuditLine(absl::Time time, absl::string_view method, const AuditRecord& record,
                            absl::string_view request_id, const absl::Status& status) {
  std::string line = absl::StrCat(
      "{\"time\":\"", absl::FormatTime("%Y-%m-%dT%H:%M:%E3SZ", time, absl::UTCTimeZone()), "\"");
  const auto add = [&line](absl::string_view key, const base::ForeignText& value) {
    absl::StrAppend(&line, ",\"", key, "\":", base::JsonString(value.text()));
  };
  add("caller", record.caller);
  add("certificate", record.certificate);
  add("peer", record.peer);
  add("method", method);
  add("dataset", record.dataset);
  add("dataset_id", record.dataset_id);
  add("request", request_id);
  add("code", absl::StatusCodeToString(status.code()));
  if (!status.ok()) {
    add("reason", base::NameOf(base::ReasonOf(status)));
  }
  line += "}\n";
  return line;
}

absl::StatusOr<std::unique_ptr<AuditLog>> AuditLog::Open(const std::string& path) {
  std::unique_ptr<AuditLog> opened(new AuditLog(path));
  const base::MutexLock lock(&opened->mutex_);
  ISOSCOPE_RETURN_IF_ERROR(opened->Reopen());
  return opened;
}

AuditLog::~AuditLog() {
  const base::MutexLock lock(&mutex_);
  if (file_ >= 0 && path_ != kStandardOutput) {
    close(file_);
  }
}

absl::Status AuditLog::Reopen() {
  if (path_ == kStandardOutput) {
    file_ = STDOUT_FILENO;
    return absl::OkStatus();
  }
  // O_NONBLOCK: opening a pipe would wait for its reader.
  const int opened =
      open(path_.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC | O_NONBLOCK, kMode);
  if (opened < 0) {
    return errno == ENXIO ? absl::FailedPreconditionError(absl::StrCat(
                                "the audit log ", path_,
                                " is a pipe that nobody reads; start its reader first"))
                          : ErrorOf(path_, "open");
  }
  struct stat state {};
  if (fstat(opened, &state) != 0) {
    const absl::Status error = ErrorOf(path_, "look at");
    close(opened);
    return error;
  }
  if (fcntl(opened, F_SETFL, O_APPEND) != 0) {
    const absl::Status error = ErrorOf(path_, "set up");
    close(opened);
    return error;
  }
  if (file_ >= 0) {
    close(file_);
  }
  file_ = opened;
  device_ = state.st_dev;
  inode_ = state.st_ino;
  return absl::OkStatus();
}

absl::Status AuditLog::WriteLine(absl::string_view line) {
  if (path_ != kStandardOutput) {
    struct stat state {};
    const bool is_same =
        stat(path_.c_str(), &state) == 0 && state.st_dev == device_ && state.st_ino == inode_;
    if (!is_same) {
      ISOSCOPE_RETURN_IF_ERROR(Reopen());
    }
  }
  while (!line.empty()) {
    const ssize_t written = write(file_, line.data(), line.size());
    if (written < 0 && errno == EINTR) {
      continue;
    }
    if (written <= 0) {
      return ErrorOf(path_, "write to");
    }
    line.remove_prefix(static_cast<std::size_t>(written));
  }
  return absl::OkStatus();
}

void AuditLog::Write(absl::string_view method, const AuditRecord& record,
                     absl::string_view request_id, const absl::Status& status) {
  const std::string line = FormatAuditLine(absl::Now(), method, record, request_id, status);
  absl::Status written;
  bool is_news = false;
  {
    const base::MutexLock lock(&mutex_);
    written = WriteLine(line);
    is_news = is_failing_ == written.ok();
    is_failing_ = !written.ok();
  }
  (written.ok() ? written_lines_ : failed_lines_).Add();
  if (is_news) {
    base::Log(written.ok() ? base::LogLevel::kInfo : base::LogLevel::kError,
              written.ok() ? "audit_written_again" : "audit_not_written", {{"status", written}});
  }
}

}  // namespace isoscope::server
