// Files that name labels: what --label-names reads, and what lies beside a volume.

#ifndef ISOSCOPE_CORE_FORMATS_LABEL_NAMES_H_
#define ISOSCOPE_CORE_FORMATS_LABEL_NAMES_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/volume/label.h"

namespace isoscope::source {

// Reads lines of these forms, which a file may mix; empty lines and those that begin with # are
// passed over:
//
//   17 Left-Hippocampus 220 216 20 0           colour table: value, name, red, green, blue, alpha
//   17 220 216 20 1 1 1 "left hippocampus"     label description: value, red, green, blue, opacity,
//                                              two switches, name
//   17,left hippocampus,#dcd814                CSV: value, name, and a colour or none; a name with
//                                              commas stands in quotation marks. A first line of
//                                              words (value,name,color) is passed over
//   17 Hippocampus_L 4101                      list of MRIcron: value, name, and a number or none
//
// Alpha, opacity, switches and the number of a list are not used. Returns the labels by value.
// `where` is for messages. INVALID_ARGUMENT: a line of another form, a value twice, or labels that
// volume::ValidateLabels refuses; names the line. Takes any bytes.
absl::StatusOr<std::vector<volume::Label>> ParseLabelNames(absl::string_view text,
                                                           absl::string_view where);

// The labels of a file of at most 16 MiB. Otherwise errors of reading and of ParseLabelNames.
absl::StatusOr<std::vector<volume::Label>> ReadLabelNames(const std::string& path);

// The file that names the labels of a volume beside it, as MRIcron has it: aal.nii.txt for aal.nii
// and aal.nii.gz. Not set for other volumes, and if there is none.
std::optional<std::string> LabelNamesBeside(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_LABEL_NAMES_H_
