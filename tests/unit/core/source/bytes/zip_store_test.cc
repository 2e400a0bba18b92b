#include "core/source/bytes/zip_store.h"

#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/types/span.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/memory_store.h"
#include "tests/support/status_matchers.h"
#include "tests/support/zip_writer.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::MemoryBytes;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ZipWriter;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

absl::StatusOr<std::unique_ptr<ZipStore>> OpenZip(const std::string& bytes,
                                                  const std::string& folder = "") {
  return OpenZipStore(std::make_shared<const MemoryBytes>(bytes), folder);
}

const base::Cancellation& Never() {
  static const base::Cancellation never;
  return never;
}

TEST(ZipStoreTest, ReadsMembers) {
  for (const bool is_64 : {false, true}) {
    for (const bool is_deflated : {false, true}) {
      ZipWriter zip(is_64);
      zip.Add("a/", "", false);
      zip.Add("a/b", "0123456789", is_deflated);
      zip.Add("a/c/d", std::string(100'000, 'x'), is_deflated);
      zip.Add("a!", "e", is_deflated);
      zip.Add("top", "", is_deflated);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto store, OpenZip(zip.Finish()));
      EXPECT_THAT(store->Names(), ElementsAre("a!", "a/b", "a/c/d", "top"));
      EXPECT_THAT(store->NamesBelow(""), ElementsAre("a!", "a", "top"));
      EXPECT_THAT(store->NamesBelow("a"), ElementsAre("b", "c"));
      const std::vector<ObjectRead> reads = {{.key = "a/b", .max_size = 10},
                                             {.key = "a/b", .offset = -3, .max_size = 10},
                                             {.key = "a/b", .offset = 2, .size = 4, .max_size = 10},
                                             {.key = "top", .max_size = 1},
                                             {.key = "none", .max_size = 1},
                                             {.key = "a/b", .offset = 8, .size = 3, .max_size = 10},
                                             {.key = "a/c/d", .max_size = 99'999},
                                             {.key = "a/../top", .max_size = 10}};
      const auto parts = store->Read(reads, Never());
      EXPECT_EQ(*parts[0] + "," + *parts[1] + "," + *parts[2] + "," + *parts[3],
                "0123456789,789,2345,");
      EXPECT_THAT(parts[4], StatusIs(absl::StatusCode::kNotFound));
      EXPECT_THAT(parts[5], StatusIs(absl::StatusCode::kOutOfRange));
      EXPECT_THAT(parts[6], StatusIs(absl::StatusCode::kResourceExhausted));
      EXPECT_THAT(parts[7], StatusIs(kInvalid));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto bytes, store->Open("a/b", Never()));
      EXPECT_EQ(bytes->size_bytes(), 10);
      std::string part(3, '?');
      ISOSCOPE_ASSERT_OK(bytes->ReadAt(4, 3, part.data(), Never()));
      EXPECT_EQ(part, "456");
      EXPECT_THAT(bytes->ReadAt(8, 3, part.data(), Never()),
                  StatusIs(absl::StatusCode::kOutOfRange));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto below, OpenZip(zip.Finish(), "a"));
      EXPECT_THAT(below->Names(), ElementsAre("b", "c/d"));
    }
  }
}

TEST(ZipStoreTest, RefusesOtherMembersByName) {
  ZipWriter zip;
  zip.Add("locked", "abc", false, 1);
  zip.Write("lzma", "abc", "abc", 14, 0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto store, OpenZip(zip.Finish()));
  const std::vector<ObjectRead> reads = {{.key = "locked", .max_size = 10},
                                         {.key = "lzma", .max_size = 10}};
  const auto parts = store->Read(reads, Never());
  EXPECT_THAT(parts[0], StatusIs(kInvalid, HasSubstr("encrypted")));
  EXPECT_THAT(parts[1], StatusIs(kInvalid, HasSubstr("method 14")));
  ZipWriter cut;
  cut.Write("short", "abcd", "abc", 0, 0);
  EXPECT_THAT(OpenZip(cut.Finish()), StatusIs(kInvalid, HasSubstr("\"short\" has 4 bytes")));
}

