// An OpenGL 3.3 core context without a window system, through EGL.
//
// Make tries, in this order, until something works: the EGL devices (hardware before software),
// Mesa's surfaceless platform, the default display. If nothing works, the error has the answer of
// each attempt, and names the packages to install.

#ifndef ISOSCOPE_CORE_RENDER_EGL_CONTEXT_H_
#define ISOSCOPE_CORE_RENDER_EGL_CONTEXT_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::render {

// One thread makes, uses and destroys it. It is always current on that thread.
class EglContext {
 public:
  // `device`: an index of ListEglDevices, or -1 for the first device or platform that works.
  // FAILED_PRECONDITION if no context can be made; the message is for people.
  static absl::StatusOr<std::unique_ptr<EglContext>> Make(int device);
  ~EglContext();

  EglContext(const EglContext&) = delete;
  EglContext& operator=(const EglContext&) = delete;

  // The device or platform of the context: "device 0 (/dev/dri/card0)", "surfaceless platform".
  [[nodiscard]] const std::string& origin() const { return origin_; }
  // GL_RENDERER and GL_VERSION.
  [[nodiscard]] const std::string& gl_renderer() const { return gl_renderer_; }
  [[nodiscard]] const std::string& gl_version() const { return gl_version_; }
  // Returns true if a GPU draws, not a software rasteriser.
  [[nodiscard]] bool is_hardware() const;

 private:
  EglContext() = default;
  friend struct EglContextMaker;

  // EGLDisplay, EGLContext and EGLSurface are pointers; their header is kept out of this one.
  void* display_ = nullptr;
  void* context_ = nullptr;
  void* surface_ = nullptr;  // null with EGL_KHR_surfaceless_context
  std::string origin_;
  std::string gl_renderer_;
  std::string gl_version_;
};

// One EGL device of this machine, and the result of making a context on it.
struct EglDevice {
  int index = 0;     // for RendererOptions::egl_device
  std::string name;  // from EGL: device file, vendor, "software"
  bool is_software = false;
  absl::Status status;      // whether an OpenGL 3.3 core context could be made
  std::string gl_renderer;  // if so
};

// Tries every EGL device, about 0.1 s each. FAILED_PRECONDITION if EGL is not installed or can't
// list devices. Thread-safe. Leaves the calling thread's current context as it is.
absl::StatusOr<std::vector<EglDevice>> ListEglDevices();
// One line for each device, for `isoscope-agent --list-egl-devices`.
std::string FormatEglDevices(const std::vector<EglDevice>& devices);

// Returns true if GL_RENDERER names a software rasteriser (llvmpipe, softpipe, SWR, swrast).
bool IsSoftwareGlRenderer(absl::string_view gl_renderer);

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_EGL_CONTEXT_H_
