// Four encodings behind one interface. InflateReader is a file of its own, because others use it.
//
// bzip2 is blocks of up to 900 kB, which the library decodes whole: that makes its memory. Text and
// hexadecimal digits are parsed from portions of the file, and a number that crosses two portions
// is put together in `token_`.
//
//   kText, int16   "-7 260\n"  ->  f9 ff 04 01
//   kHex           "f9ff 0401" ->  f9 ff 04 01

#include "core/source/bytes/decoded_stream.h"

#include <bzlib.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/bytes/inflate_reader.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kPortionBytes = 64 * base::kKiB;

// The bytes of a file in portions.
class FilePortions {
 public:
  FilePortions(const io::RandomAccessFile* file, std::int64_t start)
      : file_(*file), start_(start), next_(start) {}

  void Rewind() { next_ = start_; }
  // The next portion; empty at the end of the file. Valid until the next call.
  absl::StatusOr<absl::string_view> Next() {
    const std::int64_t rest = std::max<std::int64_t>(file_.size_bytes() - next_, 0);
    bytes_.resize(std::min(kPortionBytes, static_cast<std::size_t>(rest)));
    if (!bytes_.empty()) {
      ISOSCOPE_RETURN_IF_ERROR(file_.ReadAt(next_, bytes_.size(), bytes_.data()));
      next_ += static_cast<std::int64_t>(bytes_.size());
    }
    return absl::string_view(bytes_.data(), bytes_.size());
  }
  [[nodiscard]] const io::RandomAccessFile& file() const { return file_; }

 private:
  const io::RandomAccessFile& file_;
  const std::int64_t start_;
  std::int64_t next_;
  std::vector<char> bytes_;
};

class Bunzip2Stream final : public DecodedStream {
 public:
  Bunzip2Stream(const io::RandomAccessFile* file, std::int64_t offset) : portions_(file, offset) {
    Begin();
  }
  ~Bunzip2Stream() override { BZ2_bzDecompressEnd(&bz_); }
  Bunzip2Stream(const Bunzip2Stream&) = delete;
  Bunzip2Stream& operator=(const Bunzip2Stream&) = delete;

  absl::StatusOr<std::size_t> Read(std::size_t size, char* out) override {
    std::size_t done = 0;
    while (done < size && !is_finished_) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t got, Step(size - done, out + done));
      done += got;
      position_ += static_cast<std::int64_t>(got);
    }
    return done;
  }

  absl::Status VerifyEnd() override {
    constexpr std::int64_t kMaxExtraBytes = base::kMiB;
    char scratch[512];
    for (std::int64_t extra = 0; !is_at_stream_end_ && extra < kMaxExtraBytes;) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t got, Read(sizeof(scratch), scratch));
      extra += static_cast<std::int64_t>(got);
      if (is_finished_ && !is_at_stream_end_) {
        return absl::InvalidArgumentError(absl::StrCat(
            portions_.file().path(), ": the file ends at ", portions_.file().size_bytes(),
            " bytes, before the end of its compressed data: it is cut; copy it again"));
      }
    }
    return absl::OkStatus();
  }

  void Rewind() override {
    BZ2_bzDecompressEnd(&bz_);
    portions_.Rewind();
    position_ = 0;
    Begin();
  }
  [[nodiscard]] std::int64_t position() const override { return position_; }

 private:
  void Begin() {
    bz_ = {};
    ISOSCOPE_CHECK_EQ(BZ2_bzDecompressInit(&bz_, 0, 0), BZ_OK);
    is_at_stream_end_ = false;
    is_finished_ = false;
  }

  // Decodes some bytes, up to `size`. Sets is_finished_ at the end of the file.
  absl::StatusOr<std::size_t> Step(std::size_t size, char* out) {
    if (bz_.avail_in == 0) {
      ISOSCOPE_ASSIGN_OR_RETURN(const absl::string_view portion, portions_.Next());
      if (portion.empty()) {
        is_finished_ = true;
        return 0;
      }
      bz_.next_in = const_cast<char*>(portion.data());  // the library does not write to it
      bz_.avail_in = static_cast<unsigned>(portion.size());
    }
    if (is_at_stream_end_) {  // another stream, or bytes that are none
      const bz_stream rest = bz_;
      BZ2_bzDecompressEnd(&bz_);
      Begin();
      bz_.next_in = rest.next_in;
      bz_.avail_in = rest.avail_in;
    }
    const std::size_t want = std::min<std::size_t>(size, std::numeric_limits<int>::max());
    bz_.next_out = out;
    bz_.avail_out = static_cast<unsigned>(want);
    const int result = BZ2_bzDecompress(&bz_);
    is_at_stream_end_ = result == BZ_STREAM_END;
    if (result == BZ_DATA_ERROR_MAGIC && position_ > 0) {
      is_finished_ = is_at_stream_end_ = true;  // bytes after the last stream
      return 0;
    }
    if (result != BZ_OK && result != BZ_STREAM_END) {
      return absl::DataLossError(
          absl::StrFormat("%s: bzip2 data is damaged at decoded byte %d; copy the file again",
                          portions_.file().path(), position_));
    }
    return want - bz_.avail_out;
  }

  FilePortions portions_;
  bz_stream bz_{};
  std::int64_t position_ = 0;
  bool is_at_stream_end_ = false;
  bool is_finished_ = false;  // the file has ended
};

