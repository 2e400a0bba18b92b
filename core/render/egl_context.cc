// Make checks that the libraries can be loaded, then tries the devices (hardware before software),
// then the platforms without a device. For each candidate, EglContextMaker::MakeOn does four steps:
//
// 1. Initialize the display and bind the API to OpenGL.
// 2. Choose a config, unless the display supports contexts without one.
// 3. Create an OpenGL 3.3 core context, and a small pbuffer if a context needs a surface.
// 4. Make it current, and read GL_RENDERER and GL_VERSION.
//
// The errors of all candidates are collected, and go into the message if none works.

#include "core/render/egl_context.h"

#include <dlfcn.h>
// epoxy/gl.h first: EGL's header must not bring its own OpenGL declarations.
#include <epoxy/gl.h>
//
#include <algorithm>
#include <array>
#include <cstddef>
#include <thread>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include <epoxy/egl.h>

#include "core/base/status_macros.h"

namespace isoscope::render {
namespace {

constexpr absl::string_view kAdvice =
    "On Debian, install libegl1, libopengl0 and libgl1-mesa-dri (software rendering), or the "
    "NVIDIA "
    "driver's EGL (package nvidia-egl-icd; in containers NVIDIA_DRIVER_CAPABILITIES must contain "
    "graphics); the renderer cpu needs none of them";

std::string EglErrorName(EGLint error) {
  switch (error) {
    case EGL_SUCCESS:
      return "EGL_SUCCESS";
    case EGL_NOT_INITIALIZED:
      return "EGL_NOT_INITIALIZED";
    case EGL_BAD_ACCESS:
      return "EGL_BAD_ACCESS";
    case EGL_BAD_ALLOC:
      return "EGL_BAD_ALLOC";
    case EGL_BAD_ATTRIBUTE:
      return "EGL_BAD_ATTRIBUTE";
    case EGL_BAD_CONFIG:
      return "EGL_BAD_CONFIG";
    case EGL_BAD_CONTEXT:
      return "EGL_BAD_CONTEXT";
    case EGL_BAD_CURRENT_SURFACE:
      return "EGL_BAD_CURRENT_SURFACE";
    case EGL_BAD_DISPLAY:
      return "EGL_BAD_DISPLAY";
    case EGL_BAD_MATCH:
      return "EGL_BAD_MATCH";
    case EGL_BAD_NATIVE_PIXMAP:
      return "EGL_BAD_NATIVE_PIXMAP";
    case EGL_BAD_NATIVE_WINDOW:
      return "EGL_BAD_NATIVE_WINDOW";
    case EGL_BAD_PARAMETER:
      return "EGL_BAD_PARAMETER";
    case EGL_BAD_SURFACE:
      return "EGL_BAD_SURFACE";
    case EGL_CONTEXT_LOST:
      return "EGL_CONTEXT_LOST";
    case EGL_BAD_DEVICE_EXT:
      return "EGL_BAD_DEVICE_EXT";
    default:
      return absl::StrCat("EGL error 0x", absl::Hex(error));
  }
}

// FAILED_PRECONDITION "<call>: <name of EGL's last error>".
absl::Status EglFailure(absl::string_view call) {
  return absl::FailedPreconditionError(absl::StrCat(call, ": ", EglErrorName(eglGetError())));
}

bool ContainsWord(const char* words, absl::string_view word) {
  if (words == nullptr) {
    return false;
  }
  const std::vector<absl::string_view> parts = absl::StrSplit(words, ' ');
  return std::find(parts.begin(), parts.end(), word) != parts.end();
}

bool HasClientExtension(absl::string_view extension) {
  return ContainsWord(eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS), extension);
}

// epoxy aborts the process if a library that it needs is missing, so this checks first.
absl::Status CheckLibraries() {
  if (!epoxy_has_egl()) {
    return absl::FailedPreconditionError("libEGL.so.1 can't be loaded");
  }
  for (const char* name : {"libOpenGL.so.0", "libGL.so.1"}) {
    void* library = dlopen(name, RTLD_LAZY | RTLD_LOCAL);
    if (library != nullptr) {
      dlclose(library);
      return absl::OkStatus();
    }
  }
  return absl::FailedPreconditionError("neither libOpenGL.so.0 nor libGL.so.1 can be loaded");
}

struct Device {
  int index = 0;
  EGLDeviceEXT handle = EGL_NO_DEVICE_EXT;
  std::string name;
  bool is_software = false;
};

std::string DeviceName(EGLDeviceEXT handle, bool is_software) {
  std::vector<std::string> parts;
  const char* extensions = eglQueryDeviceStringEXT(handle, EGL_EXTENSIONS);
  const auto add_string = [&](const char* extension, EGLint name) {
    if (ContainsWord(extensions, extension)) {
      const char* value = eglQueryDeviceStringEXT(handle, name);
      if (value != nullptr) {
        parts.emplace_back(value);
      }
    }
  };
  add_string("EGL_EXT_device_drm", EGL_DRM_DEVICE_FILE_EXT);
#if defined(EGL_RENDERER_EXT)
  add_string("EGL_EXT_device_query_name", EGL_RENDERER_EXT);
#endif
  if (ContainsWord(extensions, "EGL_NV_device_cuda")) {
    EGLAttrib cuda_index = 0;
    if (eglQueryDeviceAttribEXT(handle, EGL_CUDA_DEVICE_NV, &cuda_index) == EGL_TRUE) {
      parts.push_back(absl::StrCat("CUDA device ", cuda_index));
    }
  }
  if (is_software) {
    parts.emplace_back("software");
  }
  return parts.empty() ? "no name" : absl::StrJoin(parts, ", ");
}

absl::StatusOr<std::vector<Device>> QueryDevices() {
  if (!HasClientExtension("EGL_EXT_device_base") &&
      !HasClientExtension("EGL_EXT_device_enumeration")) {
    return absl::FailedPreconditionError(
        "this libEGL can't list devices (EGL_EXT_device_enumeration is missing)");
  }
  EGLint count = 0;
  if (eglQueryDevicesEXT(0, nullptr, &count) != EGL_TRUE) {
    return EglFailure("eglQueryDevicesEXT");
  }
  std::vector<EGLDeviceEXT> handles(static_cast<std::size_t>(std::max(count, 0)));
  if (!handles.empty() && eglQueryDevicesEXT(count, handles.data(), &count) != EGL_TRUE) {
    return EglFailure("eglQueryDevicesEXT");
  }
  handles.resize(std::min(handles.size(), static_cast<std::size_t>(std::max(count, 0))));
  std::vector<Device> devices;
  for (EGLDeviceEXT handle : handles) {
    const bool is_software =
        ContainsWord(eglQueryDeviceStringEXT(handle, EGL_EXTENSIONS), "EGL_MESA_device_software");
    devices.push_back({.index = static_cast<int>(devices.size()),
                       .handle = handle,
                       .name = DeviceName(handle, is_software),
                       .is_software = is_software});
  }
  return devices;
}

std::string GlString(GLenum name) {
  const GLubyte* value = glGetString(name);
  return value == nullptr ? "" : reinterpret_cast<const char*>(value);
}

}  // namespace

