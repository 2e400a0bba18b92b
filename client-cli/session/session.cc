// Where the dataset of a session comes from:
//
//   --server       ServiceClient on a channel to it; nothing is opened here
//   DIR            the dataset directory, as it is
//   a source       an entry of the cache, made by PartitionVolume or PartitionSeries unless it is
//                  there and intact; of a source of several volumes with those that are wanted
//
// For the last two an EmbeddedCluster serves the directory. The lock on a cache entry outlives it,
// so no other process removes the files of an open session.

#include "client-cli/session/session.h"

#include <map>
#include <optional>
#include <ostream>
#include <set>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "client-cli/session/cache_entry.h"
#include "client-cli/session/dataset_cache.h"
#include "client-cli/session/embedded_cluster.h"
#include "client-cli/session/partition_volume.h"
#include "clients/cpp/connection/connect.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/log.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/cli/waiting_line.h"
#include "core/formats/address_opening.h"
#include "core/formats/open_request.h"
#include "core/io/file.h"
#include "core/partition/partitioner.h"
#include "core/source/series_parts.h"
#include "core/source/series_selection.h"
#include "core/source/source_stamps.h"
#include "core/source/volume_series.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_levels.h"
#include "core/store/shard_reader.h"
#include "isoscope/v1/dataset_service.pb.h"
#include "partition-agent/shard/shard.h"
#include "rpc/host_port.h"

namespace isoscope::cli {
namespace {

constexpr std::int64_t kMaxThreadCount = 1024;

absl::StatusOr<std::int64_t> ParseThreadCount(absl::string_view text) {
  return client::ParseInteger(text, 1, kMaxThreadCount);
}

absl::Status VerifyShard(const std::string& directory, std::uint32_t* manifest_crc32c) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const agent::Shard> opened,
                            agent::OpenShard(directory));
  *manifest_crc32c = opened->reader->manifest_crc32c();
  for (int level = 1; level <= opened->reader->manifest().highest_level(); ++level) {
    ISOSCOPE_RETURN_IF_ERROR(store::OpenLevelOf(*opened->reader, level).status());
  }
  return opened->reader->ReadHistogram().status();
}

