#include "core/source/bytes/text_header.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(TextHeaderTest, LinesEndAsUnixOrDosOrTheTextDoes) {
  const std::string text = "a\n\r\nb\r\nlast";
  std::vector<std::string> lines;
  std::size_t position = 0;
  absl::string_view line;
  while (NextLine(text, &position, &line)) {
    lines.emplace_back(line);
  }
  EXPECT_THAT(lines, ElementsAre("a", "", "b", "last"));
  EXPECT_EQ(position, text.size());
}

TEST(TextHeaderTest, AGzipStreamIsNoText) {
  const testing::TempDir dir;
  testing::WriteFile(dir.Sub("a.HEAD"), testing::Gzip("type = string-attribute\n"));
  EXPECT_THAT(ReadTextHeader(dir.Sub("a.HEAD")),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("a.HEAD: a gzip stream")));
}

TEST(TextHeaderTest, FieldsAreFoundInAnyCaseWithoutSpacesAround) {
  HeaderFields fields("f.mhd");
  fields.Set(" DimSize ", "\t1 2\t 3 ");
  fields.Set("HeaderSize", "-1");
  fields.Set("Odd", "12x");
  EXPECT_EQ(fields.Get("dimsize"), "1 2\t 3");
  EXPECT_EQ(fields.Get("absent"), "");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto sizes, fields.GetIntegers("dimsize"));
  EXPECT_THAT(sizes, ElementsAre(1, 2, 3));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto none, fields.GetIntegers("absent"));
  EXPECT_THAT(none, IsEmpty());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::int64_t size, fields.GetInteger("headersize", 0));
  EXPECT_EQ(size, -1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::int64_t fallback, fields.GetInteger("absent", 7));
  EXPECT_EQ(fallback, 7);
  for (const absl::Status& status :
       {fields.GetInteger("odd", 0).status(), fields.GetIntegers("odd").status()}) {
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("f.mhd: ")));
    EXPECT_THAT(status.message(), HasSubstr("12x"));
  }
}

TEST(TextHeaderTest, NoMoreIsReadThanAHeaderCanHave) {
  const testing::TempDir dir;
  testing::WriteFile(dir.Sub("small"), "abc");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string small, ReadTextHeader(dir.Sub("small")));
  EXPECT_EQ(small, "abc");
  testing::WriteFile(dir.Sub("large"), std::string(5 << 20, 'x'));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string large, ReadTextHeader(dir.Sub("large")));
  EXPECT_EQ(large.size(), std::size_t{4} << 20);
  EXPECT_THAT(ReadTextHeader(dir.Sub("none")).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("none")));
}

}  // namespace
}  // namespace isoscope::source
