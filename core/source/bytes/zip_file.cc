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

#include "core/source/bytes/zip_file.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <set>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "zlib.h"

namespace isoscope::source {
namespace {

constexpr absl::string_view kLocalMark("PK\x03\x04", 4);
constexpr absl::string_view kEntryMark("PK\x01\x02", 4);
constexpr absl::string_view kEndMark("PK\x05\x06", 4);
constexpr absl::string_view kLongEndMark("PK\x06\x06", 4);
constexpr absl::string_view kLocatorMark("PK\x06\x07", 4);
constexpr std::int64_t kLocalBytes = 30;
constexpr std::size_t kEntryBytes = 46;
constexpr std::int64_t kEndBytes = 22;
constexpr std::int64_t kLongEndBytes = 56;
constexpr std::int64_t kLocatorBytes = 20;
constexpr std::int64_t kMaxComment = 65'535;
constexpr std::int64_t kMaxDirectoryBytes = 64 * base::kMiB;
constexpr std::int64_t kMaxMembers = 200'000;
constexpr std::int64_t kMaxDeflateRatio = 1032;
constexpr std::size_t kZipInputBytes = 256 * base::kKiB;
constexpr std::uint32_t kIn64 = 0xffffffff;  // the number stands in the extra field

template <typename T>
T Load(absl::string_view bytes, std::size_t offset) {
  return base::LoadLittleEndian<T>(bytes.data() + offset);
}
// Numbers beyond int64 come out as the largest one, which no file holds.
std::int64_t LoadLong(absl::string_view bytes, std::size_t offset) {
  return static_cast<std::int64_t>(std::min<std::uint64_t>(
      Load<std::uint64_t>(bytes, offset),
      static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max())));
}

absl::Status ZipError(const io::RandomAccessFile& file, absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat(file.path(), ": a ZIP archive: ", what));
}

absl::StatusOr<std::string> ReadText(const io::RandomAccessFile& file, std::int64_t offset,
                                     std::int64_t size) {
  std::string text(static_cast<std::size_t>(size), '\0');
  ISOSCOPE_RETURN_IF_ERROR(file.ReadAt(offset, text.size(), text.data()));
  return text;
}

struct Directory {
  std::int64_t offset = 0;
  std::int64_t size = 0;
  std::int64_t count = 0;
  std::int64_t end = 0;  // where what is behind it begins
};

// Reads the directory's place out of the Zip64 end, if there is one in front of the end.
absl::Status ReadLongEnd(const io::RandomAccessFile& file, std::int64_t end_offset,
                         Directory* directory) {
  if (end_offset < kLocatorBytes) {
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string locator,
                            ReadText(file, end_offset - kLocatorBytes, kLocatorBytes));
  if (!absl::StartsWith(locator, kLocatorMark)) {
    return absl::OkStatus();
  }
  const std::int64_t offset = LoadLong(locator, 8);
  if (offset > end_offset - kLocatorBytes - kLongEndBytes) {
    return ZipError(file, "its Zip64 record lies behind its end: it is cut or damaged");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string end, ReadText(file, offset, kLongEndBytes));
  if (!absl::StartsWith(end, kLongEndMark)) {
    return ZipError(file,
                    "no Zip64 record where it should be: bytes stand in front of the archive, "
                    "or it is damaged");
  }
  if (Load<std::uint32_t>(end, 16) != 0 || Load<std::uint32_t>(end, 20) != 0 ||
      LoadLong(end, 24) != LoadLong(end, 32)) {
    return ZipError(file, "one of several parts: join them first (zip -s 0)");
  }
  *directory = {.offset = LoadLong(end, 48),
                .size = LoadLong(end, 40),
                .count = LoadLong(end, 32),
                .end = offset};
  return absl::OkStatus();
}

