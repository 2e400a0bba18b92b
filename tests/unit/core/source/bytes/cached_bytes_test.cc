#include "core/source/bytes/cached_bytes.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/types/span.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/mutex.h"
#include "core/base/process_interrupt.h"
#include "core/base/random.h"
#include "core/base/status_macros.h"
#include "tests/support/memory_store.h"
#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using testing::IsOk;
using ::testing::Pair;
using ::testing::SizeIs;
using testing::StatusIs;

std::string NoiseOf(std::size_t size) {
  std::string bytes(size, '\0');
  for (std::size_t i = 0; i < size; ++i) {
    bytes[i] = static_cast<char>(base::RandomBits(3, i));
  }
  return bytes;
}

// Notes the requests, and fails while it is told to.
class NotedBytes final : public ByteSource {
 public:
  explicit NotedBytes(const std::string& bytes) : bytes_(bytes) {}

  [[nodiscard]] absl::Status ReadRanges(absl::Span<const ByteRange> ranges,
                                        const base::Cancellation& cancellation) const override {
    for (const ByteRange& range : ranges) {
      requests_.emplace_back(range.offset, static_cast<std::int64_t>(range.size));
    }
    return is_failing_ ? absl::UnavailableError("gone") : bytes_.ReadRanges(ranges, cancellation);
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return bytes_.size_bytes(); }
  [[nodiscard]] const std::string& name() const override { return bytes_.name(); }
  [[nodiscard]] std::string version() const override { return ""; }

  std::vector<std::pair<std::int64_t, std::int64_t>> TakeRequests() const {
    return std::exchange(requests_, {});
  }
  void SetFailing(bool is_failing) { is_failing_ = is_failing; }

 private:
  const testing::MemoryBytes bytes_;
  mutable std::vector<std::pair<std::int64_t, std::int64_t>> requests_;
  bool is_failing_ = false;
};

class CachedBytesTest : public ::testing::Test {
 protected:
  explicit CachedBytesTest(std::size_t size = 40 * kCachedBlockBytes + 17)
      : bytes_(NoiseOf(size)),
        source_(std::make_shared<NotedBytes>(bytes_)),
        file_(MakeCachedFile(source_, "https://host/x")) {}

  std::string Read(std::int64_t offset, std::size_t size) const {
    std::string out(size, '?');
    const absl::Status status = file_->ReadAt(offset, size, out.data());
    return status.ok() ? out : std::string(status.message());
  }

  const std::string bytes_;
  const std::shared_ptr<NotedBytes> source_;
  const std::unique_ptr<io::RandomAccessFile> file_;
};

TEST_F(CachedBytesTest, ReadsASmallPieceOnce) {
  EXPECT_EQ(file_->path(), "https://host/x");
  EXPECT_EQ(file_->size_bytes(), static_cast<std::int64_t>(bytes_.size()));
  EXPECT_EQ(Read(100, 8), bytes_.substr(100, 8));
  EXPECT_THAT(source_->TakeRequests(), ElementsAre(Pair(0, kCachedBlockBytes)));
  EXPECT_EQ(Read(0, 1000), bytes_.substr(0, 1000));
  EXPECT_EQ(Read(kCachedBlockBytes - 1, 1), bytes_.substr(kCachedBlockBytes - 1, 1));
  EXPECT_THAT(source_->TakeRequests(), IsEmpty());
}

// The request that opened an object has its first block; one of another size is left alone.
TEST_F(CachedBytesTest, TakesTheFirstBlock) {
  const auto first = MakeCachedFile(source_, "https://host/y",
                                    bytes_.substr(0, static_cast<std::size_t>(kCachedBlockBytes)));
  std::string out(1000, '?');
  ISOSCOPE_ASSERT_OK(first->ReadAt(5, out.size(), out.data()));
  EXPECT_EQ(out, bytes_.substr(5, out.size()));
  EXPECT_THAT(source_->TakeRequests(), IsEmpty());
  ISOSCOPE_ASSERT_OK(first->ReadAt(kCachedBlockBytes, 1, out.data()));
  EXPECT_THAT(source_->TakeRequests(), ElementsAre(Pair(kCachedBlockBytes, 2 * kCachedBlockBytes)));

  const auto cut = MakeCachedFile(source_, "https://host/z", bytes_.substr(0, 100));
  ISOSCOPE_ASSERT_OK(cut->ReadAt(5, out.size(), out.data()));
  EXPECT_EQ(out, bytes_.substr(5, out.size()));
}

