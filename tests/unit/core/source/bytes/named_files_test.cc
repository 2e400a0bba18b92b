#include "core/source/bytes/named_files.h"

#include <filesystem>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

bool IsPng(const std::string& path) {
  return path.size() > 4 && path.substr(path.size() - 4) == ".png";
}

class NamedFilesTest : public ::testing::Test {
 protected:
  NamedFilesTest() {
    for (const char* name : {"s10.png", "s9.png", "s1.txt", "a[1].png", "t2.png"}) {
      testing::WriteFile(dir_.Sub(name), "");
    }
    std::filesystem::create_directory(dir_.Sub("s3.png"));
  }
  const testing::TempDir dir_;
};

TEST_F(NamedFilesTest, AFolderGivesItsWantedFilesInTheOrderOfTheirNumbers) {
  EXPECT_THAT(FilesNamed(dir_.path(), IsPng), ElementsAre(dir_.Sub("a[1].png"), dir_.Sub("s9.png"),
                                                          dir_.Sub("s10.png"), dir_.Sub("t2.png")));
}

TEST_F(NamedFilesTest, APatternGivesThoseThatMatchButNoFolderAndNoOtherKind) {
  EXPECT_THAT(FilesNamed(dir_.Sub("s*"), IsPng),
              ElementsAre(dir_.Sub("s9.png"), dir_.Sub("s10.png")));
  EXPECT_THAT(FilesNamed(dir_.Sub("u*"), IsPng), IsEmpty());
}

TEST_F(NamedFilesTest, AFileWithABracketInItsNameIsThatFile) {
  EXPECT_THAT(FilesNamed(dir_.Sub("a[1].png"), IsPng), ElementsAre(dir_.Sub("a[1].png")));
}

}  // namespace
}  // namespace isoscope::source
