// isoscope info INPUT|DIR | --server HOST:PORT

#include <cstdint>
#include <memory>
#include <optional>
#include <ostream>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

#include "client-cli/command.h"
#include "client-cli/dataset_json.h"
#include "client-cli/flags.h"
#include "client-cli/output.h"
#include "client-cli/parse_value.h"
#include "client-cli/service_client.h"
#include "client-cli/source_flags.h"
#include "client-cli/usage.h"
#include "core/base/status_macros.h"
#include "core/rpc/channel.h"
#include "core/source/value_range.h"
#include "core/store/shard_reader.h"

namespace isoscope::cli {
namespace {

// The calls answer from memory.
constexpr absl::Duration kDefaultTimeout = absl::Seconds(10);

struct InfoFlags {
  std::optional<std::string> input;
  std::optional<std::string> server;
  std::optional<absl::Duration> timeout;
  bool is_json = false;
  SourceFlags source;
};

absl::StatusOr<Json> DescribeDirectory(const std::string& directory) {
  ISOSCOPE_ASSIGN_OR_RETURN(const store::DatasetDescription description,
                            store::OpenDataset(directory));
  Json json;
  json["datasets"] = Json::array({DatasetDirectoryToJson(description)});
  return json;
}

// Reads the whole volume: its range is not known otherwise.
absl::StatusOr<Json> DescribeFile(const InfoFlags& flags, const Context& context) {
  // It knows what a folder without a volume is.
  ISOSCOPE_RETURN_IF_ERROR(SourceFiles(flags.source, *flags.input).status());
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> source,
                            OpenSource(flags.source, *flags.input));
  ProgressLine line(context.err, context.err_is_terminal);
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::ScalarSpan range,
                            source::FindValueRange(
                                source.get(),
                                [&line](std::int64_t done_bytes, std::int64_t total_bytes) {
                                  line.Update("reading values", done_bytes, total_bytes);
                                },
                                context.interrupt->cancellation()));
  Json json;
  json["volume"] = VolumeToJson(*source, range);
  return json;
}

absl::StatusOr<Json> DescribeServer(const InfoFlags& flags, const Context& context) {
  const absl::Duration timeout = flags.timeout.value_or(kDefaultTimeout);
  ServiceClient client(rpc::MakeChannel(*flags.server), *flags.server, context.interrupt);
  ISOSCOPE_ASSIGN_OR_RETURN(const auto capabilities, client.GetCapabilities(timeout));
  ISOSCOPE_ASSIGN_OR_RETURN(const auto datasets, client.ListDatasets(timeout));
  ISOSCOPE_ASSIGN_OR_RETURN(const auto cluster, client.GetClusterStatus(timeout));
  Json json;
  json["server"] = {{"address", *flags.server},
                    {"version", capabilities.version()},
                    {"max_viewport_px", capabilities.max_viewport_px()},
                    {"max_concurrent_frame_count", capabilities.max_concurrent_frame_count()},
                    {"max_queued_frame_count", capabilities.max_queued_frame_count()},
                    {"max_message_bytes", capabilities.max_message_bytes()},
                    {"max_frame_seconds", capabilities.max_frame_seconds()}};
  json["datasets"] = Json::array();
  for (const auto& dataset : datasets.datasets()) {
    json["datasets"].push_back(DatasetToJson(dataset));
  }
  json["agents"] = Json::array();
  for (const auto& agent : cluster.agents()) {
    json["agents"].push_back(AgentToJson(agent));
  }
  return json;
}

std::string ToText(const Json& json) {
  if (json.contains("volume")) {
    return DescribeVolume(json.at("volume"));
  }
  std::string text;
  if (json.contains("server")) {
    const Json& server = json.at("server");
    absl::StrAppend(&text, "server        ", server.at("address").get<std::string>(), ", version ",
                    server.at("version").get<std::string>(), "\n");
  }
  for (const Json& dataset : json.at("datasets")) {
    absl::StrAppend(&text, text.empty() ? "" : "\n", DescribeDataset(dataset));
  }
  if (json.at("datasets").empty()) {
    absl::StrAppend(&text, "\nno dataset is served\n");
  }
  if (json.contains("agents")) {
    absl::StrAppend(&text, "\n", DescribeAgents(json.at("agents")));
  }
  return text;
}

absl::Status Run(const InfoFlags& flags, const Context& context) {
  if (flags.input.has_value() == flags.server.has_value()) {
    return UsageError(flags.input ? "a file or folder can't be used with --server; give one of them"
                                  : "give a volume, a dataset folder or --server HOST:PORT");
  }
  if (const char* given = flags.source.FirstGiven(); flags.server && given != nullptr) {
    return UsageError(absl::StrCat(given, " can't be used with --server"));
  }
  Json json;
  if (flags.server) {
    ISOSCOPE_ASSIGN_OR_RETURN(json, DescribeServer(flags, context));
  } else {
    ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.source, *flags.input));
    if (store::IsDatasetDirectory(*flags.input)) {
      ISOSCOPE_ASSIGN_OR_RETURN(json, DescribeDirectory(*flags.input));
    } else {
      ISOSCOPE_ASSIGN_OR_RETURN(json, DescribeFile(flags, context));
    }
  }
  *context.out << (flags.is_json ? json.dump(2) + "\n" : ToText(json));
  return absl::OkStatus();
}

Action RegisterFlags(CLI::App* app) {
  const auto flags = std::make_shared<InfoFlags>();
  AddFlag(app, "input", "INPUT|DIR", &flags->input, ParseText,
          "a volume, as 'partition' takes it, or a dataset folder");
  AddFlag(app, "--server", "HOST:PORT", &flags->server, ParseHostPort, "a coordinator");
  AddFlag(app, "--timeout", "SECONDS", &flags->timeout, ParseSeconds,
          "how long to wait for the server (default: 10)");
  app->add_flag("--json", flags->is_json, "print JSON instead of text");
  AddSourceFlags(app, &flags->source);
  return [flags](const Context& context) { return Run(*flags, context); };
}

}  // namespace

Command InfoCommand() {
  return {.name = "info",
          .summary =
              "Describes a volume, a dataset folder, or what a server holds and how its agents are",
          .usage = "INPUT|DIR | --server HOST:PORT [--json]",
          .examples =
              "  isoscope info head.nii.gz\n"
              "  isoscope info head\n"
              "  isoscope info --server localhost:50051 --json\n",
          .register_flags = RegisterFlags};
}

}  // namespace isoscope::cli
