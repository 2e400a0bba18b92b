// Files of answers that do not fit into memory: meshes and films.

#ifndef ISOSCOPE_WEB_GATEWAY_API_ANSWER_FILE_H_
#define ISOSCOPE_WEB_GATEWAY_API_ANSWER_FILE_H_

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::gateway {

// Makes a folder in that for temporary files (TMPDIR), which only this user may read, and returns
// the path of a file in it. RemoveTemporaryFile removes both. FAILED_PRECONDITION if no folder can be
// made there.
absl::StatusOr<std::string> MakeAnswerPath(absl::string_view file_name);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_ANSWER_FILE_H_
