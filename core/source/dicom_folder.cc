// A folder may hold several series, reports and an index besides. Every file is scanned
// (dicom_scan.h). One with the DICOM mark goes to one of three lists:
//
//   image, or cut behind its series     the files of that series (0020,000e)
//   cut before its series               may be of any series, so it stops all of them
//   no image                            left out
//
// A file that can't be opened may be a slice, so it is an error.
//
// Only for files that the scan can't read does GDCM find the series (dicom_decoder.h).

#include "core/source/dicom_folder.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <map>
#include <system_error>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"

namespace isoscope::source {
namespace {

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
  for (const std::string& file : DicomCandidatesIn(path)) {
    absl::StatusOr<DicomScan> scanned = ScanDicomFile(file);
    if (!scanned.ok()) {
      return absl::Status(
          scanned.status().code(),
          absl::StrCat(scanned.status().message(),
                       "; it may be a slice: make it readable, or put it elsewhere if it is none"));
    }
    DicomScan scan = *std::move(scanned);
    if (!scan.has_mark) {
      continue;
    }
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
    return DicomCutError(path);
  }
  if (scan.content == DicomContent::kNoImage) {
    return absl::InvalidArgumentError(
        absl::StrCat(path,
                     ": a DICOM file without an image (an index or a report, for example); give "
                     "a slice of the series, or its folder"));
  }
  return SeriesUid(path, scan, decoder);
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

std::vector<std::string> DicomCandidatesIn(const std::string& folder) {
  std::vector<std::string> files;
  std::error_code error;
  for (std::filesystem::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code unknown;  // a link to nowhere stays: it may be a slice
    if (!entry->is_directory(unknown) && !entry->is_other(unknown) &&
        entry->path().filename() != "DICOMDIR") {
      files.push_back(entry->path().string());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<std::string> DicomFilesIn(const std::string& folder) {
  std::vector<std::string> files = DicomCandidatesIn(folder);
  std::erase_if(files, [](const std::string& file) { return !IsDicomFile(file); });
  return files;
}

bool HasDicomFile(const std::string& folder) {
  const std::vector<std::string> files = DicomCandidatesIn(folder);
  return std::any_of(files.begin(), files.end(), IsDicomFile);
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

absl::StatusOr<DicomSeriesFiles> FindDicomSeries(const std::string& path, DicomDecoder* decoder) {
  const std::string folder_path = DicomFolder(path);
  ISOSCOPE_ASSIGN_OR_RETURN(Folder folder, ScanFolder(folder_path, decoder));
  if (!folder.cut.empty()) {
    return DicomCutError(folder.cut.front());
  }
  if (folder.series.empty()) {
    return absl::NotFoundError(folder.left_out.empty()
                                   ? absl::StrCat(folder_path, ": a folder without DICOM files")
                                   : absl::StrFormat("%s: none of its %d DICOM files is an image",
                                                     folder_path, folder.left_out.size()));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string uid, io::IsDirectory(path)
                                                       ? ChooseSeries(folder, path)
                                                       : SeriesOf(path, decoder));
  const auto files = folder.series.find(uid);
  if (files == folder.series.end()) {  // the file's name is not listed in the folder
    return absl::InvalidArgumentError(absl::StrCat(path, ": can't be read as a DICOM series"));
  }
  DicomSeriesFiles found;
  found.left_out = std::move(folder.left_out);
  for (const std::string& file : files->second) {
    found.images.push_back({.path = file, .scan = std::move(folder.scans.at(file))});
  }
  return found;
}

}  // namespace isoscope::source
