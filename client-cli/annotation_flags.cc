#include "client-cli/annotation_flags.h"

#include <string>

#include <CLI/CLI.hpp>

#include "client-cli/flags.h"

namespace isoscope::cli {

void AddAnnotationFlags(CLI::App* app, Annotations* flags) {
  const std::string group = "Annotations (drawn over the picture)";
  app->add_flag("--axes", flags->has_axes,
                "orientation axes in the bottom left corner: X, Y, Z, or the sides of the patient "
                "(L R A P S I) where it is known")
      ->group(group);
  app->add_flag("--scale-bar", flags->has_scale_bar,
                "a bar of a round number of world units in the bottom right corner; of a "
                "perspective camera it holds at the target's distance")
      ->group(group);
  app->add_flag("--legend", flags->has_legend,
                "the colour map of --color-by with its range, at the right side")
      ->group(group);
  AddFlag(app, "--caption", "TEXT", &flags->caption, ParseText,
          "text in the top left corner; {isovalue} becomes the frame's, \\n begins a line")
      ->group(group);
}

}  // namespace isoscope::cli
