#include "core/io/temporary_folder.h"

#include <filesystem>
#include <fstream>
#include <string>
#include <utility>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::io {
namespace {

namespace fs = std::filesystem;

TEST(TemporaryFolderTest, IsOfItsOwnerAloneAndGoesWithAllThatIsInIt) {
  std::string path;
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(TemporaryFolder made, TemporaryFolder::Make());
    path = made.path();
    const TemporaryFolder folder = std::move(made);
    EXPECT_EQ(folder.path(), path);
    EXPECT_EQ(fs::status(path).permissions(), fs::perms::owner_all);
    EXPECT_EQ(folder.Sub("a"), path + "/a");
    std::ofstream(folder.Sub("a")) << "x";
    EXPECT_TRUE(fs::exists(folder.Sub("a")));
  }
  EXPECT_FALSE(fs::exists(path));
}

}  // namespace
}  // namespace isoscope::io
