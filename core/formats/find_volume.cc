// The order:
//
//   a folder, whatever its name   the row that finds its files in it, else those of folders below
//   any other path                the row that finds its name, in the order of the table: "a.mrc",
//                                 "a.h5:/dataset", "slice*.png"
//   a name that formats share     the row whose mark or first bytes the file has, or its header
//   a name of none                the same
//   an address                    a Zarr store; or an object, found as a file by name and content

#include "core/formats/find_volume.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/formats/address_source.h"
#include "core/formats/medical/layout_formats.h"
#include "core/formats/refused_formats.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "core/source/bytes/file_start.h"
#include "core/source/bytes/named_files.h"
#include "core/source/bytes/part_path.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kHeadBytes = 1024;

FoundVolume WholeFile(const Format& format, const std::string& path) {
  return {.format = &format, .request = {.path = path, .file = path, .files = {path}}};
}

const Format* FormatOfMark(const std::string& path, absl::Span<const Format> formats) {
  for (const Format& format : formats) {
    if (format.is_marked != nullptr && format.is_marked(path)) {
      return &format;
    }
  }
  return nullptr;
}

const Format* FormatOfHead(const std::string& path, absl::Span<const Format> formats) {
  const auto head = ReadFileStart(path, kHeadBytes);
  if (!head.ok()) {
    return nullptr;
  }
  for (const Format& format : formats) {
    if (format.is_content != nullptr && !(format.is_plain && head->is_gzip) &&
        format.is_content(head->bytes)) {
      return &format;
    }
  }
  return nullptr;
}

// Finds a file of the format by its ending, with or without a part, or as the row finds it.
absl::StatusOr<std::optional<FileRequest>> FindOfFormat(const Format& format,
                                                        const std::string& path) {
  if (format.find != nullptr) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::optional<FileRequest> request, format.find(path));
    if (request.has_value()) {
      return request;
    }
  }
  PartPath parts;
  if (!SplitPartPath(path, format.endings, &parts)) {
    return std::nullopt;
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(parts.file));
  return FileRequest{.path = path, .file = parts.file, .part = parts.part, .files = {parts.file}};
}

absl::StatusOr<FoundVolume> FindInFolder(const std::string& path,
                                         absl::Span<const Format> formats) {
  for (const Format& format : formats) {
    if (format.find_in_folder != nullptr) {
      ISOSCOPE_ASSIGN_OR_RETURN(std::optional<FileRequest> request, format.find_in_folder(path));
      if (request.has_value()) {
        return FoundVolume{.format = &format, .request = *std::move(request)};
      }
    }
  }
  if (const auto why = WhyRefused(path); why.has_value()) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", *why));
  }
  std::vector<std::string> wanted;
  for (const Format& format : formats) {
    if (format.is_below != nullptr && format.is_below(path)) {
      return FoundVolume{.format = &format, .request = {.path = path, .file = path}};
    }
    if (!format.in_folder.empty()) {
      wanted.push_back(format.in_folder);
    }
  }
  const std::string volumes = ListVolumesIn(path, formats);
  return absl::NotFoundError(absl::StrCat(
      path, ": a folder with neither ", absl::StrJoin(wanted, ", nor "), " in it",
      volumes.empty() ? "" : absl::StrCat("; it holds ", volumes, ": give such a file")));
}

// Takes the path for the named format. The name and the content of the file do not count.
absl::StatusOr<FoundVolume> FindVolumeAs(const std::string& path, absl::string_view name,
                                         absl::Span<const Format> formats) {
  const Format* const format = FindFormat(name, formats);
  if (format == nullptr || !format->opens_folders || !io::IsDirectory(path)) {
    ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(path));
  }
  if (format != nullptr && format->is_forceable) {
    return WholeFile(*format, path);
  }
  std::vector<std::string> names;
  for (const FormatName& known : FormatNames(formats)) {
    if (known.is_forceable) {
      names.push_back(known.name);
    }
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("--format %s: expected one of %s", name, absl::StrJoin(names, ", ")));
}

// PERMISSION_DENIED if the system does not let this process look there. Readers would say that it is
// no file of theirs.
absl::Status CheckRights(const std::string& path, bool is_folder) {
  const bool is_refused =
      !io::IsMounted(path) &&
      faccessat(AT_FDCWD, path.c_str(), is_folder ? X_OK : R_OK, AT_EACCESS) != 0 &&
      errno == EACCES;
  return is_refused ? io::ErrnoToStatus(EACCES, "open", path) : absl::OkStatus();
}

