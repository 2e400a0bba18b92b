#include "client-cli/session/embedded_cluster.h"

#include <memory>
#include <string>
#include <utility>

#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/partition/partitioner.h"
#include "core/render/renderer_kind.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/scalar_type.h"
#include "server/coordinator_server.h"
#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::cli {
namespace {

// Breaks if the agents end before the coordinator, which asks them every two seconds: `isoscope
// serve` that was told to end died of SIGSEGV, once in some two hundred times on a busy machine.
TEST(EmbeddedClusterTest, AgentsAnswerUntilTheCoordinatorIsGone) {
  const testing::TempDir folder;
  volume::GridGeometry geometry;
  geometry.sample_dims = {9, 9, 9};
  std::string samples(9 * 9 * 9, '\0');
  samples[samples.size() / 2] = '\xff';
  const auto source =
      testing::MakeMemorySource(geometry, volume::ScalarType::kUint8, std::move(samples), "dot");
  partition::PartitionOptions partition_options;
  partition_options.output_directory = folder.Sub("d");
  ISOSCOPE_ASSERT_OK(partition::Partition(*source, partition_options, base::Cancellation()));

  EmbeddedClusterOptions options;
  options.dataset_directory = folder.Sub("d");
  options.renderer = render::RendererKind::kCpu;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<EmbeddedCluster> cluster,
                                EmbeddedCluster::Start(options));
  cluster->Shutdown(absl::ZeroDuration());
  absl::SleepFor(server::CoordinatorServerOptions().poll_interval + absl::Milliseconds(300));
}

}  // namespace
}  // namespace isoscope::cli
