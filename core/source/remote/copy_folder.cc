// Steps: name, lock, then the record:
//
//   isoscope copy of a folder 1
//   s3://bucket/run.zarr
//   "9bb58f26192e4ba00f01e2e7b136bbd8"<TAB>c/0/0/1     a version and a key, for each object
//
// 1. Of the objects in the record, the first byte is asked for: its answer has version and size.
// 2. The others are copied, many at a time; those of more than 8 MiB one by one, by pieces.
// 3. Each batch is on the disk before its lines are in the record. At last the name.

#include "core/source/remote/copy_folder.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/types/span.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/atomic_file.h"
#include "core/io/continued_file.h"
#include "core/io/file.h"
#include "core/io/file_lock.h"
#include "core/io/file_stamp.h"
#include "core/source/remote/fetch.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kLargeObjectBytes = 8 * base::kMiB;
constexpr std::size_t kBatchObjects = 16;  // of unknown size: 128 MiB at most
constexpr std::size_t kVersionBatch = 256;
constexpr std::int64_t kMaxFolderRecordBytes = 4 * base::kGiB;
constexpr std::size_t kMaxFolderNameBytes = 240;  // 255 with the longest ending of ours
constexpr char kFolderRecordHead[] = "isoscope copy of a folder 1";

// Keeps a small object; a larger one is RESOURCE_EXHAUSTED.
class SmallObjectSink : public FetchSink {
 public:
  absl::Status Begin(std::int64_t size) override {
    bytes_.clear();
    return size > kLargeObjectBytes ? TooLarge() : absl::OkStatus();
  }
  absl::Status Append(absl::string_view bytes) override {
    if (static_cast<std::int64_t>(bytes_.size() + bytes.size()) > kLargeObjectBytes) {
      return TooLarge();
    }
    bytes_.append(bytes.data(), bytes.size());
    return absl::OkStatus();
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  static absl::Status TooLarge() { return absl::ResourceExhaustedError("more than 8 MiB"); }

  std::string bytes_;
};

// The version of an answer; empty: the server tells none.
std::string VersionOf(const ObjectVersion& version) {
  std::string text = !version.etag.empty() ? version.etag : version.last_modified;
  for (char& c : text) {
    c = absl::ascii_iscntrl(static_cast<unsigned char>(c)) ? ' ' : c;
  }
  return text;
}

// Makes the folders of a path below `top`, which is there.
absl::Status MakeFolders(const std::string& top, absl::string_view key,
                         std::set<std::string>* made) {
  for (std::size_t slash = key.find('/'); slash != absl::string_view::npos;
       slash = key.find('/', slash + 1)) {
    const std::string path = absl::StrCat(top, "/", key.substr(0, slash));
    if (made->contains(path)) {
      continue;
    }
    if (!io::IsDirectory(path)) {
      ISOSCOPE_RETURN_IF_ERROR(io::CreateDirectory(path));
    }
    made->insert(path);
  }
  return absl::OkStatus();
}

// A file can't be a folder, too.
absl::Status CheckIsTree(const Address& prefix, const std::vector<ListedObject>& objects) {
  std::set<std::string> folders;
  for (const ListedObject& object : objects) {
    for (std::size_t slash = object.key.find('/'); slash != std::string::npos;
         slash = object.key.find('/', slash + 1)) {
      folders.insert(object.key.substr(0, slash));
    }
  }
  for (const ListedObject& object : objects) {
    if (folders.contains(object.key)) {
      return absl::InvalidArgumentError(absl::StrCat(
          NameOf(prefix), ": ", base::Quoted(object.key),
          " is an object and the folder of others, which no disk can hold: copy its parts"));
    }
  }
  return absl::OkStatus();
}

class FolderCopy {
 public:
  FolderCopy(RemoteClient* client, const Address& prefix, const std::string& path,
             const CopyHooks& hooks, const base::Cancellation& cancellation)
      : client_(client),
        prefix_(prefix),
        part_path_(absl::StrCat(path, ".part")),
        record_path_(absl::StrCat(path, ".part.record")),
        hooks_(hooks),
        cancellation_(cancellation) {}

