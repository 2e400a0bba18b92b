#include "core/source/child/far_files.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include <sys/mman.h>
#include <sys/socket.h>

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kFarPieceBytes = static_cast<std::size_t>(base::kMiB);

struct FarRequest {
  std::int64_t number = 0;  // of the file
  std::int64_t offset = 0;
  std::int64_t size = 0;
};
struct FarAnswer {
  std::int32_t code = 0;  // of absl::StatusCode
  std::array<char, 508> message{};
};

template <typename Call>
auto RetryFar(Call call) {
  auto result = call();
  while (result < 0 && errno == EINTR) {
    result = call();
  }
  return result;
}

FarAnswer AnswerOf(const absl::Status& status) {
  FarAnswer answer{.code = static_cast<std::int32_t>(status.raw_code())};
  std::string(status.message()).copy(answer.message.data(), answer.message.size() - 1);
  return answer;
}

// A file of the parent, in the child.
class ChildFile final : public io::RandomAccessFile {
 public:
  ChildFile(std::int64_t number, std::string path, std::int64_t size, int socket,
            const char* memory)
      : number_(number), path_(std::move(path)), size_(size), socket_(socket), memory_(memory) {}

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckRange(*this, offset, size));
    while (size > 0) {
      const std::size_t take = std::min(size, kFarPieceBytes);
      const FarRequest request{
          .number = number_, .offset = offset, .size = static_cast<std::int64_t>(take)};
      FarAnswer answer;
      if (RetryFar([&] { return send(socket_, &request, sizeof(request), MSG_NOSIGNAL); }) < 0 ||
          RetryFar([&] { return recv(socket_, &answer, sizeof(answer), 0); }) !=
              static_cast<ssize_t>(sizeof(answer))) {
        return absl::UnavailableError(absl::StrCat(path_, ": the process that reads it is gone"));
      }
      if (answer.code != 0) {
        return absl::Status(static_cast<absl::StatusCode>(answer.code), answer.message.data());
      }
      std::memcpy(out, memory_, take);
      offset += static_cast<std::int64_t>(take);
      out += take;
      size -= take;
    }
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return size_; }
  [[nodiscard]] const std::string& path() const override { return path_; }

 private:
  const std::int64_t number_;
  const std::string path_;
  const std::int64_t size_;
  const int socket_;
  const char* const memory_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<FarFiles>> FarFiles::Make(std::vector<io::MountedFile> files) {
  void* const memory = mmap(nullptr, kFarPieceBytes, PROT_READ | PROT_WRITE,
                            MAP_SHARED | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (memory == MAP_FAILED) {
    return absl::ResourceExhaustedError("no memory to read for a process that decodes");
  }
  std::array<int, 2> ends{};
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends.data()) != 0) {
    munmap(memory, kFarPieceBytes);
    return absl::ResourceExhaustedError(
        "no socket for a process that decodes; raise the limit of open files (ulimit -n)");
  }
  return std::unique_ptr<FarFiles>(
      new FarFiles(std::move(files), ends[0], ends[1], static_cast<char*>(memory)));
}

FarFiles::~FarFiles() {
  shutdown(parent_socket_, SHUT_RDWR);  // wakes the thread
  if (thread_.joinable()) {
    thread_.join();
  }
  close(parent_socket_);
  if (child_socket_ >= 0) {
    close(child_socket_);
  }
  munmap(memory_, kFarPieceBytes);
}

void FarFiles::Serve() {
  close(child_socket_);
  child_socket_ = -1;
  thread_ = std::thread([this] { Run(); });
}

void FarFiles::Run() const {
  while (true) {
    FarRequest request;
    const ssize_t size =
        RetryFar([&] { return recv(parent_socket_, &request, sizeof(request), 0); });
    if (size <= 0) {
      return;  // the child is gone, or this object goes
    }
    // The child may send anything.
    absl::Status status = absl::InvalidArgumentError("no request of a file");
    if (size == static_cast<ssize_t>(sizeof(request)) && request.number >= 0 &&
        request.number < static_cast<std::int64_t>(files_.size()) && request.offset >= 0 &&
        request.size > 0 && request.size <= static_cast<std::int64_t>(kFarPieceBytes)) {
      const io::RandomAccessFile& file = *files_[static_cast<std::size_t>(request.number)].file;
      const auto count = static_cast<std::size_t>(request.size);
      status = io::CheckRange(file, request.offset, count);
      if (status.ok()) {
        status = file.ReadAt(request.offset, count, memory_);
      }
    }
    const FarAnswer answer = AnswerOf(status);
    if (RetryFar([&] { return send(parent_socket_, &answer, sizeof(answer), MSG_NOSIGNAL); }) < 0) {
      return;
    }
  }
}

void FarFiles::MountInChild(int socket) const {
  std::vector<io::MountedFile> mounted;
  for (std::size_t i = 0; i < files_.size(); ++i) {
    const io::RandomAccessFile& file = *files_[i].file;
    mounted.push_back(
        {.file = std::make_shared<ChildFile>(static_cast<std::int64_t>(i), file.path(),
                                             file.size_bytes(), socket, memory_),
         .version = files_[i].version,
         .tells_all = files_[i].tells_all});
  }
  io::ReplaceMounts(std::move(mounted));
}

}  // namespace isoscope::source
