// A folder for an unfinished operation: a dataset that is being made, or removed. Its lock shows
// other processes that its own process lives, and what a killed process has left can be removed.
//
//   flow.partial-a8Xd3q/
//     lock    locked by the process that works here; says on which machine that is:
//               boot 5f1c...        of /proc/sys/kernel/random/boot_id
//               machine 9a80...     of /etc/machine-id
//               host node-7
//
// A free lock alone does not tell that the process has ended, because locks of network file systems
// may be known on one machine only. So only folders of this machine are removed.

#ifndef ISOSCOPE_CORE_IO_WORK_FOLDER_H_
#define ISOSCOPE_CORE_IO_WORK_FOLDER_H_

#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::io {

// Folder and lock end with the object; after a crash the folder stays, and its lock is free.
// Thread-compatible.
class WorkFolder {
 public:
  // Makes `parent`/`prefix`XXXXXX, whose last characters are random. On a file system without locks
  // it has none, and what a crash leaves stays.
  static absl::StatusOr<WorkFolder> Make(const std::string& parent, const std::string& prefix);
  ~WorkFolder();
  WorkFolder(WorkFolder&& other) noexcept
      : path_(std::exchange(other.path_, "")), lock_(std::exchange(other.lock_, -1)) {}
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;
  WorkFolder& operator=(WorkFolder&&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }

  // Gives the folder the name `to`, without the lock: it is no work folder any more, and stays. As
  // RenamePath.
  absl::Status MoveTo(const std::string& to);

 private:
  WorkFolder(std::string path, int lock) : path_(std::move(path)), lock_(lock) {}

  std::string path_;  // empty: moved away
  int lock_;          // a descriptor, or -1
};

// The machine that this process runs on, as the lock has it.
struct MachineRecord {
  std::string boot;     // "": unknown
  std::string machine;  // "": unknown
  std::string host;

  friend bool operator==(const MachineRecord&, const MachineRecord&) = default;
};
MachineRecord ThisMachine();

// Removes the lock in a folder that has got its name by MoveTo, if the process was killed before it
// could. A lock that is held stays: its process removes it.
void RemoveLeftLock(const std::string& directory);

// Removes the work folders in `parent` whose names begin with `prefix`, and whose processes have
// ended: those that began on this machine, since its last start with a lock that is free, before it
// with nothing in them that has changed since. Those of other machines stay, and folders that are
// no work folders.
void RemoveLeftovers(const std::string& parent, absl::string_view prefix);
// The same as if this were another machine, for tests.
void RemoveLeftovers(const std::string& parent, absl::string_view prefix,
                     const MachineRecord& machine);

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_WORK_FOLDER_H_
