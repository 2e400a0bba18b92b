// The one thread that owns an OpenGL context. Other threads submit work to it.

#ifndef ISOSCOPE_CORE_RENDER_GL_THREAD_H_
#define ISOSCOPE_CORE_RENDER_GL_THREAD_H_

#include <deque>
#include <memory>
#include <string>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/functional/any_invocable.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/mutex.h"

namespace isoscope::render {

// Thread-safe. The destructor runs the queued jobs, then destroys the context on its thread.
class GlThread {
 public:
  using Job = absl::AnyInvocable<void() &&>;

  // Returns the errors of EglContext::Make.
  static absl::StatusOr<std::unique_ptr<GlThread>> Start(int egl_device);
  ~GlThread();

  GlThread(const GlThread&) = delete;
  GlThread& operator=(const GlThread&) = delete;

  // Queues `job`. Jobs run one at a time, in the order of the calls, with the context current.
  void Submit(Job job);

  // "egl: llvmpipe (...), OpenGL 4.5 (Core Profile) Mesa 22.3.6, device 0 (software)".
  [[nodiscard]] const std::string& description() const { return description_; }
  // The driver that decides the pixels: "llvmpipe (LLVM 15.0.6, 256 bits), OpenGL 4.5 (Core
  // Profile) Mesa ...".
  [[nodiscard]] const std::string& driver() const { return driver_; }
  [[nodiscard]] bool is_hardware() const { return is_hardware_; }

 private:
  GlThread() = default;
  void Run(int egl_device);

  // Written by the thread before started_ is set, constant after.
  std::string driver_;
  std::string description_;
  bool is_hardware_ = false;

  base::Mutex mutex_;
  base::CondVar changed_;
  bool started_ ABSL_GUARDED_BY(mutex_) = false;
  absl::Status start_status_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::deque<Job> queue_ ABSL_GUARDED_BY(mutex_);
  std::thread thread_;
};

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_GL_THREAD_H_
