// Copies an object to a disk, or all below an address (copy_folder.h), so that a copy that was broken
// off goes on where it ended.
//
//   DIR/head.nrrd              appears whole, at the end
//   DIR/head.nrrd.part         the bytes so far
//   DIR/head.nrrd.part.record  whose they are: address, version, size, and how many are on the disk
//   DIR/head.nrrd.part.lock    held while a process copies
//
// A record counts bytes only after they were flushed to the disk. An object whose ETag or size is
// another one is copied from the start. So is an object of a server that knows no ranges, each time.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_COPY_ADDRESS_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_COPY_ADDRESS_H_

#include <cstdint>
#include <functional>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/cancellation.h"
#include "core/source/remote/remote_options.h"

namespace isoscope::source {

struct CopyHooks {
  std::function<void(std::int64_t done_bytes, std::int64_t total_bytes)> progress = {};
  // A sentence for people: that the copy goes on, or why it begins again.
  std::function<void(const std::string& sentence)> note = {};
};

struct CopyReport {
  std::string path;  // of the copy
  std::int64_t size_bytes = 0;
  std::int64_t kept_bytes = 0;    // that an earlier call had copied
  std::int64_t object_count = 0;  // of a folder; 0: one object
  std::string version = {};       // of an object, as ByteSource::version
};

// Copies the object at `address` into `folder`, which is made if its parent is there, under the last
// part of its path. Uses 64 MiB of memory. If the address ends in '/', names a bucket, or no object is
// there, it copies all objects below it, which S3 lists, or an index page: as CopyFolder.
//
// ALREADY_EXISTS if the copy is there. INVALID_ARGUMENT for an address whose last part is no name of
// a file. FAILED_PRECONDITION if another process copies to the same name. Errors of reading as
// OpenAddress, of writing as io/file.h; what was copied stays for the next call.
absl::StatusOr<CopyReport> CopyAddress(absl::string_view address, const std::string& folder,
                                       const RemoteOptions& options, const CopyHooks& hooks,
                                       const base::Cancellation& cancellation);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_COPY_ADDRESS_H_
