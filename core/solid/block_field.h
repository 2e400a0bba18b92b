// The stored samples of one block, and what a rule makes of them: inside, outside, missing.
//
// A cell has a solid unless it lies outside the volume or touches a missing sample (NaN): then it
// is absent. The solid of a surface ends at absent cells.

#ifndef ISOSCOPE_CORE_SOLID_BLOCK_FIELD_H_
#define ISOSCOPE_CORE_SOLID_BLOCK_FIELD_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/inside_rule.h"

namespace isoscope::solid {

// A sample by its index among the stored ones, x fastest. A cell has the index of its lowest one.
using SampleIndex = std::size_t;

enum class SampleState : std::uint8_t { kOutside, kInside, kMissing };

// kUnknown: a corner is not stored. Such a cell touches no own sample of the block.
enum class CellState : std::uint8_t { kPresent, kAbsent, kUnknown };

// Reused for many blocks of a volume. Thread-compatible.
class BlockField {
 public:
  explicit BlockField(const volume::BlockLayout& layout) : layout_(layout) {}

  // Both must outlive the next calls. O(samples).
  void Set(const volume::BlockSamples& samples, const volume::InsideRule& rule);

  [[nodiscard]] const volume::InsideRule& rule() const { return *rule_; }
  [[nodiscard]] const math::IndexBox& stored() const { return stored_; }
  // The block's own cells.
  [[nodiscard]] const math::IndexBox& cells() const { return cells_; }
  [[nodiscard]] std::size_t sample_count() const { return states_.size(); }
  [[nodiscard]] bool has_missing() const { return has_missing_; }
  [[nodiscard]] bool has_inside() const { return has_inside_; }
  // True if an own cell lies at the border of the volume.
  [[nodiscard]] bool touches_border() const;

  // The distance to the next sample on an axis.
  [[nodiscard]] std::size_t StrideOf(int axis) const {
    return strides_[static_cast<std::size_t>(axis)];
  }
  [[nodiscard]] SampleIndex IndexOf(const math::Index3& position) const;
  // In the volume.
  [[nodiscard]] math::Index3 PositionOf(SampleIndex sample) const;
  [[nodiscard]] std::int64_t LinearInVolume(SampleIndex sample) const;

  // Takes the key of a grid edge (mesh::BlockMesh) to 3 * its lower sample + axis.
  // REQUIRES: both ends are stored.
  [[nodiscard]] std::size_t LocalEdge(std::int64_t key) const;

  [[nodiscard]] SampleState StateOf(SampleIndex sample) const { return states_[sample]; }
  [[nodiscard]] double ValueAt(SampleIndex sample) const;

  // cell: its lowest sample, in the volume; may lie outside
  [[nodiscard]] CellState StateOfCell(const math::Index3& cell) const;
  // Bit c is set iff corner c is inside (extract/case_table.h). REQUIRES: all corners are stored.
  [[nodiscard]] unsigned CaseOf(SampleIndex cell) const;

 private:
  const volume::BlockLayout layout_;
  const volume::InsideRule* rule_ = nullptr;
  volume::BlockSamples samples_;
  math::IndexBox stored_;
  math::IndexBox cells_;
  std::array<std::size_t, 3> strides_{};
  std::vector<SampleState> states_;
  bool has_missing_ = false;
  bool has_inside_ = false;
};

}  // namespace isoscope::solid

#endif  // ISOSCOPE_CORE_SOLID_BLOCK_FIELD_H_
