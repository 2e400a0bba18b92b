// Objects that live in strings, and the reads that were asked for.

#ifndef ISOSCOPE_TESTS_SUPPORT_MEMORY_STORE_H_
#define ISOSCOPE_TESTS_SUPPORT_MEMORY_STORE_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/types/span.h"

#include "core/base/cancellation.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/source/bytes/byte_source.h"
#include "core/source/bytes/object_store.h"

namespace isoscope::testing {

// Thread-safe.
class MemoryBytes final : public source::ByteSource {
 public:
  explicit MemoryBytes(std::string bytes) : bytes_(std::move(bytes)) {}

  [[nodiscard]] absl::Status ReadRanges(absl::Span<const source::ByteRange> ranges,
                                        const base::Cancellation& cancellation) const override {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    for (const source::ByteRange& range : ranges) {
      if (range.offset < 0 || range.offset > size_bytes() ||
          static_cast<std::int64_t>(range.size) > size_bytes() - range.offset) {
        return absl::OutOfRangeError(absl::StrCat("memory: no ", range.size, " bytes at ",
                                                  range.offset, " of ", size_bytes()));
      }
      if (range.size > 0) {
        std::memcpy(range.out, bytes_.data() + range.offset, range.size);
      }
    }
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override {
    return static_cast<std::int64_t>(bytes_.size());
  }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] std::string version() const override { return ""; }

 private:
  const std::string bytes_;
  const std::string name_ = "memory";
};

// Thread-safe.
class MemoryStore final : public source::ObjectStore {
 public:
  explicit MemoryStore(std::map<std::string, std::string> objects) : objects_(std::move(objects)) {}

  [[nodiscard]] std::vector<absl::StatusOr<std::string>> Read(
      absl::Span<const source::ObjectRead> reads,
      const base::Cancellation& cancellation) const override {
    std::vector<absl::StatusOr<std::string>> parts;
    const base::MutexLock lock(&mutex_);
    for (const source::ObjectRead& read : reads) {
      reads_.push_back(read);
      const absl::Status cancelled = cancellation.Check();
      parts.push_back(cancelled.ok() ? ReadOne(read) : cancelled);
    }
    return parts;
  }
  [[nodiscard]] absl::StatusOr<std::unique_ptr<source::ByteSource>> Open(
      const std::string& key, const base::Cancellation& /*cancellation*/) const override {
    const auto found = objects_.find(key);
    if (found == objects_.end()) {
      return absl::NotFoundError(absl::StrCat("memory/", key, ": no such object"));
    }
    return std::make_unique<MemoryBytes>(found->second);
  }
  [[nodiscard]] const std::string& name() const override { return name_; }

  // All that were asked for since the last call.
  [[nodiscard]] std::vector<source::ObjectRead> TakeReads() const {
    const base::MutexLock lock(&mutex_);
    return std::exchange(reads_, {});
  }

 private:
  [[nodiscard]] absl::StatusOr<std::string> ReadOne(const source::ObjectRead& read) const {
    const auto found = objects_.find(read.key);
    if (found == objects_.end()) {
      return absl::NotFoundError(absl::StrCat("memory/", read.key, ": no such object"));
    }
    const auto all = static_cast<std::int64_t>(found->second.size());
    const std::int64_t begin = read.offset < 0 ? all + read.offset : read.offset;
    const std::int64_t size = read.size < 0 ? all - begin : read.size;
    if (begin < 0 || begin > all || size > all - begin) {
      return absl::OutOfRangeError(
          absl::StrCat("memory/", read.key, ": no ", size, " bytes at ", read.offset, " of ", all));
    }
    if (size > read.max_size) {
      return absl::ResourceExhaustedError(absl::StrCat("memory/", read.key, ": ", size, " bytes"));
    }
    return found->second.substr(static_cast<std::size_t>(begin), static_cast<std::size_t>(size));
  }

  const std::map<std::string, std::string> objects_;
  const std::string name_ = "memory";
  mutable base::Mutex mutex_;
  mutable std::vector<source::ObjectRead> reads_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_MEMORY_STORE_H_
