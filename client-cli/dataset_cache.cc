#include "client-cli/dataset_cache.h"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include <openssl/evp.h>
#include <sys/file.h>
#include <sys/stat.h>

#include "core/base/status_macros.h"
#include "core/io/file.h"

namespace isoscope::cli {
namespace {

namespace fs = std::filesystem;

// Raised when the same source and parameters no longer give the same dataset.
constexpr absl::string_view kKeyVersion = "isoscope-cache-2";
constexpr absl::string_view kWorkPrefix = ".making-";
constexpr const char* kLockName = "lock";

std::string Environment(const char* name) {
  const char* value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): nobody sets any
  return value == nullptr ? "" : value;
}

// Makes `directory` with its parents, for this user alone; says why not.
absl::Status MakeOwnDirectory(const std::string& directory) {
  std::error_code error;
  fs::create_directories(fs::path(directory).parent_path(), error);
  if (mkdir(directory.c_str(), S_IRWXU) != 0 && errno != EEXIST) {
    return io::ErrnoToStatus(errno, "can't make folder", directory);
  }
  struct stat info {};
  if (lstat(directory.c_str(), &info) != 0) {
    return io::ErrnoToStatus(errno, "can't look at", directory);
  }
  // A folder in /tmp could have been put there by somebody else.
  if (!S_ISDIR(info.st_mode) || info.st_uid != geteuid() || access(directory.c_str(), W_OK) != 0) {
    return absl::PermissionDeniedError(
        absl::StrCat("'", directory, "' is no folder of this user that can be written"));
  }
  return absl::OkStatus();
}

// With links resolved, as far as it exists: what it names need be no file.
absl::StatusOr<std::string> AbsolutePath(const std::string& path) {
  std::error_code error;
  std::string absolute = fs::weakly_canonical(path, error).string();
  if (error) {
    return io::ErrnoToStatus(error.value(), "can't resolve", path);
  }
  return absolute;
}

absl::StatusOr<std::string> StampOf(const std::string& file) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string path, AbsolutePath(file));
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) {
    return io::ErrnoToStatus(errno, "can't look at", path);
  }
  return absl::StrCat(path, "\n", std::int64_t{info.st_size}, "\n",
                      std::int64_t{info.st_mtim.tv_sec}, ".", std::int64_t{info.st_mtim.tv_nsec},
                      "\n");
}

std::string Sha256Hex(absl::string_view bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int size = 0;
  EVP_Digest(bytes.data(), bytes.size(), digest.data(), &size, EVP_sha256(), nullptr);
  return absl::BytesToHexString(
      absl::string_view(reinterpret_cast<const char*>(digest.data()), size));
}

// The name of a file without folders and endings, with nothing in it that a dataset's name may not
// have.
std::string ReadableStem(const std::string& path) {
  std::string stem = fs::path(path).filename().string();
  stem = stem.substr(0, stem.find('.', 1));
  for (char& c : stem) {
    if (!absl::ascii_isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '_') {
      c = '_';
    }
  }
  return stem.substr(0, 40);
}

// A folder for making a dataset in. The lock tells others that its maker lives; both end with the
// object.
class WorkFolder {
 public:
  static absl::StatusOr<WorkFolder> Make(const std::string& cache_directory) {
    std::string pattern = absl::StrCat(cache_directory, "/", kWorkPrefix, "XXXXXX");
    if (mkdtemp(pattern.data()) == nullptr) {
      return io::ErrnoToStatus(errno, "can't make a folder in", cache_directory);
    }
    // Gets its name once it is held: others would take a lock that is free for a leftover.
    const std::string path = absl::StrCat(pattern, "/", kLockName);
    const std::string unnamed = path + ".new";
    const int lock = open(unnamed.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, S_IRUSR | S_IWUSR);
    if (lock < 0 || flock(lock, LOCK_EX | LOCK_NB) != 0 ||
        rename(unnamed.c_str(), path.c_str()) != 0) {
      const absl::Status status = io::ErrnoToStatus(errno, "can't lock", pattern);
      if (lock >= 0) {
        close(lock);
      }
      return status;
    }
    return WorkFolder(std::move(pattern), lock);
  }

