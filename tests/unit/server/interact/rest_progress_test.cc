// The steps of views at rest, one after the other.

#include "server/interact/rest_progress.h"

#include <cmath>
#include <limits>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "tests/support/status_matchers.h"
#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;
using Kind = RestStep::Kind;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::StatusIs;

constexpr std::int64_t kGiB = std::int64_t{1} << 30;  // 1 s, as long as nothing was measured
constexpr RestWish kAll{.coarse_levels = true, .tiles = true};

FrameFacts Facts(std::int64_t active_bytes, int coarsest = 5) {
  return {.coarsest_level = coarsest, .active_bytes = active_bytes, .may_tile = true};
}

// Draws all tiles, and returns them in their order.
std::vector<int> DrawTiles(RestProgress* progress, const ExactCost& cost) {
  std::vector<int> order;
  for (;;) {
    const RestStep step = progress->Next(cost);
    if (step.kind != Kind::kTile) {
      EXPECT_EQ(step.kind, Kind::kFinish);
      return order;
    }
    order.push_back(step.tile);
    progress->OnTileDrawn(step.tile);
  }
}

TEST(RestProgressTest, AQuickFrameIsDrawnAtOnceAndOnce) {
  RestProgress progress(kAll);
  EXPECT_EQ(progress.Next({}).kind, Kind::kPlan);
  EXPECT_TRUE(progress.OnFacts(Facts(kGiB / 8), {}));
  progress.OnExact();
  EXPECT_EQ(progress.Next({}).kind, Kind::kNone);
}

TEST(RestProgressTest, ASlowFrameComesCoarseThenInTilesThenExact) {
  RestProgress progress(kAll);
  EXPECT_FALSE(progress.OnFacts(Facts(10 * kGiB), {}));
  const RestStep coarse = progress.Next({});
  EXPECT_EQ(coarse.kind, Kind::kCoarse);
  EXPECT_EQ(coarse.least_level, 3) << "10 GiB / 64 take 160 ms";
  EXPECT_FALSE(coarse.stays);
  const v1::DrawnLevel level;
  progress.OnCoarse(&level, true);
  EXPECT_EQ(progress.Next({}).kind, Kind::kTile);
  const BandGrid grid({1024, 1024}, {512, 512});
  progress.OnTiles(&grid);
  EXPECT_EQ(DrawTiles(&progress, {}).size(), 4U);
  progress.OnExact();
  EXPECT_EQ(progress.Next({}).kind, Kind::kNone);
}

TEST(RestProgressTest, TheCoarseFrameIsOfTheCoarsestLevelIfNoneIsQuick) {
  RestProgress progress(kAll);
  progress.OnFacts(Facts(10000 * kGiB, 2), {});
  EXPECT_EQ(progress.Next({}).least_level, 2);
}

TEST(RestProgressTest, WithoutLevelsOrTheWishThereIsNoCoarseFrame) {
  RestProgress without_levels(kAll);
  without_levels.OnFacts(Facts(kGiB, 0), {});
  EXPECT_EQ(without_levels.Next({}).kind, Kind::kTile);
  RestProgress without_wish({.tiles = true});
  without_wish.OnFacts(Facts(kGiB), {});
  EXPECT_EQ(without_wish.Next({}).kind, Kind::kTile);
}

TEST(RestProgressTest, WithoutTilesTheWholeFollowsTheCoarseFrame) {
  RestProgress without_wish({.coarse_levels = true});
  EXPECT_FALSE(without_wish.OnFacts(Facts(kGiB), {}));
  without_wish.OnCoarse(nullptr, true);
  EXPECT_EQ(without_wish.Next({}).kind, Kind::kWhole);

  FrameFacts of_mask = Facts(kGiB);
  of_mask.may_tile = false;
  RestProgress mask(kAll);
  EXPECT_FALSE(mask.OnFacts(of_mask, {}));
  mask.OnCoarse(nullptr, true);
  EXPECT_EQ(mask.Next({}).kind, Kind::kWhole);

  RestProgress without_memory(kAll);
  without_memory.OnFacts(Facts(kGiB), {});
  without_memory.OnCoarse(nullptr, true);
  without_memory.OnTiles(nullptr);
  EXPECT_EQ(without_memory.Next({}).kind, Kind::kWhole);
}

