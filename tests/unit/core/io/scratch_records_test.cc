#include "core/io/scratch_records.h"

#include <cstdint>
#include <vector>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::io {
namespace {

using ::isoscope::testing::TempDir;

struct Record {
  std::uint32_t key = 0;
  std::uint64_t value = 0;
};

TEST(ScratchRecordsTest, WhatIsAppendedComesBackInOrderForAnyBufferAndLength) {
  const TempDir dir;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, ScratchFile::Create(dir.path()));
  for (const std::int64_t buffer_bytes : {1, 16, 50, 4096}) {
    for (const std::int64_t count : {0, 1, 2, 3, 4, 255, 256, 257, 1000}) {
      const ScratchRange range{.offset = 24, .count = count};
      RecordWriter<Record> writer(file.get(), range.offset, buffer_bytes);
      for (std::int64_t i = 0; i < count; ++i) {
        EXPECT_EQ(writer.offset(), range.offset + i * static_cast<std::int64_t>(sizeof(Record)));
        ISOSCOPE_ASSERT_OK(writer.Append(
            {static_cast<std::uint32_t>(i), static_cast<std::uint64_t>(count * 1000 + i)}));
      }
      ISOSCOPE_ASSERT_OK(writer.Flush());

      RecordReader<Record> reader(file.get(), range, buffer_bytes);
      std::vector<std::uint64_t> values;
      while (true) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const absl::Span<const Record> records, reader.Next());
        if (records.empty()) {
          break;
        }
        for (const Record& record : records) {
          EXPECT_EQ(record.key, values.size());
          values.push_back(record.value);
        }
      }
      ASSERT_EQ(values.size(), static_cast<std::size_t>(count));
      for (std::size_t i = 0; i < values.size(); ++i) {
        EXPECT_EQ(values[i], static_cast<std::uint64_t>(count) * 1000 + i);
      }
    }
  }
}

TEST(ScratchRecordsTest, ABufferSmallerThanARecordHoldsOne) {
  EXPECT_EQ(RecordsIn<Record>(1), 1u);
  EXPECT_EQ(RecordsIn<Record>(3 * sizeof(Record)), 3u);
}

}  // namespace
}  // namespace isoscope::io
