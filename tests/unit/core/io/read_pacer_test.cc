#include "core/io/read_pacer.h"

#include <cstddef>
#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::io {
namespace {

// An event of a pacer, repeated `times` times.
enum Event { kBegin, kEnd, kMiss, kHit, kEndBatch };
struct Step {
  Event event;
  std::size_t times;
  std::size_t bytes;  // of the buffer that begins or ends, or the next one
  bool has_room;      // afterwards, for `bytes`
  bool is_due;        // afterwards
};

TEST(ReadPacerTest, ReadsBeginAsTheTableSays) {
  struct Case {
    std::string name;
    std::size_t max_bytes;
    std::size_t max_count;
    std::vector<Step> steps;
  };
  const std::vector<Case> cases = {
      {"bytes are bounded",
       100,
       10,
       {{kBegin, 1, 40, true, true},
        {kBegin, 1, 40, false, true},
        {kBegin, 0, 20, true, true},
        {kEnd, 1, 40, true, true}}},
      {"just as many bytes",
       80,
       10,
       {{kBegin, 1, 40, true, true}, {kBegin, 1, 40, false, true}, {kEnd, 1, 40, true, true}}},
      {"requests are bounded", 100, 2, {{kBegin, 2, 1, false, true}, {kEnd, 1, 1, true, true}}},
      {"a larger one goes alone",
       10,
       2,
       {{kMiss, 1, 90, true, true},
        {kBegin, 1, 90, false, true},
        {kBegin, 0, 1, false, true},
        {kEnd, 1, 90, true, true}}},
      {"a larger one waits for others",
       10,
       2,
       {{kBegin, 1, 1, true, true},
        {kBegin, 0, 90, false, true},
        {kEnd, 1, 1, true, true},
        {kBegin, 0, 90, true, true}}},
      {"no wait without a batch", 100, 99, {{kMiss, 8, 1, true, true}, {kBegin, 9, 1, true, true}}},
      {"a quarter of the batch is awaited",
       100,
       99,
       {{kBegin, 8, 1, true, true},
        {kMiss, 7, 1, true, true},
        {kEndBatch, 1, 1, true, true},
        {kMiss, 1, 1, true, false},
        {kEnd, 1, 1, true, false},
        {kEnd, 1, 1, true, true},
        {kBegin, 1, 1, true, false}}},
      {"of a small batch, the first",
       100,
       99,
       {{kBegin, 3, 1, true, true}, {kEndBatch, 1, 1, true, true}, {kMiss, 9, 1, true, true}}},
      {"one hit ends the wait",
       100,
       99,
       {{kBegin, 8, 1, true, true},
        {kEndBatch, 1, 1, true, true},
        {kMiss, 20, 1, true, false},
        {kHit, 1, 1, true, true},
        {kMiss, 7, 1, true, true},
        {kMiss, 1, 1, true, false}}},
      {"a batch is due with all slots free",
       100,
       4,
       {{kBegin, 4, 1, false, true},
        {kEndBatch, 1, 1, false, true},
        {kMiss, 8, 1, false, false},
        {kEnd, 4, 1, true, true}}},
  };
  for (const Case& c : cases) {
    ReadPacer pacer(c.max_bytes, c.max_count);
    std::size_t begun = 0;
    std::size_t misses = 0;
    for (std::size_t i = 0; i < c.steps.size(); ++i) {
      SCOPED_TRACE(c.name + ", step " + std::to_string(i));
      const Step& step = c.steps[i];
      for (std::size_t k = 0; k < step.times; ++k) {
        switch (step.event) {
          case kBegin:
            pacer.Begin(step.bytes);
            ++begun;
            break;
          case kEnd:
            pacer.End(step.bytes);
            --begun;
            break;
          case kMiss:
            pacer.RecordMiss();
            ++misses;
            break;
          case kHit:
            EXPECT_EQ(pacer.RecordHit(), misses >= ReadPacer::kColdReads);
            misses = 0;
            break;
          case kEndBatch:
            pacer.EndBatch();
            break;
        }
      }
      EXPECT_EQ(pacer.HasRoom(step.bytes), step.has_room);
      EXPECT_EQ(pacer.IsDue(), step.is_due);
      EXPECT_EQ(pacer.is_idle(), begun == 0);
      EXPECT_EQ(pacer.is_cold(), misses >= ReadPacer::kColdReads);
    }
  }
}

TEST(ReadPacerTest, BuffersAreWholeSteps) {
  constexpr std::size_t kStep = ReadPacer::kBufferStepBytes;
  const std::size_t cases[][2] = {{0, kStep}, {1, kStep}, {kStep, kStep}, {kStep + 1, 2 * kStep}};
  for (const auto& [read_bytes, buffer_bytes] : cases) {
    EXPECT_EQ(ReadPacer::BufferBytesFor(read_bytes), buffer_bytes) << read_bytes;
  }
}

}  // namespace
}  // namespace isoscope::io
