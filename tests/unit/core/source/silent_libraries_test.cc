#include "core/source/silent_libraries.h"

#include <string>

#include "gtest/gtest.h"
#include "itkMacro.h"
#include "itkOutputWindow.h"

#include "gdcmTrace.h"

namespace isoscope::source {
namespace {

void WriteMessages() {
  gdcm::Trace::GetWarningStream() << "Patient^Name" << std::endl;
  gdcm::Trace::GetErrorStream() << "Patient^Name" << std::endl;
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
  EXPECT_FALSE(gdcm::Trace::GetDebugFlag());
  EXPECT_FALSE(gdcm::Trace::GetWarningFlag());
  EXPECT_FALSE(gdcm::Trace::GetErrorFlag());
}

}  // namespace
}  // namespace isoscope::source
