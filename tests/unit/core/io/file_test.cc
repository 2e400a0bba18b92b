// Files on a real file system, and the faulty ones of tests/support:
//
// - writes of all sizes and in any order, compared with a model;
// - reads outside the file, and of a file that was cut after it was opened;
// - names: create, rename and remove, without overwriting anything by mistake;
// - errors: the code, the reason and the path of each, and that the first one stays.

#include "core/io/file.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <limits>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/resource.h>
#include <sys/stat.h>

#include "core/base/random.h"
#include "core/base/units.h"
#include "tests/support/fault_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::io {
namespace {

using ::isoscope::testing::MakeFaultyFile;
using ::isoscope::testing::MakeFullDiskFile;
using ::isoscope::testing::ReadFault;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::_;
using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(FileTest, ErrnoKeepsItsMeaningReasonAndPath) {
  const std::map<int, absl::StatusCode> expected = {{ENOENT, absl::StatusCode::kNotFound},
                                                    {ENOTDIR, absl::StatusCode::kNotFound},
                                                    {EACCES, absl::StatusCode::kPermissionDenied},
                                                    {EROFS, absl::StatusCode::kPermissionDenied},
                                                    {EEXIST, absl::StatusCode::kAlreadyExists},
                                                    {ENOSPC, absl::StatusCode::kResourceExhausted},
                                                    {EDQUOT, absl::StatusCode::kResourceExhausted},
                                                    {EMFILE, absl::StatusCode::kResourceExhausted},
                                                    {EIO, absl::StatusCode::kDataLoss},
                                                    {EBADF, absl::StatusCode::kInternal}};
  for (const auto& [error_number, code] : expected) {
    EXPECT_THAT(ErrnoToStatus(error_number, "open", "/a/b"),
                StatusIs(code, HasSubstr("open /a/b: ")));
  }
  EXPECT_THAT(ErrnoToStatus(ENOSPC, "write", "/a"),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("No space left on device")));
}

TEST(FileTest, AppendsOfAllSizesComeBack) {
  const TempDir temp;
  std::string expected;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, CreateWritableFile(temp.Sub("f")));
  for (const std::size_t size : {std::size_t{0}, std::size_t{1}, std::size_t{100000},
                                 std::size_t{200000}, std::size_t{262144}, std::size_t{3},
                                 std::size_t{262143}, std::size_t{2}, std::size_t{1000000}}) {
    const std::string piece(size, static_cast<char>('a' + size % 23));
    ISOSCOPE_ASSERT_OK(file->Append(piece));
    expected += piece;
    EXPECT_EQ(file->size_bytes(), static_cast<std::int64_t>(expected.size()));
  }
  ISOSCOPE_ASSERT_OK(file->Close());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadWholeFile(temp.Sub("f"), base::kGiB));
  EXPECT_TRUE(bytes == expected);
}

TEST(FileTest, RandomWritesEqualThoseOfAModel) {
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    const TempDir temp;
    std::string model;
    // With its own buffer, with smaller ones, and past the page cache.
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto file, seed % 3 == 0   ? CreateWritableFile(temp.Sub("f"))
                         : seed % 3 == 1 ? CreateBufferedFile(temp.Sub("f"), 64U << seed % 7)
                                         : CreateDirectFile(temp.Sub("f"), 4096U << seed % 7));
    for (std::uint64_t step = 0; step < 60; ++step) {
      const std::uint64_t bits = base::RandomBits(seed, step);
      // Mostly small pieces, sometimes one larger than the buffer.
      const std::size_t size = bits % 17 == 0 ? 300000 + bits % 1000 : bits % 5000;
      const std::string piece(size, static_cast<char>('A' + step % 50));
      std::size_t offset = model.size();
      if (bits >> 20 & 1) {
        offset = (bits >> 24) % 600000;
        ISOSCOPE_ASSERT_OK(file->WriteAt(static_cast<std::int64_t>(offset), piece));
      } else {
        ISOSCOPE_ASSERT_OK(file->Append(piece));
      }
      if (size > 0) {
        model.resize(std::max(model.size(), offset + size), '\0');
        model.replace(offset, size, piece);
      }
      ASSERT_EQ(file->size_bytes(), static_cast<std::int64_t>(model.size()));
    }
    ISOSCOPE_ASSERT_OK(file->Close());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes,
                                  ReadWholeFile(temp.Sub("f"), base::kGiB));
    EXPECT_TRUE(bytes == model) << "seed " << seed;
  }
}

