// The default plot of a NeXus file and its axes: groups of the class NXdata. This code calls the
// HDF5 library, so it is for the process in which the library runs (walled_source.h).

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_NEXUS_DATA_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_NEXUS_DATA_H_

#include <cstddef>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "hdf5.h"

namespace isoscope::source {

// The dataset that a file plots by default: "/entry/data/counts". The attribute `default` leads
// from the root to an entry, and on to a plot; where it is missing, the only group of that class is
// taken. "" if the file does not say it.
std::string FindNexusDefault(hid_t file);

// The name of the dataset that a group plots: by its attribute `signal`, or by that of the dataset,
// as older files have it. "" if the group is no NXdata, or names none.
std::string FindNexusSignal(hid_t group);

// The names of the datasets in the group with the coordinates along each axis of the dataset
// `name`, slowest first; "" for an axis without. Empty if the group says nothing of it.
// INVALID_ARGUMENT: coordinates that depend on several axes (names them). The message is to follow
// a name and a colon.
absl::StatusOr<std::vector<std::string>> FindNexusAxes(hid_t group, const std::string& name,
                                                       std::size_t rank);

// Turns the stored values of the field `name` of a group to real ones: (value + offset) * factor,
// by the fields `name`_scaling_factor and `name`_offset.
struct NexusScale {
  double factor = 1;
  double offset = 0;

  [[nodiscard]] double Apply(double value) const { return (value + offset) * factor; }
  friend bool operator==(const NexusScale&, const NexusScale&) = default;
};
// INVALID_ARGUMENT: such a field that is not one finite number, or a factor of 0. The message is to
// follow a name and a colon.
absl::StatusOr<NexusScale> FindNexusScale(hid_t group, const std::string& name);
// The same of the field that the group plots, for which older files have scaling_factor and offset.
absl::StatusOr<NexusScale> FindNexusSignalScale(hid_t group, const std::string& name);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_NEXUS_DATA_H_
