// Files of fixed-size pages, each with its own checksum, read through a bounded page cache.
//
// A page has 4096 bytes: 4084 of payload, then the file's tag, the page's number and a CRC-32C of
// all bytes before it (docs/format/interval_tree.md, "Pages"). A page that is damaged, misplaced or
// taken from another file is noticed.

#ifndef ISOSCOPE_CORE_IO_PAGE_FILE_H_
#define ISOSCOPE_CORE_IO_PAGE_FILE_H_

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <string>
#include <unordered_map>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/mutex.h"
#include "core/io/file.h"

namespace isoscope::io {

inline constexpr std::size_t kPageBytes = 4096;
inline constexpr std::size_t kPagePayloadBytes = kPageBytes - 12;

using PageNumber = std::uint32_t;
inline constexpr std::int64_t kMaxPageCount = 0xffffffff;

// Writes pages to a file that it neither owns nor closes. Thread-compatible.
class PageFileWriter {
 public:
  // file: empty, outlives the writer
  // tag:  stored in every page; should be a fingerprint of the whole content
  PageFileWriter(WritableFile* file, std::uint32_t tag) : file_(file), tag_(tag) {}

  // Appends a page; `payload` has at most kPagePayloadBytes and is padded with zeros.
  // RESOURCE_EXHAUSTED after kMaxPageCount pages; otherwise the file's errors.
  [[nodiscard]] absl::StatusOr<PageNumber> Append(absl::string_view payload);
  // Replaces a page. REQUIRES: page < page_count().
  [[nodiscard]] absl::Status Overwrite(PageNumber page, absl::string_view payload);

  [[nodiscard]] std::int64_t page_count() const { return page_count_; }

 private:
  [[nodiscard]] std::string EncodePage(PageNumber page, absl::string_view payload) const;

  WritableFile* file_;
  std::uint32_t tag_;
  std::int64_t page_count_ = 0;
};

// The cost of reading. PageFile::Read adds to it.
struct PageReadCost {
  std::int64_t page_read_count = 0;  // pages asked for, cached or not
  std::int64_t read_bytes = 0;       // bytes that came from the file
};

// A file of pages, with a cache of the least recently used ones. Thread-safe.
class PageFile {
 public:
  // The payload of a verified page. Keeps it alive, even when the cache has dropped it.
  class Page {
   public:
    [[nodiscard]] absl::string_view payload() const { return {bytes_.get(), kPagePayloadBytes}; }

   private:
    friend class PageFile;
    explicit Page(std::shared_ptr<const char[]> bytes) : bytes_(std::move(bytes)) {}

    std::shared_ptr<const char[]> bytes_;
  };

  // Opens `file` and verifies page 0. All other pages must bear its tag. At most `cache_bytes` of
  // pages stay in memory (0: none). DATA_LOSS, naming file and page, if the file does not have a
  // whole number of pages, at least one, or if page 0 is damaged.
  static absl::StatusOr<std::unique_ptr<PageFile>> Open(std::unique_ptr<RandomAccessFile> file,
                                                        std::int64_t cache_bytes);
  PageFile(const PageFile&) = delete;
  PageFile& operator=(const PageFile&) = delete;

  // Reads a page, from the cache if it is there, and adds to `cost`. DATA_LOSS, naming file and
  // page, if there is no such page or it is damaged; damaged pages are not cached.
  [[nodiscard]] absl::StatusOr<Page> Read(PageNumber page, PageReadCost* cost) const;

  // Returns a DATA_LOSS that names the file, `page` and the damage `what`. For readers of payloads.
  [[nodiscard]] absl::Status PageError(PageNumber page, absl::string_view what) const;

  [[nodiscard]] std::int64_t page_count() const { return page_count_; }
  [[nodiscard]] const std::string& path() const { return file_->path(); }
  // Returns the bytes of the pages in the cache; never more than `cache_bytes`.
  [[nodiscard]] std::int64_t cached_bytes() const;

 private:
  using LruList = std::list<std::pair<PageNumber, std::shared_ptr<const char[]>>>;

  PageFile(std::unique_ptr<RandomAccessFile> file, std::int64_t page_count,
           std::int64_t max_cached_pages)
      : file_(std::move(file)), page_count_(page_count), max_cached_pages_(max_cached_pages) {}

  // Reads a page and verifies checksum and number, but not the tag.
  [[nodiscard]] absl::StatusOr<std::shared_ptr<const char[]>> ReadFromFile(PageNumber page) const;
  void Insert(PageNumber page, std::shared_ptr<const char[]> bytes) const;

  const std::unique_ptr<RandomAccessFile> file_;
  const std::int64_t page_count_;
  const std::int64_t max_cached_pages_;
  std::uint32_t tag_ = 0;  // set once, by Open

  mutable base::Mutex mutex_;
  // Most recently used first.
  mutable LruList lru_ ABSL_GUARDED_BY(mutex_);
  mutable std::unordered_map<PageNumber, LruList::iterator> cached_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_PAGE_FILE_H_
