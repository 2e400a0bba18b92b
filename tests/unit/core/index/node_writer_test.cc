#include "core/index/node_writer.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/index/interval_tree.h"
#include "core/index/interval_tree_format.h"
#include "core/io/page_file.h"
#include "tests/support/memory_file.h"
#include "tests/support/status_matchers.h"

namespace isoscope::index {
namespace {

using ::isoscope::testing::MemoryReadFile;
using ::isoscope::testing::MemoryWriteFile;

BlockInterval IntervalAt(std::uint32_t i) {
  return {.span = {i - 0.5, i + 0.25}, .block_id = 7 * i, .ordinal = i};
}

TEST(NodeWriterTest, RunFillsItsPagesAndHasNoEmptyOne) {
  for (const std::uint32_t count : {0u, 1u, 169u, 170u, 171u, 340u, 341u}) {
    SCOPED_TRACE(count);
    std::string bytes;
    MemoryWriteFile file(&bytes);
    io::PageFileWriter writer(&file, 0);
    ISOSCOPE_ASSERT_OK(writer.Append(""));
    EntryRunWriter entry_run(&writer);
    for (std::uint32_t i = 0; i < count; ++i) {
      EXPECT_EQ(entry_run.entry_count(), i);
      ISOSCOPE_ASSERT_OK(entry_run.Append(IntervalAt(i)));
    }
    ISOSCOPE_ASSERT_OK(entry_run.Finish());
    EXPECT_EQ(entry_run.entry_count(), count);
    ASSERT_EQ(writer.page_count(), 1 + (count + 169) / 170);

    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pages,
                                  io::PageFile::Open(std::make_unique<MemoryReadFile>(bytes), 0));
    io::PageReadCost cost;
    for (std::uint32_t begin = 0; begin < count; begin += 170) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto page, pages->Read(1 + begin / 170, &cost));
      const char* payload = page.payload().data();
      EXPECT_EQ(base::LoadLittleEndian<std::uint16_t>(payload), format::kEntryPageKind);
      const std::uint32_t size = base::LoadLittleEndian<std::uint16_t>(payload + 2);
      ASSERT_EQ(size, std::min(170u, count - begin));
      for (std::uint32_t i = 0; i < size; ++i) {
        EXPECT_EQ(
            format::DecodeEntry(payload + format::kEntryPageHeaderBytes + i * format::kEntryBytes),
            IntervalAt(begin + i));
      }
    }
  }
}

TEST(NodeWriterTest, LargestNodeFitsIntoItsPageAndKeepsEveryField) {
  std::vector<double> lower = {-std::numeric_limits<double>::infinity()};
  while (static_cast<std::int64_t>(lower.size()) < format::kMaxSlabs) {
    lower.push_back(static_cast<double>(lower.size()) / 3);
  }
  NodeRecords node(lower);
  node.header.left_end = 1;
  node.header.right_end = 20;
  node.header.window_end = 300;
  node.header.leaf_end = 0xffffffff;
  std::uint32_t next = 0;
  for (format::SlabRecord& slab : node.slabs) {
    slab.left_begin = ++next;
    slab.right_begin = ++next;
    slab.leaf_begin = ++next;
    slab.window_begin = ++next;
    slab.window_size = ++next;
    slab.child_page = ++next;
  }

  const std::string payload = node.Encode();
  ASSERT_LE(payload.size(), io::kPagePayloadBytes);
  EXPECT_EQ(base::LoadLittleEndian<std::uint16_t>(payload.data()), format::kNodeKind);
  const format::NodeHeader header = format::DecodeNodeHeader(payload.data());
  EXPECT_EQ(header.slab_count, format::kMaxSlabs);
  EXPECT_EQ(header.left_end, 1u);
  EXPECT_EQ(header.right_end, 20u);
  EXPECT_EQ(header.window_end, 300u);
  EXPECT_EQ(header.leaf_end, 0xffffffff);
  next = 0;
  for (std::size_t slab = 0; slab < lower.size(); ++slab) {
    const format::SlabRecord record = format::DecodeSlabRecord(
        payload.data() + format::SlabRecordOffset(static_cast<std::int64_t>(slab)));
    EXPECT_EQ(record.lower, lower[slab]);
    EXPECT_EQ(record.left_begin, ++next);
    EXPECT_EQ(record.right_begin, ++next);
    EXPECT_EQ(record.leaf_begin, ++next);
    EXPECT_EQ(record.window_begin, ++next);
    EXPECT_EQ(record.window_size, ++next);
    EXPECT_EQ(record.child_page, ++next);
  }
}

}  // namespace
}  // namespace isoscope::index
