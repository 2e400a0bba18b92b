#include "core/partition/output_folder.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"

namespace isoscope::partition {
namespace {

std::string ParentOf(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return slash == std::string::npos ? "." : slash == 0 ? "/" : path.substr(0, slash);
}

absl::Status ValidateName(const std::string& name) {
  constexpr std::size_t kMaxNameBytes = 200;  // leaves room for ".partial-XXXXXX" in a file name
  const auto is_word = [](char c) {
    return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '_';
  };
  if (!name.empty() && name.size() <= kMaxNameBytes && is_word(name[0]) &&
      std::all_of(name.begin(), name.end(),
                  [&](char c) { return is_word(c) || c == '.' || c == '-'; })) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "output folder \"%s\": its name becomes the dataset's name; expected 1 to %d letters, "
      "digits, '.', '_' and '-', starting with a letter, a digit or '_'",
      name, kMaxNameBytes));
}

absl::Status ValidateOutput(const std::string& output) {
  ISOSCOPE_RETURN_IF_ERROR(ValidateName(BaseName(output)));
  if (io::PathExists(output)) {
    return absl::AlreadyExistsError(absl::StrCat(
        "output ", output, " exists: remove it, or give a folder that does not exist yet"));
  }
  const std::string parent = ParentOf(output);
  if (!io::IsDirectory(parent)) {
    return absl::NotFoundError(absl::StrFormat(
        "output %s: its parent folder %s does not exist: create it (mkdir -p)", output, parent));
  }
  return absl::OkStatus();
}

}  // namespace

std::string BaseName(const std::string& path) { return path.substr(path.rfind('/') + 1); }

OutputFolder::OutputFolder(std::string path, std::string name)
    : path_(std::move(path)), name_(name.empty() ? BaseName(path_) : std::move(name)) {}

absl::StatusOr<std::unique_ptr<OutputFolder>> OutputFolder::Make(const std::string& path,
                                                                 const std::string& name) {
  std::string trimmed = path;
  while (trimmed.size() > 1 && trimmed.back() == '/') {
    trimmed.pop_back();
  }
  std::unique_ptr<OutputFolder> folder(new OutputFolder(std::move(trimmed), name));
  ISOSCOPE_RETURN_IF_ERROR(ValidateOutput(folder->path_));
  ISOSCOPE_RETURN_IF_ERROR(ValidateName(folder->name_));
  return folder;
}

absl::Status OutputFolder::Create() {
  const std::string parent = ParentOf(path_);
  const std::string prefix = absl::StrCat(BaseName(path_), ".partial-");
  io::RemoveLeftovers(parent, prefix);
  ISOSCOPE_ASSIGN_OR_RETURN(io::WorkFolder partial, io::WorkFolder::Make(parent, prefix));
  unfinished_.emplace(partial.path());
  partial_.emplace(std::move(partial));
  return absl::OkStatus();
}

absl::Status OutputFolder::Commit() {
  ISOSCOPE_RETURN_IF_ERROR(partial_->MoveTo(path_));
  unfinished_.reset();
  return absl::OkStatus();
}

}  // namespace isoscope::partition
