#include "tests/support/process_cluster.h"

#include <algorithm>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <grpcpp/client_context.h>

#include "core/base/cancellation.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/partition/partitioner.h"
#include "core/source/volume_source.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "tests/support/held_port.h"
#include "tests/support/memory_source.h"
#include "tests/support/synthetic_fields.h"

namespace isoscope::testing {
namespace {

constexpr char kIsoscope[] = ISOSCOPE_TEST_PROGRAM;
constexpr char kBench[] = ISOSCOPE_TEST_BENCH;
constexpr char kAgent[] = ISOSCOPE_TEST_AGENT;
constexpr char kCoordinator[] = ISOSCOPE_TEST_COORDINATOR;
constexpr char kGateway[] = ISOSCOPE_TEST_GATEWAY;
constexpr char kHoldingAgent[] = ISOSCOPE_TEST_HOLDING_AGENT;

TestVolume MakeVolume(const testing::Field& field, const math::Index3& dims, double scale) {
  TestVolume made;
  made.geometry.sample_dims = dims;
  made.samples = testing::SampleField(field, dims, made.type, scale, 128);
  return made;
}

std::string Triple(const math::Vec3d& v) {
  return absl::StrFormat("%.17g,%.17g,%.17g", v.x, v.y, v.z);
}

constexpr absl::string_view kLoopback = "127.0.0.1:";

// Holds the port of "127.0.0.1:PORT", and writes it into the address if it was 0. Null for other
// addresses, and for a port in use.
std::shared_ptr<const HeldPort> HoldPortOf(std::string* address) {
  int port = 0;
  if (!absl::StartsWith(*address, kLoopback) ||
      !absl::SimpleAtoi(absl::string_view(*address).substr(kLoopback.size()), &port)) {
    return nullptr;
  }
  std::shared_ptr<const HeldPort> held = HeldPort::Bind(port);
  if (held != nullptr) {
    *address = held->address();
  }
  return held;
}

// Starts a server and takes its address from the line with `event`.
absl::StatusOr<ServerProcess> StartServer(const std::vector<std::string>& argv,
                                          const std::string& event) {
  ServerProcess server;
  ISOSCOPE_ASSIGN_OR_RETURN(server.process, Process::Start(argv, {}));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string line, server.process->WaitForErrLine(event));
  constexpr absl::string_view kKey = "address=";
  const std::size_t begin = line.find(kKey.data());
  if (begin == std::string::npos) {
    return absl::InternalError(absl::StrCat("no ", kKey, " in: ", line));
  }
  const std::size_t value = begin + kKey.size();
  server.address = line.substr(value, line.find(' ', value) - value);
  return server;
}

void Append(const std::vector<std::string>& more, std::vector<std::string>* all) {
  all->insert(all->end(), more.begin(), more.end());
}

}  // namespace

TestVolume GyroidVolume(const math::Index3& dims) {
  return MakeVolume(testing::GyroidField(2), dims, 80);
}

TestVolume BallVolume(const math::Index3& dims, double radius) {
  return MakeVolume(testing::SphereField(radius), dims, 100);
}

absl::Status WriteRawFile(const TestVolume& volume, const std::string& path) {
  return io::WriteWholeFile(path, volume.samples);
}

std::vector<std::string> RawFlags(const TestVolume& volume) {
  const math::Index3& dims = volume.geometry.sample_dims;
  return {"--dims",    absl::StrCat(dims.x, ",", dims.y, ",", dims.z),
          "--type",    std::string(volume::NameOf(volume.type)),
          "--spacing", Triple(volume.geometry.spacing),
          "--origin",  Triple(volume.geometry.origin)};
}

absl::Status MakeDataset(const TestVolume& volume, const std::string& directory, int shard_count,
                         int block_edge) {
  const auto source =
      testing::MakeMemorySource(volume.geometry, volume.type, volume.samples, "generated");
  partition::PartitionOptions options;
  options.output_directory = directory;
  options.shard_count = shard_count;
  options.block_cells = {block_edge, block_edge, block_edge};
  return partition::Partition(*source, options, base::Cancellation()).status();
}

