#include "core/source/dicom_module.h"

#include "gtest/gtest.h"

#include "core/source/dicom_child.h"
#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

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
