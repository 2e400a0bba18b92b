#include "core/source/child/itk_types.h"

#include <stdexcept>
#include <utility>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using volume::ScalarType;
using Component = itk::ImageIOBase::IOComponentEnum;

TEST(ScalarTypeOfTest, EveryTypeOfOursIsKnownAndOthersAreRefusedByName) {
  const std::pair<Component, ScalarType> rows[] = {
      {Component::UCHAR, ScalarType::kUint8},   {Component::CHAR, ScalarType::kInt8},
      {Component::USHORT, ScalarType::kUint16}, {Component::SHORT, ScalarType::kInt16},
      {Component::UINT, ScalarType::kUint32},   {Component::INT, ScalarType::kInt32},
      {Component::FLOAT, ScalarType::kFloat32}, {Component::DOUBLE, ScalarType::kFloat64}};
  for (const auto& [component, type] : rows) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ScalarType found, ScalarTypeOf(component, "v"));
    EXPECT_EQ(found, type);
  }
  for (const Component component :
       {Component::ULONGLONG, Component::LONGLONG, Component::UNKNOWNCOMPONENTTYPE}) {
    EXPECT_THAT(
        ScalarTypeOf(component, "/d/v.dcm").status(),
        StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("/d/v.dcm: samples of type")));
  }
}

TEST(TextOfItkTest, MessagesHaveNoAddresses) {
  itk::ExceptionObject error("a.cxx", 7);
  error.SetDescription("ITK ERROR: NrrdImageIO(0x55ae): too many axes");
  EXPECT_EQ(TextOfItk(error), "too many axes");
  error.SetDescription("too many axes");
  EXPECT_EQ(TextOfItk(error), "too many axes");
  EXPECT_EQ(TextOfItk(std::runtime_error("of others")), "of others");
}

}  // namespace
}  // namespace isoscope::source
