// Steps: name, open, lock, compare with the record, then stretch by stretch: read, append, flush,
// record; at last the name. Nothing is made before the object is known to be there.

#include "core/source/remote/copy_address.h"

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/time.h"
#include "absl/types/span.h"

#include "core/base/monotonic_time.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/atomic_file.h"
#include "core/io/continued_file.h"
#include "core/io/file.h"
#include "core/io/file_lock.h"
#include "core/source/bytes/byte_source.h"
#include "core/source/remote/address.h"
#include "core/source/remote/copy_folder.h"
#include "core/source/remote/fetch.h"
#include "core/source/remote/list_objects.h"
#include "core/source/remote/open_address.h"
#include "core/source/remote/remote_client.h"
#include "core/source/remote/transfer_engine.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMinStretchBytes = 2 * base::kMiB;
constexpr std::int64_t kMaxStretchBytes = 64 * base::kMiB;
constexpr std::int64_t kCopyPieceBytes = 2 * base::kMiB;  // many at a time of each stretch
constexpr std::int64_t kMaxRecordBytes = 64 * base::kKiB;
constexpr char kRecordHead[] = "isoscope copy 1";

struct CopyRecord {
  std::string address;
  std::string version;
  std::int64_t size = 0;
  std::int64_t done = 0;
};

// One value a line; a version may have spaces.
std::string EncodeRecord(const CopyRecord& record) {
  return absl::StrCat(kRecordHead, "\n", record.address, "\n", record.version, "\n", record.size,
                      "\n", record.done, "\n");
}

// None if there is no record, or a broken one.
std::optional<CopyRecord> ReadRecord(const std::string& path) {
  const auto text = io::ReadWholeFile(path, kMaxRecordBytes);
  if (!text.ok()) {
    return std::nullopt;
  }
  const std::vector<std::string> lines = absl::StrSplit(*text, '\n');
  CopyRecord record;
  if (lines.size() != 6 || lines[0] != kRecordHead || !absl::SimpleAtoi(lines[3], &record.size) ||
      !absl::SimpleAtoi(lines[4], &record.done) || record.done < 0 || record.done > record.size) {
    return std::nullopt;
  }
  record.address = lines[1];
  record.version = lines[2];
  return record;
}

// Bytes of an earlier copy that this one goes on from. Says in `note` why there are none, if a file
// was begun.
std::int64_t DoneBytes(const CopyRecord& wanted, const std::string& part_path,
                       const std::string& record_path, std::string* note) {
  if (!io::PathExists(part_path)) {
    return 0;
  }
  const std::optional<CopyRecord> record = ReadRecord(record_path);
  if (!record) {
    *note = "what was copied before has no record";
  } else if (record->address != wanted.address) {
    *note = absl::StrCat("what was copied before is of ", record->address);
  } else if (record->size != wanted.size) {
    *note = absl::StrCat("the object has changed: it had ", record->size, " bytes, and has ",
                         wanted.size);
  } else if (record->version != wanted.version) {
    *note = absl::StrCat("the object has changed: its version was ",
                         base::Quoted(record->version, '\''), ", and is ",
                         base::Quoted(wanted.version, '\''));
  } else if (wanted.version.empty()) {
    *note = "the server gives no ETag and no time, so that the object may have changed";
  } else {
    return record->done;
  }
  return 0;
}

// The file of the bytes so far, cut to `done` bytes. None of them: a new file.
absl::StatusOr<std::unique_ptr<io::WritableFile>> OpenPart(const std::string& path,
                                                           std::int64_t done) {
  if (done == 0) {
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(path));
    return io::CreateWritableFile(path);
  }
  return io::ContinueWritableFile(path, done);
}

// Writes stretches, each while the next one is read. The record tells what is written.
class StretchWriter {
 public:
  StretchWriter(std::string part_path, std::string record_path, CopyRecord* record)
      : part_path_(std::move(part_path)), record_path_(std::move(record_path)), record_(record) {}
  ~StretchWriter() { Finish().IgnoreError(); }
  StretchWriter(const StretchWriter&) = delete;
  StretchWriter& operator=(const StretchWriter&) = delete;

