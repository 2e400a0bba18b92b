// External links and virtual datasets of HDF5, without waiting. The library opens whatever file
// they name: a named pipe would be waited for for ever. Calls the library: for the process that it
// runs in (walled_source.h).

#ifndef ISOSCOPE_CORE_SOURCE_HDF5_HDF5_EXTERNAL_LINKS_H_
#define ISOSCOPE_CORE_SOURCE_HDF5_HDF5_EXTERNAL_LINKS_H_

#include <string>

#include "absl/status/status.h"

#include "hdf5.h"

namespace isoscope::source {

// From now on the library, whoever calls it (netCDF and MINC, too), follows external links to
// regular files only. It looks for them at the same places, and passes over what is no regular
// file.
void FollowLinksToRegularFiles();

// Tells why the external link `name` of a group leads nowhere.
// "c.h5: is a pipe (FIFO), expected ...": it names an object that is no regular file.
// "in FILE, which is missing": it names what is not there.
// "in FILE, to which a file at an address can't lead": the file of the group is mounted.
// "": it is no external link.
std::string WhyLinkIsBroken(hid_t group, const std::string& name);

// FAILED_PRECONDITION, with its name: a source of a virtual dataset is there, but is no regular
// file. Call it before asking for the extent of a dataset, for which the library may open sources.
absl::Status CheckHdf5Sources(hid_t dataset);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_HDF5_HDF5_EXTERNAL_LINKS_H_
