// Start builds the parts of a coordinator in the order of their dependencies:
//
//   HealthReporter, AgentRegistry, AccessControl, AuditLog, CoordinatorState, FrameRunner,
//   services, gRPC server
//
// Members are destroyed in the reverse order, so each part outlives its users. gRPC creates the
// health service with the server, and the registry reports its first probe from its own thread. So
// the reporter is shared, and waits for both.

#include "server/coordinator_server.h"

#include <array>
#include <cstdint>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/base/version.h"
#include "core/view/camera.h"
#include "rpc/certificate_watch.h"
#include "rpc/channel.h"
#include "rpc/grpc_time.h"
#include "rpc/reflection_v1.h"
#include "server/access/access_control.h"
#include "server/access/audit_log.h"
#include "server/admission/coordinator_memory.h"
#include "server/cluster/agent_registry.h"
#include "server/cluster_service_impl.h"
#include "server/dataset_service_impl.h"
#include "server/frame/coordinator_state.h"
#include "server/frame/frame_runner.h"
#include "server/interact/interact_service_impl.h"
#include "server/isosurface_service_impl.h"

namespace isoscope::server {
namespace {

// Features of this server beyond the first version that clients may use; ascending. proto/README.md
// explains each name.
constexpr std::array<const char*, 17> kFeatures = {
    "bands",           "closed_meshes",   "color_ranges", "dataset_id",   "depth_bounds",
    "draining_agents", "error_info",      "fit_cells",    "label_values", "labels",
    "levels",          "nan_color",       "notes",        "pages",        "refinement",
    "smooth_labels",   "unresolved_count"};

isoscope::v1::GetCapabilitiesResponse CapabilitiesOf(const CoordinatorServerOptions& options) {
  isoscope::v1::GetCapabilitiesResponse capabilities;
  capabilities.set_version(std::string(base::Version()));
  capabilities.set_max_viewport_px(view::kMaxViewportPx);
  capabilities.set_max_concurrent_frame_count(options.max_concurrent_frames);
  capabilities.set_max_queued_frame_count(options.max_queued_frames);
  capabilities.set_max_message_bytes(rpc::kMaxMessageBytes);
  capabilities.set_max_frame_seconds(absl::ToDoubleSeconds(options.max_frame_duration));
  capabilities.set_gateway_address(options.gateway_address);
  for (const char* feature : kFeatures) {
    capabilities.add_features(feature);
  }
  return capabilities;
}

// Reports the health of the server and of its services: ready from the end of the first probe of
// all agents until the server stops. An incomplete dataset does not change that: it is one of many,
// and each of its calls reports it. The reporter begins once it has server and probe, in any order.
// Thread-safe.
class HealthReporter {
 public:
  void SetReady() {
    const base::MutexLock lock(&mutex_);
    is_ready_ = true;
    Report();
  }
  // Null when the server stops. Then nothing is serving.
  void SetServer(grpc::Server* server) {
    const base::MutexLock lock(&mutex_);
    if (server == nullptr) {
      is_ready_ = false;
      Report();
    }
    server_ = server;
    Report();
  }

 private:
  void Report() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (server_ == nullptr) {
      return;
    }
    grpc::HealthCheckServiceInterface* const health = server_->GetHealthCheckService();
    health->SetServingStatus(is_ready_);  // the server as a whole
    for (const char* service : {isoscope::v1::IsosurfaceService::service_full_name(),
                                isoscope::v1::InteractService::service_full_name(),
                                isoscope::v1::DatasetService::service_full_name(),
                                isoscope::v1::ClusterService::service_full_name()}) {
      health->SetServingStatus(service, is_ready_);
    }
  }

