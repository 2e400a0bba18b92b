#include "core/formats/dicom/dicom_labels.h"

#include <optional>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

#include "core/formats/dicom/cielab_color.h"
#include "core/formats/dicom/dicom_child.h"
#include "core/formats/dicom/dicom_decoder.h"
#include "core/formats/dicom/dicom_folder.h"
#include "core/formats/dicom/dicom_scan.h"
#include "core/formats/dicom/dicom_storage.h"
#include "core/io/file.h"

namespace isoscope::source {

absl::StatusOr<std::vector<volume::Label>> ReadDicomLabels(const std::string& path) {
  std::vector<std::string> files{path};
  if (io::IsDirectory(path)) {
    files = DicomFilesOf(path).value_or(std::vector<std::string>());
  }
  for (const std::string& file : files) {
    const absl::StatusOr<DicomScan> scan = ScanDicomFile(file);
    if (!scan.ok() || scan->content == DicomContent::kNoImage) {
      continue;
    }
    if (!IsSegmentationStorage(scan->storage_class)) {
      break;
    }
    DicomDecoder decoder;
    const absl::StatusOr<DicomSegments> read = decoder.ReadSegments(file);
    if (!read.ok() && !absl::IsDataLoss(read.status())) {  // the file may have labels
      return absl::Status(read.status().code(), absl::StrCat(file, ": ", read.status().message()));
    }
    if (!read.ok() || read->kind == DicomSegmentKind::kFractional) {
      break;
    }
    std::vector<volume::Label> labels;
    for (const DicomSegment& segment : read->segments) {
      labels.push_back({.value = static_cast<double>(segment.number),
                        .name = volume::CleanLabelName(segment.label),
                        .color = segment.cielab.has_value()
                                     ? std::optional(ColorOfCieLab(*segment.cielab))
                                     : std::nullopt});
    }
    volume::SortLabels(&labels);
    const absl::Status valid = volume::ValidateLabels(labels);
    if (!valid.ok()) {
      return absl::InvalidArgumentError(absl::StrCat(file, ": ", valid.message()));
    }
    return labels;
  }
  return std::vector<volume::Label>();
}

}  // namespace isoscope::source
