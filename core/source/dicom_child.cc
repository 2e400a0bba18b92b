// Here GDCM and ITK read files, in a child process that they may end. The questions:
//
//   kSlice   the header by ITK; also the pixels, with slope and intercept applied, if the parent
//            wants as many bytes as there are
//   kFrames  a list of frames by GDCM, in the shared memory: what functional groups say of all
//            frames (5200,9229), and then of each (5200,9230); in a dose grid, the offsets of
//            frames from the first one along the normal (3004,000c)
//   kFrame   the pixels of one frame by GDCM, as they are stored
//   kSegmentFrames  the frames of a segmentation, with the segment of each (0062,000a)
//   kSegments       its segments (0062,0002): number, label, colour
//
// GDCM's readers of images end the process on some segmentations, and do not know label maps. So
// for the last two only its reader of elements is used.
//
// Invariants: an answer of zeros means "not decoded", so a child that ends early gives no header.
// No text but the series UID and the labels of segments leaves the child, because texts may quote
// fields of the patient.

#include "core/source/dicom_child.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "itkGDCMImageIO.h"
#include "itkMetaDataObject.h"

#include "core/base/coding.h"
#include "core/volume/scalar_type.h"
#include "gdcmBoxRegion.h"
#include "gdcmImageReader.h"
#include "gdcmImageRegionReader.h"
#include "gdcmReader.h"
#include "gdcmSequenceOfItems.h"

