// GDCM ends its process by an assertion if some elements are cut. About a report it says only that
// it can't be read. So this scan checks every file before GDCM reads it, and the user gets a
// precise message.
//
// dicom_element.cc has the layout of elements.
//
// A sequence or an item may have the length 0xffffffff: then it holds elements up to its delimiter.
// The walk takes the first step that applies to an element:
//
// 1. A delimiter ends an item or a sequence. At the delimiter of pixels the walk is done.
// 2. An element without a length is entered. Pixels without a length are a row of items. A value of
//    unknown kind (UN) without a length holds implicit elements, in any file (CP-246).
// 3. Pixels with a length are counted, and the walk is done.
// 4. Another value is kept if the scan needs it, and skipped.
//
// The walk counts its depth, because the pixels of an icon inside a sequence are not those of the
// image.
//
// GDCM also ends its process if a number that describes the pixels is of a wrong kind, such as rows
// that are a text. The same holds for an invalid kind in the group 0002. Such a file counts as cut.
// For other causes there is the child process (decoder_process.h).
//
// GDCM also accepts files with too few pixels, and leaves the others undefined. So this scan counts
// the pixels of files that are not compressed.
//
// A file without pixels is no image. But if its class is one of images, or it has a number of rows,
// it counts as cut. Big-endian files are not scanned, nor are the elements of deflated ones.
// Source: DICOM PS3.5, sections 6.2.2 and 7, annex A.4.

#include "core/formats/dicom/dicom_scan.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

#include "core/base/coding.h"
#include "core/base/printable.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/formats/dicom/dicom_element.h"
#include "core/formats/dicom/dicom_storage.h"

namespace isoscope::source {
namespace {

constexpr std::uint32_t kMetaLength = 0x00020000;
constexpr std::uint32_t kStorageClass = 0x00020002;
constexpr std::uint32_t kTransferSyntax = 0x00020010;
constexpr std::uint32_t kObjectClass = 0x00080016;
constexpr std::uint32_t kSeries = 0x0020000e;
constexpr std::uint32_t kSamplesOfPixel = 0x00280002;
constexpr std::uint32_t kRows = 0x00280010;
constexpr std::uint32_t kColumns = 0x00280011;
constexpr std::uint32_t kBitsAllocated = 0x00280100;
constexpr std::uint32_t kFloatPixels = 0x7fe00008;
constexpr std::uint32_t kDoublePixels = 0x7fe00009;
constexpr std::uint32_t kPixels = 0x7fe00010;
constexpr std::uint32_t kItemEnd = 0xfffee00d;
constexpr std::uint32_t kSequenceEnd = 0xfffee0dd;

constexpr char kImplicit[] = "1.2.840.10008.1.2";
constexpr char kExplicit[] = "1.2.840.10008.1.2.1";
constexpr char kExplicitSyntaxes[] = "1.2.840.10008.1.2.";  // their beginning
constexpr char kDeflated[] = "1.2.840.10008.1.2.1.99";
constexpr char kBigEndian[] = "1.2.840.10008.1.2.2";

// Texts that are kept.
constexpr std::uint32_t kImageType = 0x00080008;
constexpr std::uint32_t kAcquisitionTime = 0x00080032;
constexpr std::uint32_t kContentTime = 0x00080033;
constexpr std::uint32_t kDescription = 0x0008103e;
constexpr std::uint32_t kEchoTime = 0x00180081;
constexpr std::uint32_t kTriggerTime = 0x00181060;
constexpr std::uint32_t kSeriesNumber = 0x00200011;
constexpr std::uint32_t kAcquisitionNumber = 0x00200012;
constexpr std::uint32_t kInstanceNumber = 0x00200013;
constexpr std::uint32_t kFrameOfReference = 0x00200052;
constexpr std::uint32_t kTemporalPosition = 0x00200100;
constexpr std::uint32_t kTemporalResolution = 0x00200110;
constexpr std::uint32_t kFrames = 0x00280008;
constexpr std::uint32_t kRescaleType = 0x00281054;
constexpr std::uint32_t kUnits = 0x00541001;         // of PET
constexpr std::uint32_t kImagesInGrid = 0x00651050;  // of United Imaging
constexpr std::array<std::uint32_t, 16> kTexts{
    kImageType,        kAcquisitionTime,   kContentTime,
    kDescription,      kEchoTime,          kTriggerTime,
    kSeriesNumber,     kAcquisitionNumber, kInstanceNumber,
    kFrameOfReference, kTemporalPosition,  kTemporalResolution,
    kFrames,           kRescaleType,       kUnits,
    kImagesInGrid};

// Elements of kind US, two bytes: samples a pixel, planar configuration, rows, columns, bits
// allocated, bits stored, high bit, pixel representation.
constexpr std::array<std::uint32_t, 8> kNumbers{kSamplesOfPixel, 0x00280006,     kRows,
                                                kColumns,        kBitsAllocated, 0x00280101,
                                                0x00280102,      0x00280103};

// Returns true if the element is one of kNumbers, but does not hold a number of kind US.
bool IsBrokenNumber(const DicomElement& element) {
  return std::find(kNumbers.begin(), kNumbers.end(), element.tag) != kNumbers.end() &&
         (element.is_no_short || (element.length != 2 && element.length != 0));
}

// "093015.25": seconds of the day.
std::optional<double> SecondsOf(const std::string& text) {
  double seconds = 0;
  int hours = 0;
  int minutes = 0;
  if (text.size() < 6 || !absl::SimpleAtoi(text.substr(0, 2), &hours) ||
      !absl::SimpleAtoi(text.substr(2, 2), &minutes) ||
      !absl::SimpleAtod(text.substr(4), &seconds)) {
    return std::nullopt;
  }
  return 3600.0 * hours + 60.0 * minutes + seconds;
}

class Scanner {
 public:
  explicit Scanner(const io::RandomAccessFile* file) : file_(*file), reader_(file) {}

