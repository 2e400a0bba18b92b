// Series in NRRD and MetaImage files, whose samples are streamed by ourselves.

#ifndef ISOSCOPE_CORE_FORMATS_MEDICAL_SAMPLE_SERIES_H_
#define ISOSCOPE_CORE_FORMATS_MEDICAL_SAMPLE_SERIES_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/formats/medical/sample_format.h"
#include "core/source/bytes/file_layout.h"
#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// Opens the file as one field of that name.
//
//   NRRD       a fourth axis that is not of space, the first or the last: time if that is its kind,
//              else components (nrrd_layout.h); 64-bit integers (wide_source.h)
//   MetaImage  the channels are components, a fourth axis is steps without a time
//
// A volume of a compressed file is read by decoding all that lies before it.
// `header_path` is the file of the header, `path` is for messages. Errors as LocateSamples,
// ReadNrrdLayout, ReadMetaImageGrid and MakeLayoutSeries. INVALID_ARGUMENT also: no volume of three
// axes; a type that no volume has.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenSampleSeries(FileFormat format,
                                                               const std::string& header_path,
                                                               const std::string& path,
                                                               const std::string& field,
                                                               const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MEDICAL_SAMPLE_SERIES_H_
