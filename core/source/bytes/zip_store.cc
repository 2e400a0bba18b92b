// Source: PKWARE's APPNOTE 6.3.10. All numbers are little-endian.
//
//   local header (30 bytes, name, extra), data, ...      of each member
//   entry (46 bytes, name, extra, comment), ...          the central directory
//   [end of Zip64 (56 bytes), its locator (20 bytes)]
//   end (22 bytes, comment)
//
// Sizes and places of 32 bits that are all ones stand in the extra field 1 of the entry, in the
// order size, packed size, place. The local header counts for one thing only: how long its name and
// its extra field are, behind which the data begin.

#include "core/source/bytes/zip_store.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

#include "core/base/coding.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "zlib.h"

namespace isoscope::source {
namespace {

constexpr std::uint32_t kZipEntry = 0x02014b50;
constexpr std::uint32_t kZipLocal = 0x04034b50;
constexpr std::uint32_t kZipEnd = 0x06054b50;
constexpr std::uint32_t kZip64End = 0x06064b50;
constexpr std::uint32_t kZip64Locator = 0x07064b50;
constexpr std::int64_t kZipEndBytes = 22;
constexpr std::int64_t kZip64LocatorBytes = 20;
constexpr std::int64_t kZip64EndBytes = 56;
constexpr std::size_t kZipLocalBytes = 30;
constexpr std::size_t kZipEntryBytes = 46;
constexpr std::int64_t kMaxZipComment = 65535;
constexpr std::int64_t kMaxZipDirectory = std::int64_t{1} << 30;
constexpr std::uint16_t kStored = 0;
constexpr std::uint16_t kDeflated = 8;
constexpr std::uint32_t kOnes32 = 0xffffffff;

struct ZipMember {
  std::int64_t place = 0;  // of its local header
  std::int64_t packed_bytes = 0;
  std::int64_t bytes = 0;
  std::uint32_t crc32 = 0;
  std::uint16_t method = kStored;
  bool is_encrypted = false;
};

template <typename T>
T ZipNumber(absl::string_view bytes, std::size_t offset) {
  return base::LoadLittleEndian<T>(bytes.data() + offset);
}

struct ZipDirectory {
  std::int64_t place = 0;
  std::int64_t bytes = 0;
};

absl::Status BadZip(const ByteSource& bytes, absl::string_view what) {
  return absl::InvalidArgumentError(
      absl::StrCat(bytes.name(), ": ", what, ": no ZIP archive, or it is damaged or cut"));
}

absl::StatusOr<std::string> ReadZip(const ByteSource& bytes, std::int64_t offset, std::int64_t size,
                                    const base::Cancellation& cancellation) {
  if (offset < 0 || size < 0 || offset > bytes.size_bytes() || size > bytes.size_bytes() - offset) {
    return BadZip(bytes, absl::StrFormat("%d bytes at %d of %d", size, offset, bytes.size_bytes()));
  }
  std::string read(static_cast<std::size_t>(size), '\0');
  ISOSCOPE_RETURN_IF_ERROR(bytes.ReadAt(offset, read.size(), read.data(), cancellation));
  return read;
}

absl::StatusOr<ZipDirectory> FindZipDirectory(const ByteSource& bytes,
                                              const base::Cancellation& cancellation) {
  // The end stands before a comment of unknown length.
  const std::int64_t all = bytes.size_bytes();
  const std::int64_t tail_bytes = std::min(all, kZipEndBytes + kMaxZipComment + kZip64LocatorBytes);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string tail,
                            ReadZip(bytes, all - tail_bytes, tail_bytes, cancellation));
  std::int64_t end = -1;  // in the tail
  for (std::int64_t i = tail_bytes - kZipEndBytes; i >= 0; --i) {
    const auto at = static_cast<std::size_t>(i);
    if (ZipNumber<std::uint32_t>(tail, at) == kZipEnd &&
        i + kZipEndBytes + ZipNumber<std::uint16_t>(tail, at + 20) == tail_bytes) {
      end = i;
      break;
    }
  }
  if (end < 0) {
    return BadZip(bytes, "its end has no directory");
  }
  const auto at = static_cast<std::size_t>(end);
  const auto disk = ZipNumber<std::uint16_t>(tail, at + 4);
  if (disk != 0 && disk != 0xffff) {
    return BadZip(bytes, "a part of an archive of several");
  }
  ZipDirectory directory{.place = ZipNumber<std::uint32_t>(tail, at + 16),
                         .bytes = ZipNumber<std::uint32_t>(tail, at + 12)};
  const std::int64_t locator = end - kZip64LocatorBytes;
  if (locator >= 0 &&
      ZipNumber<std::uint32_t>(tail, static_cast<std::size_t>(locator)) == kZip64Locator) {
    const auto place = ZipNumber<std::uint64_t>(tail, static_cast<std::size_t>(locator) + 8);
    if (place > static_cast<std::uint64_t>(all)) {
      return BadZip(bytes, absl::StrFormat("its Zip64 end lies at %d of %d", place, all));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::string zip64,
        ReadZip(bytes, static_cast<std::int64_t>(place), kZip64EndBytes, cancellation));
    const auto size = ZipNumber<std::uint64_t>(zip64, 40);
    const auto offset = ZipNumber<std::uint64_t>(zip64, 48);
    if (ZipNumber<std::uint32_t>(zip64, 0) != kZip64End || size > static_cast<std::uint64_t>(all) ||
        offset > static_cast<std::uint64_t>(all)) {
      return BadZip(bytes, "its Zip64 end makes no sense");
    }
    directory = {.place = static_cast<std::int64_t>(offset),
                 .bytes = static_cast<std::int64_t>(size)};
  }
  if (directory.bytes > kMaxZipDirectory) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: a directory of %d bytes; expected at most %d: write it in shards (Zarr 3)",
        bytes.name(), directory.bytes, kMaxZipDirectory));
  }
  return directory;
}