  // Step 1. Returns those of `objects` that are to be copied.
  absl::StatusOr<std::vector<ListedObject>> KeepCopied(const std::vector<ListedObject>& objects);
  // Step 2.
  absl::Status CopyRest(const std::vector<ListedObject>& objects, CopyLargeObject copy_large);
  absl::Status CopyLarge(const ListedObject& object, CopyLargeObject copy_large);

  [[nodiscard]] const CopyReport& report() const { return report_; }
  [[nodiscard]] const std::string& part_path() const { return part_path_; }
  [[nodiscard]] const std::string& record_path() const { return record_path_; }

 private:
  // Keys and versions of the record; not set if it is another folder's, or broken.
  [[nodiscard]] std::optional<std::map<std::string, std::string>> ReadRecord() const;
  absl::Status BeginRecord();
  absl::Status AddToRecord(const std::string& lines);
  [[nodiscard]] std::string PathOf(const std::string& key) const {
    return absl::StrCat(part_path_, "/", key);
  }
  void ShowProgress() const {
    if (hooks_.progress && total_objects_ > 0) {
      hooks_.progress(done_objects_, total_objects_);
    }
  }

  RemoteClient* const client_;
  const Address prefix_;
  const std::string part_path_;
  const std::string record_path_;
  const CopyHooks& hooks_;
  const base::Cancellation& cancellation_;

  CopyReport report_;
  std::set<std::string> folders_;  // that were made
  std::int64_t record_bytes_ = 0;
  std::int64_t done_objects_ = 0;
  std::int64_t total_objects_ = 0;
};

std::optional<std::map<std::string, std::string>> FolderCopy::ReadRecord() const {
  const auto text = io::ReadWholeFile(record_path_, kMaxFolderRecordBytes);
  if (!text.ok()) {
    return std::nullopt;
  }
  std::map<std::string, std::string> versions;
  int number = 0;
  // The last line may have been cut by a crash.
  const absl::string_view whole = absl::string_view(*text).substr(0, text->rfind('\n') + 1);
  for (const absl::string_view line : absl::StrSplit(whole, '\n')) {
    ++number;
    if (number == 1 || number == 2) {
      if (line != (number == 1 ? absl::string_view(kFolderRecordHead)
                               : absl::string_view(NameOf(prefix_)))) {
        return std::nullopt;
      }
      continue;
    }
    const std::size_t tab = line.find('\t');
    if (tab != absl::string_view::npos) {
      versions[std::string(line.substr(tab + 1))] = std::string(line.substr(0, tab));
    }
  }
  return number < 2 ? std::nullopt
                    : std::optional<std::map<std::string, std::string>>(std::move(versions));
}

absl::Status FolderCopy::BeginRecord() {
  const std::string head = absl::StrCat(kFolderRecordHead, "\n", NameOf(prefix_), "\n");
  ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(record_path_, head));
  record_bytes_ = static_cast<std::int64_t>(head.size());
  return absl::OkStatus();
}

absl::Status FolderCopy::AddToRecord(const std::string& lines) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::WritableFile> record,
                            io::ContinueWritableFile(record_path_, record_bytes_));
  ISOSCOPE_RETURN_IF_ERROR(record->Append(lines));
  ISOSCOPE_RETURN_IF_ERROR(record->Close());
  record_bytes_ += static_cast<std::int64_t>(lines.size());
  return absl::OkStatus();
}

