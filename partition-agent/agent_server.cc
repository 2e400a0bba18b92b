// An agent comes up in these steps, of which Listen does 1 and 2 and its caller 3:
//
//   1. Plan resolves the given folders to shard directories.
//   2. Bind starts the gRPC server. It answers that shards are being opened.
//   3. Open opens them, checks that no shard comes twice and no name means two datasets, lets the
//      caller settle its memory, and serves. Health turns to SERVING.
//
// Start opens before it listens, so nobody sees it without its shards. AnnounceDrain and Shutdown
// turn health to NOT_SERVING first, so that the coordinator sends no more frames. Shutdown first waits
// for the frames that have begun while the server takes their calls (begun_frames.h).

#include "partition-agent/agent_server.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <iterator>
#include <map>
#include <memory>
#include <set>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/store/directory_files.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "partition-agent/opening.h"
#include "partition-agent/partition_agent_service_impl.h"
#include "partition-agent/shard/series_shard.h"
#include "partition-agent/shard/shard.h"
#include "partition-agent/shard_set.h"
#include "rpc/channel.h"
#include "rpc/grpc_time.h"
#include "rpc/reflection_v1.h"

namespace isoscope::agent {
namespace {

// Those of a dataset directory that are there; NOT_FOUND if none is.
absl::StatusOr<std::vector<std::string>> PresentShards(
    const std::string& directory, const std::vector<std::string>& shard_directories) {
  std::vector<std::string> present;
  std::copy_if(shard_directories.begin(), shard_directories.end(), std::back_inserter(present),
               [](const std::string& shard) { return !shard.empty(); });
  if (present.empty()) {
    return absl::NotFoundError(absl::StrCat(directory, ": a dataset directory without any of its ",
                                            shard_directories.size(), " shard directories"));
  }
  return present;
}

// Returns the shard directories of one directory of the options.
absl::StatusOr<std::vector<std::string>> ShardDirectoriesOf(const std::string& directory) {
  if (store::IsShardDirectory(directory)) {
    return std::vector<std::string>{directory};
  }
  if (!store::IsDatasetDirectory(directory)) {
    // A folder that this user may not read looks empty, so this checks.
    const absl::Status readable =
        io::OpenRandomAccessFile(absl::StrCat(directory, "/", store::kManifestFileName)).status();
    if (absl::IsPermissionDenied(readable)) {
      return readable;
    }
    return absl::NotFoundError(absl::StrCat(directory,
                                            io::PathExists(directory)
                                                ? ": neither a shard nor a dataset directory"
                                                : ": no such directory",
                                            "; `isoscope partition` makes them"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> shard_directories,
                            store::ShardDirectoriesOf(directory));
  return PresentShards(directory, shard_directories);
}

// The identity of a shard, with fields or without.
struct ShardLabel {
  std::string dataset;
  std::string dataset_id;
  std::uint32_t content_crc32c = 0;  // 0 for series, whose manifests grow
  int index = 0;
  std::size_t shard_count = 0;
  std::string directory;
};

struct OpenedShards {
  Shards plain;
  SeriesShards series;
};

std::vector<ShardLabel> LabelsOf(const OpenedShards& shards) {
  std::vector<ShardLabel> labels;
  for (const std::shared_ptr<const Shard>& shard : shards.plain) {
    const store::ShardReader& reader = *shard->reader;
    labels.push_back({reader.manifest().name, reader.manifest().dataset_id,
                      reader.manifest_crc32c(), reader.shard_index(),
                      reader.manifest().shards.size(), reader.directory()});
  }
  for (const std::shared_ptr<SeriesShard>& shard : shards.series) {
    const std::shared_ptr<const SeriesShard::Served> served = shard->served();
    labels.push_back({served->manifest.name, served->manifest.dataset_id, 0, shard->shard_index(),
                      static_cast<std::size_t>(served->manifest.shard_count), shard->directory()});
  }
  return labels;
}

// INVALID_ARGUMENT if a shard comes twice, or if two datasets share a name.
absl::Status CheckConsistent(const std::vector<ShardLabel>& labels) {
  std::map<std::string, const ShardLabel*> by_name;
  std::map<std::pair<std::string, int>, const ShardLabel*> by_index;
  for (const ShardLabel& label : labels) {
    const auto [same_name, is_new_name] = by_name.emplace(label.dataset, &label);
    if (!is_new_name && (same_name->second->content_crc32c != label.content_crc32c ||
                         same_name->second->dataset_id != label.dataset_id)) {
      return absl::InvalidArgumentError(absl::StrCat(
          "dataset \"", label.dataset, "\" is two different ones: ", same_name->second->directory,
          " has id ", same_name->second->dataset_id, ", ", label.directory, " has id ",
          label.dataset_id, "; serve one of them"));
    }
    const auto [same_shard, is_new_shard] =
        by_index.emplace(std::pair(label.dataset_id, label.index), &label);
    if (!is_new_shard) {
      return absl::InvalidArgumentError(absl::StrCat(
          "shard ", label.index, " of dataset \"", label.dataset, "\" is given twice: ",
          same_shard->second->directory, " and ", label.directory, "; name it once"));
    }
  }
  return absl::OkStatus();
}

std::string Summarize(const std::vector<ShardLabel>& labels) {
  std::map<std::string, std::set<int>> indices;
  std::map<std::string, std::size_t> counts;
  for (const ShardLabel& label : labels) {
    indices[label.dataset].insert(label.index);
    counts[label.dataset] = label.shard_count;
  }
  std::vector<std::string> parts;
  parts.reserve(indices.size());
  for (const auto& [name, shard_indices] : indices) {
    parts.push_back(
        absl::StrCat(name, " ", absl::StrJoin(shard_indices, ","), " of ", counts[name]));
  }
  return absl::StrJoin(parts, "; ");
}

// Returns all shard directories of the options, as absolute paths: errors are told by them.
absl::StatusOr<std::vector<std::string>> AllShardDirectories(const AgentServerOptions& options) {
  std::vector<std::string> all;
  for (const std::string& given : options.directories) {
    std::error_code error;
    std::filesystem::path path = std::filesystem::absolute(given, error).lexically_normal();
    if (!path.has_filename()) {  // it ends with a slash
      path = path.parent_path();
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> shard_directories,
                              ShardDirectoriesOf(error ? given : path.string()));
    all.insert(all.end(), shard_directories.begin(), shard_directories.end());
  }
  return all;
}

absl::StatusOr<OpenedShards> OpenShards(const AgentServerOptions& options,
                                        const std::vector<std::string>& directories,
                                        const base::Cancellation& cancellation, Opening* opening) {
  OpenedShards opened;
  const store::OpenFile open_file = [&cancellation, opening](const std::string& path) {
    return opening->OpenFile(path, cancellation);
  };
  for (const std::string& directory : directories) {
    if (cancellation.is_cancelled()) {
      return absl::CancelledError("the opening was cancelled");
    }
    if (store::IsSeriesDirectory(directory)) {
      ISOSCOPE_ASSIGN_OR_RETURN(opened.series.emplace_back(),
                                SeriesShard::Open(directory, options.memory->TakeOpenVolumes(),
                                                  store::OpenSeriesShard, options.open_samples));
      options.memory->NoteBlocks(opened.series.back()->served()->manifest.block_cells);
      if (opened.series.back()->is_index_only()) {
        options.memory->NoteSource();
      }
    } else {
      ISOSCOPE_ASSIGN_OR_RETURN(opened.plain.emplace_back(),
                                OpenShardWithLevels(directory, open_file, options.open_samples));
      const store::ShardReader& reader = *opened.plain.back()->reader;
      options.memory->NoteBlocks(reader.manifest().block_cells);
      if (reader.is_index_only()) {
        options.memory->NoteSource();
      }
    }
    opening->NoteOpen();
  }
  return opened;
}

class AgentServerImpl final : public AgentServer {
 public:
  explicit AgentServerImpl(const AgentServerOptions& options)
      : options_(options), certificate_(options.transport.certificate_file), service_(options) {}
  ~AgentServerImpl() override { Shutdown(absl::ZeroDuration()); }

  // Finds what Open will open. Comes before Bind: an answer that named no dataset would be taken
  // for that of an agent without any.
  absl::Status Plan() {
    ISOSCOPE_ASSIGN_OR_RETURN(directories_, AllShardDirectories(options_));
    service_.opening()->Begin(directories_);
    return absl::OkStatus();
  }

  absl::Status Open(const base::Cancellation& cancellation,
                    const std::function<absl::Status()>& settle) override {
    ISOSCOPE_ASSIGN_OR_RETURN(OpenedShards opened,
                              OpenShards(options_, directories_, cancellation, service_.opening()));
    const std::vector<ShardLabel> labels = LabelsOf(opened);
    ISOSCOPE_RETURN_IF_ERROR(CheckConsistent(labels));
    if (settle != nullptr) {
      ISOSCOPE_RETURN_IF_ERROR(settle());
    }
    service_.Serve(std::move(opened.plain), std::move(opened.series));
    const base::MutexLock lock(&mutex_);
    summary_ = Summarize(labels);
    SetServing();
    return absl::OkStatus();
  }

  [[nodiscard]] std::string opening_summary() const override {
    return ToString(service_.opening()->progress());
  }

  absl::Status Bind(const AgentServerOptions& options) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::shared_ptr<grpc::ServerCredentials> credentials,
        rpc::MakeServerCredentials(options.transport, rpc::kAgentRole,
                                   rpc::PeerCertificate::kRequired, rpc::kCoordinatorRole));
    rpc::EnableServerPlugins();
    grpc::ServerBuilder builder;
    rpc::ConfigureServer(&builder);
    if (options.has_reflection) {
      rpc::AddReflectionV1(&builder);
    } else {
      rpc::RemoveReflection(&builder);
    }
    builder.RegisterService(&service_);
    ISOSCOPE_ASSIGN_OR_RETURN(rpc::RunningServer running,
                              rpc::StartServer(&builder, options.listen_address, credentials));
    const base::MutexLock lock(&mutex_);
    server_ = std::move(running.server);
    port_ = running.port;
    SetServing();
    return absl::OkStatus();
  }

  [[nodiscard]] int port() const override { return port_; }

  std::shared_ptr<grpc::Channel> InProcessChannel() override {
    return server_->InProcessChannel(rpc::MakeChannelArguments());
  }

  [[nodiscard]] std::string shard_summary() const override {
    const base::MutexLock lock(&mutex_);
    return summary_;
  }

  [[nodiscard]] int frames_in_work() const override { return service_.frames_in_work(); }

  std::vector<base::MetricFamily> CollectMetrics() override {
    return service_.CollectMetrics(&certificate_);
  }

  void AnnounceDrain() override {
    service_.AnnounceDrain();
    const base::MutexLock lock(&mutex_);
    is_stopping_ = true;
    SetServing();
  }

  void Shutdown(absl::Duration grace) override {
    if (server_ == nullptr) {
      return;  // never listened
    }
    {
      const base::MutexLock lock(&mutex_);
      is_stopping_ = true;
      SetServing();
    }
    const base::MonotonicTime deadline = base::MonotonicNow() + grace;
    service_.FinishFrames(deadline);
    server_->Shutdown(deadline);
  }

 private:
  // Health tells whether all shards are open, and the agent does not stop.
  void SetServing() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (server_ == nullptr) {
      return;  // opened before it listens
    }
    const bool is_serving = service_.is_open() && !is_stopping_;
    grpc::HealthCheckServiceInterface* health = server_->GetHealthCheckService();
    health->SetServingStatus(is_serving);  // the server as a whole
    health->SetServingStatus(isoscope::internal::v1::PartitionAgentService::service_full_name(),
                             is_serving);
  }

