#include "core/render/gl_thread.h"

#include <utility>

#include "absl/strings/str_cat.h"

#include "core/render/egl_context.h"

namespace isoscope::render {

absl::StatusOr<std::unique_ptr<GlThread>> GlThread::Start(int egl_device) {
  std::unique_ptr<GlThread> made(new GlThread);
  GlThread* self = made.get();
  self->thread_ = std::thread([self, egl_device]() { self->Run(egl_device); });
  absl::Status status;
  {
    const base::MutexLock lock(&self->mutex_);
    self->changed_.Await(&self->mutex_, [self]() ABSL_SHARED_LOCKS_REQUIRED(self->mutex_) {
      return self->started_;
    });
    status = self->start_status_;
  }
  if (!status.ok()) {
    return status;
  }
  return made;
}

GlThread::~GlThread() {
  {
    const base::MutexLock lock(&mutex_);
    stopping_ = true;
    changed_.SignalAll();
  }
  thread_.join();
}

void GlThread::Submit(Job job) {
  const base::MutexLock lock(&mutex_);
  queue_.push_back(std::move(job));
  changed_.SignalAll();
}

void GlThread::Run(int egl_device) {
  absl::StatusOr<std::unique_ptr<EglContext>> context = EglContext::Make(egl_device);
  if (context.ok()) {
    driver_ = absl::StrCat((*context)->gl_renderer(), ", OpenGL ", (*context)->gl_version());
    description_ = absl::StrCat("egl: ", driver_, ", ", (*context)->origin());
    is_hardware_ = (*context)->is_hardware();
  }
  {
    const base::MutexLock lock(&mutex_);
    start_status_ = context.status();
    started_ = true;
    changed_.SignalAll();
  }
  if (!context.ok()) {
    return;
  }
  while (true) {
    Job job;
    {
      const base::MutexLock lock(&mutex_);
      changed_.Await(&mutex_, [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
        return !queue_.empty() || stopping_;
      });
      if (queue_.empty()) {
        return;
      }
      job = std::move(queue_.front());
      queue_.pop_front();
    }
    std::move(job)();
  }
}

}  // namespace isoscope::render
