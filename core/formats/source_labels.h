// The names and colours of labels that a source file has itself.

#ifndef ISOSCOPE_CORE_FORMATS_SOURCE_LABELS_H_
#define ISOSCOPE_CORE_FORMATS_SOURCE_LABELS_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"

#include "core/formats/format_table.h"
#include "core/volume/label.h"

namespace isoscope::source {

// Reads the labels of the file that a path names, by its content:
//
//   NRRD    segments of 3D Slicer (Segment0_LabelValue, _Name, _Color), of all layers
//   AFNI    VALUE_LABEL_DTABLE of the header; without colours
//   NIfTI   extension 4 with an AFNI attribute of that name; extension 30, or any other of XML,
//           with a LabelTable: the first one
//   Zarr    image-label of a label image of OME-Zarr
//   DICOM   the segments of a segmentation (SEG), of a file or a folder (dicom_labels.h)
//
// A value that has several names is left out: in the layers of a segmentation it stands for
// several segments. Names are cleaned (volume::CleanLabelName). Empty if the file has no labels, if
// it is of another format, or if it can't be opened: whoever reads its samples says why.
// INVALID_ARGUMENT: a table that is damaged or too long; the samples may be read all the same.
absl::StatusOr<std::vector<volume::Label>> ReadSourceLabels(
    const std::string& path, absl::Span<const Format> formats = Formats());
// The file that ReadSourceLabels would read; not set if there is none, or if the path names a DICOM
// series, which is a matter of all of its files.
std::optional<std::string> FileOfSourceLabels(const std::string& path,
                                              absl::Span<const Format> formats = Formats());

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_SOURCE_LABELS_H_
