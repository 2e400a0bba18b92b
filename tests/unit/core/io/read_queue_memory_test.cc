// Reads of a queue whose memory runs out at any allocation, also in the threads of the queue and in
// destructors. Each read must give the right bytes or RESOURCE_EXHAUSTED, and nothing may wait for
// ever or leak.

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/no_memory.h"
#include "core/base/status_macros.h"
#include "core/io/read_queue.h"
#include "tests/support/memory_failure.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/io/cold_file.h"

namespace isoscope::io {
namespace {

using testing::IsOk;
using testing::MemoryFailure;

constexpr std::size_t kReadBytes = 100;
constexpr std::size_t kReadCount = 24;

class ReadQueueMemoryTest : public ::testing::TestWithParam<std::tuple<ReadBackend, bool>> {
 protected:
  ReadQueueMemoryTest() {
    std::string bytes;
    for (std::size_t i = 0; i < kReadBytes * (kReadCount - 1) + 50; ++i) {
      bytes += static_cast<char>(i * i % 251);
    }
    const std::string path = dir_.Sub("file");
    std::ofstream(path, std::ios::binary) << bytes;
    auto file = OpenRandomAccessFile(path);
    EXPECT_THAT(file, IsOk());
    file_ = std::make_unique<ColdFile>(*std::move(file), std::get<1>(GetParam()), 50);
    bytes_ = std::move(bytes);
  }

  // Reads everything, the last read beyond the end of the file.
  absl::Status ReadAll() {
    std::vector<ReadQueue::Read> reads;
    for (std::size_t i = 0; i < kReadCount; ++i) {
      reads.push_back({file_.get(), static_cast<std::int64_t>(i * kReadBytes), kReadBytes});
    }
    ReadQueue queue(
        std::move(reads),
        {.backend = std::get<0>(GetParam()), .max_bytes = 20 << 16, .max_requests = 16});
    absl::Status error;
    std::size_t seen = 0;
    while (true) {
      ISOSCOPE_ASSIGN_OR_RETURN(const bool has_more, queue.WaitForMore(never_));
      if (!has_more) {
        EXPECT_TRUE(seen == kReadCount || !error.ok());
        return error;
      }
      while (const auto arrival = queue.TryTake()) {
        ++seen;
        if (absl::IsResourceExhausted(arrival->status())) {
          error = arrival->status();
        } else if (arrival->index() == kReadCount - 1) {
          EXPECT_TRUE(absl::IsDataLoss(arrival->status())) << arrival->status();
        } else {
          EXPECT_TRUE(arrival->status().ok() && absl::string_view(arrival->data(), kReadBytes) ==
                                                    absl::string_view(bytes_).substr(
                                                        arrival->index() * kReadBytes, kReadBytes));
        }
      }
    }
  }

  testing::TempDir dir_;
  std::string bytes_;
  std::unique_ptr<ColdFile> file_;
  const base::Cancellation never_;
};

TEST_P(ReadQueueMemoryTest, NoAllocationEndsTheProcessOrIsWaitedForForEver) {
  const auto run = [&](std::int64_t nth, MemoryFailure::Mode mode) {
    SCOPED_TRACE(
        absl::StrCat("allocation ", nth, mode == MemoryFailure::Mode::kOnce ? "" : " and later"));
    bool has_failed = false;
    {
      absl::Status status;
      {
        const MemoryFailure failure(nth, mode);
        status = base::OrNoMemory("reads", [&] { return ReadAll(); });
        has_failed = failure.has_come();
      }
      EXPECT_TRUE(status.ok() || (has_failed && absl::IsResourceExhausted(status))) << status;
    }
    return has_failed && !HasFailure();
  };
  // Objects that are made once are made now. Otherwise the first run that waits would make the list
  // of callbacks.
  {
    const base::Cancellation::Callback callback(never_, [] {});
  }
  run(1, MemoryFailure::Mode::kOnce);
  run(1000, MemoryFailure::Mode::kOnce);  // never happens
  const std::int64_t live_before = testing::LiveAllocationCount();
  const int run_count = testing::ForEachFailure(run);
  EXPECT_EQ(testing::LiveAllocationCount(), live_before) << "something leaked";
  EXPECT_GT(run_count, 50) << "there are too few reads";
}

INSTANTIATE_TEST_SUITE_P(BackEnds, ReadQueueMemoryTest,
                         ::testing::Combine(::testing::Values(ReadBackend::kThreads,
                                                              ReadBackend::kIoUring),
                                            ::testing::Bool()));

}  // namespace
}  // namespace isoscope::io
