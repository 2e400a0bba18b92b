// A fixture whose tests write files into a folder of their own.

#ifndef ISOSCOPE_TESTS_SUPPORT_FOLDER_TEST_H_
#define ISOSCOPE_TESTS_SUPPORT_FOLDER_TEST_H_

#include <string>

#include "gtest/gtest.h"

#include "tests/support/temp_dir.h"

namespace isoscope::testing {

class FolderTest : public ::testing::Test {
 protected:
  // Returns the path.
  std::string Write(const std::string& name, const std::string& bytes) const {
    return dir_.Write(name, bytes);
  }

  TempDir dir_;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_FOLDER_TEST_H_
