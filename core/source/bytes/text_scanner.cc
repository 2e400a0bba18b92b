#include "core/source/bytes/text_scanner.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kScanBytes = 64 * base::kKiB;

bool IsTextSpace(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }

}  // namespace

absl::StatusOr<bool> TextScanner::Fill() {
  buffer_.erase(0, next_);
  buffer_offset_ += static_cast<std::int64_t>(next_);
  next_ = 0;
  const std::size_t kept = buffer_.size();
  if (kept >= kScanBytes) {
    return absl::InvalidArgumentError(absl::StrCat(file_->path(), ": more than ", kScanBytes,
                                                   " bytes without a break at offset ",
                                                   buffer_offset_, ": no text as expected"));
  }
  const std::int64_t end = buffer_offset_ + static_cast<std::int64_t>(kept);
  const std::int64_t left = std::max<std::int64_t>(file_->size_bytes() - end, 0);
  const std::size_t more = std::min<std::size_t>(kScanBytes - kept, static_cast<std::size_t>(left));
  if (more == 0) {
    return false;
  }
  buffer_.resize(kept + more);
  ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(end, more, buffer_.data() + kept));
  return true;
}

absl::StatusOr<absl::string_view> TextScanner::NextWord() {
  while (true) {
    while (next_ < buffer_.size() && IsTextSpace(buffer_[next_])) {
      ++next_;
    }
    if (next_ < buffer_.size()) {
      break;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const bool is_more, Fill());
    if (!is_more) {
      return absl::string_view();
    }
  }
  std::size_t length = 0;
  while (true) {
    while (next_ + length < buffer_.size() && !IsTextSpace(buffer_[next_ + length])) {
      ++length;
    }
    if (next_ + length < buffer_.size()) {
      break;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const bool is_more, Fill());
    if (!is_more) {
      break;
    }
  }
  const absl::string_view word(buffer_.data() + next_, length);
  next_ += length;
  return word;
}

absl::StatusOr<absl::string_view> TextScanner::NextLine() {
  std::size_t end = buffer_.find('\n', next_);
  while (end == std::string::npos) {
    ISOSCOPE_ASSIGN_OR_RETURN(const bool is_more, Fill());
    end = buffer_.find('\n', next_);
    if (!is_more) {
      break;
    }
  }
  const std::size_t stop = std::min(end, buffer_.size());
  const absl::string_view line(buffer_.data() + next_, stop - next_);
  next_ = std::min(stop + 1, buffer_.size());
  return absl::StripSuffix(line, "\r");
}

void TextScanner::MoveTo(std::int64_t offset) {
  const std::int64_t within = offset - buffer_offset_;
  if (within >= 0 && within <= static_cast<std::int64_t>(buffer_.size())) {
    next_ = static_cast<std::size_t>(within);
    return;
  }
  buffer_.clear();
  next_ = 0;
  buffer_offset_ = offset;
}

}  // namespace isoscope::source