// Text: tokens apart by separators.
class TextStream final : public DecodedStream {
 public:
  TextStream(SampleEncoding encoding, volume::ScalarType type, const io::RandomAccessFile* file,
             std::int64_t offset)
      : is_hex_(encoding == SampleEncoding::kHex), type_(type), portions_(file, offset) {}

  absl::StatusOr<std::size_t> Read(std::size_t size, char* out) override {
    const std::size_t unit = is_hex_ ? 1 : volume::SizeOf(type_);
    ISOSCOPE_CHECK(size % unit == 0);
    std::size_t done = 0;
    for (; done < size; done += unit) {
      ISOSCOPE_ASSIGN_OR_RETURN(const bool has_token, NextToken());
      if (!has_token) {
        break;
      }
      ISOSCOPE_RETURN_IF_ERROR(is_hex_ ? StoreByte(out + done) : StoreNumber(out + done));
      position_ += static_cast<std::int64_t>(unit);
    }
    return done;
  }
  absl::Status VerifyEnd() override { return absl::OkStatus(); }
  void Rewind() override {
    portions_.Rewind();
    portion_ = {};
    position_ = 0;
  }
  [[nodiscard]] std::int64_t position() const override { return position_; }

 private:
  [[nodiscard]] bool IsSeparator(char c) const {
    return absl::ascii_isspace(static_cast<unsigned char>(c)) || (c == ',' && !is_hex_);
  }

  // Takes a number, or two digits, into token_. False at the end of the file.
  absl::StatusOr<bool> NextToken() {
    constexpr std::size_t kMaxTokenBytes = 64;
    token_.clear();
    while (true) {
      if (portion_.empty()) {
        ISOSCOPE_ASSIGN_OR_RETURN(portion_, portions_.Next());
        if (portion_.empty()) {
          return !token_.empty();
        }
      }
      while (!portion_.empty()) {
        const char c = portion_.front();
        if (IsSeparator(c)) {
          portion_.remove_prefix(1);
          if (!token_.empty() && !is_hex_) {
            return true;
          }
          continue;
        }
        token_.push_back(c);
        portion_.remove_prefix(1);
        if (is_hex_ && token_.size() == 2) {
          return true;
        }
        if (token_.size() > kMaxTokenBytes) {
          return Bad("a number");
        }
      }
    }
  }

