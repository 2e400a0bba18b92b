// Samples, ambient occlusion and silhouettes of clusters of real processes: neither agents, their
// threads and memory limits, blocks, culling nor regions show, planes and picks do not change, and
// the command line repeats pictures.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <regex>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/client_context.h>

#include "core/base/monotonic_time.h"
#include "core/base/random.h"
#include "core/base/status_macros.h"
#include "core/image/png_codec.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "partition-agent/memory/agent_memory.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "tests/support/draws.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::ProcessCluster;
using testing::StatusIs;

constexpr int kWidth = 130;
constexpr int kHeight = 110;
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr std::uint64_t kRequestCount = 12;
#else
constexpr std::uint64_t kRequestCount = 60;
#endif
// Random requests are asked in as many parts, each of new clusters.
constexpr std::uint64_t kPartCount = 3;
constexpr std::int64_t kNoiseSide = 72;
constexpr std::int64_t kLeastLimitMib = 96;  // that an agent accepts

// A coordinator on agents of one back end.
struct Cluster {
  std::vector<testing::ServerProcess> agents;
  std::vector<std::string> flags;  // of each agent
  testing::ServerProcess coordinator;
};

// The least limit of an agent that can draw the request (AgentMemory::ReserveStep). The factors are
// bytes of a pixel, of a translucent fragment, and the share of the limit that is for pixels.
std::int64_t LeastLimitMib(const v1::RenderIsosurfaceRequest& request) {
  const std::int64_t pixels = std::int64_t{request.viewport().width_px()} *
                              request.viewport().height_px() * std::max(request.samples(), 1);
  const std::int64_t layers = request.max_layers() == 0 ? 8 : request.max_layers();
  const bool is_translucent =
      std::any_of(request.surfaces().begin(), request.surfaces().end(),
                  [](const v1::Surface& surface) { return surface.color().alpha() < 1; });
  const std::int64_t bytes = pixels * (32 + (is_translucent ? 24 * (layers + 1) : 0));
  return std::max(kLeastLimitMib, (bytes * 32 / 5 >> 20) + 1);
}

class EffectsTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = new testing::TempDir();
    for (const auto& [shard_count, edge] : {std::pair(1, 8), std::pair(3, 8), std::pair(2, 5)}) {
      ISOSCOPE_ASSERT_OK(testing::MakeDataset(testing::GyroidVolume({43, 37, 29}),
                                              Dataset(shard_count), shard_count, edge));
    }
  }
  static void TearDownTestSuite() {
    delete shared_;
    shared_ = nullptr;
  }
  static std::string Dataset(int shard_count) {
    return shared_->Sub(absl::StrCat("d", shard_count));
  }

  // Starts agents with the given flags, besides their back end.
  static absl::StatusOr<std::unique_ptr<Cluster>> StartCluster(
      const std::string& dataset, int shard_count, const std::string& renderer,
      const std::function<std::vector<std::string>()>& flags_of_agent) {
    auto cluster = std::make_unique<Cluster>();
    std::vector<std::string> addresses;
    for (int shard = 0; shard < shard_count; ++shard) {
      std::vector<std::string> flags = flags_of_agent();
      cluster->flags.push_back(absl::StrJoin(flags, " "));
      flags.insert(flags.end(), {"--renderer", renderer});
      ISOSCOPE_ASSIGN_OR_RETURN(
          testing::ServerProcess agent,
          testing::StartAgent({testing::ShardDirectory(dataset, shard, shard_count)}, "127.0.0.1:0",
                              flags));
      addresses.push_back(agent.address);
      cluster->agents.push_back(std::move(agent));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(cluster->coordinator, testing::StartCoordinator(addresses));
    return cluster;
  }
  static absl::StatusOr<std::unique_ptr<Cluster>> StartCluster(int shard_count,
                                                               const std::string& renderer) {
    return StartCluster(Dataset(shard_count), shard_count, renderer,
                        [] { return std::vector<std::string>(); });
  }

  // The least memory limit with which an agent serves the dataset.
  static absl::StatusOr<std::int64_t> LeastLimitMibOfAgent(const std::string& dataset,
                                                           const std::string& renderer) {
    const absl::Status refused =
        StartCluster(dataset, 1, renderer, [] {
          return std::vector<std::string>{"--memory-limit", absl::StrCat(kLeastLimitMib, "MiB")};
        }).status();
    if (refused.ok()) {
      return kLeastLimitMib;
    }
    std::smatch found;
    std::int64_t least = 0;
    const std::string message(refused.message());
    if (!std::regex_search(message, found, std::regex("raise --memory-limit to (\\d+)MiB")) ||
        !absl::SimpleAtoi(found[1].str(), &least)) {
      return refused;
    }
    return least + 16;  // another process holds a bit more
  }

  // The least limit that has room for so many threads.
  static std::int64_t LimitMibFor(int thread_count, std::int64_t least_mib) {
    std::int64_t limit_mib = least_mib;
    while (agent::AgentMemory::MakeArena(thread_count, static_cast<std::size_t>(limit_mib) << 20)
               ->max_concurrency() < thread_count) {
      limit_mib += 8;
    }
    return limit_mib;
  }

  // Draws the threads of an agent, and its limit: from `least_mib` to none.
  static std::vector<std::string> DrawFlags(std::int64_t least_mib, testing::Dice* dice) {
    std::vector<std::string> flags{"--threads", absl::StrCat(dice->OneOf(testing::kThreadCounts))};
    if (!dice->OneIn(4)) {
      const auto least = static_cast<std::size_t>(least_mib);
      flags.insert(flags.end(),
                   {"--memory-limit",
                    absl::StrCat(dice->Size(least, 8 * std::max<std::size_t>(least, 512)), "MiB")});
    }
    return flags;
  }

  // A request with all options at random: camera, surfaces, opacities, colours, lights, clipping,
  // background and effects; never without an effect.
  static v1::RenderIsosurfaceRequest RandomRequest(std::uint64_t seed) {
    std::uint64_t counter = 0;
    const auto random = [&] { return base::RandomUnit(seed, 77'000 + counter++); };
    const auto below = [&](int limit) { return static_cast<int>(limit * random()); };
    v1::RenderIsosurfaceRequest request;
    request.mutable_viewport()->set_width_px(kWidth + below(20));
    request.mutable_viewport()->set_height_px(kHeight + below(20));
    v1::Camera* const camera = request.mutable_camera();
    const double angle = 6.283 * random();
    const double height = 60 * (random() - 0.5);
    const double distance = 45 + 60 * random();
    camera->mutable_eye()->set_x(21 + distance * std::cos(angle));
    camera->mutable_eye()->set_y(18 + height);
    camera->mutable_eye()->set_z(14 + distance * std::sin(angle));
    camera->mutable_target()->set_x(21);
    camera->mutable_target()->set_y(18);
    camera->mutable_target()->set_z(14);
    camera->mutable_up()->set_y(1);
    if (below(2) == 0) {
      camera->mutable_perspective()->set_fov_y_degrees(20 + 30 * random());
    } else {
      camera->mutable_orthographic()->set_height(20 + 40 * random());
    }
    const int surfaces = 1 + below(3);
    for (int i = 0; i < surfaces; ++i) {
      v1::Surface* const surface = request.add_surfaces();
      surface->set_isovalue(100 + 20 * i);
      surface->mutable_color()->set_red(static_cast<float>(random()));
      surface->mutable_color()->set_green(static_cast<float>(random()));
      surface->mutable_color()->set_blue(static_cast<float>(random()));
      // The first one is opaque: effects show on it alone.
      const bool is_translucent = i > 0 && below(2) == 0;
      surface->mutable_color()->set_alpha(is_translucent ? static_cast<float>(0.1 + 0.8 * random())
                                                         : 1.0F);
      if (below(4) == 0) {
        surface->mutable_color_by()->set_quantity(static_cast<v1::ColorBy::Quantity>(
            1 + below(v1::ColorBy::QUANTITY_GRADIENT_MAGNITUDE)));
      }
    }
    constexpr int kMaxLayers[] = {0, 1, 3, 16};
    request.set_max_layers(kMaxLayers[below(4)]);
    for (int i = below(2) * below(5); i > 0; --i) {
      v1::Light* const light = request.add_lights();
      light->mutable_direction()->set_x(random() - 0.5);
      light->mutable_direction()->set_y(random() - 0.5);
      light->mutable_direction()->set_z(0.1 + random());
      light->set_space(static_cast<v1::Light::Space>(below(v1::Light::Space_MAX + 1)));
      light->set_intensity(static_cast<float>(2 * random()));
    }
    if (below(3) == 0) {
      v1::HalfSpace* const half_space = request.mutable_clip()->add_half_spaces();
      half_space->mutable_normal()->set_x(1);
      half_space->set_offset(10 + 10 * random());
      const int caps = below(3);
      if (caps > 0) {
        request.mutable_caps();
      }
      if (caps > 1) {
        request.mutable_caps()->set_color_map(
            static_cast<v1::ColorMap>(1 + below(v1::ColorMap_MAX)));
      }
    }
    request.mutable_background_color()->set_red(static_cast<float>(random()));
    constexpr float kAlphas[] = {1, 1, 0, 0.6F};
    request.mutable_background_color()->set_alpha(kAlphas[below(4)]);
    constexpr int kSamples[] = {1, 4, 9, 16};
    request.set_samples(kSamples[below(4)]);
    const int effects = request.samples() == 1 ? 1 + below(3) : below(4);
    if ((effects & 1) != 0) {
      request.mutable_ambient_occlusion()->set_radius_px(4 + below(53));
      request.mutable_ambient_occlusion()->set_strength(static_cast<float>(random()));
    }
    if ((effects & 2) != 0) {
      request.mutable_silhouette()->set_width_px(1 + below(16));
    }
    return request;
  }

  static absl::StatusOr<v1::RenderIsosurfaceResponse> Render(
      const Cluster& cluster, const v1::RenderIsosurfaceRequest& request) {
    return testing::Render(cluster.coordinator.address, request);
  }

  static absl::StatusOr<image::RgbaImage> RenderImage(const Cluster& cluster,
                                                      const v1::RenderIsosurfaceRequest& request) {
    const absl::StatusOr<v1::RenderIsosurfaceResponse> response = Render(cluster, request);
    return response.ok() ? image::DecodePng(response->png()) : response.status();
  }

  // Compares random requests between clusters of one back end, and their regions with the whole.
  static void CheckRandomRequests(const std::string& renderer, bool with_other_blocks) {
    std::vector<std::pair<std::uint64_t, v1::RenderIsosurfaceRequest>> requests;
    for (std::uint64_t seed = 1; seed <= kRequestCount; ++seed) {
      requests.emplace_back(seed, RandomRequest(seed));
    }
    // Those that need least memory come first, so that the first clusters may have little.
    std::stable_sort(requests.begin(), requests.end(), [](const auto& a, const auto& b) {
      return LeastLimitMib(a.second) < LeastLimitMib(b.second);
    });
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::int64_t least,
                                  LeastLimitMibOfAgent(Dataset(1), renderer));
    testing::Dice dice(testing::DrawSeed());
    std::int64_t shown_count = 0;
    constexpr std::uint64_t kPartSize = kRequestCount / kPartCount;
    for (std::uint64_t part = 0; part < kPartCount; ++part) {
      const auto begin = requests.begin() + static_cast<std::ptrdiff_t>(part * kPartSize);
      const auto end = begin + kPartSize;
      const std::int64_t least_of_part = std::max(least, LeastLimitMib((end - 1)->second));
      std::vector<std::unique_ptr<Cluster>> clusters;
      for (const int shard_count : {1, 3, 2}) {  // the last one has other blocks
        if (shard_count == 2 && !with_other_blocks) {
          continue;
        }
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(
            clusters.emplace_back(), StartCluster(Dataset(shard_count), shard_count, renderer,
                                                  [&] { return DrawFlags(least_of_part, &dice); }));
      }
      for (auto request = begin; request != end; ++request) {
        shown_count += CheckRequest(clusters, request->first, request->second);
        if (HasFatalFailure()) {
          return;
        }
      }
    }
    EXPECT_GT(shown_count, static_cast<std::int64_t>(kRequestCount) * 3000);
  }

  // Returns how many pixels the picture shows.
  static std::int64_t CheckRequest(const std::vector<std::unique_ptr<Cluster>>& clusters,
                                   std::uint64_t seed, v1::RenderIsosurfaceRequest request) {
    std::int64_t shown_count = 0;
    const auto check = [&] {
      SCOPED_TRACE(absl::StrCat("seed ", seed, ": ", request.ShortDebugString()));
      request.set_culling(v1::CULLING_NONE);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse expected,
                                    Render(*clusters[0], request));
      request.set_culling(v1::CULLING_DEPTH);
      for (const auto& cluster : clusters) {
        SCOPED_TRACE(absl::StrCat("agents: ", absl::StrJoin(cluster->flags, "; ")));
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response,
                                      Render(*cluster, request));
        ASSERT_TRUE(response.png() == expected.png())
            << cluster->agents.size() << " agents show in the picture";
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage whole, image::DecodePng(expected.png()));
      shown_count = CountOthers(whole);
      const auto part = [&](std::uint64_t counter, int size) {
        return static_cast<int>(size * base::RandomUnit(seed, counter));
      };
      v1::Region* const region = request.mutable_region();
      region->set_x(part(1, whole.width));
      region->set_y(part(2, whole.height));
      region->set_width_px(1 + part(3, whole.width - region->x()));
      region->set_height_px(1 + part(4, whole.height - region->y()));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage window,
                                    RenderImage(*clusters[seed % clusters.size()], request));
      ExpectWindow(whole, window, region->x(), region->y());
    };
    check();
    return shown_count;
  }

  // Pixels that differ from the first one.
  static std::int64_t CountOthers(const image::RgbaImage& image) {
    return std::count_if(image.pixels.begin(), image.pixels.end(),
                         [&](const image::Rgba8& pixel) { return !(pixel == image.pixels[0]); });
  }

  static void ExpectWindow(const image::RgbaImage& whole, const image::RgbaImage& window, int x0,
                           int y0) {
    for (int y = 0; y < window.height; ++y) {
      for (int x = 0; x < window.width; ++x) {
        ASSERT_EQ(window.pixels[static_cast<std::size_t>(y * window.width + x)],
                  whole.pixels[static_cast<std::size_t>((y + y0) * whole.width + x + x0)])
            << "pixel " << x + x0 << ", " << y + y0;
      }
    }
  }

  static testing::TempDir* shared_;
};

