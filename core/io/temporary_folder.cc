#include "core/io/temporary_folder.h"

#include <cerrno>
#include <cstdlib>

#include "core/io/file.h"

namespace isoscope::io {

absl::StatusOr<TemporaryFolder> TemporaryFolder::Make() {
  const char* variable = std::getenv("TMPDIR");  // NOLINT(concurrency-mt-unsafe): never set here
  const std::string parent = variable != nullptr && *variable == '/' ? variable : "/tmp";
  std::string path = absl::StrCat(parent, "/isoscope-XXXXXX");
  if (mkdtemp(path.data()) == nullptr) {
    return ErrnoToStatus(errno, "can't make a temporary folder in (set TMPDIR to another)", parent);
  }
  return TemporaryFolder(std::move(path));
}

TemporaryFolder::~TemporaryFolder() {
  if (!path_.empty()) {
    RemoveRecursively(path_).IgnoreError();  // no caller is left to report to
  }
}

}  // namespace isoscope::io
