#include "core/source/child/far_files.h"

#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/socket.h>
#include <sys/wait.h>

#include "core/base/cancellation.h"
#include "core/base/mutex.h"
#include "core/base/random.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "tests/support/memory_file.h"
#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

class NamedBytes final : public io::RandomAccessFile {
 public:
  NamedBytes(std::string path, const std::string& bytes) : path_(std::move(path)), bytes_(bytes) {}
  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    return offset == 13 ? absl::UnavailableError("the server is busy")
                        : bytes_.ReadAt(offset, size, out);
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return bytes_.size_bytes(); }
  [[nodiscard]] const std::string& path() const override { return path_; }

 private:
  const std::string path_;
  const testing::MemoryReadFile bytes_;
};

std::string BytesOf(std::size_t size) {
  std::string bytes(size, '\0');
  for (std::size_t i = 0; i < size; ++i) {
    bytes[i] = static_cast<char>(base::RandomBits(5, i));
  }
  return bytes;
}

// Runs `check` in a forked process: its number is the exit code; 0 is good.
template <typename Check>
int InChild(FarFiles* far, Check check) {
  const int socket = far->child_socket();
  const pid_t pid = fork();
  if (pid == 0) {
    far->MountInChild(socket);
    _exit(check(socket));
  }
  far->Serve();
  int status = 0;
  waitpid(pid, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 255;
}

TEST(FarFilesTest, AChildReadsWhatTheParentHasMounted) {
  const std::string a = BytesOf(3'000'001);
  auto far = FarFiles::Make({{.file = std::make_shared<NamedBytes>("https://h/far/a", a)},
                             {.file = std::make_shared<NamedBytes>("https://h/far/b", "bytes")}});
  ASSERT_THAT(far.status(), testing::IsOk());
  const int code = InChild(far->get(), [&](int /*socket*/) {
    const auto whole = io::ReadWholeFile("https://h/far/a", 1 << 24);
    if (!whole.ok() || *whole != a) {
      return 1;
    }
    const auto other = io::ReadWholeFile("https://h/far/b", 5);
    if (!other.ok() || *other != "bytes" || io::PathExists("https://h/far/c")) {
      return 2;
    }
    const auto file = io::OpenRandomAccessFile("https://h/far/a");
    char out[8];
    const absl::Status late = (*file)->ReadAt(13, 4, out);
    if (!absl::IsUnavailable(late) || late.message() != "the server is busy") {
      return 3;
    }
    return absl::IsDataLoss((*file)->ReadAt(3'000'000, 2, out)) ? 0 : 4;
  });
  EXPECT_EQ(code, 0);
}

TEST(FarFilesTest, AChildThatSendsAnythingGetsErrors) {
  auto far =
      FarFiles::Make({{.file = std::make_shared<NamedBytes>("https://h/far/a", "0123456789")}});
  ASSERT_THAT(far.status(), testing::IsOk());
  const int code = InChild(far->get(), [&](int socket) {
    constexpr std::int64_t kMost = INT64_MAX;
    for (const std::int64_t number : {std::int64_t{-1}, std::int64_t{0}, std::int64_t{1}, kMost}) {
      for (const std::int64_t offset :
           {std::int64_t{-1}, std::int64_t{0}, std::int64_t{11}, kMost}) {
        for (const std::int64_t size :
             {std::int64_t{-1}, std::int64_t{0}, std::int64_t{11}, kMost}) {
          const std::int64_t request[3] = {number, offset, size};
          std::int32_t answer[128] = {};
          if (send(socket, request, sizeof(request), 0) < 0 ||
              recv(socket, answer, sizeof(answer), 0) != sizeof(answer) || answer[0] == 0) {
            return 1;
          }
        }
      }
    }
    // Ranges to expect, of which none makes sense; nothing answers.
    const std::int64_t ranges[7] = {0, 2, 0, -5, 3, 5, kMost};
    const std::int64_t other[5] = {7, 1, 0, 0, 3};
    const std::int64_t too_many[5] = {0, kMost, 0, 0, 3};
    if (send(socket, ranges, sizeof(ranges), 0) < 0 || send(socket, other, sizeof(other), 0) < 0) {
      return 3;
    }
    char answer[512];
    if (send(socket, too_many, sizeof(too_many), 0) < 0 ||
        recv(socket, answer, sizeof(answer), 0) != 512) {
      return 4;
    }
    return send(socket, "x", 1, 0) == 1 && recv(socket, answer, sizeof(answer), 0) == 512 ? 0 : 2;
  });
  EXPECT_EQ(code, 0);
}

// Expected ranges come at once, whatever order they are asked for in, and more than are held.
TEST(FarFilesTest, ExpectedRangesAreFetchedBefore) {
  const std::string a = BytesOf(50'000'000);
  std::atomic<int> calls{0};
  std::atomic<int> single_reads{0};
  class CountedFile final : public io::RandomAccessFile {
   public:
    CountedFile(const std::string& bytes, std::atomic<int>* reads) : bytes_(bytes), reads_(reads) {}
    [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                      char* out) const override {
      ++*reads_;
      return bytes_.ReadAt(offset, size, out);
    }
    [[nodiscard]] std::int64_t size_bytes() const override { return bytes_.size_bytes(); }
    [[nodiscard]] const std::string& path() const override { return path_; }

   private:
    const std::string path_ = "https://h/far/a";
    const testing::MemoryReadFile bytes_;
    std::atomic<int>* const reads_;
  };
  auto far = FarFiles::Make(
      {{.file = std::make_shared<CountedFile>(a, &single_reads),
        .read_pieces = [&](absl::Span<const io::FilePiece> pieces,
                           const base::Cancellation& /*cancellation*/) -> absl::Status {
          ++calls;
          for (const io::FilePiece& piece : pieces) {
            if (piece.range.offset == 49'000'000) {
              return absl::UnavailableError("the server is gone");
            }
            a.copy(piece.out, piece.range.size, static_cast<std::size_t>(piece.range.offset));
          }
          return absl::OkStatus();
        }}});
  ASSERT_THAT(far.status(), testing::IsOk());
  const int code = InChild(far->get(), [&](int /*socket*/) {
    std::vector<io::FileRange> ranges;
    for (std::int64_t i = 0; i < 480; ++i) {
      ranges.push_back({.offset = i * 100'000, .size = 100'000});
    }
    const auto mounted = io::FindMounted("https://h/far/a");
    mounted->expect_reads(ranges);
    std::string out(100'000, '\0');
    // In order, then one near the end, one that was passed, one of half a range.
    for (const std::int64_t i : {0, 1, 2, 3, 7, 470, 5, 471, 479}) {
      if (!mounted->file->ReadAt(i * 100'000, out.size(), out.data()).ok() ||
          out != a.substr(static_cast<std::size_t>(i) * 100'000, out.size())) {
        return 1;
      }
    }
    mounted->expect_reads(std::vector<io::FileRange>{{.offset = 1000, .size = 100'000}});
    for (const std::int64_t begin : {1000, 51'000}) {
      if (!mounted->file->ReadAt(begin, 50'000, out.data()).ok() ||
          out.substr(0, 50'000) != a.substr(static_cast<std::size_t>(begin), 50'000)) {
        return 2;
      }
    }
    mounted->expect_reads(std::vector<io::FileRange>{{.offset = 49'000'000, .size = 9}});
    const absl::Status gone = mounted->file->ReadAt(49'000'000, 9, out.data());
    return absl::IsUnavailable(gone) && !FarFiles::ErrorInChild().ok() ? 0 : 3;
  });
  EXPECT_EQ(code, 0);
  EXPECT_EQ(single_reads, 1);  // of the one that was passed
  EXPECT_GT(calls, 2);
}

// A server that does not answer: the end does not wait for it.
TEST(FarFilesTest, TheEndCancelsWhatIsFetched) {
  auto far = FarFiles::Make(
      {{.file = std::make_shared<NamedBytes>("https://h/far/a", "0123456789"),
        .read_pieces = [](absl::Span<const io::FilePiece> /*pieces*/,
                          const base::Cancellation& cancellation) -> absl::Status {
          base::Mutex mutex;
          base::CondVar never;
          return base::AwaitOrCancelled(cancellation, &mutex, &never, [] { return false; });
        }}});
  ASSERT_THAT(far.status(), testing::IsOk());
  const int code = InChild(far->get(), [](int /*socket*/) {
    io::FindMounted("https://h/far/a")
        ->expect_reads(std::vector<io::FileRange>{{.offset = 0, .size = 9}});
    return 0;
  });
  EXPECT_EQ(code, 0);
}

TEST(FarFilesTest, EndsWithoutAChild) {
  auto far = FarFiles::Make({});
  ASSERT_THAT(far.status(), testing::IsOk());
  (*far)->Serve();
}

}  // namespace
}  // namespace isoscope::source
