// Files that have a name and are on no disk of this machine: objects at an address, under it. Readers
// open them by OpenRandomAccessFile (file.h), as any other file. Only what was mounted can be
// opened, so that no name in a file leads to another place.

#ifndef ISOSCOPE_CORE_IO_MOUNTED_FILE_H_
#define ISOSCOPE_CORE_IO_MOUNTED_FILE_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/types/span.h"

#include "core/base/cancellation.h"
#include "core/io/file.h"

namespace isoscope::io {

// Bytes [offset, offset + size) of a file.
struct FileRange {
  std::int64_t offset = 0;
  std::size_t size = 0;
};
// They go to `out`, which has room for them.
struct FilePiece {
  FileRange range;
  char* out = nullptr;
};

struct MountedFile {
  std::shared_ptr<const RandomAccessFile> file = {};
  // Text that differs if the bytes do, as far as the place tells.
  std::string version = {};
  // False: other bytes may have the same version.
  bool tells_all = true;
  // Reads pieces at once, where the place allows it; errors as file->ReadAt, and CANCELLED. Null: they
  // are read one after the other. Thread-safe.
  std::function<absl::Status(absl::Span<const FilePiece>, const base::Cancellation&)> read_pieces =
      {};
  // Tells which ranges file->ReadAt will be asked for, each as a whole, in this order, so that they
  // are fetched before. A wrong word costs time alone. Null: that helps nothing.
  std::function<void(absl::Span<const FileRange>)> expect_reads = {};
};

// Makes file.file known under its path(), until the process ends or another file takes its place.
// Each open file keeps the bytes that it had. Thread-safe, as the functions below.
void MountFile(MountedFile file);

// Returns the file of that name; not set: none is mounted there. Costs nothing while none is mounted.
std::optional<MountedFile> FindMounted(const std::string& path);
bool IsMounted(const std::string& path);

// All that are mounted.
std::vector<MountedFile> AllMounted();
// In a forked child, whose threads are gone and may have held a lock: `files` take the place of all
// that the parent mounted. Called once, by its only thread; MountFile is not called after it.
void ReplaceMounts(std::vector<MountedFile> files);

// Returns true for text that begins with a scheme, as "https://" does: no path of this machine.
bool IsAddressText(absl::string_view path);

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_MOUNTED_FILE_H_
