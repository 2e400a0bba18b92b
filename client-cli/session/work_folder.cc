#include "client-cli/session/work_folder.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <system_error>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include <sys/file.h>
#include <sys/stat.h>

#include "core/io/file.h"

namespace isoscope::cli {
namespace {

namespace fs = std::filesystem;

constexpr absl::string_view kWorkPrefix = ".making-";
constexpr const char* kLockName = "lock";

}  // namespace

absl::StatusOr<WorkFolder> WorkFolder::Make(const std::string& cache_directory) {
  std::string pattern = absl::StrCat(cache_directory, "/", kWorkPrefix, "XXXXXX");
  if (mkdtemp(pattern.data()) == nullptr) {
    return io::ErrnoToStatus(errno, "can't make a folder in", cache_directory);
  }
  // The file gets its name once it is locked: other processes would take a free lock for a
  // leftover.
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

WorkFolder::~WorkFolder() {
  if (lock_ >= 0) {
    std::error_code ignored;  // the next maker tries again
    fs::remove_all(path_, ignored);
    close(lock_);
  }
}

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
      continue;  // being created at this moment, or removed
    }
    if (flock(lock, LOCK_EX | LOCK_NB) == 0) {
      std::error_code ignored;
      fs::remove_all(folder, ignored);
    }
    close(lock);
  }
}

}  // namespace isoscope::cli