  base::Mutex mutex_;
  grpc::Server* server_ ABSL_GUARDED_BY(mutex_) = nullptr;
  bool is_ready_ ABSL_GUARDED_BY(mutex_) = false;
};

class CoordinatorServerImpl final : public CoordinatorServer {
 public:
  CoordinatorServerImpl(const CoordinatorServerOptions& options,
                        std::shared_ptr<HealthReporter> health,
                        std::unique_ptr<AgentRegistry> registry,
                        std::unique_ptr<AccessControl> access, std::shared_ptr<AuditLog> audit)
      : certificate_(options.transport.certificate_file),
        health_(std::move(health)),
        registry_(std::move(registry)),
        access_(std::move(access)),
        state_({.registry = registry_.get(),
                .access = access_.get(),
                .max_concurrent_frames = options.max_concurrent_frames,
                .max_queued_frames = options.max_queued_frames,
                .arena =
                    options.arena != nullptr ? options.arena : std::make_shared<base::TaskArena>(),
                .memory_limit_bytes = options.memory_limit_bytes > 0
                                          ? options.memory_limit_bytes
                                          : CoordinatorMemory::DefaultLimitBytes(),
                .agent_limit = options.agent_limit,
                .mailboxes = options.mailboxes,
                .audit = std::move(audit),
                .expected_viewport = options.expected_viewport}),
        runner_(&state_),
        isosurface_service_({.state = &state_,
                             .runner = &runner_,
                             .max_frame_duration = options.max_frame_duration,
                             .max_agent_silence = options.max_agent_silence,
                             .sign_of_life_interval = options.sign_of_life_interval,
                             .export_limits = options.export_limits}),
        interact_service_({.state = &state_,
                           .runner = &runner_,
                           .max_frame_duration = options.max_frame_duration}),
        dataset_service_(&state_),
        cluster_service_(&state_, CapabilitiesOf(options)) {}
  ~CoordinatorServerImpl() override { Shutdown(absl::ZeroDuration()); }

  absl::Status Listen(const CoordinatorServerOptions& options) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::shared_ptr<grpc::ServerCredentials> credentials,
        rpc::MakeServerCredentials(options.transport, rpc::kCoordinatorRole,
                                   rpc::PeerCertificate::kIfShown, /*required_role=*/""));
    rpc::EnableServerPlugins();
    grpc::ServerBuilder builder;
    rpc::ConfigureServer(&builder, rpc::kMaxPublicRequestBytes);
    if (options.has_reflection) {
      rpc::AddReflectionV1(&builder);
    } else {
      rpc::RemoveReflection(&builder);
    }
    builder.RegisterService(&isosurface_service_);
    builder.RegisterService(&interact_service_);
    builder.RegisterService(&dataset_service_);
    builder.RegisterService(&cluster_service_);
    ISOSCOPE_ASSIGN_OR_RETURN(rpc::RunningServer running,
                              rpc::StartServer(&builder, options.listen_address, credentials));
    server_ = std::move(running.server);
    port_ = running.port;
    health_->SetServer(server_.get());
    return absl::OkStatus();
  }

  [[nodiscard]] int port() const override { return port_; }

  std::shared_ptr<grpc::Channel> InProcessChannel() override {
    return server_->InProcessChannel(rpc::MakeChannelArguments());
  }

  absl::Status WaitUntilReady(base::MonotonicTime deadline) override {
    return registry_->WaitUntilReady(deadline);
  }

  std::vector<base::MetricFamily> CollectMetrics() override {
    std::vector<base::MetricFamily> families = base::ProcessMetrics(
        "isoscope-coordinator", static_cast<std::int64_t>(state_.memory.limit_bytes()));
    state_.AppendMetrics(&families);
    runner_.AppendMetrics(&families);
    AppendFileMetrics(&families);
    return families;
  }

  void SetGatewayAddress(const std::string& address) override {
    cluster_service_.SetGatewayAddress(address);
  }

  void Shutdown(absl::Duration grace) override {
    if (server_ == nullptr) {
      return;  // never listened
    }
    health_->SetServer(nullptr);
    interact_service_.EndStreams();  // they would outlast any grace
    server_->Shutdown(base::MonotonicNow() + grace);
  }

 private:
  // Files that are read again when they have changed, and the audit log.
  void AppendFileMetrics(std::vector<base::MetricFamily>* families) {
    using base::MetricSample;
    using Type = base::MetricFamily::Type;
    const AuditLog* const audit = state_.calls.audit.get();
    const auto count = [](std::int64_t value, const char* label, const char* label_value) {
      return MetricSample::Of(static_cast<double>(value), {{label, label_value}});
    };
    families->push_back({.name = "isoscope_certificate_days_left",
                         .help = "Days until the own certificate expires; 0 if it can't be read, "
                                 "infinity without one.",
                         .type = Type::kGauge,
                         .samples = {MetricSample::Of(certificate_.DaysLeft())}});
    families->push_back(
        {.name = "isoscope_reload_failures_total",
         .help = "Files that were wrong, or could not be read, after a change; what was read "
                 "before holds.",
         .type = Type::kCounter,
         .samples = {count(access_->failed_reloads(), "file", "tokens"),
                     count(certificate_.failures(), "file", "certificate")}});
    families->push_back(
        {.name = "isoscope_audit_lines_total",
         .help = "Lines of the audit log, by result.",
         .type = Type::kCounter,
         .samples = {count(audit == nullptr ? 0 : audit->written_lines(), "result", "written"),
                     count(audit == nullptr ? 0 : audit->failed_lines(), "result", "failed")}});
  }

  rpc::CertificateWatch certificate_;
  const std::shared_ptr<HealthReporter> health_;
  const std::unique_ptr<AgentRegistry> registry_;
  const std::unique_ptr<AccessControl> access_;
  CoordinatorState state_;
  FrameRunner runner_;
  IsosurfaceServiceImpl isosurface_service_;  // services outlive the server
  InteractServiceImpl interact_service_;
  DatasetServiceImpl dataset_service_;
  ClusterServiceImpl cluster_service_;
  std::unique_ptr<grpc::Server> server_;
  int port_ = 0;
};

}  // namespace

