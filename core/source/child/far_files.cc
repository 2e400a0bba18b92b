#include "core/source/child/far_files.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/types/span.h"
#include <sys/mman.h>
#include <sys/socket.h>

#include "core/base/status_macros.h"
#include "core/base/thread_interrupt.h"
#include "core/base/units.h"
#include "core/io/file.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kFarPieceBytes = 8 * static_cast<std::size_t>(base::kMiB);  // of an answer
constexpr std::size_t kFarPacketRanges = 2048;
constexpr std::size_t kMaxFarRanges = 65'536;  // more are not fetched before
constexpr std::int64_t kFarBatchBytes = 8 * base::kMiB;
constexpr std::size_t kFarBatchRanges = 64;
constexpr int kFarFetchers = 2;

struct FarRequest {
  std::int64_t number = 0;  // of the file
  std::int64_t offset = 0;
  std::int64_t size = 0;
};
// Ranges that will be asked for: size is 0, and their number stands in `offset`; they follow.
struct FarExpectation {
  FarRequest head;
  std::array<io::FileRange, kFarPacketRanges> ranges{};
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

absl::Status& FirstError() {
  static absl::Status error;  // of this process, a child
  return error;
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
        return Failed(
            absl::UnavailableError(absl::StrCat(path_, ": the process that reads it is gone")));
      }
      if (answer.code != 0) {
        return Failed(
            absl::Status(static_cast<absl::StatusCode>(answer.code), answer.message.data()));
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
  static absl::Status Failed(absl::Status status) {
    FirstError().Update(status);
    return status;
  }

  const std::int64_t number_;
  const std::string path_;
  const std::int64_t size_;
  const int socket_;
  const char* const memory_;
};

// An error is one of the next read.
void SendExpectation(std::int64_t number, absl::Span<const io::FileRange> ranges, int socket) {
  const auto packet = std::make_unique<FarExpectation>();
  while (!ranges.empty()) {
    const std::size_t count = std::min(ranges.size(), kFarPacketRanges);
    packet->head = {.number = number, .offset = static_cast<std::int64_t>(count)};
    std::copy_n(ranges.begin(), count, packet->ranges.begin());
    const std::size_t bytes = sizeof(FarRequest) + count * sizeof(io::FileRange);
    if (RetryFar([&] { return send(socket, packet.get(), bytes, MSG_NOSIGNAL); }) < 0) {
      return;
    }
    ranges.remove_prefix(count);
  }
}

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

FarFiles::FarFiles(std::vector<io::MountedFile> files, int parent_socket, int child_socket,
                   char* memory)
    : files_(std::move(files)),
      parent_socket_(parent_socket),
      child_socket_(child_socket),
      memory_(memory),
      by_process_(base::InterruptOfAllThreads(), [this] { ended_.Cancel(); }),
      next_(expected_.end()) {}

FarFiles::~FarFiles() {
  ended_.Cancel();
  shutdown(parent_socket_, SHUT_RDWR);  // wakes the thread
  if (thread_.joinable()) {
    thread_.join();
  }
  for (std::thread& fetcher : fetchers_) {
    fetcher.join();
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
  thread_ = std::thread([this] {
    const base::ThreadInterrupt interrupt(ended_);  // a server that is silent
    Run();
  });
}

void FarFiles::Run() {
  const auto packet = std::make_unique<FarExpectation>();
  while (true) {
    const ssize_t size =
        RetryFar([&] { return recv(parent_socket_, packet.get(), sizeof(*packet), 0); });
    if (size <= 0) {
      return;  // the child is gone, or this object goes
    }
    // The child may send anything.
    const auto bytes = static_cast<std::size_t>(size);
    const FarRequest& request = packet->head;
    if (bytes > sizeof(FarRequest) && request.offset >= 0 &&
        request.offset <= static_cast<std::int64_t>(kFarPacketRanges) &&
        bytes ==
            sizeof(FarRequest) + static_cast<std::size_t>(request.offset) * sizeof(io::FileRange)) {
      Expect(request.number,
             {packet->ranges.data(), static_cast<std::size_t>(request.offset)});  // no answer
      continue;
    }
    const FarAnswer answer =
        AnswerOf(bytes == sizeof(FarRequest) ? Read(request.number, request.offset, request.size)
                                             : absl::InvalidArgumentError("no request of a file"));
    if (RetryFar([&] { return send(parent_socket_, &answer, sizeof(answer), MSG_NOSIGNAL); }) < 0) {
      return;
    }
  }
}

absl::Status FarFiles::Read(std::int64_t number, std::int64_t offset, std::int64_t size) {
  if (number < 0 || number >= static_cast<std::int64_t>(files_.size()) || offset < 0 || size <= 0 ||
      size > static_cast<std::int64_t>(kFarPieceBytes)) {
    return absl::InvalidArgumentError("no request of a file");
  }
  const auto index = static_cast<std::size_t>(number);
  const io::RandomAccessFile& file = *files_[index].file;
  const auto count = static_cast<std::size_t>(size);
  ISOSCOPE_RETURN_IF_ERROR(io::CheckRange(file, offset, count));
  absl::Status status;
  return TakeExpected(index, offset, count, &status) ? status : file.ReadAt(offset, count, memory_);
}

void FarFiles::Expect(std::int64_t number, absl::Span<const io::FileRange> ranges) {
  if (number < 0 || number >= static_cast<std::int64_t>(files_.size())) {
    return;
  }
  const auto index = static_cast<std::size_t>(number);
  {
    const base::MutexLock lock(&mutex_);
    for (const io::FileRange& range : ranges) {
      if (range.offset < 0 || range.size == 0 ||
          range.size > static_cast<std::size_t>(kFarAheadBytes) ||
          !io::CheckRange(*files_[index].file, range.offset, range.size).ok() ||
          expected_.size() >= kMaxFarRanges) {
        continue;  // whoever reads it gets the error
      }
      expected_.push_back({.file = index, .range = range});
      next_ = next_ == expected_.end() ? std::prev(expected_.end()) : next_;
    }
  }
  changed_.SignalAll();
  while (static_cast<int>(fetchers_.size()) < kFarFetchers) {
    fetchers_.emplace_back([this] { Fetch(); });
  }
}

bool FarFiles::TakeExpected(std::size_t file, std::int64_t offset, std::size_t size,
                            absl::Status* status) {
  const auto holds = [&](const Expected& expected) {
    return expected.file == file && expected.range.offset <= offset &&
           offset + static_cast<std::int64_t>(size) <=
               expected.range.offset + static_cast<std::int64_t>(expected.range.size);
  };
  std::list<Expected>::iterator found;
  {
    const base::MutexLock lock(&mutex_);
    found = std::find_if(expected_.begin(), expected_.end(), holds);
    if (found == expected_.end()) {
      return false;
    }
  }
  // The fetchers have it, or will.
  *status = base::AwaitOrCancelled(ended_, &mutex_, &changed_,
                                   [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
                                     DropBefore(found);
                                     return found->is_done;
                                   });
  if (!status->ok()) {
    return true;
  }
  const base::MutexLock lock(&mutex_);
  *status = found->status;
  if (status->ok()) {
    std::memcpy(memory_, found->bytes.get() + (offset - found->range.offset), size);
  }
  if (!status->ok() || offset + static_cast<std::int64_t>(size) ==
                           found->range.offset + static_cast<std::int64_t>(found->range.size)) {
    held_bytes_ -= static_cast<std::int64_t>(found->range.size);
    expected_.erase(found);
    changed_.SignalAll();
  }
  return true;
}

void FarFiles::DropBefore(std::list<Expected>::iterator end) {
  bool has_dropped = false;
  for (auto i = expected_.begin(); i != end;) {
    if (!i->is_done && i->bytes != nullptr) {
      ++i;  // a fetcher writes to it
      continue;
    }
    held_bytes_ -= i->is_done ? static_cast<std::int64_t>(i->range.size) : 0;
    next_ = next_ == i ? std::next(i) : next_;
    i = expected_.erase(i);
    has_dropped = true;
  }
  if (has_dropped) {
    changed_.SignalAll();  // there is room
  }
}

void FarFiles::Fetch() {
  while (true) {
    std::vector<Expected*> batch;
    const auto takes_batch = [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
      std::int64_t batch_bytes = 0;
      while (next_ != expected_.end() && batch.size() < kFarBatchRanges) {
        const auto bytes = static_cast<std::int64_t>(next_->range.size);
        if ((held_bytes_ > 0 && held_bytes_ + bytes > kFarAheadBytes) ||
            (!batch.empty() && batch_bytes + bytes > kFarBatchBytes)) {
          break;
        }
        held_bytes_ += bytes;
        batch_bytes += bytes;
        next_->bytes.reset(new char[next_->range.size]);
        batch.push_back(&*next_);
        ++next_;
      }
      return !batch.empty();
    };
    if (!base::AwaitOrCancelled(ended_, &mutex_, &changed_, takes_batch).ok()) {
      return;
    }
    const absl::Status status = FetchBatch(batch);
    {
      const base::MutexLock lock(&mutex_);
      for (Expected* const expected : batch) {
        expected->is_done = true;
        expected->status = status;
      }
    }
    changed_.SignalAll();
  }
}

absl::Status FarFiles::FetchBatch(const std::vector<Expected*>& batch) {
  const io::MountedFile& first = files_[batch.front()->file];
  std::vector<io::FilePiece> pieces;
  for (const Expected* const expected : batch) {
    const io::MountedFile& file = files_[expected->file];
    if (first.read_pieces == nullptr || expected->file != batch.front()->file) {
      ISOSCOPE_RETURN_IF_ERROR(
          file.file->ReadAt(expected->range.offset, expected->range.size, expected->bytes.get()));
    } else {
      pieces.push_back({.range = expected->range, .out = expected->bytes.get()});
    }
  }
  return pieces.empty() ? absl::OkStatus() : first.read_pieces(pieces, ended_);
}

absl::Status FarFiles::ErrorInChild() { return FirstError(); }

void FarFiles::MountInChild(int socket) const {
  std::vector<io::MountedFile> mounted;
  for (std::size_t i = 0; i < files_.size(); ++i) {
    const io::RandomAccessFile& file = *files_[i].file;
    const auto number = static_cast<std::int64_t>(i);
    mounted.push_back({.file = std::make_shared<ChildFile>(number, file.path(), file.size_bytes(),
                                                           socket, memory_),
                       .version = files_[i].version,
                       .tells_all = files_[i].tells_all,
                       .expect_reads = [number, socket](absl::Span<const io::FileRange> ranges) {
                         SendExpectation(number, ranges, socket);
                       }});
  }
  io::ReplaceMounts(std::move(mounted));
}

}  // namespace isoscope::source
