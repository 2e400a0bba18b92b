// Reads DICOM files by GDCM, in a process of its own.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_DECODER_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_DECODER_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/formats/dicom/dicom_child.h"
#include "core/math/vec.h"
#include "core/source/child/decoder_process.h"

namespace isoscope::source {

// A frame, or the only image of a file. Numbers are finite where they are given, and nothing else
// is checked.
struct DicomFrame {
  DicomNumbers<3> position{};       // of the first pixel, LPS
  DicomNumbers<6> orientation{};    // of rows, then of columns
  DicomNumbers<2> pixel_spacing{};  // the distance of rows, of columns: y, then x
  DicomNumbers<1> slice_spacing{};
  DicomNumbers<1> slope{};
  DicomNumbers<1> intercept{};
  double offset = 0;                     // of a dose grid; 0 unless DicomFrames has offsets
  std::vector<std::uint32_t> indices{};  // by DicomFrames::dimensions
  std::optional<double> temporal_position{};
  std::optional<double> echo_time{};     // ms
  std::optional<double> trigger_time{};  // ms
  std::int64_t segment = 0;              // its number; 0: the file does not say
  bool has_own_values = false;           // slope and intercept stand in a group of this frame alone
};

// How the pixels of a file are stored.
struct DicomPixels {
  std::int64_t width = 0;
  std::int64_t height = 0;
  std::int64_t components = 1;  // samples a pixel
  std::int64_t bits_allocated = 0;
  std::int64_t bits_stored = 0;
  std::int64_t high_bit = 0;
  bool is_signed = false;

  // The bytes of a frame, if its bits are whole bytes; otherwise fewer.
  [[nodiscard]] std::int64_t frame_bytes() const {
    return width * height * components * (bits_allocated / 8);
  }
  friend bool operator==(const DicomPixels&, const DicomPixels&) = default;
};

struct DicomFrames {
  DicomPixels pixels{};
  DicomPhotometric photometric = DicomPhotometric::kMissing;
  bool has_lut = false;              // a table that gives stored pixels other values
  std::string series{};              // its UID, at most 64 bytes; "" if the file does not say
  std::vector<DicomFrame> frames{};  // in the order of the file; at least one
  std::int64_t group_items = 0;      // of functional groups, one for each frame; 0: it has none
  DicomNumbers<2> imager_spacing{};
  DicomNumbers<2> scanned_spacing{};
  DicomNumbers<1> dose_scaling{};
  DicomGiven offsets = DicomGiven::kMissing;
  std::vector<std::uint32_t> increments{};  // tags of elements that tell frames apart
  std::vector<std::uint32_t> dimensions{};  // tags
  // These two describe a segmentation:
  DicomSegmentKind segment_kind = DicomSegmentKind::kUnknown;
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
  // `frame_bytes`: the most that ReadFrame reads; 0 for headers alone. Loads the libraries
  // (dicom_module.h); if that fails, all calls return its error.
  explicit DicomDecoder(std::int64_t frame_bytes = 0);

  // Starts the process early (decoder_process.h). RESOURCE_EXHAUSTED: there can be none.
  // FAILED_PRECONDITION: the libraries are not there.
  absl::Status Start();

  // The frames of a file, at most 65 536, without their pixels. `is_high_throughput`: as DicomScan.
  // DATA_LOSS: the file can't be decoded. The message, without the path, says how the process
  // ended; it is "" if the libraries refused the file. DEADLINE_EXCEEDED, CANCELLED: as
  // DecoderProcess::Ask; nothing is known of the file. RESOURCE_EXHAUSTED: as Start.
  absl::StatusOr<DicomFrames> ReadFrames(const std::string& path, bool is_high_throughput = false);
  // The segments of a segmentation, at most 65 536. Errors: as ReadFrames.
  absl::StatusOr<DicomSegments> ReadSegments(const std::string& path,
                                             bool is_high_throughput = false);
  // Decodes the pixels of a frame as they are stored, before slope and intercept, into `out`.
  // Reads no other frame, as far as the encoding allows it. DATA_LOSS also: the pixels are stored
  // otherwise than `pixels` says; then the message is not "". REQUIRES: frame_bytes of `pixels`
  // are at most those of the constructor.
  absl::Status ReadFrame(const std::string& path, bool is_high_throughput, std::int64_t frame,
                         const DicomPixels& pixels, char* out);

 private:
  // Asks about a file; `request` has all but its path. `bytes`: what the answer may need.
  absl::StatusOr<DicomAnswer> Ask(const std::string& path, DicomRequest request,
                                  std::int64_t bytes);

  const std::int64_t frame_bytes_;
  const absl::StatusOr<DecoderProcess::Handler> handler_;
  DecoderProcess process_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_DECODER_H_
