// isoscope info INPUT|DIR | --server HOST:PORT
//
// The input decides the output: the header of a volume file, the manifest of a dataset directory,
// or the datasets and agents of a server. Each becomes JSON first (output/dataset_json), which
// --json prints as it is and the text is made from. --histogram adds a histogram, and surfaces add
// their measures: they open a session, which partitions a volume into the cache.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/time.h"
#include <nlohmann/json.hpp>

#include "client-cli/commands/info_parts.h"
#include "client-cli/commands/info_surfaces.h"
#include "client-cli/commands/program.h"
#include "client-cli/output/dataset_json.h"
#include "client-cli/output/histogram_plot.h"
#include "client-cli/output/label_json.h"
#include "client-cli/output/series_json.h"
#include "client-cli/output/source_json.h"
#include "client-cli/output/surface_measures.h"
#include "client-cli/session/connection_flags.h"
#include "client-cli/session/session.h"
#include "client-cli/session/source_flags.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/request/dataset_fields.h"
#include "clients/cpp/request/json_text.h"
#include "clients/cpp/request/parse_value.h"
#include "clients/cpp/request/selection_flags.h"
#include "core/base/printable.h"
#include "core/base/shell_word.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/progress_line.h"
#include "core/cli/usage.h"
#include "core/cli/waiting_line.h"
#include "core/formats/address_opening.h"
#include "core/formats/find_volume.h"
#include "core/formats/open_request.h"
#include "core/io/file.h"
#include "core/partition/series_partitioner.h"
#include "core/render/renderer_factory.h"
#include "core/source/adapt/value_range.h"
#include "core/source/volume_series.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_reader.h"
#include "core/volume/label.h"
#include "core/volume/label_suggestion.h"
#include "core/volume/sample_histogram.h"
#include "core/volume/scalar_span.h"
#include "isoscope/v1/cluster_service.pb.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/dataset_service.pb.h"
#include "rpc/host_port.h"

namespace isoscope::cli {
namespace {

// The calls are answered from memory, or in one pass over the ranges of blocks.
constexpr absl::Duration kDefaultTimeout = absl::Seconds(10);

// Samples of this size are read in a second or two, even if they are compressed.
constexpr std::int64_t kMaxQuickBytes = 64 * base::kMiB;

struct InfoFlags {
  std::optional<std::string> input;
  std::optional<std::string> server;
  ConnectionFlags connection;
  std::optional<absl::Duration> timeout;
  bool is_json = false;
  bool reads_values = false;
  bool lists_formats = false;
  SourceFlags source;
  // of a single dataset
  InfoSurfaceFlags surfaces;
  bool draws_histogram = false;
  std::optional<std::string> dataset;
  std::optional<std::int64_t> bin_count;
  std::optional<volume::ScalarSpan> value_range;
  client::SelectionFlags selection;
  bool is_logarithmic = false;