// Makes contexts. It is a separate class, so that EGL's types stay out of the header.
struct EglContextMaker {
  static absl::StatusOr<EGLConfig> ChooseConfig(EGLDisplay display, bool needs_pbuffer) {
    for (const EGLint surface_type : {EGL_PBUFFER_BIT, 0}) {
      if (needs_pbuffer && surface_type == 0) {
        continue;
      }
      const std::array<EGLint, 5> attributes{EGL_SURFACE_TYPE, surface_type, EGL_RENDERABLE_TYPE,
                                             EGL_OPENGL_BIT, EGL_NONE};
      EGLConfig config = nullptr;
      EGLint count = 0;
      if (eglChooseConfig(display, attributes.data(), &config, 1, &count) != EGL_TRUE) {
        return EglFailure("eglChooseConfig");
      }
      if (count > 0) {
        return config;
      }
    }
    if (!needs_pbuffer &&
        ContainsWord(eglQueryString(display, EGL_EXTENSIONS), "EGL_KHR_no_config_context")) {
      return EGL_NO_CONFIG_KHR;
    }
    return absl::FailedPreconditionError("eglChooseConfig: no config that OpenGL can draw with");
  }

  static absl::StatusOr<std::unique_ptr<EglContext>> MakeOn(EGLDisplay display,
                                                            absl::string_view origin) {
    if (display == EGL_NO_DISPLAY) {
      return EglFailure("there is no such display");
    }
    // Displays belong to the process. eglTerminate would take this one from other contexts, so it
    // is never called.
    EGLint major = 0;
    EGLint minor = 0;
    if (eglInitialize(display, &major, &minor) != EGL_TRUE) {
      return EglFailure("eglInitialize");
    }
    if (eglBindAPI(EGL_OPENGL_API) != EGL_TRUE) {
      return EglFailure("eglBindAPI(EGL_OPENGL_API)");
    }
    const char* extensions = eglQueryString(display, EGL_EXTENSIONS);
    const bool needs_pbuffer = !ContainsWord(extensions, "EGL_KHR_surfaceless_context");
    ISOSCOPE_ASSIGN_OR_RETURN(EGLConfig config, ChooseConfig(display, needs_pbuffer));
    const std::array<EGLint, 7> attributes{EGL_CONTEXT_MAJOR_VERSION,
                                           3,
                                           EGL_CONTEXT_MINOR_VERSION,
                                           3,
                                           EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                           EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                           EGL_NONE};
    // It owns the objects that are made from here on, so that a failure below frees them.
    std::unique_ptr<EglContext> made(new EglContext);
    made->display_ = display;
    made->origin_ = std::string(origin);
    made->context_ = eglCreateContext(display, config, EGL_NO_CONTEXT, attributes.data());
    if (made->context_ == nullptr) {
      return EglFailure("eglCreateContext(OpenGL 3.3 core)");
    }
    if (needs_pbuffer) {
      const std::array<EGLint, 5> size{EGL_WIDTH, 1, EGL_HEIGHT, 1, EGL_NONE};
      made->surface_ = eglCreatePbufferSurface(display, config, size.data());
      if (made->surface_ == nullptr) {
        return EglFailure("eglCreatePbufferSurface");
      }
    }
    if (eglMakeCurrent(display, made->surface_, made->surface_, made->context_) != EGL_TRUE) {
      return EglFailure("eglMakeCurrent");
    }
    made->gl_renderer_ = GlString(GL_RENDERER);
    made->gl_version_ = GlString(GL_VERSION);
    if (epoxy_gl_version() < 33) {
      return absl::FailedPreconditionError(absl::StrCat(
          "OpenGL ", made->gl_version_, " by ", made->gl_renderer_, "; expected 3.3 or newer"));
    }
    return made;
  }

