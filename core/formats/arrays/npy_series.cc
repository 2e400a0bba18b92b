// An array becomes a SampleLocation: at an offset of the file, of a gzip stream, or of a member of
// an archive, which is a stream, too.

#include "core/formats/arrays/npy_series.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/formats/arrays/npy_header.h"
#include "core/io/file.h"
#include "core/source/bytes/file_layout.h"
#include "core/source/bytes/file_start.h"
#include "core/source/bytes/located_series.h"
#include "core/source/bytes/zip_file.h"

namespace isoscope::source {
namespace {

constexpr absl::string_view kNpyEnding = ".npy";
constexpr std::size_t kMaxArrays = 1000;

struct NpzArray {
  std::string field;
  volume::GridGeometry geometry{};
  FieldLocation location{};
};

absl::StatusOr<NpzArray> ReadNpzArray(const std::string& path, const io::RandomAccessFile& file,
                                      const ZipMember& member) {
  NpzArray array{.field = std::string(absl::StripSuffix(member.name, kNpyEnding))};
  const std::string name = absl::StrCat(path, ":", base::Escaped(base::CutText(array.field)));
  if (!base::IsPlain(array.field) || array.field.size() > base::kMaxForeignBytes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: a name that no field has; expected at most %d bytes of UTF-8, without "
                        "quotation marks, backslashes and control characters",
                        name, base::kMaxForeignBytes));
  }
  std::string head(static_cast<std::size_t>(std::min<std::int64_t>(
                       static_cast<std::int64_t>(kNpyHeadBytes), member.size_bytes)),
                   '\0');
  ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t got,
                            MakeZipStream(member, &file)->Read(head.size(), head.data()));
  head.resize(got);
  ISOSCOPE_ASSIGN_OR_RETURN(const NpyHeader header, ParseNpyHeader(head, name));
  ISOSCOPE_ASSIGN_OR_RETURN(array.geometry, NpyGrid(header, name));
  const std::int64_t size =
      header.SampleCount() * static_cast<std::int64_t>(header.sample_bytes()) +
      header.samples_start;
  if (header.SampleCount() < 0 || size != member.size_bytes) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: shape (%s) of %s needs %d bytes, the member has %d: damaged", name,
        absl::StrJoin(header.shape, ", "), volume::NameOf(header.type), size, member.size_bytes));
  }
  array.location = {.location = SampleLocation{.files = {path},
                                               .encoding = SampleEncoding::kZip,
                                               .decoded_skip = header.samples_start,
                                               .member = member,
                                               .is_big_endian = header.is_big_endian,
                                               .stored_type = header.type},
                    .wide = header.wide};
  return array;
}

absl::Status NoSuchArray(const std::string& path, const std::string& part,
                         const std::vector<ZipMember>& members) {
  constexpr std::size_t kMaxListed = 50;
  std::vector<std::string> names;
  for (const ZipMember& member : members) {
    if (names.size() < kMaxListed) {
      names.push_back(base::Printable(base::CutText(absl::StripSuffix(member.name, kNpyEnding))));
    }
  }
  return absl::NotFoundError(absl::StrCat(
      path, ": no array ", base::Quoted(part), "; it holds ", absl::StrJoin(names, ", "),
      members.size() > kMaxListed ? absl::StrCat(" and ", members.size() - kMaxListed, " more")
                                  : ""));
}

}  // namespace

bool IsNpy(absl::string_view head) { return IsNpyHeader(head); }

bool IsNpz(absl::string_view head) { return absl::EndsWith(FirstZipName(head), kNpyEnding); }

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenNpySeries(const std::string& path,
                                                            const std::string& field,
                                                            const std::string& axes) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FileStart start, ReadFileStart(path, kNpyHeadBytes));
  ISOSCOPE_ASSIGN_OR_RETURN(const NpyHeader header, ParseNpyHeader(start.bytes, path));
  FileLayout layout{.wide = header.wide};
  NpyVolumes volumes;
  if (axes.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(volumes.geometry, NpyGrid(header, path));
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(volumes, NpyVolumesOf(header, axes, path));
  }
  layout.geometry = volumes.geometry;
  (volumes.are_steps ? layout.steps : layout.components) = volumes.count;
  layout.location = {.files = {path},
                     .encoding = start.is_gzip ? SampleEncoding::kDeflate : SampleEncoding::kRaw,
                     .is_big_endian = header.is_big_endian,
                     .stored_type = header.type};
  (volumes.are_fastest ? layout.location.components : layout.location.volume_count) = volumes.count;
  (start.is_gzip ? layout.location.decoded_skip : layout.location.offset) = header.samples_start;
  return MakeLayoutSeries(path, field, std::move(layout));
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenNpzSeries(const std::string& path,
                                                            const std::string& part) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<ZipMember> members, ReadZipMembers(*file));
  members.erase(std::remove_if(members.begin(), members.end(),
                               [](const ZipMember& member) {
                                 return !absl::EndsWith(member.name, kNpyEnding) ||
                                        member.name.size() == kNpyEnding.size();
                               }),
                members.end());
  if (members.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": a ZIP archive without a NumPy array (.npy) in it"));
  }
  LocatedFile located{.info = {.name = part.empty() ? path : absl::StrCat(path, ":", part)}};
  absl::Status first_error;
  for (const ZipMember& member : members) {
    if (!part.empty() && absl::StripSuffix(member.name, kNpyEnding) != part) {
      continue;
    }
    auto array = ReadNpzArray(path, *file, member);
    if (!array.ok()) {
      // A lone number beside the volumes is no fault of theirs.
      if (!part.empty() || !absl::IsInvalidArgument(array.status())) {
        return array.status();
      }
      first_error.Update(array.status());
    } else if (located.locations.size() + located.info.fields_elsewhere.size() == kMaxArrays) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: more than %d volumes; give one, FILE:NAME", path, kMaxArrays));
    } else if (!located.locations.empty() && array->geometry != located.geometry) {
      located.info.fields_elsewhere.push_back(array->field);
    } else {
      located.geometry = array->geometry;
      located.Add({.name = array->field}, std::move(array->location));
    }
  }
  if (located.locations.empty()) {
    return first_error.ok() ? NoSuchArray(path, part, members) : first_error;
  }
  return MakeLocatedSeries(std::move(located));
}

}  // namespace isoscope::source
