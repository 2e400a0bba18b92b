// The surfaces of labels of `view`, as text: for the address of the page and for `isoscope render`.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_VIEW_LABELS_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_VIEW_LABELS_H_

#include <string>
#include <vector>

#include "clients/cpp/request/label_flags.h"

namespace isoscope::cli {

// "3,7-9", as the page and --label take it. Ranges keep the text of many labels short. `values` are
// ascending.
std::string TextOfValues(const std::vector<double>& values);

// The flags of `render` that draw these surfaces, one each, with the same bits: "--label 3 --label
// 7-9:1,0,0:0.5 --smooth-labels". A colour that the dataset gives is left out.
std::string FlagsOfLabels(const std::vector<client::LabelSurface>& labels);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_VIEW_LABELS_H_