// Opens all files that a frame can touch, of all levels: of a series, of all volumes that its
// manifest names.
// Their sizes and checksums are looked at, but for the blocks and the pages of the index.
absl::Status VerifyDatasetDirectory(const std::string& directory) {
  if (IsMarkedDamaged(directory)) {
    return absl::DataLossError(absl::StrCat("'", directory, "' was found to be damaged"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> shards,
                            store::ShardDirectoriesOf(directory));
  for (const std::string& shard : shards) {
    if (shard.empty()) {
      return absl::NotFoundError(absl::StrCat("'", directory, "' lacks a shard"));
    }
    std::uint32_t crc32c = 0;
    if (!store::IsSeriesDirectory(shard)) {
      ISOSCOPE_RETURN_IF_ERROR(VerifyShard(shard, &crc32c));
      continue;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const store::SeriesShard series, store::OpenSeriesShard(shard));
    for (const store::ScalarVolume& volume : series.manifest.volumes) {
      const std::string path =
          absl::StrCat(shard, "/", store::ScalarVolumeDirectoryName(volume.key));
      ISOSCOPE_RETURN_IF_ERROR(VerifyShard(path, &crc32c));
      if (crc32c != volume.manifest_crc32c) {
        return absl::DataLossError(absl::StrCat("'", path, "' holds another volume"));
      }
    }
  }
  return absl::OkStatus();
}

// Trims the cache to its limit after an entry was added, and reports a large entry. An error is
// reported but does not end the request.
void TrimAfterMaking(const std::string& cache_directory, std::int64_t limit_bytes,
                     const CachedDataset& made, const Context& context) {
  const absl::StatusOr<std::vector<CacheEntry>> removed = TrimCache(cache_directory, limit_bytes);
  const absl::StatusOr<std::vector<CacheEntry>> entries = ListEntries(cache_directory);
  if (!removed.ok() || !entries.ok()) {
    *context.err << "isoscope: the cache was not kept to its limit: "
                 << (removed.ok() ? entries.status() : removed.status()).message() << std::endl;
    return;
  }
  const std::string note =
      DescribeLargeEntry(cache_directory, limit_bytes, *entries, made.directory);
  if (!note.empty()) {
    *context.err << "isoscope: " << note << std::endl;
  }
}

// The volumes that are wanted. Opens the source only if that is needed to know them.
absl::StatusOr<ChosenVolumes> ChooseOf(const source::OpenRequest& request,
                                       const WantedVolumes* wanted) {
  if (wanted != nullptr && wanted->is_default()) {
    return ChosenVolumes();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSeries> series,
                            source::Open(request));
  return wanted != nullptr ? ChooseVolumes(*wanted, *series)
                           : absl::StatusOr<ChosenVolumes>(ChooseAllVolumes(*series));
}

// Makes the dataset of an entry of the cache: of the only volume of a source, or a series with the
// volumes that are wanted. Ends the opening before it reads samples, which may take hours.
absl::Status MakeDatasetOf(const source::OpenRequest& request, const WantedVolumes* wanted,
                           partition::PartitionOptions options, const Context& context,
                           std::optional<source::AddressOpening>* opening) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<source::VolumeSeries> series,
                            source::OpenIdentified(request));
  ISOSCOPE_ASSIGN_OR_RETURN(options.labels, LabelsOfSource(request, context.err));
  opening->reset();
  if (source::IsOneVolume(series->info())) {
    return PartitionVolume(*series, options, context).status();
  }
  ChosenVolumes chosen = ChooseAllVolumes(*series);
  if (wanted != nullptr) {
    ISOSCOPE_ASSIGN_OR_RETURN(chosen, ChooseVolumes(*wanted, *series));
  }
  // By the fields that are left: their numbers count these alone.
  std::set<std::pair<std::string, int>> names;
  for (const auto& [field, step] : chosen.volumes) {
    names.emplace(series->info().field(field).name, step);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      series, source::SelectFrom(std::move(series), {.fields = std::move(chosen.fields)}));
  const auto wants = [&](int field, int step) {
    return names.contains({series->info().field(field).name, step});
  };
  const std::string directory = options.output_directory;
  ISOSCOPE_RETURN_IF_ERROR(PartitionSeries(SeriesAction::kMake, *series,
                                           {.volume = std::move(options), .wants = wants}, context)
                               .status());
  return chosen.note.empty() ? absl::OkStatus()
                             : WriteNote(directory, absl::StrCat(request.path, ": ", chosen.note));
}

// The cached dataset of a source, which is read from `files`. opening: of these
absl::StatusOr<CachedDataset> PrepareSource(const SessionFlags& flags, const WantedVolumes* wanted,
                                            const source::OpenRequest& request,
                                            const std::vector<std::string>& files,
                                            const Context& context,
                                            std::optional<source::AddressOpening>* opening) {
  partition::PartitionOptions options;
  options.shard_count = static_cast<int>(flags.shard_count.value_or(1));
  if (wanted == nullptr) {  // for who looks around; a single picture is made of the samples
    options.levels.highest = partition::LevelOptions::kAuto;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const ChosenVolumes chosen, ChooseOf(request, wanted));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::string key,
      CacheKey(request, files, absl::StrCat(options.shard_count, "\n", chosen.text)));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string cache_directory, CacheDirectory(context.err));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t limit_bytes,
                            CacheLimitBytes(flags.cache_limit_bytes, cache_directory));
  const auto make = [&](const std::string& directory) -> absl::Status {
    if (context.err_is_terminal) {
      *context.err << "partitioning '" << request.path << "' into the cache, " << cache_directory
                   << std::endl;
    }
    options.output_directory = directory;
    options.name = key.substr(0, key.rfind('-'));  // the user knows this name
    return MakeDatasetOf(request, wanted, options, context, opening);
  };
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string source, source::ResolvedPath(request.path));
  ISOSCOPE_ASSIGN_OR_RETURN(CachedDataset dataset, FindOrMakeDataset(cache_directory, key, source,
                                                                     make, VerifyDatasetDirectory));
  if (dataset.was_made) {
    TrimAfterMaking(cache_directory, limit_bytes, dataset, context);
  } else if (context.err_is_terminal) {
    *context.err << "using the cached dataset " << dataset.directory << std::endl;
  }
  if (const std::string note = ReadNote(dataset.directory); wanted != nullptr && !note.empty()) {
    *context.err << "isoscope: " << base::Printable(note) << std::endl;
  }
  dataset.is_cached = true;
  dataset.is_only_volume = !store::IsSeriesDirectory(dataset.directory);
  return dataset;
}

