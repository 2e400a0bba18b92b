// A slice is a file, or a frame of a file of many. Its pixels are read as they are stored into the
// tail of the slice's memory. There they are cleaned and rescaled from the first one on
// (dicom_values.h). Four pixels of 16 bits, two bytes a letter:
//
//   stored     ....0123
//   rescaled   00112233     as float32
//
// Pixels that are not compressed are read from the file itself: DicomScan knows where they lie. The
// decoder reads the others.
//
// The file is scanned again before its pixels are read: it may have been cut since.
//
// Messages never repeat one of the libraries, because those quote fields of the patient.

#include "core/formats/dicom/dicom_slice_reader.h"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "core/base/status_macros.h"
#include "core/formats/dicom/dicom_geometry.h"
#include "core/formats/dicom/dicom_storage.h"
#include "core/formats/dicom/dicom_values.h"
#include "core/io/file.h"
#include "core/math/vec.h"

namespace isoscope::source {
namespace {

// Returns an error of `code` for a file that the decoder refused (DATA_LOSS). Other errors keep
// their code.
absl::Status NotDecodable(absl::StatusCode code, const absl::Status& error, const std::string& path,
                          const DicomScan& scan) {
  if (!absl::IsDataLoss(error)) {
    return absl::Status(error.code(), absl::StrCat(path, ": ", error.message()));
  }
  return absl::Status(
      code, absl::StrFormat(
                "%s: can't be decoded as a DICOM image (transfer syntax %s%s%s): "
                "damaged, or of a kind that is not known; convert it (gdcmconv --raw), "
                "or put it elsewhere if it is no slice of the series",
                path, scan.transfer_syntax.empty() ? "unknown" : scan.transfer_syntax,
                error.message().empty() ? "" : "; the process that decodes: ", error.message()));
}

// Files that hold no slices of this kind, by what the scan found.
absl::Status CheckKind(const std::string& path, const DicomScan& scan) {
  if (IsWholeSlideStorage(scan.storage_class)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: a whole-slide image: its %d frames are tiles of planes, without places in a volume; "
        "export a stack of its focal planes as TIFF",
        path, scan.frames));
  }
  if (scan.is_mosaic) {
    return absl::InvalidArgumentError(
        absl::StrCat(path,
                     ": a mosaic: the slices of a volume side by side in one image, as scanners of "
                     "Siemens and United Imaging write them; convert it to NIfTI (dcm2niix)"));
  }
  if (scan.has_float_pixels) {
    return absl::InvalidArgumentError(absl::StrCat(
        path,
        ": a parametric map whose pixels are floats, which GDCM does not read: convert it "
        "to NRRD or NIfTI"));
  }
  constexpr auto kMaxFrames = static_cast<std::int64_t>(kMaxDicomFrames);
  if (scan.frames > kMaxFrames) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d frames; at most %d", path, scan.frames, kMaxFrames));
  }
  return absl::OkStatus();
}

// ---- Slope and intercept. -----------------------------------------------------------------------

absl::Status NotRescalable(const std::string& path, std::int64_t frame, absl::string_view what) {
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: %s%s; correct it in the file", path,
                      frame < 0 ? std::string() : absl::StrFormat("frame %d: ", frame), what));
}

// `frame`: for messages; -1 if it is the only one.
absl::StatusOr<Rescaling> RescalingOf(const DicomFrames& file, const DicomFrame& frame,
                                      const DicomScan& scan, const std::string& path,
                                      std::int64_t number) {
  if (IsDoseStorage(scan.storage_class)) {
    const DicomNumbers<1>& scaling = file.dose_scaling;
    if (scaling.is_given() && scaling.value() > 0) {
      return Rescaling{.slope = scaling.value()};
    }
    return NotRescalable(
        path, -1,
        scaling.is_missing() ? "no dose grid scaling (3004,000e), without which pixels are no dose"
        : scaling.is_given()
            ? absl::StrFormat("a dose grid scaling (3004,000e) of %g", scaling.value())
            : "its dose grid scaling (3004,000e) is there, but is no number");
  }
  if (frame.slope.given == DicomGiven::kBroken) {
    return NotRescalable(path, number, "its rescale slope (0028,1053) is there, but is no number");
  }
  if (frame.intercept.given == DicomGiven::kBroken) {
    return NotRescalable(path, number,
                         "its rescale intercept (0028,1052) is there, but is no number");
  }
  const Rescaling rescaling{.slope = frame.slope.is_given() ? frame.slope.value() : 1,
                            .intercept = frame.intercept.value()};
  if (frame.slope.is_missing() && rescaling.intercept != 0) {
    return NotRescalable(path, number,
                         absl::StrFormat("a rescale intercept (0028,1052) of %g without a slope "
                                         "(0028,1053)",
                                         rescaling.intercept));
  }
  if (frame.intercept.is_missing() && rescaling.slope != 1) {
    return NotRescalable(path, number,
                         absl::StrFormat("a rescale slope (0028,1053) of %g without an intercept "
                                         "(0028,1052)",
                                         rescaling.slope));
  }
  return rescaling;
}

