#include "core/source/child/silent_libraries.h"

#include <string>

#include "gtest/gtest.h"
#include "itkMacro.h"
#include "itkOutputWindow.h"

namespace isoscope::source {
namespace {

void WriteMessages() {
  itk::OutputWindow::GetInstance()->DisplayWarningText("Patient^Name");
  itkGenericOutputMacro(<< "Patient^Name");
}

TEST(SilentLibrariesTest, NothingThatTheLibrariesSayIsPrinted) {
  testing::internal::CaptureStderr();
  WriteMessages();
  EXPECT_NE(testing::internal::GetCapturedStderr(), "");  // what the test is about
  SilenceImageLibraries();
  SilenceImageLibraries();
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  WriteMessages();
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
}

}  // namespace
}  // namespace isoscope::source
