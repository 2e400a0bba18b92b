// Opens and reads hostile volume files as the partitioner does.

#ifndef ISOSCOPE_TESTS_FUZZ_CORE_FORMATS_OPEN_VOLUME_H_
#define ISOSCOPE_TESTS_FUZZ_CORE_FORMATS_OPEN_VOLUME_H_

#include <string>

#include "absl/strings/string_view.h"

namespace isoscope::fuzz {

// A folder of this process for the files of one input.
const std::string& VolumeFolder();
// The path of a file in it.
std::string InVolumeFolder(absl::string_view name);
// Writes a file there, in place of the one before.
void WriteVolumeFile(absl::string_view name, absl::string_view bytes);
// Reads a file of it, for seeds that libraries write.
std::string ReadVolumeFile(absl::string_view name);

// Opens the volume at `path`, which lies in the folder, and reads it if it is small. Requires:
// errors are those that are documented; an open volume has a valid grid; reading it in one piece,
// in several, or again gives the same.
void OpenAndReadVolume(const std::string& path);

// The same, and then, of the series at `path`, some components of the first fields at the first and
// the last step.
void OpenAndReadSeries(const std::string& path);

}  // namespace isoscope::fuzz

#endif  // ISOSCOPE_TESTS_FUZZ_CORE_FORMATS_OPEN_VOLUME_H_