// Sets those of 64 bits.
bool TakeZip64(absl::string_view extra, bool has_bytes, bool has_packed, bool has_place,
               ZipMember* member) {
  constexpr auto kMost = static_cast<std::uint64_t>(std::int64_t{1} << 60);
  while (extra.size() >= 4) {
    const auto id = ZipNumber<std::uint16_t>(extra, 0);
    const auto size = ZipNumber<std::uint16_t>(extra, 2);
    if (size > extra.size() - 4) {
      return false;
    }
    if (id == 1) {
      base::Decoder decoder(extra.substr(4, size));
      std::uint64_t number = 0;
      for (const auto& [is_there, place] :
           {std::pair{has_bytes, &member->bytes}, std::pair{has_packed, &member->packed_bytes},
            std::pair{has_place, &member->place}}) {
        if (is_there) {
          if (!decoder.Read(&number) || number > kMost) {
            return false;
          }
          *place = static_cast<std::int64_t>(number);
        }
      }
      return true;
    }
    extra.remove_prefix(std::size_t{4} + size);
  }
  return !has_bytes && !has_packed && !has_place;
}

absl::StatusOr<std::map<std::string, ZipMember>> ReadZipDirectory(const ByteSource& bytes,
                                                                  const std::string& folder) {
  const base::Cancellation never;
  ISOSCOPE_ASSIGN_OR_RETURN(const ZipDirectory directory, FindZipDirectory(bytes, never));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string all,
                            ReadZip(bytes, directory.place, directory.bytes, never));
  std::map<std::string, ZipMember> members;
  absl::string_view rest = all;
  while (!rest.empty()) {
    if (rest.size() < kZipEntryBytes || ZipNumber<std::uint32_t>(rest, 0) != kZipEntry) {
      return BadZip(bytes,
                    absl::StrFormat("entry %d of its directory makes no sense", members.size()));
    }
    const std::size_t name_bytes = ZipNumber<std::uint16_t>(rest, 28);
    const std::size_t extra_bytes = ZipNumber<std::uint16_t>(rest, 30);
    const std::size_t comment_bytes = ZipNumber<std::uint16_t>(rest, 32);
    const std::size_t entry_bytes = kZipEntryBytes + name_bytes + extra_bytes + comment_bytes;
    if (entry_bytes > rest.size()) {
      return BadZip(bytes, "its directory ends within an entry");
    }
    const auto packed = ZipNumber<std::uint32_t>(rest, 20);
    const auto size = ZipNumber<std::uint32_t>(rest, 24);
    const auto place = ZipNumber<std::uint32_t>(rest, 42);
    ZipMember member{.place = place,
                     .packed_bytes = packed,
                     .bytes = size,
                     .crc32 = ZipNumber<std::uint32_t>(rest, 16),
                     .method = ZipNumber<std::uint16_t>(rest, 10),
                     .is_encrypted = (ZipNumber<std::uint16_t>(rest, 8) & 1U) != 0};
    std::string name(rest.substr(kZipEntryBytes, name_bytes));
    if (!TakeZip64(rest.substr(kZipEntryBytes + name_bytes, extra_bytes), size == kOnes32,
                   packed == kOnes32, place == kOnes32, &member)) {
      return BadZip(bytes, absl::StrFormat("the sizes of \"%s\" make no sense",
                                           base::Printable(base::CutText(name, 80))));
    }
    if (!name.empty() && name.back() != '/' && absl::StartsWith(name, folder)) {
      members[name.substr(folder.size())] = member;  // the last of a name counts, as for unzip
    }
    rest.remove_prefix(entry_bytes);
  }
  return members;
}

