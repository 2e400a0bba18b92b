// Pages, their checksums and their cache:
//
// - the documented bytes of a page, and replacing one;
// - the counts of requests and of bytes, and the bound of the cache;
// - damage: flipped bits, misplaced pages, pages of other files, sizes that are no whole pages;
// - threads that share a small cache.

#include "core/io/page_file.h"

#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/random.h"
#include "tests/support/memory_file.h"
#include "tests/support/status_matchers.h"

namespace isoscope::io {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::MemoryReadFile;
using ::isoscope::testing::MemoryWriteFile;
using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr std::int64_t kPage = 4096;
constexpr std::uint32_t kTag = 0x12345678;

std::string PayloadOf(PageNumber page) { return "page number " + std::to_string(page); }

std::string MakeFile(PageNumber page_count, std::uint32_t tag = kTag) {
  std::string bytes;
  MemoryWriteFile file(&bytes);
  PageFileWriter writer(&file, tag);
  for (PageNumber page = 0; page < page_count; ++page) {
    const auto appended = writer.Append(PayloadOf(page));
    EXPECT_THAT(appended, IsOk());
    EXPECT_EQ(*appended, page);
  }
  EXPECT_EQ(writer.page_count(), page_count);
  return bytes;
}

absl::StatusOr<std::unique_ptr<PageFile>> OpenBytes(const std::string& bytes,
                                                    std::int64_t cache_bytes) {
  return PageFile::Open(std::make_unique<MemoryReadFile>(bytes), cache_bytes);
}

// The page holds its payload, padded with zeros.
void ExpectPage(const PageFile& file, PageNumber page, PageReadCost* cost) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PageFile::Page read, file.Read(page, cost));
  std::string expected = PayloadOf(page);
  expected.resize(kPagePayloadBytes, '\0');
  EXPECT_EQ(std::string(read.payload()), expected);
}

TEST(PageFileTest, PageHasItsDocumentedBytes) {
  const std::string bytes = MakeFile(2);
  ASSERT_EQ(bytes.size(), 8192u);
  EXPECT_EQ(bytes.substr(4096, 14), std::string("page number 1\0", 14));
  EXPECT_EQ(bytes.substr(4096 + 4084, 8), std::string("\x78\x56\x34\x12\x01\x00\x00\x00", 8));
  EXPECT_EQ(base::LoadLittleEndian<std::uint32_t>(&bytes[8188]),
            base::Crc32c(absl::string_view(bytes).substr(4096, 4092)));
}

TEST(PageFileTest, OverwriteReplacesOnePageAndItsPadding) {
  std::string bytes;
  MemoryWriteFile file(&bytes);
  PageFileWriter writer(&file, kTag);
  ISOSCOPE_ASSERT_OK(writer.Append("something longer than what replaces it"));
  ISOSCOPE_ASSERT_OK(writer.Append(PayloadOf(1)));
  ISOSCOPE_ASSERT_OK(writer.Overwrite(0, PayloadOf(0)));
  EXPECT_EQ(bytes, MakeFile(2));
}

TEST(PageFileTest, ReadCountsRequestsAndBytesFromTheFileApart) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenBytes(MakeFile(3), 1 << 20));
  PageReadCost cost;
  ExpectPage(*file, 2, &cost);
  ExpectPage(*file, 2, &cost);
  ExpectPage(*file, 0, &cost);  // read by Open
  EXPECT_EQ(cost.page_read_count, 3);
  EXPECT_EQ(cost.read_bytes, 4096);
}

TEST(PageFileTest, CacheOfZeroBytesKeepsNothing) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenBytes(MakeFile(2), 0));
  PageReadCost cost;
  ExpectPage(*file, 1, &cost);
  ExpectPage(*file, 1, &cost);
  EXPECT_EQ(cost.read_bytes, 2 * kPage);
  EXPECT_EQ(file->cached_bytes(), 0);
}

TEST(PageFileTest, NegativeCacheSizeKeepsNothing) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenBytes(MakeFile(2), -1));
  PageReadCost cost;
  ExpectPage(*file, 1, &cost);
  EXPECT_EQ(file->cached_bytes(), 0);
}

TEST(PageFileTest, CacheDropsTheLeastRecentlyUsedPage) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenBytes(MakeFile(4), 2 * kPage + 4095));
  PageReadCost warm_up;
  ExpectPage(*file, 1, &warm_up);
  ExpectPage(*file, 2, &warm_up);  // drops 0
  ExpectPage(*file, 1, &warm_up);  // 2 is now the older one
  ExpectPage(*file, 3, &warm_up);  // drops 2
  PageReadCost hit;
  ExpectPage(*file, 1, &hit);
  ExpectPage(*file, 3, &hit);
  EXPECT_EQ(hit.read_bytes, 0);
  PageReadCost miss;
  ExpectPage(*file, 2, &miss);
  EXPECT_EQ(miss.read_bytes, 4096);
}

