// Many objects by key: the files below a folder, the objects below an address, the members of a
// ZIP. Stores of chunks (Zarr) know this interface, and neither disk nor network.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_OBJECT_STORE_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_OBJECT_STORE_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"

#include "core/base/cancellation.h"
#include "core/source/bytes/byte_source.h"

namespace isoscope::source {

// A read of one object.
struct ObjectRead {
  std::string key;            // "c/0/1/2": parts joined by '/', none empty, "." or ".."
  std::int64_t offset = 0;    // negative: from the end of the object
  std::int64_t size = -1;     // bytes that are wanted; negative: all to the end
  std::int64_t max_size = 0;  // more than this is an error: RESOURCE_EXHAUSTED, early
};

// Thread-safe.
class ObjectStore {
 public:
  virtual ~ObjectStore() = default;

  // Reads all, at once where the place allows it. The answers are in the order of `reads`.
  //
  // NOT_FOUND if there is no such object: of a chunk that means that it was never written.
  // OUT_OF_RANGE if the object ends before the range does. INVALID_ARGUMENT for a key with an
  // empty part, "." or "..". Other errors are those of ByteSource::ReadRanges.
  [[nodiscard]] virtual std::vector<absl::StatusOr<std::string>> Read(
      absl::Span<const ObjectRead> reads, const base::Cancellation& cancellation) const = 0;
  // Tells what Read will be asked for soon, each as a whole, so that it is fetched at once where each
  // takes a round trip. A wrong word costs time alone. By default it helps nothing.
  virtual void Expect(absl::Span<const ObjectRead> /*reads*/) const {}
  // Opens one object for many reads. Errors as of Read.
  [[nodiscard]] virtual absl::StatusOr<std::unique_ptr<ByteSource>> Open(
      const std::string& key, const base::Cancellation& cancellation) const = 0;
  // The folder or the address, without credentials: for messages.
  [[nodiscard]] virtual const std::string& name() const = 0;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_OBJECT_STORE_H_
