// What is below an address: the keys of a bucket below a prefix, or the names on the pages of an
// index, as web servers make them for folders.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_LIST_OBJECTS_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_LIST_OBJECTS_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/cancellation.h"
#include "core/source/remote/address.h"
#include "core/source/remote/remote_client.h"

namespace isoscope::source {

inline constexpr std::size_t kMaxListedObjects = 4'000'000;

struct ListedObject {
  std::string key;         // below the address, as CheckObjectKey
  std::int64_t size = -1;  // bytes; -1: the list does not say it
};

// Lists all objects below `folder`, in the order of their keys. Of S3 by ListObjectsV2; of HTTP by the
// links of its page that lead below it, and of the pages of the folders among them; metadata of Zarr 2
// that the pages hide is looked for.
//
// NOT_FOUND: there is none. INVALID_ARGUMENT: a key that is no path below the folder; what comes is no
// list. RESOURCE_EXHAUSTED: more than kMaxListedObjects, or folders more than 32 deep. Other errors
// as Fetch.
absl::StatusOr<std::vector<ListedObject>> ListObjects(RemoteClient* client, const Address& folder,
                                                      const base::Cancellation& cancellation);

// One page of a list of S3.
struct ListedPage {
  std::vector<ListedObject> objects;  // whole keys
  std::string next = {};              // the token of the next page; empty: the last one
};
// INVALID_ARGUMENT: no list. Keys are decoded if the list says that they are percent-encoded, as
// encoding-type=url asks for.
absl::StatusOr<ListedPage> ParseS3List(absl::string_view xml);

// The names that a page of an index links to, one level below `path`, the path of the page, which is
// percent-encoded: decoded, a folder with a '/' behind it, in order, each once.
std::vector<std::string> NamesOfIndex(absl::string_view html, absl::string_view path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_LIST_OBJECTS_H_
