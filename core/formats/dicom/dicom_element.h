// Reads the elements of a DICOM file one after the other, without GDCM (dicom_scan.cc says why).

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_ELEMENT_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_ELEMENT_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/io/file.h"

namespace isoscope::source {

// The head of an element. Its value has `length` bytes, or ends with a delimiter.
struct DicomElement {
  static constexpr std::uint32_t kUndefined = 0xffffffff;  // as a length

  std::uint32_t tag = 0;  // group << 16 | element
  std::uint32_t length = 0;
  // False of implicit elements and of delimiters:
  bool is_unknown = false;   // of kind UN
  bool is_no_short = false;  // not of kind US
  bool has_kind = false;     // the kind exists
};

// Thread-compatible. All calls give the errors of reading.
class DicomElementReader {
 public:
  explicit DicomElementReader(const io::RandomAccessFile* file) : file_(*file) {}

  [[nodiscard]] std::int64_t position() const { return position_; }
  // Never goes back, but to the beginning of the file.
  void set_position(std::int64_t position) { position_ = position; }
  void Skip(std::int64_t size) { position_ += size; }
  // Returns true if heads have a kind of two letters.
  [[nodiscard]] bool is_explicit() const { return is_explicit_; }
  void set_is_explicit(bool is_explicit) { is_explicit_ = is_explicit; }

  // Returns true if the file has as many bytes from the position on.
  [[nodiscard]] bool Has(std::int64_t size) const { return size <= file_.size_bytes() - position_; }
  // Reads without moving. REQUIRES: Has(size).
  absl::Status Read(std::size_t size, char* out);
  // Reads the head of an element and moves behind it. False if the file ends before.
  absl::StatusOr<bool> ReadHead(DicomElement* element);
  // The leading digits and dots of a value of that length, at most 64. REQUIRES: Has(length).
  absl::StatusOr<std::string> ReadUid(std::uint32_t length);

 private:
  // Reads through a window of the file: elements are small, most headers fit one window, and the
  // position mostly grows.
  static constexpr std::int64_t kWindowBytes = 4096;

  const io::RandomAccessFile& file_;
  std::int64_t position_ = 0;
  std::array<char, kWindowBytes> window_;
  std::int64_t window_begin_ = 0;
  std::int64_t window_bytes_ = 0;
  bool is_explicit_ = true;
};

// How a file begins.
enum class DicomStart {
  kNone,     // it is no DICOM file
  kMark,     // 128 bytes, "DICM", and the group 0002
  kMeta,     // the group 0002
  kDataSet,  // elements of a data set
};
// Tells how the file begins, and whether the elements of a kDataSet have kinds.
absl::StatusOr<DicomStart> FindDicomStart(const io::RandomAccessFile& file, bool* is_explicit);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_ELEMENT_H_