absl::StatusOr<std::vector<ListedObject>> FolderCopy::KeepCopied(
    const std::vector<ListedObject>& objects) {
  total_objects_ = static_cast<std::int64_t>(objects.size());
  report_.object_count = total_objects_;
  const auto versions = ReadRecord();
  if (!io::IsDirectory(part_path_) || !versions.has_value()) {
    if (hooks_.note && io::PathExists(part_path_)) {
      hooks_.note(
          absl::StrCat(part_path_, ": begins again: it has no record of ", NameOf(prefix_)));
    }
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(part_path_));
    ISOSCOPE_RETURN_IF_ERROR(io::CreateDirectory(part_path_));
    ISOSCOPE_RETURN_IF_ERROR(BeginRecord());
    return objects;
  }
  ISOSCOPE_RETURN_IF_ERROR(BeginRecord());  // of those that are kept
  std::vector<ListedObject> rest;
  std::int64_t changed = 0;
  for (std::size_t begin = 0; begin < objects.size(); begin += kVersionBatch) {
    std::vector<const ListedObject*> known;
    for (std::size_t i = begin; i < std::min(begin + kVersionBatch, objects.size()); ++i) {
      const auto version = versions->find(objects[i].key);
      if (version != versions->end() && !version->second.empty() &&
          io::PathExists(PathOf(objects[i].key))) {
        known.push_back(&objects[i]);
      } else {
        rest.push_back(objects[i]);
      }
    }
    std::vector<SmallObjectSink> sinks(known.size());
    std::vector<FetchJob> jobs;
    for (std::size_t i = 0; i < known.size(); ++i) {
      jobs.push_back({.address = AddressBelow(prefix_, known[i]->key),
                      .kind = FetchJob::Kind::kWithin,
                      .first = 0,
                      .last = 0,
                      .sink = &sinks[i]});
    }
    Fetch(client_, absl::MakeSpan(jobs), /*stops_at_error=*/false, cancellation_).IgnoreError();
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    std::string lines;
    for (std::size_t i = 0; i < known.size(); ++i) {
      const std::int64_t size = io::StampOf(PathOf(known[i]->key)).size;
      const std::string& version = versions->at(known[i]->key);
      if (jobs[i].status.ok() && VersionOf(jobs[i].version) == version &&
          jobs[i].version.size == size) {
        absl::StrAppend(&lines, version, "\t", known[i]->key, "\n");
        report_.size_bytes += size;
        report_.kept_bytes += size;
        ++done_objects_;
      } else {
        ++changed;
        rest.push_back(*known[i]);
      }
    }
    if (!lines.empty()) {
      ISOSCOPE_RETURN_IF_ERROR(AddToRecord(lines));
    }
  }
  if (hooks_.note) {
    hooks_.note(absl::StrCat(
        part_path_, ": goes on after ", done_objects_, " of ", total_objects_, " objects",
        changed > 0
            ? absl::StrCat("; ", changed, " are copied again, because they may have changed")
            : ""));
  }
  return rest;
}

absl::Status FolderCopy::CopyLarge(const ListedObject& object, CopyLargeObject copy_large) {
  const std::string path = PathOf(object.key);
  const std::string folder = path.substr(0, path.rfind('/'));
  // A copy of an earlier call, whose version is another one.
  ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const CopyReport copied,
                            copy_large(AddressBelow(prefix_, object.key), folder));
  report_.size_bytes += copied.size_bytes;
  report_.kept_bytes += copied.kept_bytes;
  ++done_objects_;
  return AddToRecord(absl::StrCat(copied.version, "\t", object.key, "\n"));
}

