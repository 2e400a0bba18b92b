// Keeps ITK from writing to standard output and error.

#ifndef ISOSCOPE_CORE_SOURCE_CHILD_SILENT_LIBRARIES_H_
#define ISOSCOPE_CORE_SOURCE_CHILD_SILENT_LIBRARIES_H_

namespace isoscope::source {

// Turns its messages off, for good and for the whole process: they may quote fields of a patient's
// examination. Statuses and log lines of this program tell users what matters. Cheap when called
// again. Thread-safe.
void SilenceImageLibraries();

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHILD_SILENT_LIBRARIES_H_