TEST(FileTest, ClosedFileRefusesWritesAndClosesAgain) {
  const TempDir temp;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, CreateWritableFile(temp.Sub("f")));
  ISOSCOPE_ASSERT_OK(file->Close());
  EXPECT_THAT(file->Append("x"), StatusIs(absl::StatusCode::kFailedPrecondition, _));
  ISOSCOPE_EXPECT_OK(file->Close());
}

TEST(FileTest, ReadsOutsideTheFileAreDataLoss) {
  const TempDir temp;
  ISOSCOPE_ASSERT_OK(WriteWholeFile(temp.Sub("f"), "0123456789"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenRandomAccessFile(temp.Sub("f")));
  EXPECT_EQ(file->size_bytes(), 10);
  EXPECT_EQ(file->path(), temp.Sub("f"));
  char out[4] = {};
  ISOSCOPE_ASSERT_OK(file->ReadAt(6, 4, out));
  EXPECT_EQ(std::string(out, 4), "6789");
  ISOSCOPE_EXPECT_OK(file->ReadAt(10, 0, out));
  EXPECT_THAT(file->ReadAt(7, 4, out),
              StatusIs(absl::StatusCode::kDataLoss,
                       AllOf(HasSubstr(temp.Sub("f")), HasSubstr("ends after 10 bytes"))));
  EXPECT_THAT(file->ReadAt(11, 0, out), StatusIs(absl::StatusCode::kDataLoss, _));
  EXPECT_THAT(file->ReadAt(std::numeric_limits<std::int64_t>::max(), 4, out),
              StatusIs(absl::StatusCode::kDataLoss, _));
  EXPECT_THAT(file->ReadAt(1, std::numeric_limits<std::size_t>::max(), out),
              StatusIs(absl::StatusCode::kDataLoss, _));
}

TEST(FileTest, FileCutAfterItWasOpenedIsDataLoss) {
  const TempDir temp;
  ISOSCOPE_ASSERT_OK(WriteWholeFile(temp.Sub("f"), "0123456789"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenRandomAccessFile(temp.Sub("f")));
  ASSERT_EQ(truncate(temp.Sub("f").c_str(), 7), 0);
  char out[10] = {};
  EXPECT_THAT(file->ReadAt(0, 10, out),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("ends after 7 bytes")));
}

TEST(FileTest, ThreadsReadOneFileAtOnce) {
  const TempDir temp;
  std::string bytes(100000, '\0');
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] = static_cast<char>(base::RandomBits(1, i));
  }
  ISOSCOPE_ASSERT_OK(WriteWholeFile(temp.Sub("f"), bytes));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenRandomAccessFile(temp.Sub("f")));
  std::atomic<int> wrong_count{0};
  std::vector<std::thread> threads;
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    threads.emplace_back([&, seed] {
      char out[64];
      for (std::uint64_t i = 0; i < 500; ++i) {
        const std::size_t offset = base::RandomBits(seed, i) % (bytes.size() - sizeof(out));
        if (!file->ReadAt(static_cast<std::int64_t>(offset), sizeof(out), out).ok() ||
            bytes.compare(offset, sizeof(out), out, sizeof(out)) != 0) {
          ++wrong_count;
        }
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(wrong_count, 0);
}

TEST(FileTest, OpeningWhatIsNoRegularFileFails) {
  const TempDir temp;
  EXPECT_THAT(OpenRandomAccessFile(temp.Sub("none")),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr(temp.Sub("none"))));
  EXPECT_THAT(OpenRandomAccessFile(temp.path()),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("is a directory")));
  ASSERT_EQ(mkfifo(temp.Sub("fifo").c_str(), 0600), 0);  // opening it must not wait for a writer
  EXPECT_THAT(OpenRandomAccessFile(temp.Sub("fifo")),
              StatusIs(absl::StatusCode::kFailedPrecondition, _));
}

