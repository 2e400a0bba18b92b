#include "core/source/bytes/named_files.h"

#include <glob.h>

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/bytes/file_content.h"
#include "core/source/bytes/natural_order.h"

namespace isoscope::source {

std::vector<std::string> FilesNamed(const std::string& path,
                                    bool (*is_wanted)(const std::string& path)) {
  std::vector<std::string> files;
  if (io::IsDirectory(path)) {
    std::error_code error;
    for (std::filesystem::directory_iterator entry(path, error), end; !error && entry != end;
         entry.increment(error)) {
      // Hidden files are those of systems: "._s1.tif" beside "s1.tif".
      if (!absl::StartsWith(entry->path().filename().string(), ".")) {
        files.push_back(entry->path().string());
      }
    }
  } else if (io::PathExists(path)) {
    files = {path};  // also if '[' is in its name
  } else {
    glob_t found{};
    // NOLINTNEXTLINE(concurrency-mt-unsafe): the programs never change their environment
    if (glob(path.c_str(), 0, nullptr, &found) == 0) {
      files.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
    }
    globfree(&found);
  }
  files.erase(std::remove_if(files.begin(), files.end(),
                             [&](const std::string& file) {
                               return !is_wanted(file) || io::IsDirectory(file);
                             }),
              files.end());
  std::sort(files.begin(), files.end(), NaturalLess);
  return files;
}

absl::Status CheckIsFile(const std::string& path) {
  if (!io::PathExists(path)) {
    return absl::NotFoundError(absl::StrCat(path, ": no such file"));
  }
  if (io::IsDirectory(path)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": a folder; expected a file"));
  }
  ISOSCOPE_RETURN_IF_ERROR(io::CheckIsRegularFile(path));
  const auto file = io::OpenRandomAccessFile(path);
  return file.ok() ? CheckIsNoLfsPointer(**file) : absl::OkStatus();  // who reads it says why not
}

}  // namespace isoscope::source