namespace isoscope::source {
namespace {

void FillHeader(itk::GDCMImageIO* io, DicomAnswer* answer) {
  answer->component_type = static_cast<std::uint32_t>(io->GetComponentType());
  answer->components = io->GetNumberOfComponents();
  for (unsigned axis = 0; axis < 3; ++axis) {
    answer->dims.at(axis) = io->GetDimensions(axis);
    answer->origin.at(axis) = io->GetOrigin(axis);
    answer->spacing.at(axis) = io->GetSpacing(axis);
    const std::vector<double> direction = io->GetDirection(axis);
    for (unsigned i = 0; i < 3; ++i) {
      answer->direction.at(3 * axis + i) = direction.at(i);
    }
  }
  std::string series;
  itk::ExposeMetaData(io->GetMetaDataDictionary(), "0020|000e", series);
  std::copy_n(series.data(), std::min(series.size(), kMaxDicomUidBytes), answer->series.data());
}

// Whether a file whose pixels are not compressed has all of them. GDCM takes fewer.
bool HasAllPixels(const char* path) {
  gdcm::ImageReader reader;
  reader.SetFileName(path);
  if (!reader.Read()) {
    return false;
  }
  const gdcm::Image& image = reader.GetImage();
  const gdcm::ByteValue* const pixels = image.GetDataElement().GetByteValue();
  return pixels == nullptr || pixels->GetLength() >= image.GetBufferLength();
}

// The bytes of an element; "" if it is not there.
std::string BytesOf(const gdcm::DataSet& data, const gdcm::Tag& tag) {
  if (!data.FindDataElement(tag)) {
    return "";
  }
  const gdcm::ByteValue* const bytes = data.GetDataElement(tag).GetByteValue();
  return bytes == nullptr ? "" : std::string(bytes->GetPointer(), bytes->GetLength());
}

// Numbers as text (DS, IS).
std::vector<double> NumbersOf(const gdcm::DataSet& data, const gdcm::Tag& tag) {
  std::vector<double> numbers;
  const std::string text = BytesOf(data, tag);
  for (const absl::string_view word : absl::StrSplit(text, '\\')) {
    double number = 0;
    if (absl::SimpleAtod(word.substr(0, word.find('\0')), &number) && std::isfinite(number)) {
      numbers.push_back(number);
    }
  }
  return numbers;
}

// A binary number (FD, UL, US).
template <typename T>
MaybeDicomNumber BinaryNumber(const gdcm::DataSet& data, const gdcm::Tag& tag) {
  const std::string bytes = BytesOf(data, tag);
  if (bytes.size() != sizeof(T)) {
    return {};
  }
  const auto value = static_cast<double>(base::LoadLittleEndian<T>(bytes.data()));
  return std::isfinite(value) ? MaybeDicomNumber{.value = value, .is_set = 1} : MaybeDicomNumber{};
}

// The items of a sequence; null if it is not there. Implicit ones are parsed at each call.
gdcm::SmartPointer<gdcm::SequenceOfItems> ItemsOf(const gdcm::DataSet& data, const gdcm::Tag& tag) {
  return data.FindDataElement(tag) ? data.GetDataElement(tag).GetValueAsSQ()
                                   : gdcm::SmartPointer<gdcm::SequenceOfItems>();
}

// Calls `use` with the first item of a sequence if it is there.
template <typename Use>
void UseItem(const gdcm::DataSet& data, const gdcm::Tag& tag, const Use& use) {
  const gdcm::SmartPointer<gdcm::SequenceOfItems> items = ItemsOf(data, tag);
  if (items != nullptr && items->GetNumberOfItems() > 0) {
    use(items->GetItem(1).GetNestedDataSet());
  }
}

// The things that a data set says of a frame: that of a file, or an item of functional groups.
void FillPlane(const gdcm::DataSet& data, DicomFrameRecord* frame) {
  if (const auto position = NumbersOf(data, {0x0020, 0x0032}); position.size() == 3) {
    std::copy(position.begin(), position.end(), frame->position.begin());
    frame->has_position = 1;
  }
  if (const auto directions = NumbersOf(data, {0x0020, 0x0037}); directions.size() == 6) {
    std::copy(directions.begin(), directions.end(), frame->directions.begin());
    frame->has_directions = 1;
  }
  if (const auto spacing = NumbersOf(data, {0x0028, 0x0030}); spacing.size() == 2) {
    frame->spacing = {spacing[1], spacing[0], frame->spacing[2]};
    frame->has_spacing = 1;
  }
  if (const auto distance = NumbersOf(data, {0x0018, 0x0088}); distance.size() == 1) {
    frame->spacing[2] = std::abs(distance[0]);
  }
  if (const auto slope = NumbersOf(data, {0x0028, 0x1053}); slope.size() == 1) {
    frame->slope = slope[0];
  }
  if (const auto intercept = NumbersOf(data, {0x0028, 0x1052}); intercept.size() == 1) {
    frame->intercept = intercept[0];
  }
}

// Functional groups, of all frames or of one.
void FillGroups(const gdcm::DataSet& groups, DicomFrameRecord* frame) {
  const auto plane = [frame](const gdcm::DataSet& data) { FillPlane(data, frame); };
  for (const gdcm::Tag& tag :
       {gdcm::Tag(0x0020, 0x9113), gdcm::Tag(0x0020, 0x9116), gdcm::Tag(0x0028, 0x9110),
        gdcm::Tag(0x0028, 0x9145)}) {  // position, orientation, measures, values
    UseItem(groups, tag, plane);
  }
  const auto keep = [](const MaybeDicomNumber& found, MaybeDicomNumber* number) {
    *number = found.is_set == 1 ? found : *number;
  };
  UseItem(groups, {0x0020, 0x9111}, [&](const gdcm::DataSet& content) {
    keep(BinaryNumber<std::uint32_t>(content, {0x0020, 0x9128}), &frame->temporal_position);
  });
  UseItem(groups, {0x0018, 0x9114}, [&](const gdcm::DataSet& echo) {
    keep(BinaryNumber<double>(echo, {0x0018, 0x9082}), &frame->echo_time);
  });
  UseItem(groups, {0x0018, 0x9118}, [&](const gdcm::DataSet& cardiac) {
    keep(BinaryNumber<double>(cardiac, {0x0020, 0x9153}), &frame->trigger_time);
  });
  UseItem(groups, {0x0062, 0x000a}, [&](const gdcm::DataSet& identification) {
    const auto number = BinaryNumber<std::uint16_t>(identification, {0x0062, 0x000b});
    frame->segment = number.is_set == 1 ? static_cast<std::uint64_t>(number.value) : frame->segment;
  });
}

// The functional groups of frame `index`.
void FillOwnGroups(const gdcm::SequenceOfItems& groups, std::size_t index,
                   DicomFrameRecord* frame) {
  if (index < groups.GetNumberOfItems()) {
    FillGroups(groups.GetItem(index + 1).GetNestedDataSet(), frame);
  }
}

void SetSeries(const gdcm::DataSet& data, DicomAnswer* answer) {
  const std::string series = BytesOf(data, {0x0020, 0x000e});
  std::copy_n(series.data(), std::min(series.size(), kMaxDicomUidBytes), answer->series.data());
}

std::uint32_t StoredTypeOf(const gdcm::PixelFormat& format) {
  const auto type = [&]() -> std::optional<volume::ScalarType> {
    switch (format.GetScalarType()) {
      case gdcm::PixelFormat::UINT8:
        return volume::ScalarType::kUint8;
      case gdcm::PixelFormat::INT8:
        return volume::ScalarType::kInt8;
      case gdcm::PixelFormat::UINT16:
        return volume::ScalarType::kUint16;
      case gdcm::PixelFormat::INT16:
        return volume::ScalarType::kInt16;
      case gdcm::PixelFormat::UINT32:
        return volume::ScalarType::kUint32;
      case gdcm::PixelFormat::INT32:
        return volume::ScalarType::kInt32;
      default:
        return std::nullopt;
    }
  }();
  return type.has_value() ? static_cast<std::uint32_t>(*type) + 1 : 0;
}

// Fills the shared memory with the frames. False if the file can't be read.
bool ListFrames(const char* path, DicomAnswer* answer, char* shared) {
  gdcm::ImageRegionReader reader;
  reader.SetFileName(path);
  if (!reader.ReadInformation()) {
    return false;
  }
  const gdcm::Image& image = reader.GetImage();
  const std::size_t count = image.GetNumberOfDimensions() == 3 ? image.GetDimension(2) : 1;
  if (count > kMaxDicomFrames) {
    return false;
  }
  answer->dims = {image.GetDimension(0), image.GetDimension(1), count};
  answer->components = image.GetPixelFormat().GetSamplesPerPixel();
  answer->stored_type = StoredTypeOf(image.GetPixelFormat());
  const gdcm::DataSet& data = reader.GetFile().GetDataSet();
  SetSeries(data, answer);
  DicomFrameRecord common{};
  common.slope = 1;
  FillPlane(data, &common);
  UseItem(data, {0x5200, 0x9229},
          [&](const gdcm::DataSet& shared_groups) { FillGroups(shared_groups, &common); });
  // A dose grid has a factor of its own, and the places of its frames.
  if (const auto scaling = NumbersOf(data, {0x3004, 0x000e});
      scaling.size() == 1 && common.slope == 1) {
    common.slope = scaling[0];
  }
  const std::vector<double> offsets = NumbersOf(data, {0x3004, 0x000c});
  const std::array<double, 6>& d = common.directions;
  const std::array<double, 3> normal{d[1] * d[5] - d[2] * d[4], d[2] * d[3] - d[0] * d[5],
                                     d[0] * d[4] - d[1] * d[3]};
  const gdcm::SmartPointer<gdcm::SequenceOfItems> groups = ItemsOf(data, {0x5200, 0x9230});
  for (std::size_t i = 0; i < count; ++i) {
    DicomFrameRecord frame = common;
    if (groups != nullptr) {
      FillOwnGroups(*groups, i, &frame);
    } else {
      // One position of all frames: the others lie along the normal, if it is known how far.
      const double distance = offsets.size() == count ? offsets[i] - offsets[0]
                                                      : static_cast<double>(i) * frame.spacing[2];
      frame.has_position = frame.has_position == 1 && frame.has_directions == 1 &&
                                   (offsets.size() == count || frame.spacing[2] > 0)
                               ? 1
                               : 0;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        frame.position.at(axis) += distance * normal.at(axis);
      }
    }
    std::memcpy(shared + i * sizeof(frame), &frame, sizeof(frame));
  }
  answer->outcome = DicomOutcome::kHeader;
  return true;
}

DicomSegmentKind SegmentKindOf(const gdcm::DataSet& data) {
  const std::string text = BytesOf(data, {0x0062, 0x0001});
  const absl::string_view word = absl::StripAsciiWhitespace(text);
  return word == "BINARY"       ? DicomSegmentKind::kBinary
         : word == "FRACTIONAL" ? DicomSegmentKind::kFractional
         : word == "LABELMAP"   ? DicomSegmentKind::kLabelMap
                                : DicomSegmentKind::kUnknown;
}

// Fills the shared memory with the frames of a segmentation. False if the file can't be read.
bool ListSegmentFrames(const char* path, DicomAnswer* answer, char* shared) {
  gdcm::Reader reader;
  reader.SetFileName(path);
  if (!reader.ReadUpToTag({0x7fe0, 0x0010})) {
    return false;
  }
  const gdcm::DataSet& data = reader.GetFile().GetDataSet();
  const auto number = [&data](std::uint16_t element) {
    return static_cast<std::uint64_t>(
        BinaryNumber<std::uint16_t>(data, gdcm::Tag(0x0028, element)).value);
  };
  const std::vector<double> frames = NumbersOf(data, {0x0028, 0x0008});
  const double count = frames.size() == 1 ? frames[0] : 1;
  if (!(count >= 1 && count <= kMaxDicomFrames)) {
    return false;
  }
  answer->dims = {number(0x0011), number(0x0010), static_cast<std::uint64_t>(count)};
  answer->components = number(0x0002);
  answer->bits_allocated = static_cast<std::uint32_t>(number(0x0100));
  answer->segment_kind = SegmentKindOf(data);
  answer->padding = BinaryNumber<std::uint16_t>(data, {0x0028, 0x0120});
  SetSeries(data, answer);
  DicomFrameRecord common{};
  common.slope = 1;
  FillPlane(data, &common);
  UseItem(data, {0x5200, 0x9229},
          [&](const gdcm::DataSet& shared_groups) { FillGroups(shared_groups, &common); });
  const gdcm::SmartPointer<gdcm::SequenceOfItems> groups = ItemsOf(data, {0x5200, 0x9230});
  for (std::size_t i = 0; i < answer->dims[2]; ++i) {
    DicomFrameRecord frame = common;
    if (groups != nullptr) {
      FillOwnGroups(*groups, i, &frame);
    }
    std::memcpy(shared + i * sizeof(frame), &frame, sizeof(frame));
  }
  answer->outcome = DicomOutcome::kHeader;
  return true;
}

// Text in UTF-8, from the set of letters that the file names (0008,0005), if it is Latin 1.
std::string Utf8Of(const std::string& text, absl::string_view letters) {
  if (!absl::StrContains(letters, "ISO_IR 100") && !absl::StrContains(letters, "ISO 2022 IR 100")) {
    return text;
  }
  std::string utf8;
  for (const char letter : text) {
    const auto code = static_cast<unsigned char>(letter);
    if (code < 0x80) {
      utf8 += letter;
    } else {
      utf8 += static_cast<char>(0xc0 | (code >> 6));
      utf8 += static_cast<char>(0x80 | (code & 0x3f));
    }
  }
  return utf8;
}

DicomSegmentRecord SegmentOf(const gdcm::DataSet& item, absl::string_view letters) {
  DicomSegmentRecord segment{};
  segment.number =
      static_cast<std::uint64_t>(BinaryNumber<std::uint16_t>(item, {0x0062, 0x0004}).value);
  const std::string bytes = Utf8Of(BytesOf(item, {0x0062, 0x0005}), letters);
  const std::string label(absl::StripAsciiWhitespace(bytes.substr(0, bytes.find('\0'))));
  std::copy_n(label.data(), std::min(label.size(), segment.label.size()), segment.label.data());
  const std::string lab = BytesOf(item, {0x0062, 0x000d});
  if (lab.size() == 3 * sizeof(std::uint16_t)) {
    constexpr double kFull = 65535;
    const auto share = [&lab](std::size_t i) {
      return base::LoadLittleEndian<std::uint16_t>(lab.data() + 2 * i) / kFull;
    };
    segment.lab = {100 * share(0), 255 * share(1) - 128, 255 * share(2) - 128};
    segment.has_lab = 1;
  }
  return segment;
}

// Fills the shared memory with the segments. False if the file can't be read.
bool ListSegments(const char* path, DicomAnswer* answer, char* shared) {
  gdcm::Reader reader;
  reader.SetFileName(path);
  if (!reader.ReadUpToTag({0x5200, 0x9229})) {
    return false;
  }
  const gdcm::DataSet& data = reader.GetFile().GetDataSet();
  const std::string letters = BytesOf(data, {0x0008, 0x0005});
  answer->segment_kind = SegmentKindOf(data);
  const gdcm::SmartPointer<gdcm::SequenceOfItems> items = ItemsOf(data, {0x0062, 0x0002});
  const std::size_t count =
      items == nullptr ? 0 : std::min<std::size_t>(items->GetNumberOfItems(), kMaxDicomSegments);
  for (std::size_t i = 0; i < count; ++i) {
    const DicomSegmentRecord segment = SegmentOf(items->GetItem(i + 1).GetNestedDataSet(), letters);
    std::memcpy(shared + i * sizeof(segment), &segment, sizeof(segment));
  }
  answer->dims = {count, 0, 0};
  answer->outcome = DicomOutcome::kHeader;
  return true;
}

bool DecodeFrame(const DicomRequest& request, DicomAnswer* answer, char* shared) {
  gdcm::ImageRegionReader reader;
  reader.SetFileName(request.path.data());
  if (!reader.ReadInformation()) {
    return false;
  }
  const gdcm::Image& image = reader.GetImage();
  const auto frame = static_cast<unsigned>(request.frame);
  gdcm::BoxRegion region;
  region.SetDomain(0, image.GetDimension(0) - 1, 0, image.GetDimension(1) - 1, frame, frame);
  reader.SetRegion(region);
  if (reader.ComputeBufferLength() != request.slice_bytes) {
    return false;
  }
  std::memset(shared, 0, static_cast<std::size_t>(request.slice_bytes));
  if (!reader.ReadIntoBuffer(shared, static_cast<std::size_t>(request.slice_bytes))) {
    return false;
  }
  answer->outcome = DicomOutcome::kPixels;
  return true;
}

// Answers the questions but kSlice.
bool Answer(const DicomRequest& request, DicomAnswer* answer, char* shared) {
  switch (request.question) {
    case DicomQuestion::kFrames:
      return ListFrames(request.path.data(), answer, shared);
    case DicomQuestion::kFrame:
      return DecodeFrame(request, answer, shared);
    case DicomQuestion::kSegmentFrames:
      return ListSegmentFrames(request.path.data(), answer, shared);
    case DicomQuestion::kSegments:
      return ListSegments(request.path.data(), answer, shared);
    case DicomQuestion::kSlice:
      break;
  }
  return false;
}

}  // namespace

