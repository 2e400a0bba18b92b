#include "core/source/bytes/zip_directory.h"

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/zip_writer.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ZipWriter;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

absl::StatusOr<std::vector<ZipMember>> Members(const std::string& bytes,
                                               const ZipLimits& limits = {}) {
  return ReadZipDirectory({.name = "a.zip",
                           .size_bytes = static_cast<std::int64_t>(bytes.size()),
                           .read_at =
                               [&](std::int64_t offset, std::size_t size, char* out) {
                                 // What is asked for lies in the archive, whatever its fields say.
                                 EXPECT_GE(offset, 0);
                                 EXPECT_LE(static_cast<std::size_t>(offset) + size, bytes.size());
                                 std::memcpy(out, bytes.data() + offset, size);
                                 return absl::OkStatus();
                               }},
                          limits);
}

TEST(ZipDirectoryTest, ListsMembersInTheirOrder) {
  for (const bool is_64 : {false, true}) {
    ZipWriter zip(is_64);
    zip.Add("b/", "", false);
    zip.Add("b/x", "0123456789", false);
    zip.Add("a", std::string(1000, 'x'), true);
    const std::string bytes = zip.Finish("a comment");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto members, Members(bytes));
    ASSERT_EQ(members.size(), 3U);
    EXPECT_TRUE(members[0].is_folder());
    EXPECT_EQ(members[1].name, "b/x");
    EXPECT_EQ(members[1].size_bytes, 10);
    EXPECT_EQ(members[1].stored_bytes, 10);
    EXPECT_EQ(members[1].method, 0);
    EXPECT_EQ(bytes.substr(static_cast<std::size_t>(members[1].header_offset), 2), "PK");
    EXPECT_EQ(members[2].method, 8);
    EXPECT_EQ(members[2].size_bytes, 1000);
    EXPECT_LT(members[2].stored_bytes, 1000);
  }
}

TEST(ZipDirectoryTest, LimitsAreThoseOfWhoeverReads) {
  ZipWriter zip;
  zip.Add("a", "1", false);
  zip.Add("b", "2", false);
  zip.Add("a", "33", false);
  const std::string bytes = zip.Finish();
  EXPECT_THAT(Members(bytes), StatusIs(kInvalid, HasSubstr("two members are named \"a\"")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto members, Members(bytes, {.takes_last_of_a_name = true}));
  ASSERT_EQ(members.size(), 3U);
  EXPECT_EQ(members[2].size_bytes, 2);
  ISOSCOPE_EXPECT_OK(Members(bytes, {.members = 3, .takes_last_of_a_name = true}));
  EXPECT_THAT(Members(bytes, {.members = 2, .takes_last_of_a_name = true}),
              StatusIs(kInvalid, HasSubstr("3 members in a directory of")));
  EXPECT_THAT(Members(bytes, {.directory_bytes = 100, .takes_last_of_a_name = true}),
              StatusIs(kInvalid, HasSubstr("expected at most")));
}

// Each byte changed, each length: an error, or members that lie in the archive.
TEST(ZipDirectoryTest, SurvivesDamage) {
  for (const bool is_64 : {false, true}) {
    ZipWriter zip(is_64);
    zip.Add("a", "0123456789", false);
    zip.Add("b", std::string(50, '0'), true);
    const std::string good = zip.Finish("");
    for (std::size_t i = 0; i < good.size(); ++i) {
      EXPECT_THAT(Members(good.substr(0, i)), StatusIs(kInvalid)) << i;
      for (const int value : {0x01, 0x80, 0xff}) {
        std::string bad = good;
        bad[i] = static_cast<char>(bad[i] ^ value);
        const auto members = Members(bad);
        if (!members.ok()) {
          EXPECT_THAT(members, StatusIs(kInvalid)) << i;
          continue;
        }
        for (const ZipMember& member : *members) {
          EXPECT_GE(member.header_offset, 0);
          EXPECT_LE(member.header_offset + member.stored_bytes,
                    static_cast<std::int64_t>(bad.size()));
        }
      }
    }
  }
}

TEST(ZipDirectoryTest, ErrorsOfReadingArePassedOn) {
  EXPECT_THAT(ReadZipDirectory({.name = "a.zip",
                                .size_bytes = 100,
                                .read_at = [](std::int64_t, std::size_t,
                                              char*) { return absl::UnavailableError("gone"); }},
                               {}),
              StatusIs(absl::StatusCode::kUnavailable));
}

}  // namespace
}  // namespace isoscope::source