  WorkFolder(WorkFolder&& other) noexcept
      : path_(std::move(other.path_)), lock_(std::exchange(other.lock_, -1)) {}
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;
  WorkFolder& operator=(WorkFolder&&) = delete;
  ~WorkFolder() {
    if (lock_ >= 0) {
      std::error_code ignored;  // the next maker tries again
      fs::remove_all(path_, ignored);
      close(lock_);
    }
  }

  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  WorkFolder(std::string path, int lock) : path_(std::move(path)), lock_(lock) {}

  std::string path_;
  int lock_;
};

// Removes work folders whose makers are gone.
void RemoveLeftovers(const std::string& cache_directory) {
  std::error_code error;
  std::vector<fs::path> folders;
  for (fs::directory_iterator entry(cache_directory, error), end; !error && entry != end;
       entry.increment(error)) {
    if (absl::StartsWith(entry->path().filename().string(), kWorkPrefix)) {
      folders.push_back(entry->path());
    }
  }
  for (const fs::path& folder : folders) {
    const int lock = open((folder / kLockName).c_str(), O_RDWR | O_CLOEXEC);
    if (lock < 0) {
      continue;  // being made at this moment, or removed
    }
    if (flock(lock, LOCK_EX | LOCK_NB) == 0) {
      std::error_code ignored;
      fs::remove_all(folder, ignored);
    }
    close(lock);
  }
}

}  // namespace

absl::StatusOr<std::string> CacheDirectory() {
  std::vector<std::string> candidates;
  const std::string xdg = Environment("XDG_CACHE_HOME");
  const std::string home = Environment("HOME");
  const std::string temporary = Environment("TMPDIR");
  if (absl::StartsWith(xdg, "/")) {  // relative ones are to be ignored, says the XDG specification
    candidates.push_back(xdg + "/isoscope");
  } else if (absl::StartsWith(home, "/")) {
    candidates.push_back(home + "/.cache/isoscope");
  }
  candidates.push_back(
      absl::StrCat(absl::StartsWith(temporary, "/") ? temporary : "/tmp", "/isoscope-", geteuid()));
  std::vector<std::string> reasons;
  for (const std::string& candidate : candidates) {
    const absl::Status status = MakeOwnDirectory(candidate);
    if (status.ok()) {
      return candidate;
    }
    reasons.emplace_back(status.message());
  }
  return absl::FailedPreconditionError(
      absl::StrCat("no folder for the cache of datasets: ", absl::StrJoin(reasons, "; "),
                   "; set XDG_CACHE_HOME, or partition the volume first"));
}

absl::StatusOr<std::string> CacheKey(const std::string& source_path,
                                     const std::vector<std::string>& files,
                                     absl::string_view parameters) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string path, AbsolutePath(source_path));
  std::string text = path + "\n";
  for (const std::string& file : files) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string stamp, StampOf(file));
    text += stamp;
  }
  absl::StrAppend(&text, kKeyVersion, "\n", parameters);
  return absl::StrCat(ReadableStem(path), "-", Sha256Hex(text).substr(0, 16));
}

absl::StatusOr<std::string> FindOrMakeDataset(const std::string& cache_directory,
                                              const std::string& key, MakeDataset make,
                                              VerifyDataset verify) {
  const std::string directory = absl::StrCat(cache_directory, "/", key);
  if (io::PathExists(directory) && verify(directory).ok()) {
    return directory;
  }
  RemoveLeftovers(cache_directory);
  ISOSCOPE_ASSIGN_OR_RETURN(const WorkFolder work, WorkFolder::Make(cache_directory));
  const std::string made = absl::StrCat(work.path(), "/", key);
  ISOSCOPE_RETURN_IF_ERROR(make(made));
  // Another process may have finished the same meanwhile: then that one is used. One that can't be
  // opened goes away with the work folder.
  if (io::PathExists(directory)) {
    if (verify(directory).ok()) {
      return directory;
    }
    std::error_code ignored;  // a third process may have moved it; the rename below tells
    fs::rename(directory, work.path() + "/damaged", ignored);
  }
  const absl::Status renamed = io::RenamePath(made, directory);
  if (!renamed.ok() && !verify(directory).ok()) {
    return renamed;
  }
  return directory;
}

}  // namespace isoscope::cli
