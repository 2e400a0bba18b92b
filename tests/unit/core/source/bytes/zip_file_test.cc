#include "core/source/bytes/zip_file.h"

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/status_macros.h"
#include "tests/support/folder_test.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/source/bytes/zip_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ZipBytes;
using ::isoscope::testing::ZipEntry;
using ::isoscope::testing::ZipOptions;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr auto kDamaged = absl::StatusCode::kDataLoss;

// 5000 bytes without a pattern, then 95 000 of one.
std::string SomeBytes() {
  std::string bytes(100'000, 'x');
  std::uint32_t state = 7;
  for (std::size_t i = 0; i < 5000; ++i) {
    state = state * 1664525u + 1013904223u;
    bytes[i] = static_cast<char>(state >> 24);
  }
  return bytes;
}

class ZipFileTest : public testing::FolderTest {
 protected:
  // The bytes of each member, in parts of `part` bytes, checked at the end.
  absl::StatusOr<std::vector<std::string>> Unzip(const std::string& bytes, std::size_t part) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                              io::OpenRandomAccessFile(Write("a.zip", bytes)));
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<ZipMember> members, ReadZipMembers(*file));
    std::vector<std::string> all;
    for (const ZipMember& member : members) {
      const std::unique_ptr<DecodedStream> stream = MakeZipStream(member, file.get());
      std::string text;
      std::string buffer(part, '\0');
      std::size_t got = part;
      while (got == part) {
        ISOSCOPE_ASSIGN_OR_RETURN(got, stream->Read(part, buffer.data()));
        text += buffer.substr(0, got);
      }
      ISOSCOPE_RETURN_IF_ERROR(stream->VerifyEnd());
      all.push_back(member.name + "=" + text);
    }
    return all;
  }
};

TEST_F(ZipFileTest, MembersAreReadStoredAndDeflatedAlsoOfZip64) {
  const std::string some = SomeBytes();
  for (const bool is_long : {false, true}) {
    for (const std::size_t part : {1UL, 777UL, 1000'000UL}) {
      const std::string zip = ZipBytes({{.name = "a", .bytes = some},
                                        {.name = "folder/b", .bytes = some, .is_deflated = true},
                                        {.name = "folder/", .bytes = ""},
                                        {.name = "none", .bytes = "", .is_deflated = true}},
                                       {.is_long = is_long, .comment = "a PK\x05\x06 comment"});
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto members, Unzip(zip, part));
      EXPECT_EQ(members,
                (std::vector<std::string>{"a=" + some, "folder/b=" + some, "folder/=", "none="}));
    }
  }
  EXPECT_TRUE(ZipMember{.name = "folder/"}.is_folder());
  EXPECT_FALSE(ZipMember{.name = "folder"}.is_folder());
}

TEST_F(ZipFileTest, AStreamStartsOverAndSkips) {
  const std::string some = SomeBytes();
  for (const bool is_deflated : {false, true}) {
    const std::string path =
        Write("a.zip", ZipBytes({{.name = "a", .bytes = some, .is_deflated = is_deflated}}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, io::OpenRandomAccessFile(path));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto members, ReadZipMembers(*file));
    const auto stream = MakeZipStream(members[0], file.get());
    for (int pass = 0; pass < 2; ++pass) {
      stream->Rewind();
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::int64_t skipped, stream->Skip(4000));
      EXPECT_EQ(skipped, 4000);
      std::string text(3000, '\0');
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::size_t got, stream->Read(3000, text.data()));
      EXPECT_EQ(got, 3000U);
      EXPECT_EQ(text, some.substr(4000, 3000));
      EXPECT_EQ(stream->position(), 7000);
      ISOSCOPE_EXPECT_OK(stream->VerifyEnd());
    }
  }
}

