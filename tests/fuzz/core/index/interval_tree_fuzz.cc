// Feeds bytes to the interval tree in two ways: as page payloads with right checksums, which must
// neither crash nor report an inactive interval; and as intervals, whose tree must answer as a
// scan.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include "core/index/interval_tree.h"
#include "core/index/interval_tree_builder.h"
#include "core/index/interval_tree_format.h"
#include "core/io/page_file.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/interval_tree.h"
#include "tests/support/memory_file.h"

namespace isoscope::index {
namespace {

using testing::MemoryReadFile;
using testing::MemoryWriteFile;

using fuzz::Require;

bool Less(const BlockInterval& a, const BlockInterval& b) {
  return std::tie(a.ordinal, a.block_id, a.span.min, a.span.max) <
         std::tie(b.ordinal, b.block_id, b.span.min, b.span.max);
}

void QueryPayloads(absl::string_view payloads) {
  std::string bytes;
  MemoryWriteFile file(&bytes);
  io::PageFileWriter pages(&file, 0);
  while (!payloads.empty()) {
    const absl::string_view payload = payloads.substr(0, io::kPagePayloadBytes);
    Require(pages.Append(payload).ok(), "a payload makes a page");
    payloads.remove_prefix(payload.size());
  }
  const auto tree = IntervalTree::Open(std::make_unique<MemoryReadFile>(bytes), 1 << 20);
  if (!tree.ok()) {
    return;
  }
  for (const double isovalue : {-1e300, -1.0, 0.0, 0.5, 100.0, 1e300}) {
    const auto result = (*tree)->Query(isovalue);
    if (result.ok()) {
      Require(std::all_of(result->active.begin(), result->active.end(),
                          [isovalue](const BlockInterval& interval) {
                            return volume::IsActive(interval.span, isovalue);
                          }),
              "an interval of the answer is active");
    }
  }
}

void CompareWithScan(absl::string_view entries) {
  std::vector<BlockInterval> intervals;
  for (; entries.size() >= format::kEntryBytes; entries.remove_prefix(format::kEntryBytes)) {
    intervals.push_back(format::DecodeEntry(entries.data()));
  }
  std::string bytes;
  MemoryWriteFile file(&bytes);
  Require(testing::BuildIntervalTree(intervals, &file).ok(), "any intervals make a tree");
  const auto tree = IntervalTree::Open(std::make_unique<MemoryReadFile>(bytes), 1 << 20);
  Require(tree.ok(), "a tree that was built can be opened");
  for (std::size_t i = 0; i < std::min<std::size_t>(intervals.size(), 16); ++i) {
    for (const double isovalue : {intervals[i].span.min, intervals[i].span.max}) {
      if (!std::isfinite(isovalue)) {
        continue;
      }
      std::vector<BlockInterval> expected;
      std::copy_if(intervals.begin(), intervals.end(), std::back_inserter(expected),
                   [isovalue](const BlockInterval& interval) {
                     return volume::IsActive(interval.span, isovalue);
                   });
      std::sort(expected.begin(), expected.end(), Less);
      auto result = (*tree)->Query(isovalue);
      Require(result.ok(), "a tree that was built answers");
      Require(result->page_read_count <=
                  IntervalTree::MaxPageReads((*tree)->interval_count(),
                                             static_cast<std::int64_t>(expected.size())),
              "an answer reads no more pages than it may");
      std::sort(result->active.begin(), result->active.end(), Less);
      Require(result->active == expected, "a tree answers as a scan");
    }
  }
}

std::vector<BlockInterval> SomeIntervals(std::size_t count) {
  std::vector<BlockInterval> intervals;
  for (std::size_t i = 0; i < count; ++i) {
    const auto min = static_cast<double>(i * 37 % 100);
    intervals.push_back({.span = {.min = min, .max = min + static_cast<double>(i % 7)},
                         .block_id = static_cast<volume::BlockId>(i),
                         .ordinal = static_cast<std::uint32_t>(i)});
  }
  return intervals;
}

}  // namespace
}  // namespace isoscope::index

std::vector<std::string> isoscope::fuzz::Seeds() {
  std::vector<std::string> seeds;
  for (const std::size_t count : {std::size_t{1}, std::size_t{30}, std::size_t{400}}) {
    const auto intervals = index::SomeIntervals(count);
    std::string bytes;
    testing::MemoryWriteFile file(&bytes);
    Require(testing::BuildIntervalTree(intervals, &file).ok(), "seeds make a tree");
    std::string pages(1, '\0');
    for (std::size_t at = 0; at + io::kPageBytes <= bytes.size(); at += io::kPageBytes) {
      pages += bytes.substr(at, io::kPagePayloadBytes);
    }
    seeds.push_back(pages);
    std::string entries(1, '\1');
    for (const index::BlockInterval& interval : intervals) {
      entries.resize(entries.size() + index::format::kEntryBytes);
      index::format::EncodeEntry(interval,
                                 entries.data() + entries.size() - index::format::kEntryBytes);
    }
    seeds.push_back(entries);
  }
  return seeds;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) {
    return 0;
  }
  const absl::string_view rest(reinterpret_cast<const char*>(data) + 1, size - 1);
  if (data[0] % 2 == 0) {
    isoscope::index::QueryPayloads(rest);
  } else {
    isoscope::index::CompareWithScan(rest);
  }
  return 0;
}
