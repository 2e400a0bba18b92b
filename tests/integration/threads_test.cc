// Every number of shards with every number of threads in one process: a frame comes to its end, and
// its picture is the same, byte for byte. A frame that hangs ends a test by the deadline of its
// call.

#include <sched.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"
#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include "client-cli/session/embedded_cluster.h"
#include "core/base/check.h"
#include "core/base/monotonic_time.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

constexpr int kMaxShards = 16;
constexpr int kMaxThreads = 3;
// Two or three steps at a time: what is most likely to wait, and quick to start. A process with
// AddressSanitizer keeps up to 256 MiB of what was freed.
#ifdef __SANITIZE_ADDRESS__
constexpr std::int64_t kMemoryLimit = 1024 * base::kMiB;
#else
constexpr std::int64_t kMemoryLimit = 256 * base::kMiB;
#endif
// For a frame that takes milliseconds.
constexpr absl::Duration kDeadline = absl::Seconds(60);

// Restricts this thread, and the processes that it starts, to one CPU while it lives.
class OneCpu {
 public:
  OneCpu() {
    ISOSCOPE_CHECK_EQ(sched_getaffinity(0, sizeof(before_), &before_), 0);
    std::size_t first = 0;
    while (CPU_ISSET(first, &before_) == 0) {
      ++first;
    }
    cpu_set_t one;
    CPU_ZERO(&one);
    CPU_SET(first, &one);
    ISOSCOPE_CHECK_EQ(sched_setaffinity(0, sizeof(one), &one), 0);
  }
  ~OneCpu() { sched_setaffinity(0, sizeof(before_), &before_); }
  OneCpu(const OneCpu&) = delete;
  OneCpu& operator=(const OneCpu&) = delete;

 private:
  cpu_set_t before_;
};

class ThreadsTest : public ::testing::Test {
 protected:
  // The dataset, partitioned into this many shards.
  std::string Dataset(int shard_count) {
    const std::string directory = directory_.Sub(absl::StrCat("shards-", shard_count));
    if (!io::PathExists(directory)) {
      EXPECT_THAT(testing::MakeDataset(gyroid_, directory, shard_count, /*block_edge=*/8),
                  testing::IsOk());
    }
    return directory;
  }

  static absl::StatusOr<std::string> Render(cli::EmbeddedCluster* cluster,
                                            const isoscope::v1::RenderIsosurfaceRequest& request) {
    const auto stub = isoscope::v1::IsosurfaceService::NewStub(cluster->Channel());
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + kDeadline);
    isoscope::v1::RenderIsosurfaceResponse response;
    const absl::Status status =
        rpc::ToAbslStatus(stub->RenderIsosurface(&context, request, &response));
    if (!status.ok()) {
      return status;
    }
    return response.png();
  }

  // Occluders and the rest; all at once; translucent layers before and behind an opaque surface.
  static std::vector<isoscope::v1::RenderIsosurfaceRequest> Requests() {
    std::vector<isoscope::v1::RenderIsosurfaceRequest> requests(3, testing::SmallRequest());
    requests[1].set_culling(isoscope::v1::CULLING_NONE);
    requests[2].clear_isovalue();
    for (const double isovalue : {110.0, 128.0, 150.0}) {
      isoscope::v1::Surface* const surface = requests[2].add_surfaces();
      surface->set_isovalue(isovalue);
      surface->mutable_color()->set_green(1);
      surface->mutable_color()->set_alpha(isovalue == 128.0 ? 1.0F : 0.4F);
    }
    return requests;
  }

  testing::TempDir directory_;
  // It has more blocks than shards, and blocks do not divide it.
  const testing::TestVolume gyroid_ = testing::GyroidVolume({43, 37, 29});
};

// Symptom: with one thread and four shards or more no frame came to its end.
TEST_F(ThreadsTest, EveryNumberOfShardsAndThreadsGivesTheSamePictures) {
  std::vector<std::string> expected;
  for (int shard_count = 1; shard_count <= kMaxShards; ++shard_count) {
    for (int thread_count = 1; thread_count <= kMaxThreads; ++thread_count) {
      SCOPED_TRACE(absl::StrCat(shard_count, " shards, ", thread_count, " threads"));
      cli::EmbeddedClusterOptions options;
      options.dataset_directory = Dataset(shard_count);
      options.renderer = render::RendererKind::kCpu;
      options.thread_count = thread_count;
      options.memory_limit_bytes = kMemoryLimit;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<cli::EmbeddedCluster> cluster,
                                    cli::EmbeddedCluster::Start(options));
      std::vector<std::string> pictures;
      for (const isoscope::v1::RenderIsosurfaceRequest& request : Requests()) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(pictures.emplace_back(), Render(cluster.get(), request));
      }
      if (expected.empty()) {
        expected = pictures;
        EXPECT_EQ(pictures[0], pictures[1]);
        EXPECT_NE(pictures[0], pictures[2]);
      }
      ASSERT_TRUE(pictures == expected);
    }
  }
}

// As in a container with one CPU, and with the memory limit of this machine. Without --threads
// there is one thread.
TEST_F(ThreadsTest, OnOneCpuTheProgramEndsWithTheSamePicture) {
  const OneCpu one_cpu;
  std::string expected;
  for (const int shard_count : {1, 4, 8, 16}) {
    for (int thread_count = 0; thread_count <= kMaxThreads; ++thread_count) {
      SCOPED_TRACE(absl::StrCat(shard_count, " shards, ", thread_count, " threads"));
      const std::string png = directory_.Sub("picture.png");
      std::vector<std::string> arguments = {
          "render",       Dataset(shard_count),
          "--isovalue",   "128",
          "--width",      "160",
          "--height",     "120",
          "--renderer",   "cpu",
          "--output",     png,
          "--timeout",    absl::StrCat(absl::ToInt64Seconds(kDeadline)),
          "--no-metadata"};
      if (thread_count > 0) {
        arguments.insert(arguments.end(), {"--threads", absl::StrCat(thread_count)});
      }
      const testing::CommandResult result = testing::RunIsoscope(arguments);
      ASSERT_EQ(result.exit_code, 0) << result.err;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string picture,
                                    io::ReadWholeFile(png, 64 * base::kMiB));
      if (expected.empty()) {
        expected = picture;
      }
      ASSERT_TRUE(picture == expected);
    }
  }
}

}  // namespace
}  // namespace isoscope
