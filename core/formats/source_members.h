// What a source is made of, as names and values that are the same on every machine: for parts of one
// dataset, which are cut on several.

#ifndef ISOSCOPE_CORE_FORMATS_SOURCE_MEMBERS_H_
#define ISOSCOPE_CORE_FORMATS_SOURCE_MEMBERS_H_

#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/open_request.h"

namespace isoscope::source {

// All that Describe (open_request.h) tells, but for the folders that files lie in, and the size and
// the time of the last change of each file. So a source may lie in another folder on each machine,
// if it was copied with its times (cp -p, rsync -t). Errors as FilesOf and Describe.
absl::StatusOr<std::vector<std::pair<std::string, std::string>>> SourceMembers(
    const OpenRequest& request);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_SOURCE_MEMBERS_H_
