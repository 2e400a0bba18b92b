// One dataset in the cache: its users, the time of its last use, and its removal.
//
//   head-0123456789abcdef/    an entry: a dataset directory, named by CacheKey
//     .cache-entry              text: the path of the source volume, one line
//                               time of change: the last use of the entry
//                               flock: shared by every process that uses the entry, exclusive for
//                               the one that removes it
//     .cache-note               text: a line that each use of the entry prints; not always there
//     .cache-damaged            there if a block or a page of the index was found to be damaged
//     manifest.json, ...
//
// To remove an entry, a process locks it exclusively and renames it into a work folder. A process
// that waited for the shared lock finds that its locked file is no longer the one at the path, and
// treats the entry as absent. An older entry without a .cache-entry gets one at its next use.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_CACHE_ENTRY_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_CACHE_ENTRY_H_

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace isoscope::cli {

// Folders of the cache in which an entry is made or removed (io::WorkFolder) begin so.
inline constexpr absl::string_view kWorkPrefix = ".making-";

// Returns true if `name` has the form of CacheKey, "...-" and 16 hexadecimal digits. Other names in
// the cache's folder are never removed.
bool IsEntryName(absl::string_view name);

// Keeps an entry from being removed while the lock lives.
class EntryLock {
 public:
  EntryLock() = default;  // holds nothing
  explicit EntryLock(int descriptor) : descriptor_(descriptor) {}
  ~EntryLock();
  EntryLock(EntryLock&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}
  EntryLock& operator=(EntryLock&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    return *this;
  }
  EntryLock(const EntryLock&) = delete;
  EntryLock& operator=(const EntryLock&) = delete;

 private:
  int descriptor_ = -1;
};

// Locks the entry in `directory` for use, and sets the time of its last use to now. `source`: the
// path to write into .cache-entry. NOT_FOUND if there is no such entry, or no longer. If the file
// can't be locked or created (a full disk, a file system without locks), the lock is empty: the
// entry can be used all the same.
absl::StatusOr<EntryLock> UseEntry(const std::string& directory, absl::string_view source);

struct CacheEntry {
  std::string name;
  std::string source = {};  // path; only a file name for entries that never had a .cache-entry
  std::int64_t size_bytes = 0;
  absl::Time last_used = {};
  bool is_in_use = false;
  bool is_damaged = false;  // it has no manifest that can be read, or lacks what that names
};

// Returns all entries, most recently used first. Errors as of reading the folder.
absl::StatusOr<std::vector<CacheEntry>> ListEntries(const std::string& cache_directory);
std::int64_t TotalBytes(const std::vector<CacheEntry>& entries);

// Marks an entry as damaged, so that the next process that wants it makes it anew.
void MarkDamaged(const std::string& directory);
bool IsMarkedDamaged(const std::string& directory);

// A line for people about an entry, which each use of it prints. "": there is none.
absl::Status WriteNote(const std::string& directory, absl::string_view note);
std::string ReadNote(const std::string& directory);

// Removes an entry. False: a process uses it, and it stays. True: it is gone, by this or another
// process.
absl::StatusOr<bool> RemoveEntry(const std::string& cache_directory, const std::string& name);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_CACHE_ENTRY_H_
