// Keeps ITK and GDCM from writing to standard output and error.

#ifndef ISOSCOPE_CORE_SOURCE_SILENT_LIBRARIES_H_
#define ISOSCOPE_CORE_SOURCE_SILENT_LIBRARIES_H_

namespace isoscope::source {

// Turns their messages off, for good and for the whole process: they quote fields of the patient's
// examination, thousands of lines a series. Statuses and log lines of this program tell users what
// matters. Cheap when called again. Thread-safe.
void SilenceImageLibraries();

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_SILENT_LIBRARIES_H_
