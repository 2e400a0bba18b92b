#include "bench/paper_bench_plots.h"

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

#include "bench/child_process.h"
#include "core/base/status_macros.h"

namespace isoscope::bench {

absl::Status DrawPlots(const std::string& folder, const std::vector<OutputFile>& scripts,
                       cli::Interrupt* interrupt) {
  for (const OutputFile& script : scripts) {
    absl::StatusOr<ChildResult> child = RunChild({"gnuplot", script.name}, folder, interrupt);
    if (absl::IsNotFound(child.status())) {
      return absl::NotFoundError("gnuplot is not installed; install the package gnuplot-nox");
    }
    ISOSCOPE_RETURN_IF_ERROR(child.status());
    if (child->exit_code != 0) {
      return absl::InternalError(absl::StrCat("gnuplot ", script.name, " ended with exit code ",
                                              child->exit_code, ": ", LastLine(child->err)));
    }
  }
  return absl::OkStatus();
}

}  // namespace isoscope::bench
