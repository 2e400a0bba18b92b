// Slices of a DICOM series made of literal bytes.

#ifndef ISOSCOPE_TESTS_SUPPORT_DICOM_FILE_H_
#define ISOSCOPE_TESTS_SUPPORT_DICOM_FILE_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

#include "core/base/coding.h"

namespace isoscope::testing {

// An element in explicit VR, little-endian.
inline std::string DicomElement(std::uint16_t group, std::uint16_t element, const std::string& vr,
                                std::string value) {
  if (value.size() % 2 != 0) {
    value += vr == "UI" ? '\0' : ' ';
  }
  std::string bytes;
  base::AppendLittleEndian(group, &bytes);
  base::AppendLittleEndian(element, &bytes);
  bytes += vr;
  if (vr == "OW" || vr == "OB" || vr == "SQ" || vr == "UN") {
    base::AppendLittleEndian(std::uint16_t{0}, &bytes);
    base::AppendLittleEndian(static_cast<std::uint32_t>(value.size()), &bytes);
  } else {
    base::AppendLittleEndian(static_cast<std::uint16_t>(value.size()), &bytes);
  }
  return bytes + value;
}

// An item of a sequence, or a fragment of compressed pixels.
inline std::string DicomItem(const std::string& content) {
  std::string bytes("\xfe\xff\x00\xe0", 4);
  base::AppendLittleEndian(static_cast<std::uint32_t>(content.size()), &bytes);
  return bytes + content;
}

// An item and an element without a length: with a delimiter behind the content.
inline std::string DicomOpenItem(const std::string& content) {
  return std::string("\xfe\xff\x00\xe0\xff\xff\xff\xff", 8) + content +
         std::string("\xfe\xff\x0d\xe0\0\0\0\0", 8);
}
inline std::string DicomOpenElement(std::uint16_t group, std::uint16_t element,
                                    const std::string& vr, const std::string& content) {
  std::string bytes;
  base::AppendLittleEndian(group, &bytes);
  base::AppendLittleEndian(element, &bytes);
  return bytes + vr + std::string("\0\0\xff\xff\xff\xff", 6) + content +
         std::string("\xfe\xff\xdd\xe0\0\0\0\0", 8);
}

template <typename T>
std::string DicomNumber(T value) {
  std::string bytes;
  base::AppendLittleEndian(value, &bytes);
  return bytes;
}

// A frame in DICOM's run-length encoding, without runs: the bytes of pixels apart, the highest
// first.
inline std::string DicomRleFrame(const std::string& pixels, std::size_t bytes) {
  std::string segments;
  std::string head = DicomNumber(static_cast<std::uint32_t>(bytes));
  for (std::size_t byte = bytes; byte-- > 0;) {
    head += DicomNumber(static_cast<std::uint32_t>(64 + segments.size()));
    std::string plane;
    for (std::size_t i = byte; i < pixels.size(); i += bytes) {
      plane += pixels[i];
    }
    for (std::size_t i = 0; i < plane.size(); i += 128) {
      const std::string run = plane.substr(i, 128);
      segments += static_cast<char>(run.size() - 1);
      segments += run;
    }
    segments.resize(segments.size() + segments.size() % 2, '\0');
  }
  head.resize(64, '\0');
  return head + segments;
}

struct DicomSlice {
  std::uint16_t width = 12;
  std::uint16_t height = 9;
  std::string series = "1.2.3";
  std::string position = "10\\20\\30";
  std::string orientation = "1\\0\\0\\0\\1\\0";
  int number = 1;
  bool is_signed = true;
  std::string storage_class = "1.2.840.10008.5.1.4.1.1.2";  // CT
  std::string more{};                                       // elements of the groups 0029 to 7fdf
  // Left out if empty or 0:
  std::string description{};
  int series_number = 0;
  int temporal_position = 0;
  int frames = 0;
  std::string letters{};    // the set of them
  std::uint16_t bits = 16;  // a pixel
  std::string photometric = "MONOCHROME2";
  std::string spacing = "2\\0.5";
  // Left out if empty:
  std::string image_type{};
  std::string intercept{};
  std::string slope{};
  // Compressed pixels are the frames of `pixels` in DICOM's run-length encoding, or those of
  // `fragments` in another transfer syntax.
  std::string transfer_syntax = "1.2.840.10008.1.2.1";
  std::vector<std::string> fragments{};
  std::string frame_of_reference{};  // left out if empty
};
inline constexpr char kDicomRle[] = "1.2.840.10008.1.2.5";

// The element of the pixels.
inline std::string DicomPixels(const DicomSlice& slice, const std::string& pixels) {
  if (slice.transfer_syntax == "1.2.840.10008.1.2.1") {
    return DicomElement(0x7fe0, 0x10, "OW", pixels);
  }
  std::string items = DicomItem("");
  for (const std::string& fragment : slice.fragments) {
    items += DicomItem(fragment + std::string(fragment.size() % 2, '\0'));
  }
  const std::size_t bytes = slice.bits / 8;
  const std::size_t frame_bytes = bytes * slice.width * slice.height;
  for (std::size_t i = 0; i < pixels.size(); i += frame_bytes) {
    items += DicomItem(DicomRleFrame(pixels.substr(i, frame_bytes), bytes));
  }
  return DicomOpenElement(0x7fe0, 0x10, "OB", items);
}

// The file of a slice: `pixels` as [y][x] of 16 bits (or `bits`), 0.5 apart on x and 2 on y.
inline std::string DicomBytes(const DicomSlice& slice, const std::string& pixels) {
  const auto text = [](std::uint16_t group, std::uint16_t element, const char* vr,
                       const std::string& value) {
    return value.empty() ? "" : DicomElement(group, element, vr, value);
  };
  const auto number = [](int value) { return value == 0 ? "" : absl::StrCat(value); };
  const std::string uid = absl::StrCat("1.2.3.4.", slice.number);
  const std::string meta =
      DicomElement(2, 1, "OB", std::string("\0\1", 2)) +
      DicomElement(2, 2, "UI", slice.storage_class) + DicomElement(2, 3, "UI", uid) +
      DicomElement(2, 0x10, "UI", slice.transfer_syntax) + DicomElement(2, 0x12, "UI", "1.2.3.4");
  return std::string(128, '\0') + "DICM" +
         DicomElement(2, 0, "UL", DicomNumber(static_cast<std::uint32_t>(meta.size()))) + meta +
         text(8, 5, "CS", slice.letters) + text(8, 8, "CS", slice.image_type) +
         DicomElement(8, 0x16, "UI", slice.storage_class) + DicomElement(8, 0x18, "UI", uid) +
         DicomElement(8, 0x60, "CS", "CT") + text(8, 0x103e, "LO", slice.description) +
         DicomElement(0x20, 0xd, "UI", "1.2.9") + DicomElement(0x20, 0xe, "UI", slice.series) +
         text(0x20, 0x11, "IS", number(slice.series_number)) +
         DicomElement(0x20, 0x13, "IS", absl::StrCat(slice.number)) +
         text(0x20, 0x32, "DS", slice.position) + text(0x20, 0x37, "DS", slice.orientation) +
         text(0x20, 0x52, "UI", slice.frame_of_reference) +
         text(0x20, 0x100, "IS", number(slice.temporal_position)) +
         DicomElement(0x28, 2, "US", DicomNumber(std::uint16_t{1})) +
         DicomElement(0x28, 4, "CS", slice.photometric) +
         text(0x28, 8, "IS", number(slice.frames)) +
         DicomElement(0x28, 0x10, "US", DicomNumber(slice.height)) +
         DicomElement(0x28, 0x11, "US", DicomNumber(slice.width)) +
         text(0x28, 0x30, "DS", slice.spacing) +
         DicomElement(0x28, 0x100, "US", DicomNumber(slice.bits)) +
         DicomElement(0x28, 0x101, "US", DicomNumber(slice.bits)) +
         DicomElement(0x28, 0x102, "US", DicomNumber(static_cast<std::uint16_t>(slice.bits - 1))) +
         DicomElement(0x28, 0x103, "US",
                      DicomNumber(static_cast<std::uint16_t>(slice.is_signed ? 1 : 0))) +
         text(0x28, 0x1052, "DS", slice.intercept) + text(0x28, 0x1053, "DS", slice.slope) +
         slice.more + DicomPixels(slice, pixels);
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_DICOM_FILE_H_