  // Waits for the stretch before, and returns its error; else begins to write `bytes`, in whose
  // place it leaves other memory.
  absl::Status Write(std::string* bytes) {
    ISOSCOPE_RETURN_IF_ERROR(Finish());
    bytes_.swap(*bytes);
    thread_ = std::thread([this] { status_ = WriteNow(); });
    return absl::OkStatus();
  }
  absl::Status Finish() {
    if (thread_.joinable()) {
      thread_.join();
    }
    return status_;
  }

 private:
  absl::Status WriteNow() {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::WritableFile> part,
                              OpenPart(part_path_, record_->done));
    ISOSCOPE_RETURN_IF_ERROR(part->Append(bytes_));
    ISOSCOPE_RETURN_IF_ERROR(part->Close());
    record_->done += static_cast<std::int64_t>(bytes_.size());
    return io::WriteFileAtomically(record_path_, EncodeRecord(*record_));
  }

  const std::string part_path_;
  const std::string record_path_;
  CopyRecord* const record_;
  std::string bytes_;
  absl::Status status_;
  std::thread thread_;
};

// Copies from record->done on.
absl::Status CopyRest(const ByteSource& source, const std::string& part_path,
                      const std::string& record_path, CopyRecord* record, const CopyHooks& hooks,
                      const base::Cancellation& cancellation) {
  const std::int64_t size = record->size;
  std::int64_t done = record->done;
  std::int64_t stretch_bytes = kMinStretchBytes;
  std::string bytes;
  StretchWriter writer(part_path, record_path, record);
  do {
    const base::MonotonicTime begin = base::MonotonicNow();
    bytes.resize(static_cast<std::size_t>(std::min(stretch_bytes, size - done)));
    ISOSCOPE_RETURN_IF_ERROR(source.ReadAt(done, bytes.size(), bytes.data(), cancellation));
    done += static_cast<std::int64_t>(bytes.size());
    ISOSCOPE_RETURN_IF_ERROR(writer.Write(&bytes));
    if (hooks.progress && size > 0) {
      hooks.progress(done, size);
    }
    // Stretches of some seconds: progress is seen, and little is read twice.
    const absl::Duration elapsed = base::MonotonicNow() - begin;
    if (elapsed < absl::Seconds(1)) {
      stretch_bytes = std::min(2 * stretch_bytes, kMaxStretchBytes);
    } else if (elapsed > absl::Seconds(5)) {
      stretch_bytes = std::max(stretch_bytes / 2, kMinStretchBytes);
    }
  } while (done < size);
  return writer.Finish();
}

// Writes a body to a file; a body that begins again begins the file again. It is called by the
// engine's thread while the copy waits.
class FileSink : public FetchSink {
 public:
  FileSink(std::string path, const CopyHooks& hooks) : path_(std::move(path)), hooks_(hooks) {}

  absl::Status Begin(std::int64_t size) override {
    total_bytes_ = size;
    done_bytes_ = 0;
    file_ = nullptr;
    ISOSCOPE_ASSIGN_OR_RETURN(file_, OpenPart(path_, 0));
    return absl::OkStatus();
  }
  absl::Status Append(absl::string_view bytes) override {
    ISOSCOPE_RETURN_IF_ERROR(file_->Append(bytes));
    done_bytes_ += static_cast<std::int64_t>(bytes.size());
    if (hooks_.progress && total_bytes_ > 0) {
      hooks_.progress(std::min(done_bytes_, total_bytes_), total_bytes_);
    }
    return absl::OkStatus();
  }
  // Of an empty body Begin may not have been called.
  absl::Status Close() {
    if (file_ == nullptr) {
      ISOSCOPE_RETURN_IF_ERROR(Begin(0));
    }
    return file_->Close();
  }
  [[nodiscard]] std::int64_t done_bytes() const { return done_bytes_; }

 private:
  const std::string path_;
  const CopyHooks& hooks_;
  std::unique_ptr<io::WritableFile> file_;
  std::int64_t done_bytes_ = 0;
  std::int64_t total_bytes_ = -1;
};

// Forgets what comes.
class IdleSink : public FetchSink {
 public:
  absl::Status Begin(std::int64_t /*size*/) override { return absl::OkStatus(); }
  absl::Status Append(absl::string_view /*bytes*/) override { return absl::OkStatus(); }
};