  absl::StatusOr<DicomScan> Scan() {
    ISOSCOPE_ASSIGN_OR_RETURN(DicomScan scan, ScanElements());
    const auto number = [this](std::uint32_t tag) -> std::optional<double> {
      const auto text = texts_.find(tag);
      double value = 0;
      return text != texts_.end() && absl::SimpleAtod(text->second, &value) && std::isfinite(value)
                 ? std::optional<double>(value)
                 : std::nullopt;
    };
    const auto seconds = [this](std::uint32_t tag) {
      const auto text = texts_.find(tag);
      return text == texts_.end() ? std::nullopt : SecondsOf(text->second);
    };
    constexpr double kMaxNumber = 0x1p31;
    scan.series_number = static_cast<std::int64_t>(
        std::clamp(number(kSeriesNumber).value_or(0), -kMaxNumber, kMaxNumber));
    scan.frames =
        static_cast<std::int64_t>(std::clamp(number(kFrames).value_or(1), 1.0, kMaxNumber));
    scan.description = base::Printable(texts_[kDescription]);
    scan.frame_of_reference = texts_[kFrameOfReference];
    scan.value_unit = base::Printable(texts_[texts_[kUnits].empty() ? kRescaleType : kUnits]);
    scan.width = columns_;
    scan.height = rows_;
    scan.bits_allocated = bits_;
    // A value of the type, of which there may be more behind it.
    const std::string types = absl::StrCat("\\", texts_[kImageType], "\\");
    scan.is_mosaic = absl::StrContains(types, "\\MOSAIC\\") ||
                     (absl::StrContains(types, "\\VFRAME\\") && number(kImagesInGrid) > 1);
    scan.moment = {.temporal_position = number(kTemporalPosition),
                   .echo_time = number(kEchoTime),
                   .trigger_time = number(kTriggerTime),
                   .acquisition_number = number(kAcquisitionNumber),
                   .acquisition_time = seconds(kAcquisitionTime),
                   .content_time = seconds(kContentTime),
                   .instance_number = number(kInstanceNumber),
                   .temporal_resolution = number(kTemporalResolution)};
    return scan;
  }

 private:
  absl::StatusOr<DicomScan> ScanElements() {
    bool is_explicit = true;
    ISOSCOPE_ASSIGN_OR_RETURN(const DicomStart start, FindDicomStart(file_, &is_explicit));
    scan_.is_dicom = start != DicomStart::kNone;
    if (start == DicomStart::kDataSet) {
      reader_.set_is_explicit(is_explicit);
      scan_.transfer_syntax = is_explicit ? kExplicit : kImplicit;
    } else {
      reader_.set_position(start == DicomStart::kMark ? 132 : 0);
      ISOSCOPE_ASSIGN_OR_RETURN(const bool has_meta, ReadMeta());
      if (!scan_.is_dicom || !has_meta) {
        return scan_;
      }
    }
    const bool is_unread =
        scan_.transfer_syntax == kBigEndian || scan_.transfer_syntax == kDeflated;
    if (is_unread && DicomStorageOf(scan_.storage_class) != DicomStorage::kOther) {
      scan_.content = reader_.Has(8) ? DicomContent::kImage : DicomContent::kCut;
      return scan_;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const End end, Walk());
    const DicomStorage storage = DicomStorageOf(scan_.storage_class);
    const bool must_have_pixels = storage == DicomStorage::kImage || has_rows_;
    scan_.content = storage == DicomStorage::kOther            ? DicomContent::kNoImage
                    : end == End::kOfPixels                    ? DicomContent::kImage
                    : end == End::kOfFile && !must_have_pixels ? DicomContent::kNoImage
                                                               : DicomContent::kCut;
    return scan_;
  }

