// Whether the names of files say that they are the slices of one stack.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_STACK_NAMES_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_STACK_NAMES_H_

#include <cstddef>
#include <string>
#include <vector>

#include "absl/status/status.h"

namespace isoscope::source {

// Names of one stack are equal but for a number, which goes up in even steps: a01.png, a02.png, ...
// Further numbers may go up with it, as times do. `files`: two or more, in natural order
// (named_files.h); `path` is the folder or pattern that gave them.
//
// INVALID_ARGUMENT: a number is missing, there twice or not even; names of several stacks; names
// without a number. Says which, and how to take them: by a pattern, or as neighbours with --axes Z.
absl::Status CheckStackNames(const std::string& path, const std::vector<std::string>& files);

// The names of up to 5 files that are missing between these, of which there were at least
// `least_count`: "run_1.vti" between run_0.vti and run_2.vti, with leading zeros as those have them.
// Empty if the names do not tell, as where the first or the last one is missing. `files`: in natural
// order.
std::vector<std::string> NamesMissingBetween(const std::vector<std::string>& files,
                                             std::size_t least_count);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_STACK_NAMES_H_
