// A member is its local header, then its stored bytes (zip_directory.cc has all of an archive). Sizes
// of a local header may be 0, and follow the stored bytes then.

#include "core/source/bytes/zip_file.h"

#include <algorithm>
#include <cstddef>
#include <limits>
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
constexpr std::int64_t kLocalBytes = 30;
constexpr std::size_t kZipInputBytes = 256 * base::kKiB;

template <typename T>
T Load(absl::string_view bytes, std::size_t offset) {
  return base::LoadLittleEndian<T>(bytes.data() + offset);
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
  return ReadZipDirectory({.name = file.path(),
                           .size_bytes = file.size_bytes(),
                           .read_at = [&](std::int64_t offset, std::size_t size,
                                          char* out) { return file.ReadAt(offset, size, out); }},
                          {});
}

std::unique_ptr<DecodedStream> MakeZipStream(const ZipMember& member,
                                             const io::RandomAccessFile* file) {
  return std::make_unique<ZipStream>(member, file);
}

}  // namespace isoscope::source