// Asks for a range again. Returns the object's version if the server ignores ranges, or tells no size
// with them; not set: it does not, so that an earlier error stands.
absl::StatusOr<std::optional<ObjectVersion>> VersionWithoutRanges(
    RemoteClient* client, const Address& address, const base::Cancellation& cancellation) {
  IdleSink sink;
  FetchJob job{
      .address = address, .kind = FetchJob::Kind::kWithin, .first = 0, .last = 1, .sink = &sink};
  Fetch(client, absl::MakeSpan(&job, 1), /*stops_at_error=*/true, cancellation).IgnoreError();
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  const bool is_whole = job.ignores_ranges || (job.status.ok() && job.version.size < 0);
  return is_whole ? std::optional<ObjectVersion>(job.version) : std::nullopt;
}

struct WholeCopy {
  std::int64_t size_bytes = 0;
  std::string version;
  bool is_folder = false;  // the server led to the page of a folder
};
// Copies an object with one request, as servers without ranges need it. Nothing but `expected`, of
// another answer, tells that a body is whole.
absl::StatusOr<WholeCopy> CopyWhole(RemoteClient* client, const Address& address,
                                    const ObjectVersion& expected, const std::string& part_path,
                                    const CopyHooks& hooks,
                                    const base::Cancellation& cancellation) {
  FileSink sink(part_path, hooks);
  FetchJob job{.address = address, .expected = &expected, .sink = &sink};
  ISOSCOPE_RETURN_IF_ERROR(
      Fetch(client, absl::MakeSpan(&job, 1), /*stops_at_error=*/true, cancellation));
  ISOSCOPE_RETURN_IF_ERROR(sink.Close());
  return WholeCopy{.size_bytes = sink.done_bytes(),
                   .version = job.version.etag,
                   .is_folder = job.redirected.has_value() &&
                                job.redirected->path == absl::StrCat(address.path, "/")};
}

struct CopyParts {
  std::string path;
  std::string part = absl::StrCat(path, ".part");
  std::string record = absl::StrCat(path, ".part.record");
  std::string lock = absl::StrCat(path, ".part.lock");
};

absl::Status FinishCopy(const CopyParts& names) {
  ISOSCOPE_RETURN_IF_ERROR(io::RenamePath(names.part, names.path));
  for (const std::string& path : {names.record, names.lock}) {
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(path));
  }
  return absl::OkStatus();
}

// The error of a copy that made nothing leaves nothing. new_folder: one that was made for it, or ""
absl::Status EndCopy(const CopyParts& names, const std::string& new_folder,
                     const absl::Status& status) {
  if (!status.ok() && !io::PathExists(names.part)) {
    io::RemoveRecursively(names.lock).IgnoreError();  // an empty file; the copy's error counts
    std::error_code ignored;                          // a folder that is not empty stays
    std::filesystem::remove(new_folder, ignored);
  }
  return status;
}

