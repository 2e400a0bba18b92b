// A file is parts, each a header and samples, filled up to blocks of 2880 bytes. A header is cards
// of 80 characters up to END:
//
//   SIMPLE  =                    T / the first part; others: XTENSION= 'IMAGE   '
//   BITPIX  =                  -32 / 8, 16, 32, 64; floats: -32, -64
//   NAXIS   =                    3
//   NAXIS1  =                  512 / the fastest axis
//   ...
//   BUNIT   = 'Jy/beam '
//   END
//
// The samples have |BITPIX| / 8 * GCOUNT * (PCOUNT + the product of axes) bytes, big-endian. In
// groups NAXIS1 is 0, and does not count. Source: FITS Standard 4.0, sections 3, 4 and 7.

#include "core/formats/arrays/fits_header.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <limits>
#include <memory>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"

#include "core/base/printable.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/bytes/file_start.h"
#include "core/source/bytes/inflate_reader.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kBlockBytes = 2880;
constexpr std::size_t kCardBytes = 80;
constexpr std::int64_t kMaxFitsHeaderBytes = 4 * base::kMiB;
constexpr std::int64_t kMaxParts = 10'000;
constexpr std::int64_t kMaxFitsAxes = 999;  // of the standard
constexpr std::int64_t kMostBytes = std::numeric_limits<std::int64_t>::max() / 4;

// The bytes of the file front to back, decoded.
class FitsBytes {
 public:
  FitsBytes(const io::RandomAccessFile* file, bool is_gzip) : file_(*file) {
    if (is_gzip) {
      stream_ = std::make_unique<InflateReader>(file, 0);
    }
  }

  // The block at `offset`, which does not lie before earlier ones; "" behind the end, and shorter at
  // the end.
  absl::StatusOr<std::string> BlockAt(std::int64_t offset) {
    std::string block(static_cast<std::size_t>(kBlockBytes), '\0');
    std::size_t got = 0;
    if (stream_ != nullptr) {
      ISOSCOPE_RETURN_IF_ERROR(stream_->Skip(offset - stream_->position()).status());
      if (stream_->position() == offset) {
        ISOSCOPE_ASSIGN_OR_RETURN(got, stream_->Read(block.size(), block.data()));
      }
    } else if (offset < file_.size_bytes()) {
      got = static_cast<std::size_t>(std::min(kBlockBytes, file_.size_bytes() - offset));
      ISOSCOPE_RETURN_IF_ERROR(file_.ReadAt(offset, got, block.data()));
    }
    block.resize(got);
    return block;
  }

 private:
  const io::RandomAccessFile& file_;
  std::unique_ptr<InflateReader> stream_;  // null: raw
};

absl::Status FitsError(const std::string& path, std::int64_t part, absl::string_view what) {
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: FITS header of part %d: %s", path, part, what));
}

// Reads cards from `offset` on, up to the block behind END.
absl::StatusOr<std::int64_t> ReadCards(const std::string& path, std::int64_t part,
                                       std::string block, std::int64_t offset, FitsBytes* bytes,
                                       FitsCards* cards) {
  const std::int64_t begin = offset;
  while (true) {
    if (static_cast<std::int64_t>(block.size()) < kBlockBytes) {
      return FitsError(path, part, "the file ends within it: it is cut; copy it again");
    }
    offset += kBlockBytes;
    for (std::size_t at = 0; at < block.size(); at += kCardBytes) {
      const absl::string_view card = absl::string_view(block).substr(at, kCardBytes);
      if (absl::StripTrailingAsciiWhitespace(card) == "END") {
        return offset;
      }
      const absl::Status added = cards->Add(card);
      if (!added.ok()) {
        return FitsError(path, part, added.message());
      }
    }
    if (offset - begin > kMaxFitsHeaderBytes) {
      return FitsError(path, part, absl::StrFormat("no END in %d bytes: damaged", offset - begin));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(block, bytes->BlockAt(offset));
  }
}

// The bytes of the samples, filled up; -1: more than any file has.
std::int64_t FilledBytes(const FitsPart& part, std::int64_t parameters, std::int64_t groups,
                         bool has_groups) {
  if (part.axes.empty()) {
    return 0;
  }
  std::int64_t count = 1;
  for (std::size_t i = has_groups ? 1 : 0; i < part.axes.size(); ++i) {
    if (part.axes[i] != 0 && count > kMostBytes / part.axes[i]) {
      return -1;
    }
    count *= part.axes[i];
  }
  const std::int64_t size = std::abs(part.bits) / 8;
  if (parameters > kMostBytes - count ||
      count + parameters > kMostBytes / size / std::max<std::int64_t>(groups, 1)) {
    return -1;
  }
  const std::int64_t bytes = (count + parameters) * size * groups;
  return (bytes + kBlockBytes - 1) / kBlockBytes * kBlockBytes;
}

// Takes what the standard demands of each part. Returns the bytes of its samples, filled up.
absl::StatusOr<std::int64_t> TakeFitsPart(FitsPart* part) {
  const FitsCards& cards = part->cards;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t bits, cards.Integer("BITPIX", 0));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t axes, cards.Integer("NAXIS", -1));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t parameters, cards.Integer("PCOUNT", 0));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t groups, cards.Integer("GCOUNT", 1));
  const bool is_type =
      bits == 8 || bits == 16 || bits == 32 || bits == 64 || bits == -32 || bits == -64;
  if (!is_type || axes < 0 || axes > kMaxFitsAxes || parameters < 0 || groups < 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "BITPIX %d, NAXIS %d, PCOUNT %d, GCOUNT %d; expected 8, 16, 32, 64, -32 or -64, and no "
        "number below 0: damaged",
        bits, axes, parameters, groups));
  }
  part->bits = static_cast<int>(bits);
  for (std::int64_t axis = 1; axis <= axes; ++axis) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t length,
                              cards.Integer(absl::StrCat("NAXIS", axis), -1));
    if (length < 0) {
      return absl::InvalidArgumentError(
          absl::StrFormat("NAXIS%d is %d or missing; expected 0 or more: damaged", axis, length));
    }
    part->axes.push_back(length);
  }
  const bool has_groups = cards.Text("GROUPS") == "T" && axes > 0 && part->axes[0] == 0;
  const std::string kind = cards.Text("XTENSION");
  part->is_image =
      (kind.empty() || kind == "IMAGE") && !has_groups && parameters == 0 && groups == 1;
  part->name = cards.Text("EXTNAME");
  const std::int64_t bytes = FilledBytes(*part, parameters, groups, has_groups);
  return bytes < 0 ? absl::StatusOr<std::int64_t>(
                         absl::InvalidArgumentError("more samples than any file holds: damaged"))
                   : bytes;
}

}  // namespace