absl::StatusOr<std::unique_ptr<CoordinatorServer>> CoordinatorServer::Start(
    const CoordinatorServerOptions& options) {
  if (options.max_concurrent_frames < 1 || options.max_queued_frames < 0 ||
      options.max_frame_duration <= absl::ZeroDuration()) {
    return absl::InvalidArgumentError(
        absl::StrCat("max_concurrent_frames is ", options.max_concurrent_frames,
                     ", max_queued_frames ", options.max_queued_frames, ", max_frame_duration ",
                     absl::FormatDuration(options.max_frame_duration),
                     ": must be at least 1, at least 0, and greater than 0"));
  }
  if (options.memory_limit_bytes > 0 &&
      options.memory_limit_bytes < CoordinatorMemory::kMinLimitBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("memory_limit_bytes is ", options.memory_limit_bytes, ": must be at least ",
                     CoordinatorMemory::kMinLimitBytes, ", or 0 for the default"));
  }
  const auto health = std::make_shared<HealthReporter>();
  AgentRegistryOptions registry_options;
  registry_options.endpoints = options.agents;
  registry_options.poll_interval = options.poll_interval;
  registry_options.check_target = [transport = options.transport](const std::string& target) {
    return rpc::CheckDial(transport, "the agent", target);
  };
  ISOSCOPE_ASSIGN_OR_RETURN(
      registry_options.dialing,
      rpc::MakeDialing(options.transport, rpc::kCoordinatorRole, rpc::kAgentRole));
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<AccessControl> access,
                            AccessControl::Make({.has_tls = options.transport.has_tls(),
                                                 .token_file = options.token_file}));
  std::shared_ptr<AuditLog> audit;
  if (!options.audit_log.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(audit, AuditLog::Open(options.audit_log));
  }
  registry_options.on_first_probe = [health] { health->SetReady(); };
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<AgentRegistry> registry,
                            AgentRegistry::Start(registry_options));
  auto server = std::make_unique<CoordinatorServerImpl>(options, health, std::move(registry),
                                                        std::move(access), std::move(audit));
  ISOSCOPE_RETURN_IF_ERROR(server->Listen(options));
  return server;
}

}  // namespace isoscope::server
