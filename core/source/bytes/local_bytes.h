// Bytes and objects on a local disk.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_LOCAL_BYTES_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_LOCAL_BYTES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/bytes/byte_source.h"
#include "core/source/bytes/object_store.h"

namespace isoscope::source {

// Opens a file. Errors as io::OpenRandomAccessFile.
absl::StatusOr<std::unique_ptr<ByteSource>> OpenFileBytes(const std::string& path);

// The files below a folder. A key is a path from there. NOT_FOUND: no such folder.
// INVALID_ARGUMENT: no folder.
absl::StatusOr<std::unique_ptr<ObjectStore>> OpenFolderStore(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_LOCAL_BYTES_H_
