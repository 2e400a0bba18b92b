// Finding the active blocks: a query of the external interval tree against a scan of the range
// table, by number of blocks and selectivity, each warm and from a cold start.
//
// A block's span is as in a smooth volume: its middle anywhere in the 16-bit range, its width such
// that the stated share of all blocks is active at the middle value. "Cold" is cold for the
// process: a page cache of its own that holds nothing, or a table that must be read from its file
// first. The files stay in the kernel's page cache; where a disk stands behind it, add its time for
// `read_pages` or `read_bytes`, which are counted.

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "benchmark/benchmark.h"

#include "core/base/check.h"
#include "core/base/random.h"
#include "core/base/units.h"
#include "core/index/interval_tree.h"
#include "core/index/interval_tree_builder.h"
#include "core/io/file.h"
#include "core/volume/range_table.h"

namespace isoscope::index {
namespace {

// As an agent opens it.
constexpr std::int64_t kPageCacheBytes = 4 * base::kMiB;
constexpr double kIsovalue = 32767.5;

// A folder of the process, removed at its end.
class Folder {
 public:
  Folder() {
    const char* parent = std::getenv("TMPDIR");
    path_ = absl::StrCat(parent != nullptr ? parent : "/tmp", "/index_benchmark-XXXXXX");
    ISOSCOPE_CHECK(mkdtemp(path_.data()) != nullptr);
  }
  ~Folder() { io::RemoveRecursively(path_).IgnoreError(); }  // nobody is left to tell
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  [[nodiscard]] std::string Sub(const std::string& name) const {
    return absl::StrCat(path_, "/", name);
  }
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

volume::ScalarSpan SpanOf(std::int64_t id, double selectivity) {
  const auto n = static_cast<std::uint64_t>(id);
  const double middle = 65535 * base::RandomUnit(11, 2 * n);
  const double half_width = 65535 * selectivity * base::RandomUnit(11, 2 * n + 1);
  return {std::floor(std::max(middle - half_width, 0.0)),
          std::ceil(std::min(middle + half_width, 65535.0))};
}

// The range table of a set, in memory and in a file, and its tree.
struct Set {
  volume::RangeTable ranges;
  std::string range_path;
  std::string tree_path;
};

std::unique_ptr<io::RandomAccessFile> OpenFile(const std::string& path) {
  auto file = io::OpenRandomAccessFile(path);
  ISOSCOPE_CHECK(file.ok());
  return *std::move(file);
}

// Built once, as large ones take seconds.
const Set& SetOf(std::int64_t block_count, double selectivity) {
  static const Folder* folder = new Folder;
  static std::map<std::pair<std::int64_t, double>, Set> sets;
  static const bool is_registered = [] { return std::atexit([] { delete folder; }) == 0; }();
  ISOSCOPE_CHECK(is_registered);
  const auto [at, is_new] = sets.try_emplace({block_count, selectivity});
  Set& set = at->second;
  if (is_new) {
    const std::string name = absl::StrCat(block_count, "-", selectivity);
    set.ranges = volume::RangeTable(volume::ScalarType::kUint16, block_count);
    IntervalTreeBuilder builder({.scratch_directory = folder->path()});
    for (std::int64_t id = 0; id < block_count; ++id) {
      const volume::ScalarSpan span = SpanOf(id, selectivity);
      const auto block = static_cast<volume::BlockId>(id);
      set.ranges.Set(block, span);
      ISOSCOPE_CHECK(builder.Add({span, block, block}).ok());
    }
    set.tree_path = folder->Sub(absl::StrCat("tree-", name));
    auto file = io::CreateWritableFile(set.tree_path);
    ISOSCOPE_CHECK(file.ok());
    ISOSCOPE_CHECK(builder.Finish(file->get()).ok());
    set.range_path = folder->Sub(absl::StrCat("ranges-", name));
    ISOSCOPE_CHECK(io::WriteWholeFile(set.range_path, set.ranges.bytes()).ok());
  }
  return set;
}

const Set& SetOf(const benchmark::State& state) {
  return SetOf(state.range(0), static_cast<double>(state.range(1)) / 1000);
}

void ReportActive(std::size_t active_count, benchmark::State* state) {
  state->counters["active"] = static_cast<double>(active_count);
}

void BM_TreeQueryCold(benchmark::State& state) {
  const Set& set = SetOf(state);
  QueryResult result;
  for (auto _ : state) {
    const auto tree = IntervalTree::Open(OpenFile(set.tree_path), kPageCacheBytes);
    ISOSCOPE_CHECK(tree.ok());
    auto queried = (*tree)->Query(kIsovalue);
    ISOSCOPE_CHECK(queried.ok());
    result = *std::move(queried);
  }
  ReportActive(result.active.size(), &state);
  state.counters["read_pages"] = static_cast<double>(result.page_read_count);
  state.counters["read_bytes"] = static_cast<double>(result.read_bytes);
  state.counters["bound_pages"] = static_cast<double>(
      IntervalTree::MaxPageReads(state.range(0), static_cast<std::int64_t>(result.active.size())));
}

// The same isovalue again and again, as a camera turns: what fits into the page cache stays there.
void BM_TreeQueryWarm(benchmark::State& state) {
  const Set& set = SetOf(state);
  const auto tree = IntervalTree::Open(OpenFile(set.tree_path), kPageCacheBytes);
  ISOSCOPE_CHECK(tree.ok());
  ISOSCOPE_CHECK((*tree)->Query(kIsovalue).ok());
  QueryResult result;
  for (auto _ : state) {
    auto queried = (*tree)->Query(kIsovalue);
    ISOSCOPE_CHECK(queried.ok());
    result = *std::move(queried);
  }
  ReportActive(result.active.size(), &state);
  state.counters["read_bytes"] = static_cast<double>(result.read_bytes);
}

// The ids of the active blocks, from a table in memory.
void BM_TableScanInMemory(benchmark::State& state) {
  const Set& set = SetOf(state);
  std::size_t active_count = 0;
  for (auto _ : state) {
    active_count = set.ranges.ActiveBlocks(kIsovalue).Ids().size();
  }
  ReportActive(active_count, &state);
}

// The same, of a table that is read from its file for each query.
void BM_TableScanFromFile(benchmark::State& state) {
  const Set& set = SetOf(state);
  std::size_t active_count = 0;
  std::int64_t read_bytes = 0;
  for (auto _ : state) {
    auto bytes = io::ReadWholeFile(set.range_path, base::kGiB);
    ISOSCOPE_CHECK(bytes.ok());
    read_bytes = static_cast<std::int64_t>(bytes->size());
    const auto ranges = volume::RangeTable::FromBytes(volume::ScalarType::kUint16, state.range(0),
                                                      *std::move(bytes));
    active_count = ranges.ActiveBlocks(kIsovalue).Ids().size();
  }
  ReportActive(active_count, &state);
  state.counters["read_bytes"] = static_cast<double>(read_bytes);
}

// The build, in the memory of the default options.
void BM_TreeBuild(benchmark::State& state) {
  const Folder folder;
  for (auto _ : state) {
    IntervalTreeBuilder builder({.scratch_directory = folder.path()});
    for (std::int64_t id = 0; id < state.range(0); ++id) {
      const auto block = static_cast<volume::BlockId>(id);
      ISOSCOPE_CHECK(builder.Add({SpanOf(id, 0.1), block, block}).ok());
    }
    const std::string path = folder.Sub("tree");
    auto file = io::CreateWritableFile(path);
    ISOSCOPE_CHECK(file.ok());
    ISOSCOPE_CHECK(builder.Finish(file->get()).ok());
    state.counters["file_bytes"] = static_cast<double>((*file)->size_bytes());
    ISOSCOPE_CHECK(io::RemoveRecursively(path).ok());
  }
}

void AllSets(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"blocks", "permille"})->Unit(benchmark::kMillisecond);
  for (const std::int64_t block_count : {100000, 1000000, 10000000}) {
    for (const std::int64_t permille : {1, 10, 100, 300}) {
      benchmark->Args({block_count, permille});
    }
  }
}
BENCHMARK(BM_TreeQueryCold)->Apply(AllSets);
BENCHMARK(BM_TreeQueryWarm)->Apply(AllSets);
BENCHMARK(BM_TableScanInMemory)->Apply(AllSets);
BENCHMARK(BM_TableScanFromFile)->Apply(AllSets);
BENCHMARK(BM_TreeBuild)
    ->ArgName("blocks")
    ->Arg(100000)
    ->Arg(1000000)
    ->Arg(10000000)
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace isoscope::index