// Copies one object. Not set: what is there is the page of a folder.
absl::StatusOr<std::optional<CopyReport>> CopyObject(RemoteClient* client, const Address& address,
                                                     const std::string& folder,
                                                     const CopyHooks& hooks,
                                                     const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string name, CopyNameOf(address));
  CopyReport report{.path = absl::StrCat(folder, "/", name)};
  if (io::PathExists(report.path)) {
    return absl::AlreadyExistsError(
        absl::StrCat(report.path, ": is there already; remove it to copy it again"));
  }
  absl::StatusOr<std::unique_ptr<ByteSource>> source = OpenAddress(
      address.is_s3 ? NameOf(address) : UrlOf(address), client->options(), cancellation);
  std::optional<ObjectVersion> without_ranges;
  if (absl::IsFailedPrecondition(source.status())) {
    ISOSCOPE_ASSIGN_OR_RETURN(without_ranges, VersionWithoutRanges(client, address, cancellation));
  }
  if (!source.ok() && !without_ranges.has_value()) {
    return source.status();
  }
  std::string new_folder;
  if (!io::PathExists(folder)) {
    ISOSCOPE_RETURN_IF_ERROR(io::CreateDirectory(folder));
    new_folder = folder;
  }
  const CopyParts names{.path = report.path};
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::FileLock> lock,
                            io::FileLock::Take(names.lock));
  if (without_ranges.has_value()) {
    const auto whole = CopyWhole(client, address, *without_ranges, names.part, hooks, cancellation);
    if (!whole.ok()) {
      return EndCopy(names, new_folder, whole.status());
    }
    if (whole->is_folder) {
      for (const std::string& path : {names.part, names.lock}) {
        ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(path));
      }
      return std::nullopt;
    }
    report.size_bytes = whole->size_bytes;
    report.version = whole->version;
    ISOSCOPE_RETURN_IF_ERROR(FinishCopy(names));
    return report;
  }
  report.size_bytes = (*source)->size_bytes();
  report.version = (*source)->version();
  CopyRecord record{.address = (*source)->name(),
                    .version = (*source)->version(),
                    .size = (*source)->size_bytes()};
  std::string reason;
  record.done = DoneBytes(record, names.part, names.record, &reason);
  if (record.done > 0) {
    // A part that is shorter than its record can't be gone on from.
    const auto part = io::ContinueWritableFile(names.part, record.done);
    if (!part.ok()) {
      reason = std::string(part.status().message());
      record.done = 0;
    }
  }
  report.kept_bytes = record.done;
  if (hooks.note && record.done > 0) {
    hooks.note(
        absl::StrCat(report.path, ": goes on after ", record.done, " of ", record.size, " bytes"));
  } else if (hooks.note && !reason.empty()) {
    hooks.note(absl::StrCat(report.path, ": begins again: ", reason));
  }
  if (record.done < record.size || record.size == 0) {
    ISOSCOPE_RETURN_IF_ERROR(
        EndCopy(names, new_folder,
                CopyRest(**source, names.part, names.record, &record, hooks, cancellation)));
  }
  ISOSCOPE_RETURN_IF_ERROR(FinishCopy(names));
  return report;
}

}  // namespace

absl::StatusOr<CopyReport> CopyAddress(absl::string_view address, const std::string& folder,
                                       const RemoteOptions& options, const CopyHooks& hooks,
                                       const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Address parsed, ParseAddress(address));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string name, CopyNameOf(parsed));
  RemoteOptions copy_options = options;
  copy_options.ranges.max_piece_bytes = kCopyPieceBytes;
  RemoteClient client(copy_options, TransferEngine::OfProcess());
  // 1. One object.
  const std::string& path = parsed.is_s3 ? parsed.key : parsed.path;
  absl::Status object_error;
  if (!path.empty() && !absl::EndsWith(path, "/")) {
    const auto report = CopyObject(&client, parsed, folder, hooks, cancellation);
    if (report.ok() && report->has_value()) {
      return **report;
    }
    object_error = report.status();
    const bool may_be_folder = report.ok() || absl::IsNotFound(object_error) ||
                               (parsed.is_s3 && absl::IsPermissionDenied(object_error));
    // A file of that name was begun: it is an object, which went away.
    const std::string part = absl::StrCat(folder, "/", name, ".part");
    if (!may_be_folder || (io::PathExists(part) && !io::IsDirectory(part))) {
      return object_error;
    }
  }
  // 2. All below it.
  const auto objects = ListObjects(&client, parsed, cancellation);
  if (!objects.ok()) {
    const bool is_told = object_error.ok() || absl::IsCancelled(objects.status()) ||
                         absl::IsInvalidArgument(objects.status());  // a list, but a bad one
    const absl::Status error = is_told ? objects.status() : object_error;
    return absl::IsNotFound(error) && !parsed.is_s3
               ? absl::NotFoundError(
                     absl::StrCat(error.message(),
                                  "; a folder is copied if the server has a page that lists it"))
               : error;
  }
  const auto copy_large = [&](const Address& object,
                              const std::string& below) -> absl::StatusOr<CopyReport> {
    CopyHooks silent;
    ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<CopyReport> report,
                              CopyObject(&client, object, below, silent, cancellation));
    return report.has_value() ? absl::StatusOr<CopyReport>(*report)
                              : absl::NotFoundError(absl::StrCat(
                                    NameOf(object), ": is a folder; expected an object"));
  };
  return CopyFolder(&client, parsed, *objects, folder, copy_large, hooks, cancellation);
}

}  // namespace isoscope::source
