// The samples of DICOM slices: slope * stored + intercept, whatever the photometric interpretation.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_VALUES_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_VALUES_H_

#include <cstddef>
#include <vector>

#include "absl/status/status.h"

#include "core/formats/dicom/dicom_decoder.h"
#include "core/source/adapt/rescale.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// How the samples of a slice come from its pixels.
struct DicomValues {
  DicomPixels pixels{};
  bool is_frame = false;  // of a file of many
  Rescaling rescaling{};
};

// OK if the pixels are whole numbers that we have, one a sample. INVALID_ARGUMENT, without the path
// of the file: colours; 1, 12 or 64 bits; bits that are not within those that are allocated.
absl::Status CheckDicomPixels(const DicomPixels& pixels, DicomPhotometric photometric);

// The type that holds the samples of all slices. REQUIRES: pixels that CheckDicomPixels takes.
//
//   no rescaling, or only 1 and 0, and pixels of one type    that type
//   whole slopes and intercepts, in files of one image       the smallest integers that hold
//                                                            every value of their bits
//   otherwise, frames of up to 16 bits                       float32
//   otherwise                                                float64
//
// Integers have no fewer bits than the pixels. They are unsigned if no value can be negative.
volume::ScalarType DicomSampleType(const std::vector<DicomValues>& slices);

// The pixels of a stored type as that type: shifted down to bit 0, without the bits that have no
// meaning, with their sign. `count` of them, little-endian.
void CleanDicomPixels(const DicomPixels& pixels, std::size_t count, char* stored);

// Writes clean pixels as samples of `type`, little-endian. `stored` may be the tail of `out`.
// REQUIRES: DicomSampleType chose the type.
void WriteDicomSamples(const DicomValues& values, volume::ScalarType type, std::size_t count,
                       const char* stored, char* out);

// The type of clean pixels, of bits_allocated bits. REQUIRES: CheckDicomPixels takes them.
volume::ScalarType DicomStoredType(const DicomPixels& pixels);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_VALUES_H_