// What is no address; objects at one are mounted.
absl::StatusOr<FoundVolume> FindFileOrFolder(const std::string& path, absl::string_view format,
                                             absl::Span<const Format> formats) {
  // The readers of libraries would wait for a writer, or read without end.
  const bool is_folder = io::IsDirectory(path);
  ISOSCOPE_RETURN_IF_ERROR(CheckRights(path, is_folder));
  ISOSCOPE_RETURN_IF_ERROR(is_folder ? absl::OkStatus() : io::CheckIsRegularFile(path));
  if (!format.empty()) {
    return FindVolumeAs(path, format, formats);
  }
  if (is_folder) {
    return FindInFolder(path, formats);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::optional<FoundVolume> found, FindByName(path, formats));
  if (!found.has_value()) {
    ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(path));
    found = FindByContent(path, formats);
  }
  return found.has_value() ? absl::StatusOr<FoundVolume>(*std::move(found))
                           : UnknownKindOfFile(path);
}

absl::StatusOr<FoundVolume> FindVolumeAtAddress(absl::string_view text, absl::string_view format,
                                                absl::Span<const Format> formats) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string path, PathOfSource(text));
  ISOSCOPE_ASSIGN_OR_RETURN(const AddressSource source, FindAtAddress(path));
  if (source.is_store) {
    constexpr absl::string_view kZarr = "zarr";
    const Format* const zarr = FindFormat(kZarr, formats);
    if (zarr == nullptr || (!format.empty() && format != kZarr)) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, ": --format ", format, ": is a Zarr store; expected --format zarr"));
    }
    return FoundVolume{
        .format = zarr,
        .request = {
            .path = path, .file = source.file, .part = source.part, .files = {source.file}}};
  }
  ISOSCOPE_ASSIGN_OR_RETURN(FoundVolume found, FindFileOrFolder(path, format, formats));
  if (!found.format->reads_addresses) {
    return NeedsWholeFile(source.file, absl::StrCat("a file of ", found.format->name));
  }
  return found;
}

}  // namespace

absl::StatusOr<std::optional<FoundVolume>> FindByName(const std::string& path,
                                                      absl::Span<const Format> formats) {
  for (const Format& format : formats) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::optional<FileRequest> request, FindOfFormat(format, path));
    if (!request.has_value()) {
      continue;
    }
    FoundVolume found{.format = &format, .request = *std::move(request)};
    if (format.shares_names) {
      // Samples beside their header have no first bytes of their own.
      const Format* other = FormatOfMark(path, formats);
      other = other == nullptr ? FormatOfHead(LayoutHeaderPath(path), formats) : other;
      found.format = other == nullptr ? &format : other;
    }
    return found;
  }
  return std::nullopt;
}

std::optional<FoundVolume> FindByContent(const std::string& path,
                                         absl::Span<const Format> formats) {
  const Format* format = FormatOfMark(path, formats);
  format = format == nullptr ? FormatOfHead(path, formats) : format;
  // Samples without a mark, beside their header: the names of .rec files are also those of MRC
  // tomograms, which have a mark.
  if (const std::string header = LayoutHeaderPath(path); format == nullptr && header != path) {
    format = FormatOfHead(header, formats);
  }
  return format == nullptr ? std::nullopt : std::optional(WholeFile(*format, path));
}

bool NamesFormat(const std::string& path, absl::Span<const Format> formats) {
  const auto found = FindByName(path, formats);
  return !found.ok() || found->has_value();
}

absl::StatusOr<FoundVolume> FindVolume(const std::string& path, absl::string_view format,
                                       absl::Span<const Format> formats) {
  return io::IsAddressText(path) ? FindVolumeAtAddress(path, format, formats)
                                 : FindFileOrFolder(path, format, formats);
}

absl::StatusOr<std::vector<SeriesEntry>> ListSeries(const std::string& path,
                                                    absl::Span<const Format> formats) {
  const auto found = FindVolume(path, "", formats);
  return found.ok() && found->format->list_series != nullptr ? found->format->list_series(path)
                                                             : std::vector<SeriesEntry>();
}

absl::StatusOr<std::string> FindSeriesFile(const std::string& path, const std::string& choice,
                                           absl::Span<const Format> formats) {
  const auto found = FindVolume(path, "", formats);
  if (found.ok() && found->format->find_series_file != nullptr) {
    return found->format->find_series_file(path, choice);
  }
  for (const Format& format : formats) {
    if (format.find_series_file != nullptr) {
      return format.find_series_file(path, choice);
    }
  }
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": no format has series to choose ", choice, " from"));
}

}  // namespace isoscope::source
