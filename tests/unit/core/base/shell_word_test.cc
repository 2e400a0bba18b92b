#include "core/base/shell_word.h"

#include "gtest/gtest.h"

namespace isoscope::base {
namespace {

TEST(ShellWordTest, QuotesWhatNeedsIt) {
  EXPECT_EQ(ShellWord("a/b-1.nii.gz"), "a/b-1.nii.gz");
  EXPECT_EQ(ShellWord("it's"), "'it'\\''s'");
  EXPECT_EQ(ShellWord("two words"), "'two words'");
  EXPECT_EQ(ShellWord("a*.h5"), "'a*.h5'");
  EXPECT_EQ(ShellWord(""), "''");
}

}  // namespace
}  // namespace isoscope::base
