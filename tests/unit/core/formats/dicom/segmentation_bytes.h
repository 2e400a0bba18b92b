// DICOM segmentations of known elements.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_FORMATS_DICOM_SEGMENTATION_BYTES_H_
#define ISOSCOPE_TESTS_UNIT_CORE_FORMATS_DICOM_SEGMENTATION_BYTES_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

#include "tests/support/dicom_file.h"

namespace isoscope::testing {

inline constexpr char kSegmentationClass[] = "1.2.840.10008.5.1.4.1.1.66.4";
inline constexpr char kLabelMapClass[] = "1.2.840.10008.5.1.4.1.1.66.7";

struct SegmentFrame {
  std::string place = "10\\20\\30";  // "": none
  int segment = 1;                   // 0: none
  std::vector<int> pixels{};         // of a BINARY one, 0 or 1
};

struct NamedSegment {
  std::uint16_t number = 1;
  std::string label{};
  std::optional<std::array<std::uint16_t, 3>> lab{};
};

struct SegmentationFile {
  std::uint16_t width = 5;
  std::uint16_t height = 3;
  std::string kind = "BINARY";
  std::uint16_t bits = 1;
  std::vector<SegmentFrame> frames{};
  std::vector<NamedSegment> segments{};
  std::string distance{};  // between slices
  std::optional<std::uint16_t> padding{};
  std::string series = "1.2.3";
  std::string letters{};
  int number = 1;
};

// Pixels of one bit are packed without gaps between frames.
inline std::string PixelsOf(const SegmentationFile& file) {
  std::string bytes;
  std::size_t bit = 0;
  for (const SegmentFrame& frame : file.frames) {
    for (const int pixel : frame.pixels) {
      if (file.bits == 16) {
        bytes += DicomNumber(static_cast<std::uint16_t>(pixel));
      } else if (file.bits == 8) {
        bytes += static_cast<char>(pixel);
      } else {
        if (bit % 8 == 0) {
          bytes += '\0';
        }
        bytes.back() = static_cast<char>(bytes.back() | (pixel << (bit % 8)));
        ++bit;
      }
    }
  }
  return bytes;
}

// Pixels lie 0.5 apart on x and 2 on y.
inline std::string SegmentationBytes(const SegmentationFile& file) {
  std::string segments;
  for (const NamedSegment& segment : file.segments) {
    std::string item = DicomElement(0x62, 4, "US", DicomNumber(segment.number));
    item += segment.label.empty() ? "" : DicomElement(0x62, 5, "LO", segment.label);
    if (segment.lab.has_value()) {
      std::string lab;
      for (const std::uint16_t part : *segment.lab) {
        lab += DicomNumber(part);
      }
      item += DicomElement(0x62, 0xd, "US", lab);
    }
    segments += DicomItem(item);
  }
  std::string frames;
  for (const SegmentFrame& frame : file.frames) {
    const std::string place = DicomItem(DicomElement(0x20, 0x32, "DS", frame.place));
    const std::string segment = DicomItem(
        DicomElement(0x62, 0xb, "US", DicomNumber(static_cast<std::uint16_t>(frame.segment))));
    frames += DicomItem((frame.place.empty() ? "" : DicomElement(0x20, 0x9113, "SQ", place)) +
                        (frame.segment == 0 ? "" : DicomElement(0x62, 0xa, "SQ", segment)));
  }
  const std::string measures =
      DicomItem(file.distance.empty() ? "" : DicomElement(0x18, 0x88, "DS", file.distance));
  DicomSlice slice{.width = file.width,
                   .height = file.height,
                   .series = file.series,
                   .position = "",
                   .number = file.number,
                   .is_signed = false,
                   .storage_class = file.kind == "LABELMAP" ? kLabelMapClass : kSegmentationClass,
                   .more = DicomElement(0x62, 1, "CS", file.kind) +
                           DicomElement(0x62, 2, "SQ", segments) +
                           DicomElement(0x5200, 0x9229, "SQ",
                                        DicomItem(DicomElement(0x28, 0x9110, "SQ", measures))) +
                           DicomElement(0x5200, 0x9230, "SQ", frames),
                   .frames = static_cast<int>(file.frames.size()),
                   .letters = file.letters,
                   .bits = file.bits};
  if (file.padding.has_value()) {
    slice.more = DicomElement(0x28, 0x120, "US", DicomNumber(*file.padding)) + slice.more;
  }
  return DicomBytes(slice, PixelsOf(file));
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_FORMATS_DICOM_SEGMENTATION_BYTES_H_