TEST(FileTest, NothingIsOverwritten) {
  const TempDir temp;
  ISOSCOPE_ASSERT_OK(WriteWholeFile(temp.Sub("f"), "old"));
  EXPECT_THAT(CreateWritableFile(temp.Sub("f")), StatusIs(absl::StatusCode::kAlreadyExists, _));
  EXPECT_THAT(WriteWholeFile(temp.Sub("f"), "new"), StatusIs(absl::StatusCode::kAlreadyExists, _));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadWholeFile(temp.Sub("f"), 3));
  EXPECT_EQ(bytes, "old");
  EXPECT_THAT(ReadWholeFile(temp.Sub("f"), 2),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("3 bytes")));
  EXPECT_THAT(CreateDirectory(temp.Sub("f")), StatusIs(absl::StatusCode::kAlreadyExists, _));
  EXPECT_THAT(CreateDirectory(temp.Sub("a/b")), StatusIs(absl::StatusCode::kNotFound, _));
}

TEST(FileTest, RenameReplacesFilesAndOnlyFiles) {
  const TempDir temp;
  ISOSCOPE_ASSERT_OK(WriteWholeFile(temp.Sub("f"), "f"));
  ISOSCOPE_ASSERT_OK(WriteWholeFile(temp.Sub("g"), "g"));
  ISOSCOPE_ASSERT_OK(CreateDirectory(temp.Sub("d")));
  ISOSCOPE_ASSERT_OK(CreateDirectory(temp.Sub("e")));  // empty: rename(2) would replace it
  ISOSCOPE_ASSERT_OK(RenamePath(temp.Sub("f"), temp.Sub("g")));
  EXPECT_FALSE(PathExists(temp.Sub("f")));
  EXPECT_EQ(ReadWholeFile(temp.Sub("g"), 10).value(), "f");
  EXPECT_THAT(RenamePath(temp.Sub("g"), temp.Sub("d")),
              StatusIs(absl::StatusCode::kAlreadyExists, _));
  EXPECT_THAT(RenamePath(temp.Sub("d"), temp.Sub("e")),
              StatusIs(absl::StatusCode::kAlreadyExists, HasSubstr(temp.Sub("e"))));
  EXPECT_THAT(RenamePath(temp.Sub("d"), temp.Sub("g")),
              StatusIs(absl::StatusCode::kAlreadyExists, _));
  EXPECT_THAT(RenamePath(temp.Sub("none"), temp.Sub("x")),
              StatusIs(absl::StatusCode::kNotFound, _));
  ISOSCOPE_ASSERT_OK(RenamePath(temp.Sub("d"), temp.Sub("e/moved/")));
  EXPECT_TRUE(IsDirectory(temp.Sub("e/moved")));
  EXPECT_FALSE(IsDirectory(temp.Sub("g")));
}

TEST(FileTest, RemoveTakesATreeAndLeavesWhatItsLinksPointTo) {
  const TempDir temp;
  ISOSCOPE_ASSERT_OK(CreateDirectory(temp.Sub("tree")));
  ISOSCOPE_ASSERT_OK(CreateDirectory(temp.Sub("tree/sub")));
  ISOSCOPE_ASSERT_OK(WriteWholeFile(temp.Sub("tree/sub/f"), "x"));
  ISOSCOPE_ASSERT_OK(CreateDirectory(temp.Sub("kept")));
  ISOSCOPE_ASSERT_OK(WriteWholeFile(temp.Sub("kept/f"), "x"));
  ASSERT_EQ(symlink(temp.Sub("kept").c_str(), temp.Sub("tree/link").c_str()), 0);
  ISOSCOPE_ASSERT_OK(RemoveRecursively(temp.Sub("tree")));
  EXPECT_FALSE(PathExists(temp.Sub("tree")));
  EXPECT_TRUE(PathExists(temp.Sub("kept/f")));
  ISOSCOPE_EXPECT_OK(RemoveRecursively(temp.Sub("tree")));  // nothing there
  ISOSCOPE_EXPECT_OK(SyncDirectory(temp.path()));
  EXPECT_THAT(SyncDirectory(temp.Sub("tree")), StatusIs(absl::StatusCode::kNotFound, _));
}

