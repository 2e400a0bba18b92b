#include "client-cli/commands/redirect_file.h"

#include <filesystem>
#include <memory>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/stat.h>

#include "core/io/file.h"
#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

unsigned ModeOf(const std::string& path) {
  struct stat found {};
  EXPECT_EQ(stat(path.c_str(), &found), 0) << path;
  return found.st_mode & 07777U;
}

TEST(RedirectFileTest, OnlyItsOwnerReadsItAndItIsGoneAtTheEnd) {
  absl::StatusOr<std::unique_ptr<RedirectFile>> file =
      RedirectFile::Create("http://127.0.0.1:1/?token=t&dataset=d");
  ISOSCOPE_ASSERT_OK(file);
  const std::string path = (*file)->path();
  const std::string folder = std::filesystem::path(path).parent_path().string();
  EXPECT_EQ(ModeOf(path), 0600U);
  EXPECT_EQ(ModeOf(folder), 0700U);
  EXPECT_THAT(path, Not(HasSubstr("token")));
  const absl::StatusOr<std::string> page = io::ReadWholeFile(path, 4096);
  ISOSCOPE_ASSERT_OK(page);
  EXPECT_THAT(*page, HasSubstr("content=\"0; url=http://127.0.0.1:1/?token=t&amp;dataset=d\""));
  file = absl::CancelledError();
  EXPECT_FALSE(std::filesystem::exists(path));
  EXPECT_FALSE(std::filesystem::exists(folder));
}

TEST(RedirectFileTest, AnAddressIsNoMarkup) {
  const absl::StatusOr<std::unique_ptr<RedirectFile>> file =
      RedirectFile::Create("http://h:1/?dataset=\"><script>'");
  ISOSCOPE_ASSERT_OK(file);
  const absl::StatusOr<std::string> page = io::ReadWholeFile((*file)->path(), 4096);
  ISOSCOPE_ASSERT_OK(page);
  EXPECT_THAT(*page, Not(HasSubstr("<script")));
  EXPECT_THAT(*page, HasSubstr("&quot;&gt;&lt;script&gt;&#39;"));
}

}  // namespace
}  // namespace isoscope::cli