std::string ShardDirectory(const std::string& dataset_directory, int shard, int shard_count) {
  return absl::StrFormat("%s/shard-%05d-of-%05d", dataset_directory, shard, shard_count);
}

std::string IsoscopePath() { return kIsoscope; }

CommandResult RunIsoscope(const std::vector<std::string>& arguments,
                          const ProcessOptions& options) {
  std::vector<std::string> argv{kIsoscope};
  Append(arguments, &argv);
  return RunCommand(argv, options);
}

CommandResult RunIsoscopeBench(const std::vector<std::string>& arguments,
                               const ProcessOptions& options) {
  std::vector<std::string> argv{kBench};
  Append(arguments, &argv);
  return RunCommand(argv, options);
}

absl::StatusOr<std::unique_ptr<Process>> StartIsoscope(const std::vector<std::string>& arguments,
                                                       const ProcessOptions& options) {
  std::vector<std::string> argv{kIsoscope};
  Append(arguments, &argv);
  return Process::Start(argv, options);
}

absl::StatusOr<std::unique_ptr<Process>> StartIsoscopeBench(
    const std::vector<std::string>& arguments, const ProcessOptions& options) {
  std::vector<std::string> argv{kBench};
  Append(arguments, &argv);
  return Process::Start(argv, options);
}

absl::StatusOr<ServerProcess> StartAgent(const std::vector<std::string>& directories,
                                         const std::string& listen_address,
                                         const std::vector<std::string>& flags) {
  std::string address = listen_address;
  std::shared_ptr<const void> held_port = HoldPortOf(&address);
  std::vector<std::string> argv{kAgent, "--listen", address};
  if (std::find(flags.begin(), flags.end(), "--threads") == flags.end()) {
    Append({"--threads", "1"}, &argv);
  }
  if (std::find(flags.begin(), flags.end(), "--renderer") == flags.end()) {
    Append({"--renderer", "cpu"}, &argv);
  }
  for (const std::string& directory : directories) {
    Append({"--shard", directory}, &argv);
  }
  Append(flags, &argv);
  ISOSCOPE_ASSIGN_OR_RETURN(ServerProcess server, StartServer(argv, "agent_started"));
  server.held_port = std::move(held_port);
  return server;
}

absl::StatusOr<ServerProcess> StartHoldingAgent(const std::string& upstream_address,
                                                const std::string& hold) {
  std::string address = absl::StrCat(kLoopback, 0);
  std::shared_ptr<const void> held_port = HoldPortOf(&address);
  ISOSCOPE_ASSIGN_OR_RETURN(
      ServerProcess server,
      StartServer({kHoldingAgent, upstream_address, hold, address}, "agent_started"));
  server.held_port = std::move(held_port);
  return server;
}

namespace {

// Waits until the coordinator has a dataset, or ends. Returns false soon after an agent did not answer
// in time.
bool IsReady(const ServerProcess& coordinator) {
  constexpr absl::Duration kPollInterval = absl::Milliseconds(5);
  constexpr int kMostPollsOfALateAgent = 200;  // another line may still come
  const base::MonotonicTime deadline = base::MonotonicNow() + kPatience;
  for (int late_polls = 0; late_polls < kMostPollsOfALateAgent;) {
    const std::string printed = coordinator.process->err();
    if (absl::StrContains(printed, " dataset_ready ") || base::MonotonicNow() > deadline ||
        coordinator.process->Wait(absl::ZeroDuration()).ok()) {
      return true;
    }
    late_polls += absl::StrContains(printed, "agent_unreachable") &&
                          absl::StrContains(printed, "DEADLINE_EXCEEDED")
                      ? 1
                      : 0;
    absl::SleepFor(kPollInterval);
  }
  return false;
}

}  // namespace