// What a read asks for, in the bytes of a member.
struct ZipRange {
  std::int64_t begin = 0;
  std::int64_t size = 0;
};

class ZipMembers final : public ZipStore {
 public:
  ZipMembers(std::shared_ptr<const ByteSource> bytes, std::map<std::string, ZipMember> members)
      : bytes_(std::move(bytes)), members_(std::move(members)) {}

  [[nodiscard]] std::vector<std::string> Names() const override {
    std::vector<std::string> names;
    for (const auto& [name, member] : members_) {
      names.push_back(name);
    }
    return names;
  }
  [[nodiscard]] std::vector<std::string> NamesBelow(const std::string& folder) const override {
    const std::string prefix = folder.empty() ? "" : absl::StrCat(folder, "/");
    std::vector<std::string> names;
    for (auto member = members_.lower_bound(prefix);
         member != members_.end() && absl::StartsWith(member->first, prefix);) {
      const std::size_t end = member->first.find('/', prefix.size());
      names.push_back(member->first.substr(prefix.size(),
                                           end == std::string::npos ? end : end - prefix.size()));
      // '0' follows '/': past all below that folder.
      member = end == std::string::npos
                   ? std::next(member)
                   : members_.lower_bound(absl::StrCat(member->first.substr(0, end), "0"));
    }
    return names;
  }

  [[nodiscard]] std::vector<absl::StatusOr<std::string>> Read(
      absl::Span<const ObjectRead> reads, const base::Cancellation& cancellation) const override {
    std::vector<absl::StatusOr<std::string>> parts(reads.size(), absl::UnknownError("not read"));
    // 1. The local headers of all of them, at once.
    std::vector<const ZipMember*> members(reads.size(), nullptr);
    std::vector<ZipRange> ranges(reads.size());
    std::vector<std::string> heads(reads.size());
    std::vector<ByteRange> wanted;
    for (std::size_t i = 0; i < reads.size(); ++i) {
      auto member = FindMember(reads[i], &ranges[i]);
      if (!member.ok()) {
        parts[i] = member.status();
        continue;
      }
      members[i] = *member;
      heads[i].resize(kZipLocalBytes);
      wanted.push_back(
          {.offset = members[i]->place, .size = kZipLocalBytes, .out = heads[i].data()});
    }
    absl::Status status = bytes_->ReadRanges(wanted, cancellation);
    // 2. Their bytes, at once.
    wanted.clear();
    for (std::size_t i = 0; i < reads.size(); ++i) {
      if (members[i] == nullptr) {
        continue;
      }
      const auto data = status.ok() ? DataOf(*members[i], heads[i], reads[i].key)
                                    : absl::StatusOr<std::int64_t>(status);
      if (!data.ok()) {
        parts[i] = data.status();
        members[i] = nullptr;
        continue;
      }
      const bool is_stored = members[i]->method == kStored;
      parts[i] = std::string(
          static_cast<std::size_t>(is_stored ? ranges[i].size : members[i]->packed_bytes), '\0');
      wanted.push_back({.offset = *data + (is_stored ? ranges[i].begin : 0),
                        .size = parts[i]->size(),
                        .out = parts[i]->data()});
    }
    status = bytes_->ReadRanges(wanted, cancellation);
    // 3. What they hold.
    for (std::size_t i = 0; i < reads.size(); ++i) {
      if (members[i] != nullptr) {
        parts[i] = status.ok() ? PartOf(*members[i], ranges[i], reads[i].key, *std::move(parts[i]))
                               : absl::StatusOr<std::string>(status);
      }
    }
    return parts;
  }

  [[nodiscard]] absl::StatusOr<std::unique_ptr<ByteSource>> Open(
      const std::string& key, const base::Cancellation& cancellation) const override;

