#include "core/source/decoder_module.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(DecoderModuleTest, AModuleIsFoundBesideTheFolderOfTheProgram) {
  const auto found = LoadDecoderModule(
      {.file = "isoscope_dicom.so", .symbol = "IsoscopeDecodeDicom", .format = "DICOM"});
  ISOSCOPE_ASSERT_OK(found.status());
  EXPECT_NE(*found, nullptr);
}

TEST(DecoderModuleTest, AnAbsentModuleIsNamedWithItsPlace) {
  EXPECT_THAT(LoadDecoderModule({.file = "isoscope_none.so", .symbol = "Call", .format = "None"}),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("None files can't be read ("),
                             HasSubstr("lib/isoscope/isoscope_none.so"),
                             HasSubstr("isoscope_none.so belongs in lib/isoscope"))));
}

TEST(DecoderModuleTest, AModuleOfAnotherVersionIsRefused) {
  EXPECT_THAT(
      LoadDecoderModule({.file = "isoscope_dicom.so", .symbol = "NoSuchCall", .format = "DICOM"}),
      StatusIs(absl::StatusCode::kFailedPrecondition,
               AllOf(HasSubstr("NoSuchCall"), HasSubstr("install it again"))));
}

}  // namespace
}  // namespace isoscope::source
