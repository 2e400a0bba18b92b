// The functions of the C library that read the date or wait for one, with a date that jumps: the
// machine's and an offset. They take the place of the library's in a program that links or preloads
// this.
//
// The offset lies in the file that ISOSCOPE_TEST_DATE_OFFSET names, eight bytes in seconds; without
// the variable, in this process. A wait for a date goes in slices, and looks at the date after each
// one. So it heeds a jump, as a wait of the kernel heeds a clock that is set.

#include "tests/support/date_functions.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdarg>
#include <cstdint>
#include <cstdlib>
#include <ctime>

#include <linux/futex.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>

namespace {

constexpr std::int64_t kSecond = 1'000'000'000;
constexpr std::int64_t kSlice = kSecond / 100;

template <typename Function>
Function* Next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

std::atomic<std::int64_t>* MapOffset() {
  static std::atomic<std::int64_t> own{0};
  // NOLINTNEXTLINE(concurrency-mt-unsafe): nobody sets the environment
  const char* const path = getenv("ISOSCOPE_TEST_DATE_OFFSET");
  const int file = path == nullptr ? -1 : open(path, O_RDONLY | O_CLOEXEC);
  if (file < 0) {
    return &own;
  }
  void* const mapped = mmap(nullptr, sizeof(own), PROT_READ, MAP_SHARED, file, 0);
  close(file);
  return mapped == MAP_FAILED ? &own : static_cast<std::atomic<std::int64_t>*>(mapped);
}

std::atomic<std::int64_t>& Offset() {
  static std::atomic<std::int64_t>* const offset = MapOffset();
  return *offset;
}

std::int64_t NanosecondsOf(const timespec& time) { return time.tv_sec * kSecond + time.tv_nsec; }

timespec ToTimespec(std::int64_t nanoseconds) {
  return {.tv_sec = nanoseconds / kSecond, .tv_nsec = nanoseconds % kSecond};
}

std::int64_t Read(clockid_t clock) {
  static auto* const next = Next<int(clockid_t, timespec*)>("clock_gettime");
  timespec now{};
  next(clock, &now);
  return NanosecondsOf(now);
}

std::int64_t Date() { return Read(CLOCK_REALTIME) + Offset().load() * kSecond; }

// Calls wait(end of a slice on the monotonic clock) until it returns anything but `timed_out`, or
// until the date `end`; then returns `timed_out`. Waits at least once.
template <typename Wait>
auto WaitInSlices(std::int64_t end, const Wait& wait, decltype(wait(timespec())) timed_out) {
  while (true) {
    const std::int64_t left = std::clamp<std::int64_t>(end - Date(), 0, kSlice);
    const auto result = wait(ToTimespec(Read(CLOCK_MONOTONIC) + left));
    if (result != timed_out || Date() >= end) {
      return result;
    }
  }
}

int WaitForCondition(pthread_cond_t* condition, pthread_mutex_t* mutex, clockid_t clock,
                     const timespec* end) {
  static auto* const next =
      Next<int(pthread_cond_t*, pthread_mutex_t*, clockid_t, const timespec*)>(
          "pthread_cond_clockwait");
  if (clock != CLOCK_REALTIME) {
    return next(condition, mutex, clock, end);
  }
  return WaitInSlices(
      NanosecondsOf(*end),
      [&](const timespec& slice) { return next(condition, mutex, CLOCK_MONOTONIC, &slice); },
      ETIMEDOUT);
}

}  // namespace

void isoscope::testing::SetDateOffset(std::int64_t offset_seconds) {
  Offset().store(offset_seconds);
}

extern "C" {

int clock_gettime(clockid_t clock, timespec* time) noexcept {
  const bool is_date = clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE;
  *time = ToTimespec(is_date ? Date() : Read(clock));
  return 0;
}

int gettimeofday(timeval* time, void* /*zone*/) noexcept {
  const timespec now = ToTimespec(Date());
  *time = {.tv_sec = now.tv_sec, .tv_usec = now.tv_nsec / 1000};
  return 0;
}

std::time_t time(std::time_t* time) noexcept {
  const std::time_t now = Date() / kSecond;
  if (time != nullptr) {
    *time = now;
  }
  return now;
}

// A condition that was made for another clock would wait wrongly. None of ours is.
int pthread_cond_timedwait(pthread_cond_t* condition, pthread_mutex_t* mutex, const timespec* end) {
  return WaitForCondition(condition, mutex, CLOCK_REALTIME, end);
}

int pthread_cond_clockwait(pthread_cond_t* condition, pthread_mutex_t* mutex, clockid_t clock,
                           const timespec* end) {
  return WaitForCondition(condition, mutex, clock, end);
}

// abseil calls the kernel's futex by it.
long syscall(long number, ...) noexcept {
  static auto* const next = Next<long(long, ...)>("syscall");
  va_list list;
  va_start(list, number);
  long a[6];
  for (long& argument : a) {
    argument = va_arg(list, long);
  }
  va_end(list);
  const auto* const end = reinterpret_cast<const timespec*>(a[3]);
  constexpr long kWaitForDate = FUTEX_WAIT_BITSET | FUTEX_CLOCK_REALTIME;
  if (number != SYS_futex || (a[1] & kWaitForDate) != kWaitForDate || end == nullptr) {
    return next(number, a[0], a[1], a[2], a[3], a[4], a[5]);
  }
  const int error = WaitInSlices(
      NanosecondsOf(*end),
      [&](const timespec& slice) {
        return next(number, a[0], a[1] & ~static_cast<long>(FUTEX_CLOCK_REALTIME), a[2], &slice,
                    a[4], a[5]) == 0
                   ? 0
                   : errno;
      },
      ETIMEDOUT);
  errno = error;
  return error == 0 ? 0 : -1;
}

}  // extern "C"