  static EGLDisplay DisplayOf(const Device& device) {
    return eglGetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, device.handle, nullptr);
  }
};

namespace {

// Tries the EGL devices, or the one asked for. Null if none works; FAILED_PRECONDITION if there is
// no such device.
absl::StatusOr<std::unique_ptr<EglContext>> TryDevices(int device,
                                                       std::vector<std::string>* tried) {
  absl::StatusOr<std::vector<Device>> devices = QueryDevices();
  if (!devices.ok()) {
    tried->push_back(absl::StrCat("EGL devices: ", devices.status().message()));
    return nullptr;
  }
  if (device >= static_cast<int>(devices->size())) {
    return absl::FailedPreconditionError(absl::StrCat("there is no EGL device ", device,
                                                      ": this machine has ", devices->size(),
                                                      ". --list-egl-devices tells which"));
  }
  std::stable_sort(devices->begin(), devices->end(), [](const Device& a, const Device& b) {
    return !a.is_software && b.is_software;
  });
  if (devices->empty()) {
    tried->emplace_back("EGL devices: there are none");
  }
  for (const Device& candidate : *devices) {
    if (device >= 0 && candidate.index != device) {
      continue;
    }
    const std::string origin = absl::StrCat("device ", candidate.index, " (", candidate.name, ")");
    auto context = EglContextMaker::MakeOn(EglContextMaker::DisplayOf(candidate), origin);
    if (context.ok()) {
      return context;
    }
    tried->push_back(absl::StrCat(origin, ": ", context.status().message()));
  }
  return nullptr;
}

// Tries the platforms that need no device. Null if nothing works.
std::unique_ptr<EglContext> TryPlatforms(std::vector<std::string>* tried) {
  if (HasClientExtension("EGL_MESA_platform_surfaceless")) {
    auto context = EglContextMaker::MakeOn(
        eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr),
        "surfaceless platform");
    if (context.ok()) {
      return *std::move(context);
    }
    tried->push_back(absl::StrCat("surfaceless platform: ", context.status().message()));
  } else {
    tried->emplace_back(
        "surfaceless platform: not supported (EGL_MESA_platform_surfaceless is missing)");
  }
  auto context = EglContextMaker::MakeOn(eglGetDisplay(EGL_DEFAULT_DISPLAY), "default display");
  if (context.ok()) {
    return *std::move(context);
  }
  tried->push_back(absl::StrCat("default display: ", context.status().message()));
  return nullptr;
}

}  // namespace

