// A slice is a file, or a frame of a file of many. ITK gives the header of a file, and its pixels
// with slope and intercept (0028,1053 and 1052) applied. Frames have slopes of their own. So GDCM
// gives their pixels as they are stored, in the tail of the slice's memory, and they are rescaled
// here from the first one on (rescale.h). Four pixels of 16 bits, two bytes a letter:
//
//   decoded    ....0123
//   rescaled   00112233     as float32
//
// The file is scanned again before its pixels are read: it may have been cut since.
//
// Messages never repeat one of the libraries, because those quote fields of the patient.

#include "core/source/dicom_slice_reader.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "core/base/status_macros.h"
#include "core/math/vec.h"
#include "core/source/dicom_storage.h"
#include "core/source/rescale.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {
namespace {

bool IsHighThroughputJpeg2000(const std::string& transfer_syntax) {
  constexpr absl::string_view kSyntaxes = "1.2.840.10008.1.2.4.20";  // and 1, 2 or 3
  return transfer_syntax.size() == kSyntaxes.size() + 1 &&
         absl::StartsWith(transfer_syntax, kSyntaxes);
}

// Returns an error of `code` for a file that the decoder refused (DATA_LOSS). Other errors keep
// their code.
absl::Status NotDecodable(absl::StatusCode code, const absl::Status& error, const std::string& path,
                          const DicomScan& scan) {
  if (!absl::IsDataLoss(error)) {
    return absl::Status(error.code(), absl::StrCat(path, ": ", error.message()));
  }
  if (IsHighThroughputJpeg2000(scan.transfer_syntax)) {
    return absl::Status(
        code, absl::StrFormat("%s: its pixels are High-Throughput JPEG 2000 (transfer syntax %s), "
                              "which GDCM does not know: convert it, as decompress() of pydicom 3 "
                              "with pylibjpeg-openjpeg does",
                              path, scan.transfer_syntax));
  }
  return absl::Status(
      code, absl::StrFormat(
                "%s: can't be decoded as a DICOM image (transfer syntax %s%s%s): "
                "damaged, or of a kind that is not known; convert it (gdcmconv --raw), "
                "or put it elsewhere if it is no slice of the series",
                path, scan.transfer_syntax.empty() ? "unknown" : scan.transfer_syntax,
                error.message().empty() ? "" : "; the process that decodes: ", error.message()));
}

// The slices of a file of many frames.
absl::StatusOr<std::vector<DicomSlice>> ReadFrameSlices(const std::string& path,
                                                        const DicomScan& scan,
                                                        DicomDecoder* decoder) {
  const absl::StatusOr<DicomFrames> read = decoder->ReadFrames(path);
  if (!read.ok()) {
    return NotDecodable(absl::StatusCode::kInvalidArgument, read.status(), path, scan);
  }
  if (read->components != 1 || !read->stored_type.has_value()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d frames of %d components a sample%s; expected greyscale integers of "
                        "8, 16 or 32 bits",
                        path, read->frames.size(), read->components,
                        read->components > 1 ? " (colour images)" : ""));
  }
  const bool is_rescaled =
      std::any_of(read->frames.begin(), read->frames.end(),
                  [](const DicomFrame& frame) { return frame.slope != 1 || frame.intercept != 0; });
  std::vector<DicomSlice> slices;
  for (const DicomFrame& frame : read->frames) {
    const auto number = static_cast<std::int64_t>(slices.size());
    if (!frame.position || !frame.along_row || !frame.along_column || !frame.spacing) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: frame %d of %d has no %s: not a volume, or without the distance of its frames", path,
          number, read->frames.size(),
          !frame.spacing                            ? "pixel spacing"
          : !frame.along_row || !frame.along_column ? "orientation"
                                                    : "position"));
    }
    DicomSlice slice;
    slice.path = path;
    slice.frame = number;
    slice.width = read->width;
    slice.height = read->height;
    slice.stored_type = *read->stored_type;
    slice.is_rescaled = is_rescaled;
    slice.rescaling = {.slope = frame.slope, .intercept = frame.intercept};
    slice.type = is_rescaled ? RescaledType(slice.stored_type) : slice.stored_type;
    slice.origin = *frame.position;
    slice.spacing = {frame.spacing->x, frame.spacing->y, 1};
    slice.direction.columns = {*frame.along_row, *frame.along_column,
                               math::Cross(*frame.along_row, *frame.along_column)};
    slice.position = math::Dot(slice.origin, slice.direction.columns[2]);
    slice.moment = {.temporal_position = frame.temporal_position,
                    .echo_time = frame.echo_time,
                    .trigger_time = frame.trigger_time,
                    .instance_number = static_cast<double>(number)};
    slices.push_back(std::move(slice));
  }
  return slices;
}

