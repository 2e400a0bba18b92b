#include "core/source/bytes/located_series.h"

#include <memory>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/series_parts.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::ReadAll;
using ::isoscope::testing::ValuesOf;
using ::testing::ElementsAre;

TEST(LocatedSeriesTest, OpensComponentsAndStepsOfBytesAndText) {
  const testing::TempDir dir;
  const std::string path = dir.Sub("run");
  testing::WriteFile(path, "abcdefghABCDEFGH 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16");
  LocatedFile file{
      .info = {.name = path, .times = {0, 1}},
      .geometry = {.sample_dims = {2, 2, 2}, .spacing = {1, 1, 1}, .origin = {}, .direction = {}}};
  file.Add({.name = "bytes"}, {.location = SampleLocation{.files = {path}, .volume_count = 2}});
  file.Add({.name = "text", .components = ComponentNames(2)},
           {.location = TextLocation{
                .file = path, .offset = 16, .type = volume::ScalarType::kUint8, .components = 2}});
  file.Add({.name = "halves"},
           {.location = SampleLocation{.files = {path}, .stored_type = volume::ScalarType::kUint16},
            .wide = WideType::kFloat16});
  const auto series = MakeLocatedSeries(file);
  EXPECT_EQ(series->info().fields[1].name, "text");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto bytes, series->Open(0, 0, 1));
  EXPECT_EQ(bytes->info().name, path + ":bytes");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string letters, ReadAll(*bytes, 1));
  EXPECT_EQ(letters, "ABCDEFGH");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto text, series->Open(1, 1, 0));
  EXPECT_EQ(text->info().name, path + ":text:1");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string numbers, ReadAll(*text, 1));
  EXPECT_THAT(ValuesOf<std::uint8_t>(numbers), ElementsAre(2, 4, 6, 8, 10, 12, 14, 16));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto halves, series->Open(2, 0, 0));
  EXPECT_EQ(halves->info().type, volume::ScalarType::kFloat32);
}

TEST(LocatedSeriesTest, NamesComponents) {
  EXPECT_THAT(ComponentNames(1), ElementsAre(""));
  EXPECT_THAT(ComponentNames(3), ElementsAre("x", "y", "z"));
  EXPECT_THAT(ComponentNames(2), ElementsAre("0", "1"));
}

}  // namespace
}  // namespace isoscope::source
