// The order of lock and removal (process A uses the entry, B removes it):
//
//   A opens .cache-entry, waits for the shared lock     B holds the exclusive lock
//                                                       B renames the entry away, unlocks
//   A has the lock, of a file that is at its path no
//   more: opens again, and finds nothing
//
// In the other order B's lock fails at once (LOCK_NB): the entry is in use and stays. Locks of
// flock end with their process, so a crash leaves none. If .cache-entry can't be locked (a full
// disk, a file system without locks), the entry is used without a lock.

#include "client-cli/session/cache_entry.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <filesystem>
#include <system_error>
#include <tuple>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include <sys/file.h>
#include <sys/stat.h>

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/io/work_folder.h"
#include "core/store/manifest.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_format.h"

namespace isoscope::cli {
namespace {

namespace fs = std::filesystem;

constexpr absl::string_view kEntryFileName = ".cache-entry";
constexpr absl::string_view kNoteName = ".cache-note";
constexpr absl::string_view kDamagedName = ".cache-damaged";
constexpr std::size_t kDigestLength = 16;
constexpr std::int64_t kMaxSourceBytes = 64 * base::kKiB;
constexpr std::int64_t kMaxManifestBytes = 64 * base::kMiB;

std::string EntryFile(const std::string& directory) {
  return absl::StrCat(directory, "/", kEntryFileName);
}

// Calls flock, again after each signal that interrupts it. Returns 0 or errno.
int Lock(int descriptor, int operation) {
  while (flock(descriptor, operation) != 0) {
    if (errno != EINTR) {
      return errno;
    }
  }
  return 0;
}

// Returns true if `path` names the file that `descriptor` has open.
bool IsFileAt(const std::string& path, int descriptor) {
  struct stat path_stat {};
  struct stat descriptor_stat {};
  return stat(path.c_str(), &path_stat) == 0 && fstat(descriptor, &descriptor_stat) == 0 &&
         std::tie(path_stat.st_dev, path_stat.st_ino) ==
             std::tie(descriptor_stat.st_dev, descriptor_stat.st_ino);
}

// Returns the total size of all files below `directory` that can be read.
std::int64_t SizeOfTree(const fs::path& directory) {
  std::int64_t size_bytes = 0;
  std::error_code error;
  for (fs::recursive_directory_iterator file(directory, error), end; !error && file != end;
       file.increment(error)) {
    std::error_code unknown;
    if (file->is_regular_file(unknown) && !file->is_symlink(unknown)) {
      const std::uintmax_t bytes = file->file_size(unknown);
      size_bytes += unknown ? 0 : static_cast<std::int64_t>(bytes);
    }
  }
  return size_bytes;
}

absl::Time TimeOfChange(const std::string& path) {
  struct stat info {};
  return stat(path.c_str(), &info) == 0 ? absl::TimeFromTimespec(info.st_mtim)
                                        : absl::InfinitePast();
}

bool IsInUse(const std::string& directory) {
  const int descriptor = open(EntryFile(directory).c_str(), O_RDWR | O_CLOEXEC);
  if (descriptor < 0) {
    return false;
  }
  const EntryLock closes(descriptor);
  return Lock(descriptor, LOCK_EX | LOCK_NB) == EWOULDBLOCK;
}

// The file name of the source, from a manifest that can be read, of a series or of one volume,
// whose shards are there.
absl::StatusOr<std::string> SourceNameOf(const std::string& directory) {
  if (store::IsSeriesDirectory(directory)) {
    ISOSCOPE_ASSIGN_OR_RETURN(store::SeriesDescription series, store::OpenSeries(directory));
    ISOSCOPE_RETURN_IF_ERROR(store::CheckComplete(series));
    return std::move(series.manifest.source);
  }
  const std::string path = absl::StrCat(directory, "/", store::kManifestFileName);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes, io::ReadWholeFile(path, kMaxManifestBytes));
  ISOSCOPE_ASSIGN_OR_RETURN(store::Manifest manifest, store::DecodeManifest(bytes, path));
  for (std::size_t shard = 0; shard < manifest.shards.size(); ++shard) {
    const std::string folder =
        absl::StrCat(directory, "/",
                     store::ShardDirectoryName(static_cast<int>(shard),
                                               static_cast<int>(manifest.shards.size())));
    if (!io::IsDirectory(folder)) {
      return absl::NotFoundError(absl::StrCat(folder, ": the shard is not there"));
    }
  }
  return std::move(manifest.source);
}

CacheEntry DescribeEntry(const fs::path& path) {
  const std::string directory = path.string();
  const std::string entry_file = EntryFile(directory);
  CacheEntry entry{.name = path.filename().string(), .size_bytes = SizeOfTree(path)};
  entry.last_used = TimeOfChange(io::PathExists(entry_file) ? entry_file : directory);
  entry.is_in_use = IsInUse(directory);
  const absl::StatusOr<std::string> file_name = SourceNameOf(directory);
  entry.is_damaged = !file_name.ok() || IsMarkedDamaged(directory);
  const absl::StatusOr<std::string> source = io::ReadWholeFile(entry_file, kMaxSourceBytes);
  entry.source = std::string(absl::StripSuffix(source.value_or(""), "\n"));
  if (entry.source.empty()) {
    entry.source = file_name.value_or("");
  }
  return entry;
}

}  // namespace