absl::StatusOr<DicomSlice> ReadSliceHeader(const std::string& path, const DicomScan& scan,
                                           DicomDecoder* decoder) {
  const absl::StatusOr<DicomHeader> header = decoder->ReadHeader(path);
  if (!header.ok()) {
    return NotDecodable(absl::StatusCode::kInvalidArgument, header.status(), path, scan);
  }
  if (header->components != 1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d components a sample (a colour image); expected greyscale", path,
                        header->components));
  }
  DicomSlice slice;
  slice.path = path;
  ISOSCOPE_ASSIGN_OR_RETURN(slice.type, header->type);
  slice.width = header->width;
  slice.height = header->height;
  slice.origin = header->origin;
  slice.spacing = header->spacing;
  slice.direction = header->direction;
  slice.position = math::Dot(slice.origin, slice.direction.columns[2]);
  slice.moment = scan.moment;
  return slice;
}

// As they are decoded.
std::int64_t SliceBytes(const DicomSlice& slice) {
  return slice.width * slice.height *
         static_cast<std::int64_t>(
             volume::SizeOf(slice.frame >= 0 ? slice.stored_type : slice.type));
}

}  // namespace

absl::StatusOr<std::vector<DicomSlice>> ReadDicomSlices(const std::string& path,
                                                        const DicomScan& scan,
                                                        DicomDecoder* decoder) {
  // On these GDCM ends the process.
  if (IsWholeSlideStorage(scan.storage_class)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: a whole-slide image: its %d frames are tiles of planes, without places in a volume; "
        "export a stack of its focal planes as TIFF",
        path, scan.frames));
  }
  if (scan.has_float_pixels) {
    return absl::InvalidArgumentError(absl::StrCat(
        path,
        ": a parametric map whose pixels are floats, which GDCM does not read: convert it "
        "to NRRD or NIfTI"));
  }
  if (scan.frames > 1) {
    return ReadFrameSlices(path, scan, decoder);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(DicomSlice slice, ReadSliceHeader(path, scan, decoder));
  return std::vector<DicomSlice>{std::move(slice)};
}

DicomSliceReader::DicomSliceReader(std::vector<DicomSlice> slices)
    : slices_(std::move(slices)), decoder_(SliceBytes(slices_.front())) {}

absl::Status DicomSliceReader::ReadSlice(std::int64_t z, char* out) {
  const DicomSlice& slice = slices_[static_cast<std::size_t>(z)];
  ISOSCOPE_ASSIGN_OR_RETURN(const DicomScan scan, ScanDicomFile(slice.path));
  if (scan.content != DicomContent::kImage) {
    return DicomCutError(slice.path);
  }
  if (slice.frame >= 0) {
    return ReadFrame(slice, scan, out);
  }
  const absl::StatusOr<DicomHeader> header = decoder_.ReadSlice(slice.path, scan.is_counted, out);
  if (!header.ok()) {
    return NotDecodable(absl::StatusCode::kDataLoss, header.status(), slice.path, scan);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::ScalarType type, header->type);
  if (!header->has_pixels || header->width != slice.width || header->height != slice.height ||
      type != slice.type || header->components != 1) {
    return absl::DataLossError(
        absl::StrCat(slice.path, ": changed while it was read; start again"));
  }
  return absl::OkStatus();
}

absl::Status DicomSliceReader::ReadFrame(const DicomSlice& slice, const DicomScan& scan,
                                         char* out) {
  const auto count = static_cast<std::size_t>(slice.width * slice.height);
  char* const stored =
      out + count * (volume::SizeOf(slice.type) - volume::SizeOf(slice.stored_type));
  const absl::Status decoded = decoder_.ReadFrame(slice.path, slice.frame, stored);
  if (!decoded.ok()) {
    return NotDecodable(absl::StatusCode::kDataLoss, decoded, slice.path, scan);
  }
  if (slice.is_rescaled) {
    Rescale(slice.stored_type, count, slice.rescaling.slope, slice.rescaling.intercept, stored,
            out);
  }
  return absl::OkStatus();
}

}  // namespace isoscope::source