// A group that stands with one frame stands with each: without it a frame has other values than
// those beside it (PS3.3, C.7.6.16.1.2).
absl::Status CheckOwnValues(const DicomFrames& file, const std::string& path) {
  const auto has_own = [](const DicomFrame& frame) { return frame.has_own_values; };
  const std::vector<DicomFrame>& frames = file.frames;
  const auto count = std::count_if(frames.begin(), frames.end(), has_own);
  if (count == 0 || count == static_cast<std::ptrdiff_t>(frames.size())) {
    return absl::OkStatus();
  }
  const auto without = std::find_if_not(frames.begin(), frames.end(), has_own) - frames.begin();
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: %d of its %d frames have a slope and an intercept of their own (0028,9145), frame %d "
      "has none, so that its values are not known; add it to each frame (1 and 0 where none is "
      "applied)",
      path, count, frames.size(), without));
}

// Rescaled values of CT are HU unless the file says another type (PS3.3, C.8.2.1).
std::string ValueUnitOf(const DicomScan& scan) {
  constexpr absl::string_view kCt = "1.2.840.10008.5.1.4.1.1.2";
  return scan.value_unit.empty() && scan.storage_class == kCt ? "HU" : scan.value_unit;
}

absl::Status CheckTable(const DicomFrames& file, const std::string& path) {
  return !file.has_lut ? absl::OkStatus()
                       : absl::InvalidArgumentError(absl::StrCat(
                             path,
                             ": a modality table (0028,3000) gives its pixels other values: apply "
                             "it (apply_modality_lut of pydicom), save the result, and remove it"));
}

// ---- Pixels. ------------------------------------------------------------------------------------

// Reads the pixels of a frame as they are stored.
absl::Status ReadStored(const DicomSlice& slice, const DicomScan& scan, DicomDecoder* decoder,
                        char* stored) {
  const DicomPixels& pixels = slice.values.pixels;
  const std::int64_t frame = std::max<std::int64_t>(slice.frame, 0);
  const std::int64_t bytes = pixels.frame_bytes();
  if (scan.is_counted) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                              io::OpenRandomAccessFile(slice.path));
    return file->ReadAt(scan.pixels_offset + frame * bytes, static_cast<std::size_t>(bytes),
                        stored);
  }
  const absl::Status decoded =
      decoder->ReadFrame(slice.path, scan.is_high_throughput(), frame, pixels, stored);
  return decoded.ok() ? decoded
                      : NotDecodable(absl::StatusCode::kDataLoss, decoded, slice.path, scan);
}

// Returns true if the file that was scanned again has the pixels that it had.
bool IsAsBefore(const DicomSlice& slice, const DicomScan& scan) {
  const DicomPixels& pixels = slice.values.pixels;
  return !scan.is_counted || (scan.width == pixels.width && scan.height == pixels.height &&
                              scan.bits_allocated == pixels.bits_allocated &&
                              scan.frames > slice.frame && (slice.frame >= 0 || scan.frames == 1));
}

// Scanners write a slope of 0 for slices in which nothing was counted. Then no pixel may differ
// from 0, because a slope that is lost would make them one value.
absl::Status CheckBlank(const DicomSlice& slice, const DicomScan& scan) {
  const auto bytes = static_cast<std::size_t>(slice.values.pixels.frame_bytes());
  DicomDecoder decoder(slice.values.pixels.frame_bytes());
  std::string stored(bytes, '\0');
  ISOSCOPE_RETURN_IF_ERROR(ReadStored(slice, scan, &decoder, stored.data()));
  return stored.find_first_not_of('\0') == std::string::npos
             ? absl::OkStatus()
             : NotRescalable(slice.path, slice.frame,
                             "its rescale slope (0028,1053) is 0, which makes all samples one "
                             "value, but its pixels differ from 0");
}

DicomMoment MomentOf(const DicomFrame& frame, const DicomScan& scan, std::int64_t number,
                     const std::vector<double>& ranks) {
  const bool is_ranked = !ranks.empty();
  const double rank = is_ranked ? ranks[static_cast<std::size_t>(number)] : 0;
  DicomMoment moment = scan.moment;
  moment.temporal_position =
      frame.temporal_position ? frame.temporal_position : moment.temporal_position;
  moment.echo_time = frame.echo_time ? frame.echo_time : moment.echo_time;
  moment.trigger_time = frame.trigger_time ? frame.trigger_time : moment.trigger_time;
  moment.dimension_rank = is_ranked ? std::optional<double>(rank) : std::nullopt;
  // Frames come in the order of their files.
  moment.instance_number = scan.moment.instance_number.value_or(0) * double{kMaxDicomFrames} +
                           (is_ranked ? rank : static_cast<double>(number));
  return moment;
}

}  // namespace

