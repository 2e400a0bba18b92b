#include "core/volume/scalar_type.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::volume {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

// Files hold these numbers.
TEST(ScalarTypeTest, NumbersSizesAndNamesNeverChange) {
  const struct {
    int number;
    const char* name;
    std::size_t size;
  } expected[] = {{1, "uint8", 1},  {2, "int8", 1},  {3, "uint16", 2},  {4, "int16", 2},
                  {5, "uint32", 4}, {6, "int32", 4}, {7, "float32", 4}, {8, "float64", 8}};
  for (const auto& row : expected) {
    const auto type = static_cast<ScalarType>(row.number);
    EXPECT_EQ(NameOf(type), row.name);
    EXPECT_EQ(SizeOf(type), row.size);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ScalarType parsed, ScalarTypeFromName(row.name));
    EXPECT_EQ(parsed, type);
  }
}

TEST(ScalarTypeTest, UnknownNameIsRefusedWithTheListOfNames) {
  for (const char* name : {"", "uint64", "UINT8", "float"}) {
    EXPECT_THAT(ScalarTypeFromName(name),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         AllOf(HasSubstr(name), HasSubstr("uint8"), HasSubstr("float64"))));
  }
}

}  // namespace
}  // namespace isoscope::volume
