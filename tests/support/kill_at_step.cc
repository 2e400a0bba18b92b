// Preloaded into a program (LD_PRELOAD), ends it with SIGKILL before a step: before it makes a
// folder, renames or removes. ISOSCOPE_TEST_KILL_AT is the number of the step, from 1, or the end
// of the path that it makes or removes. So a test tries every state that a program may leave on the
// disk. Writing into a file is no step: it is flushed before a rename gives it its name.
// ISOSCOPE_TEST_STOP_AT is the end of a path, too: before the first such step it stops by SIGSTOP.

#include <dlfcn.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include <sys/stat.h>
#include <sys/types.h>

namespace {

std::atomic<long> steps{0};
std::atomic<bool> was_stopped{false};

void CountStep(std::string_view path) {
  // NOLINTNEXTLINE(concurrency-mt-unsafe): nobody sets variables
  const char* const stop = std::getenv("ISOSCOPE_TEST_STOP_AT");
  if (stop != nullptr && path.ends_with(stop) && !was_stopped.exchange(true)) {
    kill(getpid(), SIGSTOP);
  }
  // NOLINTNEXTLINE(concurrency-mt-unsafe): nobody sets variables
  const char* const text = std::getenv("ISOSCOPE_TEST_KILL_AT");
  if (text == nullptr) {
    return;
  }
  char* end = nullptr;
  const long number = std::strtol(text, &end, 10);
  const bool is_number = *end == '\0';
  if (is_number ? ++steps == number : path.ends_with(text)) {
    kill(getpid(), SIGKILL);
    pause();
  }
}

// Calls the function of the C library, after the step is counted. `path`: it makes or removes it
template <typename Function, typename... Arguments>
int Call(const char* name, const char* path, Arguments... arguments) {
  CountStep(path);
  // The only way to a function that has the name of one's own.
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name))(arguments...);
}

}  // namespace

extern "C" {

int mkdir(const char* path, mode_t mode) noexcept {
  return Call<int (*)(const char*, mode_t)>("mkdir", path, path, mode);
}
int rename(const char* from, const char* to) noexcept {
  return Call<int (*)(const char*, const char*)>("rename", to, from, to);
}
int renameat2(int from_folder, const char* from, int to_folder, const char* to,
              unsigned int flags) noexcept {
  return Call<int (*)(int, const char*, int, const char*, unsigned int)>(
      "renameat2", to, from_folder, from, to_folder, to, flags);
}
int unlink(const char* path) noexcept { return Call<int (*)(const char*)>("unlink", path, path); }
int unlinkat(int folder, const char* path, int flags) noexcept {
  return Call<int (*)(int, const char*, int)>("unlinkat", path, folder, path, flags);
}

}  // extern "C"
