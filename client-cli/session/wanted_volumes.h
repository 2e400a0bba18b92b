// Which volumes of a source a command draws, so that the cache gets no others: one picture of a
// series of 500 steps needs one of them.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_WANTED_VOLUMES_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_WANTED_VOLUMES_H_

#include <functional>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"

#include "clients/cpp/request/look_flags.h"
#include "clients/cpp/request/selection_flags.h"
#include "core/source/volume_series.h"

namespace isoscope::cli {

// A field beside the one whose surfaces are drawn.
struct WantedField {
  std::string text;  // as --field has it: "NAME[:COMPONENT]"
  // Colours are to have the range of all steps, so that they do not jump while a series plays.
  bool needs_all_steps = false;
};

struct WantedVolumes {
  client::SelectionFlags selection{};
  // The numbers of the steps of a sweep, of a source with so many, in place of the selection's.
  // Null: there is none.
  std::function<absl::StatusOr<std::vector<int>>(int step_count)> steps{};
  bool needs_all_steps = false;  // of the field of the selection
  std::vector<WantedField> colors{};
  bool needs_all_fields = false;

  // Whether no flag chooses: the first field at the last step.
  [[nodiscard]] bool is_default() const {
    return selection.empty() && !steps && !needs_all_steps && colors.empty() && !needs_all_fields;
  }
};

// Adds what colours and caps show.
void AddColors(const client::LookFlags& look, const std::optional<frame::ClipCaps>& caps,
               WantedVolumes* wanted);

// The volumes of a source, by index of the field and number of the step.
struct ChosenVolumes {
  std::set<std::pair<int, int>> volumes;
  // The names of their fields, in the order of the source.
  std::vector<std::string> fields;
  // Canonical, for the key of the cache: "" for those of is_default().
  std::string text;
  // For people, without a line's end: which field and step are drawn of several. "": there is one.
  std::string note;
};

// INVALID_ARGUMENT: a field or component that the source does not have (lists them), a time for a
// source without times. NOT_FOUND: a step that it does not have.
absl::StatusOr<ChosenVolumes> ChooseVolumes(const WantedVolumes& wanted,
                                            const source::VolumeSeries& source);
// All of them.
ChosenVolumes ChooseAllVolumes(const source::VolumeSeries& source);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_WANTED_VOLUMES_H_
