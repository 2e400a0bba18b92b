// Steps: name, open, lock, compare with the record, then stretch by stretch: read, append, flush,
// record; at last the name. Nothing is made before the object is known to be there.

#include "core/source/remote/copy_address.h"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/time.h"

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
#include "core/source/remote/open_address.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMinStretchBytes = 2 * base::kMiB;
constexpr std::int64_t kMaxStretchBytes = 64 * base::kMiB;
constexpr std::int64_t kCopyPieceBytes = 2 * base::kMiB;  // many at a time of each stretch
constexpr std::int64_t kMaxRecordBytes = 64 * base::kKiB;
constexpr std::size_t kMaxFileNameBytes = 240;  // 255 with the longest ending of ours
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

// The name of the copy.
absl::StatusOr<std::string> FileNameOf(const Address& address) {
  std::string name = LastPartOf(address);
  if (name.empty() || name == "." || name == ".." || name.find('/') != std::string::npos ||
      name.size() > kMaxFileNameBytes || std::any_of(name.begin(), name.end(), [](char c) {
        return absl::ascii_iscntrl(static_cast<unsigned char>(c));
      })) {
    return absl::InvalidArgumentError(
        absl::StrCat(NameOf(address), ": ends in ", base::Quoted(name),
                     ", which is no name of a file; expected the address of one object"));
  }
  return name;
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

// Copies from record->done on.
absl::Status CopyRest(const ByteSource& source, const std::string& part_path,
                      const std::string& record_path, CopyRecord* record, const CopyHooks& hooks,
                      const base::Cancellation& cancellation) {
  std::int64_t stretch_bytes = kMinStretchBytes;
  std::string bytes;
  do {
    const base::MonotonicTime begin = base::MonotonicNow();
    bytes.resize(static_cast<std::size_t>(std::min(stretch_bytes, record->size - record->done)));
    ISOSCOPE_RETURN_IF_ERROR(source.ReadAt(record->done, bytes.size(), bytes.data(), cancellation));
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::WritableFile> part,
                              OpenPart(part_path, record->done));
    ISOSCOPE_RETURN_IF_ERROR(part->Append(bytes));
    ISOSCOPE_RETURN_IF_ERROR(part->Close());
    record->done += static_cast<std::int64_t>(bytes.size());
    ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(record_path, EncodeRecord(*record)));
    if (hooks.progress && record->size > 0) {
      hooks.progress(record->done, record->size);
    }
    // Stretches of some seconds: progress is seen, and little is read twice.
    const absl::Duration elapsed = base::MonotonicNow() - begin;
    if (elapsed < absl::Seconds(1)) {
      stretch_bytes = std::min(2 * stretch_bytes, kMaxStretchBytes);
    } else if (elapsed > absl::Seconds(5)) {
      stretch_bytes = std::max(stretch_bytes / 2, kMinStretchBytes);
    }
  } while (record->done < record->size);
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<CopyReport> CopyAddress(absl::string_view address, const std::string& folder,
                                       const RemoteOptions& options, const CopyHooks& hooks,
                                       const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Address parsed, ParseAddress(address));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string name, FileNameOf(parsed));
  CopyReport report{.path = absl::StrCat(folder, "/", name)};
  if (io::PathExists(report.path)) {
    return absl::AlreadyExistsError(
        absl::StrCat(report.path, ": is there already; remove it to copy it again"));
  }
  RemoteOptions copy_options = options;
  copy_options.ranges.max_piece_bytes = kCopyPieceBytes;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<ByteSource> source,
                            OpenAddress(address, copy_options, cancellation));
  report.size_bytes = source->size_bytes();
  if (!io::PathExists(folder)) {
    ISOSCOPE_RETURN_IF_ERROR(io::CreateDirectory(folder));
  }
  const std::string part_path = report.path + ".part";
  const std::string record_path = part_path + ".record";
  const std::string lock_path = part_path + ".lock";
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::FileLock> lock,
                            io::FileLock::Take(lock_path));
  CopyRecord record{
      .address = source->name(), .version = source->version(), .size = source->size_bytes()};
  std::string reason;
  record.done = DoneBytes(record, part_path, record_path, &reason);
  if (record.done > 0) {
    // A part that is shorter than its record can't be gone on from.
    const auto part = io::ContinueWritableFile(part_path, record.done);
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
    const absl::Status status =
        CopyRest(*source, part_path, record_path, &record, hooks, cancellation);
    if (!status.ok()) {
      if (!io::PathExists(part_path)) {
        io::RemoveRecursively(lock_path).IgnoreError();  // an empty file; the copy's error counts
      }
      return status;
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(io::RenamePath(part_path, report.path));
  for (const std::string& path : {record_path, lock_path}) {
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(path));
  }
  return report;
}

}  // namespace isoscope::source
