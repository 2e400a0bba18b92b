#include "clients/cpp/picture_file/npy_writer.h"

#include <cstddef>
#include <filesystem>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::client {
namespace {

using isoscope::testing::StatusIs;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;
using testing::TempDir;

TEST(NpyWriterTest, TheHeaderIsThatOfNumpy) {
  const std::string header = MakeNpyHeader("<f4", {2, 3});
  EXPECT_EQ(header.size() % 64, 0U);
  EXPECT_THAT(header, StartsWith(std::string("\x93NUMPY\x01\x00", 8)));
  const std::size_t length = static_cast<unsigned char>(header[8]) +
                             256 * static_cast<std::size_t>(static_cast<unsigned char>(header[9]));
  EXPECT_EQ(length, header.size() - 10);
  EXPECT_THAT(header, HasSubstr("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }"));
  EXPECT_THAT(header, EndsWith(" \n"));
  EXPECT_THAT(MakeNpyHeader("|u1", {7}), HasSubstr("'shape': (7,), }"));
}

TEST(NpyWriterTest, ElementsFollowTheHeader) {
  const TempDir folder;
  ISOSCOPE_ASSERT_OK(WriteNpy(folder.Sub("a.npy"), "|u1", 1, {2, 2}, "abcd"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string file,
                                io::ReadWholeFile(folder.Sub("a.npy"), 1000));
  EXPECT_EQ(file, MakeNpyHeader("|u1", {2, 2}) + "abcd");
}

TEST(NpyWriterTest, AWrongNumberOfBytesIsDataLossAndLeavesNoFile) {
  const TempDir folder;
  EXPECT_THAT(WriteNpy(folder.Sub("a.npy"), "<f4", 4, {2, 2}, "abcd"),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("4 bytes")));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace isoscope::client
