// A source put together from pieces, each a source of a box of its samples.

#ifndef ISOSCOPE_CORE_SOURCE_ADAPT_PIECES_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_ADAPT_PIECES_SOURCE_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "absl/status/statusor.h"

#include "core/math/vec.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// Indices of samples of the whole.
struct SamplePiece {
  math::Index3 begin;  // the box that it gives
  math::Index3 end;
  math::Index3 first;  // the first sample of its source, which may have more around the box
};

// A sample that no piece gives; not set if there is none. RESOURCE_EXHAUSTED if the pieces lie so
// that what they leave falls into more than 65 536 boxes.
absl::StatusOr<std::optional<math::Index3>> FindGap(const math::Index3& dims,
                                                    const std::vector<SamplePiece>& pieces);

// Opens the source of a piece, which has the sample type of the whole and all of the piece's box.
using OpenPiece = std::function<absl::StatusOr<std::unique_ptr<VolumeSource>>(std::size_t piece)>;

// Where pieces overlap, the first one that has a sample counts. Keeps the 16 pieces open that were
// used last, and 256 KiB of rows or one row; `piece_bytes` is the most that one source holds. `info` says
// all of the whole but its memory.
// Errors of ReadRows are those of the pieces. REQUIRES: no gap; the pieces lie within the whole.
std::unique_ptr<VolumeSource> MakePiecesSource(SourceInfo info, std::vector<SamplePiece> pieces,
                                               std::int64_t piece_bytes, OpenPiece open);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_ADAPT_PIECES_SOURCE_H_