  [[nodiscard]] const std::string& name() const override { return bytes_->name(); }

 private:
  [[nodiscard]] std::string NameOf(const std::string& key) const {
    return absl::StrCat(name(), "/", base::Printable(base::CutText(key, 200)));
  }

  [[nodiscard]] absl::StatusOr<const ZipMember*> FindMember(const ObjectRead& read,
                                                            ZipRange* range) const {
    for (const absl::string_view part : absl::StrSplit(read.key, '/')) {
      if (part.empty() || part == "." || part == "..") {
        return absl::InvalidArgumentError(absl::StrFormat(
            "%s: key \"%s\" has a part that is empty, \".\" or \"..\"", name(), read.key));
      }
    }
    const auto found = members_.find(read.key);
    if (found == members_.end()) {
      return absl::NotFoundError(absl::StrCat(NameOf(read.key), ": no such member"));
    }
    const ZipMember& member = found->second;
    if (member.is_encrypted || (member.method != kStored && member.method != kDeflated)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %s; expected a member that is stored or deflated: write the archive again (zip -0)",
          NameOf(read.key),
          member.is_encrypted ? "it is encrypted" : absl::StrCat("it has method ", member.method)));
    }
    if (member.method == kStored && member.packed_bytes != member.bytes) {
      return absl::DataLossError(absl::StrFormat("%s: stored are %d bytes of %d: it is damaged",
                                                 NameOf(read.key), member.packed_bytes,
                                                 member.bytes));
    }
    range->begin = read.offset < 0 ? member.bytes + read.offset : read.offset;
    range->size = read.size < 0 ? member.bytes - range->begin : read.size;
    if (range->begin < 0 || range->begin > member.bytes ||
        range->size > member.bytes - range->begin) {
      return absl::OutOfRangeError(absl::StrFormat("%s: no %d bytes from %d on, of %d",
                                                   NameOf(read.key), read.size, read.offset,
                                                   member.bytes));
    }
    // A deflated member is in memory as a whole, packed and inflated.
    const std::int64_t least = member.method == kStored ? range->size : member.bytes;
    if (least > read.max_size ||
        (member.method != kStored && member.packed_bytes > MostDeflated(member.bytes))) {
      return absl::ResourceExhaustedError(
          absl::StrFormat("%s: %d bytes (%d packed); expected at most %d", NameOf(read.key), least,
                          member.packed_bytes, read.max_size));
    }
    return &member;
  }

  [[nodiscard]] static std::int64_t MostDeflated(std::int64_t bytes) {
    return bytes + bytes / 100 + 1024;
  }

  // Where its data begin.
  [[nodiscard]] absl::StatusOr<std::int64_t> DataOf(const ZipMember& member,
                                                    const std::string& head,
                                                    const std::string& key) const {
    const std::int64_t data = member.place + static_cast<std::int64_t>(kZipLocalBytes) +
                              ZipNumber<std::uint16_t>(head, 26) +
                              ZipNumber<std::uint16_t>(head, 28);
    if (ZipNumber<std::uint32_t>(head, 0) != kZipLocal || data > bytes_->size_bytes() ||
        member.packed_bytes > bytes_->size_bytes() - data) {
      return absl::DataLossError(
          absl::StrFormat("%s: %d bytes at %d of %d: the archive is damaged or cut", NameOf(key),
                          member.packed_bytes, member.place, bytes_->size_bytes()));
    }
    return data;
  }

  [[nodiscard]] absl::StatusOr<std::string> PartOf(const ZipMember& member, const ZipRange& range,
                                                   const std::string& key,
                                                   std::string packed) const {
    if (member.method == kDeflated) {
      ISOSCOPE_ASSIGN_OR_RETURN(packed, Inflate(member, key, packed));
    }
    const bool is_whole = static_cast<std::int64_t>(packed.size()) == member.bytes;
    if (is_whole &&
        crc32_z(0, reinterpret_cast<const Bytef*>(packed.data()), packed.size()) != member.crc32) {
      return absl::DataLossError(
          absl::StrCat(NameOf(key), ": its checksum is wrong: the archive is damaged"));
    }
    return member.method == kStored ? std::move(packed)
                                    : packed.substr(static_cast<std::size_t>(range.begin),
                                                    static_cast<std::size_t>(range.size));
  }

  [[nodiscard]] absl::StatusOr<std::string> Inflate(const ZipMember& member, const std::string& key,
                                                    const std::string& packed) const {
    constexpr std::int64_t kMost = std::numeric_limits<uInt>::max();
    if (member.bytes >= kMost || member.packed_bytes >= kMost) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %d bytes that are deflated; expected less than 4 GiB", NameOf(key), member.bytes));
    }
    std::string out(static_cast<std::size_t>(member.bytes) + 1, '\0');
    z_stream z{};
    if (inflateInit2(&z, -15) != Z_OK) {
      return absl::ResourceExhaustedError("no memory for zlib");
    }
    z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
    z.avail_in = static_cast<uInt>(packed.size());
    z.next_out = reinterpret_cast<Bytef*>(out.data());
    z.avail_out = static_cast<uInt>(out.size());
    const int result = inflate(&z, Z_FINISH);
    const bool is_good = result == Z_STREAM_END && z.avail_out == 1;
    inflateEnd(&z);
    out.resize(out.size() - 1);
    return is_good ? absl::StatusOr<std::string>(std::move(out))
                   : absl::DataLossError(absl::StrFormat(
                         "%s: it does not inflate to %d bytes: the archive is damaged", NameOf(key),
                         member.bytes));
  }

  const std::shared_ptr<const ByteSource> bytes_;
  const std::map<std::string, ZipMember> members_;
};

