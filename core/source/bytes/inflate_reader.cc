#include "core/source/bytes/inflate_reader.h"

#include <algorithm>
#include <limits>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "zlib.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kInputBytes = std::size_t{256} * 1024;

}  // namespace

class InflateReader::Stream {
 public:
  // 32: recognise gzip or zlib by its header.
  Stream() { ISOSCOPE_CHECK_EQ(inflateInit2(&z, MAX_WBITS + 32), Z_OK); }
  ~Stream() { inflateEnd(&z); }
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;

  z_stream z{};
  bool at_member_end = false;
  bool is_finished = false;  // the stream has ended
};

InflateReader::InflateReader(const io::RandomAccessFile* file, std::int64_t offset)
    : file_(file), start_(offset) {
  input_.resize(kInputBytes);
  Rewind();
}

InflateReader::~InflateReader() = default;

void InflateReader::Rewind() {
  stream_ = std::make_unique<Stream>();
  next_input_ = start_;
  position_ = 0;
}

absl::StatusOr<std::size_t> InflateReader::Read(std::size_t size, char* out) {
  z_stream& z = stream_->z;
  std::size_t done = 0;
  while (done < size && !stream_->is_finished) {
    if (z.avail_in == 0) {
      const std::int64_t rest = std::max<std::int64_t>(file_->size_bytes() - next_input_, 0);
      const std::size_t count = std::min<std::size_t>(kInputBytes, static_cast<std::size_t>(rest));
      if (count == 0) {
        break;
      }
      ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(next_input_, count, input_.data()));
      next_input_ += static_cast<std::int64_t>(count);
      z.next_in = reinterpret_cast<Bytef*>(input_.data());
      z.avail_in = static_cast<uInt>(count);
    }
    const bool is_first_member = stream_->z.total_out == 0 && position_ == 0 && done == 0;
    if (stream_->at_member_end) {
      inflateReset(&z);
      stream_->at_member_end = false;
    }
    const std::size_t want =
        std::min<std::size_t>(size - done, std::numeric_limits<uInt>::max() / 2);
    z.next_out = reinterpret_cast<Bytef*>(out + done);
    z.avail_out = static_cast<uInt>(want);
    const int result = inflate(&z, Z_NO_FLUSH);
    const std::size_t got = want - z.avail_out;
    done += got;
    position_ += static_cast<std::int64_t>(got);
    if (result == Z_STREAM_END) {
      stream_->at_member_end = true;
    } else if (result != Z_OK && result != Z_BUF_ERROR) {
      if (z.total_out == 0 && !is_first_member && got == 0) {
        stream_->is_finished = true;  // bytes after the last member that are no member
        break;
      }
      return absl::DataLossError(absl::StrFormat(
          "%s: compressed data is damaged at decoded byte %d (file offset about %d): %s",
          file_->path(), position_, next_input_ - static_cast<std::int64_t>(z.avail_in),
          z.msg != nullptr ? z.msg : "unknown error"));
    }
  }
  return done;
}

absl::Status InflateReader::VerifyEnd() {
  constexpr std::int64_t kMaxExtraBytes = base::kMiB;
  std::int64_t extra = 0;
  char scratch[512];
  while (!stream_->at_member_end && !stream_->is_finished && extra < kMaxExtraBytes) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t got, Read(sizeof(scratch), scratch));
    extra += static_cast<std::int64_t>(got);
    if (got < sizeof(scratch)) {
      if (!stream_->at_member_end && !stream_->is_finished) {
        return absl::InvalidArgumentError(absl::StrCat(
            file_->path(), ": the file ends at ", file_->size_bytes(),
            " bytes, before the end of its compressed data: it is cut; copy it again"));
      }
      break;
    }
  }
  return absl::OkStatus();
}

}  // namespace isoscope::source
