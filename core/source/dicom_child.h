// Decodes DICOM files by ITK and GDCM in the process of a DecoderProcess, and the words that it and
// its parent (dicom_decoder.h) exchange.

#ifndef ISOSCOPE_CORE_SOURCE_DICOM_CHILD_H_
#define ISOSCOPE_CORE_SOURCE_DICOM_CHILD_H_

#include <array>
#include <cstddef>
#include <cstdint>

namespace isoscope::source {

inline constexpr std::size_t kMaxDicomUidBytes = 64;

enum class DicomQuestion : std::uint64_t { kSlice, kFrames, kFrame, kSegmentFrames, kSegments };

struct DicomRequest {
  std::array<char, 4096> path{};  // ends with 0
  DicomQuestion question = DicomQuestion::kSlice;
  std::uint64_t frame = 0;
  std::uint64_t slice_bytes = 0;  // 0: no pixels
  std::uint64_t is_counted = 0;   // 0 or 1
};

enum class DicomOutcome : std::uint32_t { kNotDecoded = 0, kHeader = 1, kPixels = 2 };

// A number that a file may lack.
struct MaybeDicomNumber {
  double value;
  std::uint64_t is_set;  // 1
};
// A frame, in the shared memory.
struct DicomFrameRecord {
  std::array<double, 3> position;
  std::array<double, 6> directions;  // of rows, of columns
  std::array<double, 3> spacing;
  std::uint64_t has_position;
  std::uint64_t has_directions;
  std::uint64_t has_spacing;
  double slope;
  double intercept;
  MaybeDicomNumber temporal_position;
  MaybeDicomNumber echo_time;
  MaybeDicomNumber trigger_time;
  std::uint64_t segment;  // its number; 0: the file does not say
};
inline constexpr std::size_t kMaxDicomFrames = 65536;
inline constexpr std::size_t kDicomFramesBytes = kMaxDicomFrames * sizeof(DicomFrameRecord);

// A segment of a segmentation, in the shared memory.
struct DicomSegmentRecord {
  std::uint64_t number;
  std::array<double, 3> lab;  // CIELab: 0 to 100, -128 to 127, -128 to 127
  std::uint64_t has_lab;
  std::array<char, 256> label;  // UTF-8 where the file says which letters it has; filled up with 0
};
inline constexpr std::size_t kMaxDicomSegments = 65536;
inline constexpr std::size_t kDicomSegmentsBytes = kMaxDicomSegments * sizeof(DicomSegmentRecord);
static_assert(kDicomSegmentsBytes >= kDicomFramesBytes);

// As the type of a segmentation says (0062,0001).
enum class DicomSegmentKind : std::uint32_t { kUnknown, kBinary, kFractional, kLabelMap };

// Zeros are "not decoded", so that a child that stops half-way says so.
struct DicomAnswer {
  DicomOutcome outcome;
  std::uint32_t component_type;  // ITK's number of it
  std::uint64_t components;
  std::array<std::uint64_t, 3> dims;  // the last one counts frames
  std::array<double, 3> origin;
  std::array<double, 3> spacing;
  std::array<double, 9> direction;             // of x, of y, of z
  std::array<char, kMaxDicomUidBytes> series;  // filled up with 0
  std::uint32_t stored_type;                   // volume::ScalarType and 1, of frames; 0: none
  // Of a segmentation:
  std::uint32_t bits_allocated;
  DicomSegmentKind segment_kind;
  MaybeDicomNumber padding;  // the value of pixels of no segment
};

// Answers a DicomRequest by a DicomAnswer, which is kNotDecoded if the libraries refuse the file.
// `shared` has kDicomSegmentsBytes, which are more than kDicomFramesBytes, or the bytes of a slice
// if those are more. As DecoderProcess::Handler, it may abort, crash, hang or take all memory.
void DecodeDicomInChild(const void* request_bytes, void* answer_bytes, char* shared);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_DICOM_CHILD_H_
