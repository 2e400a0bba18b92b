// Most tests run for each back end (ReadQueueTest): every read arrives once with its bytes, for
//
// - files that are in memory, partly in memory, or not at all (cold_file.h);
// - any number of threads, sizes of buffers and of system calls;
// - errors: outside the file, of the system, of files without a descriptor;
// - cancellation and destruction while reads are under way.

#include "core/io/read_queue.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/mman.h>

#include "core/base/mutex.h"
#include "core/base/random.h"
#include "tests/support/fault_file.h"
#include "tests/support/skips.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/io/cold_file.h"

namespace isoscope::io {
namespace {

using ::isoscope::testing::MakeDescriptorFile;
using ::isoscope::testing::MakeFaultyFile;
using ::isoscope::testing::ReadFault;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::_;
using ::testing::AllOf;
using ::testing::HasSubstr;

// The results of a queue, by read.
struct Answer {
  absl::Status status;
  std::string bytes;
};
using Answers = std::map<std::size_t, Answer>;

// Finds the first half of each read in memory.
class HalfCachedFile : public ColdFile {
 public:
  using ColdFile::ColdFile;
  [[nodiscard]] std::size_t ReadCached(std::int64_t offset, std::size_t size,
                                       char* out) const override {
    return ReadAt(offset, size / 2, out).ok() ? size / 2 : 0;
  }
};

// Counts the calls of ReadCached, and finds bytes in memory after `miss_count` calls.
class CountingFile : public ColdFile {
 public:
  CountingFile(std::unique_ptr<RandomAccessFile> file, std::size_t miss_count)
      : ColdFile(std::move(file)), miss_count_(miss_count) {}
  [[nodiscard]] std::size_t ReadCached(std::int64_t offset, std::size_t size,
                                       char* out) const override {
    return ++asked_count_ > miss_count_ && ReadAt(offset, size, out).ok() ? size : 0;
  }
  [[nodiscard]] std::size_t asked_count() const { return asked_count_; }

 private:
  const std::size_t miss_count_;
  mutable std::atomic<std::size_t> asked_count_{0};
};

// Has no descriptor, and blocks its readers until it is opened.
class GateFile : public RandomAccessFile {
 public:
  [[nodiscard]] absl::Status ReadAt(std::int64_t /*offset*/, std::size_t size,
                                    char* out) const override {
    ++read_count_;
    base::MutexLock lock(&mutex_);
    opened_.Await(&mutex_, [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return is_open_; });
    std::fill_n(out, size, 'x');
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return 1 << 30; }
  [[nodiscard]] const std::string& path() const override { return path_; }

  void Open() {
    base::MutexLock lock(&mutex_);
    is_open_ = true;
    opened_.SignalAll();
  }
  [[nodiscard]] int read_count() const { return read_count_; }

 private:
  const std::string path_ = "gate";
  mutable std::atomic<int> read_count_{0};
  mutable base::Mutex mutex_;
  mutable base::CondVar opened_;
  bool is_open_ ABSL_GUARDED_BY(mutex_) = false;
};

class ReadQueueTest : public ::testing::TestWithParam<ReadBackend> {
 protected:
  void SetUp() override {
    if (GetParam() == ReadBackend::kIoUring && !IoUringIsAvailable()) {
      ISOSCOPE_SKIP("io_uring", "this kernel, or the rules of this container, refuse it");
    }
    options_.backend = GetParam();
    bytes_.resize(1'000'000);
    for (std::size_t i = 0; i < bytes_.size(); ++i) {
      bytes_[i] = static_cast<char>(base::RandomBits(1, i));
    }
    ISOSCOPE_ASSERT_OK(WriteWholeFile(path_, bytes_));
  }

  [[nodiscard]] std::unique_ptr<RandomAccessFile> Open() const {
    return OpenRandomAccessFile(path_).value();
  }
  [[nodiscard]] std::unique_ptr<RandomAccessFile> OpenCold() const {
    return std::make_unique<ColdFile>(Open());
  }

