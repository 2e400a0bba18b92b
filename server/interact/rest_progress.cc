#include "server/interact/rest_progress.h"

#include <algorithm>
#include <cstddef>
#include <tuple>
#include <utility>

#include "absl/strings/str_cat.h"

#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

// A level has about a quarter of the active blocks of the next finer one: a surface has two
// dimensions.
constexpr double kBlocksByLevel = 4;

constexpr absl::Duration kForMiddleTiles = absl::Seconds(1);
constexpr absl::Duration kForSmallTiles = absl::Seconds(4);
constexpr int kLargeTilePx = 512;
constexpr int kMiddleTilePx = 384;
constexpr int kSmallTilePx = 256;

absl::Status CheckFraction(double value, const char* name) {
  if (value >= 0 && value <= 1) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      absl::StrCat("view_state.refinement.focus.", name, " is ", value, ": must lie in [0, 1]"));
}

bool HaveSameLimits(const RestWish& a, const RestWish& b) {
  return a.max_bytes == b.max_bytes && a.max_duration == b.max_duration;
}

// The distance of a value from a range.
double DistanceTo(double value, double begin, double end) {
  return std::max({begin - value, value - end, 0.0});
}

double SquareSum(double a, double b) { return a * a + b * b; }

}  // namespace

absl::StatusOr<RestWish> RestWishFromProto(const v1::Refinement& refinement) {
  RestWish wish{.coarse_levels = refinement.coarse_levels(),
                .tiles = refinement.tiles(),
                .max_bytes = refinement.max_exact_bytes()};
  if (refinement.has_focus()) {
    wish.focus_x = refinement.focus().x();
    wish.focus_y = refinement.focus().y();
  }
  for (const auto& [value, name] : {std::pair(wish.focus_x, "x"), std::pair(wish.focus_y, "y")}) {
    if (absl::Status status = CheckFraction(value, name); !status.ok()) {
      return status;
    }
  }
  if (wish.max_bytes < 0) {
    return absl::InvalidArgumentError(absl::StrCat("view_state.refinement.max_exact_bytes is ",
                                                   wish.max_bytes,
                                                   ": must be at least 0, which is no limit"));
  }
  if (refinement.has_max_exact_duration()) {
    wish.max_duration = wire::DurationFromProto(refinement.max_exact_duration());
    if (wish.max_duration < absl::ZeroDuration()) {
      return absl::InvalidArgumentError(absl::StrCat(
          "view_state.refinement.max_exact_duration is ", absl::FormatDuration(wish.max_duration),
          ": must be at least 0; leave it out for no limit"));
    }
  }
  return wish;
}

void RestProgress::SetWish(const RestWish& wish) {
  is_deferred_ = is_deferred_ && HaveSameLimits(wish, wish_);
  wish_ = wish;
  is_over_ = is_over_ && facts_.has_value();  // not after an error
}

bool RestProgress::IsDeferredOtherwise(const RestWish& wish) const {
  return is_deferred_ && !HaveSameLimits(wish, wish_);
}

bool RestProgress::IsOverLimit(absl::Duration expected) const {
  return (wish_.max_bytes > 0 && facts_->active_bytes > wish_.max_bytes) ||
         expected > wish_.max_duration;
}

bool RestProgress::OnFacts(const FrameFacts& facts, const ExactCost& cost) {
  facts_ = facts;
  return Next(cost).kind == RestStep::Kind::kWhole;
}

void RestProgress::OnCoarse(const v1::DrawnLevel* drawn, bool tells_hidden) {
  had_coarse_ = true;
  tells_hidden_ = tells_hidden || drawn == nullptr;
  if (drawn != nullptr) {
    coarse_ = *drawn;
  }
}

void RestProgress::OnTiles(const BandGrid* grid) {
  if (grid == nullptr) {
    has_no_tiles_ = true;
    return;
  }
  grid_ = *grid;
  is_drawn_.assign(static_cast<std::size_t>(grid->count()), false);
}

