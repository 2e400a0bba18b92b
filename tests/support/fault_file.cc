#include "tests/support/fault_file.h"

#include <unistd.h>

#include <cerrno>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "core/base/status_macros.h"

namespace isoscope::testing {
namespace {

class FaultyFile : public io::RandomAccessFile {
 public:
  FaultyFile(std::unique_ptr<io::RandomAccessFile> file, ReadFault fault, std::int64_t fault_offset)
      : file_(std::move(file)), fault_(fault), fault_offset_(fault_offset) {}

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    const bool touches =
        offset <= fault_offset_ && fault_offset_ < offset + static_cast<std::int64_t>(size);
    if (touches && fault_ == ReadFault::kIoError) {
      return io::ErrnoToStatus(EIO, "read", file_->path());
    }
    if (touches && fault_ == ReadFault::kShortRead) {
      return absl::DataLossError(
          absl::StrFormat("%s: ends after %d bytes", file_->path(), fault_offset_));
    }
    ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(offset, size, out));
    if (touches) {
      char& byte = out[fault_offset_ - offset];
      byte = static_cast<char>(static_cast<unsigned char>(byte) ^ 1u);
    }
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return file_->size_bytes(); }
  [[nodiscard]] const std::string& path() const override { return file_->path(); }

 private:
  const std::unique_ptr<io::RandomAccessFile> file_;
  const ReadFault fault_;
  const std::int64_t fault_offset_;
};

class DescriptorFile : public io::RandomAccessFile {
 public:
  DescriptorFile(int descriptor, std::int64_t size_bytes, std::string path)
      : descriptor_(descriptor), size_bytes_(size_bytes), path_(std::move(path)) {}
  ~DescriptorFile() override { close(descriptor_); }
  DescriptorFile(const DescriptorFile&) = delete;
  DescriptorFile& operator=(const DescriptorFile&) = delete;

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    for (std::size_t done = 0; done < size;) {
      const std::int64_t place = offset + static_cast<std::int64_t>(done);
      const ssize_t count = pread(descriptor_, out + done, size - done, place);
      if (count < 0) {
        return io::ReadFailed(errno, *this, offset, size);
      }
      if (count == 0) {
        return io::FileTooShort(*this, offset, size, place);
      }
      done += static_cast<std::size_t>(count);
    }
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return size_bytes_; }
  [[nodiscard]] const std::string& path() const override { return path_; }
  [[nodiscard]] int descriptor() const override { return descriptor_; }

 private:
  const int descriptor_;
  const std::int64_t size_bytes_;
  const std::string path_;
};

class FullDiskFile : public io::WritableFile {
 public:
  FullDiskFile(std::unique_ptr<io::WritableFile> file, std::int64_t capacity_bytes)
      : file_(std::move(file)), left_(capacity_bytes) {}

  [[nodiscard]] absl::Status Append(absl::string_view bytes) override {
    return WriteAt(file_->size_bytes(), bytes);
  }
  [[nodiscard]] absl::Status WriteAt(std::int64_t offset, absl::string_view bytes) override {
    ISOSCOPE_RETURN_IF_ERROR(status_);
    const absl::string_view fits = bytes.substr(0, static_cast<std::size_t>(left_));
    left_ -= static_cast<std::int64_t>(fits.size());
    ISOSCOPE_RETURN_IF_ERROR(file_->WriteAt(offset, fits));
    if (fits.size() < bytes.size()) {
      status_ = io::ErrnoToStatus(ENOSPC, "write", "full disk of the test");
    }
    return status_;
  }
  [[nodiscard]] absl::Status Close() override {
    ISOSCOPE_RETURN_IF_ERROR(status_);
    return file_->Close();
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return file_->size_bytes(); }

 private:
  const std::unique_ptr<io::WritableFile> file_;
  std::int64_t left_;
  absl::Status status_;
};

}  // namespace

std::unique_ptr<io::RandomAccessFile> MakeFaultyFile(std::unique_ptr<io::RandomAccessFile> file,
                                                     ReadFault fault, std::int64_t fault_offset) {
  return std::make_unique<FaultyFile>(std::move(file), fault, fault_offset);
}

std::unique_ptr<io::RandomAccessFile> MakeDescriptorFile(int descriptor, std::int64_t size_bytes,
                                                         const std::string& path) {
  return std::make_unique<DescriptorFile>(descriptor, size_bytes, path);
}

std::unique_ptr<io::WritableFile> MakeFullDiskFile(std::unique_ptr<io::WritableFile> file,
                                                   std::int64_t capacity_bytes) {
  return std::make_unique<FullDiskFile>(std::move(file), capacity_bytes);
}

}  // namespace isoscope::testing
