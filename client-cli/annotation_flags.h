// The flags of annotations: --axes, --scale-bar, --legend and --caption.

#ifndef ISOSCOPE_CLIENT_CLI_ANNOTATION_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_ANNOTATION_FLAGS_H_

#include "client-cli/annotations.h"

namespace CLI {  // NOLINT(readability-identifier-naming): theirs
class App;
}  // namespace CLI

namespace isoscope::cli {

// `flags` must outlive the parsing.
void AddAnnotationFlags(CLI::App* app, Annotations* flags);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_ANNOTATION_FLAGS_H_
