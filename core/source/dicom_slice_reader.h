// Reads the slices of a DICOM series: first their headers, then the pixels of one at a time.

#ifndef ISOSCOPE_CORE_SOURCE_DICOM_SLICE_READER_H_
#define ISOSCOPE_CORE_SOURCE_DICOM_SLICE_READER_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/source/dicom_decoder.h"
#include "core/source/dicom_module.h"
#include "core/source/dicom_scan.h"
#include "core/source/dicom_steps.h"
#include "core/source/slice_source.h"

namespace isoscope::source {

// The slices of a file that was scanned, without their pixels: one, or one for each frame, in the
// order of the file. INVALID_ARGUMENT: a header that can't be decoded; colour; a whole-slide image;
// pixels that are floats; frames without a position, orientation or spacing. RESOURCE_EXHAUSTED:
// the system gives no process.
absl::StatusOr<std::vector<DicomSlice>> ReadDicomSlices(const std::string& path,
                                                        const DicomScan& scan,
                                                        DicomDecoder* decoder);

// Thread-compatible.
class DicomSliceReader final : public SliceReader {
 public:
  // `slices` are alike, and there is one.
  explicit DicomSliceReader(std::vector<DicomSlice> slices);

  // Starts the process that decodes (dicom_decoder.h). RESOURCE_EXHAUSTED: there can be none.
  absl::Status Start() { return decoder_.Start(); }

  // Decodes the pixels of slices[z] as [y][x], rescaled. INVALID_ARGUMENT: the file is cut.
  // DATA_LOSS: pixels that can't be decoded, or the file is another than before.
  absl::Status ReadSlice(std::int64_t z, char* out) override;
  [[nodiscard]] std::int64_t memory_bytes() const override { return kDicomModuleBytes; }

 private:
  absl::Status ReadFrame(const DicomSlice& slice, const DicomScan& scan, char* out);

  const std::vector<DicomSlice> slices_;
  DicomDecoder decoder_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_DICOM_SLICE_READER_H_