TEST_F(CachedBytesTest, ReadsAheadOfThoseWhoGoOn) {
  for (std::int64_t offset = 0; offset + 1000 <= file_->size_bytes(); offset += 1000) {
    ASSERT_EQ(Read(offset, 1000), bytes_.substr(static_cast<std::size_t>(offset), 1000)) << offset;
  }
  // 1, 2, 4, 8, 16 blocks, and the rest.
  EXPECT_THAT(source_->TakeRequests(), SizeIs(6));
}

// As directories between samples are read; blocks that were left out are not asked for later.
TEST_F(CachedBytesTest, ReadsAheadOfThoseWhoLeaveBlocksOut) {
  for (const std::int64_t first : {0, 1, 2}) {
    for (std::int64_t block = first; block < 40; block += 3) {
      const std::int64_t offset = block * kCachedBlockBytes + 9;
      ASSERT_EQ(Read(offset, 100), bytes_.substr(static_cast<std::size_t>(offset), 100)) << block;
    }
  }
  // 1, 2 + 2, 4 + 1, 8 + 2, 16 + 2 blocks, and the rest.
  EXPECT_THAT(source_->TakeRequests(), SizeIs(::testing::Le(7)));
  // Farther away is another place.
  Read(10, 1);
  EXPECT_THAT(source_->TakeRequests(), IsEmpty());
}

TEST_F(CachedBytesTest, ReadsLongPiecesDirectly) {
  EXPECT_EQ(Read(5, kDirectReadBytes), bytes_.substr(5, kDirectReadBytes));
  EXPECT_THAT(source_->TakeRequests(), ElementsAre(Pair(5, kDirectReadBytes)));
}

TEST_F(CachedBytesTest, ReadsTheEndAndNotBehind) {
  const std::int64_t size = file_->size_bytes();
  EXPECT_EQ(Read(size - 20, 20), bytes_.substr(bytes_.size() - 20));
  EXPECT_EQ(Read(size, 0), "");
  std::string out(2, '?');
  EXPECT_THAT(file_->ReadAt(size - 1, 2, out.data()), StatusIs(absl::StatusCode::kDataLoss));
}

TEST_F(CachedBytesTest, AnErrorIsNotKept) {
  source_->SetFailing(true);
  EXPECT_EQ(Read(0, 4), "gone");
  source_->SetFailing(false);
  EXPECT_EQ(Read(0, 4), bytes_.substr(0, 4));
}

class ManyBlocksTest : public CachedBytesTest {
 protected:
  ManyBlocksTest() : CachedBytesTest((kMaxCachedBlocks + 100) * kCachedBlockBytes + 5) {}
};

TEST_F(ManyBlocksTest, AnyOrderGivesTheBytesInBoundedMemory) {
  for (std::uint64_t i = 0; i < 4000; ++i) {
    const auto offset = static_cast<std::int64_t>(base::RandomBits(11, i) % bytes_.size());
    const auto size = std::min<std::size_t>(base::RandomBits(12, i) % 200'000,
                                            bytes_.size() - static_cast<std::size_t>(offset));
    ASSERT_TRUE(Read(offset, size) == bytes_.substr(static_cast<std::size_t>(offset), size))
        << offset << " " << size;
  }
  // What was read first is gone: the kept blocks are not all.
  source_->TakeRequests();
  for (std::int64_t block = 0; block < kMaxCachedBlocks + 100; ++block) {
    Read(block * kCachedBlockBytes, 1);
  }
  EXPECT_THAT(source_->TakeRequests(), ::testing::Not(IsEmpty()));
}

