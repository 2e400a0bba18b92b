#include "core/source/child/decoder_module.h"

#include <sched.h>
#include <unistd.h>

#include <string>

#include "absl/strings/match.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/mount.h>
#include <sys/wait.h>

#include "tests/support/skips.h"
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

// Not from the current folder, where anybody may have put one.
TEST(DecoderModuleTest, WithoutProcNoModuleIsLoaded) {
  constexpr int kNotPermitted = 77;
  const pid_t child = ::fork();
  if (child == 0) {
    if (::unshare(CLONE_NEWUSER | CLONE_NEWNS) != 0 ||
        ::mount("none", "/proc", "tmpfs", 0, nullptr) != 0) {
      ::_exit(kNotPermitted);
    }
    const absl::Status status =
        LoadDecoderModule(
            {.file = "isoscope_dicom.so", .symbol = "IsoscopeDecodeDicom", .format = "DICOM"})
            .status();
    ::_exit(status.code() == absl::StatusCode::kFailedPrecondition &&
                    absl::StrContains(status.message(), "mount /proc")
                ? 0
                : 1);
  }
  ASSERT_GT(child, 0);
  int state = 0;
  ASSERT_EQ(::waitpid(child, &state, 0), child);
  ASSERT_TRUE(WIFEXITED(state));
  if (WEXITSTATUS(state) == kNotPermitted) {
    ISOSCOPE_SKIP("namespaces", "no namespace may be made here (user namespaces)");
  }
  EXPECT_EQ(WEXITSTATUS(state), 0);
}

}  // namespace
}  // namespace isoscope::source
