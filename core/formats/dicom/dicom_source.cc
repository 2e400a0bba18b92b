// A series is a folder of files, one slice each or a frame for each slice, whose names do not give
// their order. A file has the position of its first pixel (0020,0032), the directions of rows and
// columns (0020,0037), the distance of pixels (0028,0030), and the series (0020,000e). Opening a
// series takes four steps:
//
//   1. Every file with the DICOM mark is scanned (dicom_folder.h). Files that are no images are
//      left out, with one line in the log.
//   2. The series is chosen: that of the file that the user gave, or the only one in the folder.
//      From here on files of other series do not matter, damaged or not.
//   3. ITK and GDCM read the headers of its slices (dicom_slice_reader.h), not their pixels, in a
//      process of their own, which a damaged file may end (dicom_decoder.h).
//   4. The slices are sorted along their normal, the cross product of rows and columns, and must
//      make one volume: of one size, type and orientation, at one distance (within 1 %), on a
//      straight line. A slice that is missing or there twice shows as a distance that differs; with
//      --resample only one that is there twice is an error.
//
//   position (0020,0032)  10\20\30   10\20\31.5   10\20\33       normal (0, 0, 1)
//   along the normal      30         31.5         33             distance 1.5
//
// Several slices at each place are steps (dicom_steps.h): each of them must make such a volume.
//
// The pixels are decoded a slice at a time, when its rows are asked for; GDCM applies slope and
// intercept (0028,1053 and 1052).
//
// Fields of the patient must never be printed. The libraries are silent (silent_libraries.h), their
// process writes nowhere, and no message repeats one of theirs, because exceptions quote fields,
// too.

#include "core/formats/dicom/dicom_source.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/log.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/formats/dicom/dicom_decoder.h"
#include "core/formats/dicom/dicom_folder.h"
#include "core/formats/dicom/dicom_scan.h"
#include "core/formats/dicom/dicom_segmentation.h"
#include "core/formats/dicom/dicom_slice_reader.h"
#include "core/formats/dicom/dicom_stack.h"
#include "core/formats/dicom/dicom_steps.h"
#include "core/formats/dicom/dicom_storage.h"
#include "core/source/adapt/resampled_source.h"
#include "core/source/adapt/slice_source.h"

namespace isoscope::source {
namespace {

// The steps of one series.
class DicomSeries final : public VolumeSeries {
 public:
  DicomSeries(const std::string& path, const std::string& field, DicomSteps steps,
              const GridRules& rules)
      : VolumeSeries({.name = path,
                      .fields = {{.name = field}},
                      .times = steps.times,
                      .time_unit = steps.time_unit,
                      .length_unit = "mm"}),
        steps_(std::move(steps)),
        rules_(rules) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int /*field*/, int /*component*/,
                                                     int step) override {
    std::vector<DicomSlice> slices = steps_.steps[static_cast<std::size_t>(step)];
    ISOSCOPE_ASSIGN_OR_RETURN(const SliceStack stack, StackSlices(&slices, info().name, rules_));
    const absl::Status valid = volume::Validate(stack.geometry);
    if (!valid.ok()) {
      return absl::Status(valid.code(), absl::StrCat(info().name, ": ", valid.message()));
    }
    const volume::ScalarType type = slices.front().type;
    const auto patient = slices.front().is_on_patient
                             ? std::optional<volume::PatientFrame>(volume::PatientFrame())
                             : std::nullopt;
    auto reader = std::make_unique<DicomSliceReader>(std::move(slices));
    ISOSCOPE_RETURN_IF_ERROR(reader->Start());  // while this process is small
    std::unique_ptr<VolumeSource> source = MakeSliceSource(
        {.name = info().name, .geometry = stack.geometry, .type = type, .patient_frame = patient},
        std::move(reader));
    return ResampleSource(std::move(source), {{{}, {}, stack.distances}}, rules_.fill);
  }

 private:
  const DicomSteps steps_;
  const GridRules rules_;
};

// The slices of a series, in no order.
absl::StatusOr<std::vector<DicomSlice>> ReadSeries(const DicomSeriesFiles& found,
                                                   const GridRules& rules, DicomDecoder* decoder) {
  std::vector<DicomSlice> slices;
  for (const DicomSeriesFiles::File& image : found.images) {
    ISOSCOPE_RETURN_IF_ERROR(base::CheckProcessInterrupt());
    if (image.scan.content == DicomContent::kCut) {
      return DicomCutError(image.path);
    }
    ISOSCOPE_ASSIGN_OR_RETURN(std::vector<DicomSlice> read,
                              ReadDicomSlices(image.path, image.scan, decoder, rules.has_spacing));
    std::move(read.begin(), read.end(), std::back_inserter(slices));
  }
  if (!found.left_out.empty()) {
    base::LogWarning("dicom_files_without_image_left_out",
                     {{"count", found.left_out.size()},
                      {"first", base::OwnText{found.left_out.front()}},
                      {"series_slices", slices.size()}});
  }
  return slices;
}

// The segmentation that `path` names: a series may have several, each a file.
absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenSegmentation(const DicomSeriesFiles& found,
                                                               const std::string& path,
                                                               const std::string& field,
                                                               const GridRules& rules) {
  if (!found.is_of_file && found.images.size() > 1) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: a series of %d segmentations, each of which is a volume; give one of them: %s, ...",
        path, found.images.size(), found.images.front().path));
  }
  // The file may have another name in its folder.
  const std::string& file = found.is_of_file ? path : found.images.front().path;
  ISOSCOPE_ASSIGN_OR_RETURN(const DicomScan scan, ScanDicomFile(file));
  if (scan.content == DicomContent::kCut) {
    return DicomCutError(file);
  }
  return OpenDicomSegmentation(file, scan, field, rules);
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenDicomSteps(const std::string& path,
                                                             const std::string& field,
                                                             const GridRules& rules) {
  DicomDecoder decoder;
  ISOSCOPE_ASSIGN_OR_RETURN(const DicomSeriesFiles found,
                            FindDicomSeries(path, rules.dicom_series, &decoder));
  if (IsSegmentationStorage(found.images.front().scan.storage_class)) {
    return OpenSegmentation(found, path, field, rules);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<DicomSlice> slices, ReadSeries(found, rules, &decoder));
  SetDicomSampleTypes(&slices);
  ISOSCOPE_RETURN_IF_ERROR(CheckParallel(slices, path));
  ISOSCOPE_ASSIGN_OR_RETURN(DicomSteps steps, SplitDicomSteps(std::move(slices), path));
  ISOSCOPE_RETURN_IF_ERROR(StackSlices(&steps.steps.front(), path, rules).status());
  return std::make_unique<DicomSeries>(path, field, std::move(steps), rules);
}

}  // namespace isoscope::source