absl::StatusOr<Directory> FindDirectory(const io::RandomAccessFile& file) {
  const std::int64_t size = file.size_bytes();
  const std::int64_t tail_size = std::min(size, kEndBytes + kMaxComment);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string tail, ReadText(file, size - tail_size, tail_size));
  std::size_t at = tail.rfind(kEndMark.data(), std::string::npos, kEndMark.size());
  const auto ends_the_file = [&] {
    return tail.size() - at >= static_cast<std::size_t>(kEndBytes) &&
           tail.size() - at - static_cast<std::size_t>(kEndBytes) ==
               Load<std::uint16_t>(tail, at + 20);
  };
  while (at != std::string::npos && !ends_the_file()) {
    at = at == 0 ? std::string::npos : tail.rfind(kEndMark.data(), at - 1, kEndMark.size());
  }
  if (at == std::string::npos) {
    return ZipError(file, "no directory at its end: the file is cut; copy it again");
  }
  const std::int64_t offset = size - tail_size + static_cast<std::int64_t>(at);
  Directory directory{.offset = Load<std::uint32_t>(tail, at + 16),
                      .size = Load<std::uint32_t>(tail, at + 12),
                      .count = Load<std::uint16_t>(tail, at + 10),
                      .end = offset};
  const auto disk = Load<std::uint16_t>(tail, at + 4);
  const bool has_parts = Load<std::uint16_t>(tail, at + 8) != Load<std::uint16_t>(tail, at + 10) ||
                         (disk != 0 && disk != 0xffff);
  if (has_parts) {
    return ZipError(file, "one of several parts: join them first (zip -s 0)");
  }
  ISOSCOPE_RETURN_IF_ERROR(ReadLongEnd(file, offset, &directory));
  if (directory.size > kMaxDirectoryBytes || directory.count > kMaxMembers) {
    return ZipError(
        file, absl::StrFormat("%d members in a directory of %d bytes; expected at most "
                              "%d in %d: unpack it, and give what is in it",
                              directory.count, directory.size, kMaxMembers, kMaxDirectoryBytes));
  }
  if (directory.offset > directory.end - directory.size ||
      directory.offset + directory.size != directory.end) {
    return ZipError(file,
                    absl::StrFormat("its directory of %d bytes at %d does not end at %d: bytes "
                                    "stand in front of the archive, or it is damaged",
                                    directory.size, directory.offset, directory.end));
  }
  return directory;
}

// Takes numbers of 64 bits out of the extra fields, where 32 bits are all ones.
absl::Status TakeLongNumbers(const io::RandomAccessFile& file, absl::string_view extra,
                             ZipMember* member) {
  std::vector<std::int64_t*> wanted;
  for (std::int64_t* number :
       {&member->size_bytes, &member->stored_bytes, &member->header_offset}) {
    if (*number == std::int64_t{kIn64}) {
      wanted.push_back(number);
    }
  }
  while (!wanted.empty() && extra.size() >= 4) {
    const std::size_t size = Load<std::uint16_t>(extra, 2);
    if (size > extra.size() - 4) {
      break;
    }
    if (Load<std::uint16_t>(extra, 0) == 1) {
      if (size < 8 * wanted.size()) {
        break;
      }
      for (std::size_t i = 0; i < wanted.size(); ++i) {
        *wanted[i] = LoadLong(extra, 4 + 8 * i);
      }
      return absl::OkStatus();
    }
    extra.remove_prefix(4 + size);
  }
  return wanted.empty() ? absl::OkStatus()
                        : ZipError(file, absl::StrCat(base::Quoted(member->name),
                                                      " lacks its sizes of 64 bits: damaged"));
}

absl::Status CheckSizes(const io::RandomAccessFile& file, const Directory& directory,
                        const ZipMember& member) {
  const bool is_within = member.stored_bytes <= directory.offset &&
                         member.header_offset <= directory.offset - member.stored_bytes;
  const bool is_possible =
      member.method == 0
          ? member.size_bytes == member.stored_bytes || member.is_encrypted
          : member.method != 8 || member.size_bytes / kMaxDeflateRatio <= member.stored_bytes;
  return is_within && is_possible
             ? absl::OkStatus()
             : ZipError(file, absl::StrFormat("%s has %d bytes, stored in %d by method %d at byte "
                                              "%d, in front of the directory at %d: damaged",
                                              base::Quoted(member.name), member.size_bytes,
                                              member.stored_bytes, member.method,
                                              member.header_offset, directory.offset));
}

class ZipStream final : public DecodedStream {
 public:
  ZipStream(ZipMember member, const io::RandomAccessFile* file)
      : member_(std::move(member)), file_(*file) {
    ISOSCOPE_CHECK_EQ(inflateInit2(&z_, -MAX_WBITS), Z_OK);  // a stream without a header
  }
  ~ZipStream() override { inflateEnd(&z_); }
  ZipStream(const ZipStream&) = delete;
  ZipStream& operator=(const ZipStream&) = delete;