  // Reads the samples of a dataset through a session.
  [[nodiscard]] bool asks_dataset() const { return draws_histogram || !surfaces.empty(); }
};

// "MIN,MAX".
absl::StatusOr<volume::ScalarSpan> ParseRange(absl::string_view text) {
  const std::vector<std::string> parts = absl::StrSplit(text, ',');
  if (parts.size() == 2) {
    const absl::StatusOr<double> min = client::ParseNumber(parts[0]);
    const absl::StatusOr<double> max = client::ParseNumber(parts[1]);
    if (min.ok() && max.ok() && *min <= *max) {
      return volume::ScalarSpan{*min, *max};
    }
  }
  return absl::InvalidArgumentError(
      absl::StrCat("'", text, "' is no range MIN,MAX of two numbers, the smaller first"));
}

absl::StatusOr<Json> DescribeDirectory(const std::string& directory) {
  if (store::IsSeriesDirectory(directory)) {
    ISOSCOPE_ASSIGN_OR_RETURN(const store::SeriesDescription series, store::OpenSeries(directory));
    Json json;
    json["datasets"] = Json::array({SeriesDirectoryToJson(series)});
    return json;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const store::DatasetDescription description,
                            store::OpenDataset(directory));
  Json json;
  json["datasets"] = Json::array({DatasetDirectoryToJson(description)});
  return json;
}

// The input, with the flags that its volumes need, as one types them.
std::string InputAsTyped(const InfoFlags& flags, const SourceFlagNames& names = {}) {
  return absl::StrCat(base::ShellWord(*flags.input), AsTyped(flags.source, names));
}

// The series of a folder, if it has several and none is chosen; else an empty object.
absl::StatusOr<Json> DescribeSeriesOfFolder(const InfoFlags& flags) {
  if (flags.source.dims || flags.source.dicom_series) {
    return Json::object();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<source::SeriesEntry> entries,
                            source::ListSeries(*flags.input));
  return entries.size() > 1 ? SeriesEntriesToJson(entries) : Json::object();
}

// How many steps of a source of several volumes are read for the ranges of their values: all, if
// that is quick or asked for, else the first, if that is quick; else none. A source that is read
// forwards only is read from its start for each volume.
int StepsToRead(const source::VolumeSeries& series, const source::VolumeSource& first,
                std::int64_t volume_bytes, bool reads_all) {
  std::int64_t components = 0;
  for (const source::SourceField& field : series.info().fields) {
    components += static_cast<std::int64_t>(field.components.size());
  }
  const auto is_quick = [&](int steps) {
    const double volumes = static_cast<double>(components) * steps;
    const double reads = first.info().is_seekable ? volumes : volumes * (volumes + 1) / 2;
    return reads * static_cast<double>(volume_bytes) <= static_cast<double>(kMaxQuickBytes);
  };
  return reads_all || is_quick(series.info().step_count()) ? series.info().step_count()
         : is_quick(1)                                     ? 1
                                                           : 0;
}

absl::StatusOr<SourceRanges> ReadRanges(source::VolumeSeries& series, int steps,
                                        const Context& context) {
  SourceRanges ranges{.steps = steps};
  if (steps == 0) {
    return ranges;
  }
  ProgressLine line(context.err, context.err_is_terminal);
  std::int64_t done = 0;
  for (std::size_t field = 0; field < series.info().fields.size(); ++field) {
    std::vector<source::ValueRange>& field_ranges = ranges.ranges.emplace_back();
    for (std::size_t component = 0; component < series.info().fields[field].components.size();
         ++component) {
      source::ValueRange& range = field_ranges.emplace_back();
      for (int step = 0; step < steps; ++step) {
        line.Update(absl::StrCat("reading values of volume ", ++done));
        ISOSCOPE_ASSIGN_OR_RETURN(
            const std::unique_ptr<source::VolumeSource> volume,
            series.Open(static_cast<int>(field), static_cast<int>(component), step));
        ISOSCOPE_ASSIGN_OR_RETURN(
            const source::ValueRange step_range,
            source::FindValueRange(volume.get(), nullptr, context.interrupt->cancellation()));
        range.span.min = std::min(range.span.min, step_range.span.min);
        range.span.max = std::max(range.span.max, step_range.span.max);
        range.infinite_count += step_range.infinite_count;
      }
    }
  }
  return ranges;
}

// Prints the header before it reads volumes for the ranges of their values. Reads only what is
// quick or asked for.
absl::StatusOr<Json> DescribeFile(const InfoFlags& flags, const Context& context) {
  std::optional<source::AddressOpening> opening(std::in_place);
  ISOSCOPE_ASSIGN_OR_RETURN(Json folder, DescribeSeriesOfFolder(flags));
  if (!folder.empty()) {
    return folder;
  }
  // SourceFiles has the error message for a folder without a volume.
  const source::OpenRequest request = RequestOf(flags.source, *flags.input);
  ISOSCOPE_RETURN_IF_ERROR(SourceFiles(request).status());
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSeries> series,
                            source::Open(request));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> source,
                            series->Open(0, 0, 0));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<volume::Label> labels,
                            LabelsOfSource(request, context.err));
  opening.reset();
  const bool is_single = !partition::NeedsSeries(*series);
  Json volume = VolumeToJson(*source, std::nullopt);
  volume["name"] = *flags.input;
  if (!flags.is_json) {
    *context.out << DescribeVolume(volume) << std::flush;
  }
  const std::int64_t bytes = math::Volume(source->info().geometry.sample_dims) *
                             static_cast<std::int64_t>(volume::SizeOf(source->info().type));
  std::optional<volume::SampleHistogram> few_values;
  if (is_single && (flags.reads_values || bytes <= kMaxQuickBytes)) {
    ProgressLine line(context.err, context.err_is_terminal);
    ISOSCOPE_ASSIGN_OR_RETURN(const source::ValueRange range,
                              source::FindValueRange(
                                  source.get(),
                                  [&line](std::int64_t done_bytes, std::int64_t total_bytes) {
                                    line.Update("reading values", done_bytes, total_bytes);
                                  },
                                  context.interrupt->cancellation(), &few_values));
    volume = VolumeToJson(*source, range);
    volume["name"] = *flags.input;
  }
  SourceRanges ranges;
  if (!is_single) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        ranges,
        ReadRanges(*series, StepsToRead(*series, *source, bytes, flags.reads_values), context));
  }
  AddSource(*series, *source, ranges, InputAsTyped(flags), InputAsTyped(flags, kRenderFlagNames),
            &volume);
  volume["is_single"] = is_single;
  AddLabels(labels, &volume);
  const bool is_segmentation =
      !labels.empty() ||
      (few_values && !volume::SuggestLabels(source->info().type, *few_values, labels).empty());
  if (is_single && is_segmentation) {
    // An isovalue between two labels means nothing.
    volume["commands"] = Json::array(
        {absl::StrCat("isoscope render ", InputAsTyped(flags, kRenderFlagNames), " --labels all")});
  }
  Json json;
  json["volume"] = std::move(volume);
  return json;
}

