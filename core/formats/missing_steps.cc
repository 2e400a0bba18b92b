#include "core/formats/missing_steps.h"

#include <cstddef>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/source/bytes/stack_names.h"

namespace isoscope::source {
namespace {

std::string NameOfFile(const std::string& path) { return path.substr(path.rfind('/') + 1); }

// The files of a source of which each is a step, in natural order; empty if none is.
std::vector<std::string> FilesOfSteps(const OpenRequest& request, int step_count) {
  absl::StatusOr<std::vector<std::string>> files = FilesOf(request);
  const bool is_file_a_step = files.ok() && !files->empty() &&
                              files->size() == static_cast<std::size_t>(step_count) &&
                              files->front() != request.path;
  return is_file_a_step ? *std::move(files) : std::vector<std::string>();
}

// "run_1.vti, run_2.vti are missing"; "" if the names don't tell.
std::string MissingBetween(const std::vector<std::string>& files, int least_count) {
  const std::vector<std::string> missing =
      NamesMissingBetween(files, static_cast<std::size_t>(least_count));
  return missing.empty() ? ""
                         : absl::StrCat(absl::StrJoin(missing, ", "),
                                        missing.size() == 1 ? " is missing" : " are missing");
}

// files: those that are there, one for each step
std::string WhatIsMissing(const std::vector<std::string>& files, int least_count) {
  std::string missing = MissingBetween(files, least_count);
  if (!missing.empty()) {
    return missing;
  }
  return files.size() == 1
             ? absl::StrCat("files are missing beside ", NameOfFile(files.front()))
             : absl::StrCat("files are missing before ", NameOfFile(files.front()), ", behind ",
                            NameOfFile(files.back()), " or between them");
}

}  // namespace

std::string DescribeMissingSteps(const OpenRequest& request, int step_count, int least_count) {
  const std::vector<std::string> files = FilesOfSteps(request, step_count);
  return files.empty()
             ? absl::StrFormat("has %d steps, expected %d or more, as there were", step_count,
                               least_count)
             : absl::StrFormat("%s: %d are there, of %d or more steps",
                               WhatIsMissing(files, least_count), step_count, least_count);
}

std::string DescribeGap(const OpenRequest& request, int step_count) {
  // Whether they were there once is not known: numbers may have had gaps from the start.
  const std::vector<std::string> missing =
      NamesMissingBetween(FilesOfSteps(request, step_count), static_cast<std::size_t>(step_count));
  return missing.empty() ? ""
                         : absl::StrCat(missing.size() == 1 ? "there is no " : "there are no ",
                                        absl::StrJoin(missing, ", "));
}

}  // namespace isoscope::source
