// Copies all objects below an address to a folder, so that a copy that was broken off goes on.
//
//   DIR/run.zarr               appears whole, at the end
//   DIR/run.zarr.part/         the objects so far, each whole
//   DIR/run.zarr.part.record   which they are, and the version of each
//   DIR/run.zarr.part.lock     held while a process copies
//
// Objects that an earlier call copied are kept if the server gives the version that they had.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_COPY_FOLDER_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_COPY_FOLDER_H_

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/source/remote/address.h"
#include "core/source/remote/copy_address.h"
#include "core/source/remote/list_objects.h"
#include "core/source/remote/remote_client.h"

namespace isoscope::source {

// Copies one object to a folder that is there, by pieces: for those that are large.
using CopyLargeObject =
    absl::FunctionRef<absl::StatusOr<CopyReport>(const Address& object, const std::string& folder)>;

// Copies the objects below `prefix` that `objects` lists to `folder`/NAME, NAME the last part of the
// prefix. hooks.progress counts objects. Uses 128 MiB of memory, and 300 bytes an object.
//
// ALREADY_EXISTS if the copy is there. INVALID_ARGUMENT: a prefix without a name; keys of which one is
// the folder of another. FAILED_PRECONDITION if another process copies to the same name. Otherwise
// errors as Fetch and io/file.h; what was copied stays for the next call.
absl::StatusOr<CopyReport> CopyFolder(RemoteClient* client, const Address& prefix,
                                      const std::vector<ListedObject>& objects,
                                      const std::string& folder, CopyLargeObject copy_large,
                                      const CopyHooks& hooks,
                                      const base::Cancellation& cancellation);

// The name of a file or folder for the copy of an address: its last part that is not empty.
// INVALID_ARGUMENT: it is no name.
absl::StatusOr<std::string> CopyNameOf(const Address& address);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_COPY_FOLDER_H_