  absl::StatusOr<std::size_t> Read(std::size_t size, char* out) override {
    ISOSCOPE_RETURN_IF_ERROR(Begin());
    size = std::min(size, static_cast<std::size_t>(member_.size_bytes - position_));
    std::size_t done = 0;
    while (done < size) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t got, member_.method == 0
                                                           ? ReadStored(size - done, out + done)
                                                           : Inflate(size - done, out + done));
      crc_ = static_cast<std::uint32_t>(
          crc32_z(crc_, reinterpret_cast<const Bytef*>(out + done), got));
      done += got;
      position_ += static_cast<std::int64_t>(got);
    }
    return done;
  }

  absl::Status VerifyEnd() override {
    constexpr std::int64_t kMaxExtraBytes = base::kMiB;
    ISOSCOPE_RETURN_IF_ERROR(Begin());
    if (member_.size_bytes - position_ > kMaxExtraBytes) {
      return absl::OkStatus();
    }
    ISOSCOPE_RETURN_IF_ERROR(Skip(member_.size_bytes - position_).status());
    char extra = 0;
    if (member_.method == 8 && !is_at_end_) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t got, InflateOnce(1, &extra));
      if (got > 0 || !is_at_end_) {
        return Damaged(absl::StrFormat("more than its %d bytes are in it", member_.size_bytes));
      }
    }
    if (crc_ != member_.crc32) {
      return Damaged(
          absl::StrFormat("its checksum is %08x, the archive says %08x", crc_, member_.crc32));
    }
    return absl::OkStatus();
  }

  void Rewind() override {
    position_ = 0;
    crc_ = 0;
    fed_ = 0;
    is_at_end_ = false;
    inflateReset(&z_);
    z_.avail_in = 0;
  }
  [[nodiscard]] std::int64_t position() const override { return position_; }

 private:
  [[nodiscard]] absl::Status Damaged(absl::string_view what) const {
    return absl::DataLossError(absl::StrCat(file_.path(), ": ", base::Quoted(member_.name),
                                            " is damaged: ", what, "; copy the file again"));
  }

  // Finds the stored bytes.
  absl::Status Begin() {
    if (start_ > 0) {
      return absl::OkStatus();
    }
    const std::string name = base::Quoted(member_.name);
    if (member_.is_encrypted) {
      return ZipError(file_,
                      absl::StrCat(name, " is encrypted: unpack it, and give what is in it"));
    }
    if (member_.method != 0 && member_.method != 8) {
      return ZipError(file_,
                      absl::StrFormat("%s is compressed by method %d; expected 0 (stored) or "
                                      "8 (deflate): unpack it, and give what is in it",
                                      name, member_.method));
    }
    const auto name_size = static_cast<std::int64_t>(member_.name.size());
    if (file_.size_bytes() - member_.header_offset < kLocalBytes + name_size) {
      return ZipError(file_, absl::StrCat(name, " lies behind the end: the file is cut"));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string local,
                              ReadText(file_, member_.header_offset, kLocalBytes + name_size));
    if (!absl::StartsWith(local, kLocalMark) || Load<std::uint16_t>(local, 8) != member_.method ||
        Load<std::uint16_t>(local, 26) != member_.name.size() ||
        local.substr(static_cast<std::size_t>(kLocalBytes)) != member_.name) {
      return ZipError(file_, absl::StrFormat("at byte %d, where its directory has %s, there is no "
                                             "such member: damaged",
                                             member_.header_offset, name));
    }
    const std::int64_t start =
        member_.header_offset + kLocalBytes + name_size + Load<std::uint16_t>(local, 28);
    if (start > file_.size_bytes() - member_.stored_bytes) {
      return ZipError(file_, absl::StrCat(name, " ends behind the file: damaged"));
    }
    start_ = start;
    return absl::OkStatus();
  }

  absl::StatusOr<std::size_t> ReadStored(std::size_t size, char* out) {
    ISOSCOPE_RETURN_IF_ERROR(file_.ReadAt(start_ + position_, size, out));
    return size;
  }

  absl::StatusOr<std::size_t> Inflate(std::size_t size, char* out) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t got, InflateOnce(size, out));
    if (got == 0) {
      return Damaged(absl::StrFormat("its %d stored bytes end after %d of %d bytes",
                                     member_.stored_bytes, position_, member_.size_bytes));
    }
    return got;
  }

  // Returns 0 only at the end of the stream, or of the stored bytes.
  absl::StatusOr<std::size_t> InflateOnce(std::size_t size, char* out) {
    const std::size_t want = std::min<std::size_t>(size, std::numeric_limits<uInt>::max() / 2);
    while (!is_at_end_) {
      if (z_.avail_in == 0 && fed_ < member_.stored_bytes) {
        input_.resize(static_cast<std::size_t>(std::min<std::int64_t>(
            static_cast<std::int64_t>(kZipInputBytes), member_.stored_bytes - fed_)));
        ISOSCOPE_RETURN_IF_ERROR(file_.ReadAt(start_ + fed_, input_.size(), input_.data()));
        fed_ += static_cast<std::int64_t>(input_.size());
        z_.next_in = reinterpret_cast<Bytef*>(input_.data());
        z_.avail_in = static_cast<uInt>(input_.size());
      }
      z_.next_out = reinterpret_cast<Bytef*>(out);
      z_.avail_out = static_cast<uInt>(want);
      const int result = inflate(&z_, Z_NO_FLUSH);
      const std::size_t got = want - z_.avail_out;
      is_at_end_ = result == Z_STREAM_END;
      if (result != Z_OK && result != Z_STREAM_END && result != Z_BUF_ERROR) {
        return Damaged(absl::StrFormat("at its byte %d: %s", position_,
                                       z_.msg != nullptr ? z_.msg : "no deflated bytes"));
      }
      if (got > 0 || (z_.avail_in == 0 && fed_ == member_.stored_bytes)) {
        return got;
      }
    }
    return 0;
  }

  const ZipMember member_;
  const io::RandomAccessFile& file_;
  std::int64_t start_ = 0;  // of the stored bytes in the file; 0: not known yet
  std::int64_t position_ = 0;
  std::int64_t fed_ = 0;  // stored bytes that were given to zlib
  std::uint32_t crc_ = 0;
  bool is_at_end_ = false;  // of the deflated stream
  z_stream z_{};
  std::string input_;
};

}  // namespace

