// isoscope copy ADDRESS [DIR]

#include <memory>
#include <optional>
#include <ostream>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

#include "client-cli/commands/program.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/monotonic_time.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/end_note.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/progress_line.h"
#include "core/cli/usage.h"
#include "core/source/remote/copy_address.h"
#include "core/source/remote/remote_options.h"

namespace isoscope::cli {
namespace {

constexpr char kGoesOn[] = "the same command goes on where it ended";

struct CopyFlags {
  bool is_quiet = false;
  std::optional<std::string> address;
  std::optional<std::string> directory;
};

constexpr char kExamples[] =
    "  isoscope copy https://data.example.org/heads/head.nrrd heads\n"
    "  isoscope copy s3://my-bucket/scans/foot.nii.gz\n"
    "  ISOSCOPE_S3_ANONYMOUS=1 isoscope copy s3://public-bucket/cell.tif .\n"
    "  isoscope copy s3://my-bucket/runs/cell.zarr/ runs\n"
    "\nA copy that was broken off goes on where it ended when the command is given again, from\n"
    "DIR/NAME.part. It begins again, and says so, if the object has changed since, or if the\n"
    "server knows no ranges. An address that ends in '/', or where no object is, is a folder: all\n"
    "below it is copied, as S3 lists it, or the pages of a web server's index.\n"
    "\nCredentials come from the environment, and never from the address:\n"
    "  S3        AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN, AWS_PROFILE,\n"
    "            AWS_REGION, AWS_ENDPOINT_URL, ~/.aws; without signatures: "
    "ISOSCOPE_S3_ANONYMOUS=1\n"
    "  tokens    ISOSCOPE_BEARER_TOKEN or ISOSCOPE_BEARER_TOKEN_FILE, for the host that\n"
    "            ISOSCOPE_BEARER_TOKEN_ORIGIN=https://HOST[:PORT] names\n"
    "  passwords ~/.netrc, or the file of NETRC; over https only\n"
    "Others: https_proxy, http_proxy, no_proxy; ISOSCOPE_CA_FILE, authorities to trust.\n";

absl::Status Run(const CopyFlags& flags, const Context& context) {
  if (!flags.address) {
    return UsageError("ADDRESS is missing: https://HOST/PATH, http://HOST/PATH or s3://BUCKET/KEY");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const source::RemoteOptions options,
                            source::RemoteOptionsFromEnvironment());
  const base::MonotonicTime start = base::MonotonicNow();
  absl::StatusOr<source::CopyReport> report;
  {
    ProgressLine line(context.err, context.err_is_terminal);
    EndNote note(kGoesOn);
    report = source::CopyAddress(*flags.address, flags.directory.value_or("."), options,
                                 {.progress =
                                      [&line](std::int64_t done_bytes, std::int64_t total_bytes) {
                                        line.Update("copying", done_bytes, total_bytes);
                                      },
                                  .note =
                                      [&context](const std::string& sentence) {
                                        *context.err << base::Printable(sentence) << std::endl;
                                      }},
                                 context.interrupt->cancellation());
    if (!report.ok() && context.interrupt->cancellation().is_cancelled()) {
      note.Keep();  // a second signal may come before the error is printed
    }
  }
  if (!report.ok() && context.interrupt->cancellation().is_cancelled()) {
    return absl::CancelledError(absl::StrCat("interrupted while copying; ", kGoesOn));
  }
  ISOSCOPE_RETURN_IF_ERROR(report.status());
  *context.out << base::Printable(report->path) << ": "
               << (report->object_count > 0 ? absl::StrCat(report->object_count, " files, ") : "")
               << FormatMebibytes(report->size_bytes) << " in "
               << FormatElapsed(base::MonotonicNow() - start) << "\n";
  return absl::OkStatus();
}

Action RegisterCopyFlags(FlagSet* set) {
  const auto flags = std::make_shared<CopyFlags>();
  AddFlag(set, "address", "ADDRESS", &flags->address, ParseText,
          "an object or a folder: https://HOST/PATH, http://HOST/PATH or s3://BUCKET/KEY");
  AddFlag(set, "directory", "DIR", &flags->directory, ParseText,
          "the folder to copy into, made if it is not there (default: the current one)");
  AddQuietFlag(set, &flags->is_quiet);
  return [flags](const Context& context) {
    return Run(*flags, flags->is_quiet ? QuietContext(context) : context);
  };
}

}  // namespace

Command CopyCommand() {
  return {.name = "copy",
          .summary = "Copies files from a web server or S3 to a folder, and goes on where it ended",
          .usage = "ADDRESS [DIR] [--quiet]",
          .examples = kExamples,
          .register_flags = RegisterCopyFlags};
}

}  // namespace isoscope::cli
