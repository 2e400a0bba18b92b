// Series of VTK images: all arrays of a .vti, .pvti or .vtr file, or a collection (.pvd) of such
// files.

#ifndef ISOSCOPE_CORE_FORMATS_VTK_VTK_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_VTK_VTK_SERIES_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// One image, with all its arrays, or that alone which `part` names: an array ("velocity") or a
// component of one ("velocity:2"). It has one step: with the time of its TimeValue, unless a part
// is named. Errors as OpenVtkImage.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenVtkImageSeries(const std::string& file,
                                                                 const std::string& part,
                                                                 const GridRules& rules = {});

// The same of a RectilinearGrid file (.vtr). Errors as OpenVtrImage.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenVtrSeries(const std::string& file,
                                                            const GridRules& rules = {});

// A step of a collection.
struct PvdStep {
  double time = 0;
  std::string file;  // as it is opened: beside the .pvd, unless its name is absolute
};
// The steps of a ParaView collection, in its order. INVALID_ARGUMENT: no such collection; no step,
// or more than 100 000; a time that is no finite number; times that do not ascend (names both); a
// file that is neither .vti, .pvti nor .vtr.
absl::StatusOr<std::vector<PvdStep>> ReadPvdSteps(const std::string& path);
// The files of a step: that of a .pvti with its pieces. Errors as FilesOfPvti.
absl::StatusOr<std::vector<std::string>> FilesOfPvdStep(const PvdStep& step);

// Opens a collection, of .vtr files those whose axes are even. Its fields are those of the first
// step; each step is looked at as it is opened: INVALID_ARGUMENT if it has not the grid or not an
// array of that type and as many components, with the file, the step and what differs.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenPvdSeries(const std::string& path,
                                                            const GridRules& rules = {});
// The same of steps that something else gives (vtk_steps.h). `name` is for messages.
// REQUIRES: at least one step.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenVtkSteps(const std::string& name,
                                                           std::vector<PvdStep> steps,
                                                           const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_VTK_VTK_SERIES_H_
