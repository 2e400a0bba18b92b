// How a dataset enters the cache:
//
// 1. If the entry exists and `verify` accepts it, it is locked and used.
// 2. Else it is made in a work folder, locked there, and renamed into place: other processes see it
//    only complete and in use.
// 3. If another process was faster, its entry is used. A damaged entry is moved into the work
//    folder, and removed with it.
//
// The key of an entry is SHA-256 over text, so that a changed source gets another entry:
//
//   isoscope source 1             source::Describe: the program's version, and a line for each
//   program 0.1.0                 member of the request
//   path "/data/head.nii.gz"
//   ...
//   /data/head.nii.gz             source::StampsOf: for each file its path,
//   7654321 1700000000.5 ...      its size, and the times of the last change of bytes and of status
//   isoscope-cache-7              the version of this scheme
//   ...                           the parameters of the partitioning

#include "client-cli/session/dataset_cache.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <ostream>
#include <random>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include <sys/file.h>
#include <sys/stat.h>

#include "clients/cpp/request/parse_value.h"
#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/cli/format.h"
#include "core/cli/usage.h"
#include "core/io/file.h"
#include "core/io/work_folder.h"
#include "core/source/source_stamps.h"

namespace isoscope::cli {
namespace {

namespace fs = std::filesystem;

// Raised when the same source and parameters would give another dataset than before.
constexpr absl::string_view kKeyVersion = "isoscope-cache-7";
constexpr const char* kLimitVariable = "ISOSCOPE_CACHE_LIMIT";
constexpr std::int64_t kMaxDefaultLimitBytes = 20 * base::kGiB;
constexpr std::int64_t kDefaultShareOfFileSystem = 10;  // one tenth

std::string Environment(const char* name) {
  const char* value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): nobody sets any
  return value == nullptr ? "" : value;
}

enum class Links { kRefused, kTaken };

// Creates `directory` with its parents, for this user alone; the error has the reason.
absl::Status MakeOwnDirectory(const std::string& directory, Links links) {
  std::error_code error;
  fs::create_directories(fs::path(directory).parent_path(), error);
  if (mkdir(directory.c_str(), S_IRWXU) != 0 && errno != EEXIST) {
    return io::ErrnoToStatus(errno, "can't make folder", directory);
  }
  struct stat named {};
  if (lstat(directory.c_str(), &named) != 0) {
    return io::ErrnoToStatus(errno, "can't look at", directory);
  }
  struct stat info = named;
  if (S_ISLNK(named.st_mode) && links == Links::kTaken && stat(directory.c_str(), &info) != 0) {
    return io::ErrnoToStatus(errno, "can't follow the link", directory);
  }
  // Another user could have created a folder, or a link, in /tmp.
  if (!S_ISDIR(info.st_mode) || named.st_uid != geteuid() || info.st_uid != geteuid() ||
      access(directory.c_str(), W_OK) != 0) {
    return absl::PermissionDeniedError(
        absl::StrCat("'", directory, "' is no folder of this user that can be written"));
  }
  return absl::OkStatus();
}

// Returns the name of a file without folders and suffixes, in the characters of a dataset's name.
std::string ReadableStem(const std::string& path) {
  std::string stem = fs::path(path).filename().string();
  stem = stem.substr(0, stem.find('.', 1));
  for (char& c : stem) {
    if (!absl::ascii_isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '_') {
      c = '_';
    }
  }
  if (stem.empty() || stem.front() == '-') {
    stem.insert(0, "_");
  }
  return stem.substr(0, 40);
}

}  // namespace

absl::StatusOr<CacheFolder> FindCacheFolder() {
  const std::string xdg = Environment("XDG_CACHE_HOME");
  const std::string home = Environment("HOME");
  const std::string temporary = Environment("TMPDIR");
  std::vector<std::pair<std::string, Links>> candidates;
  if (absl::StartsWith(xdg, "/")) {  // the XDG specification ignores relative paths
    candidates.emplace_back(xdg + "/isoscope", Links::kTaken);
  } else if (absl::StartsWith(home, "/")) {
    candidates.emplace_back(home + "/.cache/isoscope", Links::kTaken);
  }
  candidates.emplace_back(
      absl::StrCat(absl::StartsWith(temporary, "/") ? temporary : "/tmp", "/isoscope-", geteuid()),
      Links::kRefused);
  std::vector<std::string> reasons;
  for (const auto& [path, links] : candidates) {
    const absl::Status status = MakeOwnDirectory(path, links);
    if (status.ok()) {
      return CacheFolder{.path = path, .passed_over = absl::StrJoin(reasons, "; ")};
    }
    reasons.emplace_back(status.message());
  }
  return absl::FailedPreconditionError(
      absl::StrCat("no folder for the cache of datasets: ", absl::StrJoin(reasons, "; "),
                   "; set XDG_CACHE_HOME, or partition the volume first"));
}

absl::StatusOr<std::string> CacheDirectory(std::ostream* err) {
  ISOSCOPE_ASSIGN_OR_RETURN(CacheFolder folder, FindCacheFolder());
  if (!folder.passed_over.empty()) {
    *err << "isoscope: the cache of datasets is in " << folder.path << ", because "
         << folder.passed_over << "; XDG_CACHE_HOME can name another folder" << std::endl;
  }
  return std::move(folder.path);
}

