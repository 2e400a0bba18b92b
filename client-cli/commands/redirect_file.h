// Passes an address with a token to a browser through a file, because every user of the machine can
// read command lines.

#ifndef ISOSCOPE_CLIENT_CLI_COMMANDS_REDIRECT_FILE_H_
#define ISOSCOPE_CLIENT_CLI_COMMANDS_REDIRECT_FILE_H_

#include <memory>
#include <string>
#include <utility>

#include "absl/status/statusor.h"

namespace isoscope::cli {

// A page on disk that redirects to an address. Only its owner may read it (mode 0600, in a folder
// of mode 0700). The destructor removes it.
class RedirectFile {
 public:
  // Creates it in the folder for temporary files (TMPDIR). FAILED_PRECONDITION if it can't be
  // written.
  static absl::StatusOr<std::unique_ptr<RedirectFile>> Create(const std::string& address);
  ~RedirectFile();
  RedirectFile(const RedirectFile&) = delete;
  RedirectFile& operator=(const RedirectFile&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  explicit RedirectFile(std::string path) : path_(std::move(path)) {}

  const std::string path_;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_REDIRECT_FILE_H_
