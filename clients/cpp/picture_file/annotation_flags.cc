#include "clients/cpp/picture_file/annotation_flags.h"

#include <string>

#include "core/cli/flag_set.h"
#include "core/cli/flags.h"

namespace isoscope::client {

void AddAnnotationFlags(cli::FlagSet* set, Annotations* flags) {
  const std::string group = "Annotations (drawn over the picture)";
  set->AddSwitch("--axes", &flags->has_axes,
                 "orientation axes in the bottom left corner: X, Y, Z, or the sides of the patient "
                 "(L R A P S I) where it is known")
      .Group(group);
  set->AddSwitch("--scale-bar", &flags->has_scale_bar,
                 "a bar of a round number of world units in the bottom right corner; of a "
                 "perspective camera it holds at the target's distance")
      .Group(group);
  set->AddSwitch("--legend", &flags->has_legend,
                 "the colour maps of --color-by and --caps MAP with their ranges, at the right "
                 "side; with a swatch where the picture shows missing values (NaN)")
      .Group(group);
  cli::AddFlag(
      set, "--caption", "TEXT", &flags->caption, cli::ParseText,
      "text in the top left corner; {isovalue} and {time} become the frame's (of a sweep of steps "
      "{time} is the default), \\n begins a line")
      .Group(group);
}

}  // namespace isoscope::client
