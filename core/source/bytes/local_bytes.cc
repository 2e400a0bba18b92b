#include "core/source/bytes/local_bytes.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/io/file_stamp.h"
#include "core/source/bytes/object_key.h"

namespace isoscope::source {
namespace {

// A cancellation is polled after so many bytes: some 10 ms of a fast disk.
constexpr std::size_t kBytesBetweenPolls = 16 * static_cast<std::size_t>(base::kMiB);

class FileBytes : public ByteSource {
 public:
  FileBytes(std::unique_ptr<io::RandomAccessFile> file, std::string version)
      : file_(std::move(file)), version_(std::move(version)) {}

  [[nodiscard]] absl::Status ReadRanges(absl::Span<const ByteRange> ranges,
                                        const base::Cancellation& cancellation) const override {
    for (const ByteRange& range : ranges) {
      ISOSCOPE_RETURN_IF_ERROR(CheckWithin(range, size_bytes(), name()));
    }
    for (const ByteRange& range : ranges) {
      std::size_t done = 0;
      do {
        ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
        const std::size_t size = std::min(range.size - done, kBytesBetweenPolls);
        if (size > 0) {
          ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(range.offset + static_cast<std::int64_t>(done),
                                                 size, range.out + done));
        }
        done += size;
      } while (done < range.size);
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

absl::StatusOr<std::unique_ptr<FileBytes>> OpenFileBytesAt(const std::string& path) {
  // The stamp comes first: if the file is replaced in between, the next version differs.
  const io::FileStamp stamp = io::StampOf(path);
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  return std::make_unique<FileBytes>(
      std::move(file),
      absl::StrCat(stamp.size, "-", stamp.modified.seconds, ".", stamp.modified.nanoseconds));
}

class FolderStore : public ObjectStore {
 public:
  explicit FolderStore(std::string path) : path_(std::move(path)) {}

  [[nodiscard]] std::vector<absl::StatusOr<std::string>> Read(
      absl::Span<const ObjectRead> reads, const base::Cancellation& cancellation) const override {
    std::vector<absl::StatusOr<std::string>> answers;
    answers.reserve(reads.size());
    for (const ObjectRead& read : reads) {
      answers.push_back(ReadOne(read, cancellation));
    }
    return answers;
  }
  [[nodiscard]] absl::StatusOr<std::unique_ptr<ByteSource>> Open(
      const std::string& key, const base::Cancellation& cancellation) const override {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    return OpenKey(key);
  }
  [[nodiscard]] const std::string& name() const override { return path_; }

 private:
  [[nodiscard]] absl::StatusOr<std::unique_ptr<FileBytes>> OpenKey(const std::string& key) const {
    ISOSCOPE_RETURN_IF_ERROR(CheckObjectKey(key));
    const std::string path = absl::StrCat(path_, "/", key);
    if (io::IsDirectory(path)) {
      return absl::NotFoundError(absl::StrCat(path, ": is a folder, expected a file"));
    }
    return OpenFileBytesAt(path);
  }
  [[nodiscard]] absl::StatusOr<std::string> ReadOne(const ObjectRead& read,
                                                    const base::Cancellation& cancellation) const {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<FileBytes> file, OpenKey(read.key));
    ISOSCOPE_ASSIGN_OR_RETURN(const ObjectExtent extent,
                              ExtentOf(read, file->size_bytes(), file->name()));
    std::string bytes(static_cast<std::size_t>(extent.size), '\0');
    ISOSCOPE_RETURN_IF_ERROR(file->ReadAt(extent.offset, bytes.size(), bytes.data(), cancellation));
    return bytes;
  }

  const std::string path_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<ByteSource>> OpenFileBytes(const std::string& path) {
  return OpenFileBytesAt(path);
}

absl::StatusOr<std::unique_ptr<ObjectStore>> OpenFolderStore(const std::string& path) {
  if (!io::PathExists(path)) {
    return absl::NotFoundError(absl::StrCat(path, ": no such folder"));
  }
  if (!io::IsDirectory(path)) {
    return absl::FailedPreconditionError(absl::StrCat(path, ": is no folder"));
  }
  return std::make_unique<FolderStore>(path);
}

}  // namespace isoscope::source
