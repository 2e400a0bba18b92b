// The bytes of a page, little-endian:
//
//   0     payload, padded with zeros
//   4084  tag of the file
//   4088  page number
//   4092  CRC-32C of the bytes before
//
// Each of the last three fields catches its own accident: the checksum a damaged page, the number a
// page in the wrong position, the tag a page of another file. Open takes the tag of page 0 as the
// tag of the file. So a page is verified in two parts: ReadFromFile checks checksum and number, and
// Read compares the tag.
//
// The cache is a list of pages, the last used in front, and a map from page number to list entry. A
// page is read outside the lock. Two threads that miss the same page both read it; the first one to
// return keeps it in the cache.

#include "core/io/page_file.h"

#include <algorithm>
#include <cstring>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/status_macros.h"

namespace isoscope::io {
namespace {

constexpr std::size_t kTagOffset = kPagePayloadBytes;
constexpr std::size_t kNumberOffset = kTagOffset + 4;
constexpr std::size_t kCrcOffset = kNumberOffset + 4;

std::int64_t OffsetOf(PageNumber page) {
  return static_cast<std::int64_t>(page) * static_cast<std::int64_t>(kPageBytes);
}

}  // namespace

std::string PageFileWriter::EncodePage(PageNumber page, absl::string_view payload) const {
  ISOSCOPE_CHECK_LE(payload.size(), kPagePayloadBytes);
  std::string bytes(kPageBytes, '\0');
  std::copy(payload.begin(), payload.end(), bytes.begin());
  base::StoreLittleEndian(tag_, &bytes[kTagOffset]);
  base::StoreLittleEndian(page, &bytes[kNumberOffset]);
  base::StoreLittleEndian(base::ExtendCrc32c(0, bytes.data(), kCrcOffset), &bytes[kCrcOffset]);
  return bytes;
}

absl::StatusOr<PageNumber> PageFileWriter::Append(absl::string_view payload) {
  if (page_count_ >= kMaxPageCount) {
    return absl::ResourceExhaustedError(
        absl::StrCat("a page file holds at most ", kMaxPageCount, " pages; it is full"));
  }
  const auto page = static_cast<PageNumber>(page_count_);
  ISOSCOPE_RETURN_IF_ERROR(file_->Append(EncodePage(page, payload)));
  ++page_count_;
  return page;
}

absl::Status PageFileWriter::Overwrite(PageNumber page, absl::string_view payload) {
  ISOSCOPE_CHECK_LT(static_cast<std::int64_t>(page), page_count_);
  return file_->WriteAt(OffsetOf(page), EncodePage(page, payload));
}

absl::StatusOr<std::unique_ptr<PageFile>> PageFile::Open(std::unique_ptr<RandomAccessFile> file,
                                                         std::int64_t cache_bytes) {
  const std::int64_t size = file->size_bytes();
  constexpr auto kPage = static_cast<std::int64_t>(kPageBytes);
  if (size <= 0 || size % kPage != 0 || size / kPage > kMaxPageCount) {
    return absl::DataLossError(absl::StrCat(
        file->path(), ": has ", size, " bytes, expected a whole number of pages of ", kPage,
        " bytes, 1 to ", kMaxPageCount, " of them; restore the file from where it was made"));
  }
  const std::int64_t max_cached_pages = std::max<std::int64_t>(cache_bytes, 0) / kPage;
  auto page_file =
      std::unique_ptr<PageFile>(new PageFile(std::move(file), size / kPage, max_cached_pages));
  ISOSCOPE_ASSIGN_OR_RETURN(auto bytes, page_file->ReadFromFile(0));
  page_file->tag_ = base::LoadLittleEndian<std::uint32_t>(bytes.get() + kTagOffset);
  page_file->Insert(0, std::move(bytes));
  return page_file;
}

absl::StatusOr<PageFile::Page> PageFile::Read(PageNumber page, PageReadCost* cost) const {
  if (static_cast<std::int64_t>(page) >= page_count_) {
    return PageError(page, absl::StrCat("does not exist, the file has ", page_count_, " pages"));
  }
  ++cost->page_read_count;
  {
    const base::MutexLock lock(&mutex_);
    const auto found = cached_.find(page);
    if (found != cached_.end()) {
      lru_.splice(lru_.begin(), lru_, found->second);
      return Page(found->second->second);
    }
  }
  // The lock is not held here, so that a miss does not keep others from their hits.
  ISOSCOPE_ASSIGN_OR_RETURN(auto bytes, ReadFromFile(page));
  cost->read_bytes += static_cast<std::int64_t>(kPageBytes);
  const auto tag = base::LoadLittleEndian<std::uint32_t>(bytes.get() + kTagOffset);
  if (tag != tag_) {
    return PageError(page, absl::StrFormat("file tag is %#010x, expected %#010x as on page 0: the "
                                           "page belongs to another file",
                                           tag, tag_));
  }
  Insert(page, bytes);
  return Page(std::move(bytes));
}

absl::Status PageFile::PageError(PageNumber page, absl::string_view what) const {
  return absl::DataLossError(
      absl::StrCat(path(), ": page ", page, " (offset ", OffsetOf(page), "): ", what));
}

std::int64_t PageFile::cached_bytes() const {
  const base::MutexLock lock(&mutex_);
  return static_cast<std::int64_t>(lru_.size() * kPageBytes);
}

absl::StatusOr<std::shared_ptr<const char[]>> PageFile::ReadFromFile(PageNumber page) const {
  std::shared_ptr<char[]> bytes(new char[kPageBytes]);
  ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(OffsetOf(page), kPageBytes, bytes.get()));
  const auto stored_crc = base::LoadLittleEndian<std::uint32_t>(bytes.get() + kCrcOffset);
  const std::uint32_t computed_crc = base::ExtendCrc32c(0, bytes.get(), kCrcOffset);
  if (stored_crc != computed_crc) {
    return PageError(
        page, absl::StrFormat("crc32c %#010x stored, %#010x computed", stored_crc, computed_crc));
  }
  const auto stored_number = base::LoadLittleEndian<PageNumber>(bytes.get() + kNumberOffset);
  if (stored_number != page) {
    return PageError(page, absl::StrCat("bears the number ", stored_number,
                                        ": it was written to the wrong place"));
  }
  return std::shared_ptr<const char[]>(std::move(bytes));
}

void PageFile::Insert(PageNumber page, std::shared_ptr<const char[]> bytes) const {
  if (max_cached_pages_ == 0) {
    return;
  }
  const base::MutexLock lock(&mutex_);
  if (cached_.count(page) > 0) {
    return;
  }
  if (static_cast<std::int64_t>(lru_.size()) >= max_cached_pages_) {
    cached_.erase(lru_.back().first);
    lru_.pop_back();
  }
  lru_.emplace_front(page, std::move(bytes));
  cached_.emplace(page, lru_.begin());
}

}  // namespace isoscope::io
