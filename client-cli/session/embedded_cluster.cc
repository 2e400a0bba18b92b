// A coordinator and an agent for each shard, in this process. They share one arena of threads, one
// memory limit, one renderer and one executor of frames; images go from agents to the coordinator
// through mailboxes, without being encoded.
//
// Start:
//
//   1. All shards of all datasets must be there, because no other machine could serve them. A frame
//      draws one dataset: what depends on the number of shards takes the most of a dataset.
//   2. With at least two shards a thread, each step draws with one thread; else with all.
//   3. Agents open their shards, then AgentMemory::Settle sizes the cache.
//   4. The coordinator starts, and waits until it knows all agents.
//
// Invariant: the coordinator ends before the agents, because it calls them.

#include "client-cli/session/embedded_cluster.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "clients/cpp/request/parse_value.h"
#include "core/base/executor.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/base/units.h"
#include "core/frame/drawn_window.h"
#include "core/frame/frame_spec.h"
#include "core/indexed/sample_opener.h"
#include "core/render/renderer_factory.h"
#include "core/store/series_manifest.h"
#include "partition-agent/agent_server.h"
#include "partition-agent/memory/agent_memory.h"
#include "server/coordinator_server.h"

namespace isoscope::cli {
namespace {

// Agents in the same process answer at once; this is for a machine under heavy load.
constexpr absl::Duration kReadyTimeout = absl::Seconds(60);

absl::Status CheckAllShardsPresent(const std::vector<std::string>& shard_directories,
                                   const std::string& directory) {
  std::vector<std::size_t> missing;
  for (std::size_t i = 0; i < shard_directories.size(); ++i) {
    if (shard_directories[i].empty()) {
      missing.push_back(i);
    }
  }
  if (missing.empty()) {
    return absl::OkStatus();
  }
  return absl::FailedPreconditionError(
      absl::StrCat("'", directory, "' lacks ", missing.size(), " of its ", shard_directories.size(),
                   " shards (", absl::StrJoin(missing, ", "),
                   "); serve them where they are with isoscope-agent, or copy them back"));
}

struct ShardsToServe {
  std::vector<std::string> directories;   // of all datasets
  std::size_t most_count_of_dataset = 0;  // the agents that draw a frame, at most
};

absl::StatusOr<ShardsToServe> FindShards(const EmbeddedClusterOptions& options) {
  std::vector<std::string> datasets = {options.dataset_directory};
  datasets.insert(datasets.end(), options.more_dataset_directories.begin(),
                  options.more_dataset_directories.end());
  ShardsToServe found;
  for (const std::string& dataset : datasets) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> shards,
                              store::ShardDirectoriesOf(dataset));
    ISOSCOPE_RETURN_IF_ERROR(CheckAllShardsPresent(shards, dataset));
    found.directories.insert(found.directories.end(), shards.begin(), shards.end());
    found.most_count_of_dataset = std::max(found.most_count_of_dataset, shards.size());
  }
  return found;
}

std::size_t LimitBytesOf(const EmbeddedClusterOptions& options) {
  return options.memory_limit_bytes > 0 ? options.memory_limit_bytes
                                        : agent::AgentMemory::DefaultLimitBytes();
}

// Without agents, and without what they share with the coordinator.
server::CoordinatorServerOptions CoordinatorOptionsOf(const EmbeddedClusterOptions& options) {
  server::CoordinatorServerOptions coordinator_options;
  coordinator_options.listen_address = options.listen_address;
  coordinator_options.transport = options.transport;
  coordinator_options.token_file = options.token_file;
  coordinator_options.memory_limit_bytes = options.memory_limit_bytes;
  coordinator_options.max_frame_duration = options.max_frame_duration;
  coordinator_options.expected_viewport =
      options.draws_once ? std::nullopt : options.expected_viewport;
  return coordinator_options;
}

}  // namespace

std::string DescribeFewerThreads(const EmbeddedClusterOptions& options) {
  const std::size_t limit_bytes = LimitBytesOf(options);
  const int wanted = agent::AgentMemory::DrawingThreads(options.thread_count,
                                                        std::numeric_limits<std::int64_t>::max());
  const int drawing = agent::AgentMemory::DrawingThreads(options.thread_count, limit_bytes);
  return drawing == wanted
             ? ""
             : absl::StrFormat(
                   "%d threads draw in place of %d: the memory limit of %d MiB has no "
                   "room for more; raise --memory-limit, or give --threads %d",
                   drawing, wanted, limit_bytes / base::kMiB, drawing);
}

absl::StatusOr<std::int64_t> ParseAgentMemory(absl::string_view text) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t bytes, client::ParseByteSize(text));
  if (static_cast<std::size_t>(bytes) < agent::AgentMemory::kMinLimitBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' is less than agents need: at least ",
                     agent::AgentMemory::kMinLimitBytes / base::kMiB, "MiB"));
  }
  return bytes;
}

