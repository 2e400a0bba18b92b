// Reads the slices of a DICOM series: first their headers, then the pixels of one at a time.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_SLICE_READER_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_SLICE_READER_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/formats/dicom/dicom_decoder.h"
#include "core/formats/dicom/dicom_module.h"
#include "core/formats/dicom/dicom_scan.h"
#include "core/formats/dicom/dicom_steps.h"
#include "core/source/adapt/slice_source.h"

namespace isoscope::source {

// The slices of a file that was scanned, without their pixels: one, or one for each frame, in the
// order of the file. `has_spacing`: as GridRules. Their `type` is not set (SetDicomSampleTypes).
// INVALID_ARGUMENT: a header that can't be decoded; colour; a whole-slide image or a mosaic; pixels
// that are floats; samples that a table changes, or whose slope is 0 or no number; a group of
// slope and intercept in some frames only; all that
// PlanesOfDicomFrames refuses. RESOURCE_EXHAUSTED: the system gives no process.
absl::StatusOr<std::vector<DicomSlice>> ReadDicomSlices(const std::string& path,
                                                        const DicomScan& scan,
                                                        DicomDecoder* decoder,
                                                        bool has_spacing = false);

// Gives all slices of a series the type that holds the samples of each (dicom_values.h).
void SetDicomSampleTypes(std::vector<DicomSlice>* slices);

// Thread-compatible.
class DicomSliceReader final : public SliceReader {
 public:
  // `slices` have one type, and there is one.
  explicit DicomSliceReader(std::vector<DicomSlice> slices);

  // Starts the process that decodes (dicom_decoder.h), if a slice needs it. RESOURCE_EXHAUSTED:
  // there can be none.
  absl::Status Start();

  // Decodes the pixels of slices[z] as [y][x], rescaled. INVALID_ARGUMENT: the file is cut.
  // DATA_LOSS: pixels that can't be decoded, or the file is another than before.
  absl::Status ReadSlice(std::int64_t z, char* out) override;
  [[nodiscard]] std::int64_t memory_bytes() const override { return kDicomModuleBytes; }

 private:
  const std::vector<DicomSlice> slices_;
  DicomDecoder decoder_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_SLICE_READER_H_