// Shards in an archive that packs them: zarrita.js has such test data.
TEST(ZipStoreTest, ReadsPartsOfDeflatedMembers) {
  std::string bytes;
  for (int i = 0; i < 1000; ++i) {
    absl::StrAppend(&bytes, i, " ");
  }
  ZipWriter zip;
  zip.Add("a", bytes, true);
  zip.Add("b", bytes + "b", true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto store, OpenZip(zip.Finish()));
  const std::vector<ObjectRead> reads = {{.key = "a", .offset = 5, .size = 7, .max_size = 7},
                                         {.key = "a", .offset = -9, .size = 9, .max_size = 9},
                                         {.key = "b", .offset = -1, .size = 1, .max_size = 1},
                                         {.key = "a", .offset = 0, .size = 3, .max_size = 3},
                                         {.key = "a", .offset = 0, .size = 3, .max_size = 2},
                                         {.key = "a", .max_size = 100},
                                         {.key = "a", .offset = 3, .max_size = 100}};
  const auto parts = store->Read(reads, Never());
  EXPECT_EQ(*parts[0], bytes.substr(5, 7));
  EXPECT_EQ(*parts[1], bytes.substr(bytes.size() - 9));
  EXPECT_EQ(*parts[2], "b");
  EXPECT_EQ(*parts[3], bytes.substr(0, 3));
  for (const std::size_t i : {4U, 5U, 6U}) {
    EXPECT_THAT(parts[i], StatusIs(absl::StatusCode::kResourceExhausted)) << i;
  }
  // A damaged one fails each read of it.
  std::string bad = zip.Finish();
  bad[60] = static_cast<char>(bad[60] ^ 0x10);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto damaged, OpenZip(bad));
  const auto failed = damaged->Read(absl::MakeConstSpan(reads).subspan(0, 2), Never());
  EXPECT_THAT(failed[0], StatusIs(absl::StatusCode::kDataLoss));
  EXPECT_THAT(failed[1], StatusIs(absl::StatusCode::kDataLoss));
}

// zarr-python appends a member each time that attributes change.
TEST(ZipStoreTest, TakesTheLastOfAName) {
  ZipWriter zip;
  zip.Add("a", "first", false);
  zip.Add("b", "other", false);
  zip.Add("a", "the last", true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto store, OpenZip(zip.Finish()));
  EXPECT_THAT(store->Names(), ElementsAre("a", "b"));
  const ObjectRead read{.key = "a", .max_size = 10};
  EXPECT_EQ(*store->Read({&read, 1}, Never())[0], "the last");
}

// Each byte changed, each length: an error, or the bytes that were written.
TEST(ZipStoreTest, SurvivesDamage) {
  for (const bool is_64 : {false, true}) {
    ZipWriter zip(is_64);
    zip.Add("a", "0123456789", false);
    zip.Add("b", "00000000000000000000000000", true);
    const std::string good = zip.Finish("");
    const std::vector<ObjectRead> reads = {{.key = "a", .max_size = 1000},
                                           {.key = "b", .max_size = 1000}};
    const auto check = [&](const std::string& bad) {
      const auto store = OpenZip(bad);
      if (!store.ok()) {
        EXPECT_THAT(store, StatusIs(kInvalid));
        return;
      }
      const auto parts = (*store)->Read(reads, Never());
      if (parts[0].ok()) {
        EXPECT_EQ(*parts[0], "0123456789");
      }
      if (parts[1].ok()) {
        EXPECT_EQ(*parts[1], "00000000000000000000000000");
      }
    };
    for (std::size_t i = 0; i < good.size(); ++i) {
      EXPECT_THAT(OpenZip(good.substr(0, i)), StatusIs(kInvalid)) << i;
      for (const int value : {0x01, 0x80, 0xff}) {
        std::string bad = good;
        bad[i] = static_cast<char>(bad[i] ^ value);
        check(bad);
      }
    }
  }
}

TEST(ZipStoreTest, FindsTheEndBeforeAComment) {
  ZipWriter zip;
  zip.Add("a", "b", false);
  ISOSCOPE_EXPECT_OK(OpenZip(zip.Finish(std::string(65535, 'x'))));
  ISOSCOPE_EXPECT_OK(OpenZip(zip.Finish("PK\x05\x06")));
  EXPECT_THAT(OpenZip(""), StatusIs(kInvalid));
  EXPECT_THAT(OpenZip(std::string(100'000, 'P')), StatusIs(kInvalid));
}

}  // namespace
}  // namespace isoscope::source