// The name by which clients ask for the dataset of a directory.
absl::StatusOr<std::string> NameOf(const std::string& directory) {
  if (store::IsSeriesDirectory(directory)) {
    ISOSCOPE_ASSIGN_OR_RETURN(const store::SeriesDescription series, store::OpenSeries(directory));
    return series.manifest.name;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const store::DatasetDescription description,
                            store::OpenDataset(directory));
  return description.manifest.name;
}

// The same error, which names the input that has it.
absl::Status OfInput(const std::string& input, const absl::Status& status) {
  if (status.ok() || absl::StrContains(status.message(), input)) {
    return status;
  }
  const std::string message = absl::StrCat("'", input, "': ", status.message());
  return IsUsageError(status) ? UsageError(message) : absl::Status(status.code(), message);
}

// A dataset directory, as it is.
absl::StatusOr<CachedDataset> PrepareDataset(const SessionFlags& flags, const Context& context) {
  const std::string& input = *flags.input;
  ISOSCOPE_RETURN_IF_ERROR(CheckUsageWithDataset(flags.source, input));
  WarnIfIncomplete(input, context);
  if (flags.shard_count) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> shards,
                              store::ShardDirectoriesOf(input));
    if (*flags.shard_count != static_cast<std::int64_t>(shards.size())) {
      return UsageError(absl::StrCat("--shards ", *flags.shard_count, ": '", input,
                                     "' was cut into ", shards.size(),
                                     " shards; leave --shards out, or partition anew"));
    }
  }
  return CachedDataset{.directory = input};
}

}  // namespace

absl::StatusOr<CachedDataset> PrepareInput(const SessionFlags& flags, const WantedVolumes* wanted,
                                           const Context& context) {
  if (store::IsDatasetDirectory(*flags.input)) {
    return PrepareDataset(flags, context);
  }
  const source::OpenRequest request = RequestOf(flags.source, *flags.input);
  std::optional<source::AddressOpening> opening(std::in_place);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> files, SourceFiles(request));
  return PrepareSource(flags, wanted, request, files, context, &opening);
}

void AddInputFlags(FlagSet* set, SessionFlags* flags, const SourceFlagNames& names) {
  AddFlag(
      set, "input", "INPUT|DIR", &flags->input, ParseSource,
      "a volume, as 'partition' takes it (partitioned into a cache first), or a dataset folder");
  AddFlag(set, "--shards", "P", &flags->shard_count, ParseShardCount,
          "cut a volume into P shards, one agent each (default: 1)");
  AddCacheLimitFlag(set, &flags->cache_limit_bytes);
  AddSourceFlags(set, &flags->source, names);
}

void AddSessionFlags(FlagSet* set, SessionFlags* flags, const SourceFlagNames& names) {
  AddInputFlags(set, flags, names);
  AddFlag(set, "--server", "HOST[:PORT]", &flags->server, rpc::ParseCoordinatorAddress,
          "the coordinator to ask; its port may be left out if it is 50051");
  AddFlag(set, "--dataset", "NAME", &flags->dataset, ParseText,
          "which dataset of the server (default: its only one)");
  AddConnectionFlags(set, &flags->connection);
  AddFlag(set, "--timeout", "SECONDS", &flags->timeout, client::ParseSeconds,
          "give up a request after this time (default: the server's limit, an hour at most; of a "
          "frame without --server 5 minutes)");
  AddFlag(set, "--threads", "T", &flags->thread_count, ParseThreadCount,
          "threads of the embedded agents together (default: one for each core)");
  AddFlag(set, "--memory-limit", "BYTES", &flags->memory_limit_bytes, ParseAgentMemory,
          "memory of the embedded agents together, as in 512MiB or 2G (default: a quarter of the "
          "machine's)");
  set->AddSwitch("--verbose", &flags->is_verbose, "log lines of the embedded servers");
}

