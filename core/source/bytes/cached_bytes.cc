// All files of a process share one pool of blocks: its bound does not grow with their number.
//
//   kept        its bytes are returned
//   in flight   another reader asks for it: wait until it is there, or its request has failed
//   else        ask for it, and for those behind it, without the mutex
//
// A reader waits for the blocks that it wants, and for no other reader. After a failed request each
// reader that waited asks by itself.

#include "core/source/bytes/cached_bytes.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <list>
#include <map>
#include <set>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/mutex.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

using BlockKey = std::pair<std::int64_t, std::int64_t>;  // file, number within it
using BlockBytes = std::shared_ptr<const std::string>;

// The blocks of all files. Thread-safe.
class BlockPool {
 public:
  static BlockPool& OfProcess() {
    static auto* const pool = new BlockPool;
    return *pool;
  }

  // Returns the block once it is kept. Null: the caller asks for the blocks [first.second, *end) of
  // the file, and calls Release, even after an exception: `*end` grows with each block that is
  // claimed, from first.second on, at most to `max_end`.
  absl::StatusOr<BlockBytes> FindOrClaim(const BlockKey& first, std::int64_t max_end,
                                         std::int64_t* end) ABSL_LOCKS_EXCLUDED(mutex_) {
    BlockBytes found;
    ISOSCOPE_RETURN_IF_ERROR(base::AwaitOrCancelled(
        base::ProcessInterrupt(), &mutex_, &landed_, [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
          if (const auto kept = places_.find(first); kept != places_.end()) {
            blocks_.splice(blocks_.begin(), blocks_, kept->second);
            found = kept->second->bytes;
            return true;
          }
          for (BlockKey key = first; key.second < max_end; ++key.second) {
            if (places_.contains(key) || !in_flight_.insert(key).second) {
              break;
            }
            *end = key.second + 1;
          }
          return *end > first.second;
        }));
    return found;
  }
  void Release(const BlockKey& first, std::int64_t end) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    for (std::int64_t i = first.second; i < end; ++i) {
      in_flight_.erase({first.first, i});
    }
    landed_.SignalAll();
  }

  // Keeps a block that the caller has claimed.
  void Keep(const BlockKey& key, BlockBytes bytes) ABSL_LOCKS_EXCLUDED(mutex_) {
    std::list<Block> added;
    added.push_back({key, std::move(bytes)});
    const base::MutexLock lock(&mutex_);
    places_.emplace(key, added.begin());
    blocks_.splice(blocks_.begin(), added);
    while (static_cast<std::int64_t>(blocks_.size()) > kMaxCachedBlocks) {
      places_.erase(blocks_.back().key);
      blocks_.pop_back();
    }
  }

  // Forgets a file that nobody reads any more.
  void Erase(std::int64_t file) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    auto place = places_.lower_bound({file, 0});
    while (place != places_.end() && place->first.first == file) {
      blocks_.erase(place->second);
      place = places_.erase(place);
    }
  }

  [[nodiscard]] std::int64_t block_count() const ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return static_cast<std::int64_t>(blocks_.size());
  }

 private:
  struct Block {
    BlockKey key;
    BlockBytes bytes = {};
  };

  mutable base::Mutex mutex_;
  base::CondVar landed_;
  std::list<Block> blocks_ ABSL_GUARDED_BY(mutex_);  // the last one used first
  std::map<BlockKey, std::list<Block>::iterator> places_ ABSL_GUARDED_BY(mutex_);
  std::set<BlockKey> in_flight_ ABSL_GUARDED_BY(mutex_);
};