absl::Status FitsCards::Add(absl::string_view card) {
  const bool is_text = std::all_of(card.begin(), card.end(), [](char c) {
    return absl::ascii_isprint(static_cast<unsigned char>(c));
  });
  if (!is_text) {
    return absl::InvalidArgumentError(
        absl::StrCat("the card ", base::Quoted(card), ": expected printable ASCII: damaged"));
  }
  if (card.substr(8, 2) != "= ") {
    return absl::OkStatus();  // a comment
  }
  const std::string key(absl::StripTrailingAsciiWhitespace(card.substr(0, 8)));
  absl::string_view rest = absl::StripLeadingAsciiWhitespace(card.substr(10));
  std::string text;
  if (absl::StartsWith(rest, "'")) {
    rest.remove_prefix(1);
    std::size_t end = rest.find('\'');
    while (end != rest.npos && rest.substr(end + 1, 1) == "'") {  // two stand for one
      text += std::string(rest.substr(0, end + 1));
      rest.remove_prefix(end + 2);
      end = rest.find('\'');
    }
    if (end == rest.npos) {
      return absl::InvalidArgumentError(absl::StrCat("the text of ", key, " has no end: damaged"));
    }
    text += std::string(rest.substr(0, end));
    text = std::string(absl::StripTrailingAsciiWhitespace(text));
  } else {
    text = std::string(absl::StripTrailingAsciiWhitespace(rest.substr(0, rest.find('/'))));
  }
  const auto [found, is_new] = values_.try_emplace(key, Value{.text = text, .differs = false});
  found->second.differs = found->second.differs || found->second.text != text;
  return absl::OkStatus();
}

std::string FitsCards::Text(const std::string& key) const {
  const auto found = values_.find(key);
  return found == values_.end() ? "" : found->second.text;
}

absl::StatusOr<std::int64_t> FitsCards::Integer(const std::string& key,
                                                std::int64_t fallback) const {
  const auto found = values_.find(key);
  std::int64_t value = fallback;
  if (found != values_.end() &&
      (found->second.differs || !absl::SimpleAtoi(found->second.text, &value))) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s is %s%s; expected one integer", key, base::Quoted(found->second.text),
                        found->second.differs ? ", and another value" : ""));
  }
  return value;
}

absl::StatusOr<double> FitsCards::Number(const std::string& key, double fallback) const {
  const auto found = values_.find(key);
  double value = fallback;
  if (found != values_.end() &&
      (found->second.differs ||  // D begins an exponent, too
       !absl::SimpleAtod(absl::StrReplaceAll(found->second.text, {{"D", "E"}, {"d", "e"}}),
                         &value))) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s is %s%s; expected one number", key, base::Quoted(found->second.text),
                        found->second.differs ? ", and another value" : ""));
  }
  return value;
}

bool IsFits(absl::string_view head) { return absl::StartsWith(head, "SIMPLE  ="); }

absl::StatusOr<FitsFile> ReadFitsFile(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FileStart start, ReadFileStart(path, kCardBytes));
  if (!IsFits(start.bytes)) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": does not begin with \"SIMPLE  =\": not a FITS file, though its name says so"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> raw,
                            io::OpenRandomAccessFile(path));
  FitsBytes bytes(raw.get(), start.is_gzip);
  FitsFile file{.is_gzip = start.is_gzip};
  std::int64_t offset = 0;
  while (true) {
    ISOSCOPE_RETURN_IF_ERROR(base::CheckProcessInterrupt());
    ISOSCOPE_ASSIGN_OR_RETURN(std::string block, bytes.BlockAt(offset));
    const auto number = static_cast<std::int64_t>(file.parts.size());
    const bool is_empty = std::all_of(block.begin(), block.end(), [](char c) { return c == '\0'; });
    if (number > 0 && is_empty) {
      return file;
    }
    if (number > 0 && !absl::StartsWith(block, "XTENSION=")) {
      return FitsError(path, number,
                       absl::StrFormat("at byte %d, behind part %d, stands no other "
                                       "part: damaged",
                                       offset, number - 1));
    }
    if (number == kMaxParts) {
      return FitsError(path, number, absl::StrFormat("more than %d parts", kMaxParts));
    }
    FitsPart part{.number = number};
    ISOSCOPE_ASSIGN_OR_RETURN(
        part.samples_start, ReadCards(path, number, std::move(block), offset, &bytes, &part.cards));
    const absl::StatusOr<std::int64_t> size = TakeFitsPart(&part);
    if (!size.ok()) {
      return FitsError(path, number, size.status().message());
    }
    if (*size > kMostBytes - part.samples_start) {
      return FitsError(path, number, "more samples than any file holds: damaged");
    }
    offset = part.samples_start + *size;
    file.parts.push_back(std::move(part));
  }
}

}  // namespace isoscope::source
