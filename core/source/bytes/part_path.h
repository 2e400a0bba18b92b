// "file.h5:/dataset", "file.vti:array": a path that names a part of a file.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_PART_PATH_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_PART_PATH_H_

#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace isoscope::source {

struct PartPath {
  std::string file;
  std::string part;  // "" if none is named
};

// True if the path ends so, in any case: with ".vti". An ending without a dot is the whole name of
// a file, "2dseq".
bool HasEnding(const std::string& path, absl::string_view ending);

// Returns true, and sets both, if `path` is a file with one of these endings (".vti", in any case),
// alone or with ':' and a part behind it. The first such ':' separates them; a part may have more.
bool SplitPartPath(const std::string& path, const std::vector<std::string>& endings,
                   PartPath* parts);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_PART_PATH_H_