class CachedBytes final : public io::RandomAccessFile {
 public:
  CachedBytes(std::shared_ptr<const ByteSource> bytes, std::string path)
      : bytes_(std::move(bytes)), path_(std::move(path)), file_(NextFile()) {}
  ~CachedBytes() override { BlockPool::OfProcess().Erase(file_); }
  CachedBytes(const CachedBytes&) = delete;
  CachedBytes& operator=(const CachedBytes&) = delete;

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckRange(*this, offset, size));
    if (static_cast<std::int64_t>(size) >= kDirectReadBytes) {
      return bytes_->ReadAt(offset, size, out, base::ProcessInterrupt());
    }
    while (size > 0) {
      ISOSCOPE_ASSIGN_OR_RETURN(const BlockBytes block, Get(offset / kCachedBlockBytes));
      const auto within = static_cast<std::size_t>(offset % kCachedBlockBytes);
      const std::size_t take = std::min(size, block->size() - within);
      out = std::copy_n(block->data() + within, take, out);
      offset += static_cast<std::int64_t>(take);
      size -= take;
    }
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return bytes_->size_bytes(); }
  [[nodiscard]] const std::string& path() const override { return path_; }

 private:
  static std::int64_t NextFile() {
    static std::atomic<std::int64_t> next = 0;
    return next++;
  }

  // Blocks of the next request, if it begins at `number`.
  std::int64_t AheadOf(std::int64_t number) const ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return number == next_ ? std::min(2 * ahead_, kMaxAheadBlocks) : 1;
  }

  absl::StatusOr<BlockBytes> Get(std::int64_t number) const ABSL_LOCKS_EXCLUDED(mutex_) {
    BlockPool& pool = BlockPool::OfProcess();
    class Claim {
     public:
      explicit Claim(const BlockKey& of) : first(of), end(of.second) {}
      ~Claim() {
        if (end > first.second) {
          BlockPool::OfProcess().Release(first, end);
        }
      }
      Claim(const Claim&) = delete;
      Claim& operator=(const Claim&) = delete;

      const BlockKey first;
      std::int64_t end;
    };
    // 1. A reader that goes on where the last request ended will want more.
    const std::int64_t ahead = AheadOf(number);
    const std::int64_t block_count = (size_bytes() + kCachedBlockBytes - 1) / kCachedBlockBytes;
    Claim claim({file_, number});
    ISOSCOPE_ASSIGN_OR_RETURN(
        BlockBytes wanted,
        pool.FindOrClaim(claim.first, std::min(number + ahead, block_count), &claim.end));
    if (wanted != nullptr) {
      return wanted;
    }
    {
      const base::MutexLock lock(&mutex_);
      ahead_ = ahead;
      next_ = claim.end;
    }
    // 2. One request.
    const std::int64_t begin_byte = number * kCachedBlockBytes;
    const std::int64_t end_byte = std::min(claim.end * kCachedBlockBytes, size_bytes());
    std::string bytes(static_cast<std::size_t>(end_byte - begin_byte), '\0');
    ISOSCOPE_RETURN_IF_ERROR(
        bytes_->ReadAt(begin_byte, bytes.size(), bytes.data(), base::ProcessInterrupt()));
    // 3. Blocks, the wanted one as the last used.
    for (std::int64_t i = claim.end; i-- > number;) {
      wanted = std::make_shared<const std::string>(
          bytes.substr(static_cast<std::size_t>((i - number) * kCachedBlockBytes),
                       static_cast<std::size_t>(kCachedBlockBytes)));
      pool.Keep({file_, i}, wanted);
    }
    return wanted;
  }

  const std::shared_ptr<const ByteSource> bytes_;
  const std::string path_;
  const std::int64_t file_;  // in the pool

  mutable base::Mutex mutex_;
  mutable std::int64_t next_ ABSL_GUARDED_BY(mutex_) = -1;  // block behind the last request
  mutable std::int64_t ahead_ ABSL_GUARDED_BY(mutex_) = 1;  // blocks of the last request
};

}  // namespace

std::unique_ptr<io::RandomAccessFile> MakeCachedFile(std::shared_ptr<const ByteSource> bytes,
                                                     std::string path) {
  return std::make_unique<CachedBytes>(std::move(bytes), std::move(path));
}

std::int64_t CachedBlockCount() { return BlockPool::OfProcess().block_count(); }

}  // namespace isoscope::source