absl::StatusOr<Json> DescribeServer(const InfoFlags& flags, const Context& context) {
  const absl::Duration timeout = flags.timeout.value_or(kDefaultTimeout);
  SessionFlags session_flags;
  session_flags.server = flags.server;
  session_flags.connection = flags.connection;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session,
                            Session::Open(session_flags, nullptr, std::nullopt, context));
  client::ServiceClient& client = session->client();
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

// A server, or agents in this process; a volume is partitioned into the cache first.
absl::StatusOr<std::unique_ptr<Session>> OpenSession(const InfoFlags& flags,
                                                     const Context& context) {
  SessionFlags session_flags;
  session_flags.input = flags.input;
  session_flags.server = flags.server;
  session_flags.connection = flags.connection;
  session_flags.dataset = flags.dataset;
  session_flags.source = flags.source;
  session_flags.timeout = flags.timeout;
  if (flags.input) {
    session_flags.renderer = render::RendererKind::kCpu;  // counts need no graphics card
  }
  const WantedVolumes wanted{.selection = flags.selection};
  return Session::Open(session_flags, &wanted, std::nullopt, context);
}

absl::StatusOr<isoscope::v1::GetHistogramResponse> FetchHistogram(
    const InfoFlags& flags, const isoscope::v1::Dataset& dataset, Session* session,
    const Context& context) {
  isoscope::v1::GetHistogramRequest request;
  request.set_dataset(dataset.name());
  request.set_max_bin_count(static_cast<std::int32_t>(flags.bin_count.value_or(0)));
  if (flags.value_range) {
    request.mutable_value_range()->set_min(flags.value_range->min);
    request.mutable_value_range()->set_max(flags.value_range->max);
  }
  client::SelectionFlags chosen = flags.selection;
  session->AdaptSelection(&chosen);
  ISOSCOPE_RETURN_IF_ERROR(client::ResolveNames(dataset, &chosen));
  if (const auto selection = client::ToProto(chosen)) {
    *request.mutable_selection() = *selection;
  }
  const WaitingLine waiting(context.err, context.err_is_terminal, "counting");
  return session->client().GetHistogram(request, session->question_timeout());
}

