#include "core/render/egl_context.h"

#include <cstdlib>
#include <iostream>
#include <string>

#include "absl/synchronization/notification.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/render/gl_objects.h"
#include "core/render/gl_thread.h"
#include "core/render/renderer_factory.h"
#include "tests/support/status_matchers.h"

namespace isoscope::render {
namespace {

using isoscope::testing::IsOk;
using isoscope::testing::StatusIs;
using ::testing::HasSubstr;

TEST(EglContextTest, SoftwareRasterisersAreToldFromHardware) {
  EXPECT_TRUE(IsSoftwareGlRenderer("llvmpipe (LLVM 15.0.6, 256 bits)"));
  EXPECT_TRUE(IsSoftwareGlRenderer("softpipe"));
  EXPECT_TRUE(IsSoftwareGlRenderer("SWR (LLVM 7.0, 256 bits)"));
  EXPECT_TRUE(IsSoftwareGlRenderer("Software Rasterizer"));
  EXPECT_FALSE(IsSoftwareGlRenderer("NVIDIA A100-SXM4-40GB/PCIe/SSE2"));
  EXPECT_FALSE(IsSoftwareGlRenderer("Mesa Intel(R) UHD Graphics 630 (CFL GT2)"));
  EXPECT_FALSE(IsSoftwareGlRenderer("AMD Radeon RX 6800 (navi21, LLVM 15.0.6, DRM 3.49)"));
}

TEST(EglContextTest, EveryListedDeviceThatWorksCanBeChosenByItsNumber) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto devices, ListEglDevices());
  ASSERT_FALSE(devices.empty());
  int working = 0;
  for (const EglDevice& device : devices) {
    EXPECT_THAT(FormatEglDevices(devices), HasSubstr(device.name));
    if (!device.status.ok()) {
      continue;
    }
    ++working;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto thread, GlThread::Start(device.index));
    EXPECT_THAT(thread->description(), HasSubstr(device.gl_renderer));
    EXPECT_EQ(thread->is_hardware(), !IsSoftwareGlRenderer(device.gl_renderer));
  }
  EXPECT_GT(working, 0);
}

TEST(EglContextTest, ADeviceThatDoesNotExistIsNamed) {
  EXPECT_THAT(EglContext::Make(1000),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("no EGL device 1000")));
}

TEST(EglContextTest, FramebuffersBeyondTheDriversLimitAreResourceExhausted) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto thread, GlThread::Start(-1));
  absl::Status wide;
  absl::Status high;
  absl::Status usual;
  absl::Notification done;
  thread->Submit([&]() {
    wide = GlFramebuffer::Make(1 << 20, 1).status();
    high = GlFramebuffer::Make(1, 1 << 20).status();
    usual = GlFramebuffer::Make(64, 64).status();
    done.Notify();
  });
  done.WaitForNotification();
  EXPECT_THAT(wide, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("1048576 x 1")));
  EXPECT_THAT(high, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("1 x 1048576")));
  EXPECT_THAT(usual, IsOk());
}

TEST(EglContextTest, ShadersThatDoNotCompileComeWithTheLog) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto thread, GlThread::Start(-1));
  absl::Status status;
  absl::Notification done;
  thread->Submit([&]() {
    status = GlProgram::Make("#version 330 core\nvoid main() {}", "#version 330 core\nnonsense")
                 .status();
    done.Notify();
  });
  done.WaitForNotification();
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kInternal, HasSubstr("fragment shader")));
}

// In a fresh process, because EGL reads its environment once.
[[noreturn]] void PrintErrorWithoutVendors() {
  setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent", 1);
  unsetenv("__EGL_VENDOR_LIBRARY_DIRS");
  const auto renderer = MakeRenderer({.kind = RendererKind::kEgl});
  std::cerr << renderer.status() << "\n";
  std::_Exit(renderer.ok() ? 0 : 3);
}

TEST(EglContextDeathTest, WithoutADriverTheErrorTellsWhatWasTriedAndWhatToInstall) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto everything = ::testing::AllOf(
      HasSubstr("FAILED_PRECONDITION"), HasSubstr("EGL can't start"), HasSubstr("EGL devices"),
      HasSubstr("surfaceless platform: "), HasSubstr("default display: "), HasSubstr(": EGL_"),
      HasSubstr("libegl1"), HasSubstr("libgl1-mesa-dri"));
  EXPECT_EXIT(PrintErrorWithoutVendors(), ::testing::ExitedWithCode(3), everything);
}

}  // namespace
}  // namespace isoscope::render
