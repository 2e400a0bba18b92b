// A folder may hold several series, reports and an index besides. Every file is scanned
// (dicom_scan.h). A DICOM file goes to one of three lists:
//
//   image, or cut behind its series     the files of that series (0020,000e)
//   cut before its series               may be of any series, so it stops all of them
//   no image                            left out
//
// A file that can't be opened may be a slice, so it is an error.
//
// A folder without an image may have folders below, as discs have: DICOM/PATIENT/STUDY/SERIES/IM1.
// The standard allows eight components. The index (DICOMDIR) is not read: it may name files that
// are not there, and leave others out.
//
// Only for files that the scan can't read does GDCM find the series (dicom_decoder.h).

#include "core/formats/dicom/dicom_folder.h"

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <iterator>
#include <map>
#include <set>
#include <system_error>
#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include <sys/stat.h>

#include "core/base/printable.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/formats/dicom/dicom_storage.h"
#include "core/io/file.h"

namespace isoscope::source {
namespace {

constexpr int kMaxDepth = 8;  // of folders; DICOM PS3.10, section 8.5
constexpr std::size_t kMaxFiles = 100000;
constexpr std::size_t kMaxFolders = 20000;
constexpr std::size_t kMaxProbed = 10000;

// ---- Files. -------------------------------------------------------------------------------------

// The place that a path names.
struct Place {
  std::string folder;
  bool is_file = false;   // a file of that folder
  bool is_index = false;  // the index of that folder
};

Place PlaceOf(const std::string& path) {
  if (io::IsDirectory(path)) {
    return {.folder = path};
  }
  const std::size_t slash = path.rfind('/');
  Place place{.folder = slash == std::string::npos ? "."
                        : slash == 0               ? "/"
                                                   : path.substr(0, slash)};
  place.is_index = IsDicomIndex(path);
  place.is_file = !place.is_index;
  return place;
}

// The folders in a folder, by name, without hidden ones. Those that can't be read have no files.
std::vector<std::string> FoldersIn(const std::string& folder) {
  std::vector<std::string> folders;
  std::error_code error;
  for (std::filesystem::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code unknown;
    if (entry->is_directory(unknown) && !absl::StartsWith(entry->path().filename().string(), ".")) {
      folders.push_back(entry->path().string());
    }
  }
  std::sort(folders.begin(), folders.end());
  return folders;
}

// Calls `use` with the candidates of each folder below, until it returns false: those nearer to the
// top first, each folder once, also if links lead to it twice. False if there are too many folders.
bool ForFoldersBelow(const std::string& top,
                     absl::FunctionRef<bool(std::vector<std::string>)> use) {
  std::set<std::pair<dev_t, ino_t>> seen;
  const auto is_new = [&seen](const std::string& folder) {
    struct stat status {};
    return stat(folder.c_str(), &status) == 0 && seen.emplace(status.st_dev, status.st_ino).second;
  };
  is_new(top);
  std::vector<std::string> level = FoldersIn(top);
  for (int depth = 1; depth <= kMaxDepth && !level.empty(); ++depth) {
    std::vector<std::string> next;
    for (const std::string& folder : level) {
      if (base::ProcessInterrupt().is_cancelled()) {
        return true;  // the next scan of a file says so
      }
      if (!is_new(folder)) {
        continue;
      }
      if (seen.size() > kMaxFolders) {
        return false;
      }
      if (!use(DicomCandidatesIn(folder))) {
        return true;
      }
      std::vector<std::string> folders = FoldersIn(folder);
      std::move(folders.begin(), folders.end(), std::back_inserter(next));
    }
    level = std::move(next);
  }
  return true;
}

absl::StatusOr<std::vector<std::string>> CandidatesBelow(const std::string& top) {
  std::vector<std::string> files;
  const bool are_all = ForFoldersBelow(top, [&files](std::vector<std::string> more) {
    std::move(more.begin(), more.end(), std::back_inserter(files));
    return files.size() <= kMaxFiles;
  });
  if (!are_all || files.size() > kMaxFiles) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("%s: more than %d %s below this folder; give the folder of the series", top,
                        are_all ? kMaxFiles : kMaxFolders, are_all ? "files" : "folders"));
  }
  return files;
}

// Returns true if a folder has an image, or a DICOM file that may be one: those below do not count
// then.
bool HasImage(const std::vector<std::string>& files) {
  return std::any_of(files.begin(), files.end(), [](const std::string& file) {
    const absl::StatusOr<DicomScan> scan = ScanDicomFile(file);
    return !scan.ok() || (scan->is_dicom && scan->content != DicomContent::kNoImage);
  });
}