absl::Status FolderCopy::CopyRest(const std::vector<ListedObject>& objects,
                                  CopyLargeObject copy_large) {
  for (std::size_t begin = 0; begin < objects.size(); begin += kBatchObjects) {
    const std::size_t end = std::min(begin + kBatchObjects, objects.size());
    std::vector<const ListedObject*> small;
    std::vector<const ListedObject*> large;
    for (std::size_t i = begin; i < end; ++i) {
      ISOSCOPE_RETURN_IF_ERROR(MakeFolders(part_path_, objects[i].key, &folders_));
      (objects[i].size > kLargeObjectBytes ? large : small).push_back(&objects[i]);
    }
    std::vector<SmallObjectSink> sinks(small.size());
    std::vector<ObjectVersion> listed(small.size());
    std::vector<FetchJob> jobs;
    for (std::size_t i = 0; i < small.size(); ++i) {
      listed[i].size = small[i]->size;
      jobs.push_back({.address = AddressBelow(prefix_, small[i]->key),
                      .expected = &listed[i],
                      .sink = &sinks[i]});
    }
    Fetch(client_, absl::MakeSpan(jobs), /*stops_at_error=*/false, cancellation_).IgnoreError();
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    std::string lines;
    absl::Status error;
    for (std::size_t i = 0; i < small.size(); ++i) {
      if (absl::IsResourceExhausted(jobs[i].status)) {
        large.push_back(small[i]);
        continue;
      }
      if (!jobs[i].status.ok()) {
        error = error.ok() ? jobs[i].status : error;
        continue;
      }
      ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(PathOf(small[i]->key), sinks[i].bytes()));
      absl::StrAppend(&lines, VersionOf(jobs[i].version), "\t", small[i]->key, "\n");
      report_.size_bytes += static_cast<std::int64_t>(sinks[i].bytes().size());
      ++done_objects_;
    }
    if (!lines.empty()) {
      ISOSCOPE_RETURN_IF_ERROR(AddToRecord(lines));
    }
    ISOSCOPE_RETURN_IF_ERROR(error);
    for (const ListedObject* const object : large) {
      ISOSCOPE_RETURN_IF_ERROR(CopyLarge(*object, copy_large));
    }
    ShowProgress();
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::string> CopyNameOf(const Address& address) {
  Address named = address;
  std::string& path = named.is_s3 ? named.key : named.path;
  while (absl::EndsWith(path, "/")) {
    path.pop_back();
  }
  std::string name = named.is_s3 && path.empty() ? named.bucket : LastPartOf(named);
  if (name.empty() || name == "." || name == ".." || name.find('/') != std::string::npos ||
      name.size() > kMaxFolderNameBytes || std::any_of(name.begin(), name.end(), [](char c) {
        return absl::ascii_iscntrl(static_cast<unsigned char>(c));
      })) {
    return absl::InvalidArgumentError(absl::StrCat(
        NameOf(address), ": ends in ", base::Quoted(name),
        ", which is no name of a file; expected the address of an object or a folder"));
  }
  return name;
}

absl::StatusOr<CopyReport> CopyFolder(RemoteClient* client, const Address& prefix,
                                      const std::vector<ListedObject>& objects,
                                      const std::string& folder, CopyLargeObject copy_large,
                                      const CopyHooks& hooks,
                                      const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string name, CopyNameOf(prefix));
  const std::string path = absl::StrCat(folder, "/", name);
  if (io::PathExists(path)) {
    return absl::AlreadyExistsError(
        absl::StrCat(path, ": is there already; remove it to copy it again"));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckIsTree(prefix, objects));
  if (!io::PathExists(folder)) {
    ISOSCOPE_RETURN_IF_ERROR(io::CreateDirectory(folder));
  }
  const std::string lock_path = absl::StrCat(path, ".part.lock");
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::FileLock> lock,
                            io::FileLock::Take(lock_path));
  FolderCopy copy(client, prefix, path, hooks, cancellation);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<ListedObject> rest, copy.KeepCopied(objects));
  ISOSCOPE_RETURN_IF_ERROR(copy.CopyRest(rest, copy_large));
  ISOSCOPE_RETURN_IF_ERROR(io::RenamePath(copy.part_path(), path));
  for (const std::string& left : {copy.record_path(), lock_path}) {
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(left));
  }
  CopyReport report = copy.report();
  report.path = path;
  return report;
}

}  // namespace isoscope::source
