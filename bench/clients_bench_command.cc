// isoscope-bench clients --server HOST:PORT --isovalue V

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/time.h"

#include "bench/clients_bench.h"
#include "bench/measurement.h"
#include "bench/program.h"
#include "client-cli/session/session.h"
#include "clients/cpp/request/parse_value.h"
#include "clients/cpp/request/render_request.h"
#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/cli/command.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"

namespace isoscope::bench {
namespace {

struct ClientsBenchFlags {
  cli::SessionFlags session;
  client::RequestFlags request;
  std::optional<std::vector<int>> counts;
  std::optional<std::int64_t> seconds;
  std::optional<std::string> json;
};

absl::StatusOr<std::vector<int>> ParseCounts(absl::string_view text) {
  std::vector<int> counts;
  for (const absl::string_view part : absl::StrSplit(text, ',')) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t count, client::ParseInteger(part, 1, 1000));
    counts.push_back(static_cast<int>(count));
  }
  return counts;
}

absl::StatusOr<std::int64_t> ParseSeconds(absl::string_view text) {
  return client::ParseInteger(text, 1, 3600);
}

absl::Status CheckUsage(const ClientsBenchFlags& flags) {
  if (!flags.session.server) {
    return cli::UsageError("--server is missing: name the coordinator that the clients ask");
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  return CheckUsage(flags.request);
}

absl::Status Run(const ClientsBenchFlags& flags, const cli::Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  base::SetLogLevel(base::LogLevel::kOff);
  ClientsBenchPlan plan;
  plan.session = flags.session;
  plan.request = flags.request;
  plan.client_counts = flags.counts.value_or(plan.client_counts);
  if (flags.seconds) {
    plan.duration = absl::Seconds(*flags.seconds);
  }
  std::vector<ClientsRound> rounds;
  ISOSCOPE_RETURN_IF_ERROR(RunMeasurement(
      flags.json, /*volume=*/"", context, [&](const Occasion& occasion) -> absl::StatusOr<Report> {
        ISOSCOPE_ASSIGN_OR_RETURN(rounds, RunClientsBench(plan, context));
        return Report{.json = ClientsBenchJson(occasion, plan, rounds),
                      .text = absl::StrCat(plan.request.viewport().width_px, " x ",
                                           plan.request.viewport().height_px, " pixels, ",
                                           absl::ToInt64Seconds(plan.duration), " s each\n\n",
                                           DescribeClientsBench(rounds))};
      }));
  for (const ClientsRound& round : rounds) {
    if (round.failed_count + round.wrong_count > 0) {
      return absl::InternalError(absl::StrCat(
          "with ", round.client_count, " clients ", round.failed_count, " frames failed and ",
          round.wrong_count, " pictures had other bytes than the first one: must be 0"));
    }
  }
  return absl::OkStatus();
}

cli::Action RegisterClientsBenchFlags(cli::FlagSet* set) {
  const auto flags = std::make_shared<ClientsBenchFlags>();
  cli::AddServerFlags(set, &flags->session);
  cli::AddFlag(set, "--clients", "N,...", &flags->counts, ParseCounts,
               "numbers of clients, a round for each (default: 4,16,64)");
  cli::AddFlag(set, "--seconds", "T", &flags->seconds, ParseSeconds,
               "duration of a round (default: 15)");
  cli::AddFlag(set, "--json", "FILE", &flags->json, cli::ParseText, "write the figures as JSON");
  client::AddRequestFlags(set, &flags->request);
  return [flags](const cli::Context& context) { return Run(*flags, context); };
}

}  // namespace

cli::Command ClientsBenchCommand() {
  return {.name = "clients",
          .summary = "Lets many clients ask a server at once: frames a second, waiting, refusals",
          .usage = "--server HOST:PORT --isovalue V [OPTIONS]",
          .examples =
              "  isoscope-bench clients --server localhost:50051 --isovalue 60\n"
              "  isoscope-bench clients --server localhost:50051 --isovalue 60 --clients 4,64 "
              "--seconds 30\n"
              "\nEach client has a connection of its own, and comes again as told when it is "
              "refused. Fails if a\nframe fails or a picture has other bytes than the first one.\n",
          .register_flags = RegisterClientsBenchFlags};
}

}  // namespace isoscope::bench