// The files among which a series is looked for.
absl::StatusOr<std::vector<std::string>> CandidatesOf(const Place& place) {
  std::vector<std::string> files = DicomCandidatesIn(place.folder);
  if (place.is_file || (!place.is_index && HasImage(files))) {
    return files;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<std::string> below, CandidatesBelow(place.folder));
  std::move(below.begin(), below.end(), std::back_inserter(files));
  return files;
}

// ---- Series. ------------------------------------------------------------------------------------

// The DICOM files of a place.
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
  const absl::StatusOr<DicomFrames> frames = decoder->ReadFrames(path);
  return frames.ok() ? frames->series : "";  // its slice will show that it can't be read
}

absl::StatusOr<Folder> ScanFolder(const Place& place, DicomDecoder* decoder) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> files, CandidatesOf(place));
  Folder folder;
  for (const std::string& file : files) {
    absl::StatusOr<DicomScan> scanned = ScanDicomFile(file);
    if (absl::IsCancelled(scanned.status())) {
      return scanned.status();
    }
    if (!scanned.ok()) {
      return absl::Status(
          scanned.status().code(),
          absl::StrCat(scanned.status().message(),
                       "; it may be a slice: make it readable, or put it elsewhere if it is none"));
    }
    DicomScan scan = *std::move(scanned);
    if (!scan.is_dicom) {
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

// The folder below `top` that has all files; "": `top` itself.
std::string CommonFolder(const std::string& top, const std::vector<std::string>& files) {
  const auto parent = [](const std::string& file) {
    return std::filesystem::path(file).parent_path();
  };
  std::filesystem::path common = parent(files.front());
  for (const std::string& file : files) {
    const std::filesystem::path other = parent(file);
    std::filesystem::path both;
    for (auto a = common.begin(), b = other.begin();
         a != common.end() && b != other.end() && *a == *b; ++a, ++b) {
      both /= *a;
    }
    common = both;
  }
  const std::string below = common.lexically_relative(top).string();
  return below == "." || absl::StartsWith(below, "..") ? "" : below;
}

std::vector<SeriesEntry> EntriesOf(const Folder& folder, const std::string& top) {
  std::vector<SeriesEntry> entries;
  for (const auto& [uid, files] : folder.series) {
    const DicomScan& first = folder.scans.at(files.front());
    SeriesEntry entry{.uid = uid,
                      .number = first.series_number,
                      .description = first.description,
                      .width = first.width,
                      .height = first.height,
                      .images = 0,
                      .first_file = files.front(),
                      .folder = CommonFolder(top, files)};
    for (const std::string& file : files) {
      entry.images += folder.scans.at(file).frames;
    }
    entries.push_back(std::move(entry));
  }
  std::stable_sort(entries.begin(), entries.end(),
                   [](const SeriesEntry& a, const SeriesEntry& b) { return a.number < b.number; });
  return entries;
}

std::string ListedSeries(const std::vector<SeriesEntry>& entries) {
  return absl::StrJoin(entries, "; ", [](std::string* out, const SeriesEntry& entry) {
    absl::StrAppend(out, DescribeDicomSeries(entry));
  });
}

// The series of that number or UID.
absl::StatusOr<SeriesEntry> ChosenOf(const std::vector<SeriesEntry>& entries,
                                     const std::string& path, const std::string& choice) {
  std::vector<SeriesEntry> chosen;
  std::copy_if(entries.begin(), entries.end(), std::back_inserter(chosen),
               [&](const SeriesEntry& entry) {
                 return entry.uid == choice || absl::StrCat(entry.number) == choice;
               });
  if (chosen.size() == 1) {
    return std::move(chosen.front());
  }
  return absl::InvalidArgumentError(
      chosen.empty()
          ? absl::StrFormat("%s: no series %s; it holds %s", path, base::Printable(choice),
                            ListedSeries(entries))
          : absl::StrFormat(
                "%s: %d series of number %s; choose one by its UID: %s", path, chosen.size(),
                choice, absl::StrJoin(chosen, "; ", [](std::string* out, const SeriesEntry& entry) {
                  absl::StrAppend(out, entry.uid, ": ", DescribeDicomSeries(entry));
                })));
}

// The one series of a folder.
absl::StatusOr<std::string> OnlySeries(const Folder& folder, const std::string& path,
                                       const std::string& top) {
  if (folder.series.size() == 1) {
    return folder.series.begin()->first;
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: %d series; choose one by --series N, or give a file of it: %s", path,
                      folder.series.size(), ListedSeries(EntriesOf(folder, top))));
}

// A file that is cut may be a slice of a series that has others in its folder.
absl::Status CheckCut(const std::vector<std::string>& cut, const std::vector<std::string>& series) {
  const auto parent = [](const std::string& file) {
    return std::filesystem::path(file).parent_path();
  };
  std::set<std::filesystem::path> folders;
  for (const std::string& file : series) {
    folders.insert(parent(file));
  }
  const auto found = std::find_if(cut.begin(), cut.end(), [&](const std::string& file) {
    return folders.count(parent(file)) > 0;
  });
  return found == cut.end() ? absl::OkStatus() : DicomCutError(*found);
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
                     ": a DICOM file without an image (a report, for example); give a slice of the "
                     "series, or its folder"));
  }
  return SeriesUid(path, scan, decoder);
}

}  // namespace

