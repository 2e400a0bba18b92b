// What a view that refines gets next, once it rests. No gRPC, no threads, no clock.
//
//   what is known                      next
//   nothing                            plan: the exact frame at once if it is quick and within limits
//   slow, or over a limit              coarse, if a coarser level may be drawn; once
//   over a limit since then            coarse again, if it does not tell what its level hides
//   over a limit                       defer; once for each pair of limits. Then nothing
//   slow                               tiles, the nearest to the focus first, then finish
//   slow without tiles, or quick       whole
//   exact frame sent, or an error      nothing
//
// Once a tile is drawn, limits no longer count: its frame is begun.

#ifndef ISOSCOPE_SERVER_INTERACT_REST_PROGRESS_H_
#define ISOSCOPE_SERVER_INTERACT_REST_PROGRESS_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"

#include "isoscope/v1/interact_service.pb.h"
#include "server/admission/band_grid.h"
#include "server/frame/picture_job.h"
#include "server/interact/exact_cost.h"

namespace isoscope::server {

// How a view refines, as isoscope.v1.Refinement has it.
struct RestWish {
  bool coarse_levels = false;
  bool tiles = false;
  double focus_x = 0.5;
  double focus_y = 0.5;
  std::int64_t max_bytes = 0;  // 0: any
  absl::Duration max_duration = absl::InfiniteDuration();
};

// INVALID_ARGUMENT names the field, its value and the allowed values.
absl::StatusOr<RestWish> RestWishFromProto(const isoscope::v1::Refinement& refinement);

struct RestStep {
  enum class Kind { kNone, kPlan, kCoarse, kDefer, kTile, kFinish, kWhole };
  Kind kind = Kind::kNone;
  int tile = 0;         // of kTile; 0 also if BeginTiles was not called yet
  int least_level = 0;  // of kCoarse
  bool stays = false;   // of kCoarse: the exact frame is over a limit
};

// The progress of one picture. Thread-compatible.
class RestProgress {
 public:
  // An exact frame that takes longer has something before it.
  static constexpr absl::Duration kQuick = absl::Milliseconds(250);

  explicit RestProgress(const RestWish& wish) : wish_(wish) {}

  // The same picture is wanted in another way, or again after an error.
  void SetWish(const RestWish& wish);
  // Returns true if the exact frame was put off, and the limits of this wish are others.
  [[nodiscard]] bool IsDeferredOtherwise(const RestWish& wish) const;
  // The facts of the exact frame are known. Returns true if it is to be drawn as a whole, now.
  bool OnFacts(const FrameFacts& facts, const ExactCost& cost);
  // A frame of a coarser level was sent; null: it can't be drawn. `tells_hidden`: nothing is missing
  // of what it should tell if it stays.
  void OnCoarse(const isoscope::v1::DrawnLevel* drawn, bool tells_hidden);
  void OnDeferred() { is_deferred_ = true; }
  // Sets the tiles; null: the picture has none.
  void OnTiles(const BandGrid* grid);
  void OnTileDrawn(int tile) { is_drawn_[static_cast<std::size_t>(tile)] = true; }
  void OnExact() { is_over_ = true; }
  // Forgets all but the wish.
  void OnError();

  [[nodiscard]] RestStep Next(const ExactCost& cost) const;
  // Returns the side of the tiles, in pixels: large ones cost less, small ones come sooner.
  [[nodiscard]] int TileSide(const ExactCost& cost) const;
  // Returns what is told about a frame that is over a limit.
  [[nodiscard]] isoscope::v1::ExactDeferred Deferral(const ExactCost& cost) const;
  // Number of tiles that were drawn.
  [[nodiscard]] int drawn_tile_count() const;

 private:
  [[nodiscard]] bool IsOverLimit(absl::Duration expected) const;
  // Whether a frame of a coarser level comes next, of a frame that is over a limit or not.
  [[nodiscard]] bool NeedsCoarse(bool is_over_limit) const;
  [[nodiscard]] int CoarseLevel(const ExactCost& cost) const;
  // The tile that comes next; none if all are drawn.
  [[nodiscard]] std::optional<int> NearestTile() const;

  RestWish wish_;
  std::optional<FrameFacts> facts_;
  bool had_coarse_ = false;
  std::optional<isoscope::v1::DrawnLevel> coarse_;
  bool tells_hidden_ = false;
  bool is_deferred_ = false;  // told, with the present limits
  bool has_no_tiles_ = false;
  std::optional<BandGrid> grid_;
  std::vector<bool> is_drawn_;  // by tile
  bool is_over_ = false;        // the exact frame or an error was told
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_REST_PROGRESS_H_
