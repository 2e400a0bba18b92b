#include "core/source/bytes/local_bytes.h"

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/io/file_stamp.h"

namespace isoscope::source {
namespace {

class FileBytes final : public ByteSource {
 public:
  FileBytes(std::unique_ptr<io::RandomAccessFile> file, std::string version)
      : file_(std::move(file)), version_(std::move(version)) {}

  [[nodiscard]] absl::Status ReadRanges(absl::Span<const ByteRange> ranges,
                                        const base::Cancellation& cancellation) const override {
    for (const ByteRange& range : ranges) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
      const std::int64_t size = size_bytes();
      if (range.offset < 0 || range.offset > size ||
          range.size > static_cast<std::size_t>(size - range.offset)) {
        return absl::OutOfRangeError(absl::StrFormat("%s: no %d bytes from %d on, of %d", name(),
                                                     range.size, range.offset, size));
      }
      ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(range.offset, range.size, range.out));
    }
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return file_->size_bytes(); }
  [[nodiscard]] const std::string& name() const override { return file_->path(); }
  [[nodiscard]] std::string version() const override { return version_; }

 private:
  const std::unique_ptr<io::RandomAccessFile> file_;
  const std::string version_;
};

class FolderStore final : public ObjectStore {
 public:
  explicit FolderStore(std::string folder) : folder_(std::move(folder)) {}

  [[nodiscard]] std::vector<absl::StatusOr<std::string>> Read(
      absl::Span<const ObjectRead> reads, const base::Cancellation& cancellation) const override {
    std::vector<absl::StatusOr<std::string>> parts;
    parts.reserve(reads.size());
    for (const ObjectRead& read : reads) {
      parts.push_back(ReadOne(read, cancellation));
    }
    return parts;
  }
  [[nodiscard]] absl::StatusOr<std::unique_ptr<ByteSource>> Open(
      const std::string& key, const base::Cancellation& cancellation) const override {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    for (const absl::string_view part : absl::StrSplit(key, '/')) {
      if (part.empty() || part == "." || part == "..") {
        return absl::InvalidArgumentError(absl::StrFormat(
            "%s: key \"%s\" has a part that is empty, \".\" or \"..\"", folder_, key));
      }
    }
    const std::string path = absl::StrCat(folder_, "/", key);
    if (io::IsDirectory(path)) {
      return absl::NotFoundError(absl::StrCat(path, ": a folder, no file"));
    }
    return OpenFileBytes(path);
  }
  [[nodiscard]] const std::string& name() const override { return folder_; }

 private:
  [[nodiscard]] absl::StatusOr<std::string> ReadOne(const ObjectRead& read,
                                                    const base::Cancellation& cancellation) const {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<ByteSource> bytes,
                              Open(read.key, cancellation));
    const std::int64_t all = bytes->size_bytes();
    const std::int64_t begin = read.offset < 0 ? all + read.offset : read.offset;
    const std::int64_t size = read.size < 0 ? all - begin : read.size;
    if (begin < 0 || begin > all || size > all - begin) {
      return absl::OutOfRangeError(absl::StrFormat("%s: no %d bytes from %d on, of %d",
                                                   bytes->name(), read.size, read.offset, all));
    }
    if (size > read.max_size) {
      return absl::ResourceExhaustedError(
          absl::StrFormat("%s: %d bytes; expected at most %d", bytes->name(), size, read.max_size));
    }
    std::string part(static_cast<std::size_t>(size), '\0');
    ISOSCOPE_RETURN_IF_ERROR(bytes->ReadAt(begin, part.size(), part.data(), cancellation));
    return part;
  }

  const std::string folder_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<ByteSource>> OpenFileBytes(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  const io::FileStamp stamp = io::StampOf(path);
  return std::make_unique<FileBytes>(
      std::move(file), absl::StrFormat("%d-%d.%09d", stamp.size, stamp.modified.seconds,
                                       stamp.modified.nanoseconds));
}

absl::StatusOr<std::unique_ptr<ObjectStore>> OpenFolderStore(const std::string& path) {
  if (!io::IsDirectory(path)) {
    return io::PathExists(path)
               ? absl::InvalidArgumentError(absl::StrCat(path, ": no folder"))
               : absl::NotFoundError(absl::StrCat(path, ": no such file or folder"));
  }
  return std::make_unique<FolderStore>(path);
}

}  // namespace isoscope::source
