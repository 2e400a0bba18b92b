// How the bytes of one block are stored: as they are, or compressed.

#ifndef ISOSCOPE_CORE_STORE_BLOCK_CODEC_H_
#define ISOSCOPE_CORE_STORE_BLOCK_CODEC_H_

#include <cstddef>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/store/shard_format.h"
#include "core/volume/scalar_type.h"

namespace isoscope::store {

// "none", "lz4" or "zstd". INVALID_ARGUMENT for any other.
absl::StatusOr<BlockEncoding> ParseBlockEncoding(absl::string_view name);
absl::string_view NameOf(BlockEncoding encoding);

// Encodes `samples`, a block of `type`, into `*out` and returns how: kRaw if `wanted` does not make
// it smaller. Thread-safe.
BlockEncoding EncodeBlock(BlockEncoding wanted, volume::ScalarType type, absl::string_view samples,
                          std::string* out);

// Decodes what EncodeBlock made of `raw_size` bytes into `out`, which takes so many. `scratch` is
// reused from call to call. DATA_LOSS if `stored` is no such encoding: whatever it holds, nothing
// is read or written beyond the two. Damage that decodes to other samples is not seen here: the
// block index has checksums. Thread-safe.
absl::Status DecodeBlock(BlockEncoding encoding, volume::ScalarType type, absl::string_view stored,
                         std::size_t raw_size, std::string* scratch, char* out);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_BLOCK_CODEC_H_
