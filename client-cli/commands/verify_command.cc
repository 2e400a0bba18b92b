// isoscope verify DIR

#include <cstdint>
#include <memory>
#include <optional>
#include <ostream>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "client-cli/commands/program.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/monotonic_time.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/progress_line.h"
#include "core/cli/usage.h"
#include "core/indexed/sample_opener.h"
#include "core/partition/dataset_verifier.h"

namespace isoscope::cli {
namespace {

constexpr std::int64_t kDefaultMaxLines = 1000;
constexpr std::int64_t kMaxMaxLines = 1'000'000'000;

struct VerifyFlags {
  bool is_quiet = false;
  std::optional<std::string> directory;
  std::optional<std::int64_t> max_lines;
};

std::string Counted(std::int64_t count, absl::string_view one, absl::string_view many) {
  return absl::StrCat(FormatCount(count), " ", count == 1 ? one : many);
}

std::string Summarize(const partition::VerifyReport& report, const std::string& directory,
                      absl::Duration elapsed) {
  return absl::StrCat(
      base::Printable(directory), ": ", Counted(report.shard_count, "shard", "shards"),
      report.missing_shard_count > 0
          ? absl::StrCat(" (", FormatCount(report.missing_shard_count), " not here)")
          : "",
      ", ", Counted(report.volume_count, "volume", "volumes"), ", ",
      Counted(report.block_count, "block", "blocks"), ", ", FormatMebibytes(report.file_bytes),
      " in ", FormatElapsed(elapsed), ": ",
      report.damage_count == 0 ? "all checksums match"
                               : Counted(report.damage_count, "damage", "damages"),
      "\n");
}

absl::Status Run(const VerifyFlags& flags, const Context& context) {
  if (!flags.directory) {
    return UsageError("DIR is missing: the dataset folder or the shard folder to verify");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const indexed::SourceAccess access, indexed::AccessOfUser());
  const base::MonotonicTime start = base::MonotonicNow();
  std::int64_t lines_left = flags.max_lines.value_or(kDefaultMaxLines);
  absl::StatusOr<partition::VerifyReport> report;
  {
    ProgressLine line(context.err, context.err_is_terminal);
    report = partition::VerifyDataset(
        *flags.directory,
        {.damage =
             [&context, &lines_left](const std::string& message) {
               if (lines_left-- > 0) {
                 *context.out << "damaged: " << base::Printable(message) << std::endl;
               }
             },
         .progress =
             [&line](std::int64_t done_bytes, std::int64_t total_bytes) {
               line.Update("verifying", done_bytes, total_bytes);
             },
         .open_samples = indexed::MakeSampleOpener(access)},
        context.interrupt->cancellation());
  }
  if (!report.ok() && context.interrupt->cancellation().is_cancelled()) {
    return absl::CancelledError("interrupted while verifying");
  }
  ISOSCOPE_RETURN_IF_ERROR(report.status());
  *context.out << Summarize(*report, *flags.directory, base::MonotonicNow() - start);
  if (report->damage_count > 0) {
    return absl::DataLossError(absl::StrCat(*flags.directory, ": ",
                                            Counted(report->damage_count, "damage", "damages"),
                                            "; copy what is damaged again, or partition anew"));
  }
  return absl::OkStatus();
}

Action RegisterVerifyFlags(FlagSet* set) {
  const auto flags = std::make_shared<VerifyFlags>();
  AddFlag(set, "input", "DIR", &flags->directory, ParseText,
          "a dataset folder, or the folder of one shard");
  AddFlag(
      set, "--max-lines", "N", &flags->max_lines,
      [](absl::string_view text) { return client::ParseInteger(text, 0, kMaxMaxLines); },
      "damages to print at most; all are counted (default: 1000)");
  AddQuietFlag(set, &flags->is_quiet);
  return [flags](const Context& context) {
    return Run(*flags, flags->is_quiet ? QuietContext(context) : context);
  };
}

}  // namespace

Command VerifyCommand() {
  return {.name = "verify",
          .summary = "Reads all of a dataset folder and checks every checksum",
          .usage = "DIR [--max-lines N] [--quiet]",
          .examples =
              "  isoscope verify head\n"
              "  isoscope verify flow/shard-00000-of-00004\n",
          .register_flags = RegisterVerifyFlags};
}

}  // namespace isoscope::cli
