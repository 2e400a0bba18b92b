// Objects at an address (HTTP, HTTPS, S3) behind the interfaces that local files have, too.
//
// Ranges are read in parallel, neighbours in one request. Every wait ends by itself: retries are
// bounded, and a cancellation is heeded at once. Credentials come from the options alone, and are in
// no name and no error. Nothing is kept on a disk.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_OPEN_ADDRESS_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_OPEN_ADDRESS_H_

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/cancellation.h"
#include "core/source/bytes/byte_source.h"
#include "core/source/bytes/object_store.h"
#include "core/source/remote/remote_options.h"

namespace isoscope::source {

// Opens one object: reads its first byte, which tells its size and its ETag, and that the server
// knows ranges. INVALID_ARGUMENT for what is no address; other errors as core/source/remote/fetch.h.
absl::StatusOr<std::unique_ptr<ByteSource>> OpenAddress(absl::string_view address,
                                                        const RemoteOptions& options,
                                                        const base::Cancellation& cancellation);

// The same with the first bytes of the object, which come with the request that opens it: `start_bytes`
// of them, or all that it has. REQUIRES: start_bytes >= 2.
struct StartedObject {
  std::unique_ptr<ByteSource> bytes;
  std::string start;
};
absl::StatusOr<StartedObject> OpenAddressWithStart(absl::string_view address,
                                                   const RemoteOptions& options,
                                                   std::int64_t start_bytes,
                                                   const base::Cancellation& cancellation);

// Opens the objects below a prefix, without a request. A query of the prefix (the signature of a
// container) goes with every key. NOT_FOUND of a read is an answer of 404 or 410. S3 answers 403 for
// missing objects where the bucket may not be listed: PERMISSION_DENIED says so.
absl::StatusOr<std::unique_ptr<ObjectStore>> OpenAddressStore(absl::string_view prefix,
                                                              const RemoteOptions& options);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_OPEN_ADDRESS_H_
