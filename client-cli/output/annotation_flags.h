// The flags of annotations: --axes, --scale-bar, --legend and --caption.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_ANNOTATION_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_ANNOTATION_FLAGS_H_

#include "clients/cpp/picture_file/annotations.h"
#include "core/cli/flag_set.h"

namespace isoscope::cli {

// `flags` must outlive the parsing.
void AddAnnotationFlags(FlagSet* set, client::Annotations* flags);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_ANNOTATION_FLAGS_H_