absl::StatusOr<std::string> CacheKey(const source::OpenRequest& request,
                                     const std::vector<std::string>& files,
                                     absl::string_view parameters) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string path, source::ResolvedPath(request.path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string description, source::Describe(request));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string stamps, source::StampsOf(files));
  // Stamps that tell not all are of no use to a later process.
  static const auto* const this_process =
      new std::string(absl::StrCat(std::random_device()(), ".", std::random_device()(), "\n"));
  const std::string nonce = source::StampsTellAll(files) ? "" : *this_process;
  return absl::StrCat(
      ReadableStem(path), "-",
      base::Sha256Hex(absl::StrCat(description, stamps, nonce, kKeyVersion, "\n", parameters))
          .substr(0, 16));
}

absl::StatusOr<CachedDataset> FindOrMakeDataset(const std::string& cache_directory,
                                                const std::string& key, absl::string_view source,
                                                MakeDataset make, VerifyDataset verify) {
  CachedDataset dataset{.directory = absl::StrCat(cache_directory, "/", key)};
  const auto find = [&] {
    absl::StatusOr<EntryLock> lock = UseEntry(dataset.directory, source);
    if (!lock.ok() || !verify(dataset.directory).ok()) {
      return false;
    }
    dataset.lock = *std::move(lock);
    return true;
  };
  if (io::PathExists(dataset.directory) && find()) {
    return dataset;
  }
  io::RemoveLeftovers(cache_directory, kWorkPrefix);
  ISOSCOPE_ASSIGN_OR_RETURN(const io::WorkFolder work,
                            io::WorkFolder::Make(cache_directory, std::string(kWorkPrefix)));
  const std::string made = absl::StrCat(work.path(), "/", key);
  ISOSCOPE_RETURN_IF_ERROR(make(made));
  // Locked before other processes can see it.
  ISOSCOPE_ASSIGN_OR_RETURN(EntryLock lock, UseEntry(made, source));
  // Another process may have finished the same dataset: then that one is used. A damaged one is
  // removed with the work folder.
  if (io::PathExists(dataset.directory)) {
    if (find()) {
      return dataset;
    }
    std::error_code ignored;  // a third process may have moved it; the rename below reports that
    fs::rename(dataset.directory, work.path() + "/damaged", ignored);
  }
  const absl::Status renamed = io::RenamePath(made, dataset.directory);
  if (renamed.ok()) {
    dataset.lock = std::move(lock);
    dataset.was_made = true;
    return dataset;
  }
  return find() ? absl::StatusOr<CachedDataset>(std::move(dataset)) : renamed;
}

absl::StatusOr<std::int64_t> CacheLimitBytes(const std::optional<std::int64_t>& flag,
                                             const std::string& cache_directory) {
  if (flag) {
    return *flag;
  }
  if (const std::string text = Environment(kLimitVariable); !text.empty()) {
    absl::StatusOr<std::int64_t> limit_bytes = client::ParseByteSize(text);
    return limit_bytes.ok() ? limit_bytes
                            : UsageError(absl::StrCat("the environment variable ", kLimitVariable,
                                                      ": ", limit_bytes.status().message()));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<CacheEntry> entries, ListEntries(cache_directory));
  std::error_code error;
  const fs::space_info space = fs::space(cache_directory, error);
  if (error) {
    return kMaxDefaultLimitBytes;
  }
  const std::uintmax_t tenth =
      (space.available + static_cast<std::uintmax_t>(TotalBytes(entries))) /
      kDefaultShareOfFileSystem;
  return static_cast<std::int64_t>(
      std::min(tenth, static_cast<std::uintmax_t>(kMaxDefaultLimitBytes)));
}

absl::StatusOr<std::vector<CacheEntry>> TrimCache(const std::string& cache_directory,
                                                  std::int64_t limit_bytes) {
  // One process at a time: two would remove more than needed. If folders can't be locked, this
  // extra removal is the only harm.
  const int descriptor = open(cache_directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor >= 0) {
    flock(descriptor, LOCK_EX);
  }
  const EntryLock turn(descriptor);
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<CacheEntry> entries, ListEntries(cache_directory));
  std::int64_t total_bytes = TotalBytes(entries);
  std::vector<CacheEntry> removed;
  for (; total_bytes > limit_bytes && !entries.empty(); entries.pop_back()) {
    CacheEntry& oldest = entries.back();
    ISOSCOPE_ASSIGN_OR_RETURN(const bool is_gone, RemoveEntry(cache_directory, oldest.name));
    if (is_gone) {
      total_bytes -= oldest.size_bytes;
      removed.push_back(std::move(oldest));
    }
  }
  return removed;
}

std::string DescribeLargeEntry(const std::string& cache_directory, std::int64_t limit_bytes,
                               const std::vector<CacheEntry>& entries,
                               const std::string& directory) {
  const std::string name = fs::path(directory).filename().string();
  const auto made = std::find_if(entries.begin(), entries.end(),
                                 [&](const CacheEntry& entry) { return entry.name == name; });
  if (made == entries.end() || made->size_bytes <= kLargeEntryBytes) {
    return "";
  }
  const std::int64_t total_bytes = TotalBytes(entries);
  return absl::StrCat(
      "the partitioned volume, ", FormatMebibytes(made->size_bytes), ", is kept in the cache, ",
      cache_directory, ", which now has ", FormatMebibytes(total_bytes),
      total_bytes > limit_bytes ? ", more than its limit of " : " of at most ",
      FormatMebibytes(limit_bytes), "; 'isoscope cache clear ", name, "' removes it");
}

}  // namespace isoscope::cli
