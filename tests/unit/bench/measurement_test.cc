#include "bench/measurement.h"

#include <sstream>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::bench {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::EndsWith;
using ::testing::HasSubstr;

TEST(MeasurementTest, TheReportGoesToTheFileAndBelowMachineAndDate) {
  const TempDir folder;
  std::ostringstream out;
  const std::string path = folder.Sub("a.json");
  ISOSCOPE_ASSERT_OK(RunMeasurement(path, "head", {.out = &out}, [](const Occasion& occasion) {
    return Report{.json = JsonHead(occasion).dump() + occasion.volume, .text = "10 ms\n"};
  }));
  EXPECT_THAT(out.str(), EndsWith(" UTC\n10 ms\n"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string json, io::ReadWholeFile(path, 1 << 20));
  EXPECT_THAT(json, HasSubstr("{\"machine\":\""));
  EXPECT_THAT(json, HasSubstr("\"date\":\""));
  EXPECT_THAT(json, EndsWith("}head"));
}

TEST(MeasurementTest, AFileThatCannotBeWrittenIsFoundBeforeAnythingIsMeasured) {
  std::ostringstream out;
  bool is_measured = false;
  const absl::Status status =
      RunMeasurement("/no/such/folder/a.json", "", {.out = &out}, [&](const Occasion&) {
        is_measured = true;
        return Report{};
      });
  EXPECT_FALSE(status.ok());
  EXPECT_FALSE(is_measured);
  EXPECT_THAT(RunMeasurement(std::nullopt, "", {.out = &out},
                             [](const Occasion&) -> absl::StatusOr<Report> {
                               return absl::UnavailableError("gone");
                             }),
              StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_EQ(out.str(), "");
}

}  // namespace
}  // namespace isoscope::bench