bool IsDicomFile(const std::string& path) {
  const auto file = io::OpenRandomAccessFile(path);
  return file.ok() && HasDicomStart(**file);
}

bool IsDicomIndex(const std::string& path) {
  const absl::StatusOr<DicomScan> scan =
      IsDicomFile(path) ? ScanDicomFile(path) : absl::StatusOr<DicomScan>(DicomScan());
  return scan.ok() && IsDirectoryStorage(scan->storage_class);
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

bool HasDicomFile(const std::string& folder) {
  const std::vector<std::string> files = DicomCandidatesIn(folder);
  return std::any_of(files.begin(), files.end(), IsDicomFile);
}

bool HasDicomFileBelow(const std::string& folder) {
  std::size_t probed = 0;
  bool has_file = false;
  ForFoldersBelow(folder, [&](const std::vector<std::string>& files) {
    const std::size_t count = std::min(files.size(), kMaxProbed - probed);
    probed += count;
    has_file =
        std::any_of(files.begin(), files.begin() + static_cast<std::ptrdiff_t>(count), IsDicomFile);
    return !has_file && probed < kMaxProbed;
  });
  return has_file;
}

absl::StatusOr<std::vector<std::string>> DicomFilesOf(const std::string& path) {
  const Place place = PlaceOf(path);
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<std::string> files, CandidatesOf(place));
  std::erase_if(files, [](const std::string& file) { return !IsDicomFile(file); });
  if (place.is_index) {
    files.push_back(path);
  }
  return files;
}

std::string DescribeDicomSeries(const SeriesEntry& entry) {
  return absl::StrFormat(
      "%d%s, %d %s of %d x %d%s", entry.number,
      entry.description.empty() ? "" : absl::StrCat(" \"", entry.description, "\""), entry.images,
      entry.images == 1 ? "image" : "images", entry.width, entry.height,
      entry.folder.empty() ? "" : absl::StrCat(" in ", base::Printable(entry.folder)));
}

absl::StatusOr<std::vector<SeriesEntry>> ListDicomSeries(const std::string& path) {
  DicomDecoder decoder;
  const Place place = PlaceOf(path);
  ISOSCOPE_ASSIGN_OR_RETURN(const Folder found, ScanFolder(place, &decoder));
  if (found.series.empty()) {
    return absl::NotFoundError(absl::StrCat(place.folder, ": a folder without a DICOM image"));
  }
  return EntriesOf(found, place.folder);
}

absl::StatusOr<std::string> FindDicomSeriesFile(const std::string& path,
                                                const std::string& choice) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<SeriesEntry> entries, ListDicomSeries(path));
  ISOSCOPE_ASSIGN_OR_RETURN(SeriesEntry entry, ChosenOf(entries, path, choice));
  return std::move(entry.first_file);
}

absl::StatusOr<DicomSeriesFiles> FindDicomSeries(const std::string& path, const std::string& choice,
                                                 DicomDecoder* decoder) {
  const Place place = PlaceOf(path);
  ISOSCOPE_ASSIGN_OR_RETURN(Folder folder, ScanFolder(place, decoder));
  if (folder.series.empty() && !folder.cut.empty()) {
    return DicomCutError(folder.cut.front());
  }
  if (folder.series.empty()) {
    return absl::NotFoundError(folder.left_out.empty()
                                   ? absl::StrCat(place.folder, ": a folder without DICOM files")
                                   : absl::StrFormat("%s: none of its %d DICOM files is an image",
                                                     place.folder, folder.left_out.size()));
  }
  std::string uid;
  if (!choice.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(SeriesEntry entry,
                              ChosenOf(EntriesOf(folder, place.folder), path, choice));
    uid = std::move(entry.uid);
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(
        uid, place.is_file ? SeriesOf(path, decoder) : OnlySeries(folder, path, place.folder));
  }
  const auto files = folder.series.find(uid);
  if (files == folder.series.end()) {  // the file's name is not listed in the folder
    return absl::InvalidArgumentError(absl::StrCat(path, ": can't be read as a DICOM series"));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckCut(folder.cut, files->second));
  DicomSeriesFiles found{.is_of_file = place.is_file && choice.empty()};
  found.left_out = std::move(folder.left_out);
  for (const std::string& file : files->second) {
    found.images.push_back({.path = file, .scan = std::move(folder.scans.at(file))});
  }
  return found;
}

}  // namespace isoscope::source
