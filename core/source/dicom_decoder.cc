// A request is the path of a file; the answer is its header. Pixels travel in the shared memory.
//
// 1. Parent: send the path, the size of a slice, and whether DicomScan has counted the pixels.
// 2. Child (dicom_child.h): read the header with ITK; if the size fits, decode into the memory.
// 3. Parent (Check): accept the answer only if all its numbers are possible.
// 4. Parent: copy the pixels.
//
// A file of many frames has a list of them, in the shared memory, and gives the pixels of one frame
// at a time, as they are stored.
//
// This is the parent. Whoever wrote the file may control the child, so nothing that it says is
// used unchecked.

#include "core/source/dicom_decoder.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <utility>

#include "absl/strings/string_view.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/dicom_module.h"
#include "core/source/itk_types.h"
#include "core/source/silent_libraries.h"

namespace isoscope::source {
namespace {

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
std::optional<double> NumberOf(const MaybeDicomNumber& number) {
  return number.is_set == 1 && std::isfinite(number.value) ? std::optional<double>(number.value)
                                                           : std::nullopt;
}

DicomFrame FrameOf(const DicomFrameRecord& record) {
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
          .trigger_time = NumberOf(record.trigger_time),
          .segment = static_cast<std::int64_t>(std::min<std::uint64_t>(record.segment, 65535))};
}

// An attacker may control the child, so every number of the answer is checked.
absl::StatusOr<DicomHeader> Check(const DicomAnswer& answer, const std::string& path) {
  constexpr std::uint64_t kMaxSide = std::uint64_t{1} << 16;  // rows and columns are 16-bit
  constexpr std::uint64_t kMaxCount = std::uint64_t{1} << 31;
  const auto is_finite = [](double number) { return std::isfinite(number); };
  if ((answer.outcome != DicomOutcome::kHeader && answer.outcome != DicomOutcome::kPixels) ||
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
      handler_(LoadDicomModule()),
      process_({.handler = handler_.ok() ? *handler_ : nullptr,
                .request_bytes = sizeof(DicomRequest),
                .answer_bytes = sizeof(DicomAnswer),
                // Memory only as far as it is used.
                .shared_bytes = std::max({static_cast<std::size_t>(slice_bytes), kDicomFramesBytes,
                                          kDicomSegmentsBytes})}) {
  SilenceImageLibraries();  // first, so that its lock is free when the process forks
}

absl::Status DicomDecoder::Start() {
  ISOSCOPE_RETURN_IF_ERROR(handler_.status());
  return process_.Start();
}

absl::StatusOr<DicomHeader> DicomDecoder::ReadHeader(const std::string& path) {
  return Read(path, false, nullptr);
}

absl::StatusOr<DicomHeader> DicomDecoder::ReadSlice(const std::string& path, bool is_counted,
                                                    char* out) {
  ISOSCOPE_CHECK(slice_bytes_ > 0);
  return Read(path, is_counted, out);
}

absl::StatusOr<DicomAnswer> DicomDecoder::Ask(const std::string& path, DicomRequest request,
                                              std::int64_t bytes) {
  ISOSCOPE_RETURN_IF_ERROR(handler_.status());
  if (path.size() >= request.path.size()) {
    return absl::DataLossError("its path is too long");
  }
  path.copy(request.path.data(), path.size());
  DicomAnswer answer{};
  const absl::Status asked = process_.Ask(request, LimitsOf(path, bytes), &answer);
  if (!asked.ok()) {
    return absl::IsUnavailable(asked) ? absl::DataLossError(asked.message()) : asked;
  }
  return answer;
}

absl::StatusOr<DicomFrames> DicomDecoder::ReadFrames(const std::string& path) {
  return ReadFrames(path, DicomQuestion::kFrames);
}

absl::StatusOr<DicomFrames> DicomDecoder::ReadSegmentFrames(const std::string& path) {
  return ReadFrames(path, DicomQuestion::kSegmentFrames);
}

absl::StatusOr<DicomSegments> DicomDecoder::ReadSegments(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const DicomAnswer answer,
                            Ask(path, {.question = DicomQuestion::kSegments}, kDicomSegmentsBytes));
  if (answer.outcome != DicomOutcome::kHeader || answer.dims[0] > kMaxDicomSegments ||
      answer.segment_kind > DicomSegmentKind::kLabelMap) {
    return absl::DataLossError("");
  }
  DicomSegments result{.kind = answer.segment_kind};
  for (std::uint64_t i = 0; i < answer.dims[0]; ++i) {
    DicomSegmentRecord record;
    std::memcpy(&record, process_.shared() + i * sizeof(record), sizeof(record));
    DicomSegment segment{
        .number = static_cast<std::int64_t>(std::min<std::uint64_t>(record.number, 65535))};
    segment.label.assign(record.label.begin(),
                         std::find(record.label.begin(), record.label.end(), '\0'));
    const math::Vec3d lab{record.lab[0], record.lab[1], record.lab[2]};
    if (record.has_lab == 1 && math::IsFinite(lab)) {
      segment.cielab = lab;
    }
    result.segments.push_back(std::move(segment));
  }
  return result;
}

absl::StatusOr<DicomFrames> DicomDecoder::ReadFrames(const std::string& path,
                                                     DicomQuestion question) {
  ISOSCOPE_ASSIGN_OR_RETURN(const DicomAnswer answer,
                            Ask(path, {.question = question}, kDicomSegmentsBytes));
  constexpr std::uint64_t kMaxSide = std::uint64_t{1} << 16;
  if (answer.outcome != DicomOutcome::kHeader || answer.dims[0] > kMaxSide ||
      answer.dims[1] > kMaxSide || answer.dims[2] > kMaxDicomFrames ||
      answer.components > kMaxSide || answer.bits_allocated > kMaxSide ||
      answer.segment_kind > DicomSegmentKind::kLabelMap ||
      answer.stored_type > static_cast<std::uint32_t>(volume::ScalarType::kFloat64) + 1) {
    return absl::DataLossError("");
  }
  DicomFrames result{.width = static_cast<std::int64_t>(answer.dims[0]),
                     .height = static_cast<std::int64_t>(answer.dims[1]),
                     .components = static_cast<std::int64_t>(answer.components),
                     .segment_kind = answer.segment_kind,
                     .bits_allocated = answer.bits_allocated,
                     .padding = NumberOf(answer.padding)};
  if (answer.stored_type > 0) {
    result.stored_type = static_cast<volume::ScalarType>(answer.stored_type - 1);
  }
  result.series.assign(answer.series.begin(),
                       std::find_if(answer.series.begin(), answer.series.end(), [](char c) {
                         return absl::string_view("0123456789.").find(c) == absl::string_view::npos;
                       }));
  for (std::uint64_t i = 0; i < answer.dims[2]; ++i) {
    DicomFrameRecord record;
    std::memcpy(&record, process_.shared() + i * sizeof(record), sizeof(record));
    result.frames.push_back(FrameOf(record));
  }
  return result;
}

absl::Status DicomDecoder::ReadFrame(const std::string& path, std::int64_t frame, char* out) {
  ISOSCOPE_ASSIGN_OR_RETURN(const DicomAnswer answer,
                            Ask(path,
                                {.question = DicomQuestion::kFrame,
                                 .frame = static_cast<std::uint64_t>(frame),
                                 .slice_bytes = static_cast<std::uint64_t>(slice_bytes_)},
                                slice_bytes_));
  if (answer.outcome != DicomOutcome::kPixels) {
    return absl::DataLossError("");
  }
  std::copy_n(process_.shared(), slice_bytes_, out);
  return absl::OkStatus();
}

absl::StatusOr<DicomHeader> DicomDecoder::Read(const std::string& path, bool is_counted,
                                               char* out) {
  const std::int64_t pixel_bytes = out != nullptr ? slice_bytes_ : 0;
  ISOSCOPE_ASSIGN_OR_RETURN(const DicomAnswer answer,
                            Ask(path,
                                {.question = DicomQuestion::kSlice,
                                 .slice_bytes = static_cast<std::uint64_t>(pixel_bytes),
                                 .is_counted = is_counted ? 1U : 0U},
                                pixel_bytes));
  ISOSCOPE_ASSIGN_OR_RETURN(DicomHeader header, Check(answer, path));
  header.has_pixels = out != nullptr && answer.outcome == DicomOutcome::kPixels;
  if (header.has_pixels) {
    std::copy_n(process_.shared(), slice_bytes_, out);
  }
  return header;
}

}  // namespace isoscope::source
