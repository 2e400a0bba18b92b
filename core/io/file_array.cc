#include "core/io/file_array.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "absl/strings/str_cat.h"
#include <sys/mman.h>

#include "core/base/units.h"
#include "core/io/file.h"
#include "core/io/scratch_file.h"

namespace isoscope::io {
namespace {

constexpr auto kMinGrowthBytes = static_cast<std::size_t>(4 * base::kMiB);

}  // namespace

absl::StatusOr<std::unique_ptr<MappedScratch>> MappedScratch::Create(const std::string& directory) {
  ISOSCOPE_ASSIGN_OR_RETURN(UnnamedFile file, CreateUnnamedFile(directory));
  return std::unique_ptr<MappedScratch>(new MappedScratch(file.descriptor, std::move(file.path)));
}

MappedScratch::~MappedScratch() {
  if (data_ != nullptr) {
    munmap(data_, capacity_);
  }
  close(fd_);
}

absl::Status MappedScratch::Reserve(std::size_t size) {
  if (size <= capacity_) {
    return absl::OkStatus();
  }
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  std::size_t capacity = std::max({size, capacity_ + capacity_ / 4, capacity_ + kMinGrowthBytes});
  capacity = (capacity + page - 1) / page * page;
  const int error =
      posix_fallocate(fd_, static_cast<off_t>(capacity_), static_cast<off_t>(capacity - capacity_));
  if (error != 0) {
    return ErrnoToStatus(error, absl::StrCat("reserve ", capacity, " bytes of disk for"), path_);
  }
  void* const mapped = data_ == nullptr
                           ? mmap(nullptr, capacity, PROT_READ | PROT_WRITE, MAP_SHARED, fd_, 0)
                           : mremap(data_, capacity_, capacity, MREMAP_MAYMOVE);
  if (mapped == MAP_FAILED) {
    return ErrnoToStatus(errno, "map", path_);
  }
  data_ = static_cast<char*>(mapped);
  capacity_ = capacity;
  return absl::OkStatus();
}

}  // namespace isoscope::io
