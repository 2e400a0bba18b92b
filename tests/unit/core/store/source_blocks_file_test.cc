#include "core/store/source_blocks_file.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/status_macros.h"
#include "tests/support/status_matchers.h"

namespace isoscope::store {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

// Blocks of 10, 20, 30, ... bytes, each of its own letter; block 5 can't be read.
std::unique_ptr<io::RandomAccessFile> MakeFile(bool is_local,
                                               const base::Cancellation* cancellation = nullptr) {
  const auto find = [](std::int64_t offset) {
    BlockPlace place{.ordinal = 0, .offset = 0, .size = 10};
    while (offset >= place.offset + place.size) {
      place = {.ordinal = place.ordinal + 1,
               .offset = place.offset + place.size,
               .size = place.size + 10};
    }
    return place;
  };
  const auto read = [](std::uint32_t ordinal, const base::Cancellation& ends,
                       char* out) -> absl::Status {
    ISOSCOPE_RETURN_IF_ERROR(ends.Check());
    if (ordinal == 5) {
      return absl::NotFoundError("block 5: a.raw: no such file");
    }
    std::fill_n(out, 10 * (ordinal + 1), static_cast<char>('a' + ordinal));
    return absl::OkStatus();
  };
  return MakeSourceBlocksFile("s/blocks.bin", 10 + 20 + 30 + 40 + 50 + 60,
                              {.find = find, .read = read, .is_local = is_local}, cancellation);
}

TEST(SourceBlocksFileTest, ReadsEndWithTheirCancellation) {
  base::Cancellation cancellation;
  const auto file = MakeFile(false, &cancellation);
  std::string bytes(15, '\0');
  ISOSCOPE_EXPECT_OK(file->ReadAt(0, bytes.size(), bytes.data()));
  cancellation.Cancel();
  EXPECT_THAT(file->ReadAt(0, bytes.size(), bytes.data()), StatusIs(absl::StatusCode::kCancelled));
}

TEST(SourceBlocksFileTest, ReadsEveryStretch) {
  std::string all;
  for (int block = 0; block < 5; ++block) {
    all += std::string(static_cast<std::size_t>(10 * (block + 1)), static_cast<char>('a' + block));
  }
  for (const bool is_local : {false, true}) {
    const auto file = MakeFile(is_local);
    EXPECT_EQ(file->size_bytes(), 210);
    EXPECT_EQ(file->descriptor(), -1);
    for (std::size_t begin = 0; begin <= all.size(); ++begin) {
      for (std::size_t size = 0; begin + size <= all.size(); size += 7) {
        std::string read(size, '?');
        ISOSCOPE_ASSERT_OK(file->ReadAt(static_cast<std::int64_t>(begin), size, read.data()));
        ASSERT_EQ(read, all.substr(begin, size)) << begin;
        // Threads that compute read what is near.
        std::string cached(size, '?');
        ASSERT_EQ(file->ReadCached(static_cast<std::int64_t>(begin), size, cached.data()),
                  is_local ? size : 0);
        ASSERT_EQ(cached, is_local ? read : std::string(size, '?'));
      }
    }
  }
}

TEST(SourceBlocksFileTest, ErrorsNameBlockFileAndSource) {
  const auto file = MakeFile(true);
  std::string read(60, '?');
  EXPECT_THAT(
      file->ReadAt(150, 60, read.data()),
      StatusIs(absl::StatusCode::kNotFound, AllOf(HasSubstr("block 5"), HasSubstr("a.raw"))));
  EXPECT_EQ(file->ReadCached(150, 60, read.data()), 0U);
  EXPECT_THAT(file->ReadAt(200, 11, read.data()), StatusIs(absl::StatusCode::kDataLoss));
}

}  // namespace
}  // namespace isoscope::store
