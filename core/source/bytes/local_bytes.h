// Local bytes: a file, and the files below a folder, under the interfaces that addresses have, too.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_LOCAL_BYTES_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_LOCAL_BYTES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/bytes/byte_source.h"
#include "core/source/bytes/object_store.h"

namespace isoscope::source {

// Opens a regular file. Its version is made of size and time of change. A file that shrinks while it
// is open is DATA_LOSS. Errors as io::OpenRandomAccessFile.
absl::StatusOr<std::unique_ptr<ByteSource>> OpenFileBytes(const std::string& path);

// Opens the files below a folder. A key is a path below it, of names only (CheckObjectKey); symbolic
// links may lead out, as for other readers. A key that names a folder is NOT_FOUND: object stores
// have no folders. NOT_FOUND if there is no folder at `path`.
absl::StatusOr<std::unique_ptr<ObjectStore>> OpenFolderStore(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_LOCAL_BYTES_H_
