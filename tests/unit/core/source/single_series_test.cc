#include "core/source/single_series.h"

#include <memory>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;

std::unique_ptr<VolumeSource> VolumeNamed(const std::string& name) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {2, 2, 2};
  return testing::MakeMemorySource(geometry, volume::ScalarType::kUint8, std::string(8, 'a'), name);
}

TEST(SingleSeriesTest, TheOpenVolumeIsTakenOnceAndEachLaterOneIsOpenedAnew) {
  int opened = 0;
  const auto series =
      MakeSingleSeries({.path = "a.mnc",
                        .field = "a",
                        .length_unit = "mm",
                        .volume = VolumeNamed("first"),
                        .open = [&opened]() -> absl::StatusOr<std::unique_ptr<VolumeSource>> {
                          if (++opened == 2) {
                            return absl::DataLossError("gone");
                          }
                          return VolumeNamed("again");
                        }});
  EXPECT_EQ(series->info().name, "a.mnc");
  ASSERT_EQ(series->info().fields.size(), 1u);
  EXPECT_EQ(series->info().fields[0].name, "a");
  EXPECT_EQ(series->info().step_count(), 1);
  EXPECT_TRUE(series->info().times.empty());
  EXPECT_EQ(series->info().length_unit, "mm");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, series->Open(0, 0, 0));
  EXPECT_EQ(first->info().name, "first");
  EXPECT_EQ(opened, 0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, series->Open(0, 0, 0));
  EXPECT_EQ(second->info().name, "again");
  EXPECT_THAT(series->Open(0, 0, 0), StatusIs(absl::StatusCode::kDataLoss, ::testing::_));
}

}  // namespace
}  // namespace isoscope::source
