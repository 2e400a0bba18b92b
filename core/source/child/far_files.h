// Mounted files (core/io/mounted_file.h) for a child process, which has neither threads nor network:
// the parent reads for it.
//
//   child                                   parent, a thread
//   send(number of a file, offset, size) -> check, read into the memory that both share
//   copy                                 <- send(a code, and what went wrong)
//   send(number of a file, ranges)       -> what will be asked for: other threads fetch it before
//
// A child may ask for any bytes of these files, and for nothing else.
//
// Expected ranges wait in the order of the child. Two threads take batches from the front, as long as
// fetched bytes that the child has not asked for stay below kFarAheadBytes. A range that the child
// asks for is dropped with all before it.

#ifndef ISOSCOPE_CORE_SOURCE_CHILD_FAR_FILES_H_
#define ISOSCOPE_CORE_SOURCE_CHILD_FAR_FILES_H_

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"

#include "core/base/cancellation.h"
#include "core/base/mutex.h"
#include "core/base/process_interrupt.h"
#include "core/base/units.h"
#include "core/io/mounted_file.h"

namespace isoscope::source {

inline constexpr std::int64_t kFarAheadBytes = 32 * base::kMiB;

// The side of the parent. Thread-compatible.
class FarFiles {
 public:
  // Makes the socket and the memory for `files`. RESOURCE_EXHAUSTED: the system gives none.
  static absl::StatusOr<std::unique_ptr<FarFiles>> Make(std::vector<io::MountedFile> files);
  // Ends the threads: fetching at once, a read that the child waits for when it has ended.
  ~FarFiles();
  FarFiles(const FarFiles&) = delete;
  FarFiles& operator=(const FarFiles&) = delete;

  // The end of the child, which inherits it by fork.
  [[nodiscard]] int child_socket() const { return child_socket_; }
  // Serves the child, in threads. Called once, behind the fork.
  void Serve();
  // In the child: mounts the files anew, so that they are read through `socket`, in place of all that
  // the parent mounted.
  void MountInChild(int socket) const;
  // In the child: the first error of the parent. Libraries take an attribute that can't be read for
  // none, so an answer that was made after it is worth nothing.
  static absl::Status ErrorInChild();

 private:
  // Bytes of a file that the child will ask for.
  struct Expected {
    std::size_t file = 0;  // index into files_
    io::FileRange range;
    std::unique_ptr<char[]> bytes = {};  // none: not fetched yet
    bool is_done = false;
    absl::Status status = {};
  };

  FarFiles(std::vector<io::MountedFile> files, int parent_socket, int child_socket, char* memory);
  void Run();
  absl::Status Read(std::int64_t number, std::int64_t offset, std::int64_t size);
  void Expect(std::int64_t number, absl::Span<const io::FileRange> ranges);
  // Returns true if the range was expected: its bytes are in memory_, or `status` is its error.
  bool TakeExpected(std::size_t file, std::int64_t offset, std::size_t size, absl::Status* status);
  void DropBefore(std::list<Expected>::iterator end) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Fetch();
  absl::Status FetchBatch(const std::vector<Expected*>& batch);

  const std::vector<io::MountedFile> files_;
  const int parent_socket_;
  int child_socket_;
  char* const memory_;
  std::thread thread_;
  std::vector<std::thread> fetchers_;

  base::Cancellation ended_;  // by the destructor, or by the process
  const base::Cancellation::Callback by_process_;
  base::Mutex mutex_;
  base::CondVar changed_;
  // By the order of the child; those that are being fetched or were fetched come first.
  std::list<Expected> expected_ ABSL_GUARDED_BY(mutex_);
  std::list<Expected>::iterator next_ ABSL_GUARDED_BY(mutex_);  // the first not fetched yet
  std::int64_t held_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHILD_FAR_FILES_H_
