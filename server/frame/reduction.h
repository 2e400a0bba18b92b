// Reduces the answers of a frame's agents to the blocks to draw, and to the picture.
//
//   step  of the agents       reduce                     gives each part
//   1     ray hits            union of sets              its occluding blocks
//   2     occluders' pixels   the nearest fragment wins  its blocks that the occluders do not hide
//   3     the other pixels    the nearest fragment wins  -
//
// These reduces are associative, commutative and idempotent. So the result does not depend on the
// number of agents or the order of arrival, and a repeated answer counts once. The consequences of
// a reduce are computed once, and each part is told its own. So these messages do not grow with the
// number of agents (docs/architecture.md).

#ifndef ISOSCOPE_SERVER_FRAME_REDUCTION_H_
#define ISOSCOPE_SERVER_FRAME_REDUCTION_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "core/base/task_arena.h"
#include "core/base/trace_recorder.h"
#include "core/composite/pixel_codec.h"
#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/image/layer_stack.h"
#include "core/image/pixel_mailboxes.h"
#include "core/image/pixel_mask.h"
#include "core/view/clip_region.h"
#include "core/view/view.h"
#include "core/visibility/occlusion_map.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_set.h"
#include "core/volume/block_tree.h"
#include "server/frame/active_blocks.h"

namespace isoscope::server {

// All objects that it points to outlive the frame.
struct ReductionSetup {
  const frame::FrameSpec* spec = nullptr;
  const view::View* view = nullptr;  // the spec's
  const volume::BlockLayout* layout = nullptr;
  image::TieRule ties = image::TieRule::kColor;  // of the agents' back end
  // The active blocks, if they are known: then no agent may be asked to report them. May be null.
  std::shared_ptr<const ActiveBlocks> active;
  image::FrameImagePool* images = nullptr;
  base::TaskArena* arena = nullptr;      // for the computations
  base::TraceRecorder* trace = nullptr;  // null: no trace was asked for
  bool keeps_blocks = false;             // the result has the blocks of each part
  // A volume with more blocks is reduced by trees (ActiveTree): the same blocks, in less time.
  std::int64_t max_dense_blocks = volume::kMaxDenseBlocks;
};

// The blocks that a part draws in steps 2 and 3; ascending.
struct PartBlocks {
  std::vector<volume::BlockId> occluders = {};
  std::vector<volume::BlockId> visible = {};
  std::string open_pixels = {};  // EncodeOpenPixels of `visible`; empty with a mask
};

struct ReducedFrame {
  image::FrameImage image;
  // The translucent fragments, at most max_layers + 1 for a pixel; some may lie behind the image.
  image::LayerStack layers;
  // The active blocks of the setup, or those that the agents reported. Null with kNone.
  std::shared_ptr<const ActiveBlocks> active;
  std::int64_t ray_hit_block_count = 0;
  // If the setup keeps them: the hits, and by part the blocks, without open pixels. Empty with
  // kNone.
  volume::BlockSet ray_hits = {};
  std::vector<PartBlocks> blocks = {};
};

// Only the functions that composite are thread-safe: their callers share locks of rows.
class Reduction {
 public:
  // image: empty, of the view's size
  Reduction(const ReductionSetup& setup, std::size_t part_count, image::FrameImage image);

  using PartBlocks = server::PartBlocks;
  // Called as soon as a part's blocks are known; several threads call it at once.
  using PartReady = std::function<void(std::size_t part_index, PartBlocks* blocks)>;

  // `active`: the active blocks of the part, if they were asked for.
  void AddRayHits(std::size_t part_index, const std::vector<volume::BlockId>& hits,
                  std::vector<volume::BlockId> active);
  // The union of the hits that have come.
  [[nodiscard]] volume::BlockSet ray_hits() const;
  // Prepares the data of known active blocks for SelectOccluders; else does nothing.
  void Prepare();
  void SelectOccluders(const PartReady& ready);
  void SelectVisible(const PartReady& ready);
  [[nodiscard]] PartBlocks* BlocksOf(std::size_t part_index) { return &blocks_[part_index]; }

  // INTERNAL if they are not of the frame's size, as the next two functions require.
  [[nodiscard]] absl::Status CheckSize(const image::DrawnPixels& pixels) const;
  // Makes the image the frame's, and returns the empty one. REQUIRES: nothing is composited yet.
  void Adopt(image::DrawnPixels* pixels) { std::swap(reduced_.image, pixels->image); }
  // in_parallel: by tasks of the caller's arena
  absl::Status CompositeDrawn(const image::DrawnPixels& pixels, bool in_parallel);
  // DATA_LOSS if the band is damaged; then nothing changes.
  absl::Status CompositeBand(absl::string_view band);
  [[nodiscard]] bool has_layers() const { return has_layers_; }

  ReducedFrame Take();

 private:
  struct Selection {
    std::vector<volume::BlockId> blocks;
    std::vector<image::PixelMask> open;  // the pixels that each block could win; or none
  };
  template <typename Fn>
  [[nodiscard]] std::vector<Selection> SelectBlocks(const Fn& select) const;
  // The steps of SelectOccluders and SelectVisible, by sets and by trees.
  [[nodiscard]] std::vector<Selection> OccludersInSet();
  [[nodiscard]] std::vector<Selection> OccludersInTree();
  [[nodiscard]] std::vector<Selection> VisibleInSet(const visibility::OcclusionMap& map) const;
  [[nodiscard]] std::vector<Selection> VisibleInTree(const visibility::OcclusionMap& map) const;
  // Returns the marked ones of a run of active blocks, and sets their footprints.
  [[nodiscard]] std::vector<volume::BlockId> MarkedBlocks(
      const std::vector<std::uint64_t>& marks, std::size_t begin, std::size_t end,
      std::vector<view::Footprint>* footprints) const;
  [[nodiscard]] bool is_by_trees() const {
    return setup_.layout->block_count() > setup_.max_dense_blocks;
  }
  [[nodiscard]] bool has_depth() const { return setup_.spec->culling == frame::Culling::kDepth; }
  template <typename Fn>
  void ForEachPart(const Fn& fn) const;
  void FindFootprints(const ActiveBlocks& active);

  const ReductionSetup setup_;
  const image::FragmentOrder order_;
  const view::Clipper clipper_;
  const bool has_layers_;                               // then step 2 draws only opaque surfaces
  volume::BlockSet hits_;                               // of all parts so far; unless by trees
  std::vector<volume::BlockId> hit_ids_;                // the same, by trees; some several times
  std::vector<std::vector<volume::BlockId>> reported_;  // active blocks, by part
  volume::BlockSet occluding_;
  std::vector<std::uint64_t> occluding_marks_;  // the same, by trees
  std::vector<view::Footprint> footprints_;     // of the active blocks
  std::vector<PartBlocks> blocks_;              // by part
  ReducedFrame reduced_;
  composite::RowLocks row_locks_;  // of its image
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_REDUCTION_H_
