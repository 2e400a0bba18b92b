#include "core/io/external_sorter.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::io {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::_;

// Twelve bytes: a size that divides neither pages nor buffers.
struct Record {
  std::uint32_t key = 0;
  std::uint32_t payload[2] = {};

  friend bool operator<(const Record& a, const Record& b) { return a.key < b.key; }
};

template <typename Less = std::less<Record>>
std::vector<std::uint32_t> Sort(const std::string& directory, std::int64_t memory_bytes,
                                const std::vector<std::uint32_t>& keys) {
  ExternalSorter<Record, Less> sorter(directory, memory_bytes);
  for (const std::uint32_t key : keys) {
    EXPECT_TRUE(sorter.Add({key, {~key, key * 7}}).ok());
  }
  EXPECT_TRUE(sorter.Finish().ok());
  EXPECT_EQ(sorter.count(), static_cast<std::int64_t>(keys.size()));
  std::vector<std::uint32_t> sorted;
  while (!sorter.is_at_end()) {
    const Record& record = sorter.current();
    EXPECT_EQ(record.payload[0], ~record.key);
    EXPECT_EQ(record.payload[1], record.key * 7);
    sorted.push_back(record.key);
    EXPECT_TRUE(sorter.Advance().ok());
  }
  EXPECT_TRUE(std::filesystem::is_empty(directory));
  return sorted;
}

TEST(ExternalSorterTest, EqualsASortInMemoryForEveryCountAndMemory) {
  const TempDir dir;
  for (const std::int64_t memory : {1, 12, 36, 100, 1200, 200000}) {
    for (const std::size_t count : {0u, 1u, 2u, 3u, 8u, 9u, 99u, 100u, 101u, 400u, 1000u}) {
      std::vector<std::uint32_t> keys;
      for (std::size_t i = 0; i < count; ++i) {
        keys.push_back(static_cast<std::uint32_t>(base::RandomBits(7, i) % (count / 2 + 1)));
      }
      std::vector<std::uint32_t> expected = keys;
      std::sort(expected.begin(), expected.end());
      EXPECT_EQ(Sort(dir.path(), memory, keys), expected) << memory << ", " << count;
    }
  }
}

TEST(ExternalSorterTest, ManyRunsAreMergedInSeveralPasses) {
  const TempDir dir;
  std::vector<std::uint32_t> keys;
  for (std::uint32_t i = 0; i < 200000; ++i) {
    keys.push_back(static_cast<std::uint32_t>(base::RandomBits(8, i)));
  }
  std::vector<std::uint32_t> expected = keys;
  std::sort(expected.begin(), expected.end());
  // 1200 runs, two at a time; 37 runs, two at a time; 10, three at a time.
  for (const std::int64_t memory : {2000, 65536, 262144}) {
    EXPECT_TRUE(Sort(dir.path(), memory, keys) == expected) << memory;
  }
}

struct Descending {
  bool operator()(const Record& a, const Record& b) const { return b.key < a.key; }
};
TEST(ExternalSorterTest, TakesAnOrderOfItsOwn) {
  const TempDir dir;
  EXPECT_THAT(Sort<Descending>(dir.path(), 24, {3, 1, 4, 1, 5, 9, 2, 6}),
              ::testing::ElementsAre(9, 6, 5, 4, 3, 2, 1, 1));
}

TEST(ExternalSorterTest, FolderThatIsNotThereIsNotFoundWhenItIsNeeded) {
  const TempDir dir;
  ExternalSorter<Record> sorter(dir.Sub("absent"), 24);
  ISOSCOPE_EXPECT_OK(sorter.Add({1, {}}));
  ISOSCOPE_EXPECT_OK(sorter.Add({2, {}}));
  EXPECT_THAT(sorter.Add({3, {}}), StatusIs(absl::StatusCode::kNotFound, _));
}

}  // namespace
}  // namespace isoscope::io
