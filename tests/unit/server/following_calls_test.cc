// What agents of a script hear about the calls of a frame: each but the last says that others follow,
// and if none does after all, the coordinator says so. Breaks if a drawing predicts wrongly whether
// another one follows, or if a frame ends without a word to agents that wait.

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/mutex.h"
#include "tests/unit/server/fake_cluster.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;
namespace v1 = isoscope::v1;

using testing::FakeAgent;
using ::testing::HasSubstr;
using testing::StatusIs;
using testing::WaitFor;

constexpr int kWidth = 200;
constexpr int kHeight = 180;
constexpr int kPixelsOfBands = 5000;

// The calls of one frame on one agent that went well, and the words that none follows.
struct Heard {
  std::int64_t frame_number = -1;
  std::vector<bool> others_follow = {};
  int end_count = 0;
};

class FollowingCallsTest : public testing::TwoAgentsTest {
 protected:
  FollowingCallsTest() {
    first_.on_frame = [this](grpc::ServerContext* context, FakeAgent::FrameStream* stream) {
      return Play(0, context, stream);
    };
    second_.on_frame = [this](grpc::ServerContext* context, FakeAgent::FrameStream* stream) {
      return Play(1, context, stream);
    };
    first_.on_frame_end = [this](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
      return PlayEnd(0, stream);
    };
    second_.on_frame_end = [this](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
      return PlayEnd(1, stream);
    };
  }

  static v1::RenderIsosurfaceRequest Request() {
    v1::RenderIsosurfaceRequest request = testing::FrameRequest(kWidth, kHeight);
    request.clear_isovalue();
    request.set_culling(v1::CULLING_NONE);
    request.add_surfaces()->set_isovalue(100);
    return request;
  }

  // Draws windows of at most most_pixels_, which are empty.
  grpc::Status Play(std::size_t agent, grpc::ServerContext* context,
                    FakeAgent::FrameStream* stream) {
    internal::RenderFrameRequest request;
    if (!stream->Read(&request)) {
      return grpc::Status::CANCELLED;
    }
    const internal::BeginFrame& begin = request.begin();
    const v1::Region& window = begin.frame().region();
    const v1::Viewport& viewport = begin.frame().viewport();
    const int pixels = begin.frame().has_region() ? window.width_px() * window.height_px()
                                                  : viewport.width_px() * viewport.height_px();
    if (pixels > most_pixels_) {
      return {grpc::StatusCode::RESOURCE_EXHAUSTED, "raise --memory-limit to 99MiB"};
    }
    if (agent == 1) {
      if (const grpc::Status status = on_second_(context); !status.ok()) {
        return status;
      }
    }
    {
      const base::MutexLock lock(&mutex_);
      Of(agent, begin.frame_number()).others_follow.push_back(begin.others_follow());
    }
    internal::RenderFrameResponse response;
    response.mutable_frame_done();
    stream->Write(response);
    return grpc::Status::OK;
  }

  grpc::Status PlayEnd(std::size_t agent, FakeAgent::FrameStream* stream) {
    internal::RenderFrameRequest request;
    stream->Read(&request);
    EXPECT_TRUE(request.begin().shard_indices().empty());
    const base::MutexLock lock(&mutex_);
    ++Of(agent, request.begin().frame_number()).end_count;
    return grpc::Status::OK;
  }

  Heard& Of(std::size_t agent, std::int64_t frame_number) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    for (Heard& heard : heard_[agent]) {
      if (heard.frame_number == frame_number) {
        return heard;
      }
    }
    return heard_[agent].emplace_back(Heard{.frame_number = frame_number});
  }
  // Of the last frame that the agent heard of.
  Heard Last(std::size_t agent) {
    const base::MutexLock lock(&mutex_);
    return heard_[agent].empty() ? Heard() : heard_[agent].back();
  }

  // Every call of the last frame but the last says that others follow.
  void ExpectExact(std::size_t agent) {
    const Heard heard = Last(agent);
    ASSERT_FALSE(heard.others_follow.empty());
    std::vector<bool> exact(heard.others_follow.size(), true);
    exact.back() = false;
    EXPECT_EQ(heard.others_follow, exact) << "agent " << agent;
  }
  // Waits until the agent knows that nothing follows.
  void ExpectThatItKnows(std::size_t agent) {
    EXPECT_TRUE(WaitFor([&] {
      const Heard heard = Last(agent);
      return !heard.others_follow.empty() && (!heard.others_follow.back() || heard.end_count == 1);
    })) << "agent "
        << agent << " waits for a call that never comes";
  }

  std::atomic<int> most_pixels_{std::numeric_limits<int>::max()};
  // Before the second agent draws.
  std::function<grpc::Status(grpc::ServerContext*)> on_second_ = [](grpc::ServerContext*) {
    return grpc::Status::OK;
  };
  base::Mutex mutex_;
  std::array<std::vector<Heard>, 2> heard_ ABSL_GUARDED_BY(mutex_);
};

// What a request may have, each of which changes how often a frame is drawn.
struct Options {
  bool has_picture = true;
  bool depth = false;
  bool normal = false;
  int samples = 1;
  bool has_light = false;
  v1::ColorBy::Quantity color_by = v1::ColorBy::QUANTITY_UNSPECIFIED;
  bool is_visible_range = false;
  bool has_region = false;
};

std::string TextOf(const Options& options) {
  return absl::StrCat("picture ", options.has_picture, ", depth ", options.depth, ", normal ",
                      options.normal, ", samples ", options.samples, ", light ", options.has_light,
                      ", colour by ", options.color_by, ", range of what is visible ",
                      options.is_visible_range, ", region ", options.has_region);
}

