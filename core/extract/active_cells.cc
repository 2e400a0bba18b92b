// For each rule every sample has a side: a bit for inside, one for outside, one for NaN. The sides of
// a cell are those of its eight samples together. It is active if they are inside and outside.

#include "core/extract/active_cells.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/base/coding.h"
#include "core/volume/scalar_type.h"

namespace isoscope::extract {
namespace {

constexpr std::uint8_t kInsideBit = 1;
constexpr std::uint8_t kOutsideBit = 2;
constexpr std::uint8_t kNanBit = 4;

// The sides of the samples that a block stores: [z][y][x], as the samples.
std::vector<std::uint8_t> SidesOf(const volume::BlockSamples& samples, std::size_t count,
                                  const volume::InsideRule& rule) {
  std::vector<std::uint8_t> sides(count);
  volume::VisitScalarType(samples.type, [&]<typename T>() {
    for (std::size_t i = 0; i < count; ++i) {
      const auto value =
          static_cast<double>(base::LoadLittleEndian<T>(samples.bytes + i * sizeof(T)));
      sides[i] = std::isnan(value) ? kNanBit : rule.IsInside(value) ? kInsideBit : kOutsideBit;
    }
  });
  return sides;
}

// Calls visit(cell) for each active cell among `cells`.
void VisitActiveCells(const std::vector<std::uint8_t>& sides, const math::IndexBox& stored,
                      const math::IndexBox& cells,
                      absl::FunctionRef<void(const math::Index3& cell)> visit) {
  const math::Index3 dims = stored.dims();
  for (std::int64_t z = cells.begin.z; z < cells.end.z; ++z) {
    for (std::int64_t y = cells.begin.y; y < cells.end.y; ++y) {
      const std::uint8_t* const row =
          sides.data() + (cells.begin.x - stored.begin.x) +
          dims.x * ((y - stored.begin.y) + dims.y * (z - stored.begin.z));
      // Of the four samples at one x.
      const auto sides_at = [&](std::int64_t x) {
        const std::uint8_t* const at = row + x;
        return at[0] | at[dims.x] | at[dims.x * dims.y] | at[dims.x * dims.y + dims.x];
      };
      int lower = sides_at(0);
      for (std::int64_t x = cells.begin.x; x < cells.end.x; ++x) {
        const int upper = sides_at(x - cells.begin.x + 1);
        if ((lower | upper) == (kInsideBit | kOutsideBit)) {
          visit({x, y, z});
        }
        lower = upper;
      }
    }
  }
}

}  // namespace

math::IndexBox BoxOfActiveCells(const volume::BlockLayout& layout,
                                const volume::BlockSamples& samples,
                                std::span<const volume::InsideRule> rules,
                                absl::FunctionRef<bool(const math::Index3& cell)> counts) {
  math::IndexBox box;
  for (const volume::InsideRule& rule : rules) {
    ForEachActiveCell(layout, samples, rule, [&](const math::Index3& cell) {
      // Cells that are in it already are not asked for.
      if (!box.Contains(cell) && counts(cell)) {
        box.Add({cell, cell + math::Index3{1, 1, 1}});
      }
    });
  }
  return box;
}

void ForEachActiveCell(const volume::BlockLayout& layout, const volume::BlockSamples& samples,
                       const volume::InsideRule& rule,
                       absl::FunctionRef<void(const math::Index3& cell)> visit) {
  const math::IndexBox stored = layout.StoredSamplesOf(samples.block_id);
  const auto count = static_cast<std::size_t>(math::Volume(stored.dims()));
  VisitActiveCells(SidesOf(samples, count, rule), stored, layout.CellsOf(samples.block_id), visit);
}

}  // namespace isoscope::extract
