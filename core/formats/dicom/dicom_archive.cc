// Unpacking takes three steps:
//
//   1. The directory alone is judged: names, overlaps, sizes, and the room on the disk.
//   2. The start of a member tells whether it is a DICOM file. If it does not, as of viewers,
//      pictures and the index DICOMDIR, nothing of it is written, and no more of it is read.
//   3. The others are written as NUMBER_NAME into one folder: "PAT/SE01/IM3" is 000003_IM3. Numbers
//      keep the order, and no character of a stranger's name but letters, digits, '.', '-' and '_'
//      gets into a path.

#include "core/formats/dicom/dicom_archive.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <system_error>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"

#include "core/base/printable.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/formats/dicom/dicom_folder.h"
#include "core/formats/dicom/dicom_scan.h"
#include "core/formats/dicom/dicom_source.h"
#include "core/io/file.h"
#include "core/io/temporary_folder.h"
#include "core/source/bytes/decoded_stream.h"
#include "core/source/bytes/zip_file.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxMemberBytes = 4 * base::kGiB;
constexpr std::int64_t kMaxUnpackedBytes = 64 * base::kGiB;
constexpr std::int64_t kMaxRatio = 200;  // of unpacked bytes beyond a GiB
constexpr std::size_t kUnpackBytes = base::kMiB;
constexpr std::int64_t kLeastHeaderBytes = 30;  // of a member, in front of its name

absl::Status ArchiveError(const std::string& path, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": a ZIP archive: ", what));
}

bool LeadsOut(const std::string& name) {
  const std::vector<std::string> parts = absl::StrSplit(name, absl::ByAnyChar("/\\"));
  const bool has_drive = name.size() > 1 && name[1] == ':';
  return name.empty() || parts.front().empty() || has_drive ||
         std::find(parts.begin(), parts.end(), "..") != parts.end() ||
         name.find('\0') != std::string::npos;
}

// Judges members by what the directory says of them, before a byte is written.
absl::Status CheckMembers(const std::string& path, std::int64_t archive_bytes,
                          std::vector<ZipMember> members) {
  std::sort(members.begin(), members.end(), [](const ZipMember& a, const ZipMember& b) {
    return a.header_offset < b.header_offset;
  });
  std::int64_t total = 0;
  std::int64_t end = 0;  // of the members before
  for (const ZipMember& member : members) {
    const std::string name = base::Quoted(member.name);
    if (LeadsOut(member.name)) {
      return ArchiveError(
          path, absl::StrCat("the name ", name, " leads out of it: made to do harm, or damaged"));
    }
    if (member.header_offset < end) {
      return ArchiveError(path, absl::StrCat("member ", name,
                                             " overlaps another one: made to do harm, or damaged"));
    }
    end = member.header_offset + kLeastHeaderBytes + static_cast<std::int64_t>(member.name.size()) +
          member.stored_bytes;
    if (member.size_bytes > kMaxMemberBytes || total > kMaxUnpackedBytes - member.size_bytes) {
      return ArchiveError(
          path,
          absl::StrFormat("member %s has %d bytes; expected at most %d, and %d of all members: "
                          "unpack it, and give the folder",
                          name, member.size_bytes, kMaxMemberBytes, kMaxUnpackedBytes));
    }
    total += member.size_bytes;
  }
  if ((total - base::kGiB) / kMaxRatio > archive_bytes) {
    return ArchiveError(path,
                        absl::StrFormat("%d bytes in an archive of %d: a bomb; if it is none, "
                                        "unpack it, and give the folder",
                                        total, archive_bytes));
  }
  std::error_code error;
  const std::filesystem::path place = std::filesystem::temp_directory_path(error);
  const std::filesystem::space_info space =
      error ? std::filesystem::space_info{} : std::filesystem::space(place, error);
  if (!error && space.available < static_cast<std::uintmax_t>(total)) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("%s: its %d bytes have no room in %s, where %d are free: set TMPDIR to a "
                        "folder of a larger "
                        "disk, or unpack it, and give the folder",
                        path, total, place.string(), space.available));
  }
  return absl::OkStatus();
}

// "000003_IM3" of "PAT/SE01/IM3".
std::string FlatName(std::size_t number, const std::string& name) {
  std::string flat = absl::StrFormat("%06d_", number);
  for (const char c : name.substr(name.find_last_of("/\\") + 1).substr(0, 100)) {
    const bool is_kept =
        absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '-' || c == '_';
    flat += is_kept ? c : '_';
  }
  return flat;
}

// A member of which only the start is known. Remembers whether more was asked for.
class MemberStart final : public io::RandomAccessFile {
 public:
  MemberStart(absl::string_view start, const ZipMember& member)
      : start_(start), size_bytes_(member.size_bytes), name_(member.name) {}

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckRange(*this, offset, size));
    const auto begin = static_cast<std::size_t>(offset);
    if (begin > start_.size() || size > start_.size() - begin) {
      is_too_short_ = true;
      return absl::OutOfRangeError(absl::StrCat(name_, ": is not unpacked so far"));
    }
    start_.copy(out, size, begin);
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return size_bytes_; }
  [[nodiscard]] const std::string& path() const override { return name_; }

  // False if what is known tells that it is none.
  [[nodiscard]] bool MayBeDicom() const { return HasDicomStart(*this) || is_too_short_; }

 private:
  const absl::string_view start_;
  const std::int64_t size_bytes_;
  const std::string name_;
  mutable bool is_too_short_ = false;
};