bool IsZip(absl::string_view head) { return absl::StartsWith(head, kLocalMark); }

std::string FirstZipName(absl::string_view head) {
  if (!IsZip(head) || head.size() < static_cast<std::size_t>(kLocalBytes)) {
    return "";
  }
  const std::size_t size = Load<std::uint16_t>(head, 26);
  head.remove_prefix(static_cast<std::size_t>(kLocalBytes));
  return std::string(head.substr(0, head.size() < size ? 0 : size));
}

absl::StatusOr<std::vector<ZipMember>> ReadZipMembers(const io::RandomAccessFile& file) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Directory directory, FindDirectory(file));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                            ReadText(file, directory.offset, directory.size));
  std::vector<ZipMember> members;
  std::set<absl::string_view> names;  // within `bytes`
  absl::string_view rest = bytes;
  for (std::int64_t i = 0; i < directory.count; ++i) {
    const bool is_entry = rest.size() >= kEntryBytes && absl::StartsWith(rest, kEntryMark);
    const std::size_t name_size = is_entry ? Load<std::uint16_t>(rest, 28) : 0;
    const std::size_t extra_size = is_entry ? Load<std::uint16_t>(rest, 30) : 0;
    const std::size_t size =
        kEntryBytes + name_size + extra_size + (is_entry ? Load<std::uint16_t>(rest, 32) : 0);
    if (!is_entry || size > rest.size()) {
      return ZipError(file, absl::StrFormat("entry %d of %d of its directory is cut or damaged", i,
                                            directory.count));
    }
    ZipMember member{.name = std::string(rest.substr(kEntryBytes, name_size)),
                     .header_offset = Load<std::uint32_t>(rest, 42),
                     .stored_bytes = Load<std::uint32_t>(rest, 20),
                     .size_bytes = Load<std::uint32_t>(rest, 24),
                     .crc32 = Load<std::uint32_t>(rest, 16),
                     .method = Load<std::uint16_t>(rest, 10),
                     .is_encrypted = (Load<std::uint16_t>(rest, 8) & 0x41) != 0};
    ISOSCOPE_RETURN_IF_ERROR(
        TakeLongNumbers(file, rest.substr(kEntryBytes + name_size, extra_size), &member));
    ISOSCOPE_RETURN_IF_ERROR(CheckSizes(file, directory, member));
    if (!names.insert(rest.substr(kEntryBytes, name_size)).second) {
      return ZipError(file, absl::StrCat("two members are named ", base::Quoted(member.name),
                                         ": unpack it, and give one of them"));
    }
    members.push_back(std::move(member));
    rest.remove_prefix(size);
  }
  if (!rest.empty()) {
    return ZipError(file,
                    absl::StrFormat("%d bytes behind the %d entries of its directory: damaged",
                                    rest.size(), directory.count));
  }
  return members;
}

std::unique_ptr<DecodedStream> MakeZipStream(const ZipMember& member,
                                             const io::RandomAccessFile* file) {
  return std::make_unique<ZipStream>(member, file);
}

}  // namespace isoscope::source
