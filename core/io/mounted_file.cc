#include "core/io/mounted_file.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <map>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/ascii.h"

#include "core/base/mutex.h"

namespace isoscope::io {
namespace {

struct Mounts {
  std::atomic<bool> has_any = false;  // read without the mutex: local files take no lock
  base::Mutex mutex;
  std::map<std::string, MountedFile> files ABSL_GUARDED_BY(mutex);
};

Mounts& MountsOfProcess() {
  static auto* const mounts = new Mounts;
  return *mounts;
}

}  // namespace

void MountFile(MountedFile file) {
  Mounts& mounts = MountsOfProcess();
  const base::MutexLock lock(&mounts.mutex);
  const std::string path = file.file->path();
  mounts.files[path] = std::move(file);
  mounts.has_any.store(true, std::memory_order_release);
}

std::optional<MountedFile> FindMounted(const std::string& path) {
  Mounts& mounts = MountsOfProcess();
  if (!mounts.has_any.load(std::memory_order_acquire)) {
    return std::nullopt;
  }
  const base::MutexLock lock(&mounts.mutex);
  const auto found = mounts.files.find(path);
  return found == mounts.files.end() ? std::nullopt : std::optional<MountedFile>(found->second);
}

bool IsMounted(const std::string& path) { return FindMounted(path).has_value(); }

bool IsAddressText(absl::string_view path) {
  const std::size_t colon = path.find("://");
  return colon != absl::string_view::npos && colon > 1 &&
         absl::ascii_isalpha(static_cast<unsigned char>(path[0])) &&
         std::all_of(path.begin(), path.begin() + static_cast<std::ptrdiff_t>(colon), [](char c) {
           return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '+' || c == '-' ||
                  c == '.';
         });
}

}  // namespace isoscope::io