  // `count` ranges of all sizes, some empty, anywhere in the file.
  [[nodiscard]] std::vector<ReadQueue::Read> RandomReads(const RandomAccessFile& file,
                                                         std::uint64_t seed,
                                                         std::size_t count) const {
    std::vector<ReadQueue::Read> reads;
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t size = base::RandomBits(seed, 2 * i) % (i % 7 == 0 ? 200'000 : 3'000);
      const std::size_t offset = base::RandomBits(seed, 2 * i + 1) % (bytes_.size() - size + 1);
      reads.push_back({&file, static_cast<std::int64_t>(offset), i % 31 == 0 ? 0 : size});
    }
    return reads;
  }

  // Takes all reads, on `thread_count` threads at once, as callers should.
  static Answers Drain(ReadQueue* queue, const std::vector<ReadQueue::Read>& reads,
                       int thread_count) {
    Answers answers;
    base::Mutex mutex;
    const base::Cancellation never;
    while (queue->WaitForMore(never).value()) {
      std::vector<std::thread> threads;
      threads.reserve(static_cast<std::size_t>(thread_count));
      for (int i = 0; i < thread_count; ++i) {
        threads.emplace_back([&] {
          while (const std::optional<ReadQueue::Arrival> arrival = queue->TryTake()) {
            const std::size_t size = arrival->status().ok() ? reads[arrival->index()].size : 0;
            Answer answer{arrival->status(), std::string(arrival->data(), size)};
            base::MutexLock lock(&mutex);
            EXPECT_TRUE(answers.emplace(arrival->index(), std::move(answer)).second)
                << "read " << arrival->index() << " came twice";
          }
        });
      }
      for (std::thread& thread : threads) {
        thread.join();
      }
    }
    return answers;
  }
  Answers ReadAll(const std::vector<ReadQueue::Read>& reads, int thread_count = 1) {
    ReadQueue queue(reads, options_);
    return Drain(&queue, reads, thread_count);
  }

  void ExpectAllRight(const std::vector<ReadQueue::Read>& reads, const Answers& answers) const {
    ASSERT_EQ(answers.size(), reads.size());
    for (const auto& [index, answer] : answers) {
      ISOSCOPE_EXPECT_OK(answer.status);
      EXPECT_TRUE(answer.bytes ==
                  bytes_.substr(static_cast<std::size_t>(reads[index].offset), reads[index].size))
          << "read " << index;
    }
  }

