// A request is the path of a file; the answer is its header. Pixels travel in the shared memory.
//
// 1. Parent: send the path, the size of a slice, and whether DicomScan has counted the pixels.
// 2. Child (DecodeInChild): read the header with ITK; if the size fits, decode into the memory.
// 3. Parent (Check): accept the answer only if all its numbers are possible.
// 4. Parent: copy the pixels.
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
#include "itkGDCMImageIO.h"
#include "itkMetaDataObject.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/itk_types.h"
#include "core/source/silent_libraries.h"
#include "gdcmImageReader.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxUidBytes = 64;

struct Request {
  std::array<char, 4096> path;  // ends with 0
  std::uint64_t slice_bytes;    // 0: no pixels
  std::uint64_t is_counted;     // 0 or 1
};

enum class Outcome : std::uint32_t { kNotDecoded = 0, kHeader = 1, kPixels = 2 };

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

void DecodeInChild(const void* request_bytes, void* answer_bytes, char* shared) {
  Request request;
  std::memcpy(&request, request_bytes, sizeof(request));
  Answer answer{};
  try {
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
                .shared_bytes = static_cast<std::size_t>(slice_bytes)}) {
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