absl::StatusOr<std::vector<DicomSlice>> ReadDicomSlices(const std::string& path,
                                                        const DicomScan& scan,
                                                        DicomDecoder* decoder, bool has_spacing) {
  ISOSCOPE_RETURN_IF_ERROR(CheckKind(path, scan));
  const absl::StatusOr<DicomFrames> file = decoder->ReadFrames(path, scan.is_high_throughput());
  if (!file.ok()) {
    return NotDecodable(absl::StatusCode::kInvalidArgument, file.status(), path, scan);
  }
  if (const absl::Status known = CheckDicomPixels(file->pixels, file->photometric); !known.ok()) {
    return absl::Status(known.code(), absl::StrCat(path, ": ", known.message()));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckTable(*file, path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<DicomPlane> planes,
                            PlanesOfDicomFrames(*file, scan.storage_class, path, has_spacing));
  ISOSCOPE_RETURN_IF_ERROR(CheckOwnValues(*file, path));
  const std::vector<double> ranks = RanksOfDicomFrames(*file);
  const bool has_frames = planes.size() > 1;
  std::vector<DicomSlice> slices;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    const DicomPlane& plane = planes[i];
    DicomSlice slice;
    slice.path = path;
    slice.frame = has_frames ? static_cast<std::int64_t>(i) : -1;
    slice.width = file->pixels.width;
    slice.height = file->pixels.height;
    slice.origin = plane.origin;
    slice.spacing = plane.spacing;
    slice.has_spacing = plane.has_spacing;
    slice.direction = plane.direction;
    slice.position = plane.position;
    slice.values = {.pixels = file->pixels, .is_frame = has_frames};
    slice.is_on_patient = !IsUltrasoundVolumeStorage(scan.storage_class);
    slice.is_decoded = !scan.is_counted;
    slice.frame_of_reference = scan.frame_of_reference;
    slice.value_unit = ValueUnitOf(scan);
    ISOSCOPE_ASSIGN_OR_RETURN(slice.values.rescaling,
                              RescalingOf(*file, file->frames[i], scan, path, slice.frame));
    if (slice.values.rescaling.slope == 0) {
      ISOSCOPE_RETURN_IF_ERROR(CheckBlank(slice, scan));
    }
    slice.moment = has_frames ? MomentOf(file->frames[i], scan, static_cast<std::int64_t>(i), ranks)
                              : scan.moment;
    slices.push_back(std::move(slice));
  }
  return slices;
}

void SetDicomSampleTypes(std::vector<DicomSlice>* slices) {
  std::vector<DicomValues> values;
  values.reserve(slices->size());
  for (const DicomSlice& slice : *slices) {
    values.push_back(slice.values);
  }
  const volume::ScalarType type = DicomSampleType(values);
  for (DicomSlice& slice : *slices) {
    slice.type = type;
  }
}

DicomSliceReader::DicomSliceReader(std::vector<DicomSlice> slices)
    : slices_(std::move(slices)),
      decoder_(std::max_element(slices_.begin(), slices_.end(),
                                [](const DicomSlice& a, const DicomSlice& b) {
                                  return a.values.pixels.frame_bytes() <
                                         b.values.pixels.frame_bytes();
                                })
                   ->values.pixels.frame_bytes()) {}

absl::Status DicomSliceReader::Start() {
  return std::any_of(slices_.begin(), slices_.end(),
                     [](const DicomSlice& slice) { return slice.is_decoded; })
             ? decoder_.Start()
             : absl::OkStatus();
}

absl::Status DicomSliceReader::ReadSlice(std::int64_t z, char* out) {
  const DicomSlice& slice = slices_[static_cast<std::size_t>(z)];
  const DicomPixels& pixels = slice.values.pixels;
  ISOSCOPE_ASSIGN_OR_RETURN(const DicomScan scan, ScanDicomFile(slice.path));
  if (scan.content != DicomContent::kImage) {
    return DicomCutError(slice.path);
  }
  if (!IsAsBefore(slice, scan)) {
    return absl::DataLossError(
        absl::StrCat(slice.path, ": changed while it was read; start again"));
  }
  const auto count = static_cast<std::size_t>(slice.width * slice.height);
  char* const stored =
      out + count * volume::SizeOf(slice.type) - static_cast<std::size_t>(pixels.frame_bytes());
  ISOSCOPE_RETURN_IF_ERROR(ReadStored(slice, scan, &decoder_, stored));
  CleanDicomPixels(pixels, count, stored);
  WriteDicomSamples(slice.values, slice.type, count, stored, out);
  return absl::OkStatus();
}

}  // namespace isoscope::source
