// A request is the path of a file; the answer is its header. Pixels travel in the shared memory.
//
// 1. Parent: send the path, the size of a slice, and whether DicomScan has counted the pixels.
// 2. Child (DecodeInChild): read the header with ITK; if the size fits, decode into the memory.
// 3. Parent (Check): accept the answer only if all its numbers are possible.
// 4. Parent: copy the pixels.
//
// A file of many frames has a list of them, in the shared memory, and gives the pixels of one frame
// at a time, as they are stored.
//
// Invariants: an answer of zeros means "not decoded", so a child that ends early gives no header.
// No text but the series UID leaves the child, because texts may quote fields of the patient.

#include "core/source/dicom_decoder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "itkGDCMImageIO.h"
#include "itkMetaDataObject.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/itk_types.h"
#include "core/source/silent_libraries.h"
#include "gdcmBoxRegion.h"
#include "gdcmImageReader.h"
#include "gdcmImageRegionReader.h"
#include "gdcmSequenceOfItems.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxUidBytes = 64;

enum class Question : std::uint64_t { kSlice, kFrames, kFrame };

struct Request {
  std::array<char, 4096> path;  // ends with 0
  Question question;
  std::uint64_t frame;
  std::uint64_t slice_bytes;  // 0: no pixels
  std::uint64_t is_counted;   // 0 or 1
};

enum class Outcome : std::uint32_t { kNotDecoded = 0, kHeader = 1, kPixels = 2 };

// A number that a file may lack.
struct MaybeNumber {
  double value;
  std::uint64_t is_set;  // 1
};
// A frame, in the shared memory.
struct FrameRecord {
  std::array<double, 3> position;
  std::array<double, 6> directions;  // of rows, of columns
  std::array<double, 3> spacing;
  std::uint64_t has_position;
  std::uint64_t has_directions;
  std::uint64_t has_spacing;
  double slope;
  double intercept;
  MaybeNumber temporal_position;
  MaybeNumber echo_time;
  MaybeNumber trigger_time;
};
constexpr std::size_t kMaxFrames = 65536;
constexpr std::size_t kFramesBytes = kMaxFrames * sizeof(FrameRecord);

// Zeros are "not decoded", so that a child that stops half-way says so.
struct Answer {
  Outcome outcome;
  std::uint32_t component_type;  // ITK's number of it
  std::uint64_t components;
  std::array<std::uint64_t, 3> dims;  // the last one counts frames
  std::array<double, 3> origin;
  std::array<double, 3> spacing;
  std::array<double, 9> direction;        // of x, of y, of z
  std::array<char, kMaxUidBytes> series;  // filled up with 0
  std::uint32_t stored_type;              // volume::ScalarType and 1, of frames; 0: none
};

// ---- The child. -------------------------------------------------------------------------------

