// Files that have a name and are on no disk of this machine: objects at an address, under it. Readers
// open them by OpenRandomAccessFile (file.h), as any other file. Only what was mounted can be
// opened, so that no name in a file leads to another place.

#ifndef ISOSCOPE_CORE_IO_MOUNTED_FILE_H_
#define ISOSCOPE_CORE_IO_MOUNTED_FILE_H_

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"

#include "core/io/file.h"

namespace isoscope::io {

struct MountedFile {
  std::shared_ptr<const RandomAccessFile> file = {};
  // Text that differs if the bytes do, as far as the place tells.
  std::string version = {};
  // False: other bytes may have the same version.
  bool tells_all = true;
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
