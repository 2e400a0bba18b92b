#include "tests/support/skips.h"

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest-spi.h"
#include "gtest/gtest.h"

#include "tests/support/temp_dir.h"

namespace isoscope::testing {
namespace {

TEST(SkipsTest, AReasonIsRequiredIfItsWholeNameIsInTheList) {
  EXPECT_FALSE(IsRequired("data", nullptr));
  EXPECT_FALSE(IsRequired("data", ""));
  EXPECT_FALSE(IsRequired("data", "metadata,dat"));
  EXPECT_TRUE(IsRequired("data", "vtk,data"));
  EXPECT_TRUE(IsRequired("data", "all"));
}

// Sets ISOSCOPE_REQUIRE and ISOSCOPE_SKIPS, and restores them.
class SkipsInAFileTest : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const char* name : {"ISOSCOPE_REQUIRE", "ISOSCOPE_SKIPS"}) {
      const char* const value = std::getenv(name);
      before_.emplace_back(name, value == nullptr ? "" : value);
    }
    setenv("ISOSCOPE_SKIPS", path_.c_str(), 1);
    setenv("ISOSCOPE_REQUIRE", "vtk", 1);
  }
  void TearDown() override {
    for (const auto& [name, value] : before_) {
      setenv(name.c_str(), value.c_str(), 1);
    }
  }

  TempDir folder_;
  std::string path_ = folder_.Sub("skips.txt");
  std::vector<std::pair<std::string, std::string>> before_;
};

TEST_F(SkipsInAFileTest, EachSkipIsALineAndARequiredOneAFailure) {
  EXPECT_FALSE(NoteSkip("data", "no\nvolume"));
  EXPECT_TRUE(NoteSkip("vtk", "none"));
  std::ifstream file(path_);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  EXPECT_EQ(text, "data\tno volume\nvtk\tnone\n");
}

TEST_F(SkipsInAFileTest, ARequiredSkipFailsItsTest) {
  EXPECT_FATAL_FAILURE(ISOSCOPE_SKIP("vtk", "none"), "ISOSCOPE_REQUIRE names vtk: none");
}

}  // namespace
}  // namespace isoscope::testing