TEST(FileTest, BytesBelowAreThoseOfAllFilesInAllFolders) {
  const TempDir temp;
  EXPECT_EQ(BytesBelow(temp.Sub("missing")), 0);
  ISOSCOPE_ASSERT_OK(CreateDirectory(temp.Sub("in")));
  ISOSCOPE_ASSERT_OK(WriteWholeFile(temp.Sub("a"), "123"));
  ISOSCOPE_ASSERT_OK(WriteWholeFile(temp.Sub("in/b"), "45678"));
  EXPECT_EQ(BytesBelow(temp.path()), 8);
}

TEST(FileTest, FaultyFilesFailExactlyWhereTheyAreToldTo) {
  const TempDir temp;
  ISOSCOPE_ASSERT_OK(WriteWholeFile(temp.Sub("f"), "0123456789"));
  const auto faulty = [&](ReadFault fault) {
    return MakeFaultyFile(OpenRandomAccessFile(temp.Sub("f")).value(), fault, 5);
  };
  char out[10] = {};
  for (const ReadFault fault : {ReadFault::kIoError, ReadFault::kShortRead}) {
    ISOSCOPE_EXPECT_OK(faulty(fault)->ReadAt(0, 5, out));
    ISOSCOPE_EXPECT_OK(faulty(fault)->ReadAt(6, 4, out));
    EXPECT_THAT(faulty(fault)->ReadAt(5, 1, out), StatusIs(absl::StatusCode::kDataLoss, _));
  }
  ISOSCOPE_EXPECT_OK(faulty(ReadFault::kFlippedBit)->ReadAt(4, 3, out));
  EXPECT_EQ(std::string(out, 3), "446");

  const auto full = MakeFullDiskFile(CreateWritableFile(temp.Sub("g")).value(), 4);
  ISOSCOPE_EXPECT_OK(full->Append("012"));
  EXPECT_THAT(full->Append("34"), StatusIs(absl::StatusCode::kResourceExhausted, _));
  EXPECT_THAT(full->WriteAt(0, "x"), StatusIs(absl::StatusCode::kResourceExhausted, _));
  EXPECT_THAT(full->Close(), StatusIs(absl::StatusCode::kResourceExhausted, _));
}

// A limit on file sizes makes the system itself refuse to write.
TEST(FileTest, ErrorOfTheSystemIsReportedAndStaysReported) {
  const TempDir temp;
  struct rlimit old_limit {};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &old_limit), 0);
  auto* const old_handler = std::signal(SIGXFSZ, SIG_IGN);
  rlimit limit = old_limit;
  limit.rlim_cur = 1000000;
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
  const std::string bytes(600000, 'x');
  const auto write = [&](const std::string& path) {
    const auto file = CreateWritableFile(path).value();
    ISOSCOPE_EXPECT_OK(file->Append(bytes));
    EXPECT_THAT(file->Append(bytes),
                StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("File too large")));
    EXPECT_THAT(file->Append("x"), StatusIs(absl::StatusCode::kResourceExhausted, _));
    EXPECT_THAT(file->Close(), StatusIs(absl::StatusCode::kResourceExhausted, _));
    EXPECT_THAT(file->Close(), StatusIs(absl::StatusCode::kResourceExhausted, _));
  };
  write(temp.Sub("f"));
  EXPECT_THAT(WriteWholeFile(temp.Sub("g"), bytes + bytes),
              StatusIs(absl::StatusCode::kResourceExhausted, _));
  EXPECT_FALSE(PathExists(temp.Sub("g")));
  ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &old_limit), 0);
  std::signal(SIGXFSZ, old_handler);
}

}  // namespace
}  // namespace isoscope::io