// What is read is fewer than all blocks of the file: those of others are evicted.
TEST_F(ManyBlocksTest, AllFilesTogetherAreBounded) {
  const auto other = MakeCachedFile(source_, "https://host/y");
  std::string out(1, '?');
  for (std::int64_t block = 0; block < kMaxCachedBlocks; ++block) {
    ASSERT_EQ(Read(block * kCachedBlockBytes, 1).size(), 1);
    ASSERT_THAT(other->ReadAt(block * kCachedBlockBytes, 1, out.data()), IsOk());
    ASSERT_LE(CachedBlockCount(), kMaxCachedBlocks);
  }
  EXPECT_EQ(CachedBlockCount(), kMaxCachedBlocks);
}

TEST(CachedBlocksTest, GoWithTheirFile) {
  const auto source = std::make_shared<testing::MemoryBytes>(NoiseOf(13 * kCachedBlockBytes));
  const auto one = MakeCachedFile(source, "https://host/x");
  std::string out(1, '?');
  ASSERT_THAT(one->ReadAt(0, 1, out.data()), IsOk());
  const std::int64_t before = CachedBlockCount();
  auto two = MakeCachedFile(source, "https://host/x");
  for (const std::int64_t block : {0, 6, 12}) {  // farther apart than steps
    ASSERT_THAT(two->ReadAt(block * kCachedBlockBytes, 1, out.data()), IsOk());
  }
  EXPECT_EQ(CachedBlockCount(), before + 3);
  two.reset();
  EXPECT_EQ(CachedBlockCount(), before);
}

// Requests of one block stand still until they are released, or fail.
class StalledBytes final : public ByteSource {
 public:
  StalledBytes(const std::string& bytes, std::int64_t stalled_block)
      : bytes_(bytes), stalled_offset_(stalled_block * kCachedBlockBytes) {}

  [[nodiscard]] absl::Status ReadRanges(absl::Span<const ByteRange> ranges,
                                        const base::Cancellation& cancellation) const override {
    if (ranges[0].offset == stalled_offset_) {
      {
        const base::MutexLock lock(&mutex_);
        ++request_count_;
        changed_.SignalAll();
      }
      ISOSCOPE_RETURN_IF_ERROR(base::AwaitOrCancelled(
          cancellation, &mutex_, &changed_,
          [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return is_released_; }));
      const base::MutexLock lock(&mutex_);
      if (failures_ > 0) {
        --failures_;
        return absl::UnavailableError("gone");
      }
    }
    return bytes_.ReadRanges(ranges, cancellation);
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return bytes_.size_bytes(); }
  [[nodiscard]] const std::string& name() const override { return bytes_.name(); }
  [[nodiscard]] std::string version() const override { return ""; }

  void AwaitRequest() const {
    const base::MutexLock lock(&mutex_);
    changed_.Await(&mutex_,
                   [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return request_count_ > 0; });
  }
  void Release(int failures = 0) {
    const base::MutexLock lock(&mutex_);
    is_released_ = true;
    failures_ = failures;
    changed_.SignalAll();
  }
  int request_count() const {
    const base::MutexLock lock(&mutex_);
    return request_count_;
  }

 private:
  const testing::MemoryBytes bytes_;
  const std::int64_t stalled_offset_;
  mutable base::Mutex mutex_;
  mutable base::CondVar changed_;
  mutable int request_count_ ABSL_GUARDED_BY(mutex_) = 0;
  mutable int failures_ ABSL_GUARDED_BY(mutex_) = 0;
  bool is_released_ ABSL_GUARDED_BY(mutex_) = false;
};

class StalledReadTest : public ::testing::Test {
 protected:
  static constexpr std::int64_t kStalled = 3;

  StalledReadTest()
      : bytes_(NoiseOf(20 * kCachedBlockBytes)),
        source_(std::make_shared<StalledBytes>(bytes_, kStalled)),
        file_(MakeCachedFile(source_, "https://host/x")) {}

