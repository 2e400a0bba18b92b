#include "core/formats/source_members.h"

#include <cstddef>
#include <cstdint>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "core/io/file_stamp.h"
#include "core/source/source_stamps.h"

namespace isoscope::source {
namespace {

// More files are summed up.
constexpr std::size_t kMaxListedFiles = 4;

std::string FolderOf(const std::string& path) { return path.substr(0, path.rfind('/') + 1); }

// The path without the folder of the first file: "run.h5:/p", "slice_*.tif"; the last name of a
// path that is that folder.
std::string NameIn(const std::string& path, const std::string& folder) {
  if (path.size() > folder.size() && absl::StartsWith(path, folder)) {
    return path.substr(folder.size());
  }
  return path.substr(path.rfind('/') + 1);
}

std::string TextOf(const io::FileStamp& stamp) {
  return absl::StrCat(stamp.size, " bytes, last changed at ", stamp.modified.seconds, ".",
                      stamp.modified.nanoseconds, " s since 1970");
}

}  // namespace

absl::StatusOr<std::vector<std::pair<std::string, std::string>>> SourceMembers(
    const OpenRequest& request) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string description, Describe(request));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> files, FilesOf(request));
  std::vector<std::string> paths;
  for (const std::string& file : files) {
    ISOSCOPE_ASSIGN_OR_RETURN(paths.emplace_back(), ResolvedPath(file));
  }
  const std::string folder = paths.empty() ? "" : FolderOf(paths.front());
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string path, ResolvedPath(request.path));
  std::vector<std::pair<std::string, std::string>> members = {{"the source", NameIn(path, folder)}};
  for (const absl::string_view line : absl::StrSplit(description, '\n', absl::SkipEmpty())) {
    const std::pair<absl::string_view, absl::string_view> parts =
        absl::StrSplit(line, absl::MaxSplits(' ', 1));
    if (parts.first == "isoscope" || parts.first == "program" || parts.first == "path" ||
        parts.first == "label_names") {
      continue;
    }
    members.emplace_back(absl::StrCat("\"", parts.first, "\" of the source"), parts.second);
  }
  std::string all;
  std::int64_t bytes = 0;
  for (const std::string& file : paths) {
    const io::FileStamp stamp = io::StampOf(file);
    if (paths.size() <= kMaxListedFiles) {
      members.emplace_back(absl::StrCat("file ", NameIn(file, folder)), TextOf(stamp));
    }
    absl::StrAppend(&all, NameIn(file, folder), "\n", TextOf(stamp), "\n");
    bytes += stamp.size;
  }
  if (paths.size() > kMaxListedFiles) {
    constexpr std::size_t kDigits = 16;
    members.emplace_back("the files of the source",
                         absl::StrCat(paths.size(), " with ", bytes,
                                      " bytes, digest of names, "
                                      "sizes and times ",
                                      base::Sha256Hex(all).substr(0, kDigits)));
  }
  return members;
}

}  // namespace isoscope::source
