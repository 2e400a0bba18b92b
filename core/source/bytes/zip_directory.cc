// A ZIP archive is members, each behind a local header, then the directory, then its end:
//
//   local header     50 4b 03 04, 26 bytes of fields, name, extra fields; then the stored bytes
//   directory entry  50 4b 01 02, 42 bytes of fields, name, extra fields, comment
//   Zip64 end        50 4b 06 06, 52 bytes of fields with sizes of 64 bits
//   Zip64 locator    50 4b 06 07, 16 bytes of fields: where the Zip64 end lies
//   end              50 4b 05 06, 18 bytes of fields, comment of up to 65 535 bytes
//
// Fields are little-endian. In Zip64 a field of all ones stands in the extra field 1 instead. The
// directory alone counts: sizes of local headers may be 0, and follow the stored bytes then. A
// deflated stream has at most 1032 bytes for one. Source: PKWARE's APPNOTE.TXT 6.3.10, sections
// 4.3, 4.4 and 4.5.3.

#include "core/source/bytes/zip_directory.h"

#include <algorithm>
#include <limits>
#include <set>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "core/base/coding.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

constexpr absl::string_view kEntryMark("PK\x01\x02", 4);
constexpr absl::string_view kEndMark("PK\x05\x06", 4);
constexpr absl::string_view kLongEndMark("PK\x06\x06", 4);
constexpr absl::string_view kLocatorMark("PK\x06\x07", 4);
constexpr std::size_t kEntryBytes = 46;
constexpr std::int64_t kEndBytes = 22;
constexpr std::int64_t kLongEndBytes = 56;
constexpr std::int64_t kLocatorBytes = 20;
constexpr std::int64_t kMaxComment = 65'535;
constexpr std::int64_t kMaxDeflateRatio = 1032;
constexpr std::uint32_t kIn64 = 0xffffffff;  // the number stands in the extra field

template <typename T>
T LoadField(absl::string_view bytes, std::size_t offset) {
  return base::LoadLittleEndian<T>(bytes.data() + offset);
}
// Numbers beyond int64 come out as the largest one, which no file holds.
std::int64_t LoadField64(absl::string_view bytes, std::size_t offset) {
  return static_cast<std::int64_t>(std::min<std::uint64_t>(
      LoadField<std::uint64_t>(bytes, offset),
      static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max())));
}

absl::Status BadArchive(const ZipBytes& archive, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(archive.name, ": a ZIP archive: ", what));
}

absl::StatusOr<std::string> ReadEntries(const ZipBytes& archive, std::int64_t offset,
                                        std::int64_t size) {
  std::string text(static_cast<std::size_t>(size), '\0');
  ISOSCOPE_RETURN_IF_ERROR(archive.read_at(offset, text.size(), text.data()));
  return text;
}

struct Directory {
  std::int64_t offset = 0;
  std::int64_t size = 0;
  std::int64_t count = 0;
  std::int64_t end = 0;  // where what is behind it begins
};

// Reads the directory's place out of the Zip64 end, if there is one in front of the end.
absl::Status ReadLongEnd(const ZipBytes& archive, std::int64_t end_offset, Directory* directory) {
  if (end_offset < kLocatorBytes) {
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string locator,
                            ReadEntries(archive, end_offset - kLocatorBytes, kLocatorBytes));
  if (!absl::StartsWith(locator, kLocatorMark)) {
    return absl::OkStatus();
  }
  const std::int64_t offset = LoadField64(locator, 8);
  if (offset > end_offset - kLocatorBytes - kLongEndBytes) {
    return BadArchive(archive, "its Zip64 record lies behind its end: it is cut or damaged");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string end, ReadEntries(archive, offset, kLongEndBytes));
  if (!absl::StartsWith(end, kLongEndMark)) {
    return BadArchive(archive,
                      "no Zip64 record where it should be: bytes stand in front of the archive, "
                      "or it is damaged");
  }
  if (LoadField<std::uint32_t>(end, 16) != 0 || LoadField<std::uint32_t>(end, 20) != 0 ||
      LoadField64(end, 24) != LoadField64(end, 32)) {
    return BadArchive(archive, "one of several parts: join them first (zip -s 0)");
  }
  *directory = {.offset = LoadField64(end, 48),
                .size = LoadField64(end, 40),
                .count = LoadField64(end, 32),
                .end = offset};
  return absl::OkStatus();
}

absl::StatusOr<Directory> FindDirectory(const ZipBytes& archive, const ZipLimits& limits) {
  const std::int64_t size = archive.size_bytes;
  const std::int64_t tail_size = std::min(size, kEndBytes + kMaxComment);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string tail,
                            ReadEntries(archive, size - tail_size, tail_size));
  std::size_t at = tail.rfind(kEndMark.data(), std::string::npos, kEndMark.size());
  const auto ends_the_file = [&] {
    return tail.size() - at >= static_cast<std::size_t>(kEndBytes) &&
           tail.size() - at - static_cast<std::size_t>(kEndBytes) ==
               LoadField<std::uint16_t>(tail, at + 20);
  };
  while (at != std::string::npos && !ends_the_file()) {
    at = at == 0 ? std::string::npos : tail.rfind(kEndMark.data(), at - 1, kEndMark.size());
  }
  if (at == std::string::npos) {
    return BadArchive(archive, "no directory at its end: the file is cut; copy it again");
  }
  const std::int64_t offset = size - tail_size + static_cast<std::int64_t>(at);
  Directory directory{.offset = LoadField<std::uint32_t>(tail, at + 16),
                      .size = LoadField<std::uint32_t>(tail, at + 12),
                      .count = LoadField<std::uint16_t>(tail, at + 10),
                      .end = offset};
  const auto disk = LoadField<std::uint16_t>(tail, at + 4);
  const bool has_parts =
      LoadField<std::uint16_t>(tail, at + 8) != LoadField<std::uint16_t>(tail, at + 10) ||
      (disk != 0 && disk != 0xffff);
  if (has_parts) {
    return BadArchive(archive, "one of several parts: join them first (zip -s 0)");
  }
  ISOSCOPE_RETURN_IF_ERROR(ReadLongEnd(archive, offset, &directory));
  if (directory.size > limits.directory_bytes || directory.count > limits.members) {
    return BadArchive(
        archive,
        absl::StrFormat("%d members in a directory of %d bytes; expected at most "
                        "%d in %d: unpack it, and give what is in it",
                        directory.count, directory.size, limits.members, limits.directory_bytes));
  }
  if (directory.offset > directory.end - directory.size ||
      directory.offset + directory.size != directory.end) {
    return BadArchive(archive,
                      absl::StrFormat("its directory of %d bytes at %d does not end at %d: bytes "
                                      "stand in front of the archive, or it is damaged",
                                      directory.size, directory.offset, directory.end));
  }
  return directory;
}

