// A file is 128 bytes, "DICM", the group 0002 (always explicit, little-endian), and elements:
//
//   explicit  group:16 element:16 kind:2 letters  length:16              value
//             group:16 element:16 kind:2 letters  0:16         length:32 value   (kLong)
//   implicit  group:16 element:16                 length:32              value
//
//   (0008,0016) UI 26 "1.2.840.10008.5.1.4.1.1.2\0"  explicit: 08 00 16 00 55 49 1a 00 31 2e 32 ...
//
// Files without the first 132 bytes begin with the group 0002, or with the data set. They are taken
// for DICOM only if the transfer syntax (0002,0010), or the class of the object (0008,0016), is one
// of the standard's. A data set is explicit if its first element has a kind that exists.
// Source: DICOM PS3.5, section 7; PS3.10, section 7.

#include "core/formats/dicom/dicom_element.h"

#include <algorithm>
#include <cstring>

#include "absl/strings/match.h"
#include "absl/strings/string_view.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMarkOffset = 128;

constexpr absl::string_view kKinds =
    "AE AS AT CS DA DS DT FD FL IS LO LT OB OD OF OL OV OW PN SH SL SQ SS ST SV TM UC UI UL UN UR "
    "US UT UV";

bool IsKind(absl::string_view kind) {
  return kind[1] != ' ' && kKinds.find(kind) != absl::string_view::npos;
}

// Returns true if elements in ascending order lead to `wanted`, with a UID of the standard that
// begins with `uid`.
absl::StatusOr<bool> LeadsTo(DicomElementReader* reader, std::uint32_t wanted,
                             absl::string_view uid) {
  std::uint32_t last = 0;
  DicomElement element;
  for (bool is_first = true;; is_first = false) {
    ISOSCOPE_ASSIGN_OR_RETURN(const bool has_element, reader->ReadHead(&element));
    if (!has_element || !reader->Has(element.length) || element.tag > wanted ||
        (!is_first && element.tag <= last) || (reader->is_explicit() && !element.has_kind)) {
      return false;
    }
    if (element.tag == wanted) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::string found, reader->ReadUid(element.length));
      return absl::StartsWith(found, uid);
    }
    last = element.tag;
    reader->Skip(element.length);
  }
}

}  // namespace

absl::Status DicomElementReader::Read(std::size_t size, char* out) {
  if (position_ < window_begin_ ||
      position_ + static_cast<std::int64_t>(size) > window_begin_ + window_bytes_) {
    window_begin_ = position_;
    window_bytes_ = std::min(kWindowBytes, file_.size_bytes() - position_);
    if (static_cast<std::int64_t>(size) > window_bytes_) {
      window_bytes_ = 0;
      return file_.ReadAt(position_, size, out);
    }
    ISOSCOPE_RETURN_IF_ERROR(
        file_.ReadAt(position_, static_cast<std::size_t>(window_bytes_), window_.data()));
  }
  std::copy_n(window_.data() + (position_ - window_begin_), size, out);
  return absl::OkStatus();
}

absl::StatusOr<bool> DicomElementReader::ReadHead(DicomElement* element) {
  if (!Has(8)) {
    return false;
  }
  std::array<char, 12> head{};
  const std::int64_t size = std::min<std::int64_t>(head.size(), file_.size_bytes() - position_);
  ISOSCOPE_RETURN_IF_ERROR(Read(static_cast<std::size_t>(size), head.data()));
  const std::uint32_t group = base::LoadLittleEndian<std::uint16_t>(head.data());
  *element = {.tag = group << 16 | base::LoadLittleEndian<std::uint16_t>(head.data() + 2),
              .length = base::LoadLittleEndian<std::uint32_t>(head.data() + 4)};
  position_ += 8;
  constexpr std::uint32_t kItemGroup = 0xfffe;
  if (group == kItemGroup || !is_explicit_) {
    return true;
  }
  constexpr absl::string_view kLong = "OB OD OF OL OV OW SQ SV UC UN UR UT UV";
  const absl::string_view kind(head.data() + 4, 2);
  element->is_unknown = kind == "UN";
  element->is_no_short = kind != "US";
  element->has_kind = IsKind(kind);
  if (kLong.find(kind) == absl::string_view::npos) {
    element->length = base::LoadLittleEndian<std::uint16_t>(head.data() + 6);
    return true;
  }
  element->length = base::LoadLittleEndian<std::uint32_t>(head.data() + 8);
  position_ += 4;
  return Has(0);
}

absl::StatusOr<std::string> DicomElementReader::ReadUid(std::uint32_t length) {
  constexpr std::uint32_t kMaxUidBytes = 64;
  std::string uid(std::min(length, kMaxUidBytes), '\0');
  ISOSCOPE_RETURN_IF_ERROR(Read(uid.size(), uid.data()));
  return uid.substr(0, uid.find_first_not_of("0123456789."));
}

absl::StatusOr<DicomStart> FindDicomStart(const io::RandomAccessFile& file, bool* is_explicit) {
  constexpr std::uint32_t kTransferSyntax = 0x00020010;
  constexpr std::uint32_t kObjectClass = 0x00080016;
  std::array<char, 8> head{};
  if (file.size_bytes() >= kMarkOffset + 4) {
    ISOSCOPE_RETURN_IF_ERROR(file.ReadAt(kMarkOffset, 4, head.data()));
    if (std::memcmp(head.data(), "DICM", 4) == 0) {
      *is_explicit = true;
      return DicomStart::kMark;
    }
  }
  if (file.size_bytes() < static_cast<std::int64_t>(head.size())) {
    return DicomStart::kNone;
  }
  ISOSCOPE_RETURN_IF_ERROR(file.ReadAt(0, head.size(), head.data()));
  const auto group = base::LoadLittleEndian<std::uint16_t>(head.data());
  *is_explicit = IsKind(absl::string_view(head.data() + 4, 2));
  if (!(group == 2 && *is_explicit) && group != 8) {
    return DicomStart::kNone;
  }
  DicomElementReader reader(&file);
  reader.set_is_explicit(*is_explicit);
  ISOSCOPE_ASSIGN_OR_RETURN(const bool is_dicom,
                            group == 2 ? LeadsTo(&reader, kTransferSyntax, "1.2.840.10008.1.2")
                                       : LeadsTo(&reader, kObjectClass, "1.2.840.10008."));
  return !is_dicom ? DicomStart::kNone : group == 2 ? DicomStart::kMeta : DicomStart::kDataSet;
}

}  // namespace isoscope::source