void AddCacheLimitFlag(FlagSet* set, std::optional<std::int64_t>* limit_bytes) {
  AddFlag(set, "--cache-limit", "BYTES", limit_bytes, client::ParseByteSize,
          "size of the cache of partitioned volumes, as in 4GiB (default: $ISOSCOPE_CACHE_LIMIT, "
          "else 20GiB or a tenth of the free space, whichever is less)");
}

void AddRendererFlag(FlagSet* set, SessionFlags* flags) {
  AddFlag(set, "--renderer", "auto|egl|cpu", &flags->renderer, render::RendererKindFromName,
          "back end of the embedded agents (default: auto, EGL on a GPU, else the CPU)");
}

absl::Status CheckUsage(const SessionFlags& flags) {
  if (flags.input.has_value() == flags.server.has_value()) {
    return UsageError(flags.input ? "a file or folder can't be used with --server; give one of them"
                                  : "give a volume, a dataset folder or --server HOST:PORT");
  }
  if (flags.server) {
    const char* embedded_only = flags.renderer             ? "--renderer"
                                : flags.shard_count        ? "--shards"
                                : flags.thread_count       ? "--threads"
                                : flags.memory_limit_bytes ? "--memory-limit"
                                : flags.cache_limit_bytes  ? "--cache-limit"
                                                           : flags.source.FirstGiven();
    if (embedded_only != nullptr) {
      return UsageError(absl::StrCat(embedded_only,
                                     " can't be used with --server: that is settled where the "
                                     "agents and the dataset are"));
    }
    return CheckUsage(flags.connection);
  }
  if (flags.dataset) {
    return UsageError("--dataset is for --server; a file or folder is one dataset");
  }
  for (const std::string& input : flags.more_inputs) {
    ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.source, input));
  }
  return CheckUsage(flags.source, *flags.input);
}

absl::Status CheckInputExists(const SessionFlags& flags) {
  if (!flags.input || store::IsDatasetDirectory(*flags.input)) {
    return absl::OkStatus();
  }
  const absl::Status status = SourceFiles(RequestOf(flags.source, *flags.input)).status();
  return absl::IsNotFound(status) ? status : absl::OkStatus();
}

Session::Session() : frame_timeout_(client::kAnswerTimeout) {}

Session::~Session() = default;

