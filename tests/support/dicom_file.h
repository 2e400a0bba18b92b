// Slices of a DICOM series made of literal bytes.

#ifndef ISOSCOPE_TESTS_SUPPORT_DICOM_FILE_H_
#define ISOSCOPE_TESTS_SUPPORT_DICOM_FILE_H_

#include <cstdint>
#include <string>

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
  if (vr == "OW" || vr == "OB") {
    base::AppendLittleEndian(std::uint16_t{0}, &bytes);
    base::AppendLittleEndian(static_cast<std::uint32_t>(value.size()), &bytes);
  } else {
    base::AppendLittleEndian(static_cast<std::uint16_t>(value.size()), &bytes);
  }
  return bytes + value;
}

template <typename T>
std::string DicomNumber(T value) {
  std::string bytes;
  base::AppendLittleEndian(value, &bytes);
  return bytes;
}

struct DicomSlice {
  std::uint16_t width = 12;
  std::uint16_t height = 9;
  std::string series = "1.2.3";
  std::string position = "10\\20\\30";
  std::string orientation = "1\\0\\0\\0\\1\\0";
  int number = 1;
  bool is_signed = true;
};

// The file of a slice: `pixels` as [y][x] of 16 bits, 0.5 apart on x and 2 on y.
inline std::string DicomBytes(const DicomSlice& slice, const std::string& pixels) {
  const std::string ct = "1.2.840.10008.5.1.4.1.1.2";
  const std::string uid = absl::StrCat("1.2.3.4.", slice.number);
  const std::string meta = DicomElement(2, 1, "OB", std::string("\0\1", 2)) +
                           DicomElement(2, 2, "UI", ct) + DicomElement(2, 3, "UI", uid) +
                           DicomElement(2, 0x10, "UI", "1.2.840.10008.1.2.1") +
                           DicomElement(2, 0x12, "UI", "1.2.3.4");
  return std::string(128, '\0') + "DICM" +
         DicomElement(2, 0, "UL", DicomNumber(static_cast<std::uint32_t>(meta.size()))) + meta +
         DicomElement(8, 0x16, "UI", ct) + DicomElement(8, 0x18, "UI", uid) +
         DicomElement(8, 0x60, "CS", "CT") + DicomElement(0x20, 0xd, "UI", "1.2.9") +
         DicomElement(0x20, 0xe, "UI", slice.series) +
         DicomElement(0x20, 0x13, "IS", absl::StrCat(slice.number)) +
         DicomElement(0x20, 0x32, "DS", slice.position) +
         DicomElement(0x20, 0x37, "DS", slice.orientation) +
         DicomElement(0x28, 2, "US", DicomNumber(std::uint16_t{1})) +
         DicomElement(0x28, 4, "CS", "MONOCHROME2") +
         DicomElement(0x28, 0x10, "US", DicomNumber(slice.height)) +
         DicomElement(0x28, 0x11, "US", DicomNumber(slice.width)) +
         DicomElement(0x28, 0x30, "DS", "2\\0.5") +
         DicomElement(0x28, 0x100, "US", DicomNumber(std::uint16_t{16})) +
         DicomElement(0x28, 0x101, "US", DicomNumber(std::uint16_t{16})) +
         DicomElement(0x28, 0x102, "US", DicomNumber(std::uint16_t{15})) +
         DicomElement(0x28, 0x103, "US",
                      DicomNumber(static_cast<std::uint16_t>(slice.is_signed ? 1 : 0))) +
         DicomElement(0x7fe0, 0x10, "OW", pixels);
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_DICOM_FILE_H_
