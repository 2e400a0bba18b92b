// The local header in front of a member's bytes counts for one thing only: how long its name and its
// extra field are, behind which the bytes begin (zip_directory.cc has all of an archive).

#include "core/source/bytes/zip_store.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

#include "core/base/coding.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/bytes/zip_directory.h"
#include "zlib.h"

namespace isoscope::source {
namespace {

constexpr std::uint32_t kZipLocal = 0x04034b50;
constexpr std::size_t kZipLocalBytes = 30;
// A store has a member for each chunk.
constexpr ZipLimits kStoreLimits{
    .directory_bytes = base::kGiB, .members = 20'000'000, .takes_last_of_a_name = true};
// A deflated member of which a part is read, as a shard, is inflated as a whole.
constexpr std::int64_t kMaxPartlyRead = 256 * base::kMiB;
constexpr int kStored = 0;
constexpr int kDeflated = 8;

template <typename T>
T ZipNumber(absl::string_view bytes, std::size_t offset) {
  return base::LoadLittleEndian<T>(bytes.data() + offset);
}

absl::StatusOr<std::map<std::string, ZipMember>> MembersBelow(const ByteSource& bytes,
                                                              const std::string& folder) {
  const base::Cancellation never;
  ISOSCOPE_ASSIGN_OR_RETURN(
      std::vector<ZipMember> all,
      ReadZipDirectory(
          {.name = bytes.name(),
           .size_bytes = bytes.size_bytes(),
           .read_at = [&](std::int64_t offset, std::size_t size,
                          char* out) { return bytes.ReadAt(offset, size, out, never); }},
          kStoreLimits));
  std::map<std::string, ZipMember> members;
  for (ZipMember& member : all) {
    if (!member.name.empty() && !member.is_folder() && absl::StartsWith(member.name, folder)) {
      std::string name = member.name.substr(folder.size());
      member.name.clear();
      members[std::move(name)] = std::move(member);
    }
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
          {.offset = members[i]->header_offset, .size = kZipLocalBytes, .out = heads[i].data()});
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
      if (IsAsBefore(members, i)) {
        continue;  // it was inflated already
      }
      const bool is_stored = members[i]->method == kStored;
      parts[i] = std::string(
          static_cast<std::size_t>(is_stored ? ranges[i].size : members[i]->stored_bytes), '\0');
      wanted.push_back({.offset = *data + (is_stored ? ranges[i].begin : 0),
                        .size = parts[i]->size(),
                        .out = parts[i]->data()});
    }
    status = bytes_->ReadRanges(wanted, cancellation);
    // 3. What they hold.
    absl::StatusOr<std::string> whole = absl::UnknownError("");  // the last deflated member
    for (std::size_t i = 0; i < reads.size(); ++i) {
      if (members[i] == nullptr) {
        continue;
      }
      const ZipMember& member = *members[i];
      if (!status.ok()) {
        parts[i] = status;
      } else if (member.method == kStored) {
        parts[i] = Checked(member, reads[i].key, *std::move(parts[i]));
      } else {
        if (!IsAsBefore(members, i)) {
          whole = Inflate(member, reads[i].key, *parts[i]);
          whole = whole.ok() ? Checked(member, reads[i].key, *std::move(whole)) : std::move(whole);
        }
        parts[i] = whole.ok() ? absl::StatusOr<std::string>(
                                    whole->substr(static_cast<std::size_t>(ranges[i].begin),
                                                  static_cast<std::size_t>(ranges[i].size)))
                              : whole.status();
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
    range->begin = read.offset < 0 ? member.size_bytes + read.offset : read.offset;
    range->size = read.size < 0 ? member.size_bytes - range->begin : read.size;
    if (range->begin < 0 || range->begin > member.size_bytes ||
        range->size > member.size_bytes - range->begin) {
      return absl::OutOfRangeError(absl::StrFormat("%s: no %d bytes from %d on, of %d",
                                                   NameOf(read.key), read.size, read.offset,
                                                   member.size_bytes));
    }
    // A deflated member is in memory as a whole, packed and inflated, whatever part is asked for.
    const bool is_part = member.method == kDeflated && read.size >= 0;
    const std::int64_t least = member.method == kStored ? range->size : member.size_bytes;
    const std::int64_t most = is_part ? std::max(read.max_size, kMaxPartlyRead) : read.max_size;
    if (range->size > read.max_size || least > most ||
        (member.method != kStored && member.stored_bytes > MostDeflated(member.size_bytes))) {
      return absl::ResourceExhaustedError(
          absl::StrFormat("%s: %d bytes (%d packed); expected at most %d%s", NameOf(read.key),
                          least, member.stored_bytes, most,
                          is_part ? ": write the archive again without packing (zip -0)" : ""));
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
    const std::int64_t data = member.header_offset + static_cast<std::int64_t>(kZipLocalBytes) +
                              ZipNumber<std::uint16_t>(head, 26) +
                              ZipNumber<std::uint16_t>(head, 28);
    if (ZipNumber<std::uint32_t>(head, 0) != kZipLocal || data > bytes_->size_bytes() ||
        member.stored_bytes > bytes_->size_bytes() - data) {
      return absl::DataLossError(
          absl::StrFormat("%s: %d bytes at %d of %d: the archive is damaged or cut", NameOf(key),
                          member.stored_bytes, member.header_offset, bytes_->size_bytes()));
    }
    return data;
  }

  // True if a read is of the same deflated member as the read before it.
  [[nodiscard]] static bool IsAsBefore(const std::vector<const ZipMember*>& members,
                                       std::size_t i) {
    return i > 0 && members[i] == members[i - 1] && members[i]->method == kDeflated;
  }

  // The checksum is that of all bytes: parts have none.
  [[nodiscard]] absl::StatusOr<std::string> Checked(const ZipMember& member, const std::string& key,
                                                    std::string bytes) const {
    const bool is_whole = static_cast<std::int64_t>(bytes.size()) == member.size_bytes;
    if (is_whole &&
        crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()) != member.crc32) {
      return absl::DataLossError(
          absl::StrCat(NameOf(key), ": its checksum is wrong: the archive is damaged"));
    }
    return bytes;
  }

  [[nodiscard]] absl::StatusOr<std::string> Inflate(const ZipMember& member, const std::string& key,
                                                    const std::string& packed) const {
    constexpr std::int64_t kMost = std::numeric_limits<uInt>::max();
    if (member.size_bytes >= kMost || member.stored_bytes >= kMost) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: %d bytes that are deflated; expected less than 4 GiB", NameOf(key),
                          member.size_bytes));
    }
    std::string out(static_cast<std::size_t>(member.size_bytes) + 1, '\0');
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
                         member.size_bytes));
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
    std::string head(kZipLocalBytes, '\0');
    ISOSCOPE_RETURN_IF_ERROR(
        bytes_->ReadAt(member->header_offset, head.size(), head.data(), cancellation));
    ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t data, DataOf(*member, head, key));
    return std::make_unique<ZipWindow>(bytes_, data, member->size_bytes, "", NameOf(key));
  }
  const ObjectRead bounded{.key = key, .max_size = kMaxInflated};
  std::vector<absl::StatusOr<std::string>> parts = Read({&bounded, 1}, cancellation);
  ISOSCOPE_RETURN_IF_ERROR(parts[0].status());
  return std::make_unique<ZipWindow>(bytes_, -1, member->size_bytes, *std::move(parts[0]),
                                     NameOf(key));
}

}  // namespace

absl::StatusOr<std::unique_ptr<ZipStore>> OpenZipStore(std::shared_ptr<const ByteSource> bytes,
                                                       const std::string& folder) {
  ISOSCOPE_ASSIGN_OR_RETURN(auto members,
                            MembersBelow(*bytes, folder.empty() ? "" : absl::StrCat(folder, "/")));
  return std::make_unique<ZipMembers>(std::move(bytes), std::move(members));
}

}  // namespace isoscope::source