void DecodeDicomInChild(const void* request_bytes, void* answer_bytes, char* shared) {
  DicomRequest request;
  std::memcpy(&request, request_bytes, sizeof(request));
  DicomAnswer answer{};
  try {
    if (request.question != DicomQuestion::kSlice) {
      if (Answer(request, &answer, shared)) {
        std::memcpy(answer_bytes, &answer, sizeof(answer));
      }
      return;
    }
    const auto io = itk::GDCMImageIO::New();
    io->SetFileName(request.path.data());
    io->ReadImageInformation();
    if (io->GetNumberOfDimensions() == 3) {
      FillHeader(io, &answer);
      const std::int64_t bytes = io->GetImageSizeInBytes();
      const bool has_pixels =
          request.slice_bytes > 0 && bytes == static_cast<std::int64_t>(request.slice_bytes);
      if (has_pixels && request.is_counted == 0 && !HasAllPixels(request.path.data())) {
        std::memset(answer_bytes, 0, sizeof(answer));
        return;
      }
      if (has_pixels) {
        // GDCM does not write pixels that the file lacks. Those of the previous slice would stay
        // there.
        std::memset(shared, 0, static_cast<std::size_t>(bytes));
        io->Read(shared);
      }
      answer.outcome = has_pixels ? DicomOutcome::kPixels : DicomOutcome::kHeader;
    }
  } catch (...) {
    answer.outcome = DicomOutcome::kNotDecoded;
  }
  std::memcpy(answer_bytes, &answer, sizeof(answer));
}

}  // namespace isoscope::source
