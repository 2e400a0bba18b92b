// Tells which files of a folder were opened, by any process: what readers really look at.

#ifndef ISOSCOPE_TESTS_SUPPORT_OPENED_FILES_H_
#define ISOSCOPE_TESTS_SUPPORT_OPENED_FILES_H_

#include <unistd.h>

#include <cstddef>
#include <cstring>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include <sys/inotify.h>

namespace isoscope::testing {

// From its making on.
class OpenedFiles {
 public:
  // The folders below `folder` count, too, if they are there already.
  explicit OpenedFiles(const std::string& folder)
      : queue_(inotify_init1(IN_NONBLOCK | IN_CLOEXEC)) {
    Watch(folder);
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
      if (entry.is_directory()) {
        Watch(entry.path().string());
      }
    }
  }
  ~OpenedFiles() { close(queue_); }
  OpenedFiles(const OpenedFiles&) = delete;
  OpenedFiles& operator=(const OpenedFiles&) = delete;

  // Paths, without folders.
  std::set<std::string> Take() {
    std::set<std::string> paths;
    std::vector<char> buffer(1 << 16);
    for (ssize_t count = 0; (count = read(queue_, buffer.data(), buffer.size())) > 0;) {
      for (std::size_t at = 0; at < static_cast<std::size_t>(count);) {
        inotify_event event{};
        std::memcpy(&event, buffer.data() + at, sizeof(event));
        EXPECT_EQ(event.mask & IN_Q_OVERFLOW, 0U) << "too many events";
        if ((event.mask & IN_ISDIR) == 0 && event.len > 0) {
          paths.insert(folders_[event.wd] + "/" + (buffer.data() + at + sizeof(event)));
        }
        at += sizeof(event) + event.len;
      }
    }
    return paths;
  }

 private:
  void Watch(const std::string& folder) {
    const int watch = inotify_add_watch(queue_, folder.c_str(), IN_OPEN);
    ASSERT_GE(watch, 0) << folder;
    folders_[watch] = folder;
  }

  const int queue_;
  std::map<int, std::string> folders_;  // by watch
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_OPENED_FILES_H_