  enum class End { kOfPixels, kOfFile, kWithinElement };

  // Reads the group 0002. Its length counts from behind its first element, which a file without a
  // mark may lack. False if the group is not there or damaged.
  absl::StatusOr<bool> ReadMeta() {
    const std::int64_t begin = reader_.position();
    DicomElement element;
    ISOSCOPE_ASSIGN_OR_RETURN(const bool has_element, reader_.ReadHead(&element));
    const bool has_length = has_element && element.tag == kMetaLength && element.length == 4;
    if (!has_length && (begin > 0 || !has_element)) {
      return false;
    }
    std::int64_t end = -1;  // not known
    if (!has_length) {
      reader_.set_position(begin);
    } else if (reader_.Has(4)) {
      std::array<char, 4> length;
      ISOSCOPE_RETURN_IF_ERROR(reader_.Read(length.size(), length.data()));
      reader_.Skip(4);
      end = reader_.position() + base::LoadLittleEndian<std::uint32_t>(length.data());
    } else {
      return false;
    }
    while (end < 0 || reader_.position() < end) {
      const std::int64_t at = reader_.position();
      ISOSCOPE_ASSIGN_OR_RETURN(const bool has_next, reader_.ReadHead(&element));
      if (end < 0 && has_next && element.tag >> 16 != 2) {
        reader_.set_position(end = at);
        break;
      }
      if (!has_next || !element.has_kind || !reader_.Has(element.length)) {
        return false;
      }
      if (element.tag == kStorageClass) {
        ISOSCOPE_ASSIGN_OR_RETURN(scan_.storage_class, reader_.ReadUid(element.length));
      } else if (element.tag == kTransferSyntax) {
        ISOSCOPE_ASSIGN_OR_RETURN(scan_.transfer_syntax, reader_.ReadUid(element.length));
      }
      reader_.Skip(element.length);
    }
    reader_.set_is_explicit(absl::StartsWith(scan_.transfer_syntax, kExplicitSyntaxes));
    return reader_.position() == end;
  }

  // Keeps the value of one of kTexts, without the spaces and zeros at its ends. It keeps the first
  // of several texts, but all texts of the type of the image.
  absl::Status KeepText(const DicomElement& element) {
    constexpr std::uint32_t kMaxTextBytes = 128;
    if (std::find(kTexts.begin(), kTexts.end(), element.tag) == kTexts.end()) {
      return absl::OkStatus();
    }
    std::string text(std::min(element.length, kMaxTextBytes), '\0');
    ISOSCOPE_RETURN_IF_ERROR(reader_.Read(text.size(), text.data()));
    text = text.substr(0, text.find('\0'));
    if (element.tag != kImageType) {
      text = text.substr(0, text.find('\\'));
    }
    texts_[element.tag] = std::string(absl::StripAsciiWhitespace(text));
    return absl::OkStatus();
  }

  // Keeps the value of an element that counts the pixels.
  absl::Status KeepNumber(const DicomElement& element) {
    std::uint16_t* const number = element.tag == kRows             ? &rows_
                                  : element.tag == kColumns        ? &columns_
                                  : element.tag == kBitsAllocated  ? &bits_
                                  : element.tag == kSamplesOfPixel ? &samples_of_pixel_
                                                                   : nullptr;
    if (number == nullptr || element.length != sizeof(*number)) {
      return absl::OkStatus();
    }
    std::array<char, sizeof(*number)> bytes;
    ISOSCOPE_RETURN_IF_ERROR(reader_.Read(bytes.size(), bytes.data()));
    // GDCM takes one of two equal elements, so this keeps the larger number.
    *number = std::max(*number, base::LoadLittleEndian<std::uint16_t>(bytes.data()));
    return absl::OkStatus();
  }

  // Returns true if `length` bytes are enough for the pixels that the numbers describe. True if
  // that can't be known: colours may be stored in fewer bytes, and compressed pixels are.
  bool CountPixels(std::uint32_t length) {
    scan_.is_counted = samples_of_pixel_ == 1 &&
                       (scan_.transfer_syntax == kImplicit || scan_.transfer_syntax == kExplicit);
    double frames = 1;
    const auto text = texts_.find(kFrames);
    if (text != texts_.end() && (!absl::SimpleAtod(text->second, &frames) || !(frames >= 1))) {
      frames = 1;
    }
    return !scan_.is_counted ||
           static_cast<double>(std::uint64_t{rows_} * columns_ * bits_) * frames <=
               static_cast<double>(length) * 8;
  }

