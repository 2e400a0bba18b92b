// Mounted files (core/io/mounted_file.h) for a child process, which has neither threads nor network:
// the parent reads for it.
//
//   child                                   parent, a thread
//   send(number of a file, offset, size) -> check, read into the memory that both share
//   copy                                 <- send(a code, and what went wrong)
//
// A child may ask for any bytes of these files, and for nothing else.

#ifndef ISOSCOPE_CORE_SOURCE_CHILD_FAR_FILES_H_
#define ISOSCOPE_CORE_SOURCE_CHILD_FAR_FILES_H_

#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"

#include "core/io/mounted_file.h"

namespace isoscope::source {

// The side of the parent. Thread-compatible.
class FarFiles {
 public:
  // Makes the socket and the memory for `files`. RESOURCE_EXHAUSTED: the system gives none.
  static absl::StatusOr<std::unique_ptr<FarFiles>> Make(std::vector<io::MountedFile> files);
  // Ends the thread: as soon as a read under way has ended.
  ~FarFiles();
  FarFiles(const FarFiles&) = delete;
  FarFiles& operator=(const FarFiles&) = delete;

  // The end of the child, which inherits it by fork.
  [[nodiscard]] int child_socket() const { return child_socket_; }
  // Serves the child, in a thread. Called once, behind the fork.
  void Serve();
  // In the child: mounts the files anew, so that they are read through `socket`, in place of all that
  // the parent mounted.
  void MountInChild(int socket) const;

 private:
  FarFiles(std::vector<io::MountedFile> files, int parent_socket, int child_socket, char* memory)
      : files_(std::move(files)),
        parent_socket_(parent_socket),
        child_socket_(child_socket),
        memory_(memory) {}
  void Run() const;

  const std::vector<io::MountedFile> files_;
  const int parent_socket_;
  int child_socket_;
  char* const memory_;
  std::thread thread_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHILD_FAR_FILES_H_