TEST_F(ZipFileTest, FaultsOfMembersAreNamed) {
  struct Case {
    ZipEntry entry;
    absl::StatusCode code;
    const char* message;
  };
  const std::string some = SomeBytes();
  const std::vector<Case> cases = {
      {{.name = "a", .bytes = some, .crc = 7}, kDamaged, "its checksum is"},
      {{.name = "a", .bytes = some, .is_deflated = true, .crc = 7}, kDamaged, "its checksum is"},
      {{.name = "a", .bytes = some, .is_deflated = true, .size = 99'999},
       kDamaged,
       "more than its 99999 bytes"},
      {{.name = "a", .bytes = some, .is_deflated = true, .size = 100'001},
       kDamaged,
       "end after 100000 of 100001 bytes"},
      {{.name = "a", .bytes = some, .method = 8}, kDamaged, "is damaged: at its byte 0"},
      {{.name = "a", .bytes = some, .size = 99'999}, kInvalid, "has 99999 bytes, stored in 100000"},
      {{.name = "a", .bytes = some, .is_deflated = true, .size = 1LL << 31},
       kInvalid,
       "has 2147483648 bytes"},
      {{.name = "a", .bytes = some, .flags = 1}, kInvalid, "\"a\" is encrypted"},
      {{.name = "a", .bytes = some, .method = 14}, kInvalid, "compressed by method 14"},
      {{.name = "a", .bytes = some, .local_name = "b"}, kInvalid, "there is no such member"}};
  for (const Case& c : cases) {
    EXPECT_THAT(Unzip(ZipBytes({c.entry}), 512), StatusIs(c.code, HasSubstr(c.message)));
  }
  EXPECT_THAT(Unzip(ZipBytes({{.name = "a", .bytes = "1"}, {.name = "a", .bytes = "2"}}), 512),
              StatusIs(kInvalid, HasSubstr("two members are named \"a\"")));
}

TEST_F(ZipFileTest, FaultsOfTheDirectoryAreNamed) {
  const std::string whole = ZipBytes({{.name = "a", .bytes = "12345678"}});
  const auto with = [&](std::size_t from_end, const std::string& bytes) {
    std::string changed = whole;
    return changed.replace(changed.size() - from_end, bytes.size(), bytes);
  };
  EXPECT_THAT(Unzip("x" + whole, 9), StatusIs(kInvalid, HasSubstr("in front of the archive")));
  EXPECT_THAT(Unzip(with(6, "\xff\xff"), 9), StatusIs(kInvalid, HasSubstr("does not end at")));
  EXPECT_THAT(Unzip(with(14, std::string("\x02\0", 2)), 9), StatusIs(kInvalid));
  EXPECT_THAT(Unzip(with(18, std::string("\x01\0", 2)), 9),
              StatusIs(kInvalid, HasSubstr("one of several parts")));
  EXPECT_THAT(Unzip(with(14, std::string("\x02\0\x02\0", 4)), 9), StatusIs(kInvalid));
  EXPECT_THAT(Unzip(with(14, std::string("\0\0\0\0", 4)), 9), StatusIs(kInvalid));
  EXPECT_THAT(Unzip(with(10, std::string("\xff\xff\xff\x7f", 4)), 9),
              StatusIs(kInvalid, HasSubstr("in a directory of")));
}

// Each byte changed, and each length: an error, or the same members.
TEST_F(ZipFileTest, NoDamagePassesInSilence) {
  for (const bool is_long : {false, true}) {
    const std::string whole = ZipBytes(
        {{.name = "a", .bytes = "abcdefgh"}, {.name = "b", .bytes = "ijkl", .is_deflated = true}},
        {.is_long = is_long});
    for (std::size_t size = 0; size < whole.size(); ++size) {
      const auto members = Unzip(whole.substr(0, size), 64);
      EXPECT_FALSE(members.ok()) << size;
      EXPECT_THAT(members.status().code(), ::testing::AnyOf(kInvalid, kDamaged)) << size;
    }
    const std::vector<std::string> good{"a=abcdefgh", "b=ijkl"};
    for (std::size_t at = 0; at < whole.size(); ++at) {
      for (const int flip : {1, 0x80, 0xff}) {
        std::string changed = whole;
        changed[at] = static_cast<char>(changed[at] ^ flip);
        const auto members = Unzip(changed, 64);
        if (members.ok()) {
          EXPECT_EQ(*members, good) << at;
        }
      }
    }
  }
}

TEST_F(ZipFileTest, TheFirstNameIsInTheFirstBytes) {
  const std::string zip = ZipBytes({{.name = "array.npy", .bytes = "1"}});
  EXPECT_TRUE(IsZip(zip));
  EXPECT_EQ(FirstZipName(zip), "array.npy");
  EXPECT_EQ(FirstZipName(zip.substr(0, 38)), "");
  EXPECT_EQ(FirstZipName(zip.substr(0, 10)), "");
  EXPECT_FALSE(IsZip("PK\x05\x06"));
}

}  // namespace
}  // namespace isoscope::source