  absl::Status StoreByte(char* out) {
    const auto value = [](char c) {
      return c >= '0' && c <= '9'   ? c - '0'
             : c >= 'a' && c <= 'f' ? c - 'a' + 10
             : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                    : -1;
    };
    if (token_.size() != 2 || value(token_[0]) < 0 || value(token_[1]) < 0) {
      return Bad("two hexadecimal digits");
    }
    *out = static_cast<char>(value(token_[0]) * 16 + value(token_[1]));
    return absl::OkStatus();
  }

  absl::Status StoreNumber(char* out) {
    bool is_number = false;
    volume::VisitScalarType(type_, [&]<typename T>() {
      T value{};
      if constexpr (std::is_same_v<T, float>) {
        is_number = absl::SimpleAtof(token_, &value);
      } else {
        double number = 0;  // exact for integers of 32 bits; "7.0" and "1e3" are integers, too
        is_number = absl::SimpleAtod(token_, &number);
        if constexpr (std::is_integral_v<T>) {
          is_number = is_number && number == std::trunc(number) &&
                      number >= static_cast<double>(std::numeric_limits<T>::min()) &&
                      number <= static_cast<double>(std::numeric_limits<T>::max());
        }
        value = is_number ? static_cast<T>(number) : T{};
      }
      base::StoreLittleEndian(value, out);
    });
    return is_number ? absl::OkStatus() : Bad(volume::NameOf(type_));
  }

  [[nodiscard]] absl::Status Bad(absl::string_view expected) const {
    return absl::DataLossError(absl::StrFormat(
        "%s: sample %d is \"%s\"; expected %s: the text of the samples is damaged, or the header "
        "has another type",
        portions_.file().path(),
        position_ / static_cast<std::int64_t>(is_hex_ ? 1 : volume::SizeOf(type_)),
        base::Printable(token_), expected));
  }

  const bool is_hex_;
  const volume::ScalarType type_;
  FilePortions portions_;
  absl::string_view portion_;  // what is left of it
  std::string token_;
  std::int64_t position_ = 0;
};

}  // namespace

absl::StatusOr<std::int64_t> DecodedStream::Skip(std::int64_t size) {
  std::vector<char> scratch(kPortionBytes);
  std::int64_t skipped = 0;
  while (skipped < size) {
    const auto want = static_cast<std::size_t>(
        std::min(size - skipped, static_cast<std::int64_t>(scratch.size())));
    ISOSCOPE_ASSIGN_OR_RETURN(const std::size_t got, Read(want, scratch.data()));
    skipped += static_cast<std::int64_t>(got);
    if (got < want) {
      break;
    }
  }
  return skipped;
}

std::unique_ptr<DecodedStream> MakeDecodedStream(SampleEncoding encoding, volume::ScalarType type,
                                                 const io::RandomAccessFile* file,
                                                 std::int64_t offset) {
  switch (encoding) {
    case SampleEncoding::kRaw:
    case SampleEncoding::kZip:
    case SampleEncoding::kDeflate:
      break;
    case SampleEncoding::kBzip2:
      return std::make_unique<Bunzip2Stream>(file, offset);
    case SampleEncoding::kText:
    case SampleEncoding::kHex:
      return std::make_unique<TextStream>(encoding, type, file, offset);
  }
  return std::make_unique<InflateReader>(file, offset);
}

std::int64_t DecodedStreamBytes(SampleEncoding encoding) {
  switch (encoding) {
    case SampleEncoding::kRaw:
      return 0;
    case SampleEncoding::kDeflate:
    case SampleEncoding::kZip:
      return 512 * base::kKiB;
    case SampleEncoding::kBzip2:
      return 4 * base::kMiB;  // 3700 kB of the library, by its manual
    case SampleEncoding::kText:
    case SampleEncoding::kHex:
      return 2 * static_cast<std::int64_t>(kPortionBytes);
  }
  return 0;
}

}  // namespace isoscope::source
