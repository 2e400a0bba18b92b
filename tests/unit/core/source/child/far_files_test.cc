#include "core/source/child/far_files.h"

#include <unistd.h>

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/socket.h>
#include <sys/wait.h>

#include "core/base/random.h"
#include "core/io/file.h"
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
    char answer[512];
    return send(socket, "x", 1, 0) == 1 && recv(socket, answer, sizeof(answer), 0) == 512 ? 0 : 2;
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
