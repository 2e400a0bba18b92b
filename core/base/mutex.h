// Locks and a condition variable: the standard library's, with the annotations that clang's lock
// checker (-Wthread-safety) reads.
//
// They are not abseil's, because ThreadSanitizer understands only the calls of pthread below the
// standard library's. Debian's abseil is not built for it, so it reports a race for everything that
// an absl::Mutex orders. In contrast to absl::Mutex, code that makes a predicate true must signal
// by hand.
//
//   void Put(Item item) {
//     base::MutexLock lock(&mutex_);
//     items_.push_back(std::move(item));
//     changed_.Signal();
//   }
//   Item Take() {
//     base::MutexLock lock(&mutex_);
//     changed_.Await(&mutex_, [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
//       return !items_.empty();
//     });
//     ...
//   }
//
// AwaitOrCancelled in cancellation.h waits until a cancellation fires, too.

#ifndef ISOSCOPE_CORE_BASE_MUTEX_H_
#define ISOSCOPE_CORE_BASE_MUTEX_H_

#include <condition_variable>
#include <mutex>
#include <shared_mutex>

#include "absl/base/thread_annotations.h"

#include "core/base/monotonic_time.h"

namespace isoscope::base {

// Not recursive.
class ABSL_LOCKABLE Mutex {
 public:
  Mutex() = default;
  Mutex(const Mutex&) = delete;
  Mutex& operator=(const Mutex&) = delete;

  void Lock() ABSL_EXCLUSIVE_LOCK_FUNCTION() { mutex_.lock(); }
  void Unlock() ABSL_UNLOCK_FUNCTION() { mutex_.unlock(); }
  [[nodiscard]] bool TryLock() ABSL_EXCLUSIVE_TRYLOCK_FUNCTION(true) { return mutex_.try_lock(); }

 private:
  friend class CondVar;

  std::mutex mutex_;
};

// Many readers or one writer. Not recursive. A reader's lock can't become a writer's.
class ABSL_LOCKABLE SharedMutex {
 public:
  SharedMutex() = default;
  SharedMutex(const SharedMutex&) = delete;
  SharedMutex& operator=(const SharedMutex&) = delete;

  void WriterLock() ABSL_EXCLUSIVE_LOCK_FUNCTION() { mutex_.lock(); }
  void WriterUnlock() ABSL_UNLOCK_FUNCTION() { mutex_.unlock(); }
  void ReaderLock() ABSL_SHARED_LOCK_FUNCTION() { mutex_.lock_shared(); }
  void ReaderUnlock() ABSL_UNLOCK_FUNCTION() { mutex_.unlock_shared(); }

 private:
  std::shared_mutex mutex_;
};

class ABSL_SCOPED_LOCKABLE MutexLock {
 public:
  explicit MutexLock(Mutex* mutex) ABSL_EXCLUSIVE_LOCK_FUNCTION(mutex) : mutex_(mutex) {
    mutex_->Lock();
  }
  ~MutexLock() ABSL_UNLOCK_FUNCTION() { mutex_->Unlock(); }
  MutexLock(const MutexLock&) = delete;
  MutexLock& operator=(const MutexLock&) = delete;

 private:
  Mutex* const mutex_;
};

// As MutexLock; does nothing for null.
class ABSL_SCOPED_LOCKABLE MutexLockMaybe {
 public:
  explicit MutexLockMaybe(Mutex* mutex) ABSL_EXCLUSIVE_LOCK_FUNCTION(mutex) : mutex_(mutex) {
    if (mutex_ != nullptr) {
      mutex_->Lock();
    }
  }
  ~MutexLockMaybe() ABSL_UNLOCK_FUNCTION() {
    if (mutex_ != nullptr) {
      mutex_->Unlock();
    }
  }
  MutexLockMaybe(const MutexLockMaybe&) = delete;
  MutexLockMaybe& operator=(const MutexLockMaybe&) = delete;

 private:
  Mutex* const mutex_;
};

class ABSL_SCOPED_LOCKABLE ReaderMutexLock {
 public:
  explicit ReaderMutexLock(SharedMutex* mutex) ABSL_SHARED_LOCK_FUNCTION(mutex) : mutex_(mutex) {
    mutex_->ReaderLock();
  }
  ~ReaderMutexLock() ABSL_UNLOCK_FUNCTION() { mutex_->ReaderUnlock(); }
  ReaderMutexLock(const ReaderMutexLock&) = delete;
  ReaderMutexLock& operator=(const ReaderMutexLock&) = delete;

 private:
  SharedMutex* const mutex_;
};

class ABSL_SCOPED_LOCKABLE WriterMutexLock {
 public:
  explicit WriterMutexLock(SharedMutex* mutex) ABSL_EXCLUSIVE_LOCK_FUNCTION(mutex) : mutex_(mutex) {
    mutex_->WriterLock();
  }
  ~WriterMutexLock() ABSL_UNLOCK_FUNCTION() { mutex_->WriterUnlock(); }
  WriterMutexLock(const WriterMutexLock&) = delete;
  WriterMutexLock& operator=(const WriterMutexLock&) = delete;

 private:
  SharedMutex* const mutex_;
};

// A thread may signal with or without the mutex. All that wait at one time pass the same mutex.
//
// Predicates are called with the mutex held, before the first wait and after each. They may change
// anything that the mutex guards.
class CondVar {
 public:
  CondVar() = default;
  CondVar(const CondVar&) = delete;
  CondVar& operator=(const CondVar&) = delete;

  // Wakes one waiting thread. Any of them must be able to use the change. If they wait for
  // different things, call SignalAll.
  void Signal() { condition_.notify_one(); }
  void SignalAll() { condition_.notify_all(); }

  // Releases the mutex, waits for a signal, and takes it again. May return without a signal.
  void Wait(Mutex* mutex) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
  // Does the same, but not after `deadline`, which may be MonotonicTime::InfiniteFuture(). Returns
  // false once `deadline` has passed. May return true without a signal.
  bool WaitUntil(Mutex* mutex, MonotonicTime deadline) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);

  // The analysis can't know that the predicate's lock is `mutex`.
  template <typename Predicate>
  void Await(Mutex* mutex, Predicate predicate)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) ABSL_NO_THREAD_SAFETY_ANALYSIS {
    while (!predicate()) {
      Wait(mutex);
    }
  }
  // Returns the last result of the predicate, which is called at least once for any `deadline`.
  template <typename Predicate>
  bool AwaitUntil(Mutex* mutex, MonotonicTime deadline, Predicate predicate)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) ABSL_NO_THREAD_SAFETY_ANALYSIS {
    while (!predicate()) {
      if (!WaitUntil(mutex, deadline)) {
        return predicate();
      }
    }
    return true;
  }

 private:
  std::condition_variable condition_;
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_MUTEX_H_
