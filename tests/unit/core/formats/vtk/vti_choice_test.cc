#include "core/formats/vtk/vti_choice.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/core/formats/vtk/vti_tags.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::kThreeComponents;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::VtiArrayTag;
using ::isoscope::testing::VtiTags;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class VtiChoiceTest : public testing::VtiTagsTest {};

TEST_F(VtiChoiceTest, DefaultIsOneComponentPointsBeforeCellsScalarsBeforeOthers) {
  const std::string v3 = VtiArrayTag("v3", "Float32", kThreeComponents);
  EXPECT_EQ(Chosen(VtiTags(VtiArrayTag("a") + VtiArrayTag("b"))), "p:a:0");
  EXPECT_EQ(Chosen(VtiTags(VtiArrayTag("a") + VtiArrayTag("b"), "", "Scalars=\"b\"")), "p:b:0");
  EXPECT_EQ(Chosen(VtiTags(v3 + VtiArrayTag("b"), "", "Scalars=\"v3\"")), "p:b:0");
  EXPECT_EQ(Chosen(VtiTags("", VtiArrayTag("c") + VtiArrayTag("d"))), "c:c:0");
  EXPECT_EQ(Chosen(VtiTags("", VtiArrayTag("c") + VtiArrayTag("d"), "", "Scalars=\"d\"")), "c:d:0");
  EXPECT_EQ(Chosen(VtiTags(VtiArrayTag("a"), VtiArrayTag("c"))), "p:a:0");
  EXPECT_EQ(Chosen(VtiTags(v3, VtiArrayTag("c"), "Vectors=\"v3\"")), "c:c:0");
  EXPECT_EQ(Chosen(VtiTags(VtiArrayTag("vtkGhostType", "UInt8") + VtiArrayTag("ids", "Int64") +
                           VtiArrayTag("b"))),
            "p:b:0");
  EXPECT_EQ(Chosen(VtiTags(VtiArrayTag("ids", "Int64"))), "p:ids:0") << "refused by its type later";
}

TEST_F(VtiChoiceTest, NameChoosesAnArrayAndANumberAComponent) {
  const std::string bytes =
      VtiTags(VtiArrayTag("a") + VtiArrayTag("v", "Float32", kThreeComponents) + VtiArrayTag("v:1"),
              VtiArrayTag("a") + VtiArrayTag("c") + VtiArrayTag("w", "Float32", kThreeComponents));
  EXPECT_EQ(Chosen(bytes, "a"), "p:a:0");
  EXPECT_EQ(Chosen(bytes, "a:0"), "p:a:0");
  EXPECT_EQ(Chosen(bytes, "c"), "c:c:0");
  EXPECT_EQ(Chosen(bytes, "v:0"), "p:v:0");
  EXPECT_EQ(Chosen(bytes, "v:2"), "p:v:2");
  EXPECT_EQ(Chosen(bytes, "v:1"), "p:v:1:0") << "an array of that very name";
  EXPECT_EQ(Chosen(bytes, "w:1"), "c:w:1");
}

TEST_F(VtiChoiceTest, ErrorsListTheArraysAndTheArgumentToGive) {
  const std::string vectors = VtiTags(VtiArrayTag("v", "Float32", kThreeComponents),
                                      VtiArrayTag("t", "Float32", "NumberOfComponents=\"9\""));
  const auto names_both = AllOf(HasSubstr("point array \"v\" of 3 components"),
                                HasSubstr("cell array \"t\" of 9 components"));
  EXPECT_THAT(Choose(vectors).status(),
              StatusIs(kInvalid, AllOf(HasSubstr("v.vti:v:0"), names_both)));
  EXPECT_THAT(Choose(vectors, "t").status(),
              StatusIs(kInvalid, AllOf(HasSubstr("0 to 8, as in v.vti:t:0"), names_both)));
  for (const char* part : {"v:3", "v:-1"}) {
    EXPECT_THAT(Choose(vectors, part).status(),
                StatusIs(kInvalid, AllOf(HasSubstr("0 to 2, as in v.vti:v:0"), names_both)));
  }
  for (const char* part : {"x", "x:0", "v:", "v:x", ":0"}) {
    EXPECT_THAT(Choose(vectors, part).status(),
                StatusIs(absl::StatusCode::kNotFound,
                         AllOf(HasSubstr(absl::StrCat("no array \"", part, "\"")), names_both)));
  }
  EXPECT_THAT(Choose(VtiTags("")).status(), StatusIs(kInvalid, HasSubstr("PointData or CellData")));
}

TEST_F(VtiChoiceTest, TypesAreVtksNames) {
  VtiArray array;
  array.name = "a";
  array.type = "UInt16";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::ScalarType type, VtiTypeOf(array, "v.vti"));
  EXPECT_EQ(type, volume::ScalarType::kUint16);
  array.type = "Int64";
  EXPECT_THAT(VtiTypeOf(array, "v.vti").status(), StatusIs(kInvalid, HasSubstr("\"Int64\"")));
}

TEST_F(VtiChoiceTest, EligibleArraysHaveOneComponentOfAVolumesTypeAndMarkNoGhosts) {
  VtiArray array{.name = "a", .type = "Float64"};
  EXPECT_TRUE(IsDefaultVtiArray(array));
  array.components = 2;
  EXPECT_FALSE(IsDefaultVtiArray(array));
  array = {.name = "a", .type = "Int64"};
  EXPECT_FALSE(IsDefaultVtiArray(array));
  array = {.name = "vtkGhostType", .type = "UInt8"};
  EXPECT_FALSE(IsDefaultVtiArray(array));
}

TEST_F(VtiChoiceTest, NumbersAreTheTypesOfVolumesAndThoseOf64Bits) {
  for (const char* type : {"UInt8", "Int8", "UInt16", "Int16", "UInt32", "Int32", "Float32",
                           "Float64", "Int64", "UInt64"}) {
    EXPECT_TRUE(IsVtiNumber(type)) << type;
  }
  for (const char* type : {"", "String", "Bit", "float", "Int65"}) {
    EXPECT_FALSE(IsVtiNumber(type)) << type;
  }
}

}  // namespace
}  // namespace isoscope::source