testing::TempDir* EffectsTest::shared_ = nullptr;

TEST_F(EffectsTest, NeitherAgentsBlocksCullingNorRegionsShowWithTheCpu) {
  CheckRandomRequests("cpu", /*with_other_blocks=*/true);
}

TEST_F(EffectsTest, NeitherAgentsCullingNorRegionsShowWithOpenGl) {
  CheckRandomRequests("egl", /*with_other_blocks=*/false);
}

// White noise: more meshes than an agent with the least limit keeps, so that it shades while other
// threads draw. Many threads need a larger limit.
TEST_F(EffectsTest, NeitherThreadsNorTheLeastMemoryLimitShow) {
  testing::TestVolume volume;
  volume.geometry.sample_dims = {kNoiseSide, kNoiseSide, kNoiseSide};
  volume.samples = testing::SampleNoise(1, volume.geometry.sample_dims, volume.type, 4);
  const std::string dataset = shared_->Sub("noise");
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(volume, dataset, 1, 16));
  v1::RenderIsosurfaceRequest request = testing::SmallRequest();
  request.set_isovalue(2.5);
  request.set_culling(v1::CULLING_NONE);
  request.set_with_trace(true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::int64_t least, LeastLimitMibOfAgent(dataset, "cpu"));
  std::string expected;
  for (const int thread_count : testing::kThreadCounts) {
    SCOPED_TRACE(absl::StrCat(thread_count, " threads"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const std::unique_ptr<Cluster> cluster, StartCluster(dataset, 1, "cpu", [&] {
          std::vector<std::string> flags{"--threads", absl::StrCat(thread_count)};
          if (!expected.empty()) {
            flags.insert(flags.end(),
                         {"--memory-limit", absl::StrCat(LimitMibFor(thread_count, least), "MiB")});
          }
          return flags;
        }));
    std::set<std::string> workers;
    // A thread may come late. The number of frames has a bound.
    for (int i = 0; i < 2 || (static_cast<int>(workers.size()) < thread_count - 1 && i < 300);
         ++i) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response,
                                    Render(*cluster, request));
      if (expected.empty()) {
        expected = response.png();
      }
      ASSERT_TRUE(response.png() == expected) << "frame " << i;
      ASSERT_EQ(response.trace().processes_size(), 2);
      for (const v1::TraceTrack& track : response.trace().processes(1).tracks()) {
        if (absl::StartsWith(track.name(), "worker ")) {
          workers.insert(track.name());
        }
      }
    }
    // The thread of the frame is one.
    EXPECT_EQ(static_cast<int>(workers.size()), thread_count - 1);
  }
}

