#include "client-cli/commands/redirect_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <system_error>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include <sys/stat.h>

#include "web-gateway/http/http_message.h"

namespace isoscope::cli {
namespace {

absl::Status WriteError(const std::string& path, int error_number) {
  return absl::FailedPreconditionError(
      absl::StrCat("the file that opens it can't be written: ", path, ": ",
                   std::system_category().message(error_number), " (TMPDIR)"));
}

std::string PageTo(const std::string& address) {
  const std::string escaped = absl::StrReplaceAll(
      address, {{"&", "&amp;"}, {"<", "&lt;"}, {">", "&gt;"}, {"\"", "&quot;"}, {"'", "&#39;"}});
  return absl::StrCat("<!doctype html>\n<meta charset=\"utf-8\">\n<title>Isoscope</title>\n",
                      "<meta http-equiv=\"refresh\" content=\"0; url=", escaped, "\">\n",
                      "<p><a href=\"", escaped, "\">Isoscope</a></p>\n");
}

}  // namespace

absl::StatusOr<std::unique_ptr<RedirectFile>> RedirectFile::Create(const std::string& address) {
  std::error_code error;
  std::string folder = (std::filesystem::temp_directory_path(error) / "isoscope-XXXXXX").string();
  if (error) {
    return WriteError(folder, error.value());
  }
  if (mkdtemp(folder.data()) == nullptr) {  // of mode 0700
    return WriteError(folder, errno);
  }
  std::unique_ptr<RedirectFile> file(new RedirectFile(folder + "/isoscope.html"));
  const int fd =
      open(file->path().c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (fd < 0) {
    return WriteError(file->path(), errno);
  }
  const std::string page = PageTo(address);
  const ssize_t written = write(fd, page.data(), page.size());
  const int write_error = written < 0 ? errno : ENOSPC;
  if (close(fd) != 0 || written != static_cast<ssize_t>(page.size())) {
    return WriteError(file->path(), write_error);
  }
  return file;
}

RedirectFile::~RedirectFile() { gateway::RemoveTemporaryFile(path_); }

}  // namespace isoscope::cli