  absl::StatusOr<End> Walk() {
    std::int64_t depth = 0;            // of sequences and items without a length
    std::int64_t implicit_depth = -1;  // elements below it are implicit, in an explicit file
    bool is_in_pixels = false;
    DicomElement element;
    while (reader_.Has(8)) {
      ISOSCOPE_ASSIGN_OR_RETURN(const bool has_head, reader_.ReadHead(&element));
      if (!has_head) {
        return End::kWithinElement;
      }
      // 1. A delimiter.
      if (element.tag == kItemEnd || element.tag == kSequenceEnd) {
        if (is_in_pixels) {
          return element.tag == kSequenceEnd ? End::kOfPixels : End::kWithinElement;
        }
        depth = std::max<std::int64_t>(depth - 1, 0);
        if (depth == implicit_depth) {
          reader_.set_is_explicit(true);
          implicit_depth = -1;
        }
        continue;
      }
      // 2. An element without a length.
      if (element.length == DicomElement::kUndefined) {
        if (is_in_pixels) {
          return End::kWithinElement;  // fragments of pixels have lengths
        }
        is_in_pixels = depth == 0 && element.tag == kPixels;
        if (element.is_unknown && !is_in_pixels) {
          implicit_depth = depth;
          reader_.set_is_explicit(false);
        }
        depth += is_in_pixels ? 0 : 1;
        continue;
      }
      if (!reader_.Has(element.length)) {
        return End::kWithinElement;
      }
      // 3. Pixels with a length.
      if (depth == 0 && element.tag == kPixels) {
        scan_.pixels_offset = reader_.position();
        return CountPixels(element.length) ? End::kOfPixels : End::kWithinElement;
      }
      if (depth == 0 && (element.tag == kFloatPixels || element.tag == kDoublePixels)) {
        scan_.has_float_pixels = true;
        return End::kOfPixels;
      }
      // 4. Another value.
      if (depth == 0 && IsBrokenNumber(element)) {
        return End::kWithinElement;
      }
      if (depth == 0) {
        ISOSCOPE_RETURN_IF_ERROR(KeepNumber(element));
        ISOSCOPE_RETURN_IF_ERROR(KeepText(element));
      }
      if (depth == 0 && element.tag == kObjectClass && scan_.storage_class.empty()) {
        ISOSCOPE_ASSIGN_OR_RETURN(scan_.storage_class, reader_.ReadUid(element.length));
      }
      if (depth == 0 && element.tag == kSeries) {
        ISOSCOPE_ASSIGN_OR_RETURN(scan_.series, reader_.ReadUid(element.length));
      }
      has_rows_ = has_rows_ || (depth == 0 && element.tag == kRows);
      reader_.Skip(element.length);
    }
    return depth == 0 && !is_in_pixels && !reader_.Has(1) ? End::kOfFile : End::kWithinElement;
  }

  const io::RandomAccessFile& file_;
  DicomElementReader reader_;
  bool has_rows_ = false;
  std::uint16_t rows_ = 0;
  std::uint16_t columns_ = 0;
  std::uint16_t bits_ = 0;
  std::uint16_t samples_of_pixel_ = 1;
  std::map<std::uint32_t, std::string> texts_;  // by tag
  DicomScan scan_;
};

}  // namespace

bool DicomScan::is_high_throughput() const {
  constexpr absl::string_view kSyntaxes = "1.2.840.10008.1.2.4.20";  // and 1, 2 or 3
  return transfer_syntax.size() == kSyntaxes.size() + 1 &&
         absl::StartsWith(transfer_syntax, kSyntaxes);
}

bool HasDicomStart(const io::RandomAccessFile& file) {
  bool is_explicit = false;
  const absl::StatusOr<DicomStart> start = FindDicomStart(file, &is_explicit);
  return start.ok() && *start != DicomStart::kNone;
}

absl::StatusOr<DicomScan> ScanDicomFile(const std::string& path) {
  ISOSCOPE_RETURN_IF_ERROR(base::CheckProcessInterrupt());  // of a folder with many files
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  return Scanner(file.get()).Scan();
}

absl::Status DicomCutError(const std::string& path) {
  return absl::InvalidArgumentError(
      absl::StrCat(path,
                   ": does not hold a DICOM image up to the end of its pixels: it is cut or "
                   "damaged; copy it again, or put it elsewhere if it is no slice of the series"));
}

}  // namespace isoscope::source
