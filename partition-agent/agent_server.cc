#include "partition-agent/agent_server.h"

#include <map>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/time/clock.h"
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/rpc/channel.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "partition-agent/partition_agent_service_impl.h"
#include "partition-agent/shard.h"

namespace isoscope::agent {
namespace {

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
  ISOSCOPE_ASSIGN_OR_RETURN(const store::DatasetDescription dataset, store::OpenDataset(directory));
  std::vector<std::string> present;
  for (const std::string& shard_directory : dataset.shard_directories) {
    if (!shard_directory.empty()) {
      present.push_back(shard_directory);
    }
  }
  if (present.empty()) {
    return absl::NotFoundError(absl::StrCat(directory, ": a dataset directory without any of its ",
                                            dataset.shard_directories.size(),
                                            " shard directories"));
  }
  return present;
}

// INVALID_ARGUMENT if a shard is given twice, or if two datasets share a name.
absl::Status CheckConsistent(const Shards& shards) {
  std::map<std::string, const store::ShardReader*> by_name;
  std::map<std::pair<std::string, int>, const store::ShardReader*> by_index;
  for (const std::shared_ptr<const Shard>& shard : shards) {
    const store::ShardReader* reader = shard->reader.get();
    const store::Manifest& manifest = reader->manifest();
    const auto [same_name, is_new_name] = by_name.emplace(manifest.name, reader);
    if (!is_new_name && (same_name->second->manifest_crc32c() != reader->manifest_crc32c() ||
                         same_name->second->manifest().dataset_id != manifest.dataset_id)) {
      return absl::InvalidArgumentError(absl::StrCat(
          "dataset \"", manifest.name, "\" is two different ones: ", same_name->second->directory(),
          " has id ", same_name->second->manifest().dataset_id, ", ", reader->directory(),
          " has id ", manifest.dataset_id, "; serve one of them"));
    }
    const auto [same_shard, is_new_shard] =
        by_index.emplace(std::pair(manifest.dataset_id, reader->shard_index()), reader);
    if (!is_new_shard) {
      return absl::InvalidArgumentError(absl::StrCat(
          "shard ", reader->shard_index(), " of dataset \"", manifest.name, "\" is given twice: ",
          same_shard->second->directory(), " and ", reader->directory(), "; name it once"));
    }
  }
  return absl::OkStatus();
}

std::string Summarize(const Shards& shards) {
  std::map<std::string, std::set<int>> indices;
  std::map<std::string, std::size_t> counts;
  for (const std::shared_ptr<const Shard>& shard : shards) {
    const store::Manifest& manifest = shard->reader->manifest();
    indices[manifest.name].insert(shard->reader->shard_index());
    counts[manifest.name] = manifest.shards.size();
  }
  std::vector<std::string> parts;
  parts.reserve(indices.size());
  for (const auto& [name, of_dataset] : indices) {
    parts.push_back(absl::StrCat(name, " ", absl::StrJoin(of_dataset, ","), " of ", counts[name]));
  }
  return absl::StrJoin(parts, "; ");
}

class AgentServerImpl final : public AgentServer {
 public:
  AgentServerImpl(const AgentServerOptions& options, const Shards& shards)
      : certificate_(options.transport.certificate_file),
        service_(options, shards),
        summary_(Summarize(shards)) {}
  ~AgentServerImpl() override { Shutdown(absl::ZeroDuration()); }

  absl::Status Listen(const AgentServerOptions& options) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::shared_ptr<grpc::ServerCredentials> credentials,
        rpc::MakeServerCredentials(options.transport, rpc::kAgentRole,
                                   rpc::PeerCertificate::kRequired, rpc::kCoordinatorRole));
    rpc::EnableServerPlugins();
    grpc::ServerBuilder builder;
    rpc::ConfigureServer(&builder);
    if (!options.has_reflection) {
      rpc::RemoveReflection(&builder);
    }
    builder.RegisterService(&service_);
    ISOSCOPE_ASSIGN_OR_RETURN(rpc::RunningServer running,
                              rpc::StartServer(&builder, options.listen_address, credentials));
    server_ = std::move(running.server);
    port_ = running.port;
    SetServing(true);
    return absl::OkStatus();
  }

  [[nodiscard]] int port() const override { return port_; }

  std::shared_ptr<grpc::Channel> InProcessChannel() override {
    return server_->InProcessChannel(rpc::MakeChannelArguments());
  }

  [[nodiscard]] std::string shard_summary() const override { return summary_; }

  [[nodiscard]] int frames_in_work() const override { return service_.frames_in_work(); }

  std::vector<base::MetricFamily> CollectMetrics() override {
    return service_.CollectMetrics(&certificate_);
  }

  void AnnounceDrain() override {
    service_.AnnounceDrain();
    SetServing(false);
  }

  void Shutdown(absl::Duration grace) override {
    if (server_ == nullptr) {
      return;  // never listened
    }
    SetServing(false);
    server_->Shutdown(absl::ToChronoTime(absl::Now() + grace));
  }

 private:
  void SetServing(bool is_serving) {
    grpc::HealthCheckServiceInterface* health = server_->GetHealthCheckService();
    health->SetServingStatus(is_serving);  // the server as a whole
    health->SetServingStatus(isoscope::internal::v1::PartitionAgentService::service_full_name(),
                             is_serving);
  }

  rpc::CertificateWatch certificate_;
  PartitionAgentServiceImpl service_;  // outlives the server
  const std::string summary_;
  std::unique_ptr<grpc::Server> server_;
  int port_ = 0;
};

}  // namespace

absl::StatusOr<std::unique_ptr<AgentServer>> AgentServer::Start(const AgentServerOptions& options) {
  if (options.directories.empty()) {
    return absl::InvalidArgumentError("no shard: name at least one shard or dataset directory");
  }
  if (options.max_concurrent_frames < 1 || options.max_queued_frames < 0) {
    return absl::InvalidArgumentError(absl::StrCat(
        "max_concurrent_frames is ", options.max_concurrent_frames, " and max_queued_frames ",
        options.max_queued_frames, ": must be at least 1 and at least 0"));
  }
  Shards shards;
  for (const std::string& directory : options.directories) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> shard_directories,
                              ShardDirectoriesOf(directory));
    for (const std::string& shard_directory : shard_directories) {
      ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const Shard> shard, OpenShard(shard_directory));
      shards.push_back(std::move(shard));
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckConsistent(shards));
  auto server = std::make_unique<AgentServerImpl>(options, shards);
  ISOSCOPE_RETURN_IF_ERROR(server->Listen(options));
  return server;
}

}  // namespace isoscope::agent