TEST_F(EffectsTest, PlanesAndPicksAreThoseOfOneSampleWithoutEffects) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> cluster, StartCluster(3, "cpu"));
  const auto stub =
      v1::IsosurfaceService::NewStub(rpc::MakeFreshChannel(cluster->coordinator.address));
  for (std::uint64_t seed = 100; seed < 112; ++seed) {
    v1::RenderIsosurfaceRequest request = RandomRequest(seed);
    SCOPED_TRACE(request.ShortDebugString());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse alone,
                                  Render(*cluster, request));
    request.mutable_output()->set_depth(true);
    request.mutable_output()->set_surface_index(true);
    request.mutable_output()->set_position(true);
    request.mutable_output()->set_normal(seed % 2 == 0);
    if (seed % 3 == 0) {
      request.mutable_region()->set_x(20);
      request.mutable_region()->set_y(10);
      request.mutable_region()->set_width_px(70);
      request.mutable_region()->set_height_px(60);
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response,
                                  Render(*cluster, request));
    if (seed % 3 != 0) {
      EXPECT_TRUE(response.png() == alone.png());
    }
    v1::RenderIsosurfaceRequest plain = request;
    plain.clear_samples();
    plain.clear_ambient_occlusion();
    plain.clear_silhouette();
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse expected,
                                  Render(*cluster, plain));
    EXPECT_FALSE(response.png() == expected.png());
    EXPECT_TRUE(response.depth() == expected.depth());
    EXPECT_TRUE(response.surface_index() == expected.surface_index());
    EXPECT_TRUE(response.position() == expected.position());
    EXPECT_TRUE(response.normal() == expected.normal());

    std::string points[2];
    for (int i = 0; i < 2; ++i) {
      v1::PickSurfaceRequest pick;
      *pick.mutable_frame() = i == 0 ? request : plain;
      pick.mutable_frame()->clear_region();
      pick.mutable_frame()->clear_output();
      for (int x = 30; x < 100; x += 7) {
        v1::Pixel* const pixel = pick.add_pixels();
        pixel->set_x(x);
        pixel->set_y(x / 2 + 10);
      }
      grpc::ClientContext context;
      context.set_deadline(base::MonotonicNow() + testing::kPatience);
      v1::PickSurfaceResponse picked;
      ISOSCOPE_ASSERT_OK(rpc::ToAbslStatus(stub->PickSurface(&context, pick, &picked)));
      picked.clear_statistics();
      points[i] = picked.SerializeAsString();
    }
    EXPECT_TRUE(points[0] == points[1]);
  }
}

