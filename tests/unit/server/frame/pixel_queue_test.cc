// Pixels that arrive in several orders, in arenas of one thread and of several.

#include "server/frame/pixel_queue.h"

#include <atomic>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/task_arena.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/server/frame/frame_pieces.h"

namespace isoscope::server {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

// Enough images, of 20 tiles each, that threads of the arena help.
constexpr std::size_t kImageCount = 150;

// One frame's queue, and the reduction that it fills.
class Frame {
 public:
  Frame(int thread_count, const frame::FrameSpec& spec)
      : spec_(spec),
        arena_(thread_count),
        reduction_({.spec = &spec_,
                    .view = &view_,
                    .layout = &layout_,
                    .active = nullptr,
                    .images = images_.get(),
                    .arena = &arena_},
                   /*part_count=*/3, image::FrameImage(kWidth, kHeight)),
        queue_(std::in_place, &reduction_, &arena_, [this] { ++damage_count_; }) {}

  void Push(AttemptId from, image::FrameImage image, image::LayerStack layers = {}) {
    queue_->Push(from,
                 image::DrawnPixels{
                     .image = std::move(image), .layers = std::move(layers), .memory = nullptr});
  }
  void Push(AttemptId from, std::vector<std::string> bands, ReadGate* gate = nullptr) {
    std::shared_ptr<const ReadGate::Hold> hold;
    if (gate != nullptr) {
      hold = std::make_shared<const ReadGate::Hold>(gate->Add(1));
    }
    queue_->Push(from, Bands{.bands = std::move(bands), .hold = std::move(hold)});
  }
  ReducedFrame Take() {
    EXPECT_TRUE(queue_->Finish().empty());
    return reduction_.Take();
  }
  [[nodiscard]] PixelQueue& queue() { return *queue_; }
  [[nodiscard]] Reduction& reduction() { return reduction_; }
  [[nodiscard]] int damage_count() const { return damage_count_; }
  void EndQueue() { queue_.reset(); }

 private:
  const frame::FrameSpec spec_;
  const view::View view_ = MakeView();
  const volume::BlockLayout layout_ = *volume::BlockLayout::Make(kDims, {4, 4, 4});
  const std::shared_ptr<image::FrameImagePool> images_ = image::FrameImagePool::Make(1 << 20);
  base::TaskArena arena_;
  Reduction reduction_;
  std::atomic<int> damage_count_{0};
  std::optional<PixelQueue> queue_;
};

class PixelQueueTest : public ::testing::TestWithParam<int> {
 protected:
  PixelQueueTest() { spec_.surfaces.resize(1); }

  // Returns the picture of all images by the rule of fragments alone.
  static image::FrameImage Expected(const std::vector<image::FrameImage>& images) {
    const image::FragmentOrder order{.block_count = kBlockCount};
    image::FrameImage expected(kWidth, kHeight);
    for (const image::FrameImage& image : images) {
      for (std::size_t i = 0; i < expected.keys.size(); ++i) {
        order.KeepFirst(image.keys[i], image.colors[i], &expected.keys[i], &expected.colors[i]);
      }
    }
    return expected;
  }

  frame::FrameSpec spec_;
};
INSTANTIATE_TEST_SUITE_P(Threads, PixelQueueTest, ::testing::Values(1, 8));

TEST_P(PixelQueueTest, TheFirstImageBecomesTheResult) {
  Frame frame(GetParam(), spec_);
  image::FrameImage image = RandomImage(1, 0.5);
  const image::FrameImage copy = image;
  const auto* const keys = image.keys.data();
  frame.Push({0, 0}, std::move(image));
  EXPECT_TRUE(frame.queue().empty()) << "nothing is left to do";
  const ReducedFrame reduced = frame.Take();
  EXPECT_EQ(reduced.image.keys.data(), keys) << "it is not copied";
  EXPECT_TRUE(reduced.image == copy);
}

TEST_P(PixelQueueTest, AnImageAfterABandIsCompositedIntoIt) {
  Frame frame(GetParam(), spec_);
  const std::vector<image::FrameImage> images = {RandomImage(1, 0.5), RandomImage(2, 0.5)};
  frame.Push({0, 0}, composite::EncodePixels(images[0]));
  frame.Push({1, 0}, images[1]);
  EXPECT_FALSE(frame.queue().empty());
  EXPECT_TRUE(frame.Take().image == Expected(images));
}

TEST_P(PixelQueueTest, EachOrderOfArrivalGivesTheSamePicture) {
  std::vector<image::FrameImage> images;
  for (std::size_t i = 0; i < kImageCount; ++i) {
    images.push_back(RandomImage(i, 0.05));
  }
  const image::FrameImage expected = Expected(images);
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U}) {
    for (const bool are_encoded : {false, true}) {
      Frame frame(GetParam(), spec_);
      std::vector<std::size_t> order(images.size());
      for (std::size_t i = 0; i < order.size(); ++i) {
        order[i] = i;
        std::swap(order[i], order[static_cast<std::size_t>(base::RandomUnit(seed, i) *
                                                           static_cast<double>(i + 1))]);
      }
      for (const std::size_t i : order) {
        if (are_encoded || i % 3 == 0) {
          frame.Push({i, 0}, ShuffledBands(images[i], seed));
        } else {
          frame.Push({i, 0}, images[i]);
        }
        if (i % 7 == 0) {
          frame.queue().CompositeOne();
        }
      }
      EXPECT_TRUE(frame.Take().image == expected) << seed << " " << are_encoded;
    }
  }
}