// Returns the histogram and the measures of surfaces as text, and adds them to `json`. For a volume
// it makes `json` from the dataset: so the range of its values needs no second read.
absl::StatusOr<std::string> AskDataset(const InfoFlags& flags, const Context& context, Json* json) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session, OpenSession(flags, context));
  ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::Dataset dataset, session->GetDataset());
  if (json->empty()) {
    (*json)["datasets"] = Json::array({DatasetToJson(dataset)});
  }
  std::string text;
  if (flags.draws_histogram) {
    ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::GetHistogramResponse histogram,
                              FetchHistogram(flags, dataset, session.get(), context));
    (*json)["histogram"] = HistogramToJson(histogram);
    absl::StrAppend(&text, "\n",
                    DrawHistogram(histogram, {.width = TerminalWidth(),
                                              .is_logarithmic = flags.is_logarithmic}));
  }
  if (!flags.surfaces.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::vector<MeasuredSurface> surfaces,
        MeasureInfoSurfaces(flags.surfaces, flags.selection, dataset, session.get(), context));
    (*json)["measures"] = MeasuresToJson(surfaces, dataset.length_unit());
    absl::StrAppend(&text, "\n",
                    MeasuresTable(surfaces, dataset.length_unit(), context.out_columns));
    if (const std::string costs = LevelCostsTable(surfaces, context.out_columns); !costs.empty()) {
      absl::StrAppend(&text, "\na frame of ", kLevelCostSidePx, " x ", kLevelCostSidePx,
                      " pixels, by level (render --level N):\n", costs);
    }
  }
  return text;
}

absl::Status CheckDatasetUsage(const InfoFlags& flags) {
  if (!flags.draws_histogram && (flags.bin_count || flags.value_range || flags.is_logarithmic)) {
    return UsageError("--bins, --range and --log are for --histogram");
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.surfaces));
  if (!flags.asks_dataset() && (flags.dataset || !flags.selection.empty())) {
    return UsageError(
        "--dataset and the flags of field and time are for --histogram and for surfaces");
  }
  ISOSCOPE_RETURN_IF_ERROR(client::CheckUsage(flags.selection));
  if (flags.dataset && !flags.server) {
    return UsageError("--dataset is for --server; a file or folder is one dataset");
  }
  return absl::OkStatus();
}

absl::Status CheckUsageOfParts(const InfoFlags& flags) {
  if (flags.asks_dataset()) {
    return UsageError(
        absl::StrCat(*flags.input,
                     " holds parts that are not joined yet; --histogram and surfaces need the "
                     "whole dataset: isoscope partition --finish DIR"));
  }
  if (const char* given = flags.source.FirstGiven(); given != nullptr) {
    return UsageError(absl::StrCat(given, " is for volumes; ", *flags.input, " holds parts"));
  }
  return absl::OkStatus();
}

std::string ToText(const Json& json, const InfoFlags& flags, int max_width) {
  if (json.contains("parts")) {
    return PartsText(json);
  }
  if (json.contains("series")) {
    return DescribeSeriesEntries(json, base::ShellWord(*flags.input));
  }
  if (json.contains("volume")) {  // the lines of the grid are printed already
    const Json& volume = json.at("volume");
    return absl::StrCat(volume.at("is_single").get<bool>() ? DescribeValueRange(volume) : "",
                        DescribeSource(volume), DescribeLabels(volume));
  }
  std::string text;
  if (json.contains("server")) {
    const Json& server = json.at("server");
    absl::StrAppend(
        &text, "server        ",
        base::Printable(absl::StrCat(server.at("address").get<std::string>(), ", version ",
                                     server.at("version").get<std::string>())),
        "\n");
  }
  for (const Json& dataset : json.at("datasets")) {
    absl::StrAppend(&text, text.empty() ? "" : "\n", DescribeDataset(dataset, max_width));
  }
  if (json.at("datasets").empty()) {
    absl::StrAppend(&text, "\nno dataset is served\n");
  }
  if (json.contains("agents")) {
    absl::StrAppend(&text, "\n", DescribeAgents(json.at("agents"), max_width));
  }
  return text;
}

