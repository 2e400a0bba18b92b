#include "core/source/bytes/text_source.h"

#include <cmath>
#include <cstdint>
#include <memory>
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

using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ValuesOf;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr volume::GridGeometry kGrid{
    .sample_dims = {2, 2, 2}, .spacing = {1, 1, 1}, .origin = {}, .direction = {}};

class TextSourceTest : public ::testing::Test {
 protected:
  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(const std::string& text,
                                                     TextLocation location) {
    location.file = dir_.Sub("text");
    testing::WriteFile(location.file, text);
    return MakeTextSource(kGrid, location, "run.vtk:p");
  }
  absl::Status ReadError(const std::string& text, const TextLocation& location) {
    auto source = Open(text, location);
    return source.ok() ? ReadAll(**source, 2).status() : source.status();
  }
  testing::TempDir dir_;
};

TEST_F(TextSourceTest, ATagEndsTheNumbers) {
  TextLocation location{.type = ScalarType::kUint8, .ends_at_tag = true};
  for (const char* text : {"1 2 3 4 5 6 7 8</a>9", "1 2 3 4 5 6 7 8 </a> 9"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open(text, location));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*source, 1));
    EXPECT_EQ(bytes, "\1\2\3\4\5\6\7\10");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string again, ReadAll(*source, 2));
    EXPECT_EQ(again, bytes);
  }
  for (const char* text : {"1 2 3 4 5 6 7</a> 8", "1 2 3 4 5 6 7 </a> 8", "1 2 3 4 5 6 7 <a>8"}) {
    EXPECT_THAT(ReadError(text, location), StatusIs(kInvalid, HasSubstr("ends after 7 numbers")))
        << text;
  }
  location.ends_at_tag = false;
  EXPECT_THAT(ReadError("1 2 3 4 5 6 7 8</a>", location), StatusIs(kInvalid));
}

TEST_F(TextSourceTest, ReadsNumbersInAnyOrderOfRows) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source,
                                Open("HEAD 1 -2.5e1 +3\n4D-1 nan -inf 7 1e-60 99",
                                     {.offset = 4, .type = ScalarType::kFloat32}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*source, 1));
  const auto values = ValuesOf<float>(bytes);
  EXPECT_THAT(std::vector<float>(values.begin(), values.begin() + 4), ElementsAre(1, -25, 3, 0.4F));
  EXPECT_TRUE(std::isnan(values[4]));
  EXPECT_EQ(values[5], -INFINITY);
  EXPECT_EQ(values[6], 7);
  EXPECT_EQ(values[7], 0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string again, ReadAll(*source, 2));
  EXPECT_EQ(again, bytes);
  EXPECT_FALSE(source->info().is_seekable);
}

TEST_F(TextSourceTest, PicksOneComponentOfTuples) {
  std::string text;
  for (int i = 0; i < 8; ++i) {
    text +=
        std::to_string(i) + " " + std::to_string(100 + i) + " " + std::to_string(200 + i) + "\n";
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto source, Open(text, {.type = ScalarType::kUint8, .components = 3, .component = 2}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*source, 1));
  EXPECT_THAT(ValuesOf<std::uint8_t>(bytes), ElementsAre(200, 201, 202, 203, 204, 205, 206, 207));
}

TEST_F(TextSourceTest, IntegersOf64BitsAreExactOrRefused) {
  const std::string seven = "0 1 2 3 4 5 6 ";
  const TextLocation wide{.type = ScalarType::kFloat64, .wide = WideType::kInt64};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open(seven + "-9007199254740992", wide));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, ReadAll(*source, 2));
  EXPECT_EQ(ValuesOf<double>(bytes)[7], -9007199254740992.0);
  EXPECT_THAT(ReadError(seven + "9007199254740993", wide), StatusIs(kInvalid, HasSubstr("2^53")));
}

TEST_F(TextSourceTest, SaysWhichWordIsNone) {
  const TextLocation bytes{.type = ScalarType::kUint8};
  EXPECT_THAT(ReadError("0 1 2 3 4 5 6 256", bytes),
              StatusIs(kInvalid, AllOf(HasSubstr("run.vtk:p"), HasSubstr("\"256\""),
                                       HasSubstr("offset 17"), HasSubstr("uint8"))));
  EXPECT_THAT(ReadError("0 1 2 3 4 5 6 -1", bytes), StatusIs(kInvalid, HasSubstr("\"-1\"")));
  EXPECT_THAT(ReadError("0 1 2 3 4 5 6 7x", bytes), StatusIs(kInvalid, HasSubstr("\"7x\"")));
  EXPECT_THAT(ReadError("0 1 2 3 4 5 6 1e39", {.type = ScalarType::kFloat32}),
              StatusIs(kInvalid, HasSubstr("\"1e39\"")));
  EXPECT_THAT(
      ReadError("0             1 2 3", bytes),
      StatusIs(kInvalid, AllOf(HasSubstr("ends after 4 numbers"), HasSubstr("promises 8"))));
  EXPECT_THAT(ReadError("0 1 2", bytes), StatusIs(kInvalid, HasSubstr("can't stand in 5 bytes")));
}

}  // namespace
}  // namespace isoscope::source
