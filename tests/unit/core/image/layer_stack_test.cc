#include "core/image/layer_stack.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::image {
namespace {

constexpr FragmentOrder kOrder{.block_count = 100, .ties = TieRule::kColor};

struct Layer {
  int x = 0;
  int y = 0;
  std::uint64_t key = 0;
  Rgba8 color;
};

// Few depths, surfaces and colours, so that all kinds of ties are common.
std::vector<Layer> RandomLayers(std::uint64_t seed, int count) {
  std::vector<Layer> layers;
  for (int i = 0; i < count; ++i) {
    const auto below = [&](std::uint64_t which, int end) {
      return static_cast<int>(end *
                              base::RandomUnit(seed, 8 * static_cast<std::uint64_t>(i) + which));
    };
    const auto surface = static_cast<std::uint32_t>(below(2, 3));
    const auto block = static_cast<std::uint32_t>(below(3, 5));
    layers.push_back(
        {below(0, 20), below(1, 20),
         FragmentKey(static_cast<float>(below(4, 6)) / 6, kOrder.OwnerOf(surface, block)),
         Rgba8{static_cast<std::uint8_t>(below(5, 3)), 0, 0, 255}});
  }
  return layers;
}

LayerStack StackOf(const std::vector<Layer>& layers, int max_layers, FrameImagePool* images) {
  LayerStack stack(20, 20, max_layers, kOrder, images);
  for (const Layer& layer : layers) {
    stack.Insert(layer.x, layer.y, layer.key, layer.color);
  }
  return stack;
}

TEST(LayerStackTest, KeepsTheFirstFragmentsOfEachPixelAsASortedListWould) {
  const auto images = FrameImagePool::Make(1 << 20);
  const std::vector<Layer> layers = RandomLayers(1, 4000);
  for (const int max_layers : {1, 3, 16}) {
    const LayerStack stack = StackOf(layers, max_layers, images.get());
    // By pixel: the winner for each (depth bits, surface).
    std::map<std::pair<int, int>, std::map<std::pair<std::uint64_t, std::uint32_t>, Layer>>
        expected;
    for (const Layer& layer : layers) {
      auto& pixel_layers = expected[{layer.y, layer.x}];
      const auto [kept, is_new] =
          pixel_layers.try_emplace({layer.key >> 32, kOrder.SurfaceOf(OwnerOf(layer.key))}, layer);
      if (!is_new &&
          kOrder.IsBefore(layer.key, layer.color, kept->second.key, kept->second.color)) {
        kept->second = layer;
      }
    }
    const std::vector<const FrameImage*> layer_images = stack.LayerImages();
    ASSERT_LE(layer_images.size(), static_cast<std::size_t>(max_layers));
    for (int y = 0; y < 20; ++y) {
      for (int x = 0; x < 20; ++x) {
        const auto& pixel_layers = expected[{y, x}];
        auto next = pixel_layers.begin();
        for (const FrameImage* layer_image : layer_images) {
          const std::size_t i = layer_image->IndexOf(x, y);
          const bool is_covered =
              (layer_image->CoveredOf(x / 16, y / 16)[static_cast<std::size_t>(y % 16)] >>
                   (x % 16) &
               1) != 0;
          ASSERT_EQ(is_covered, next != pixel_layers.end());
          ASSERT_EQ(layer_image->keys[i], is_covered ? next->second.key : kBackgroundKey);
          ASSERT_EQ(layer_image->colors[i], is_covered ? next->second.color : Rgba8{});
          next = is_covered ? std::next(next) : next;
        }
        EXPECT_EQ(std::min(pixel_layers.size(), static_cast<std::size_t>(max_layers)),
                  static_cast<std::size_t>(std::distance(pixel_layers.begin(), next)));
      }
    }
  }
}

TEST(LayerStackTest, NeitherOrderNorRepetitionNorPartsChangeIt) {
  const auto images = FrameImagePool::Make(1 << 20);
  std::vector<Layer> layers = RandomLayers(2, 3000);
  const LayerStack expected = StackOf(layers, 4, images.get());

  std::vector<Layer> twice = layers;
  twice.insert(twice.end(), layers.rbegin(), layers.rend());
  EXPECT_TRUE(StackOf(twice, 4, images.get()) == expected);

  // Two agents: what each of them keeps is enough.
  LayerStack merged(20, 20, 4, kOrder, images.get());
  const auto middle = layers.begin() + 1300;
  for (const std::vector<Layer>& part :
       {std::vector<Layer>(middle, layers.end()), std::vector<Layer>(layers.begin(), middle)}) {
    const LayerStack part_stack = StackOf(part, 4, images.get());
    for (const FrameImage* layer_image : part_stack.LayerImages()) {
      for (int y = 0; y < 20; ++y) {
        for (int x = 0; x < 20; ++x) {
          if (const std::size_t i = layer_image->IndexOf(x, y);
              layer_image->keys[i] != kBackgroundKey) {
            merged.Insert(x, y, layer_image->keys[i], layer_image->colors[i]);
          }
        }
      }
    }
  }
  EXPECT_TRUE(merged == expected);
}

TEST(LayerStackTest, ImagesAreMadeWhenTheyAreNeeded) {
  const auto images = FrameImagePool::Make(1 << 20);
  LayerStack stack(20, 20, 16, kOrder, images.get());
  EXPECT_TRUE(stack.empty());
  EXPECT_TRUE(LayerStack().empty());
  EXPECT_TRUE(LayerStack().LayerImages().empty());
  stack.Insert(3, 4, FragmentKey(0.5F, 7), {1, 2, 3, 255});
  EXPECT_EQ(stack.LayerImages().size(), 1U);
  stack.Insert(3, 4, FragmentKey(0.25F, 7), {4, 5, 6, 255});
  ASSERT_EQ(stack.LayerImages().size(), 2U);
  EXPECT_EQ(stack.LayerImages()[0]->keys[stack.LayerImages()[0]->IndexOf(3, 4)],
            FragmentKey(0.25F, 7));
  const LayerStack moved = std::move(stack);
  EXPECT_EQ(moved.LayerImages().size(), 2U);
}

TEST(LayerStackTest, ALayerShowsBeforeAFartherOpaqueFragmentOrOneOfALaterSurface) {
  const auto images = FrameImagePool::Make(1 << 20);
  const LayerStack stack(20, 20, 1, kOrder, images.get());
  const auto key = [](float depth, std::uint32_t surface) {
    return FragmentKey(depth, kOrder.OwnerOf(surface, 9));
  };
  EXPECT_TRUE(stack.IsBefore(key(0.25F, 1), key(0.5F, 0)));
  EXPECT_FALSE(stack.IsBefore(key(0.5F, 0), key(0.25F, 1)));
  EXPECT_TRUE(stack.IsBefore(key(0.5F, 0), key(0.5F, 1)));
  EXPECT_FALSE(stack.IsBefore(key(0.5F, 1), key(0.5F, 0)));
  EXPECT_TRUE(stack.IsBefore(key(1.0F, 2), kBackgroundKey));
}

}  // namespace
}  // namespace isoscope::image