absl::Status Run(const InfoFlags& flags, const Context& context) {
  if (flags.lists_formats) {
    *context.out << ListFormats();
    return absl::OkStatus();
  }
  if (flags.input.has_value() == flags.server.has_value()) {
    return UsageError(flags.input ? "a file or folder can't be used with --server; give one of them"
                                  : "give a volume, a dataset folder or --server HOST:PORT");
  }
  if (const char* given = flags.source.FirstGiven(); flags.server && given != nullptr) {
    return UsageError(absl::StrCat(given, " can't be used with --server"));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckDatasetUsage(flags));
  Json json;
  if (flags.server) {
    ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.connection));
    ISOSCOPE_ASSIGN_OR_RETURN(json, DescribeServer(flags, context));
  } else {
    ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.source, *flags.input));
    if (HoldsParts(*flags.input)) {
      ISOSCOPE_RETURN_IF_ERROR(CheckUsageOfParts(flags));
      ISOSCOPE_ASSIGN_OR_RETURN(json, DescribeParts(*flags.input));
    } else if (store::IsDatasetDirectory(*flags.input)) {
      ISOSCOPE_RETURN_IF_ERROR(CheckUsageWithDataset(flags.source, *flags.input));
      ISOSCOPE_ASSIGN_OR_RETURN(json, DescribeDirectory(*flags.input));
    } else if (!flags.asks_dataset()) {
      ISOSCOPE_ASSIGN_OR_RETURN(json, DescribeFile(flags, context));
    }
  }
  std::string answers;
  if (flags.asks_dataset()) {
    ISOSCOPE_ASSIGN_OR_RETURN(answers, AskDataset(flags, context, &json));
  }
  *context.out << (flags.is_json ? client::JsonText(json)
                                 : absl::StrCat(ToText(json, flags, context.out_columns), answers));
  return absl::OkStatus();
}

Action RegisterInfoFlags(FlagSet* set) {
  const auto flags = std::make_shared<InfoFlags>();
  AddFlag(set, "input", "INPUT|DIR", &flags->input, ParseSource,
          "a volume, as 'partition' takes it, a dataset folder, or DIR.partial with parts of one");
  AddFlag(set, "--server", "HOST[:PORT]", &flags->server, rpc::ParseCoordinatorAddress,
          "a coordinator");
  AddConnectionFlags(set, &flags->connection);
  AddFlag(set, "--timeout", "SECONDS", &flags->timeout, client::ParseSeconds,
          "how long to wait for the server (default: 10)");
  set->AddSwitch("--json", &flags->is_json, "print JSON instead of text");
  set->AddSwitch("--values", &flags->reads_values,
                 "read all volumes for the ranges of their values (default: up to 64 MiB)");
  set->AddSwitch("--list-formats", &flags->lists_formats,
                 "list the formats of volumes, by the names that --format takes");
  set->AddSwitch(
      "--histogram", &flags->draws_histogram,
      "draw the samples by value, what surfaces cost, and suggest isovalues (a volume is "
      "partitioned into the cache first)");
  AddFlag(
      set, "--bins", "N", &flags->bin_count,
      [](absl::string_view text) {
        return client::ParseInteger(text, 1, volume::kMaxHistogramBins);
      },
      "bins of the histogram at most (default: 256)");
  AddFlag(set, "--range", "MIN,MAX", &flags->value_range, ParseRange,
          "the values that the histogram looks at (default: all)");
  set->AddSwitch("--log", &flags->is_logarithmic, "heights by the logarithm of the counts");
  AddFlag(set, "--dataset", "NAME", &flags->dataset, ParseText,
          "the dataset of the server, for --histogram and surfaces (default: its only one)");
  AddInfoSurfaceFlags(set, &flags->surfaces);
  client::AddSelectionFlags(set, &flags->selection);
  AddSourceFlags(set, &flags->source);
  return [flags](const Context& context) { return Run(*flags, context); };
}

}  // namespace

Command InfoCommand() {
  return {.name = "info",
          .summary =
              "Describes a volume, a dataset folder, or what a server holds and how its agents are",
          .usage = "INPUT|DIR | --server HOST:PORT [--json] [--histogram] [--isovalue V]",
          .examples =
              "  isoscope info head.nii.gz\n"
              "  isoscope info large.nrrd --values\n"
              "  isoscope info --list-formats\n"
              "  isoscope info scans/ --series 3\n"
              "  isoscope info head\n"
              "  isoscope info big.partial\n"
              "  isoscope info head.nii.gz --histogram --log\n"
              "  isoscope info head.nii.gz --isovalue 30 --isovalue 60 --close\n"
              "  isoscope info --server localhost:50051 --json\n",
          .register_flags = RegisterInfoFlags};
}

}  // namespace isoscope::cli
