// A request is the path of a file; the answer describes its pixels. Lists and pixels travel in the
// shared memory.
//
// 1. Parent: send the path, the question, and what DicomScan found out about the encoding.
// 2. Child (dicom_child.h): read the file by GDCM; write the list, or the pixels, into the memory.
// 3. Parent: accept the answer only if all its numbers are possible, and copy the memory.
//
// This is the parent. Whoever wrote the file may control the child, so nothing that it says is
// used unchecked.

#include "core/formats/dicom/dicom_decoder.h"

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
#include "core/formats/dicom/dicom_module.h"

namespace isoscope::source {
namespace {

// GDCM holds the file and its pixels several times. It also allocates any length that an element
// claims to have.
DecoderProcess::Limits LimitsOf(const std::string& path, std::int64_t frame_bytes) {
  constexpr std::int64_t kMaxBytes = std::int64_t{1} << 50;  // the sums below have room
  std::error_code error;
  const std::uintmax_t file_bytes = std::filesystem::file_size(path, error);
  const std::int64_t bytes =
      frame_bytes +
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

DicomGiven GivenOf(DicomGiven given) {
  return given == DicomGiven::kMissing || given == DicomGiven::kGiven ? given : DicomGiven::kBroken;
}

// Numbers of the child, which are broken if one is not finite.
template <std::size_t kCount>
DicomNumbers<kCount> NumbersOf(const DicomNumbers<kCount>& numbers) {
  DicomNumbers<kCount> checked{.given = GivenOf(numbers.given)};
  if (!checked.is_given()) {
    return checked;
  }
  checked.values = numbers.values;
  if (!std::all_of(checked.values.begin(), checked.values.end(),
                   [](double number) { return std::isfinite(number); })) {
    return {.given = DicomGiven::kBroken};
  }
  return checked;
}

std::vector<std::uint32_t> TagsOf(const DicomTags& tags) {
  return {tags.begin(), std::find(tags.begin(), tags.end(), 0U)};
}

DicomFrame FrameOf(const DicomFrameRecord& record, std::size_t dimensions) {
  DicomFrame frame{
      .position = NumbersOf(record.position),
      .orientation = NumbersOf(record.orientation),
      .pixel_spacing = NumbersOf(record.pixel_spacing),
      .slice_spacing = NumbersOf(record.slice_spacing),
      .slope = NumbersOf(record.slope),
      .intercept = NumbersOf(record.intercept),
      .offset = std::isfinite(record.offset) ? record.offset : 0,
      .temporal_position = NumberOf(record.temporal_position),
      .echo_time = NumberOf(record.echo_time),
      .trigger_time = NumberOf(record.trigger_time),
      .segment = static_cast<std::int64_t>(std::min<std::uint64_t>(record.segment, 65535)),
      .has_own_values = record.has_own_values == 1};
  frame.indices.assign(record.indices.begin(),
                       record.indices.begin() + static_cast<std::ptrdiff_t>(dimensions));
  return frame;
}

// Reads the description of the pixels in an answer. DATA_LOSS: its numbers are impossible.
absl::StatusOr<DicomPixels> PixelsOf(const DicomAnswer& answer) {
  constexpr std::uint64_t kMaxSide = std::uint64_t{1} << 16;  // rows and columns are 16-bit
  if (answer.dims[0] > kMaxSide || answer.dims[1] > kMaxSide || answer.dims[2] < 1 ||
      answer.dims[2] > kMaxDicomFrames || answer.components > kMaxSide ||
      answer.bits_allocated > kMaxSide || answer.bits_stored > kMaxSide ||
      answer.high_bit > kMaxSide) {
    return absl::DataLossError("");
  }
  return DicomPixels{.width = static_cast<std::int64_t>(answer.dims[0]),
                     .height = static_cast<std::int64_t>(answer.dims[1]),
                     .components = answer.components,
                     .bits_allocated = answer.bits_allocated,
                     .bits_stored = answer.bits_stored,
                     .high_bit = answer.high_bit,
                     .is_signed = answer.is_signed == 1};
}

}  // namespace

DicomDecoder::DicomDecoder(std::int64_t frame_bytes)
    : frame_bytes_(frame_bytes),
      handler_(LoadDicomModule()),
      process_({.handler = handler_.ok() ? *handler_ : nullptr,
                .request_bytes = sizeof(DicomRequest),
                .answer_bytes = sizeof(DicomAnswer),
                // Memory only as far as it is used.
                .shared_bytes = std::max(static_cast<std::size_t>(frame_bytes), kDicomListBytes)}) {
}

absl::Status DicomDecoder::Start() {
  ISOSCOPE_RETURN_IF_ERROR(handler_.status());
  return process_.Start();
}

absl::StatusOr<DicomAnswer> DicomDecoder::Ask(const std::string& path, DicomRequest request,
                                              std::int64_t bytes) {
  ISOSCOPE_RETURN_IF_ERROR(handler_.status());
  if (path.size() >= request.path.size()) {
    return absl::DataLossError("its path is too long");
  }
  path.copy(request.path.data(), path.size());
  DicomAnswer answer;
  const absl::Status asked = process_.Ask(request, LimitsOf(path, bytes), &answer);
  if (!asked.ok()) {
    return absl::IsUnavailable(asked) ? absl::DataLossError(asked.message()) : asked;
  }
  return answer;
}

absl::StatusOr<DicomSegments> DicomDecoder::ReadSegments(const std::string& path,
                                                         bool is_high_throughput) {
  ISOSCOPE_ASSIGN_OR_RETURN(const DicomAnswer answer,
                            Ask(path,
                                {.question = DicomQuestion::kSegments,
                                 .is_high_throughput = is_high_throughput ? 1U : 0U},
                                kDicomListBytes));
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
                                                     bool is_high_throughput) {
  ISOSCOPE_ASSIGN_OR_RETURN(
      const DicomAnswer answer,
      Ask(path,
          {.question = DicomQuestion::kFrames, .is_high_throughput = is_high_throughput ? 1U : 0U},
          kDicomListBytes));
  if (answer.outcome != DicomOutcome::kHeader ||
      answer.segment_kind > DicomSegmentKind::kLabelMap ||
      answer.photometric > DicomPhotometric::kOther) {
    return absl::DataLossError("");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const DicomPixels pixels, PixelsOf(answer));
  DicomFrames result{.pixels = pixels,
                     .photometric = answer.photometric,
                     .has_lut = answer.has_lut == 1,
                     .group_items = static_cast<std::int64_t>(
                         std::min<std::uint64_t>(answer.group_items, kMaxDicomFrames + 1)),
                     .imager_spacing = NumbersOf(answer.imager_spacing),
                     .scanned_spacing = NumbersOf(answer.scanned_spacing),
                     .dose_scaling = NumbersOf(answer.dose_scaling),
                     .offsets = GivenOf(answer.offsets),
                     .increments = TagsOf(answer.increments),
                     .dimensions = TagsOf(answer.dimensions),
                     .segment_kind = answer.segment_kind,
                     .padding = NumberOf(answer.padding)};
  result.series.assign(answer.series.begin(),
                       std::find_if(answer.series.begin(), answer.series.end(), [](char c) {
                         return absl::string_view("0123456789.").find(c) == absl::string_view::npos;
                       }));
  for (std::uint64_t i = 0; i < answer.dims[2]; ++i) {
    DicomFrameRecord record;
    std::memcpy(&record, process_.shared() + i * sizeof(record), sizeof(record));
    result.frames.push_back(FrameOf(record, result.dimensions.size()));
  }
  return result;
}

absl::Status DicomDecoder::ReadFrame(const std::string& path, bool is_high_throughput,
                                     std::int64_t frame, const DicomPixels& pixels, char* out) {
  const std::int64_t bytes = pixels.frame_bytes();
  ISOSCOPE_CHECK(bytes > 0 && bytes <= frame_bytes_);
  ISOSCOPE_ASSIGN_OR_RETURN(const DicomAnswer answer,
                            Ask(path,
                                {.question = DicomQuestion::kFrame,
                                 .is_high_throughput = is_high_throughput ? 1U : 0U,
                                 .frame = static_cast<std::uint64_t>(frame),
                                 .frame_bytes = static_cast<std::uint64_t>(bytes)},
                                bytes));
  if (answer.outcome != DicomOutcome::kPixels) {
    return absl::DataLossError("");
  }
  const absl::StatusOr<DicomPixels> decoded = PixelsOf(answer);
  if (!decoded.ok() || !(*decoded == pixels)) {
    return absl::DataLossError("its pixels are stored otherwise than its header says");
  }
  std::copy_n(process_.shared(), bytes, out);
  return absl::OkStatus();
}

}  // namespace isoscope::source
