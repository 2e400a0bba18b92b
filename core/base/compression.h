// Zstandard for messages: fast level, sizes checked before anything is allocated.

#ifndef ISOSCOPE_CORE_BASE_COMPRESSION_H_
#define ISOSCOPE_CORE_BASE_COMPRESSION_H_

#include <cstddef>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::base {

// Compresses `bytes` into one Zstandard frame that states its content size. Thread-safe.
std::string Compress(absl::string_view bytes);

// Decompresses one frame. DATA_LOSS if it is damaged, does not state its size, states more than
// `max_size` bytes, or has bytes after it. Allocates at most `max_size`. Thread-safe.
absl::StatusOr<std::string> Decompress(absl::string_view frame, std::size_t max_size);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_COMPRESSION_H_
