// Encodes and decodes the stored bytes of one block: raw, LZ4, Zstandard or packed
// (docs/format/shard.md, "blocks.bin").

#ifndef ISOSCOPE_CORE_STORE_BLOCK_CODEC_H_
#define ISOSCOPE_CORE_STORE_BLOCK_CODEC_H_

#include <cstddef>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/math/vec.h"
#include "core/store/shard_format.h"
#include "core/volume/scalar_type.h"

namespace isoscope::store {

// "none", "lz4", "zstd" or "packed". INVALID_ARGUMENT for any other.
absl::StatusOr<BlockEncoding> ParseBlockEncoding(absl::string_view name);
absl::string_view NameOf(BlockEncoding encoding);

// Encodes the samples of one block into `*out` and returns the encoding: `wanted`, or kRaw if that
// does not make the block smaller. Of kPacked also kLz4, where that is much smaller, as for single
// bright samples, and for samples of 8 bytes, which are not packed. Thread-safe.
//
// dims:    samples on each axis, at least 1
// samples: [z][y][x] of `type`, x fastest, little-endian
BlockEncoding EncodeBlock(BlockEncoding wanted, volume::ScalarType type, const math::Index3& dims,
                          absl::string_view samples, std::string* out);

// Decodes one block. Safe for any bytes: reads and writes stay within `stored` and `out`. Damage
// that decodes to other samples passes unnoticed; the checksums of the block index reveal it.
// Thread-safe.
//
// dims:    samples on each axis, at least 1
// stored:  the bytes that EncodeBlock returned
// scratch: overwritten; pass the same string again to avoid allocations
// out:     room for all samples of dims
//
// DATA_LOSS if `stored` is no such encoding of exactly these samples.
absl::Status DecodeBlock(BlockEncoding encoding, volume::ScalarType type, const math::Index3& dims,
                         absl::string_view stored, std::string* scratch, char* out);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_BLOCK_CODEC_H_
