// ParaView writes a list beside the files of its steps:
//
//   { "file-series-version" : "1.0",
//     "files" : [
//       { "name" : "run_0.vti", "time" : 0 },
//       { "name" : "run_1.vti", "time" : 0.05 } ] }
//
// Source: https://docs.paraview.org, "Catalyst and file series", vtkFileSeriesReader.

#include "core/formats/vtk/vtk_steps.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <nlohmann/json.hpp>

#include "core/base/printable.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/formats/vtk/vtk_image.h"
#include "core/io/file.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxListBytes = 64 * base::kMiB;
constexpr std::size_t kMaxListedSteps = 100'000;
constexpr int kMaxListDepth = 16;
using ListJson = nlohmann::json;

absl::Status ListError(const std::string& path, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": list of time steps: ", what));
}

// Returns whether brackets of a JSON text, outside of its strings, are nested more than `most` deep.
//
// A callback of the parser would know it too, but makes it look through a whole list after each element.
bool IsDeeperThan(absl::string_view text, int most) {
  bool is_in_string = false;
  int depth = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (is_in_string) {
      i += c == '\\' ? 1 : 0;
      is_in_string = c != '"';
      continue;
    }
    is_in_string = c == '"';
    depth += c == '{' || c == '[' ? 1 : 0;
    depth -= c == '}' || c == ']' ? 1 : 0;
    if (depth > most) {
      return true;
    }
  }
  return false;
}

bool IsStepName(const std::string& name) {
  return absl::EndsWithIgnoreCase(name, ".vti") || absl::EndsWithIgnoreCase(name, ".pvti") ||
         absl::EndsWithIgnoreCase(name, ".vtr");
}

// Takes one of "files". The time is NaN if it has none.
absl::StatusOr<PvdStep> StepOfJson(const ListJson& file, const std::string& path) {
  PvdStep step{.time = std::nan(""), .file = {}};
  const auto name = file.is_object() ? file.find("name") : file.end();
  if (!file.is_object() || name == file.end() || !name->is_string()) {
    return ListError(path, "a file without a \"name\" of text");
  }
  const auto& text = name->get_ref<const std::string&>();
  if (!IsStepName(text)) {
    return ListError(path, absl::StrFormat("%s; expected ImageData (.vti or .pvti) or a "
                                           "RectilinearGrid (.vtr)",
                                           base::Quoted(text)));
  }
  const std::size_t slash = path.rfind('/');
  const bool is_beside = slash != std::string::npos && !absl::StartsWith(text, "/");
  step.file = is_beside ? absl::StrCat(path.substr(0, slash + 1), text) : text;
  const auto time = file.find("time");
  if (time != file.end()) {
    if (!time->is_number() || !std::isfinite(time->get<double>())) {
      return ListError(
          path, absl::StrFormat("the time of %s; expected a finite number", base::Quoted(text)));
    }
    step.time = time->get<double>();
  }
  return step;
}

// Numbers steps without times from 0, and checks that times ascend. `what` begins messages.
absl::Status TakeTimes(const std::string& what, std::vector<PvdStep>* steps) {
  std::size_t timed = 0;
  for (const PvdStep& step : *steps) {
    timed += std::isnan(step.time) ? std::size_t{0} : std::size_t{1};
  }
  if (timed != 0 && timed != steps->size()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d of %d files have a time; expected all or none", what, timed, steps->size()));
  }
  for (std::size_t i = 0; i < steps->size(); ++i) {
    PvdStep& step = (*steps)[i];
    if (timed == 0) {
      step.time = static_cast<double>(i);
    } else if (i > 0 && !(step.time > (*steps)[i - 1].time)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: time %g (%s) behind time %g (%s); expected times that ascend, each once", what,
          step.time, step.file, (*steps)[i - 1].time, (*steps)[i - 1].file));
    }
  }
  return absl::OkStatus();
}

}  // namespace

bool IsVtkStepList(const std::string& path) { return absl::EndsWithIgnoreCase(path, ".series"); }

absl::StatusOr<std::vector<PvdStep>> ReadVtkStepList(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, io::ReadWholeFile(path, kMaxListBytes));
  const bool is_deep = IsDeeperThan(text, kMaxListDepth);
  const ListJson list = is_deep ? ListJson()
                                : ListJson::parse(text.begin(), text.end(), /*cb=*/nullptr,
                                                  /*allow_exceptions=*/false);
  const auto files = list.is_object() ? list.find("files") : list.end();
  if (!list.is_object() || files == list.end() || !files->is_array()) {
    return ListError(path, "no JSON with an array \"files\": damaged, or no list of ParaView");
  }
  const auto version = list.find("file-series-version");
  if (version == list.end() || !version->is_string() ||
      !absl::StartsWith(version->get_ref<const std::string&>(), "1.")) {
    return ListError(path, "no \"file-series-version\" of \"1.0\"");
  }
  if (files->empty() || files->size() > kMaxListedSteps) {
    return ListError(path,
                     absl::StrFormat("%d files; expected 1 to %d", files->size(), kMaxListedSteps));
  }
  std::vector<PvdStep> steps;
  for (const ListJson& file : *files) {
    ISOSCOPE_ASSIGN_OR_RETURN(PvdStep step, StepOfJson(file, path));
    steps.push_back(std::move(step));
  }
  ISOSCOPE_RETURN_IF_ERROR(TakeTimes(path, &steps));
  return steps;
}

absl::StatusOr<std::vector<PvdStep>> StepsOfVtkFiles(const std::string& pattern,
                                                     const std::vector<std::string>& files,
                                                     const GridRules& rules) {
  if (files.empty()) {
    return absl::NotFoundError(absl::StrCat(pattern, ": no such file"));
  }
  if (files.size() > kMaxListedSteps) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: %d files; expected at most %d", pattern,
                                                      files.size(), kMaxListedSteps));
  }
  std::vector<PvdStep> steps;
  for (const std::string& file : files) {
    ISOSCOPE_RETURN_IF_ERROR(base::CheckProcessInterrupt());
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VtkImage> image, OpenVtkImage(file, "", rules));
    steps.push_back({.time = image->time().value_or(std::nan("")), .file = file});
  }
  ISOSCOPE_RETURN_IF_ERROR(TakeTimes(pattern, &steps));
  return steps;
}

}  // namespace isoscope::source
