// The files that a folder or a pattern names.

#ifndef ISOSCOPE_CORE_SOURCE_NAMED_FILES_H_
#define ISOSCOPE_CORE_SOURCE_NAMED_FILES_H_

#include <string>
#include <vector>

namespace isoscope::source {

// The files in a folder, or those of a pattern with '*', '?' or '[' in it, or the file itself. Only
// those whose paths `is_wanted`, without folders: "slice9" before "slice10" (natural_order.h).
std::vector<std::string> FilesNamed(const std::string& path,
                                    bool (*is_wanted)(const std::string& path));

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_NAMED_FILES_H_
