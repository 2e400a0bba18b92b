#include "clients/cpp/mesh_file/sectioned_file.h"

#include <filesystem>
#include <string>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::TempDir;

TEST(SectionedFileTest, SectionsThatGrowTogetherLieOneBehindTheOther) {
  const TempDir folder;
  const std::string path = folder.Sub("file");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, SectionedFile::Create(path, 4, 3));
  for (int i = 0; i < 3; ++i) {
    ISOSCOPE_ASSERT_OK(file->Append(0, "a"));
    ISOSCOPE_ASSERT_OK(file->Append(1, "bb"));
    ISOSCOPE_ASSERT_OK(file->Append(2, "c"));
  }
  EXPECT_EQ(file->section_bytes(0), 3);
  EXPECT_EQ(file->section_bytes(1), 6);
  EXPECT_EQ(file->disk_use().file_bytes, 12);
  EXPECT_EQ(file->disk_use().peak_bytes, 18) << "the largest later section is there twice";
  EXPECT_FALSE(io::PathExists(path));
  ISOSCOPE_ASSERT_OK(file->Finish("head", {"<1>"}, "tail"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, io::ReadWholeFile(path, 100));
  EXPECT_EQ(bytes, "headaaa<1>bbbbbbccctail");
  EXPECT_EQ(file->size_bytes(), 23);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()),
                          std::filesystem::directory_iterator()),
            1);
}

TEST(SectionedFileTest, SectionLargerThanTheBufferIsCopiedWhole) {
  const TempDir folder;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, SectionedFile::Create(folder.Sub("file"), 0, 2));
  std::string large;
  for (int i = 0; large.size() < 9'000'000; ++i) {
    large += std::to_string(i);
  }
  ISOSCOPE_ASSERT_OK(file->Append(1, large));
  ISOSCOPE_ASSERT_OK(file->Finish(""));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes,
                                io::ReadWholeFile(folder.Sub("file"), 10'000'000));
  EXPECT_TRUE(bytes == large);
}

}  // namespace
}  // namespace isoscope::client
