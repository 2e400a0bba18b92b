// Surfaces that do not show: the picture is right, and the user is told the reason.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_NOTE_LINES_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_NOTE_LINES_H_

#include <string>
#include <vector>

#include "client-cli/output/frame_statistics.h"
#include "core/cli/command.h"

namespace isoscope::cli {

// Returns the notes of the frames as lines without their ends, each once, in the order in which
// they come first. A note that not all frames have names those: "frames 2, 5 to 7: isovalue 300 has
// no surface: ...". The last of at most 12 lines tells how many there are beyond.
std::vector<std::string> NoteLines(const std::vector<FrameRecord>& frames);

// Writes these lines to standard error.
void WriteNotes(const std::vector<FrameRecord>& frames, const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_NOTE_LINES_H_
