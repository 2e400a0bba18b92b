// Keys of objects, and the bytes of an object that a read asks for: the rules of every ObjectStore.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_OBJECT_KEY_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_OBJECT_KEY_H_

#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/bytes/byte_source.h"
#include "core/source/bytes/object_store.h"

namespace isoscope::source {

// S3 allows no longer key.
inline constexpr std::size_t kMaxKeyBytes = 1024;

// INVALID_ARGUMENT unless `key` has 1 to kMaxKeyBytes bytes and its parts, joined by '/', are names:
// none is empty, "." or "..", none has a control character. So a key leads below its folder.
absl::Status CheckObjectKey(absl::string_view key);

// The last part of a path or an address, without the '/' behind it. Of an address of HTTP it is
// decoded, "a b" of "https://host/a%20b", where that is a key of UTF-8 without '/'.
std::string LastPartOfPath(absl::string_view path);

// Bytes [offset, offset + size) of an object.
struct ObjectExtent {
  std::int64_t offset = 0;
  std::int64_t size = 0;
};

// Returns the bytes that `read` asks of an object of `object_size` bytes. OUT_OF_RANGE if the object
// ends before; RESOURCE_EXHAUSTED for more than read.max_size. Errors begin with `name`.
absl::StatusOr<ObjectExtent> ExtentOf(const ObjectRead& read, std::int64_t object_size,
                                      absl::string_view name);

// OUT_OF_RANGE, which begins with `name`, unless `range` lies within an object of `object_size`
// bytes.
absl::Status CheckWithin(const ByteRange& range, std::int64_t object_size, absl::string_view name);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_OBJECT_KEY_H_
