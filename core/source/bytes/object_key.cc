#include "core/source/bytes/object_key.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

#include "core/base/printable.h"
#include "core/source/bytes/percent_code.h"

namespace isoscope::source {

absl::Status CheckObjectKey(absl::string_view key) {
  if (key.empty() || key.size() > kMaxKeyBytes) {
    return absl::InvalidArgumentError(absl::StrCat("the key ", base::Quoted(key),
                                                   " of an object has ", key.size(),
                                                   " bytes; expected 1 to ", kMaxKeyBytes));
  }
  for (const absl::string_view part : absl::StrSplit(key, '/')) {
    if (part.empty() || part == "." || part == "..") {
      return absl::InvalidArgumentError(
          absl::StrCat("the key ", base::Quoted(key), " of an object has the part ",
                       base::Quoted(part), "; expected names joined by '/'"));
    }
  }
  if (std::any_of(key.begin(), key.end(),
                  [](char c) { return absl::ascii_iscntrl(static_cast<unsigned char>(c)); })) {
    return absl::InvalidArgumentError(
        absl::StrCat("the key ", base::Quoted(key), " of an object has a control character"));
  }
  return absl::OkStatus();
}

std::string LastPartOfPath(absl::string_view path) {
  const bool is_http =
      absl::StartsWithIgnoreCase(path, "http://") || absl::StartsWithIgnoreCase(path, "https://");
  while (path.size() > 1 && absl::ConsumeSuffix(&path, "/")) {
  }
  std::string last(path.substr(path.rfind('/') + 1));
  if (!is_http) {
    return last;
  }
  std::string decoded = PercentDecode(last);
  const bool is_name = CheckObjectKey(decoded).ok() && !absl::StrContains(decoded, '/') &&
                       base::ValidUtf8(decoded) == decoded;
  return is_name ? decoded : last;
}

absl::StatusOr<ObjectExtent> ExtentOf(const ObjectRead& read, std::int64_t object_size,
                                      absl::string_view name) {
  const bool is_from_end = read.offset < 0;
  // -object_size can't overflow, as read.offset could.
  if (is_from_end ? read.offset < -object_size : read.offset > object_size) {
    return absl::OutOfRangeError(
        absl::StrCat(name, ": has ", object_size, " bytes, none at offset ", read.offset));
  }
  const std::int64_t offset = is_from_end ? object_size + read.offset : read.offset;
  const std::int64_t left = object_size - offset;
  if (read.size > left) {
    return absl::OutOfRangeError(absl::StrCat(name, ": ends after ", object_size,
                                              " bytes, expected ", read.size, " bytes at offset ",
                                              offset));
  }
  const std::int64_t size = read.size < 0 ? left : read.size;
  if (size > read.max_size) {
    return absl::ResourceExhaustedError(absl::StrCat(name, ": ", size, " bytes at offset ", offset,
                                                     "; expected at most ", read.max_size));
  }
  return ObjectExtent{.offset = offset, .size = size};
}

absl::Status CheckWithin(const ByteRange& range, std::int64_t object_size, absl::string_view name) {
  if (range.offset < 0 || range.offset > object_size ||
      range.size > static_cast<std::size_t>(object_size - range.offset)) {
    return absl::OutOfRangeError(absl::StrCat(name, ": has ", object_size, " bytes, expected ",
                                              range.size, " bytes at offset ", range.offset));
  }
  return absl::OkStatus();
}

}  // namespace isoscope::source
