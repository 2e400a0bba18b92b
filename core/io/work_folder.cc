// Make:
//
//   1. mkdir a new name with random letters.
//   2. Create the file lock.new, lock it, and write this machine's record into it.
//   3. Rename it to lock. A free lock with this name is a leftover, so it is locked before.
//
// RemoveLeftovers looks at each folder with the prefix. HasEnded decides by the lock and record:
//
//   lock held by a process                       stays
//   free, record of this boot                    removed
//   free, this machine and host, older boot      removed if nothing changed since this boot
//   free, no record                              removed a day after the last change
//   free, another machine                        stays
//   no lock file, empty or with lock.new alone   removed 10 minutes after the last change

#include "core/io/work_folder.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <system_error>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/sysinfo.h>

#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"

namespace isoscope::io {
namespace {

namespace fs = std::filesystem;

constexpr const char* kLockName = "lock";
constexpr const char* kUnlockedName = "lock.new";  // before it is locked
constexpr std::int64_t kMaxRecordBytes = 4096;
// A folder without a lock is either being made at this moment, or its process was killed then.
constexpr absl::Duration kMakingTime = absl::Minutes(10);
// Earlier programs wrote no record. Nobody makes a dataset for a day without writing to it.
constexpr absl::Duration kUnrecordedTime = absl::Hours(24);

// Not ReadWholeFile: the kernel says that its own files have no bytes.
std::string FirstLineOf(const char* path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line;
}

std::string TextOf(const MachineRecord& record) {
  return absl::StrCat("boot ", record.boot, "\nmachine ", record.machine, "\nhost ", record.host,
                      "\n");
}

MachineRecord ParseRecord(absl::string_view text) {
  std::map<std::string, std::string> values;
  for (const absl::string_view line : absl::StrSplit(text, '\n', absl::SkipEmpty())) {
    const std::pair<std::string, std::string> pair = absl::StrSplit(line, absl::MaxSplits(' ', 1));
    values.insert(pair);
  }
  return {.boot = values["boot"], .machine = values["machine"], .host = values["host"]};
}

bool Lock(int descriptor) {
  while (flock(descriptor, LOCK_EX | LOCK_NB) != 0) {
    if (errno != EINTR) {
      return false;
    }
  }
  return true;
}

absl::Time LastChangeOf(const fs::path& path) {
  struct stat info {};
  return lstat(path.c_str(), &info) == 0
             ? std::max(absl::TimeFromTimespec(info.st_mtim), absl::TimeFromTimespec(info.st_ctim))
             : absl::InfinitePast();
}

// Returns the last change of the folder or of anything in it.
absl::Time LastChangeIn(const fs::path& folder) {
  absl::Time last = LastChangeOf(folder);
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    last = std::max(last, LastChangeOf(entry->path()));
  }
  return error ? absl::InfiniteFuture() : last;
}

absl::Time StartOfMachine() {
  struct sysinfo info {};
  return sysinfo(&info) == 0 ? absl::Now() - absl::Seconds(info.uptime) : absl::InfinitePast();
}

// Removes a work folder. A process that is killed meanwhile leaves the lock, so that others know
// whose remains these are.
absl::Status RemoveLockLast(const std::string& path) {
  std::error_code error;
  std::vector<fs::path> others;
  for (fs::directory_iterator entry(path, error), end; !error && entry != end;
       entry.increment(error)) {
    if (entry->path().filename() != kLockName) {
      others.push_back(entry->path());
    }
  }
  for (const fs::path& other : others) {
    ISOSCOPE_RETURN_IF_ERROR(RemoveRecursively(other.string()));
  }
  return RemoveRecursively(path);
}

bool IsBeingMade(const fs::path& folder) {
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (entry->path().filename() != kUnlockedName) {
      return false;
    }
  }
  return !error;
}

// Not mkdtemp, whose folders are for this user alone: a dataset keeps the rights of its folder.
absl::StatusOr<std::string> MakeNewFolder(const std::string& parent, const std::string& prefix) {
  constexpr absl::string_view kLetters = "abcdefghijklmnopqrstuvwxyz0123456789";
  constexpr int kMaxTries = 100;
  std::random_device random;
  for (int i = 0;; ++i) {
    std::string path = absl::StrCat(parent, "/", prefix);
    for (int letter = 0; letter < 6; ++letter) {
      path += kLetters[random() % kLetters.size()];
    }
    if (mkdir(path.c_str(), S_IRWXU | S_IRWXG | S_IRWXO) == 0) {
      return path;
    }
    if (errno != EEXIST || i == kMaxTries) {
      return ErrnoToStatus(errno, "can't make a folder in", parent);
    }
  }
}

