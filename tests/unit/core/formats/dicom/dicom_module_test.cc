#include "core/formats/dicom/dicom_module.h"

#include <cstdint>

#include "gtest/gtest.h"

#include "core/base/memory_info.h"
#include "core/formats/dicom/dicom_child.h"
#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // they add memory of their own
// First, since it stays loaded.
TEST(DicomModuleTest, LoadedItTakesNoMoreMemoryThanIsStated) {
  static const std::int64_t bytes = [] {
    const auto before = static_cast<std::int64_t>(base::ResidentBytes());
    ISOSCOPE_EXPECT_OK(LoadDicomModule().status());
    return static_cast<std::int64_t>(base::ResidentBytes()) - before;
  }();
  EXPECT_LE(bytes, kDicomModuleBytes);
  EXPECT_GE(bytes, kDicomModuleBytes / 4) << "another test has loaded it before";
}
#endif

TEST(DicomModuleTest, ItsHandlerAnswersThatAnAbsentFileIsNotDecoded) {
  const absl::StatusOr<DecoderProcess::Handler> handler = LoadDicomModule();
  ISOSCOPE_ASSERT_OK(handler.status());
  DicomRequest request;
  request.path = {'n', 'o', 'n', 'e'};
  DicomAnswer answer{};
  answer.outcome = DicomOutcome::kPixels;
  (*handler)(&request, &answer, nullptr);
  EXPECT_EQ(answer.outcome, DicomOutcome::kNotDecoded);
  EXPECT_EQ(LoadDicomModule().value(), *handler);
}

}  // namespace
}  // namespace isoscope::source
