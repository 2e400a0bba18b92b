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
    const absl::MutexLock lock(&self->mutex_);
    self->mutex_.Await(absl::Condition(&self->started_));
    status = self->start_status_;
  }
  if (!status.ok()) {
    return status;
  }
  return made;
}

GlThread::~GlThread() {
  {
    const absl::MutexLock lock(&mutex_);
    stopping_ = true;
  }
  thread_.join();
}

void GlThread::Submit(Job job) {
  const absl::MutexLock lock(&mutex_);
  queue_.push_back(std::move(job));
}

void GlThread::Run(int egl_device) {
  absl::StatusOr<std::unique_ptr<EglContext>> context = EglContext::Make(egl_device);
  if (context.ok()) {
    driver_ = absl::StrCat((*context)->gl_renderer(), ", OpenGL ", (*context)->gl_version());
    description_ = absl::StrCat("egl: ", driver_, ", ", (*context)->origin());
    is_hardware_ = (*context)->is_hardware();
  }
  {
    const absl::MutexLock lock(&mutex_);
    start_status_ = context.status();
    started_ = true;
  }
  if (!context.ok()) {
    return;
  }
  while (true) {
    Job job;
    {
      const absl::MutexLock lock(&mutex_);
      const auto has_news = [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
        return !queue_.empty() || stopping_;
      };
      mutex_.Await(absl::Condition(&has_news));
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
