// Isolates libraries that may end the process they run in.

#ifndef ISOSCOPE_CORE_SOURCE_CHILD_DECODER_PROCESS_H_
#define ISOSCOPE_CORE_SOURCE_CHILD_DECODER_PROCESS_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "absl/status/status.h"
#include <sys/types.h>

#include "core/source/child/far_files.h"

namespace isoscope::source {

// A child of this process, forked from it, that answers one request at a time, so that hostile
// bytes can end the child, but not this process:
//
//   struct Request { std::array<char, 4096> path; };  // both trivially copyable
//   struct Answer { std::int64_t width; };
//   DecoderProcess process({&DecodeInChild, sizeof(Request), sizeof(Answer), slice_bytes});
//   absl::Status status = process.Ask(request, {.cpu_seconds = 60}, &answer);
//
// The child reads mounted files (core/io/mounted_file.h) through the parent (far_files.h), those of the
// time of Start. It keeps no other descriptors of the parent, writes no core file, and ignores the signals
// that a terminal sends. Its standard input, output and error are /dev/null. It takes no lock of
// the parent. It ends when this process ends, for any reason, as soon as its request is done.
// Thread-compatible; other threads may run, if none of them holds a lock that the handler takes.
class DecoderProcess {
 public:
  // Runs in the child: fills `answer`, which is zeros, from `request`. May throw, abort, crash,
  // hang or take all memory. `shared` is the memory that both processes see.
  using Handler = void (*)(const void* request, void* answer, char* shared);
  struct Job {
    Handler handler = nullptr;
    std::size_t request_bytes = 0;  // below 64 KiB, as the answer
    std::size_t answer_bytes = 0;
    std::size_t shared_bytes = 0;
  };

  // The limits of one request.
  struct Limits {
    std::int64_t cpu_seconds = 60;     // at least 1
    std::int64_t clock_seconds = 600;  // at least 1; while this process runs
    // Address space beyond what the child starts with (see HasMemoryLimit).
    std::int64_t memory_bytes = std::int64_t{1} << 30;
  };

  explicit DecoderProcess(const Job& job) : job_(job) {}
  ~DecoderProcess();
  DecoderProcess(const DecoderProcess&) = delete;
  DecoderProcess& operator=(const DecoderProcess&) = delete;

  // False under sanitizers, which reserve more address space than there is memory.
  static bool HasMemoryLimit();

  // Starts the child if there is none. Call it while this process is small: until the child ends,
  // each page that this process writes to is copied. RESOURCE_EXHAUSTED: the system gives no
  // process or memory.
  absl::Status Start();

  // UNAVAILABLE: the child ended, or its limits of processor time or memory ended it. The message
  // says how. DEADLINE_EXCEEDED: it did not answer within clock_seconds, most often because a disk
  // does not; nothing is known of the file. CANCELLED: the process was interrupted
  // (base::ProcessInterrupt); the child is killed. After each the next request gets a new child. If
  // another process killed the child (SIGKILL), this request is retried once. The child may have
  // written anything: check the answer as any bytes from outside. Otherwise as Start.
  template <typename Request, typename Answer>
  absl::Status Ask(const Request& request, const Limits& limits, Answer* answer) {
    static_assert(std::is_trivially_copyable_v<Request> && std::is_trivially_copyable_v<Answer>);
    return AskBytes(&request, sizeof(Request), limits, answer, sizeof(Answer));
  }

  // The memory that both processes share, Job::shared_bytes long; null before Start. The child may
  // write to it at any time: copy before checking.
  [[nodiscard]] const char* shared() const { return shared_; }
  // The child, or -1.
  [[nodiscard]] pid_t pid() const { return pid_; }

 private:
  enum class Outcome { kAnswered, kEnded, kLate, kInterrupted, kWrongAnswer };

  absl::Status AskBytes(const void* request, std::size_t request_bytes, const Limits& limits,
                        void* answer, std::size_t answer_bytes);
  Outcome AskChild(const Limits& limits, void* answer);
  // Ends the child and returns its status as wait does; 0 if that can't be known. A child that
  // waits for a disk may stay for some time.
  int Stop();

  const Job job_;
  pid_t pid_ = -1;
  int socket_ = -1;
  char* shared_ = nullptr;
  std::unique_ptr<FarFiles> far_files_;  // of the child; null: none is mounted
  std::vector<char> packet_;             // the limits and the request
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHILD_DECODER_PROCESS_H_