  absl::Status ReadBlock(std::int64_t block) const {
    std::string out(1000, '?');
    const std::int64_t offset = block * kCachedBlockBytes + 7;
    const absl::Status status = file_->ReadAt(offset, out.size(), out.data());
    return !status.ok() || out == bytes_.substr(static_cast<std::size_t>(offset), out.size())
               ? status
               : absl::InternalError("other bytes");
  }

  const std::string bytes_;
  const std::shared_ptr<StalledBytes> source_;
  const std::unique_ptr<io::RandomAccessFile> file_;
};

// Without this all that follow would wait: the test would not end.
TEST_F(StalledReadTest, OtherBlocksAreReadMeanwhile) {
  std::vector<absl::Status> answers(3);
  std::vector<std::thread> readers;
  readers.emplace_back([&] { answers[0] = ReadBlock(kStalled); });
  source_->AwaitRequest();
  for (const std::int64_t block : {0, 1, 2, 4, 9}) {
    EXPECT_THAT(ReadBlock(block), IsOk()) << block;
  }
  for (std::size_t i = 1; i < answers.size(); ++i) {
    readers.emplace_back([&answers, i, this] { answers[i] = ReadBlock(kStalled); });
  }
  source_->Release();
  for (std::thread& reader : readers) {
    reader.join();
  }
  for (const absl::Status& answer : answers) {
    EXPECT_THAT(answer, IsOk());
  }
  EXPECT_EQ(source_->request_count(), 1);
}

TEST_F(StalledReadTest, AfterAFailureThoseWhoWaitedAskThemselves) {
  std::vector<absl::Status> answers(4);
  std::vector<std::thread> readers;
  for (absl::Status& answer : answers) {
    readers.emplace_back([&answer, this] { answer = ReadBlock(kStalled); });
  }
  source_->AwaitRequest();
  source_->Release(/*failures=*/2);
  for (std::thread& reader : readers) {
    reader.join();
  }
  EXPECT_EQ(std::count_if(answers.begin(), answers.end(),
                          [](const absl::Status& answer) { return absl::IsUnavailable(answer); }),
            2);
  EXPECT_EQ(std::count(answers.begin(), answers.end(), absl::OkStatus()), 2);
  EXPECT_EQ(source_->request_count(), 3);
}

TEST_F(StalledReadTest, TheInterruptEndsThoseWhoWait) {
  base::Cancellation interrupt;
  base::SetProcessInterrupt(&interrupt);
  std::vector<absl::Status> answers(3);
  std::vector<std::thread> readers;
  for (absl::Status& answer : answers) {
    readers.emplace_back([&answer, this] { answer = ReadBlock(kStalled); });
  }
  source_->AwaitRequest();
  interrupt.Cancel();
  for (std::thread& reader : readers) {
    reader.join();
  }
  base::SetProcessInterrupt(nullptr);
  for (const absl::Status& answer : answers) {
    EXPECT_THAT(answer, StatusIs(absl::StatusCode::kCancelled));
  }
  source_->Release();
  EXPECT_THAT(ReadBlock(kStalled), IsOk());
}

TEST_F(StalledReadTest, ManyThreadsReadTheBytes) {
  source_->Release();
  std::vector<std::thread> readers;
  std::vector<int> wrong(4);
  for (std::size_t thread = 0; thread < wrong.size(); ++thread) {
    readers.emplace_back([&, thread] {
      for (std::uint64_t i = 0; i < 500; ++i) {
        const std::size_t offset = base::RandomBits(21 + thread, i) % bytes_.size();
        const std::size_t size = std::min<std::size_t>(base::RandomBits(31 + thread, i) % 150'000,
                                                       bytes_.size() - offset);
        std::string out(size, '?');
        const auto status = file_->ReadAt(static_cast<std::int64_t>(offset), size, out.data());
        wrong[thread] += status.ok() && out == bytes_.substr(offset, size) ? 0 : 1;
      }
    });
  }
  for (std::thread& reader : readers) {
    reader.join();
  }
  EXPECT_THAT(wrong, ::testing::Each(0));
}

}  // namespace
}  // namespace isoscope::source
