// Feeds bytes to the interval tree in two ways: as page payloads with right checksums, which must
// neither crash nor report an inactive interval; and as intervals, whose tree must answer as a
// scan.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <iterator>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include "core/index/interval_tree.h"
#include "core/index/interval_tree_builder.h"
#include "core/index/interval_tree_format.h"
#include "core/io/page_file.h"
#include "tests/support/interval_tree.h"
#include "tests/support/memory_file.h"

namespace isoscope::index {
namespace {

using testing::MemoryReadFile;
using testing::MemoryWriteFile;

void Require(bool condition) {
  if (!condition) {
    std::abort();
  }
}

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
    Require(pages.Append(payload).ok());
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
                          }));
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
  Require(testing::BuildIntervalTree(intervals, &file).ok());
  const auto tree = IntervalTree::Open(std::make_unique<MemoryReadFile>(bytes), 1 << 20);
  Require(tree.ok());
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
      Require(result.ok());
      Require(result->page_read_count <=
              IntervalTree::MaxPageReads((*tree)->interval_count(),
                                         static_cast<std::int64_t>(expected.size())));
      std::sort(result->active.begin(), result->active.end(), Less);
      Require(result->active == expected);
    }
  }
}

}  // namespace
}  // namespace isoscope::index

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
