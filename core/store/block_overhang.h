// The overhang of a block of an index-only shard: those of its stored samples that lie outside of the
// unit of the source that has its first own sample. It is in blocks.bin, so that a block is read from
// one unit, and an agent decodes no other agent's units (docs/format/shard.md, "Overhangs").
//
//   unit                   next unit
//   |...................|...................     along one axis, in blocks of 16 cells
//                  [=======]                     stored samples of a block
//                       [==]                     its overhang

#ifndef ISOSCOPE_CORE_STORE_BLOCK_OVERHANG_H_
#define ISOSCOPE_CORE_STORE_BLOCK_OVERHANG_H_

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/math/box.h"
#include "core/store/sample_reader.h"
#include "core/store/shard_format.h"
#include "core/volume/block_layout.h"
#include "core/volume/scalar_type.h"

namespace isoscope::store {

// Returns the index of the unit, in the grid of units, that has the first own sample of a block.
math::Index3 UnitOfBlock(const volume::BlockLayout& layout, const SourceSamples& source,
                         volume::BlockId id);
// Returns the stored samples of a block that lie in that unit; not empty.
math::IndexBox PartInUnit(const volume::BlockLayout& layout, const SourceSamples& source,
                          volume::BlockId id);

// The bytes of an overhang without its samples: a checksum and an encoding.
inline constexpr std::size_t kOverhangHeadBytes = 5;

// Encodes the overhang of a block, with a checksum of all its stored samples, into `*out`, and returns
// kOverhang; all its samples and kRaw, if that is not larger. Thread-safe.
BlockEncoding EncodeOverhang(const volume::BlockLayout& layout, const SourceSamples& source,
                             volume::ScalarType type, volume::BlockId id, absl::string_view samples,
                             std::string* out);

// Writes the samples of an overhang to their places among the stored samples, and returns the CRC-32C that
// all stored samples of the block have. Safe for any bytes. Thread-safe. DATA_LOSS: `stored` is no
// overhang of that block.
absl::StatusOr<std::uint32_t> DecodeOverhang(const volume::BlockLayout& layout,
                                             const SourceSamples& source, volume::ScalarType type,
                                             volume::BlockId id, absl::string_view stored,
                                             char* samples);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_BLOCK_OVERHANG_H_