  const TempDir temp_;
  const std::string path_ = temp_.Sub("f");
  std::string bytes_;
  ReadQueueOptions options_;
};

INSTANTIATE_TEST_SUITE_P(Backends, ReadQueueTest,
                         ::testing::Values(ReadBackend::kIoUring, ReadBackend::kThreads),
                         [](const auto& test) {
                           return test.param == ReadBackend::kIoUring ? "IoUring" : "Threads";
                         });

TEST_P(ReadQueueTest, EveryReadComesOnceWithItsBytesHoweverMuchIsCached) {
  const std::unique_ptr<RandomAccessFile> files[] = {
      Open(), OpenCold(), std::make_unique<HalfCachedFile>(Open()),
      MakeFaultyFile(Open(), ReadFault::kIoError, 2'000'000)};  // no descriptor
  for (const int thread_count : {1, 3}) {
    for (const auto& file : files) {
      const std::vector<ReadQueue::Read> reads = RandomReads(*file, 5, 300);
      ExpectAllRight(reads, ReadAll(reads, thread_count));
    }
    // All in one queue.
    std::vector<ReadQueue::Read> mixed;
    for (std::size_t i = 0; i < 4; ++i) {
      const std::vector<ReadQueue::Read> reads = RandomReads(*files[i], i, 50);
      mixed.insert(mixed.end(), reads.begin(), reads.end());
    }
    ExpectAllRight(mixed, ReadAll(mixed, thread_count));
  }
}

TEST_P(ReadQueueTest, BackendIsTheOneAskedForAndMadeOnlyIfNeeded) {
  const auto cold = OpenCold();
  const std::vector<ReadQueue::Read> reads = RandomReads(*cold, 5, 10);
  ReadQueue queue(reads, options_);
  EXPECT_EQ(queue.backend_in_use(), ReadBackend::kAutomatic);
  Drain(&queue, reads, 1);
  EXPECT_EQ(queue.backend_in_use(), GetParam());

  // NOLINTBEGIN(concurrency-mt-unsafe): one thread
  ASSERT_EQ(setenv("ISOSCOPE_READ_BACKEND",
                   GetParam() == ReadBackend::kThreads ? "threads" : "io_uring", 1),
            0);
  ReadQueue by_environment(reads);
  Drain(&by_environment, reads, 1);
  EXPECT_EQ(by_environment.backend_in_use(), GetParam());
  ASSERT_EQ(unsetenv("ISOSCOPE_READ_BACKEND"), 0);
  // NOLINTEND(concurrency-mt-unsafe)

  // All of it, from the same pages as were written.
  const auto warm = Open();
  std::vector<char> scratch(bytes_.size());
  if (warm->ReadCached(0, bytes_.size(), scratch.data()) == bytes_.size()) {
    const std::vector<ReadQueue::Read> warm_reads = RandomReads(*warm, 5, 10);
    ReadQueue warm_queue(warm_reads, options_);
    Drain(&warm_queue, warm_reads, 1);
    EXPECT_EQ(warm_queue.backend_in_use(), ReadBackend::kAutomatic);
  }
}

TEST_P(ReadQueueTest, ColdFilesAreSubmittedManyAtATimeAndNotAskedAgainAndAgain) {
  constexpr std::size_t kCount = 2000;
  for (const std::size_t max_requests : std::vector<std::size_t>{1, 2, 3, 5, 256}) {
    options_.max_requests = max_requests;
    for (const int thread_count : {1, 3}) {
      const CountingFile cold(Open(), kCount);
      std::vector<ReadQueue::Read> reads;
      for (std::size_t i = 0; i < kCount; ++i) {
        reads.push_back(
            {&cold, static_cast<std::int64_t>(base::RandomBits(3, i) % 900'000), 1 + i});
      }
      ExpectAllRight(reads, ReadAll(reads, thread_count));
      if (GetParam() == ReadBackend::kThreads) {
        EXPECT_EQ(cold.asked_count(), kCount);
      } else if (max_requests == 256) {
        EXPECT_LT(cold.asked_count(), kCount / 4);
      }
    }
  }
}

TEST_P(ReadQueueTest, WhatIsInMemoryIsTakenFromThereAlsoBehindColdParts) {
  constexpr std::size_t kCount = 2000;
  const CountingFile file(Open(), 20);
  const std::vector<ReadQueue::Read> reads(kCount, {&file, 1000, 500});
  ExpectAllRight(reads, ReadAll(reads));
  EXPECT_GT(file.asked_count(), kCount / 4);
}

TEST_P(ReadQueueTest, ReadsThatTheSystemEndsEarlyAreContinued) {
  const auto cold = OpenCold();
  const HalfCachedFile half(Open());
  for (const std::size_t transfer : {std::size_t{1}, std::size_t{4095}, std::size_t{100'000}}) {
    options_.max_transfer_bytes = transfer;
    for (const RandomAccessFile* file : {static_cast<const RandomAccessFile*>(cold.get()),
                                         static_cast<const RandomAccessFile*>(&half)}) {
      std::vector<ReadQueue::Read> reads = RandomReads(*file, 9, 20);
      if (transfer == 1) {
        for (ReadQueue::Read& read : reads) {
          read.size = std::min<std::size_t>(read.size, 100);
        }
      }
      ExpectAllRight(reads, ReadAll(reads));
    }
  }
}

TEST_P(ReadQueueTest, BytesAndRequestsStayWithinTheirBounds) {
  const auto file = OpenCold();
  std::vector<ReadQueue::Read> reads = RandomReads(*file, 11, 200);
  options_.max_bytes = 400'000;
  options_.max_requests = 5;
  ReadQueue queue(reads, options_);
  const base::Cancellation never;
  std::vector<ReadQueue::Arrival> held;
  std::size_t taken = 0;
  std::size_t most_held = 0;
  while (queue.WaitForMore(never).value()) {
    // Keeps all arrivals until there are no more: then the bounds have been reached.
    for (int attempt = 0; attempt < 20; ++attempt) {
      if (auto arrival = queue.TryTake()) {
        held.push_back(std::move(*arrival));
        ++taken;
      } else {
        absl::SleepFor(absl::Microseconds(100));
      }
    }
    std::size_t held_bytes = 0;
    for (const ReadQueue::Arrival& arrival : held) {
      held_bytes += reads[arrival.index()].size;
    }
    EXPECT_LE(held.size(), 5U);
    EXPECT_LE(held_bytes, 400'000U);
    EXPECT_LE(queue.peak_bytes(), 400'000U);
    most_held = std::max(most_held, held.size());
    held.clear();
  }
  EXPECT_EQ(taken, reads.size());
  EXPECT_GT(most_held, 1U);
  EXPECT_GT(queue.peak_bytes(), 200'000U);
}

TEST_P(ReadQueueTest, ReadLargerThanTheBoundGoesAlone) {
  const auto file = OpenCold();
  options_.max_bytes = 100'000;
  const std::vector<ReadQueue::Read> reads = {
      {file.get(), 0, 10'000}, {file.get(), 100, 900'000}, {file.get(), 7, 10'000}};
  ReadQueue queue(reads, options_);
  ExpectAllRight(reads, Drain(&queue, reads, 2));
  EXPECT_GE(queue.peak_bytes(), 900'000U);
  EXPECT_LE(queue.peak_bytes(), 1'000'000U);
}

TEST_P(ReadQueueTest, RangesOutsideTheFileFailAsReadAtDoesAndOthersDoNot) {
  const auto file = OpenCold();
  Answers answers = ReadAll({{file.get(), 999'990, 10},
                             {file.get(), 999'990, 11},
                             {file.get(), 1'000'001, 0},
                             {file.get(), 1'000'000, 0}});
  ISOSCOPE_EXPECT_OK(answers[0].status);
  char out[16] = {};
  EXPECT_EQ(answers[1].status, file->ReadAt(999'990, 11, out));
  EXPECT_THAT(answers[1].status,
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("ends after 1000000 bytes")));
  EXPECT_EQ(answers[2].status, file->ReadAt(1'000'001, 0, out));
  ISOSCOPE_EXPECT_OK(answers[3].status);
}

TEST_P(ReadQueueTest, FileCutAfterItWasOpenedFailsAsReadAtDoes) {
  const auto file = OpenCold();
  ASSERT_EQ(truncate(path_.c_str(), 700'000), 0);
  std::string out(10'000, '\0');
  for (const std::size_t transfer : {std::size_t{1} << 30, std::size_t{999}}) {
    options_.max_transfer_bytes = transfer;
    Answers answers = ReadAll({{file.get(), 690'000, 10'000},
                               {file.get(), 695'000, 10'000},
                               {file.get(), 800'000, 10'000}});
    ISOSCOPE_EXPECT_OK(answers[0].status);
    EXPECT_TRUE(answers[0].bytes == bytes_.substr(690'000, 10'000));
    EXPECT_THAT(answers[1].status,
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("ends after 700000 bytes")));
    EXPECT_EQ(answers[1].status, file->ReadAt(695'000, 10'000, out.data()));
    EXPECT_THAT(answers[2].status, StatusIs(absl::StatusCode::kDataLoss, HasSubstr(path_)));
  }
}

// The memory of this process as a file. A page in the middle lies past the end of its mapping.
// Reading it gives a short read, then EIO.
TEST_P(ReadQueueTest, ErrorOfTheSystemInTheMiddleFailsThatReadAndNoOther) {
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  char* const memory = static_cast<char*>(
      mmap(nullptr, 4 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
  ASSERT_NE(memory, MAP_FAILED);
  std::fill_n(memory, 4 * page, 'm');
  const int empty = memfd_create("empty", MFD_CLOEXEC);
  ASSERT_GE(empty, 0);
  ASSERT_NE(mmap(memory + 2 * page, page, PROT_READ, MAP_PRIVATE | MAP_FIXED, empty, 0),
            MAP_FAILED);
  ASSERT_EQ(close(empty), 0);
  const int descriptor = open("/proc/self/mem", O_RDONLY | O_CLOEXEC);
  ASSERT_GE(descriptor, 0);
  const auto base = static_cast<std::int64_t>(reinterpret_cast<std::uintptr_t>(memory));
  const auto file = MakeDescriptorFile(descriptor, base + 4 * static_cast<std::int64_t>(page),
                                       "memory of this process");
  const auto half = static_cast<std::int64_t>(page / 2);
  Answers answers = ReadAll({{file.get(), base, 2 * page},
                             {file.get(), base + half, 2 * page},
                             {file.get(), base + 6 * half, page}});
  ISOSCOPE_EXPECT_OK(answers[0].status);
  EXPECT_EQ(answers[0].bytes, std::string(2 * page, 'm'));
  EXPECT_THAT(answers[1].status,
              StatusIs(absl::StatusCode::kDataLoss,
                       AllOf(HasSubstr("read " + std::to_string(2 * page) + " bytes at offset " +
                                       std::to_string(base + half) + " of memory of this process"),
                             HasSubstr("Input/output error"))));
  std::string out(2 * page, '\0');
  EXPECT_EQ(answers[1].status, file->ReadAt(base + half, out.size(), out.data()));
  ISOSCOPE_EXPECT_OK(answers[2].status);
  EXPECT_EQ(answers[2].bytes, std::string(page, 'm'));
  ASSERT_EQ(munmap(memory, 4 * page), 0);
}

TEST_P(ReadQueueTest, ErrorsOfFilesWithoutDescriptorArePassedOn) {
  for (const ReadFault fault : {ReadFault::kIoError, ReadFault::kShortRead}) {
    const auto file = MakeFaultyFile(Open(), fault, 500'000);
    Answers answers = ReadAll({{file.get(), 0, 1000}, {file.get(), 499'999, 1000}});
    ISOSCOPE_EXPECT_OK(answers[0].status);
    EXPECT_THAT(answers[1].status, StatusIs(absl::StatusCode::kDataLoss, HasSubstr(path_)));
  }
}

TEST_P(ReadQueueTest, CancellationEndsTheWaitAndStartsNothingMore) {
  GateFile file;
  const std::vector<ReadQueue::Read> reads(1000, {&file, 0, 100});
  options_.max_requests = 4;
  base::Cancellation cancellation;
  std::atomic<bool> has_returned{false};
  ReadQueue queue(reads, options_);
  EXPECT_FALSE(queue.TryTake().has_value());
  std::thread waiting([&] {
    EXPECT_THAT(queue.WaitForMore(cancellation), StatusIs(absl::StatusCode::kCancelled, _));
    has_returned = true;
  });
  absl::SleepFor(absl::Milliseconds(30));
  EXPECT_FALSE(has_returned);
  cancellation.Cancel();
  waiting.join();  // though the file still blocks its readers
  EXPECT_LE(file.read_count(), 4);
  file.Open();
}

TEST_P(ReadQueueTest, DestroyedQueueWaitsForReadsUnderWayAndDropsTheRest) {
  const auto file = OpenCold();
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    const std::vector<ReadQueue::Read> reads = RandomReads(*file, seed, 100);
    ReadQueue queue(reads, options_);
    for (std::uint64_t i = 0; i < seed % 5; ++i) {
      static_cast<void>(queue.TryTake());
    }
  }
}

TEST_P(ReadQueueTest, EmptyListIsDoneAtOnce) {
  ReadQueue queue({}, options_);
  EXPECT_FALSE(queue.TryTake().has_value());
  EXPECT_FALSE(queue.WaitForMore(base::Cancellation()).value());
  EXPECT_EQ(queue.peak_bytes(), 0U);
}

TEST(IoUringReadQueueTest, ReadsThatWouldNeverEndAreCancelled) {
  if (!IoUringIsAvailable()) {
    ISOSCOPE_SKIP("io_uring", "this kernel, or the rules of this container, refuse it");
  }
  int ends[2] = {};
  ASSERT_EQ(pipe2(ends, O_CLOEXEC), 0);
  const auto file = MakeDescriptorFile(ends[0], 1000, "pipe");
  {
    ReadQueue queue({{file.get(), 0, 10}, {file.get(), 10, 10}},
                    {.backend = ReadBackend::kIoUring});
    EXPECT_FALSE(queue.TryTake().has_value());
    absl::SleepFor(absl::Milliseconds(20));
  }  // hangs here otherwise
  ASSERT_EQ(close(ends[1]), 0);
}

}  // namespace
}  // namespace isoscope::io