TEST(RestProgressTest, TilesComeInTheOrderOfTheirDistanceFromTheFocus) {
  const BandGrid grid({900, 900}, {300, 300});  // 0 1 2 / 3 4 5 / 6 7 8
  const auto order_of = [&](double x, double y) {
    RestProgress progress({.tiles = true, .focus_x = x, .focus_y = y});
    progress.OnFacts(Facts(kGiB), {});
    progress.OnTiles(&grid);
    return DrawTiles(&progress, {});
  };
  EXPECT_THAT(order_of(0.5, 0.5), ElementsAre(4, 1, 3, 5, 7, 0, 2, 6, 8));
  EXPECT_THAT(order_of(1, 0), ElementsAre(2, 1, 5, 4, 0, 8, 3, 7, 6));
  EXPECT_THAT(order_of(0.1, 0.9).front(), 6);
}

TEST(RestProgressTest, AnotherFocusLeavesTheTilesThatAreDrawn) {
  const BandGrid grid({900, 300}, {300, 300});
  RestProgress progress({.tiles = true, .focus_x = 0});
  progress.OnFacts(Facts(kGiB), {});
  progress.OnTiles(&grid);
  EXPECT_EQ(progress.Next({}).tile, 0);
  progress.OnTileDrawn(0);
  progress.SetWish({.tiles = true, .focus_x = 1});
  EXPECT_THAT(DrawTiles(&progress, {}), ElementsAre(2, 1));
}

TEST(RestProgressTest, AFrameOverALimitIsDeferredOnceAfterTheCoarseFrame) {
  for (const RestWish& limit :
       {RestWish{.coarse_levels = true, .tiles = true, .max_bytes = kGiB - 1},
        RestWish{.coarse_levels = true, .tiles = true, .max_duration = absl::Milliseconds(999)}}) {
    RestProgress progress(limit);
    EXPECT_FALSE(progress.OnFacts(Facts(kGiB), {}));
    EXPECT_EQ(progress.Next({}).kind, Kind::kCoarse);
    EXPECT_TRUE(progress.Next({}).stays);
    v1::DrawnLevel level;
    level.set_level(2);
    progress.OnCoarse(&level, true);
    EXPECT_EQ(progress.Next({}).kind, Kind::kDefer);
    const v1::ExactDeferred deferral = progress.Deferral({});
    EXPECT_EQ(deferral.expected_bytes(), kGiB);
    EXPECT_EQ(wire::DurationFromProto(deferral.expected_duration()), absl::Seconds(1));
    EXPECT_EQ(deferral.drawn_level().level(), 2);
    progress.OnDeferred();
    EXPECT_EQ(progress.Next({}).kind, Kind::kNone);
    RestWish other_focus = limit;
    other_focus.focus_x = 0;
    progress.SetWish(other_focus);
    EXPECT_EQ(progress.Next({}).kind, Kind::kNone) << "told already";
    progress.SetWish(kAll);
    EXPECT_EQ(progress.Next({}).kind, Kind::kTile) << "the limits are gone";
  }
}

// Symptom: a limit that was lowered held the view at a level, and nothing told what that hides.
TEST(RestProgressTest, ACoarseFrameThatHadNotToStayIsSentAgainIfItDoesNotTellWhatItHides) {
  constexpr RestWish kLimited{.coarse_levels = true, .tiles = true, .max_bytes = 1};
  v1::DrawnLevel level;
  level.set_level(4);
  RestProgress progress(kAll);
  progress.OnFacts(Facts(10 * kGiB), {});
  EXPECT_FALSE(progress.Next({}).stays);
  progress.OnCoarse(&level, /*tells_hidden=*/false);
  EXPECT_EQ(progress.Next({}).kind, Kind::kTile) << "the exact frame tells all";
  progress.SetWish(kLimited);
  const RestStep again = progress.Next({});
  EXPECT_EQ(again.kind, Kind::kCoarse);
  EXPECT_TRUE(again.stays);
  EXPECT_EQ(again.least_level, 4) << "the one on the screen, though level 3 is quick";
  progress.OnCoarse(&level, /*tells_hidden=*/true);
  EXPECT_EQ(progress.Next({}).kind, Kind::kDefer);
  progress.OnDeferred();
  EXPECT_EQ(progress.Next({}).kind, Kind::kNone);

  RestProgress told(kAll);
  told.OnFacts(Facts(10 * kGiB), {});
  told.OnCoarse(&level, /*tells_hidden=*/true);
  told.SetWish(kLimited);
  EXPECT_EQ(told.Next({}).kind, Kind::kDefer) << "what it hides was known";
}

TEST(RestProgressTest, ACoarseFrameThatCannotBeDrawnAgainIsNotTriedForEver) {
  v1::DrawnLevel level;
  level.set_level(4);
  RestProgress progress(kAll);
  progress.OnFacts(Facts(10 * kGiB), {});
  progress.OnCoarse(&level, /*tells_hidden=*/false);
  progress.SetWish({.coarse_levels = true, .max_bytes = 1});
  ASSERT_EQ(progress.Next({}).kind, Kind::kCoarse);
  progress.OnCoarse(nullptr, /*tells_hidden=*/false);
  EXPECT_EQ(progress.Next({}).kind, Kind::kDefer);
  EXPECT_EQ(progress.Deferral({}).drawn_level().level(), 4) << "of the one that is shown";
}