// A member that is stored: a window of the archive; or one that was inflated.
class ZipWindow final : public ByteSource {
 public:
  ZipWindow(std::shared_ptr<const ByteSource> archive, std::int64_t begin, std::int64_t size,
            std::string inflated, std::string name)
      : archive_(std::move(archive)),
        begin_(begin),
        size_(size),
        inflated_(std::move(inflated)),
        name_(std::move(name)) {}

  [[nodiscard]] absl::Status ReadRanges(absl::Span<const ByteRange> ranges,
                                        const base::Cancellation& cancellation) const override {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    std::vector<ByteRange> moved(ranges.begin(), ranges.end());
    for (ByteRange& range : moved) {
      if (range.offset < 0 || range.offset > size_ ||
          range.size > static_cast<std::size_t>(size_ - range.offset)) {
        return absl::OutOfRangeError(absl::StrFormat("%s: no %d bytes from %d on, of %d", name_,
                                                     range.size, range.offset, size_));
      }
      if (begin_ < 0) {
        inflated_.copy(range.out, range.size, static_cast<std::size_t>(range.offset));
      }
      range.offset += begin_;
    }
    return begin_ < 0 ? absl::OkStatus() : archive_->ReadRanges(moved, cancellation);
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return size_; }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] std::string version() const override { return archive_->version(); }

 private:
  const std::shared_ptr<const ByteSource> archive_;
  const std::int64_t begin_;  // negative: it was inflated
  const std::int64_t size_;
  const std::string inflated_;
  const std::string name_;
};

absl::StatusOr<std::unique_ptr<ByteSource>> ZipMembers::Open(
    const std::string& key, const base::Cancellation& cancellation) const {
  constexpr std::int64_t kMaxInflated = std::int64_t{1} << 30;
  const ObjectRead all{.key = key, .max_size = std::numeric_limits<std::int64_t>::max()};
  ZipRange range;
  ISOSCOPE_ASSIGN_OR_RETURN(const ZipMember* const member, FindMember(all, &range));
  if (member->method == kStored) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::string head,
        ReadZip(*bytes_, member->place, static_cast<std::int64_t>(kZipLocalBytes), cancellation));
    ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t data, DataOf(*member, head, key));
    return std::make_unique<ZipWindow>(bytes_, data, member->bytes, "", NameOf(key));
  }
  const ObjectRead bounded{.key = key, .max_size = kMaxInflated};
  std::vector<absl::StatusOr<std::string>> parts = Read({&bounded, 1}, cancellation);
  ISOSCOPE_RETURN_IF_ERROR(parts[0].status());
  return std::make_unique<ZipWindow>(bytes_, -1, member->bytes, *std::move(parts[0]), NameOf(key));
}

}  // namespace

absl::StatusOr<std::unique_ptr<ZipStore>> OpenZipStore(std::shared_ptr<const ByteSource> bytes,
                                                       const std::string& folder) {
  ISOSCOPE_ASSIGN_OR_RETURN(
      auto members, ReadZipDirectory(*bytes, folder.empty() ? "" : absl::StrCat(folder, "/")));
  return std::make_unique<ZipMembers>(std::move(bytes), std::move(members));
}

}  // namespace isoscope::source