EntryLock::~EntryLock() {
  if (descriptor_ >= 0) {
    close(descriptor_);
  }
}

bool IsEntryName(absl::string_view name) {
  if (name.size() < kDigestLength + 1 || name.front() == '.') {
    return false;
  }
  const absl::string_view digest = name.substr(name.size() - kDigestLength);
  return name[name.size() - kDigestLength - 1] == '-' &&
         std::all_of(digest.begin(), digest.end(), [](char c) {
           return absl::ascii_isxdigit(static_cast<unsigned char>(c)) &&
                  !absl::ascii_isupper(static_cast<unsigned char>(c));
         });
}

absl::StatusOr<EntryLock> UseEntry(const std::string& directory, absl::string_view source) {
  const std::string path = EntryFile(directory);
  while (true) {
    const int descriptor = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, S_IRUSR | S_IWUSR);
    if (descriptor < 0 && (errno == ENOENT || errno == ENOTDIR)) {
      return io::ErrnoToStatus(errno, "no dataset in the cache at", directory);
    }
    EntryLock lock(descriptor);
    if (descriptor < 0 || Lock(descriptor, LOCK_SH) != 0) {
      return EntryLock();
    }
    if (!IsFileAt(path, descriptor)) {
      continue;  // removed during the wait; perhaps created again since
    }
    // The dataset is readable even if neither the text nor the time can be written.
    struct stat info {};
    if (fstat(descriptor, &info) == 0 && info.st_size == 0) {
      const std::string text = absl::StrCat(source, "\n");
      [[maybe_unused]] const ssize_t written = pwrite(descriptor, text.data(), text.size(), 0);
    }
    futimens(descriptor, nullptr);
    return lock;
  }
}

void MarkDamaged(const std::string& directory) {
  const int descriptor = open(absl::StrCat(directory, "/", kDamagedName).c_str(),
                              O_WRONLY | O_CREAT | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (descriptor >= 0) {
    close(descriptor);
  }
}

bool IsMarkedDamaged(const std::string& directory) {
  return io::PathExists(absl::StrCat(directory, "/", kDamagedName));
}

absl::Status WriteNote(const std::string& directory, absl::string_view note) {
  return io::WriteWholeFile(absl::StrCat(directory, "/", kNoteName), note);
}

std::string ReadNote(const std::string& directory) {
  return io::ReadWholeFile(absl::StrCat(directory, "/", kNoteName), kMaxSourceBytes).value_or("");
}

absl::StatusOr<std::vector<CacheEntry>> ListEntries(const std::string& cache_directory) {
  std::vector<CacheEntry> entries;
  std::error_code error;
  fs::directory_iterator file(cache_directory, error);
  for (const fs::directory_iterator end; !error && file != end; file.increment(error)) {
    std::error_code unknown;
    if (IsEntryName(file->path().filename().string()) && file->is_directory(unknown) &&
        !file->is_symlink(unknown)) {
      entries.push_back(DescribeEntry(file->path()));
    }
  }
  if (error) {
    return io::ErrnoToStatus(error.value(), "can't list the cache", cache_directory);
  }
  std::sort(entries.begin(), entries.end(), [](const CacheEntry& a, const CacheEntry& b) {
    return a.last_used != b.last_used ? a.last_used > b.last_used : a.name < b.name;
  });
  return entries;
}

std::int64_t TotalBytes(const std::vector<CacheEntry>& entries) {
  std::int64_t total = 0;
  for (const CacheEntry& entry : entries) {
    total += entry.size_bytes;
  }
  return total;
}

absl::StatusOr<bool> RemoveEntry(const std::string& cache_directory, const std::string& name) {
  const std::string directory = absl::StrCat(cache_directory, "/", name);
  const std::string path = EntryFile(directory);
  const int descriptor = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (descriptor < 0 && errno == ENOENT) {
    return true;
  }
  // If the file does not exist and can't be created, no process holds a lock either.
  EntryLock lock(descriptor);
  if (descriptor >= 0) {
    const int error_number = Lock(descriptor, LOCK_EX | LOCK_NB);
    if (error_number == EWOULDBLOCK) {
      return false;
    }
    if (error_number != 0) {
      return io::ErrnoToStatus(error_number, "can't lock", path);
    }
    if (!IsFileAt(path, descriptor)) {
      return true;  // by another process
    }
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const io::WorkFolder work,
                            io::WorkFolder::Make(cache_directory, std::string(kWorkPrefix)));
  const std::string target = work.path() + "/removed";
  if (rename(directory.c_str(), target.c_str()) != 0) {
    return io::ErrnoToStatus(errno, "can't remove", directory);
  }
  lock = EntryLock();  // processes that wait for the lock need not wait for the deletion
  std::error_code error;
  fs::remove_all(target, error);
  if (error) {
    return io::ErrnoToStatus(error.value(), "can't remove", target);
  }
  return true;
}

}  // namespace isoscope::cli
