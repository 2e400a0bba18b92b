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

using FilesByName = std::map<std::string, MountedFile>;

struct Mounts {
  std::atomic<const FilesByName*> replaced = nullptr;  // of a child: read without the mutex
  std::atomic<bool> has_any = false;  // read without the mutex: local files take no lock
  base::Mutex mutex;
  FilesByName files ABSL_GUARDED_BY(mutex);
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
  if (const FilesByName* const replaced = mounts.replaced.load(std::memory_order_acquire);
      replaced != nullptr) {
    const auto found = replaced->find(path);
    return found == replaced->end() ? std::nullopt : std::optional<MountedFile>(found->second);
  }
  if (!mounts.has_any.load(std::memory_order_acquire)) {
    return std::nullopt;
  }
  const base::MutexLock lock(&mounts.mutex);
  const auto found = mounts.files.find(path);
  return found == mounts.files.end() ? std::nullopt : std::optional<MountedFile>(found->second);
}

std::vector<MountedFile> AllMounted() {
  Mounts& mounts = MountsOfProcess();
  std::vector<MountedFile> files;
  if (mounts.has_any.load(std::memory_order_acquire)) {
    const base::MutexLock lock(&mounts.mutex);
    for (const auto& [path, file] : mounts.files) {
      files.push_back(file);
    }
  }
  return files;
}

void ReplaceMounts(std::vector<MountedFile> files) {
  auto* const replaced = new FilesByName;  // until the process ends
  for (MountedFile& file : files) {
    const std::string path = file.file->path();
    (*replaced)[path] = std::move(file);
  }
  MountsOfProcess().replaced.store(replaced, std::memory_order_release);
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
