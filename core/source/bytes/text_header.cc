#include "core/source/bytes/text_header.h"

#include <algorithm>
#include <memory>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxTextHeaderBytes = 4 * base::kMiB;
constexpr std::int64_t kTextPartBytes = 64 * base::kKiB;

// Whether the beginning of a file surely has all lines of its header: of NRRD up to an empty one, of
// MetaImage up to the one that says where the samples are.
bool HasWholeHeader(absl::string_view text) {
  if (absl::StartsWith(text, "NRRD")) {
    return absl::StrContains(text, "\n\n") || absl::StrContains(text, "\n\r\n");
  }
  const std::size_t last = text.find("\nElementDataFile");
  return last != absl::string_view::npos && text.find('\n', last + 1) != absl::string_view::npos;
}

}  // namespace

absl::StatusOr<std::string> ReadTextHeader(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  const std::int64_t most = std::min(file->size_bytes(), kMaxTextHeaderBytes);
  // At an address in small parts, since samples may follow.
  const std::int64_t part = io::IsMounted(path) ? kTextPartBytes : most;
  std::string text;
  for (std::int64_t size = 0; size < most && !HasWholeHeader(text);) {
    const std::int64_t more = std::min(part, most - size);
    text.resize(static_cast<std::size_t>(size + more));
    ISOSCOPE_RETURN_IF_ERROR(
        file->ReadAt(size, static_cast<std::size_t>(more), text.data() + size));
    size += more;
  }
  if (absl::StartsWith(text, "\x1f\x8b\x08")) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": a gzip stream; expected a header of text: decompress it (gunzip -c)"));
  }
  return text;
}

bool NextLine(absl::string_view text, std::size_t* position, absl::string_view* line) {
  if (*position >= text.size()) {
    return false;
  }
  const std::size_t end = text.find('\n', *position);
  if (end == absl::string_view::npos) {
    *line = text.substr(*position);
    *position = text.size();
  } else {
    *line = text.substr(*position, end - *position);
    *position = end + 1;
  }
  *line = absl::StripSuffix(*line, "\r");
  return true;
}

void HeaderFields::Set(absl::string_view key, absl::string_view value) {
  fields_[absl::AsciiStrToLower(absl::StripAsciiWhitespace(key))] =
      std::string(absl::StripAsciiWhitespace(value));
}

std::string HeaderFields::Get(const std::string& key) const {
  const auto found = fields_.find(key);
  return found == fields_.end() ? "" : found->second;
}

absl::StatusOr<std::int64_t> HeaderFields::GetInteger(const std::string& key,
                                                      std::int64_t fallback) const {
  const std::string text = Get(key);
  std::int64_t value = fallback;
  if (!text.empty() && !absl::SimpleAtoi(text, &value)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: header field \"%s\" is \"%s\"; expected an integer", path_, key, text));
  }
  return value;
}

absl::StatusOr<std::vector<std::int64_t>> HeaderFields::GetIntegers(const std::string& key) const {
  const std::string text = Get(key);
  std::vector<std::int64_t> values;
  for (const absl::string_view word :
       absl::StrSplit(text, absl::ByAnyChar(" \t"), absl::SkipEmpty())) {
    if (!absl::SimpleAtoi(word, &values.emplace_back())) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: header field \"%s\" is \"%s\"; expected integers", path_, key, text));
    }
  }
  return values;
}

}  // namespace isoscope::source
