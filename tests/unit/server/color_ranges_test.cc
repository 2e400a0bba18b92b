// Ranges of colour maps that the coordinator finds, with agents of a script that show one pixel each.

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/mutex.h"
#include "core/composite/pixel_codec.h"
#include "core/image/frame_image.h"
#include "tests/unit/server/fake_cluster.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;
namespace v1 = isoscope::v1;

using ::testing::AllOf;
using testing::FakeAgent;
using ::testing::HasSubstr;
using testing::StatusIs;

constexpr int kWidth = 200;
constexpr int kHeight = 180;

// A pixel of the picture.
struct Shown {
  int x = 0;
  int y = 0;
  std::uint32_t owner = 0;
};

class ColorRangesTest : public testing::TwoAgentsTest {
 protected:
  ColorRangesTest() {
    first_.on_frame = [this](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
      return Play({.x = 100, .y = 90, .owner = 0}, nullptr, stream);
    };
    second_.on_frame = [this](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
      return Play({.x = 10, .y = 10, .owner = 7}, &drawn_by_second_, stream);
    };
    for (FakeAgent* const agent : {&first_, &second_}) {
      agent->on_active_box = [](const internal::GetActiveBoxRequest&,
                                internal::GetActiveBoxResponse* response) {
        response->set_active_block_count(2);
        response->mutable_begin_cell();
        v1::Dimensions& end = *response->mutable_end_cell();
        end.set_x(8);
        end.set_y(8);
        end.set_z(8);
        return grpc::Status::OK;
      };
    }
  }

  // The colour is the position.
  static v1::RenderIsosurfaceRequest Request(v1::ColorRange::Source source) {
    v1::RenderIsosurfaceRequest request = testing::FrameRequest(kWidth, kHeight);
    request.clear_isovalue();
    request.set_culling(v1::CULLING_NONE);
    v1::Surface& surface = *request.add_surfaces();
    surface.set_isovalue(100);
    surface.mutable_color_by()->set_quantity(v1::ColorBy::QUANTITY_POSITION_X);
    surface.mutable_color_by()->set_color_map(v1::COLOR_MAP_VIRIDIS);
    if (source != v1::ColorRange::SOURCE_UNSPECIFIED) {
      surface.mutable_color_by()->mutable_range()->set_source(source);
    }
    return request;
  }

  // Draws windows of at most most_pixels_. An agent that counts its drawings is lost at lost_at_.
  grpc::Status Play(const Shown& shown, std::atomic<int>* drawn, FakeAgent::FrameStream* stream) {
    internal::RenderFrameRequest request;
    stream->Read(&request);
    if (!request.begin().has_frame()) {
      return grpc::Status::OK;  // no drawing: it hears that none follows
    }
    const internal::FrameSpec& frame = request.begin().frame();
    v1::Region window = frame.region();
    if (!frame.has_region()) {
      window.set_width_px(frame.viewport().width_px());
      window.set_height_px(frame.viewport().height_px());
    }
    if (window.width_px() * window.height_px() > most_pixels_) {
      return {grpc::StatusCode::RESOURCE_EXHAUSTED, "raise --memory-limit to 99MiB"};
    }
    if (drawn != nullptr && ++*drawn >= lost_at_) {
      return {grpc::StatusCode::UNAVAILABLE, "the agent is lost"};
    }
    {
      const base::MutexLock lock(&mutex_);
      frames_drawn_.push_back(frame);
    }
    image::FrameImage image(window.width_px(), window.height_px());
    const int scale = frame.viewport().width_px() / kWidth;
    const int x = scale * shown.x - window.x();
    const int y = scale * shown.y - window.y();
    if (x >= 0 && x < image.width && y >= 0 && y < image.height) {
      image.Set(x, y, image::FragmentKey(0.5F, shown.owner), {0, 0, 64, 0});
    }
    internal::RenderFrameResponse response;
    for (std::string& band : composite::EncodePixels(image)) {
      response.add_bands(std::move(band));
    }
    response.mutable_frame_done();
    stream->Write(response);
    return grpc::Status::OK;
  }

  std::atomic<int> most_pixels_{std::numeric_limits<int>::max()};
  std::atomic<int> drawn_by_second_{0};
  std::atomic<int> lost_at_{std::numeric_limits<int>::max()};
  base::Mutex mutex_;
  std::vector<internal::FrameSpec> frames_drawn_ ABSL_GUARDED_BY(mutex_);
};

