#include "core/source/source_stamps.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <sys/stat.h>

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/io/file_stamp.h"
#include "core/io/mounted_file.h"

namespace isoscope::source {
namespace {

// Linux has ticks of 1 to 10 ms.
constexpr absl::Duration kTick = absl::Milliseconds(20);
// Times without nanoseconds are those of a file system that keeps none.
constexpr absl::Duration kCoarseTick = absl::Seconds(2);

// Returns the time until the clock of the file's disk has surely moved on since its last change.
absl::Duration TimeToNextTick(const io::FileStamp& stamp, absl::Time now) {
  const bool is_coarse = stamp.changed.nanoseconds == 0 && stamp.modified.nanoseconds == 0;
  const absl::Duration tick = is_coarse ? kCoarseTick : kTick;
  const absl::Time changed =
      absl::FromUnixSeconds(stamp.changed.seconds) + absl::Nanoseconds(stamp.changed.nanoseconds);
  // The clock of a server may be ahead of ours.
  return changed + tick <= now ? absl::ZeroDuration() : tick;
}

std::string TextOf(const io::FileTime& time) {
  return absl::StrCat(time.seconds, ".", time.nanoseconds);
}

// A page of a memory map changes the file's times as it is first written, and again only once it
// was written back. The system does that within a minute. So what has changed lately is written
// back.
void WriteBackIfNew(const std::string& path, const struct stat& info, absl::Time now) {
  constexpr absl::Duration kOld = absl::Minutes(5);
  if (!S_ISREG(info.st_mode) || now - absl::TimeFromTimespec(info.st_mtim) > kOld) {
    return;
  }
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (file >= 0) {
    sync_file_range(
        file, 0, 0,
        SYNC_FILE_RANGE_WAIT_BEFORE | SYNC_FILE_RANGE_WRITE | SYNC_FILE_RANGE_WAIT_AFTER);
    close(file);
  }
}

}  // namespace

absl::StatusOr<std::string> ResolvedPath(const std::string& path) {
  if (io::IsAddressText(path)) {
    return path;
  }
  std::error_code error;
  std::string resolved = std::filesystem::weakly_canonical(path, error).string();
  if (error) {
    return io::ErrnoToStatus(error.value(), "can't resolve", path);
  }
  return resolved;
}

absl::StatusOr<std::string> StampsOf(const std::vector<std::string>& files) {
  std::vector<std::string> paths;
  paths.reserve(files.size());
  absl::Duration wait = absl::ZeroDuration();
  const absl::Time now = absl::Now();  // files have times of this clock
  for (const std::string& file : files) {
    ISOSCOPE_ASSIGN_OR_RETURN(paths.emplace_back(), ResolvedPath(file));
    if (io::IsMounted(file)) {
      continue;
    }
    struct stat info {};
    if (stat(paths.back().c_str(), &info) != 0) {
      return io::ErrnoToStatus(errno, "can't look at", paths.back());
    }
    WriteBackIfNew(paths.back(), info, now);
    wait = std::max(wait, TimeToNextTick(io::StampOf(paths.back()), now));
  }
  absl::SleepFor(wait);
  std::string text;
  for (const std::string& path : paths) {
    if (const auto mounted = io::FindMounted(path); mounted.has_value()) {
      absl::StrAppend(&text, path, "\n", mounted->file->size_bytes(), " ", mounted->version, "\n");
      continue;
    }
    const io::FileStamp stamp = io::StampOf(path);
    absl::StrAppend(&text, path, "\n", stamp.inode, " ", stamp.size, " ", TextOf(stamp.modified),
                    " ", TextOf(stamp.changed), "\n");
  }
  return text;
}

bool StampsTellAll(const std::vector<std::string>& files) {
  return std::all_of(files.begin(), files.end(), [](const std::string& file) {
    const auto mounted = io::FindMounted(file);
    return !mounted.has_value() || mounted->tells_all;
  });
}

}  // namespace isoscope::source
