// A folder in the cache for an unfinished operation: a dataset that is being made or removed. Its
// lock shows other processes that its own process lives.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_WORK_FOLDER_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_WORK_FOLDER_H_

#include <string>
#include <utility>

#include "absl/status/statusor.h"

namespace isoscope::cli {

// `.making-XXXXXX`, with an exclusively locked file `lock` in it. Folder and lock end with the
// object; after a crash the folder stays, and its lock is free. Thread-compatible.
class WorkFolder {
 public:
  static absl::StatusOr<WorkFolder> Make(const std::string& cache_directory);
  ~WorkFolder();
  WorkFolder(WorkFolder&& other) noexcept
      : path_(std::move(other.path_)), lock_(std::exchange(other.lock_, -1)) {}
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;
  WorkFolder& operator=(WorkFolder&&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  WorkFolder(std::string path, int lock) : path_(std::move(path)), lock_(lock) {}

  std::string path_;
  int lock_;
};

// Removes the work folders of processes that have ended.
void RemoveLeftovers(const std::string& cache_directory);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_WORK_FOLDER_H_