absl::StatusOr<std::unique_ptr<EmbeddedCluster>> EmbeddedCluster::Start(
    const EmbeddedClusterOptions& options) {
  // 1. All shards are there.
  ISOSCOPE_ASSIGN_OR_RETURN(const ShardsToServe shards, FindShards(options));

  std::unique_ptr<EmbeddedCluster> cluster(new EmbeddedCluster());
  const std::size_t limit_bytes = LimitBytesOf(options);
  const std::shared_ptr<base::TaskArena> arena =
      agent::AgentMemory::MakeArena(options.thread_count, limit_bytes);

  // 2. With at least two agents a thread, no thread is idle for long while the last one draws.
  const bool one_thread_a_step =
      shards.most_count_of_dataset >= 2 * static_cast<std::size_t>(arena->max_concurrency());
  arena->SetSharesThreads(one_thread_a_step);
  const auto memory = std::make_shared<agent::AgentMemory>(
      limit_bytes,
      one_thread_a_step ? arena->max_concurrency() : agent::AgentMemory::kDefaultStepCount,
      arena->max_concurrency());
  ISOSCOPE_ASSIGN_OR_RETURN(cluster->renderer_,
                            render::MakeRenderer({.kind = options.renderer,
                                                  .max_kept_mesh_bytes = memory->kept_mesh_bytes(),
                                                  .max_unused_bytes = memory->unused_image_bytes(),
                                                  .arena = arena}));

  const std::shared_ptr<image::PixelMailboxes> mailboxes = image::PixelMailboxes::Make();
  // As many steps at a time as there are drawing threads, and one more, because a step may wait for
  // a disk.
  const auto frame_executor = std::make_shared<base::Executor>(
      static_cast<std::size_t>(std::max(2, arena->max_concurrency())),
      /*max_queued=*/std::numeric_limits<std::size_t>::max());
  server::CoordinatorServerOptions coordinator_options = CoordinatorOptionsOf(options);
  coordinator_options.mailboxes = mailboxes;
  const int step_count =
      one_thread_a_step ? arena->max_concurrency() : agent::AgentMemory::kDefaultStepCount;
  coordinator_options.agent_limit = [step_count,
                                     back_end = cluster->renderer_->picture_revision().back_end](
                                        const frame::FrameSpec& spec) {
    const frame::DrawnWindow window = frame::DrawnWindowOf(spec);
    // OpenGL draws a region into a picture of the whole.
    const bool draws_whole = frame::DrawnBy(spec, back_end) == frame::BackEnd::kEgl;
    return agent::AgentMemory::LeastLimitFor(draws_whole ? window.viewport : window.image_size(),
                                             frame::HasLayers(spec) ? spec.max_layers : 0,
                                             step_count);
  };
  coordinator_options.arena = arena;
  agent::AgentServerOptions agent_options;
  agent_options.renderer = cluster->renderer_;
  agent_options.arena = arena;
  agent_options.memory = memory;
  // The user's own dataset, with the user's rights.
  ISOSCOPE_ASSIGN_OR_RETURN(indexed::SourceAccess access, indexed::AccessOfUser());
  access.max_bytes = memory->source_bytes();
  access.max_index_bytes = memory->source_index_bytes();
  agent_options.open_samples = indexed::MakeSampleOpener(access);
  agent_options.mailboxes = mailboxes;
  agent_options.frame_executor = frame_executor;
  agent_options.one_thread_a_step = one_thread_a_step;
  agent_options.hides_paths = !options.listen_address.empty();
  // 3. Agents open their shards; then the cache gets its size.
  for (const std::string& directory : shards.directories) {
    agent_options.directories = {directory};
    ISOSCOPE_ASSIGN_OR_RETURN(cluster->agents_.emplace_back(),
                              agent::AgentServer::Start(agent_options));
    coordinator_options.agents.push_back(
        {.target = absl::StrCat("in-process:", coordinator_options.agents.size()),
         .channel = cluster->agents_.back()->InProcessChannel()});
  }
  // The CPU draws in bands what does not fit the limit.
  std::optional<agent::AgentMemory::ExpectedStep> expected;
  if (options.expected_viewport &&
      (cluster->renderer_->picture_revision().back_end == frame::BackEnd::kEgl ||
       agent::AgentMemory::LeastLimitFor(*options.expected_viewport, options.expected_layers,
                                         step_count) <= memory->limit_bytes())) {
    expected = {.viewport = *options.expected_viewport, .max_layers = options.expected_layers};
  }
  const bool touches_ahead = options.expected_viewport.has_value() && !options.draws_once;
  ISOSCOPE_RETURN_IF_ERROR(memory->Settle(expected, touches_ahead));
  if (touches_ahead) {
    // Images go to the coordinator, which still holds those of step 2 while step 3 draws.
    const int count = static_cast<int>(shards.most_count_of_dataset);
    cluster->renderer_->Prepare(*options.expected_viewport, count, 2 * count);
  }
  // 4. The coordinator waits for all agents.
  ISOSCOPE_ASSIGN_OR_RETURN(cluster->coordinator_,
                            server::CoordinatorServer::Start(coordinator_options));
  ISOSCOPE_RETURN_IF_ERROR(
      cluster->coordinator_->WaitUntilReady(base::MonotonicNow() + kReadyTimeout));
  return cluster;
}

EmbeddedCluster::EmbeddedCluster() = default;

EmbeddedCluster::~EmbeddedCluster() {
  // The coordinator calls the agents, so it ends first.
  coordinator_.reset();
  agents_.clear();
}

std::shared_ptr<grpc::Channel> EmbeddedCluster::Channel() {
  return coordinator_->InProcessChannel();
}

void EmbeddedCluster::SetGatewayAddress(const std::string& address) {
  coordinator_->SetGatewayAddress(address);
}

int EmbeddedCluster::port() const { return coordinator_->port(); }

std::string EmbeddedCluster::renderer_description() const { return renderer_->description(); }

// The agents stay: until it is destroyed, the coordinator asks them how they are, and a call on the
// in-process channel of a server that has ended is a crash of gRPC 1.51, which calls the null pointer
// that stands for the server's callback then.
void EmbeddedCluster::Shutdown(absl::Duration grace) { coordinator_->Shutdown(grace); }

}  // namespace isoscope::cli
