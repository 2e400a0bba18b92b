// The flags of annotations: --axes, --scale-bar, --legend and --caption.

#ifndef ISOSCOPE_CLIENT_CLI_ANNOTATION_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_ANNOTATION_FLAGS_H_

#include "client-cli/annotations.h"

namespace isoscope::cli {

// `flags` must outlive the parsing.
void AddAnnotationFlags(FlagSet* set, Annotations* flags);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_ANNOTATION_FLAGS_H_