absl::StatusOr<ServerProcess> StartCoordinator(const std::vector<std::string>& agent_addresses,
                                               const std::vector<std::string>& flags,
                                               bool wait_until_ready) {
  std::vector<std::string> argv{kCoordinator};
  if (std::find(flags.begin(), flags.end(), "--poll-seconds") == flags.end()) {
    Append({"--poll-seconds", "86400"}, &argv);
  }
  if (std::find(flags.begin(), flags.end(), "--listen") == flags.end()) {
    Append({"--listen", "127.0.0.1:0"}, &argv);
  }
  for (const std::string& address : agent_addresses) {
    Append({"--agent", address}, &argv);
  }
  Append(flags, &argv);
  const base::MonotonicTime deadline = base::MonotonicNow() + kPatience;
  while (true) {
    ISOSCOPE_ASSIGN_OR_RETURN(ServerProcess server, StartServer(argv, "coordinator_started"));
    if (!wait_until_ready) {
      return server;
    }
    if (IsReady(server) || base::MonotonicNow() > deadline) {
      ISOSCOPE_RETURN_IF_ERROR(server.process->WaitForErrLine("dataset_ready").status());
      return server;
    }
    // On a busy machine an agent was not asked in time, and it is not asked again by itself.
    server.process->Kill();
  }
}

absl::StatusOr<ServerProcess> StartGateway(const std::string& coordinator_address,
                                           const std::vector<std::string>& flags) {
  std::vector<std::string> argv{kGateway, "--listen", "127.0.0.1:0", "--server",
                                coordinator_address};
  Append(flags, &argv);
  return StartServer(argv, "gateway_started");
}

absl::StatusOr<std::unique_ptr<ProcessCluster>> ProcessCluster::Start(
    const std::string& dataset_directory, int shard_count,
    const std::vector<std::string>& coordinator_flags) {
  std::unique_ptr<ProcessCluster> cluster(new ProcessCluster());
  cluster->dataset_directory_ = dataset_directory;
  std::vector<std::string> addresses;
  for (int shard = 0; shard < shard_count; ++shard) {
    ISOSCOPE_ASSIGN_OR_RETURN(ServerProcess agent,
                              StartAgent({ShardDirectory(dataset_directory, shard, shard_count)}));
    addresses.push_back(agent.address);
    cluster->agents_.push_back(std::move(agent));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(cluster->coordinator_, StartCoordinator(addresses, coordinator_flags));
  return cluster;
}

absl::Status ProcessCluster::RestartAgent(int shard) {
  const int shard_count = static_cast<int>(agents_.size());
  ServerProcess& agent = agents_[static_cast<std::size_t>(shard)];
  agent.process->Kill();
  ISOSCOPE_ASSIGN_OR_RETURN(
      agent, StartAgent({ShardDirectory(dataset_directory_, shard, shard_count)}, agent.address));
  return absl::OkStatus();
}

isoscope::v1::RenderIsosurfaceRequest SmallRequest() {
  isoscope::v1::RenderIsosurfaceRequest request;
  request.set_isovalue(128);
  request.mutable_viewport()->set_width_px(96);
  request.mutable_viewport()->set_height_px(80);
  return request;
}

absl::StatusOr<isoscope::v1::RenderIsosurfaceResponse> Render(
    const std::string& address, const isoscope::v1::RenderIsosurfaceRequest& request,
    absl::Duration timeout) {
  const auto stub = isoscope::v1::IsosurfaceService::NewStub(rpc::MakeFreshChannel(address));
  grpc::ClientContext context;
  context.set_deadline(base::MonotonicNow() + timeout);
  isoscope::v1::RenderIsosurfaceResponse response;
  ISOSCOPE_RETURN_IF_ERROR(rpc::ToAbslStatus(stub->RenderIsosurface(&context, request, &response)));
  return response;
}

}  // namespace isoscope::testing