// The opaque image of the first arrival is adopted, and its layers are composited.
TEST_P(PixelQueueTest, LayersOfEachArrivalAreComposited) {
  spec_.surfaces[0].opacity = 0.5F;
  const image::FragmentOrder order{.block_count = kBlockCount};
  const auto pool = image::FrameImagePool::Make(1 << 20);
  const auto make = [&] {
    return image::LayerStack(kWidth, kHeight, spec_.max_layers + 1, order, pool.get());
  };
  Frame frame(GetParam(), spec_);
  image::LayerStack expected = make();
  for (const std::size_t part : {0U, 1U, 2U}) {
    image::LayerStack layers = make();
    for (int x = 0; x < kWidth; ++x) {
      const std::uint64_t key =
          image::FragmentKey(static_cast<float>((part * 7 + static_cast<std::size_t>(x)) % 5) / 8,
                             static_cast<std::uint32_t>(part));
      const image::Rgba8 color{static_cast<std::uint8_t>(part), 1, 2, 128};
      layers.Insert(x, static_cast<int>(part), key, color);
      layers.Insert(x, 20, key, color);
      expected.Insert(x, static_cast<int>(part), key, color);
      expected.Insert(x, 20, key, color);
    }
    image::FrameImage image(kWidth, kHeight);
    frame.Push({part, 0}, std::move(image), std::move(layers));
  }
  EXPECT_TRUE(frame.Take().layers == expected);
}

TEST_P(PixelQueueTest, ItIsEmptyOnceEachArrivalIsComposited) {
  Frame frame(GetParam(), spec_);
  EXPECT_TRUE(frame.queue().empty());
  frame.queue().CompositeOne();
  const std::vector<std::string> bands = ShuffledBands(RandomImage(1, 0.5), 1);
  ASSERT_GT(bands.size(), 3U);
  frame.Push({0, 0}, bands);
  for (std::size_t i = 0; i < bands.size(); ++i) {
    EXPECT_FALSE(frame.queue().empty()) << i;
    frame.queue().CompositeOne();
  }
  EXPECT_TRUE(frame.queue().empty());
  EXPECT_TRUE(frame.Take().image == RandomImage(1, 0.5));
}

TEST_P(PixelQueueTest, DamagedBandsAreReportedWithTheirSendersAndChangeNothing) {
  Frame frame(GetParam(), spec_);
  std::vector<image::FrameImage> images;
  const std::vector<AttemptId> damaged = {{3, 1}, {40, 0}, {99, 0}};
  for (std::size_t i = 0; i < kImageCount; ++i) {
    images.push_back(RandomImage(i, 0.05));
    frame.Push({i, 0}, ShuffledBands(images.back(), i));
    for (const AttemptId from : damaged) {
      if (from.part == i) {
        std::string band = composite::EncodePixels(Wall()).front();
        band[band.size() / 2] = static_cast<char>(band[band.size() / 2] ^ 1);
        frame.Push(from, {band});
      }
    }
  }
  const std::vector<AgentEvent> damages = frame.queue().Finish();
  EXPECT_EQ(frame.damage_count(), 3);
  std::vector<AttemptId> senders;
  for (const AgentEvent& damage : damages) {
    senders.push_back(damage.from);
    EXPECT_EQ(damage.word, AgentWord::kDamaged);
    EXPECT_THAT(damage.status, StatusIs(absl::StatusCode::kDataLoss, HasSubstr("pixels: ")));
  }
  EXPECT_THAT(senders, ::testing::UnorderedElementsAreArray(damaged));
  EXPECT_TRUE(frame.Take().image == Expected(images)) << "and each is reported once";
}

TEST_P(PixelQueueTest, ArrivalsHoldTheGateUntilTheyAreComposited) {
  Frame frame(GetParam(), spec_);
  ReadGate gate(0);
  frame.Push({0, 0}, {composite::EncodePixels(Wall()).front()}, &gate);
  int reads = 0;
  gate.WhenRoom([&] { ++reads; });
  EXPECT_EQ(reads, 0);
  frame.queue().CompositeOne();
  EXPECT_EQ(reads, 1);
}

// Few pixels wait for the frame's thread. Of many, threads of the arena may composite some.
TEST_P(PixelQueueTest, AnAbandonedQueueDropsItsPixelsAndTheirHolds) {
  struct Case {
    const char* name;
    std::size_t image_count;
    void (*end)(Frame* frame);
  };
  const auto abandon = [](Frame* frame) { frame->queue().Abandon(); };
  const auto destroy = [](Frame* frame) { frame->EndQueue(); };
  for (const Case& c : std::vector<Case>{{"few abandoned", 3, abandon},
                                         {"few destroyed", 3, destroy},
                                         {"many abandoned", kImageCount, abandon},
                                         {"many destroyed", kImageCount, destroy}}) {
    Frame frame(GetParam(), spec_);
    ReadGate gate(0);
    for (std::size_t i = 0; i < c.image_count; ++i) {
      frame.Push({i, 0}, ShuffledBands(RandomImage(i, 0.5), i), &gate);
    }
    int reads = 0;
    gate.WhenRoom([&] { ++reads; });
    c.end(&frame);
    EXPECT_EQ(reads, 1) << c.name;
    if (c.image_count == 3) {
      EXPECT_TRUE(frame.reduction().Take().image == image::FrameImage(kWidth, kHeight)) << c.name;
    }
  }
}

}  // namespace
}  // namespace isoscope::server
