#include "core/source/bytes/cached_bytes.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <list>
#include <unordered_map>
#include <utility>

#include "absl/base/thread_annotations.h"

#include "core/base/mutex.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

class CachedBytes final : public io::RandomAccessFile {
 public:
  CachedBytes(std::shared_ptr<const ByteSource> bytes, std::string path)
      : bytes_(std::move(bytes)), path_(std::move(path)) {}

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckRange(*this, offset, size));
    if (static_cast<std::int64_t>(size) >= kDirectReadBytes) {
      return bytes_->ReadAt(offset, size, out, base::ProcessInterrupt());
    }
    const base::MutexLock lock(&mutex_);
    while (size > 0) {
      const std::int64_t block = offset / kCachedBlockBytes;
      ISOSCOPE_RETURN_IF_ERROR(Keep(block));
      const std::string& kept = blocks_.front().bytes;
      const auto within = static_cast<std::size_t>(offset % kCachedBlockBytes);
      const std::size_t take = std::min(size, kept.size() - within);
      std::memcpy(out, kept.data() + within, take);
      offset += static_cast<std::int64_t>(take);
      out += take;
      size -= take;
    }
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return bytes_->size_bytes(); }
  [[nodiscard]] const std::string& path() const override { return path_; }

 private:
  struct Block {
    std::int64_t number = 0;
    std::string bytes = {};
  };

  // Makes the block the first of blocks_; reads it, with those behind it, if it is not kept.
  absl::Status Keep(std::int64_t number) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (const auto found = by_number_.find(number); found != by_number_.end()) {
      blocks_.splice(blocks_.begin(), blocks_, found->second);
      return absl::OkStatus();
    }
    // 1. A reader that goes on where the last request ended will want more.
    const bool goes_on = number >= next_ && number <= next_ + kMaxStepBlocks && next_ >= 0;
    ahead_ = goes_on ? std::min(2 * ahead_, kMaxAheadBlocks) : 1;
    const std::int64_t wanted = number;
    while (goes_on && number > next_ && !by_number_.contains(number - 1)) {
      --number;  // what was passed is often wanted later
    }
    const std::int64_t block_count = (size_bytes() + kCachedBlockBytes - 1) / kCachedBlockBytes;
    std::int64_t end = std::min(wanted + ahead_, block_count);
    for (std::int64_t i = wanted + 1; i < end; ++i) {
      if (by_number_.contains(i)) {
        end = i;
      }
    }
    // 2. One request.
    const std::int64_t begin_byte = number * kCachedBlockBytes;
    const std::int64_t end_byte = std::min(end * kCachedBlockBytes, size_bytes());
    std::string bytes(static_cast<std::size_t>(end_byte - begin_byte), '\0');
    ISOSCOPE_RETURN_IF_ERROR(
        bytes_->ReadAt(begin_byte, bytes.size(), bytes.data(), base::ProcessInterrupt()));
    // 3. Blocks, the wanted one in front.
    for (std::int64_t i = end; i-- > number;) {
      blocks_.push_front(
          {i, bytes.substr(static_cast<std::size_t>((i - number) * kCachedBlockBytes),
                           static_cast<std::size_t>(kCachedBlockBytes))});
      by_number_[i] = blocks_.begin();
    }
    blocks_.splice(blocks_.begin(), blocks_, by_number_[wanted]);
    while (static_cast<std::int64_t>(blocks_.size()) > kMaxCachedBlocks) {
      by_number_.erase(blocks_.back().number);
      blocks_.pop_back();
    }
    next_ = end;
    return absl::OkStatus();
  }

  const std::shared_ptr<const ByteSource> bytes_;
  const std::string path_;

  mutable base::Mutex mutex_;
  mutable std::list<Block> blocks_ ABSL_GUARDED_BY(mutex_);  // the last one used first
  mutable std::unordered_map<std::int64_t, std::list<Block>::iterator> by_number_
      ABSL_GUARDED_BY(mutex_);
  mutable std::int64_t next_ ABSL_GUARDED_BY(mutex_) = -1;  // block behind the last request
  mutable std::int64_t ahead_ ABSL_GUARDED_BY(mutex_) = 1;  // blocks of the last request
};

}  // namespace

std::unique_ptr<io::RandomAccessFile> MakeCachedFile(std::shared_ptr<const ByteSource> bytes,
                                                     std::string path) {
  return std::make_unique<CachedBytes>(std::move(bytes), std::move(path));
}

}  // namespace isoscope::source
