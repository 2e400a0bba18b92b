// A series is a folder of files, one slice each or a frame for each slice, whose names do not give
// their order. A file has the position of its first pixel (0020,0032), the directions of rows and
// columns (0020,0037), the distance of pixels (0028,0030), and the series (0020,000e). Opening a
// series takes four steps:
//
//   1. Every file with the DICOM mark is scanned (dicom_scan.h). Files that are no images are left
//      out, with one line in the log.
//   2. The series is chosen: that of the file that the user gave, or the only one in the folder.
//      From here on files of other series do not matter, damaged or not.
//   3. ITK and GDCM read the headers of its slices, not their pixels, in a process of their own,
//      which a damaged file may end (dicom_decoder.h).
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

#include "core/source/dicom_source.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <map>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/log.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/dicom_decoder.h"
#include "core/source/dicom_scan.h"
#include "core/source/dicom_stack.h"
#include "core/source/dicom_steps.h"
#include "core/source/resampled_source.h"
#include "core/source/rescale.h"
#include "core/source/series_format.h"
#include "core/source/slice_source.h"

namespace isoscope::source {
namespace {

using Slice = DicomSlice;

absl::Status CutError(const std::string& path) {
  return absl::InvalidArgumentError(
      absl::StrCat(path,
                   ": does not hold a DICOM image up to the end of its pixels: it is cut or "
                   "damaged; copy it again, or put it elsewhere if it is no slice of the series"));
}

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
absl::StatusOr<std::vector<Slice>> ReadFrameSlices(const std::string& path, const DicomScan& scan,
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
  std::vector<Slice> slices;
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
    Slice slice;
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

absl::StatusOr<Slice> ReadSliceHeader(const std::string& path, const DicomScan& scan,
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
  Slice slice;
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

class DicomReader final : public SliceReader {
 public:
  // `slices` are alike, and there is one.
  explicit DicomReader(std::vector<Slice> slices)
      : slices_(std::move(slices)), decoder_(SliceBytes(slices_.front())) {}

  absl::Status Start() { return decoder_.Start(); }

  absl::Status ReadSlice(std::int64_t z, char* out) override {
    const Slice& slice = slices_[static_cast<std::size_t>(z)];
    ISOSCOPE_ASSIGN_OR_RETURN(const DicomScan scan, ScanDicomFile(slice.path));
    if (scan.content != DicomContent::kImage) {
      return CutError(slice.path);
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

 private:
  // As they are decoded.
  static std::int64_t SliceBytes(const Slice& slice) {
    return slice.width * slice.height *
           static_cast<std::int64_t>(
               volume::SizeOf(slice.frame >= 0 ? slice.stored_type : slice.type));
  }

  absl::Status ReadFrame(const Slice& slice, const DicomScan& scan, char* out) {
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

  const std::vector<Slice> slices_;
  DicomDecoder decoder_;
};

// The steps of one series.
class DicomSeries final : public VolumeSeries {
 public:
  DicomSeries(std::string path, const std::string& field, DicomSteps steps, const GridRules& rules)
      : path_(std::move(path)), fields_{{.name = field}}, steps_(std::move(steps)), rules_(rules) {}

  [[nodiscard]] const std::string& name() const override { return path_; }
  [[nodiscard]] const std::vector<SourceField>& fields() const override { return fields_; }
  [[nodiscard]] const std::vector<double>& times() const override { return steps_.times; }
  [[nodiscard]] const std::string& time_unit() const override { return steps_.time_unit; }
  [[nodiscard]] const std::string& length_unit() const override { return length_unit_; }

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int /*field*/, int /*component*/,
                                                     int step) override {
    std::vector<Slice> slices = steps_.steps[static_cast<std::size_t>(step)];
    ISOSCOPE_ASSIGN_OR_RETURN(const SliceStack stack, StackSlices(&slices, path_, rules_));
    const absl::Status valid = volume::Validate(stack.geometry);
    if (!valid.ok()) {
      return absl::Status(valid.code(), absl::StrCat(path_, ": ", valid.message()));
    }
    const volume::ScalarType type = slices.front().type;
    auto reader = std::make_unique<DicomReader>(std::move(slices));
    ISOSCOPE_RETURN_IF_ERROR(reader->Start());  // while this process is small
    std::unique_ptr<VolumeSource> source =
        MakeSliceSource(stack.geometry, type, path_, std::move(reader), volume::PatientFrame());
    return ResampleSource(std::move(source), {{{}, {}, stack.distances}}, rules_.fill);
  }

 private:
  const std::string path_;
  const std::vector<SourceField> fields_;
  const DicomSteps steps_;
  const GridRules rules_;
  const std::string length_unit_ = "mm";
};

// The files of a folder that carry the DICOM mark.
struct Folder {
  std::map<std::string, std::vector<std::string>> series;  // images by their series' UID
  std::map<std::string, DicomScan> scans;                  // of the images, by path
  std::vector<std::string> cut;                            // of an unknown series
  std::vector<std::string> left_out;                       // no images
};

// Returns the series of a file. GDCM finds it if the scan did not read the elements.
std::string SeriesUid(const std::string& path, const DicomScan& scan, DicomDecoder* decoder) {
  if (!scan.series.empty() || scan.content != DicomContent::kImage) {
    return scan.series;
  }
  const absl::StatusOr<DicomHeader> header = decoder->ReadHeader(path);
  return header.ok() ? header->series : "";  // its slice will show that it can't be read
}

absl::StatusOr<Folder> ScanFolder(const std::string& path, DicomDecoder* decoder) {
  Folder folder;
  for (const std::string& file : DicomFilesIn(path)) {
    ISOSCOPE_ASSIGN_OR_RETURN(DicomScan scan, ScanDicomFile(file));
    if (scan.content == DicomContent::kNoImage) {
      folder.left_out.push_back(file);
    } else if (scan.content == DicomContent::kCut && scan.series.empty()) {
      folder.cut.push_back(file);
    } else {
      folder.series[SeriesUid(file, scan, decoder)].push_back(file);
      folder.scans.emplace(file, std::move(scan));
    }
  }
  return folder;
}

std::vector<DicomSeriesEntry> EntriesOf(const Folder& folder) {
  std::vector<DicomSeriesEntry> entries;
  for (const auto& [uid, files] : folder.series) {
    const DicomScan& first = folder.scans.at(files.front());
    DicomSeriesEntry entry{.uid = uid,
                           .number = first.series_number,
                           .description = first.description,
                           .width = first.width,
                           .height = first.height,
                           .images = 0,
                           .first_file = files.front()};
    for (const std::string& file : files) {
      entry.images += folder.scans.at(file).frames;
    }
    entries.push_back(std::move(entry));
  }
  std::stable_sort(
      entries.begin(), entries.end(),
      [](const DicomSeriesEntry& a, const DicomSeriesEntry& b) { return a.number < b.number; });
  return entries;
}

std::string ListedSeries(const std::vector<DicomSeriesEntry>& entries) {
  return absl::StrJoin(entries, "; ", [](std::string* out, const DicomSeriesEntry& entry) {
    absl::StrAppend(out, DescribeDicomSeries(entry));
  });
}

// The one series of a folder.
absl::StatusOr<std::string> ChooseSeries(const Folder& folder, const std::string& path) {
  if (folder.series.size() == 1) {
    return folder.series.begin()->first;
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: %d series; choose one by --series N, or give a file of it: %s", path,
                      folder.series.size(), ListedSeries(EntriesOf(folder))));
}

// The series that a file belongs to.
absl::StatusOr<std::string> SeriesOf(const std::string& path, DicomDecoder* decoder) {
  ISOSCOPE_ASSIGN_OR_RETURN(const DicomScan scan, ScanDicomFile(path));
  if (scan.content == DicomContent::kCut) {
    return CutError(path);
  }
  if (scan.content == DicomContent::kNoImage) {
    return absl::InvalidArgumentError(
        absl::StrCat(path,
                     ": a DICOM file without an image (an index or a report, for example); give "
                     "a slice of the series, or its folder"));
  }
  return SeriesUid(path, scan, decoder);
}

// The slices of the series that `path` names, in no order.
absl::StatusOr<std::vector<Slice>> FindSeries(const std::string& path) {
  const std::string folder_path = DicomFolder(path);
  DicomDecoder decoder;
  ISOSCOPE_ASSIGN_OR_RETURN(const Folder folder, ScanFolder(folder_path, &decoder));
  if (!folder.cut.empty()) {
    return CutError(folder.cut.front());
  }
  if (folder.series.empty()) {
    return absl::NotFoundError(folder.left_out.empty()
                                   ? absl::StrCat(folder_path, ": a folder without DICOM files")
                                   : absl::StrFormat("%s: none of its %d DICOM files is an image",
                                                     folder_path, folder.left_out.size()));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string uid, io::IsDirectory(path)
                                                       ? ChooseSeries(folder, path)
                                                       : SeriesOf(path, &decoder));
  const auto files = folder.series.find(uid);
  if (files == folder.series.end()) {  // the file's name is not listed in the folder
    return absl::InvalidArgumentError(absl::StrCat(path, ": can't be read as a DICOM series"));
  }
  std::vector<Slice> slices;
  for (const std::string& file : files->second) {
    const DicomScan& scan = folder.scans.at(file);
    if (scan.content == DicomContent::kCut) {
      return CutError(file);
    }
    if (scan.frames > 1) {
      ISOSCOPE_ASSIGN_OR_RETURN(std::vector<Slice> frames, ReadFrameSlices(file, scan, &decoder));
      std::move(frames.begin(), frames.end(), std::back_inserter(slices));
      continue;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(Slice slice, ReadSliceHeader(file, scan, &decoder));
    slices.push_back(std::move(slice));
  }
  if (!folder.left_out.empty()) {
    base::LogWarning("dicom_files_without_image_left_out", {{"count", folder.left_out.size()},
                                                            {"first", folder.left_out.front()},
                                                            {"series_slices", slices.size()}});
  }
  return slices;
}

}  // namespace

bool IsDicomFile(const std::string& path) {
  constexpr std::int64_t kMarkOffset = 128;
  const auto file = io::OpenRandomAccessFile(path);
  char mark[4];
  return file.ok() && (*file)->size_bytes() >= kMarkOffset + 4 &&
         (*file)->ReadAt(kMarkOffset, sizeof(mark), mark).ok() &&
         std::memcmp(mark, "DICM", sizeof(mark)) == 0;
}

std::vector<std::string> DicomFilesIn(const std::string& folder) {
  std::vector<std::string> files;
  std::error_code error;
  for (std::filesystem::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string path = entry->path().string();
    if (entry->path().filename() != "DICOMDIR" && IsDicomFile(path)) {
      files.push_back(path);
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::string DicomFolder(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return io::IsDirectory(path) ? path : slash == std::string::npos ? "." : path.substr(0, slash);
}

std::string DescribeDicomSeries(const DicomSeriesEntry& entry) {
  return absl::StrFormat(
      "%d%s, %d %s of %d x %d", entry.number,
      entry.description.empty() ? "" : absl::StrCat(" \"", entry.description, "\""), entry.images,
      entry.images == 1 ? "image" : "images", entry.width, entry.height);
}

absl::StatusOr<std::vector<DicomSeriesEntry>> ListDicomSeries(const std::string& folder) {
  DicomDecoder decoder;
  ISOSCOPE_ASSIGN_OR_RETURN(const Folder found, ScanFolder(folder, &decoder));
  if (found.series.empty()) {
    return absl::NotFoundError(absl::StrCat(folder, ": a folder without a DICOM image"));
  }
  return EntriesOf(found);
}

absl::StatusOr<std::string> FindDicomSeriesFile(const std::string& path,
                                                const std::string& choice) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<DicomSeriesEntry> entries,
                            ListDicomSeries(DicomFolder(path)));
  std::vector<DicomSeriesEntry> chosen;
  std::copy_if(entries.begin(), entries.end(), std::back_inserter(chosen),
               [&](const DicomSeriesEntry& entry) {
                 return entry.uid == choice || absl::StrCat(entry.number) == choice;
               });
  if (chosen.size() == 1) {
    return chosen.front().first_file;
  }
  return absl::InvalidArgumentError(
      chosen.empty()
          ? absl::StrFormat("%s: no series %s; it holds %s", path, base::Printable(choice),
                            ListedSeries(entries))
          : absl::StrFormat(
                "%s: %d series of number %s; choose one by its UID: %s", path, chosen.size(),
                choice,
                absl::StrJoin(chosen, "; ", [](std::string* out, const DicomSeriesEntry& entry) {
                  absl::StrAppend(out, entry.uid, ": ", DescribeDicomSeries(entry));
                })));
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenDicomSteps(const std::string& path,
                                                             const std::string& field,
                                                             const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<Slice> slices, FindSeries(path));
  ISOSCOPE_ASSIGN_OR_RETURN(DicomSteps steps, SplitDicomSteps(std::move(slices), path));
  ISOSCOPE_RETURN_IF_ERROR(StackSlices(&steps.steps.front(), path, rules).status());
  return std::make_unique<DicomSeries>(path, field, std::move(steps), rules);
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenDicomSeries(const std::string& path,
                                                              const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VolumeSeries> series,
                            OpenDicomSteps(path, "volume", rules));
  return OpenOnlyVolume(*series, path, false);
}

}  // namespace isoscope::source