// Symptom: a range had values of a part that was lost between two bands, or after them, and that the
// picture did not show.
TEST_F(ColorRangesTest, ARangeOfWhatIsVisibleIsThatOfThePartsInThePicture) {
  most_pixels_ = 5000;
  const Running running = Start();
  v1::RenderIsosurfaceRequest request = Request(v1::ColorRange::SOURCE_VISIBLE);
  request.set_allow_partial(true);
  // Bands that were drawn before others were refused are drawn again: only the first frame has those.
  ISOSCOPE_ASSERT_OK(Render(request));
  drawn_by_second_ = 0;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse whole, Render(request));
  EXPECT_GT(whole.statistics().band_count(), 4);
  EXPECT_EQ(whole.statistics().missing_shards_size(), 0);
  const int drawing_count = drawn_by_second_;
  ASSERT_GT(drawing_count, whole.statistics().band_count()) << "values, and the picture";
  const auto range_of = [](const v1::RenderIsosurfaceResponse& response) {
    return response.colorings(0).color_by().range().DebugString();
  };
  std::string partial_range;
  std::string partial_png;
  for (int lost_at = 1; lost_at <= drawing_count; ++lost_at) {
    drawn_by_second_ = 0;
    lost_at_ = lost_at;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse partial, Render(request));
    ASSERT_EQ(partial.statistics().missing_shards_size(), 1) << lost_at;
    ASSERT_EQ(drawn_by_second_, lost_at) << "not before";
    if (lost_at == 1) {
      partial_range = range_of(partial);
      partial_png = partial.png();
      EXPECT_NE(partial_range, range_of(whole));
    }
    EXPECT_EQ(range_of(partial), partial_range) << "lost at drawing " << lost_at;
    EXPECT_TRUE(partial.png() == partial_png) << lost_at;
  }
}

// Symptom: the bands for what is visible were those of 16 samples, though one is drawn.
TEST_F(ColorRangesTest, WhatIsVisibleIsFoundInBandsOfOneSample) {
  most_pixels_ = 2 * kWidth * kHeight;
  const Running running = Start();
  v1::RenderIsosurfaceRequest request = Request(v1::ColorRange::SOURCE_VISIBLE);
  request.set_samples(16);
  for (int i = 0; i < 2; ++i) {  // the second one knows what agents have room for
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(request));
    EXPECT_GE(response.statistics().band_count(), 16 / 2);
    const base::MutexLock lock(&mutex_);
    const auto of_values = std::count_if(
        frames_drawn_.begin(), frames_drawn_.end(),
        [](const internal::FrameSpec& frame) { return frame.viewport().width_px() == kWidth; });
    EXPECT_EQ(of_values, 2) << "one for each agent";
    frames_drawn_.clear();
  }
}

// Symptom: agents got SOURCE_STEP for a position, and found the numbers themselves.
TEST_F(ColorRangesTest, AgentsGetNumbersForPositions) {
  const Running running = Start();
  for (const v1::ColorRange::Source source :
       {v1::ColorRange::SOURCE_UNSPECIFIED, v1::ColorRange::SOURCE_STEP,
        v1::ColorRange::SOURCE_VISIBLE}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response,
                                  Render(Request(source)));
    const v1::ColorRange& answered = response.colorings(0).color_by().range();
    const base::MutexLock lock(&mutex_);
    for (const internal::FrameSpec& frame : frames_drawn_) {
      const v1::ColorRange& got = frame.surfaces(0).color_by().range();
      EXPECT_EQ(got.source(), v1::ColorRange::SOURCE_UNSPECIFIED);
      EXPECT_LT(got.min(), got.max());
    }
    EXPECT_EQ(frames_drawn_.back().surfaces(0).color_by().range().SerializeAsString(),
              answered.SerializeAsString());
    EXPECT_EQ(answered.max() == 8, source != v1::ColorRange::SOURCE_VISIBLE) << answered.max();
    frames_drawn_.clear();
  }
}

// Symptom: the advice was the agent's, to ask for a smaller viewport, which needs as much.
TEST_F(ColorRangesTest, ASmallestBandThatIsRefusedSaysWhatMakesItLarge) {
  most_pixels_ = 10000;
  const Running running = Start();
  v1::RenderIsosurfaceRequest request = Request(v1::ColorRange::SOURCE_UNSPECIFIED);
  ISOSCOPE_EXPECT_OK(Render(request));
  request.set_samples(16);
  request.mutable_ambient_occlusion()->set_radius_px(56);
  for (const int times : {1, 3}) {
    request.mutable_viewport()->set_width_px(times * kWidth);
    request.mutable_viewport()->set_height_px(times * kHeight);
    EXPECT_THAT(Render(request),
                StatusIs(absl::StatusCode::kResourceExhausted,
                         AllOf(HasSubstr("to 99MiB"),
                               HasSubstr(times == 1 ? "bands of it are no help"
                                                    : "that was the smallest band"),
                               HasSubstr("16 samples and 64 pixels around it for effects: ask for "
                                         "fewer samples, for a smaller ambient_occlusion"))));
  }
}

}  // namespace
}  // namespace isoscope::server
