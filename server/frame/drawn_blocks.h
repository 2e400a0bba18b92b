// The blocks that the bands of a picture have drawn so far. A block that lies in several bands is
// drawn for each of them, and counts once.

#ifndef ISOSCOPE_SERVER_FRAME_DRAWN_BLOCKS_H_
#define ISOSCOPE_SERVER_FRAME_DRAWN_BLOCKS_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/volume/block_layout.h"
#include "core/volume/block_set.h"
#include "server/cluster/frame_part.h"
#include "server/frame/active_blocks.h"
#include "server/frame/reduction.h"
#include "server/frame/render_statistics.h"

namespace isoscope::server {

// Parts are those of one frame, in the same order in all bands. Thread-compatible.
class DrawnBlocks {
 public:
  explicit DrawnBlocks(std::int64_t block_count);
  // Returns the bytes of its sets.
  static std::size_t BytesOf(std::int64_t block_count);

  // Adds the blocks of a band. Does nothing with kNone, whose agents draw all their blocks unasked.
  // REQUIRES: the band's setup keeps blocks.
  void Add(const ReducedFrame& band);

  // Returns the blocks of a part whose opaque meshes were drawn, ascending, and those whose
  // translucent meshes were.
  [[nodiscard]] std::vector<volume::BlockId> OpaqueOf(std::size_t part_index) const;
  [[nodiscard]] std::vector<volume::BlockId> TranslucentOf(std::size_t part_index) const;

  // Sets the counts of ray hits, occluding and visible blocks to those of all bands together. Does
  // nothing with kNone.
  void SetCounts(const std::vector<FramePart>& parts, FrameCost* cost) const;

 private:
  [[nodiscard]] std::vector<volume::BlockId> MembersOf(std::size_t part_index,
                                                       const volume::BlockSet& set) const;

  std::shared_ptr<const ActiveBlocks> active_;  // null: no band has any
  volume::BlockSet ray_hits_;
  volume::BlockSet occluding_;
  volume::BlockSet drawn_;
  volume::BlockSet drawn_in_step_3_;  // with translucent surfaces, also blocks of step 2
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_DRAWN_BLOCKS_H_
