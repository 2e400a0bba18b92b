#include "core/source/bytes/file_layout.h"

#include <cstdint>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ValuesOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class FileLayoutTest : public ::testing::Test {
 protected:
  FileLayoutTest() {
    std::vector<std::int16_t> values;
    for (std::int16_t i = 0; i < 32; ++i) {
      values.push_back(i);
    }
    testing::WriteFile(dir_.Sub("a"), BytesOf(values));
    layout_.geometry.sample_dims = {2, 2, 2};
    layout_.location.files = {dir_.Sub("a")};
    layout_.location.stored_type = volume::ScalarType::kInt16;
    layout_.location.volume_count = 4;
    layout_.fields = {"p", "q"};
    layout_.steps = 2;
  }
  testing::TempDir dir_;
  FileLayout layout_;
};

TEST_F(FileLayoutTest, FieldsThenStepsWithTheirTimes) {
  layout_.times = {3, 7};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, MakeLayoutSeries("a", "unused", layout_));
  EXPECT_EQ(series->info().fields[1].name, "q");
  EXPECT_THAT(series->info().times, ElementsAre(3, 7));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(1, 0, 1));
  EXPECT_EQ(ValuesOf<std::int16_t>(ReadAll(*source, 1).value())[0], 24);
}

TEST_F(FileLayoutTest, OneScaledVolumeMakesAllFloat) {
  layout_.rescalings = {{}, {}, {.slope = 0.5}, {}};
  for (const int volume : {0, 2}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenLayoutVolume(layout_, volume, "a"));
    ASSERT_EQ(source->info().type, volume::ScalarType::kFloat32);
    EXPECT_EQ(ValuesOf<float>(ReadAll(*source, 2).value())[1], volume == 0 ? 1 : 8.5F);
  }
}

TEST_F(FileLayoutTest, SlicesLieAnywhere) {
  layout_.fields.clear();
  layout_.steps = 1;
  layout_.slices = {{.offset = 40}, {.offset = 8, .rescaling = {.slope = 2, .intercept = 1}}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenLayoutVolume(layout_, 0, "a"));
  EXPECT_THAT(ValuesOf<float>(ReadAll(*source, 2).value()),
              ElementsAre(20, 21, 22, 23, 9, 11, 13, 15));
  layout_.slices[0].offset = 57;
  EXPECT_THAT(OpenLayoutVolume(layout_, 0, "a"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("the file has 64")));
}

TEST_F(FileLayoutTest, TooManySteps) {
  layout_.steps = 100'001;
  EXPECT_THAT(MakeLayoutSeries("a", "f", layout_),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("100001 steps")));
}

TEST_F(FileLayoutTest, TooManyComponents) {
  layout_.components = 5000;
  EXPECT_THAT(MakeLayoutSeries("a", "f", layout_),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("5000 components")));
}

}  // namespace
}  // namespace isoscope::source
