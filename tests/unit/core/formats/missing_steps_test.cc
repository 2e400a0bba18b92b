#include "core/formats/missing_steps.h"

#include <cstddef>
#include <filesystem>
#include <string>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "tests/support/folder_test.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

class MissingStepsTest : public testing::FolderTest {};

// sample_opener_test.cc has those of a dataset.
TEST_F(MissingStepsTest, NamesAFileOnlyWhereAFileIsAStep) {
  for (const int step : {0, 1, 3}) {
    testing::WriteFile(
        dir_.Sub(absl::StrCat("run_", step, ".vti")),
        testing::VtiBytes({.extent = "0 4 0 3 0 2",
                           .fields = {{"p", "UInt8", std::string(std::size_t{5 * 4 * 3}, 'a')}}}));
  }
  EXPECT_EQ(DescribeMissingSteps({.path = dir_.Sub("run_*.vti")}, 3, 4),
            "run_2.vti is missing: 3 are there, of 4 or more steps");
  // A selection of the steps, one file with steps, and none.
  for (const char* const path : {"run_*.vti", "run_1.vti", "none.h5"}) {
    EXPECT_EQ(DescribeMissingSteps({.path = dir_.Sub(path)}, 2, 4),
              "has 2 steps, expected 4 or more, as there were");
  }
  EXPECT_EQ(DescribeMissingSteps({.path = dir_.Sub("run_1.vti")}, 1, 2),
            "has 1 steps, expected 2 or more, as there were");
  EXPECT_EQ(DescribeGap({.path = dir_.Sub("run_*.vti")}, 3), "there is no run_2.vti");
  for (const char* const path : {"run_*.vti", "run_1.vti", "none.h5"}) {
    EXPECT_EQ(DescribeGap({.path = dir_.Sub(path)}, 2), "");
  }
  std::filesystem::remove(dir_.Sub("run_3.vti"));
  EXPECT_EQ(DescribeGap({.path = dir_.Sub("run_*.vti")}, 2), "");
}

}  // namespace
}  // namespace isoscope::source