// The mean of the picture of four times as many pixels, which the product can draw too.
TEST_F(EffectsTest, APixelIsTheMeanOfTheSamplesOfALargerPicture) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> cluster, StartCluster(1, "cpu"));
  v1::RenderIsosurfaceRequest request = testing::SmallRequest();
  request.mutable_background_color()->set_alpha(1);
  request.mutable_background_color()->set_blue(1);
  request.set_samples(4);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage picture, RenderImage(*cluster, request));
  request.clear_samples();
  request.mutable_viewport()->set_width_px(2 * picture.width);
  request.mutable_viewport()->set_height_px(2 * picture.height);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage large, RenderImage(*cluster, request));
  const auto light = [](std::uint8_t value) {
    const double srgb = value / 255.0;
    return srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
  };
  int mixed_count = 0;
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      double sum = 0;
      bool is_mixed = false;
      const auto at = [&](int dx, int dy) {
        return large.pixels[static_cast<std::size_t>((2 * y + dy) * large.width + 2 * x + dx)];
      };
      for (const auto& [dx, dy] : {std::pair(0, 0), {1, 0}, {0, 1}, {1, 1}}) {
        sum += light(at(dx, dy).r) / 4;
        is_mixed = is_mixed || at(dx, dy) != at(0, 0);
      }
      mixed_count += is_mixed ? 1 : 0;
      const double srgb = sum <= 0.0031308 ? 12.92 * sum : 1.055 * std::pow(sum, 1 / 2.4) - 0.055;
      ASSERT_NEAR(picture.pixels[static_cast<std::size_t>(y * picture.width + x)].r, 255 * srgb,
                  0.6)
          << x << ", " << y;
    }
  }
  EXPECT_GT(mixed_count, 100);
}

