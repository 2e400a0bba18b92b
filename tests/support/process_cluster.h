// Clusters made of the real programs: isoscope-agent and isoscope-coordinator processes on free
// ports of 127.0.0.1, and datasets for them. For what users meet: exit codes, messages, signals,
// processes that die.

#ifndef ISOSCOPE_TESTS_SUPPORT_PROCESS_CLUSTER_H_
#define ISOSCOPE_TESTS_SUPPORT_PROCESS_CLUSTER_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/math/vec.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/scalar_type.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "tests/support/process.h"

namespace isoscope::testing {

// A volume in memory.
struct TestVolume {
  volume::GridGeometry geometry;
  volume::ScalarType type = volume::ScalarType::kUint8;
  std::string samples;  // [z][y][x], x fastest, little-endian
};

// A gyroid around 128 in uint8 that fills the volume; unit spacing unless changed.
TestVolume GyroidVolume(const math::Index3& dims);
// A ball of `radius` (in [0, 1], of the half axis) around 128 in uint8; closed at 128.
TestVolume BallVolume(const math::Index3& dims, double radius);

// Writes the samples alone, and "--dims", "--type", "--spacing" and "--origin" that describe them.
absl::Status WriteRawFile(const TestVolume& volume, const std::string& path);
std::vector<std::string> RawFlags(const TestVolume& volume);

// Partitions without a process: blocks of `block_edge` cells.
absl::Status MakeDataset(const TestVolume& volume, const std::string& directory, int shard_count,
                         int block_edge);
// "DATASET/shard-00001-of-00003".
std::string ShardDirectory(const std::string& dataset_directory, int shard, int shard_count);

// The path of `isoscope`.
std::string IsoscopePath();
// Runs `isoscope ARGUMENTS...` to its end.
CommandResult RunIsoscope(const std::vector<std::string>& arguments,
                          const ProcessOptions& options = {});
// Runs `isoscope-bench ARGUMENTS...` to its end.
CommandResult RunIsoscopeBench(const std::vector<std::string>& arguments,
                               const ProcessOptions& options = {});
// Starts `isoscope`.
absl::StatusOr<std::unique_ptr<Process>> StartIsoscope(const std::vector<std::string>& arguments,
                                                       const ProcessOptions& options = {});

// Starts `isoscope-bench`.
absl::StatusOr<std::unique_ptr<Process>> StartIsoscopeBench(
    const std::vector<std::string>& arguments, const ProcessOptions& options = {});

// A server process and the address it printed.
struct ServerProcess {
  std::unique_ptr<Process> process;
  std::string address;
  // Keeps an agent's port for a successor: no other program gets it while this lives.
  std::shared_ptr<const void> held_port = nullptr;
};

// isoscope-agent with the CPU back end and one thread, unless `flags` choose others; waits until it
// serves. `listen_address` with port 0 takes a free one.
absl::StatusOr<ServerProcess> StartAgent(const std::vector<std::string>& directories,
                                         const std::string& listen_address = "127.0.0.1:0",
                                         const std::vector<std::string>& flags = {});
// Stands in for the agent at `upstream_address`, passes everything on, and holds the message `hold`
// ("begin", "occluders" or "visible_blocks") back: the frame then waits in step 1, 2 or 3. It
// prints "holding" when it does, "cancelled" when a frame that is held is cancelled, and passes
// everything on after SIGUSR1.
absl::StatusOr<ServerProcess> StartHoldingAgent(const std::string& upstream_address,
                                                const std::string& hold);
// isoscope-coordinator that asks its agents at start and when a frame needs them, but not by the
// clock: what it knows does not depend on time. Waits until a dataset is complete, unless told not
// to.
absl::StatusOr<ServerProcess> StartCoordinator(const std::vector<std::string>& agent_addresses,
                                               const std::vector<std::string>& flags = {},
                                               bool wait_until_ready = true);

// isoscope-gateway on a free port of 127.0.0.1.
absl::StatusOr<ServerProcess> StartGateway(const std::string& coordinator_address,
                                           const std::vector<std::string>& flags = {});

// A coordinator and one agent for each shard.
class ProcessCluster {
 public:
  static absl::StatusOr<std::unique_ptr<ProcessCluster>> Start(
      const std::string& dataset_directory, int shard_count,
      const std::vector<std::string>& coordinator_flags = {});

  [[nodiscard]] const std::string& address() const { return coordinator_.address; }
  [[nodiscard]] Process& coordinator() const { return *coordinator_.process; }
  [[nodiscard]] Process& agent(int shard) const {
    return *agents_[static_cast<std::size_t>(shard)].process;
  }
  [[nodiscard]] const std::string& agent_address(int shard) const {
    return agents_[static_cast<std::size_t>(shard)].address;
  }
  // Starts the agent of `shard` anew on its old port.
  absl::Status RestartAgent(int shard);

 private:
  std::string dataset_directory_;
  std::vector<ServerProcess> agents_;
  ServerProcess coordinator_;
};

// A request for a small picture at 128 from the default camera.
isoscope::v1::RenderIsosurfaceRequest SmallRequest();
// One RenderIsosurface to the coordinator at `address`, on a connection of its own; `timeout` is
// the client's deadline.
absl::StatusOr<isoscope::v1::RenderIsosurfaceResponse> Render(
    const std::string& address, const isoscope::v1::RenderIsosurfaceRequest& request,
    absl::Duration timeout = kPatience);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_PROCESS_CLUSTER_H_