  const AgentServerOptions options_;
  std::vector<std::string> directories_;  // of all shards; set by Plan
  rpc::CertificateWatch certificate_;
  PartitionAgentServiceImpl service_;  // outlives the server
  mutable base::Mutex mutex_;          // of the health, which two threads may set
  std::string summary_ ABSL_GUARDED_BY(mutex_);
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::unique_ptr<grpc::Server> server_;  // set before other threads may call
  int port_ = 0;
};

}  // namespace

namespace {

absl::Status CheckOptions(const AgentServerOptions& options) {
  if (options.directories.empty()) {
    return absl::InvalidArgumentError("no shard: name at least one shard or dataset directory");
  }
  if (options.max_concurrent_frames < 1 || options.max_queued_frames < 0) {
    return absl::InvalidArgumentError(absl::StrCat(
        "max_concurrent_frames is ", options.max_concurrent_frames, " and max_queued_frames ",
        options.max_queued_frames, ": must be at least 1 and at least 0"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::unique_ptr<AgentServer>> AgentServer::Start(const AgentServerOptions& options) {
  ISOSCOPE_RETURN_IF_ERROR(CheckOptions(options));
  auto server = std::make_unique<AgentServerImpl>(options);
  ISOSCOPE_RETURN_IF_ERROR(server->Plan());
  ISOSCOPE_RETURN_IF_ERROR(server->Open(base::ProcessInterrupt(), /*settle=*/nullptr));
  ISOSCOPE_RETURN_IF_ERROR(server->Bind(options));
  return server;
}

absl::StatusOr<std::unique_ptr<AgentServer>> AgentServer::Listen(
    const AgentServerOptions& options) {
  ISOSCOPE_RETURN_IF_ERROR(CheckOptions(options));
  auto server = std::make_unique<AgentServerImpl>(options);
  ISOSCOPE_RETURN_IF_ERROR(server->Plan());
  ISOSCOPE_RETURN_IF_ERROR(server->Bind(options));
  return server;
}

}  // namespace isoscope::agent
