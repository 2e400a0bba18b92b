// A folder of its own for a test, removed with everything in it at the end.

#ifndef ISOSCOPE_TESTS_SUPPORT_TEMP_DIR_H_
#define ISOSCOPE_TESTS_SUPPORT_TEMP_DIR_H_

#include <string>

namespace isoscope::testing {

class TempDir {
 public:
  TempDir();
  ~TempDir();
  TempDir(const TempDir&) = delete;
  TempDir& operator=(const TempDir&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }
  // `path()/name`.
  [[nodiscard]] std::string Sub(const std::string& name) const { return path_ + "/" + name; }
  // Writes a file, and the folders above it. Returns its path.
  std::string Write(const std::string& name, const std::string& bytes) const;

 private:
  std::string path_;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_TEMP_DIR_H_