absl::StatusOr<std::unique_ptr<Session>> Session::Open(
    const SessionFlags& flags, const WantedVolumes* wanted,
    const std::optional<view::Viewport>& expected_viewport, const Context& context) {
  base::SetLogLevel(flags.is_verbose ? base::LogLevel::kInfo : base::LogLevel::kOff);
  std::unique_ptr<Session> session(new Session());
  session->timeout_ = flags.timeout;
  if (flags.server) {
    session->dataset_name_ = flags.dataset.value_or("");
    ISOSCOPE_ASSIGN_OR_RETURN(session->token_, ReadToken(flags.connection, *flags.server));
    ISOSCOPE_ASSIGN_OR_RETURN(session->client_,
                              client::Connect({.address = *flags.server,
                                               .transport = flags.connection.transport,
                                               .token = session->token_},
                                              context.interrupt));
    return session;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(session->dataset_, PrepareInput(flags, wanted, context));
  ISOSCOPE_RETURN_IF_ERROR(session->PrepareMore(flags, wanted, context));
  EmbeddedClusterOptions options;
  options.dataset_directory = session->dataset_.directory;
  for (const CachedDataset& dataset : session->more_datasets_) {
    options.more_dataset_directories.push_back(dataset.directory);
  }
  options.renderer = flags.renderer.value_or(render::RendererKind::kAuto);
  options.thread_count = static_cast<int>(flags.thread_count.value_or(0));
  options.memory_limit_bytes = static_cast<std::size_t>(flags.memory_limit_bytes.value_or(0));
  // No other client waits for this process, so --timeout alone decides, if it is given.
  options.max_frame_duration = flags.timeout.value_or(options.max_frame_duration);
  session->frame_timeout_ = options.max_frame_duration;
  options.expected_viewport = expected_viewport;
  options.expected_layers = flags.expected_layers;
  options.draws_once = flags.draws_once;
  // Log lines of --verbose would interrupt it.
  const WaitingLine waiting(context.err, context.err_is_terminal && !flags.is_verbose, "opening");
  ISOSCOPE_ASSIGN_OR_RETURN(session->cluster_, EmbeddedCluster::Start(options));
  session->client_ = std::make_unique<client::ServiceClient>(session->cluster_->Channel(), "",
                                                             context.interrupt, "");
  return session;
}

absl::Status Session::PrepareMore(const SessionFlags& flags, const WantedVolumes* wanted,
                                  const Context& context) {
  if (flags.more_inputs.empty()) {
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(dataset_name_, NameOf(dataset_.directory));
  std::map<std::string, std::string> inputs = {{dataset_name_, *flags.input}};  // by name
  for (const std::string& input : flags.more_inputs) {
    SessionFlags of_input = flags;
    of_input.input = input;
    absl::StatusOr<CachedDataset> prepared = PrepareInput(of_input, wanted, context);
    ISOSCOPE_RETURN_IF_ERROR(OfInput(input, prepared.status()));
    more_datasets_.push_back(*std::move(prepared));
    const absl::StatusOr<std::string> name = NameOf(more_datasets_.back().directory);
    ISOSCOPE_RETURN_IF_ERROR(OfInput(input, name.status()));
    const auto [same, is_new] = inputs.emplace(*name, input);
    if (!is_new) {
      return UsageError(absl::StrCat(
          "'", same->second, "' and '", input, "' are both the dataset \"", *name,
          "\": leave one out, or give one another name by 'isoscope partition' into a folder"));
    }
  }
  return absl::OkStatus();
}

const std::shared_ptr<grpc::Channel>& Session::channel() const { return client_->channel(); }

absl::StatusOr<isoscope::v1::Dataset> Session::GetDataset() {
  absl::StatusOr<isoscope::v1::Dataset> dataset =
      client_->GetDataset(dataset_name_, question_timeout());
  if (!absl::IsNotFound(dataset.status()) || dataset_name_.empty()) {
    return dataset;
  }
  const auto datasets = client_->ListDatasets(question_timeout());
  if (!datasets.ok()) {
    return dataset;
  }
  std::vector<std::string> known;
  for (const isoscope::v1::Dataset& one : datasets->datasets()) {
    known.push_back(one.name());
  }
  const std::string nearest = NearestName(dataset_name_, known);
  if (nearest.empty()) {
    return dataset;
  }
  return absl::NotFoundError(
      absl::StrCat(dataset.status().message(), "; did you mean \"", nearest, "\"?"));
}

void Session::AdaptSelection(client::SelectionFlags* selection) const {
  if (dataset_.is_only_volume) {
    *selection = client::SelectionFlags();
  }
}

absl::Status Session::Finish(const absl::Status& status) {
  if (!absl::IsDataLoss(status) || !dataset_.is_cached) {
    return status;
  }
  MarkDamaged(dataset_.directory);
  return {status.code(), absl::StrCat(status.message(),
                                      "; the copy in the cache is damaged: run the command again, "
                                      "and it is made anew")};
}

void Session::SetGatewayAddress(const std::string& address) {
  if (cluster_ != nullptr) {
    cluster_->SetGatewayAddress(address);
  }
}

absl::Duration Session::question_timeout() const {
  return timeout_.value_or(client::kQuestionTimeout);
}

}  // namespace isoscope::cli