TEST(PageFileTest, CacheNeverHoldsMoreThanItsBound) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenBytes(MakeFile(50), 7 * kPage));
  PageReadCost cost;
  for (std::uint64_t i = 0; i < 1000; ++i) {
    ExpectPage(*file, static_cast<PageNumber>(base::RandomBits(1, i) % 50), &cost);
    ASSERT_LE(file->cached_bytes(), 7 * kPage);
  }
  EXPECT_EQ(file->cached_bytes(), 7 * kPage);
  EXPECT_LT(cost.read_bytes, 1000 * kPage);
}

TEST(PageFileTest, PageOutlivesItsPlaceInTheCache) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenBytes(MakeFile(3), 4096));
  PageReadCost cost;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PageFile::Page page, file->Read(1, &cost));
  ExpectPage(*file, 2, &cost);
  EXPECT_EQ(std::string(page.payload().substr(0, PayloadOf(1).size())), PayloadOf(1));
}

TEST(PageFileTest, EverySizeOtherThanWholePagesIsDataLoss) {
  const std::string bytes = MakeFile(2);
  for (std::size_t size = 0; size <= bytes.size(); ++size) {
    const auto file = OpenBytes(bytes.substr(0, size), 0);
    if (size == 4096 || size == 8192) {
      EXPECT_THAT(file, IsOk());
    } else {
      ASSERT_THAT(file, StatusIs(absl::StatusCode::kDataLoss, HasSubstr("memory_file"))) << size;
    }
  }
}

TEST(PageFileTest, EveryFlippedBitOfAPageIsDataLossThatNamesFileAndPage) {
  const std::string bytes = MakeFile(2);
  for (std::size_t bit = 0; bit < kPageBytes * 8; ++bit) {
    std::string damaged = bytes;
    char& byte = damaged[kPageBytes + bit / 8];
    byte = static_cast<char>(byte ^ (1 << (bit % 8)));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenBytes(damaged, 1 << 20));
    PageReadCost cost;
    ASSERT_THAT(
        file->Read(1, &cost),
        StatusIs(absl::StatusCode::kDataLoss, AllOf(HasSubstr("memory_file"), HasSubstr("page 1"))))
        << bit;
    EXPECT_EQ(file->cached_bytes(), 4096) << "the damaged page was cached";
  }
}

TEST(PageFileTest, DamagedFirstPageFailsOpen) {
  std::string bytes = MakeFile(1);
  bytes[17] = 'x';
  EXPECT_THAT(OpenBytes(bytes, 0), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("page 0")));
}

TEST(PageFileTest, MisplacedPageIsDataLoss) {
  const std::string bytes = MakeFile(3);
  const std::string swapped = bytes.substr(0, 4096) + bytes.substr(8192) + bytes.substr(4096, 4096);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenBytes(swapped, 0));
  PageReadCost cost;
  EXPECT_THAT(file->Read(1, &cost),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("bears the number 2")));
}

TEST(PageFileTest, PageOfAnotherFileIsDataLoss) {
  const std::string mixed = MakeFile(1) + MakeFile(2, kTag + 1).substr(4096);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenBytes(mixed, 0));
  PageReadCost cost;
  EXPECT_THAT(file->Read(1, &cost),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("belongs to another file")));
}

TEST(PageFileTest, PagePastTheEndIsDataLoss) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenBytes(MakeFile(2), 0));
  PageReadCost cost;
  EXPECT_THAT(file->Read(2, &cost),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("the file has 2 pages")));
  EXPECT_THAT(file->Read(0xffffffff, &cost), StatusIs(absl::StatusCode::kDataLoss, _));
}

TEST(PageFileTest, WriterPassesOnErrorsOfTheFile) {
  std::string bytes;
  MemoryWriteFile file(&bytes, /*failing_operation=*/1);
  PageFileWriter writer(&file, kTag);
  ISOSCOPE_ASSERT_OK(writer.Append(""));
  EXPECT_THAT(writer.Append(""), StatusIs(absl::StatusCode::kResourceExhausted, _));
  EXPECT_EQ(writer.page_count(), 1);
  EXPECT_THAT(writer.Overwrite(0, ""), StatusIs(absl::StatusCode::kResourceExhausted, _));
}

TEST(PageFileTest, ThreadsThatShareASmallCacheReadTheRightPages) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, OpenBytes(MakeFile(20), 5 * kPage));
  std::vector<std::thread> threads;
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    threads.emplace_back([&file, seed] {
      PageReadCost cost;
      for (std::uint64_t i = 0; i < 2000; ++i) {
        ExpectPage(*file, static_cast<PageNumber>(base::RandomBits(seed, i) % 20), &cost);
      }
      EXPECT_EQ(cost.page_read_count, 2000);
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_LE(file->cached_bytes(), 5 * kPage);
}

}  // namespace
}  // namespace isoscope::io