absl::StatusOr<std::unique_ptr<EglContext>> EglContext::Make(int device) {
  std::vector<std::string> tried;
  const auto failure = [&tried]() {
    return absl::FailedPreconditionError(absl::StrCat(
        "EGL can't start an OpenGL 3.3 core context. Tried: ", absl::StrJoin(tried, "; "), ". ",
        kAdvice));
  };
  const absl::Status libraries = CheckLibraries();
  if (!libraries.ok()) {
    tried.push_back(absl::StrCat("loading the libraries: ", libraries.message()));
    return failure();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<EglContext> context, TryDevices(device, &tried));
  if (context == nullptr && device < 0) {
    context = TryPlatforms(&tried);
  }
  if (context == nullptr) {
    return failure();
  }
  return context;
}

EglContext::~EglContext() {
  eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  if (surface_ != nullptr) {
    eglDestroySurface(display_, surface_);
  }
  if (context_ != nullptr) {
    eglDestroyContext(display_, context_);
  }
  eglReleaseThread();
}

bool EglContext::is_hardware() const { return !IsSoftwareGlRenderer(gl_renderer_); }

absl::StatusOr<std::vector<EglDevice>> ListEglDevices() {
  absl::Status error;
  std::vector<EglDevice> listed;
  // This runs on a thread of its own, so that the caller's current context stays current.
  std::thread([&error, &listed]() {
    error = CheckLibraries();
    if (!error.ok()) {
      return;
    }
    const absl::StatusOr<std::vector<Device>> devices = QueryDevices();
    error = devices.status();
    if (!error.ok()) {
      return;
    }
    for (const Device& device : *devices) {
      const auto context = EglContextMaker::MakeOn(EglContextMaker::DisplayOf(device), device.name);
      listed.push_back({.index = device.index,
                        .name = device.name,
                        .is_software = device.is_software,
                        .status = context.status(),
                        .gl_renderer = context.ok() ? (*context)->gl_renderer() : ""});
    }
  }).join();
  if (!error.ok()) {
    return absl::FailedPreconditionError(
        absl::StrCat("can't list EGL devices: ", error.message(), ". ", kAdvice));
  }
  return listed;
}

std::string FormatEglDevices(const std::vector<EglDevice>& devices) {
  std::string out;
  for (const EglDevice& device : devices) {
    absl::StrAppend(&out, device.index, ": ", device.name, ": ",
                    device.status.ok() ? device.gl_renderer : device.status.message(), "\n");
  }
  return out;
}

bool IsSoftwareGlRenderer(absl::string_view gl_renderer) {
  const std::string lower = absl::AsciiStrToLower(gl_renderer);
  for (const absl::string_view name :
       {"llvmpipe", "softpipe", "swrast", "swr", "software rasterizer", "swiftshader"}) {
    if (absl::StrContains(lower, name)) {
      return true;
    }
  }
  return false;
}

}  // namespace isoscope::render
