// Bytes at a place: a local file, or one object at an address (HTTP, S3). Readers of formats know
// this interface, and neither disk nor network.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_BYTE_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_BYTE_SOURCE_H_

#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/types/span.h"

#include "core/base/cancellation.h"

namespace isoscope::source {

// Bytes [offset, offset + size) go to `out`, which has room for them.
struct ByteRange {
  std::int64_t offset = 0;
  std::size_t size = 0;
  char* out = nullptr;
};

// Fixed bytes of known size. Thread-safe.
class ByteSource {
 public:
  virtual ~ByteSource() = default;

  // Reads all ranges, at once where the place allows it, and joins neighbours. Ranges may overlap
  // if their memory does not. Returns the first error that is met; then any part of the ranges may
  // have been read.
  //
  // OUT_OF_RANGE if a range does not lie within size_bytes(). DATA_LOSS if the bytes end before, or
  // if the object has changed since it was opened. CANCELLED and DEADLINE_EXCEEDED soon after the
  // cancellation says so. UNAVAILABLE if the place did not answer, after all retries.
  [[nodiscard]] virtual absl::Status ReadRanges(absl::Span<const ByteRange> ranges,
                                                const base::Cancellation& cancellation) const = 0;
  [[nodiscard]] virtual std::int64_t size_bytes() const = 0;
  // The path or the address, without credentials: for messages.
  [[nodiscard]] virtual const std::string& name() const = 0;
  // Differs if the bytes do, as far as the place tells: an ETag, or size and time. May be empty.
  [[nodiscard]] virtual std::string version() const = 0;

  // Reads one range.
  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size, char* out,
                                    const base::Cancellation& cancellation) const {
    const ByteRange range{.offset = offset, .size = size, .out = out};
    return ReadRanges({&range, 1}, cancellation);
  }
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_BYTE_SOURCE_H_
