// The surfaces of labels of `view`: those that show, and as text for the address of the page and for
// `isoscope render`.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_VIEW_LABELS_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_VIEW_LABELS_H_

#include <string>
#include <vector>

#include "client-cli/terminal/label_choice.h"
#include "clients/cpp/request/label_flags.h"

namespace isoscope::cli {

// "3,7-9", as the page and --label take it. Ranges keep the text of many labels short. `values` are
// ascending.
std::string TextOfValues(const std::vector<double>& values);

// The flags of `render` that draw these surfaces, one each, with the same bits: "--label 3 --label
// 7-9:1,0,0:0.5 --smooth-labels". A colour that the dataset gives is left out.
std::string FlagsOfLabels(const std::vector<client::LabelSurface>& labels);

// The labels that a choice shows, in their order. Around a highlighted one the others are faint, as on
// the page. REQUIRES: the choice is of as many labels.
std::vector<client::LabelSurface> ShownLabels(const std::vector<client::LabelSurface>& labels,
                                              const LabelChoice& choice);

// "left lung (2 of 13)", "left lung (2 of 13) highlighted", "12 of 13 labels"; for the last line.
// REQUIRES: one label at least.
std::string DescribeLabels(const std::vector<client::LabelSurface>& labels,
                           const LabelChoice& choice);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_VIEW_LABELS_H_