void RestProgress::OnError() {
  *this = RestProgress(wish_);
  is_over_ = true;
}

int RestProgress::drawn_tile_count() const {
  return static_cast<int>(std::count(is_drawn_.begin(), is_drawn_.end(), true));
}

std::optional<int> RestProgress::NearestTile() const {
  std::optional<int> nearest;
  std::tuple<double, double> least;
  const view::Region last = grid_->At(grid_->count() - 1);
  const double x = wish_.focus_x * (last.x + last.width_px);
  const double y = wish_.focus_y * (last.y + last.height_px);
  for (int i = 0; i < grid_->count(); ++i) {
    if (is_drawn_[static_cast<std::size_t>(i)]) {
      continue;
    }
    const view::Region tile = grid_->At(i);
    const double beside = SquareSum(DistanceTo(x, tile.x, tile.x + tile.width_px),
                                    DistanceTo(y, tile.y, tile.y + tile.height_px));
    const double from_middle =
        SquareSum(x - tile.x - tile.width_px / 2.0, y - tile.y - tile.height_px / 2.0);
    const std::tuple<double, double> distance(beside, from_middle);
    if (!nearest.has_value() || distance < least) {
      nearest = i;
      least = distance;
    }
  }
  return nearest;
}

int RestProgress::CoarseLevel(const ExactCost& cost) const {
  auto bytes = static_cast<double>(facts_->active_bytes);
  for (int level = facts_->level + 1; level < facts_->coarsest_level; ++level) {
    bytes /= kBlocksByLevel;
    if (cost.Expected(static_cast<std::int64_t>(bytes)) <= kQuick) {
      return level;
    }
  }
  return facts_->coarsest_level;
}

bool RestProgress::NeedsCoarse(bool is_over_limit) const {
  const bool is_missing = !had_coarse_ || (is_over_limit && !tells_hidden_ && !is_deferred_);
  return is_missing && wish_.coarse_levels && facts_->coarsest_level > facts_->level;
}

RestStep RestProgress::Next(const ExactCost& cost) const {
  using Kind = RestStep::Kind;
  if (is_over_) {
    return {.kind = Kind::kNone};
  }
  if (!facts_.has_value()) {
    return {.kind = Kind::kPlan};
  }
  if (drawn_tile_count() > 0) {
    const std::optional<int> tile = NearestTile();
    return {.kind = tile.has_value() ? Kind::kTile : Kind::kFinish, .tile = tile.value_or(0)};
  }
  const absl::Duration expected = cost.Expected(facts_->active_bytes);
  const bool is_slow = expected > kQuick;
  const bool is_over_limit = IsOverLimit(expected);
  if ((is_slow || is_over_limit) && NeedsCoarse(is_over_limit)) {
    return {.kind = Kind::kCoarse,
            .least_level = coarse_.has_value() ? coarse_->level() : CoarseLevel(cost),
            .stays = is_over_limit};
  }
  if (is_over_limit) {
    return {.kind = is_deferred_ ? Kind::kNone : Kind::kDefer};
  }
  if (is_slow && wish_.tiles && facts_->may_tile && !has_no_tiles_) {
    return {.kind = Kind::kTile, .tile = grid_.has_value() ? NearestTile().value_or(0) : 0};
  }
  return {.kind = Kind::kWhole};
}

int RestProgress::TileSide(const ExactCost& cost) const {
  const absl::Duration expected = cost.Expected(facts_->active_bytes);
  return expected < kForMiddleTiles  ? kLargeTilePx
         : expected < kForSmallTiles ? kMiddleTilePx
                                     : kSmallTilePx;
}

v1::ExactDeferred RestProgress::Deferral(const ExactCost& cost) const {
  v1::ExactDeferred deferral;
  deferral.set_expected_bytes(facts_->active_bytes);
  *deferral.mutable_expected_duration() = wire::ToProto(cost.Expected(facts_->active_bytes));
  if (coarse_.has_value()) {
    *deferral.mutable_drawn_level() = *coarse_;
  }
  return deferral;
}

}  // namespace isoscope::server
