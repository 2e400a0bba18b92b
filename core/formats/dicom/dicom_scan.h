// Finds out, without GDCM, whether a DICOM file is an image, and whether it is complete.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_SCAN_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_SCAN_H_

#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/io/file.h"

namespace isoscope::source {

enum class DicomContent {
  kImage,    // whole up to the end of its pixels
  kNoImage,  // an index (DICOMDIR), a report, a plan: it has no pixels
  kCut       // an image that ends before its pixels do, or bytes that are no DICOM file
};

// These can tell images at one place apart. Not set: the file does not say.
struct DicomMoment {
  std::optional<double> temporal_position{};
  std::optional<double> echo_time{};     // ms
  std::optional<double> trigger_time{};  // ms
  // The place of a frame in the order of the dimensions of its file, without those of space.
  std::optional<double> dimension_rank{};
  std::optional<double> acquisition_number{};
  std::optional<double> acquisition_time{};  // seconds of the day
  std::optional<double> content_time{};      // seconds of the day
  std::optional<double> instance_number{};
  std::optional<double> temporal_resolution{};  // ms; tells none apart
};

struct DicomScan {
  // It has the mark "DICM", or begins with elements of DICOM without one; else the file is kCut.
  bool is_dicom = false;
  DicomContent content = DicomContent::kCut;
  // UIDs of the series and of the pixels' encoding; "" if the file ends before, or has none.
  std::string series;
  std::string transfer_syntax;
  std::string storage_class;  // the UID of the kind of object; "" if the file ends before
  bool is_mosaic = false;     // slices of a volume side by side in one image
  // They describe the series to people who choose one; 0 and "" if the file does not say.
  std::int64_t series_number = 0;
  std::string description;
  // The UID of the frame of reference (0020,0052), and what the values are: the units of PET
  // (0054,1001), else the type of rescaled values (0028,1054); "" if the file does not say.
  std::string frame_of_reference;
  std::string value_unit;
  std::int64_t width = 0;  // samples
  std::int64_t height = 0;
  std::int64_t frames = 1;
  std::int64_t bits_allocated = 0;  // a pixel
  DicomMoment moment;
  // Whether an image has as many pixels as its rows and columns say; else they were not counted.
  bool is_counted = false;
  // Where the pixels lie in the file, in bytes; -1 if they are compressed, or were not found.
  std::int64_t pixels_offset = -1;
  // Returns true if its pixels are High-Throughput JPEG 2000 (1.2.840.10008.1.2.4.201 to 203).
  [[nodiscard]] bool is_high_throughput() const;
  bool has_float_pixels = false;  // those of a parametric map (7fe0,0008 or 0009); not counted
};

// Returns true if the file has the mark "DICM" behind 128 bytes, or begins with elements of DICOM.
// These are of the group 0002, or of a data set, up to a class of DICOM's own. A few bytes of most
// other files are read.
bool HasDicomStart(const io::RandomAccessFile& file);

// Scans the file element by element, without its pixels. Keeps no field of the patient but the
// description of the series and the unit of values, without control characters. Errors: those of
// reading.
absl::StatusOr<DicomScan> ScanDicomFile(const std::string& path);

// The error of a file that is kCut where a slice is needed: INVALID_ARGUMENT.
absl::Status DicomCutError(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_SCAN_H_
