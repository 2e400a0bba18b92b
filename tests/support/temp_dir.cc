#include "tests/support/temp_dir.h"

#include <cstdlib>
#include <filesystem>
#include <system_error>

#include "core/base/check.h"

namespace isoscope::testing {

TempDir::TempDir() {
  std::string pattern = (std::filesystem::temp_directory_path() / "isoscope-test-XXXXXX").string();
  ISOSCOPE_CHECK(mkdtemp(pattern.data()) != nullptr);
  path_ = pattern;
}

TempDir::~TempDir() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace isoscope::testing
