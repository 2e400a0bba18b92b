#include "core/source/hdf5/hdf5_file_lookup.h"

#include <cstdlib>
#include <filesystem>
#include <system_error>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

namespace isoscope::source {
namespace {

namespace fs = std::filesystem;

std::string Environment(const char* name) {
  const char* value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): no code sets variables
  return value == nullptr ? "" : value;
}

// "${ORIGIN}" at the beginning of a prefix means the folder of the file that names others.
std::string WithOrigin(const std::string& prefix, const std::string& origin) {
  absl::string_view rest = prefix;
  return absl::ConsumePrefix(&rest, "${ORIGIN}") ? absl::StrCat(origin, rest) : prefix;
}

// The folder of a file, "." if it is named without one.
std::string FolderOf(const std::string& file) {
  const std::string folder = fs::path(file).parent_path().string();
  return folder.empty() ? "." : folder;
}

std::string Joined(const std::string& folder, const std::string& file) {
  return (fs::path(folder) / file).lexically_normal().string();
}

}  // namespace

std::string Hdf5FileOf(hid_t object) {
  return Hdf5TextFrom([&](char* out, std::size_t size) { return H5Fget_name(object, out, size); });
}

std::vector<std::string> Hdf5PathsOf(Hdf5OtherFile kind, const std::string& file,
                                     const std::string& owner) {
  std::vector<std::string> paths;
  std::string relative = file;
  if (file.starts_with('/')) {
    paths.push_back(file);
    relative = fs::path(file).filename().string();
  }
  const std::string prefixes =
      Environment(kind == Hdf5OtherFile::kOfLink ? "HDF5_EXT_PREFIX" : "HDF5_VDS_PREFIX");
  for (const absl::string_view prefix : absl::StrSplit(prefixes, ':', absl::SkipEmpty())) {
    paths.push_back(Joined(WithOrigin(std::string(prefix), FolderOf(owner)), relative));
  }
  paths.push_back(Joined(FolderOf(owner), relative));
  paths.push_back(relative);
  std::error_code error;
  const fs::path actual = fs::canonical(owner, error);  // the owner may be a symbolic link
  if (!error) {
    paths.push_back(Joined(actual.parent_path().string(), relative));
  }
  return paths;
}

std::string Hdf5RawFilePath(const std::string& file, const std::string& owner) {
  const std::string prefix = Environment("HDF5_EXTFILE_PREFIX");
  if (file.starts_with('/') || prefix.empty() || prefix == ".") {
    return file;
  }
  return Joined(WithOrigin(prefix, FolderOf(owner)), file);
}

std::string Hdf5NumberedName(absl::string_view name, std::int64_t i, bool* is_numbered) {
  const std::string numbered = absl::StrReplaceAll(name, {{"%b", absl::StrCat(i)}, {"%%", "%"}});
  *is_numbered |= numbered != absl::StrReplaceAll(name, {{"%b", ""}, {"%%", "%"}});
  return numbered;
}

}  // namespace isoscope::source
