// Reads DICOM files by ITK and GDCM, in a process of its own.

#ifndef ISOSCOPE_CORE_SOURCE_DICOM_DECODER_H_
#define ISOSCOPE_CORE_SOURCE_DICOM_DECODER_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/math/matrix.h"
#include "core/math/vec.h"
#include "core/source/decoder_process.h"
#include "core/source/dicom_child.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// All numbers are finite, and nothing else about them is checked.
struct DicomHeader {
  std::int64_t width = 0;  // samples
  std::int64_t height = 0;
  std::int64_t frames = 0;
  std::int64_t components = 0;              // of a sample
  absl::StatusOr<volume::ScalarType> type;  // INVALID_ARGUMENT: one that we do not have
  math::Vec3d origin;                       // LPS
  math::Vec3d spacing;
  math::Mat3d direction;
  std::string series;       // its UID, at most 64 bytes; "" if the file does not say
  bool has_pixels = false;  // whether ReadSlice decoded them
};

// A frame of a file of many. Numbers are finite where they are set, and nothing else is checked.
struct DicomFrame {
  std::optional<math::Vec3d> position;  // of the first pixel, LPS
  std::optional<math::Vec3d> along_row;
  std::optional<math::Vec3d> along_column;
  std::optional<math::Vec3d> spacing;  // x, y; z is the distance of frames, or 0
  double slope = 1;
  double intercept = 0;
  std::optional<double> temporal_position;
  std::optional<double> echo_time;     // ms
  std::optional<double> trigger_time;  // ms
  std::int64_t segment = 0;            // its number; 0: the file does not say
};

struct DicomFrames {
  std::int64_t width = 0;
  std::int64_t height = 0;
  std::int64_t components = 0;
  std::optional<volume::ScalarType> stored_type{};  // not set: one that we do not have
  std::string series{};
  std::vector<DicomFrame> frames{};  // in the order of the file
  // Of ReadSegmentFrames:
  DicomSegmentKind segment_kind = DicomSegmentKind::kUnknown;
  std::int64_t bits_allocated = 0;
  std::optional<double> padding{};  // the value of pixels of no segment
};

// Labels and colours are as the file has them.
struct DicomSegment {
  std::int64_t number = 0;              // 0 to 65535
  std::string label{};                  // any bytes, at most 256
  std::optional<math::Vec3d> cielab{};  // finite
};
struct DicomSegments {
  DicomSegmentKind kind = DicomSegmentKind::kUnknown;
  std::vector<DicomSegment> segments{};
};

// Debian's GDCM ends the process it runs in by assertions on many damaged files. Here that process
// is a child, which the next file replaces. No status quotes a word of the libraries: they quote
// fields of the patient. Thread-compatible.
class DicomDecoder {
 public:
  // `slice_bytes`: those of the pixels that ReadSlice and ReadFrame read; 0 for headers alone.
  // Loads the libraries (dicom_module.h); if that fails, all calls return its error.
  explicit DicomDecoder(std::int64_t slice_bytes = 0);

  // Starts the process early (decoder_process.h). RESOURCE_EXHAUSTED: there can be none.
  // FAILED_PRECONDITION: the libraries are not there.
  absl::Status Start();

  // DATA_LOSS: the file can't be decoded. The message, without the path, says how the process
  // ended; it is "" if the libraries refused the file. DEADLINE_EXCEEDED, CANCELLED: as
  // DecoderProcess::Ask; nothing is known of the file. RESOURCE_EXHAUSTED: as Start.
  absl::StatusOr<DicomHeader> ReadHeader(const std::string& path);

  // Also decodes the pixels into `out`, as [y][x], if they have `slice_bytes`; else `out` stays as
  // it is. `is_counted`: DicomScan has counted them; else a file with too few that are not
  // compressed can't be decoded. Errors: as ReadHeader.
  absl::StatusOr<DicomHeader> ReadSlice(const std::string& path, bool is_counted, char* out);

  // The frames of a file, at most 65 536, without their pixels. Errors: as ReadHeader.
  absl::StatusOr<DicomFrames> ReadFrames(const std::string& path);
  // The same of a segmentation, without a stored type. The segments are at most 65 536.
  absl::StatusOr<DicomFrames> ReadSegmentFrames(const std::string& path);
  absl::StatusOr<DicomSegments> ReadSegments(const std::string& path);
  // Decodes the pixels of a frame as they are stored, before slope and intercept, into `out`:
  // `slice_bytes`. Reads no other frame, as far as the encoding allows it. Errors: as ReadHeader.
  absl::Status ReadFrame(const std::string& path, std::int64_t frame, char* out);

 private:
  // Asks about a file; `request` has all but its path. `bytes`: what the answer may need.
  absl::StatusOr<DicomAnswer> Ask(const std::string& path, DicomRequest request,
                                  std::int64_t bytes);
  absl::StatusOr<DicomHeader> Read(const std::string& path, bool is_counted, char* out);
  absl::StatusOr<DicomFrames> ReadFrames(const std::string& path, DicomQuestion question);

  const std::int64_t slice_bytes_;
  const absl::StatusOr<DecoderProcess::Handler> handler_;
  DecoderProcess process_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_DICOM_DECODER_H_
