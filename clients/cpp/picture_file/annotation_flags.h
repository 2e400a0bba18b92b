// The flags of annotations: --axes, --scale-bar, --legend and --caption.

#ifndef ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_ANNOTATION_FLAGS_H_
#define ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_ANNOTATION_FLAGS_H_

#include "clients/cpp/picture_file/annotations.h"
#include "core/cli/flag_set.h"

namespace isoscope::client {

// `flags` must outlive the parsing.
void AddAnnotationFlags(cli::FlagSet* set, Annotations* flags);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_ANNOTATION_FLAGS_H_
