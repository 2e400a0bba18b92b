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

  // Blocks [begin, end) of a file that are asked for.
  struct Claim {
    std::int64_t file = 0;
    std::int64_t begin = 0;
    std::int64_t end = 0;
  };

  // Returns block `wanted` of claim->file once it is kept. Null: the caller asks for the blocks of the
  // claim, and calls Release, even after an exception. They are `wanted` and its neighbours from
  // `least` on and below `most`, as far as nobody has them. REQUIRES: the claim is empty, at `wanted`.
  absl::StatusOr<BlockBytes> FindOrClaim(std::int64_t wanted, std::int64_t least, std::int64_t most,
                                         Claim* claim) ABSL_LOCKS_EXCLUDED(mutex_) {
    BlockBytes found;
    ISOSCOPE_RETURN_IF_ERROR(base::AwaitOrCancelled(
        base::ProcessInterrupt(), &mutex_, &landed_, [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
          if (const auto kept = places_.find({claim->file, wanted}); kept != places_.end()) {
            blocks_.splice(blocks_.begin(), blocks_, kept->second);
            found = kept->second->bytes;
            return true;
          }
          while (claim->end < most && Take({claim->file, claim->end})) {
            ++claim->end;
          }
          while (claim->end > wanted && claim->begin > least &&
                 Take({claim->file, claim->begin - 1})) {
            --claim->begin;
          }
          return claim->end > wanted;
        }));
    return found;
  }
  void Release(const Claim& claim) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    for (std::int64_t i = claim.begin; i < claim.end; ++i) {
      in_flight_.erase({claim.file, i});
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

  // Whether the caller has to ask for the block, because nobody has it.
  bool Take(const BlockKey& key) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return !places_.contains(key) && in_flight_.insert(key).second;
  }

  mutable base::Mutex mutex_;
  base::CondVar landed_;
  std::list<Block> blocks_ ABSL_GUARDED_BY(mutex_);  // the last one used first
  std::map<BlockKey, std::list<Block>::iterator> places_ ABSL_GUARDED_BY(mutex_);
  std::set<BlockKey> in_flight_ ABSL_GUARDED_BY(mutex_);
};

class CachedBytes final : public io::RandomAccessFile {
 public:
  CachedBytes(std::shared_ptr<const ByteSource> bytes, std::string path, std::string start)
      : bytes_(std::move(bytes)), path_(std::move(path)), file_(NextFile()) {
    if (!start.empty() && static_cast<std::int64_t>(start.size()) ==
                              std::min(kCachedBlockBytes, bytes_->size_bytes())) {
      BlockPool::OfProcess().Keep({file_, 0},
                                  std::make_shared<const std::string>(std::move(start)));
      next_ = 1;
    }
  }
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

  // The next request, if it is for `number`.
  struct Plan {
    std::int64_t least = 0;  // the first block of the request
    std::int64_t ahead = 1;  // blocks from `number` on
  };
  // A reader that goes on where the last request ended, or a few blocks behind, will want more; what
  // it has left out is often wanted later.
  Plan PlanFor(std::int64_t number) const ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return next_ >= 0 && number >= next_ && number <= next_ + kMaxStepBlocks
               ? Plan{.least = next_, .ahead = std::min(2 * ahead_, kMaxAheadBlocks)}
               : Plan{.least = number, .ahead = 1};
  }

  absl::StatusOr<BlockBytes> Get(std::int64_t number) const ABSL_LOCKS_EXCLUDED(mutex_) {
    BlockPool& pool = BlockPool::OfProcess();
    class ClaimScope {
     public:
      explicit ClaimScope(const BlockPool::Claim& at) : claim(at) {}
      ~ClaimScope() {
        if (claim.end > claim.begin) {
          BlockPool::OfProcess().Release(claim);
        }
      }
      ClaimScope(const ClaimScope&) = delete;
      ClaimScope& operator=(const ClaimScope&) = delete;

      BlockPool::Claim claim;
    };
    // 1. Which blocks.
    const Plan plan = PlanFor(number);
    const std::int64_t block_count = (size_bytes() + kCachedBlockBytes - 1) / kCachedBlockBytes;
    ClaimScope scope({.file = file_, .begin = number, .end = number});
    const BlockPool::Claim& claim = scope.claim;
    ISOSCOPE_ASSIGN_OR_RETURN(
        BlockBytes wanted,
        pool.FindOrClaim(number, plan.least, std::min(number + plan.ahead, block_count),
                         &scope.claim));
    if (wanted != nullptr) {
      return wanted;
    }
    {
      const base::MutexLock lock(&mutex_);
      ahead_ = plan.ahead;
      next_ = claim.end;
    }
    // 2. One request.
    const std::int64_t begin_byte = claim.begin * kCachedBlockBytes;
    const std::int64_t end_byte = std::min(claim.end * kCachedBlockBytes, size_bytes());
    std::string bytes(static_cast<std::size_t>(end_byte - begin_byte), '\0');
    ISOSCOPE_RETURN_IF_ERROR(
        bytes_->ReadAt(begin_byte, bytes.size(), bytes.data(), base::ProcessInterrupt()));
    // 3. Blocks, the wanted one as the last used.
    const auto keep = [&](std::int64_t block) {
      auto kept = std::make_shared<const std::string>(
          bytes.substr(static_cast<std::size_t>((block - claim.begin) * kCachedBlockBytes),
                       static_cast<std::size_t>(kCachedBlockBytes)));
      pool.Keep({file_, block}, kept);
      return kept;
    };
    for (std::int64_t block = claim.end; block-- > claim.begin;) {
      if (block != number) {
        keep(block);
      }
    }
    return keep(number);
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
                                                     std::string path, std::string start) {
  return std::make_unique<CachedBytes>(std::move(bytes), std::move(path), std::move(start));
}

std::int64_t CachedBlockCount() { return BlockPool::OfProcess().block_count(); }

}  // namespace isoscope::source