// Whether the process of a folder has ended. `lock` is the descriptor of its lock.
bool HasEnded(const fs::path& folder, int lock, const MachineRecord& machine) {
  if (!Lock(lock)) {
    return false;
  }
  const MachineRecord record =
      ParseRecord(ReadWholeFile((folder / kLockName).string(), kMaxRecordBytes).value_or(""));
  if (record == MachineRecord()) {
    return LastChangeIn(folder) < absl::Now() - kUnrecordedTime;
  }
  if (!record.boot.empty() && record.boot == machine.boot) {
    return true;
  }
  const bool is_this_machine = !record.machine.empty() && record.machine == machine.machine &&
                               !record.host.empty() && record.host == machine.host;
  return is_this_machine && LastChangeIn(folder) < StartOfMachine();
}

}  // namespace

MachineRecord ThisMachine() {
  std::array<char, 256> host{};
  if (gethostname(host.data(), host.size() - 1) != 0) {
    host[0] = '\0';
  }
  return {.boot = FirstLineOf("/proc/sys/kernel/random/boot_id"),
          .machine = FirstLineOf("/etc/machine-id"),
          .host = host.data()};
}

absl::StatusOr<WorkFolder> WorkFolder::Make(const std::string& parent, const std::string& prefix) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string path, MakeNewFolder(parent, prefix));
  // The file gets its name once it is locked: other processes would take a free lock for a
  // leftover.
  const std::string unlocked = absl::StrCat(path, "/", kUnlockedName);
  const int lock = open(unlocked.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (lock < 0) {
    const absl::Status status = ErrnoToStatus(errno, "can't make", unlocked);
    RemoveRecursively(path).IgnoreError();  // the first error is the one to report
    return status;
  }
  WorkFolder folder(path, lock);
  const std::string record = TextOf(ThisMachine());
  if (!Lock(lock) ||
      write(lock, record.data(), record.size()) != static_cast<ssize_t>(record.size())) {
    RemoveRecursively(unlocked).IgnoreError();  // no lock: nobody takes the folder for a leftover
    return folder;
  }
  if (rename(unlocked.c_str(), absl::StrCat(path, "/", kLockName).c_str()) != 0) {
    return ErrnoToStatus(errno, "can't lock", path);
  }
  return folder;
}

WorkFolder::~WorkFolder() {
  if (!path_.empty()) {
    if (const absl::Status removed = RemoveLockLast(path_); !removed.ok()) {
      base::LogWarning("work_folder_left", {{"path", path_}, {"status", removed}});
    }
  }
  if (lock_ >= 0) {
    close(lock_);
  }
}

absl::Status WorkFolder::MoveTo(const std::string& to) {
  ISOSCOPE_RETURN_IF_ERROR(RenamePath(path_, to));
  path_.clear();
  return RemoveRecursively(absl::StrCat(to, "/", kLockName));
}

void RemoveLeftLock(const std::string& directory) {
  const std::string path = absl::StrCat(directory, "/", kLockName);
  const int lock = open(path.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW);
  if (lock < 0) {
    return;
  }
  if (Lock(lock)) {
    unlink(path.c_str());
  }
  close(lock);
}

void RemoveLeftovers(const std::string& parent, absl::string_view prefix,
                     const MachineRecord& machine) {
  std::error_code error;
  std::vector<fs::path> folders;
  for (fs::directory_iterator entry(parent, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code unknown;
    if (absl::StartsWith(entry->path().filename().string(), prefix) &&
        entry->symlink_status(unknown).type() == fs::file_type::directory) {
      folders.push_back(entry->path());
    }
  }
  for (const fs::path& folder : folders) {
    const int lock = open((folder / kLockName).c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW);
    const bool has_ended =
        lock >= 0 ? HasEnded(folder, lock, machine)
                  : IsBeingMade(folder) && LastChangeIn(folder) < absl::Now() - kMakingTime;
    if (has_ended) {
      RemoveLockLast(folder.string()).IgnoreError();  // the next maker tries again
    }
    if (lock >= 0) {
      close(lock);
    }
  }
}

void RemoveLeftovers(const std::string& parent, absl::string_view prefix) {
  RemoveLeftovers(parent, prefix, ThisMachine());
}

}  // namespace isoscope::io