void FillHeader(itk::GDCMImageIO* io, Answer* answer) {
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
  std::copy_n(series.data(), std::min(series.size(), kMaxUidBytes), answer->series.data());
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
MaybeNumber BinaryNumber(const gdcm::DataSet& data, const gdcm::Tag& tag) {
  const std::string bytes = BytesOf(data, tag);
  if (bytes.size() != sizeof(T)) {
    return {};
  }
  const auto value = static_cast<double>(base::LoadLittleEndian<T>(bytes.data()));
  return std::isfinite(value) ? MaybeNumber{.value = value, .is_set = 1} : MaybeNumber{};
}

// Calls `use` with an item of a sequence, the first one being 1, if it is there.
template <typename Use>
void UseItem(const gdcm::DataSet& data, const gdcm::Tag& tag, std::size_t item, const Use& use) {
  if (!data.FindDataElement(tag)) {
    return;
  }
  const gdcm::SmartPointer<gdcm::SequenceOfItems> items = data.GetDataElement(tag).GetValueAsSQ();
  if (items != nullptr && item <= items->GetNumberOfItems()) {
    use(items->GetItem(item).GetNestedDataSet());
  }
}

// The things that a data set says of a frame: that of a file, or an item of functional groups.
void FillPlane(const gdcm::DataSet& data, FrameRecord* frame) {
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
void FillGroups(const gdcm::DataSet& groups, FrameRecord* frame) {
  const auto plane = [frame](const gdcm::DataSet& data) { FillPlane(data, frame); };
  for (const gdcm::Tag& tag :
       {gdcm::Tag(0x0020, 0x9113), gdcm::Tag(0x0020, 0x9116), gdcm::Tag(0x0028, 0x9110),
        gdcm::Tag(0x0028, 0x9145)}) {  // position, orientation, measures, values
    UseItem(groups, tag, 1, plane);
  }
  const auto keep = [](const MaybeNumber& found, MaybeNumber* number) {
    *number = found.is_set == 1 ? found : *number;
  };
  UseItem(groups, {0x0020, 0x9111}, 1, [&](const gdcm::DataSet& content) {
    keep(BinaryNumber<std::uint32_t>(content, {0x0020, 0x9128}), &frame->temporal_position);
  });
  UseItem(groups, {0x0018, 0x9114}, 1, [&](const gdcm::DataSet& echo) {
    keep(BinaryNumber<double>(echo, {0x0018, 0x9082}), &frame->echo_time);
  });
  UseItem(groups, {0x0018, 0x9118}, 1, [&](const gdcm::DataSet& cardiac) {
    keep(BinaryNumber<double>(cardiac, {0x0020, 0x9153}), &frame->trigger_time);
  });
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
bool ListFrames(const char* path, Answer* answer, char* shared) {
  gdcm::ImageRegionReader reader;
  reader.SetFileName(path);
  if (!reader.ReadInformation()) {
    return false;
  }
  const gdcm::Image& image = reader.GetImage();
  const std::size_t count = image.GetNumberOfDimensions() == 3 ? image.GetDimension(2) : 1;
  if (count > kMaxFrames) {
    return false;
  }
  answer->dims = {image.GetDimension(0), image.GetDimension(1), count};
  answer->components = image.GetPixelFormat().GetSamplesPerPixel();
  answer->stored_type = StoredTypeOf(image.GetPixelFormat());
  const gdcm::DataSet& data = reader.GetFile().GetDataSet();
  const std::string series = BytesOf(data, {0x0020, 0x000e});
  std::copy_n(series.data(), std::min(series.size(), kMaxUidBytes), answer->series.data());
  FrameRecord common{};
  common.slope = 1;
  FillPlane(data, &common);
  UseItem(data, {0x5200, 0x9229}, 1,
          [&](const gdcm::DataSet& groups) { FillGroups(groups, &common); });
  // A dose grid has a factor of its own, and the places of its frames.
  if (const auto scaling = NumbersOf(data, {0x3004, 0x000e});
      scaling.size() == 1 && common.slope == 1) {
    common.slope = scaling[0];
  }
  const std::vector<double> offsets = NumbersOf(data, {0x3004, 0x000c});
  const std::array<double, 6>& d = common.directions;
  const std::array<double, 3> normal{d[1] * d[5] - d[2] * d[4], d[2] * d[3] - d[0] * d[5],
                                     d[0] * d[4] - d[1] * d[3]};
  const bool has_groups = data.FindDataElement(gdcm::Tag(0x5200, 0x9230));
  for (std::size_t i = 0; i < count; ++i) {
    FrameRecord frame = common;
    if (has_groups) {
      UseItem(data, {0x5200, 0x9230}, i + 1,
              [&](const gdcm::DataSet& groups) { FillGroups(groups, &frame); });
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
  answer->outcome = Outcome::kHeader;
  return true;
}

bool DecodeFrame(const Request& request, Answer* answer, char* shared) {
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
  answer->outcome = Outcome::kPixels;
  return true;
}

void DecodeInChild(const void* request_bytes, void* answer_bytes, char* shared) {
  Request request;
  std::memcpy(&request, request_bytes, sizeof(request));
  Answer answer{};
  try {
    if (request.question != Question::kSlice) {
      const bool is_decoded = request.question == Question::kFrames
                                  ? ListFrames(request.path.data(), &answer, shared)
                                  : DecodeFrame(request, &answer, shared);
      if (is_decoded) {
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
      answer.outcome = has_pixels ? Outcome::kPixels : Outcome::kHeader;
    }
  } catch (...) {
    answer.outcome = Outcome::kNotDecoded;
  }
  std::memcpy(answer_bytes, &answer, sizeof(answer));
}

// ---- The parent. ------------------------------------------------------------------------------

// GDCM holds the file and its pixels several times. It also allocates any length that an element
// claims to have.
DecoderProcess::Limits LimitsOf(const std::string& path, std::int64_t slice_bytes) {
  constexpr std::int64_t kMaxBytes = std::int64_t{1} << 50;  // the sums below have room
  std::error_code error;
  const std::uintmax_t file_bytes = std::filesystem::file_size(path, error);
  const std::int64_t bytes =
      slice_bytes +
      (error ? 0 : static_cast<std::int64_t>(std::min<std::uintmax_t>(file_bytes, kMaxBytes)));
  const std::int64_t seconds = 60 + bytes / base::kMiB;
  return {.cpu_seconds = seconds,
          .clock_seconds = 10 * seconds,  // for slow disks and busy machines
          .memory_bytes = 256 * base::kMiB + 8 * bytes};
}

// A number of the child; not set if it is not, or is none.
std::optional<double> NumberOf(const MaybeNumber& number) {
  return number.is_set == 1 && std::isfinite(number.value) ? std::optional<double>(number.value)
                                                           : std::nullopt;
}

DicomFrame FrameOf(const FrameRecord& record) {
  const auto vector = [](const auto& numbers, std::size_t first,
                         bool is_set) -> std::optional<math::Vec3d> {
    const math::Vec3d v{numbers.at(first), numbers.at(first + 1), numbers.at(first + 2)};
    return is_set && math::IsFinite(v) ? std::optional<math::Vec3d>(v) : std::nullopt;
  };
  return {.position = vector(record.position, 0, record.has_position == 1),
          .along_row = vector(record.directions, 0, record.has_directions == 1),
          .along_column = vector(record.directions, 3, record.has_directions == 1),
          .spacing = vector(record.spacing, 0, record.has_spacing == 1),
          .slope = std::isfinite(record.slope) ? record.slope : 1,
          .intercept = std::isfinite(record.intercept) ? record.intercept : 0,
          .temporal_position = NumberOf(record.temporal_position),
          .echo_time = NumberOf(record.echo_time),
          .trigger_time = NumberOf(record.trigger_time)};
}

// An attacker may control the child, so every number of the answer is checked.
absl::StatusOr<DicomHeader> Check(const Answer& answer, const std::string& path) {
  constexpr std::uint64_t kMaxSide = std::uint64_t{1} << 16;  // rows and columns are 16-bit
  constexpr std::uint64_t kMaxCount = std::uint64_t{1} << 31;
  const auto is_finite = [](double number) { return std::isfinite(number); };
  if ((answer.outcome != Outcome::kHeader && answer.outcome != Outcome::kPixels) ||
      answer.component_type > static_cast<std::uint32_t>(itk::IOComponentEnum::LDOUBLE) ||
      answer.components > kMaxCount || answer.dims[0] > kMaxSide || answer.dims[1] > kMaxSide ||
      answer.dims[2] > kMaxCount ||
      !std::all_of(answer.origin.begin(), answer.origin.end(), is_finite) ||
      !std::all_of(answer.spacing.begin(), answer.spacing.end(), is_finite) ||
      !std::all_of(answer.direction.begin(), answer.direction.end(), is_finite)) {
    return absl::DataLossError("");
  }
  DicomHeader header;
  header.width = static_cast<std::int64_t>(answer.dims[0]);
  header.height = static_cast<std::int64_t>(answer.dims[1]);
  header.frames = static_cast<std::int64_t>(answer.dims[2]);
  header.components = static_cast<std::int64_t>(answer.components);
  header.type = ScalarTypeOf(static_cast<itk::IOComponentEnum>(answer.component_type), path);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    header.origin[static_cast<int>(axis)] = answer.origin[axis];
    header.spacing[static_cast<int>(axis)] = answer.spacing[axis];
    const double* column = answer.direction.data() + 3 * axis;
    header.direction.columns[axis] = {column[0], column[1], column[2]};
  }
  header.series.assign(answer.series.begin(),
                       std::find(answer.series.begin(), answer.series.end(), '\0'));
  return header;
}

}  // namespace

DicomDecoder::DicomDecoder(std::int64_t slice_bytes)
    : slice_bytes_(slice_bytes),
      process_({.handler = DecodeInChild,
                .request_bytes = sizeof(Request),
                .answer_bytes = sizeof(Answer),
                // Memory only as far as it is used.
                .shared_bytes = std::max(static_cast<std::size_t>(slice_bytes), kFramesBytes)}) {
  SilenceImageLibraries();  // first, so that its lock is free when the process forks
}

absl::Status DicomDecoder::Start() { return process_.Start(); }

absl::StatusOr<DicomHeader> DicomDecoder::ReadHeader(const std::string& path) {
  return Read(path, false, nullptr);
}

absl::StatusOr<DicomHeader> DicomDecoder::ReadSlice(const std::string& path, bool is_counted,
                                                    char* out) {
  ISOSCOPE_CHECK(slice_bytes_ > 0);
  return Read(path, is_counted, out);
}

absl::StatusOr<DicomFrames> DicomDecoder::ReadFrames(const std::string& path) {
  Request request{};
  request.question = Question::kFrames;
  if (path.size() >= request.path.size()) {
    return absl::DataLossError("its path is too long");
  }
  path.copy(request.path.data(), path.size());
  Answer answer{};
  const absl::Status asked = process_.Ask(request, LimitsOf(path, kFramesBytes), &answer);
  if (!asked.ok()) {
    return absl::IsUnavailable(asked) ? absl::DataLossError(asked.message()) : asked;
  }
  constexpr std::uint64_t kMaxSide = std::uint64_t{1} << 16;
  if (answer.outcome != Outcome::kHeader || answer.dims[0] > kMaxSide ||
      answer.dims[1] > kMaxSide || answer.dims[2] > kMaxFrames || answer.components > kMaxSide ||
      answer.stored_type > static_cast<std::uint32_t>(volume::ScalarType::kFloat64) + 1) {
    return absl::DataLossError("");
  }
  DicomFrames result{.width = static_cast<std::int64_t>(answer.dims[0]),
                     .height = static_cast<std::int64_t>(answer.dims[1]),
                     .components = static_cast<std::int64_t>(answer.components)};
  if (answer.stored_type > 0) {
    result.stored_type = static_cast<volume::ScalarType>(answer.stored_type - 1);
  }
  result.series.assign(answer.series.begin(),
                       std::find_if(answer.series.begin(), answer.series.end(), [](char c) {
                         return absl::string_view("0123456789.").find(c) == absl::string_view::npos;
                       }));
  for (std::uint64_t i = 0; i < answer.dims[2]; ++i) {
    FrameRecord record;
    std::memcpy(&record, process_.shared() + i * sizeof(record), sizeof(record));
    result.frames.push_back(FrameOf(record));
  }
  return result;
}

absl::Status DicomDecoder::ReadFrame(const std::string& path, std::int64_t frame, char* out) {
  Request request{};
  request.question = Question::kFrame;
  if (path.size() >= request.path.size()) {
    return absl::DataLossError("its path is too long");
  }
  path.copy(request.path.data(), path.size());
  request.frame = static_cast<std::uint64_t>(frame);
  request.slice_bytes = static_cast<std::uint64_t>(slice_bytes_);
  Answer answer{};
  const absl::Status asked = process_.Ask(request, LimitsOf(path, slice_bytes_), &answer);
  if (!asked.ok()) {
    return absl::IsUnavailable(asked) ? absl::DataLossError(asked.message()) : asked;
  }
  if (answer.outcome != Outcome::kPixels) {
    return absl::DataLossError("");
  }
  std::copy_n(process_.shared(), slice_bytes_, out);
  return absl::OkStatus();
}

absl::StatusOr<DicomHeader> DicomDecoder::Read(const std::string& path, bool is_counted,
                                               char* out) {
  Request request{};
  if (path.size() >= request.path.size()) {
    return absl::DataLossError("its path is too long");
  }
  path.copy(request.path.data(), path.size());
  const std::int64_t pixel_bytes = out != nullptr ? slice_bytes_ : 0;
  request.slice_bytes = static_cast<std::uint64_t>(pixel_bytes);
  request.is_counted = is_counted ? 1 : 0;
  Answer answer{};
  const absl::Status asked = process_.Ask(request, LimitsOf(path, pixel_bytes), &answer);
  if (!asked.ok()) {
    return absl::IsUnavailable(asked) ? absl::DataLossError(asked.message()) : asked;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(DicomHeader header, Check(answer, path));
  header.has_pixels = out != nullptr && answer.outcome == Outcome::kPixels;
  if (header.has_pixels) {
    std::copy_n(process_.shared(), slice_bytes_, out);
  }
  return header;
}

}  // namespace isoscope::source