// Unpacks a member into a file of the folder, if it is a DICOM file. Returns whether it is.
absl::StatusOr<bool> Unpack(const io::RandomAccessFile& archive, const ZipMember& member,
                            const io::TemporaryFolder& folder, const std::string& name) {
  const std::unique_ptr<DecodedStream> stream = MakeZipStream(member, &archive);
  std::string part(kUnpackBytes, '\0');
  std::unique_ptr<io::WritableFile> file;
  do {
    ISOSCOPE_RETURN_IF_ERROR(base::CheckProcessInterrupt());
    ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t got, stream->Read(part.size(), part.data()));
    const absl::string_view bytes = absl::string_view(part).substr(0, got);
    if (file == nullptr) {
      if (!MemberStart(bytes, member).MayBeDicom()) {
        return false;
      }
      ISOSCOPE_ASSIGN_OR_RETURN(file, folder.CreateFile(name));
    }
    ISOSCOPE_RETURN_IF_ERROR(file->Append(bytes));
  } while (stream->position() < member.size_bytes);
  ISOSCOPE_RETURN_IF_ERROR(stream->VerifyEnd());
  ISOSCOPE_RETURN_IF_ERROR(file->Close());
  const std::string path = folder.Sub(name);
  if (IsDicomFile(path)) {
    return true;
  }
  ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(path));
  return false;
}

using SharedFolder = std::shared_ptr<const io::TemporaryFolder>;

absl::StatusOr<SharedFolder> UnpackDicom(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> archive,
                            io::OpenRandomAccessFile(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<ZipMember> members, ReadZipMembers(*archive));
  ISOSCOPE_RETURN_IF_ERROR(CheckMembers(path, archive->size_bytes(), members));
  ISOSCOPE_ASSIGN_OR_RETURN(io::TemporaryFolder made, io::TemporaryFolder::Make());
  auto folder = std::make_shared<const io::TemporaryFolder>(std::move(made));
  std::size_t kept = 0;
  for (std::size_t i = 0; i < members.size(); ++i) {
    const ZipMember& member = members[i];
    if (member.is_folder() || absl::EndsWithIgnoreCase(member.name, "DICOMDIR")) {
      continue;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const bool is_dicom,
                              Unpack(*archive, member, *folder, FlatName(i + 1, member.name)));
    kept += is_dicom ? 1 : 0;
  }
  if (kept == 0) {
    return ArchiveError(path, absl::StrFormat("none of its %d members is a DICOM file; unpack it, "
                                              "and give what is in it",
                                              members.size()));
  }
  return folder;
}

// An error that names the archive in place of the folder.
absl::Status Renamed(const absl::Status& status, const std::string& folder,
                     const std::string& archive) {
  return absl::Status(status.code(), absl::StrReplaceAll(status.message(), {{folder, archive}}));
}

class ArchivedSource final : public VolumeSource {
 public:
  ArchivedSource(std::unique_ptr<VolumeSource> source, SharedFolder folder, std::string path)
      : VolumeSource(InfoOf(*source, folder->path(), path)),
        folder_(std::move(folder)),
        path_(std::move(path)),
        source_(std::move(source)) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const absl::Status read = source_->ReadRows(begin_row, end_row, out);
    return read.ok() ? read : Renamed(read, folder_->path(), path_);
  }

  void HeedCancellation(const base::Cancellation* cancellation) override {
    source_->HeedCancellation(cancellation);
  }

 private:
  static SourceInfo InfoOf(const VolumeSource& source, const std::string& folder,
                           const std::string& path) {
    SourceInfo info = source.info();
    info.name = absl::StrReplaceAll(info.name, {{folder, path}});
    return info;
  }

  const SharedFolder folder_;  // released behind the source, which reads in it
  const std::string path_;
  const std::unique_ptr<VolumeSource> source_;
};

class ArchivedSeries final : public VolumeSeries {
 public:
  ArchivedSeries(std::unique_ptr<VolumeSeries> series, SharedFolder folder, std::string path)
      : VolumeSeries(InfoOf(*series, path)),
        folder_(std::move(folder)),
        path_(std::move(path)),
        series_(std::move(series)) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    auto source = series_->Open(field, component, step);
    if (!source.ok()) {
      return Renamed(source.status(), folder_->path(), path_);
    }
    return std::make_unique<ArchivedSource>(*std::move(source), folder_, path_);
  }

 private:
  static SeriesInfo InfoOf(const VolumeSeries& series, const std::string& path) {
    SeriesInfo info = series.info();
    info.name = path;
    return info;
  }

  const SharedFolder folder_;
  const std::string path_;
  const std::unique_ptr<VolumeSeries> series_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenDicomArchive(const std::string& path,
                                                               const std::string& field,
                                                               const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(SharedFolder folder, UnpackDicom(path));
  auto series = OpenDicomSteps(folder->path(), field, rules);
  if (!series.ok()) {
    return Renamed(series.status(), folder->path(), path);
  }
  return std::make_unique<ArchivedSeries>(*std::move(series), std::move(folder), path);
}

absl::StatusOr<std::vector<SeriesEntry>> ListDicomArchive(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const SharedFolder folder, UnpackDicom(path));
  auto entries = ListDicomSeries(folder->path());
  if (!entries.ok()) {
    return Renamed(entries.status(), folder->path(), path);
  }
  for (SeriesEntry& entry : *entries) {
    entry.first_file = path;
  }
  return entries;
}

}  // namespace isoscope::source
