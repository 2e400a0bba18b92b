// Reads DICOM files by GDCM in the process of a DecoderProcess, and the words that it and its
// parent (dicom_decoder.h) exchange.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_CHILD_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_CHILD_H_

#include <array>
#include <cstddef>
#include <cstdint>

namespace isoscope::source {

inline constexpr std::size_t kMaxDicomUidBytes = 64;

enum class DicomQuestion : std::uint64_t { kFrames, kFrame, kSegments };

struct DicomRequest {
  std::array<char, 4096> path{};  // ends with 0
  DicomQuestion question = DicomQuestion::kFrames;
  std::uint64_t is_high_throughput = 0;  // 1: its pixels are High-Throughput JPEG 2000
  std::uint64_t frame = 0;
  std::uint64_t frame_bytes = 0;  // as they are stored
};

enum class DicomOutcome : std::uint32_t { kNotDecoded = 0, kHeader = 1, kPixels = 2 };

enum class DicomGiven : std::uint32_t {
  kMissing,  // not there, or empty
  kGiven,
  kBroken,  // another count of values, or a text that is no finite number
};

// The values of an element. They are zeros unless they are given.
template <std::size_t kCount>
struct DicomNumbers {
  std::array<double, kCount> values{};
  DicomGiven given = DicomGiven::kMissing;

  [[nodiscard]] bool is_given() const { return given == DicomGiven::kGiven; }
  [[nodiscard]] bool is_missing() const { return given == DicomGiven::kMissing; }
  [[nodiscard]] double value() const { return values[0]; }
};

// A number that a file may lack.
struct MaybeDicomNumber {
  double value;
  std::uint64_t is_set;  // 1
};

inline constexpr std::size_t kMaxDicomDimensions = 8;

// A frame, in the shared memory; or the only image of a file.
struct DicomFrameRecord {
  DicomNumbers<3> position{};       // (0020,0032); of ultrasound volumes (0020,9301)
  DicomNumbers<6> orientation{};    // (0020,0037) or (0020,9302): of rows, of columns
  DicomNumbers<2> pixel_spacing{};  // (0028,0030): of rows (along y), of columns
  DicomNumbers<1> slice_spacing{};  // (0018,0088)
  DicomNumbers<1> slope{};          // (0028,1053)
  DicomNumbers<1> intercept{};      // (0028,1052)
  double offset = 0;                // of a dose grid, if DicomAnswer::offsets are given
  // One index for each of DicomAnswer::dimensions; all are 0 if the frame does not have as many.
  std::array<std::uint32_t, kMaxDicomDimensions> indices{};
  MaybeDicomNumber temporal_position{};
  MaybeDicomNumber echo_time{};
  MaybeDicomNumber trigger_time{};
  std::uint64_t segment = 0;         // its number; 0: the file does not say
  std::uint64_t has_own_values = 0;  // 1: slope and intercept stand in its own group (0028,9145)
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
inline constexpr std::size_t kDicomListBytes =
    kDicomFramesBytes > kDicomSegmentsBytes ? kDicomFramesBytes : kDicomSegmentsBytes;

// The type of a segmentation (0062,0001).
enum class DicomSegmentKind : std::uint32_t { kUnknown, kBinary, kFractional, kLabelMap };

// (0028,0004)
enum class DicomPhotometric : std::uint32_t {
  kMissing,
  kMonochrome,  // 1 or 2, which differ only on a screen
  kPalette,
  kColour,
  kOther,
};

// Tags, a group and an element of 16 bits each; zeros behind the last one.
using DicomTags = std::array<std::uint32_t, kMaxDicomDimensions>;

// Zeros are "not decoded", so that a child that stops half-way says so.
struct DicomAnswer {
  DicomOutcome outcome = DicomOutcome::kNotDecoded;
  std::uint32_t components = 0;         // samples a pixel
  std::array<std::uint64_t, 3> dims{};  // the last one counts frames; or segments, the first one
  std::array<char, kMaxDicomUidBytes> series{};  // filled up with 0
  std::uint32_t bits_allocated = 0;
  std::uint32_t bits_stored = 0;
  std::uint32_t high_bit = 0;
  std::uint32_t is_signed = 0;  // 0 or 1
  DicomPhotometric photometric = DicomPhotometric::kMissing;
  std::uint32_t has_lut = 0;                  // a table from stored to other values (0028,3000)
  std::uint64_t group_items = 0;              // frames that have functional groups (5200,9230)
  DicomNumbers<2> imager_spacing{};           // (0018,1164)
  DicomNumbers<2> scanned_spacing{};          // (0018,2010)
  DicomNumbers<1> dose_scaling{};             // (3004,000e)
  DicomGiven offsets = DicomGiven::kMissing;  // of a dose grid (3004,000c)
  DicomTags increments{};                     // the elements that tell frames apart (0028,0009)
  // The elements that frames have indices of: (0020,9222), or vectors of nuclear medicine.
  DicomTags dimensions{};
  // These two describe a segmentation:
  DicomSegmentKind segment_kind = DicomSegmentKind::kUnknown;
  MaybeDicomNumber padding{};  // the value of pixels of no segment
};

// Answers a DicomRequest by a DicomAnswer, which is kNotDecoded if the libraries refuse the file.
// `shared` has kDicomListBytes, or the bytes of a frame if those are more. As
// DecoderProcess::Handler, it may abort, crash, hang or take all memory.
void DecodeDicomInChild(const void* request_bytes, void* answer_bytes, char* shared);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_CHILD_H_