TEST_F(EffectsTest, HostileValuesAreNamedWithTheirRange) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> cluster, StartCluster(1, "cpu"));
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  constexpr double kMaxInt = std::numeric_limits<std::int32_t>::max();
  constexpr double kMinInt = std::numeric_limits<std::int32_t>::min();
  using Request = v1::RenderIsosurfaceRequest;
  struct Case {
    const char* field;
    const char* range;
    std::function<void(Request*, double)> set;
    std::vector<double> values;
  };
  const std::vector<Case> cases{
      {"samples",
       "1, 4, 9 or 16",
       [](Request* r, double v) { r->set_samples(static_cast<std::int32_t>(v)); },
       {-1, 2, 3, 15, 17, 64, kMaxInt, kMinInt}},
      {"ambient_occlusion.radius_px",
       "[4, 56]",
       [](Request* r, double v) {
         r->mutable_ambient_occlusion()->set_radius_px(static_cast<std::int32_t>(v));
       },
       {-1, 1, 3, 57, kMaxInt, kMinInt}},
      {"ambient_occlusion.strength",
       "[0, 1]",
       [](Request* r, double v) {
         r->mutable_ambient_occlusion()->set_strength(static_cast<float>(v));
       },
       {kNan, -0.01, 1.01, kInfinity, -kInfinity}},
      {"silhouette.width_px",
       "[1, 16]",
       [](Request* r, double v) {
         r->mutable_silhouette()->set_width_px(static_cast<std::int32_t>(v));
       },
       {-1, 17, kMaxInt, kMinInt}},
      {"silhouette.color.alpha",
       "1",
       [](Request* r, double v) {
         r->mutable_silhouette()->mutable_color()->set_alpha(static_cast<float>(v));
       },
       {kNan, 0, 0.5, 2}},
      {"silhouette.color.blue",
       "1",
       [](Request* r, double v) {
         r->mutable_silhouette()->mutable_color()->set_alpha(1);
         r->mutable_silhouette()->mutable_color()->set_blue(static_cast<float>(v));
       },
       {kNan, -1, 2, kInfinity}},
  };
  for (const Case& wrong : cases) {
    for (const double value : wrong.values) {
      Request request = testing::SmallRequest();
      wrong.set(&request, value);
      EXPECT_THAT(Render(*cluster, request),
                  StatusIs(absl::StatusCode::kInvalidArgument,
                           AllOf(HasSubstr(wrong.field), HasSubstr(wrong.range))))
          << value;
    }
  }
  ISOSCOPE_EXPECT_OK(Render(*cluster, testing::SmallRequest()));
}

TEST_F(EffectsTest, WhatCanNotBeDrawnIsRefusedWithItsNumbers) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Cluster> cluster, StartCluster(1, "egl"));
  v1::RenderIsosurfaceRequest request = testing::SmallRequest();
  request.set_samples(16);
  request.mutable_viewport()->set_width_px(4097);
  request.set_culling(v1::CULLING_MASK);
  EXPECT_THAT(Render(*cluster, request),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("samples is 16"), HasSubstr("4097"))));
  request.clear_culling();
  // OpenGL takes memory for the whole viewport, with its samples, also for a band or a region.
  EXPECT_THAT(Render(*cluster, request),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("4097"), HasSubstr("samples 16"), HasSubstr("16388"))));
  request.mutable_region()->set_width_px(10);
  request.mutable_region()->set_height_px(10);
  EXPECT_THAT(Render(*cluster, request),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("4097"), HasSubstr("samples 16"), HasSubstr("16388"))));
}

TEST_F(EffectsTest, TheCommandLineDrawsRepeatsAndCutsPictures) {
  const std::string picture = shared_->Sub("effects.png");
  const std::vector<std::string> drawing{
      "render",   Dataset(1), "--isovalue",          "128",    "--width",      "200",
      "--height", "150",      "--renderer",          "cpu",    "--samples",    "4",
      "--output", picture,    "--ambient-occlusion", "20,0.5", "--silhouette", "2:1,0,0"};
  const testing::CommandResult made = testing::RunIsoscope(drawing);
  ASSERT_EQ(made.exit_code, 0) << made.err;
  const testing::CommandResult like =
      testing::RunIsoscope({"render", Dataset(1), "--renderer", "cpu", "--like", picture,
                            "--output", shared_->Sub("again.png")});
  ASSERT_EQ(like.exit_code, 0) << like.err;
  EXPECT_THAT(like.out, HasSubstr("byte for byte"));
  const testing::CommandResult wrong =
      testing::RunIsoscope({"render", Dataset(1), "--renderer", "cpu", "--like", picture,
                            "--output", shared_->Sub("again.png"), "--silhouette"});
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_THAT(wrong.err, HasSubstr("--silhouette"));
}

}  // namespace
}  // namespace isoscope