TEST(RestProgressTest, ADeferredFrameIsWantedOtherwiseOnlyWithOtherLimits) {
  constexpr RestWish kLimited{.coarse_levels = true, .max_bytes = 1};
  RestProgress progress(kLimited);
  EXPECT_FALSE(progress.IsDeferredOtherwise(kAll)) << "nothing is known";
  progress.OnFacts(Facts(kGiB), {});
  progress.OnCoarse(nullptr, true);
  EXPECT_FALSE(progress.IsDeferredOtherwise(kAll)) << "nothing was told";
  progress.OnDeferred();
  EXPECT_FALSE(progress.IsDeferredOtherwise(kLimited));
  EXPECT_TRUE(progress.IsDeferredOtherwise(kAll));
  EXPECT_TRUE(progress.IsDeferredOtherwise({.max_bytes = 1, .max_duration = absl::Seconds(1)}));
  progress.SetWish(kAll);
  EXPECT_FALSE(progress.IsDeferredOtherwise(kLimited)) << "it goes on";
}

TEST(RestProgressTest, AQuickFrameOverALimitIsDeferredToo) {
  RestProgress progress({.max_bytes = 1});
  EXPECT_FALSE(progress.OnFacts(Facts(1000), {}));
  EXPECT_EQ(progress.Next({}).kind, Kind::kDefer);
  EXPECT_FALSE(progress.Deferral({}).has_drawn_level()) << "nothing is shown instead";
}

TEST(RestProgressTest, AFrameThatHasBegunIsNotDeferred) {
  const BandGrid grid({900, 300}, {300, 300});
  RestProgress progress({.tiles = true});
  progress.OnFacts(Facts(kGiB), {});
  progress.OnTiles(&grid);
  progress.OnTileDrawn(1);
  progress.SetWish({.tiles = true, .max_bytes = 1});
  EXPECT_EQ(progress.Next({}).kind, Kind::kTile);
}

TEST(RestProgressTest, AfterAnErrorTheSamePictureBeginsAnew) {
  RestProgress progress(kAll);
  progress.OnFacts(Facts(kGiB), {});
  progress.OnError();
  EXPECT_EQ(progress.Next({}).kind, Kind::kNone);
  progress.SetWish(kAll);
  EXPECT_EQ(progress.Next({}).kind, Kind::kPlan);
}

TEST(RestProgressTest, AnExactFrameIsNotSentTwiceForItsPicture) {
  RestProgress progress(kAll);
  progress.OnFacts(Facts(1000), {});
  progress.OnExact();
  progress.SetWish({.tiles = true, .max_bytes = 1});
  EXPECT_EQ(progress.Next({}).kind, Kind::kNone);
}

TEST(RestProgressTest, LongFramesHaveSmallTiles) {
  RestProgress progress(kAll);
  progress.OnFacts(Facts(kGiB / 2), {});
  EXPECT_EQ(progress.TileSide({}), 512);
  progress.OnFacts(Facts(2 * kGiB), {});
  EXPECT_EQ(progress.TileSide({}), 384);
  progress.OnFacts(Facts(9 * kGiB), {});
  EXPECT_EQ(progress.TileSide({}), 256);
}

TEST(RestWishTest, WrongFieldsAreNamed) {
  v1::Refinement refinement;
  EXPECT_EQ(RestWishFromProto(refinement)->focus_x, 0.5) << "the centre";
  EXPECT_EQ(RestWishFromProto(refinement)->max_duration, absl::InfiniteDuration());
  const auto error_of = [](const v1::Refinement& wrong, const char* text) {
    EXPECT_THAT(RestWishFromProto(wrong).status(),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(text)));
  };
  for (const double value : {-0.1, 1.5, std::nan(""), std::numeric_limits<double>::infinity()}) {
    v1::Refinement wrong;
    wrong.mutable_focus()->set_y(value);
    error_of(wrong, "view_state.refinement.focus.y is ");
  }
  v1::Refinement bytes;
  bytes.set_max_exact_bytes(-1);
  error_of(bytes, "max_exact_bytes is -1");
  v1::Refinement duration;
  *duration.mutable_max_exact_duration() = wire::ToProto(-absl::Seconds(2));
  error_of(duration, "max_exact_duration is -2s");
}

}  // namespace
}  // namespace isoscope::server