std::vector<Options> AllOptions() {
  std::vector<Options> all;
  for (int bits = 0; bits < 64; ++bits) {
    const auto has = [bits](int bit) { return (bits >> bit & 1) != 0; };
    Options options{.has_picture = has(0),
                    .depth = has(1),
                    .normal = has(2),
                    .samples = has(3) ? 4 : 1,
                    .has_light = has(4),
                    .has_region = has(5)};
    if (!options.has_picture && !options.depth && !options.normal) {
      continue;
    }
    all.push_back(options);
    if (options.has_light) {
      for (const v1::ColorBy::Quantity quantity :
           {v1::ColorBy::QUANTITY_NORMAL, v1::ColorBy::QUANTITY_POSITION_X}) {
        options.color_by = quantity;
        options.is_visible_range =
            quantity == v1::ColorBy::QUANTITY_POSITION_X && !options.has_region;
        all.push_back(options);
      }
    }
  }
  return all;
}

v1::RenderIsosurfaceRequest With(const Options& options, v1::RenderIsosurfaceRequest request) {
  v1::OutputOptions& output = *request.mutable_output();
  output.set_image_format(options.has_picture ? v1::OutputOptions::IMAGE_FORMAT_PNG
                                              : v1::OutputOptions::IMAGE_FORMAT_NONE);
  output.set_depth(options.depth);
  output.set_normal(options.normal);
  request.set_samples(options.samples);
  if (options.has_light) {
    request.add_lights()->mutable_direction()->set_x(1);
  }
  if (options.color_by != v1::ColorBy::QUANTITY_UNSPECIFIED) {
    v1::ColorBy& color_by = *request.mutable_surfaces(0)->mutable_color_by();
    color_by.set_quantity(options.color_by);
    if (options.is_visible_range) {
      color_by.set_color_map(v1::COLOR_MAP_VIRIDIS);
      color_by.mutable_range()->set_source(v1::ColorRange::SOURCE_VISIBLE);
    }
  }
  if (options.has_region) {
    request.mutable_region()->set_x(10);
    request.mutable_region()->set_width_px(kWidth - 20);
    request.mutable_region()->set_height_px(kHeight);
  }
  return request;
}

// Symptom: the last band of a picture with lights and the plane of normals said that others follow.
// Agents that stopped waited for them.
TEST_F(FollowingCallsTest, OpaqueFramesSayExactlyWhetherOthersFollow) {
  const Running running = Start();
  for (const bool in_bands : {false, true}) {
    for (const Options& options : AllOptions()) {
      SCOPED_TRACE(absl::StrCat("in bands ", in_bands, ", ", TextOf(options)));
      most_pixels_ = in_bands ? options.samples * kPixelsOfBands : std::numeric_limits<int>::max();
      const v1::RenderIsosurfaceRequest request = With(options, Request());
      if (in_bands) {
        // What was drawn before others were refused is drawn again: only the first frame has those.
        ISOSCOPE_ASSERT_OK(Render(request));
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(request));
      EXPECT_EQ(response.statistics().band_count() > 1, in_bands);
      ExpectExact(0);
      ExpectExact(1);
    }
  }
}

// Layers have no normals. Whether one shows is known only when it is drawn: then nothing follows.
TEST_F(FollowingCallsTest, AgentsHearThatNoPlanesAreDrawnIfNoLayerShows) {
  const Running running = Start();
  Options options{.normal = true, .has_light = true};
  v1::RenderIsosurfaceRequest request = With(options, Request());
  request.mutable_surfaces(0)->mutable_color()->set_red(1);
  request.mutable_surfaces(0)->mutable_color()->set_alpha(0.5F);
  ISOSCOPE_ASSERT_OK(Render(request));
  for (const std::size_t agent : {0U, 1U}) {
    EXPECT_EQ(Last(agent).others_follow, std::vector<bool>{true});
    ExpectThatItKnows(agent);
  }
}

TEST_F(FollowingCallsTest, AgentsHearThatTheClientLeftBetweenTwoBands) {
  absl::Notification is_held;
  on_second_ = [&](grpc::ServerContext* context) {
    is_held.Notify();
    return testing::HangUntilCancelled(context);
  };
  most_pixels_ = kPixelsOfBands;
  const Running running = Start();
  grpc::ClientContext context;
  v1::RenderIsosurfaceResponse response;
  std::thread client([&] {
    const grpc::Status status = frames_->RenderIsosurface(&context, Request(), &response);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::CANCELLED);
  });
  is_held.WaitForNotification();
  EXPECT_TRUE(WaitFor([&] { return Last(0).others_follow.size() == 1; }));
  EXPECT_EQ(Last(0).others_follow, std::vector<bool>{true});
  EXPECT_EQ(Last(0).end_count, 0) << "the frame goes on";
  context.TryCancel();
  client.join();
  ExpectThatItKnows(0);
}

TEST_F(FollowingCallsTest, AgentsHearThatAnotherOneHasFailed) {
  on_second_ = [this](grpc::ServerContext*) {
    EXPECT_TRUE(WaitFor([&] { return !Last(0).others_follow.empty(); }));
    return grpc::Status(grpc::StatusCode::DATA_LOSS, "block 3 is damaged");
  };
  most_pixels_ = kPixelsOfBands;
  const Running running = Start();
  EXPECT_THAT(Render(Request()), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("block 3")));
  ExpectThatItKnows(0);
}

}  // namespace
}  // namespace isoscope::server
