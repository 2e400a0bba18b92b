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

TEST(MeasurementTest, AFrameHasItsSizeAndItsDrawers) {
  client::RequestFlags flags;
  flags.width = 640;
  flags.height = 480;
  EXPECT_EQ(DescribeFrame(flags, {1, "cpu"}), "640 x 480 pixels, 1 agent");
  EXPECT_EQ(DescribeFrame(flags, {2, "cpu"}), "640 x 480 pixels, 2 agents");
  nlohmann::ordered_json json;
  AddFrame(flags, {2, "cpu"}, &json);
  EXPECT_EQ(json.dump(), R"({"width":640,"height":480,"agents":2,"renderer":"cpu"})");
}

TEST(MeasurementTest, AVolumeIsCalledAsItsFileElseAsItsDataset) {
  cli::SessionFlags session;
  EXPECT_EQ(VolumeOf(session), "");
  session.dataset = "head";
  EXPECT_EQ(VolumeOf(session), "head");
  session.input = "/data/skull.nrrd";
  EXPECT_EQ(VolumeOf(session), "skull.nrrd");
}

}  // namespace
}  // namespace isoscope::bench
