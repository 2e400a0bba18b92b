// The files of time steps that a list of ParaView (.vti.series), or a pattern of names, gives.

#ifndef ISOSCOPE_CORE_FORMATS_VTK_VTK_STEPS_H_
#define ISOSCOPE_CORE_FORMATS_VTK_VTK_STEPS_H_

#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/vtk/vtk_series.h"
#include "core/source/grid/grid_rules.h"

namespace isoscope::source {

// Returns true if a name is that of a list: run.vti.series. Lists of meshes have such names, too.
bool IsVtkStepList(const std::string& path);

// Reads a list, in its order: JSON with "files" of "name", and of "time" in all of them or in none;
// then they are numbered from 0. INVALID_ARGUMENT: no such list, or more than 64 MiB of it; no
// step, or more than 100 000; times that are not finite, or do not ascend (names both); a file that
// is neither .vti, .pvti nor .vtr.
absl::StatusOr<std::vector<PvdStep>> ReadVtkStepList(const std::string& path);

// Returns the steps of files in that order, as a pattern gives them. Times are those of TimeValue,
// if all have one; else they are numbered from 0. Reads the header of each file. `pattern` is for
// messages. INVALID_ARGUMENT: times that do not ascend, or that some files have and others have
// not. NOT_FOUND: no file.
absl::StatusOr<std::vector<PvdStep>> StepsOfVtkFiles(const std::string& pattern,
                                                     const std::vector<std::string>& files,
                                                     const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_VTK_VTK_STEPS_H_