// Takes numbers of 64 bits out of the extra fields, where 32 bits are all ones.
absl::Status TakeLongNumbers(const ZipBytes& archive, absl::string_view extra, ZipMember* member) {
  std::vector<std::int64_t*> wanted;
  for (std::int64_t* number :
       {&member->size_bytes, &member->stored_bytes, &member->header_offset}) {
    if (*number == std::int64_t{kIn64}) {
      wanted.push_back(number);
    }
  }
  while (!wanted.empty() && extra.size() >= 4) {
    const std::size_t size = LoadField<std::uint16_t>(extra, 2);
    if (size > extra.size() - 4) {
      break;
    }
    if (LoadField<std::uint16_t>(extra, 0) == 1) {
      if (size < 8 * wanted.size()) {
        break;
      }
      for (std::size_t i = 0; i < wanted.size(); ++i) {
        *wanted[i] = LoadField64(extra, 4 + 8 * i);
      }
      return absl::OkStatus();
    }
    extra.remove_prefix(4 + size);
  }
  return wanted.empty() ? absl::OkStatus()
                        : BadArchive(archive, absl::StrCat(base::Quoted(member->name),
                                                           " lacks its sizes of 64 bits: damaged"));
}

absl::Status CheckSizes(const ZipBytes& archive, const Directory& directory,
                        const ZipMember& member) {
  const bool is_within = member.stored_bytes <= directory.offset &&
                         member.header_offset <= directory.offset - member.stored_bytes;
  const bool is_possible =
      member.method == 0
          ? member.size_bytes == member.stored_bytes || member.is_encrypted
          : member.method != 8 || member.size_bytes / kMaxDeflateRatio <= member.stored_bytes;
  return is_within && is_possible
             ? absl::OkStatus()
             : BadArchive(archive,
                          absl::StrFormat("%s has %d bytes, stored in %d by method %d at byte "
                                          "%d, in front of the directory at %d: damaged",
                                          base::Quoted(member.name), member.size_bytes,
                                          member.stored_bytes, member.method, member.header_offset,
                                          directory.offset));
}

}  // namespace

absl::StatusOr<std::vector<ZipMember>> ReadZipDirectory(const ZipBytes& archive,
                                                        const ZipLimits& limits) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Directory directory, FindDirectory(archive, limits));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                            ReadEntries(archive, directory.offset, directory.size));
  std::vector<ZipMember> members;
  std::set<absl::string_view> names;  // within `bytes`
  absl::string_view rest = bytes;
  for (std::int64_t i = 0; i < directory.count; ++i) {
    const bool is_entry = rest.size() >= kEntryBytes && absl::StartsWith(rest, kEntryMark);
    const std::size_t name_size = is_entry ? LoadField<std::uint16_t>(rest, 28) : 0;
    const std::size_t extra_size = is_entry ? LoadField<std::uint16_t>(rest, 30) : 0;
    const std::size_t size =
        kEntryBytes + name_size + extra_size + (is_entry ? LoadField<std::uint16_t>(rest, 32) : 0);
    if (!is_entry || size > rest.size()) {
      return BadArchive(
          archive,
          absl::StrFormat("entry %d of %d of its directory is cut or damaged", i, directory.count));
    }
    ZipMember member{.name = std::string(rest.substr(kEntryBytes, name_size)),
                     .header_offset = LoadField<std::uint32_t>(rest, 42),
                     .stored_bytes = LoadField<std::uint32_t>(rest, 20),
                     .size_bytes = LoadField<std::uint32_t>(rest, 24),
                     .crc32 = LoadField<std::uint32_t>(rest, 16),
                     .method = LoadField<std::uint16_t>(rest, 10),
                     .is_encrypted = (LoadField<std::uint16_t>(rest, 8) & 0x41) != 0};
    ISOSCOPE_RETURN_IF_ERROR(
        TakeLongNumbers(archive, rest.substr(kEntryBytes + name_size, extra_size), &member));
    ISOSCOPE_RETURN_IF_ERROR(CheckSizes(archive, directory, member));
    if (!limits.takes_last_of_a_name && !names.insert(rest.substr(kEntryBytes, name_size)).second) {
      return BadArchive(archive, absl::StrCat("two members are named ", base::Quoted(member.name),
                                              ": unpack it, and give one of them"));
    }
    members.push_back(std::move(member));
    rest.remove_prefix(size);
  }
  if (!rest.empty()) {
    return BadArchive(archive,
                      absl::StrFormat("%d bytes behind the %d entries of its directory: damaged",
                                      rest.size(), directory.count));
  }
  return members;
}

}  // namespace isoscope::source
