#include "server/page.h"

#include <utility>

#include "absl/status/status.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"

#include "core/base/printable.h"

namespace isoscope::server {

absl::StatusOr<Page> Page::Make(absl::string_view list, std::int32_t size,
                                absl::string_view token) {
  if (size < 0) {
    return absl::InvalidArgumentError(
        absl::StrCat("page_size is ", size, ": must be at least 0; 0 is all"));
  }
  std::string after;
  if (!token.empty()) {
    std::string text;
    absl::string_view name;
    const bool is_text = absl::WebSafeBase64Unescape(token, &text);
    name = text;
    // A token has exactly one encoding, and the prefix of its list.
    if (!is_text || absl::WebSafeBase64Escape(text) != token ||
        !absl::ConsumePrefix(&name, absl::StrCat(list, ":")) || name.empty()) {
      return absl::InvalidArgumentError(
          absl::StrCat("page_token is ", base::Quoted(token),
                       ": must be next_page_token of the page before, or empty"));
    }
    after = std::string(name);
  }
  return Page(list, static_cast<std::size_t>(size), std::move(after));
}

bool Page::Offer(absl::string_view name) {
  if (!after_.empty() && name <= after_) {
    return false;
  }
  if (size_ > 0 && count_ == size_) {
    is_more_ = true;
    return false;
  }
  ++count_;
  after_ = std::string(name);
  return true;
}

std::string Page::next_token() const {
  return is_more_ ? absl::WebSafeBase64Escape(absl::StrCat(list_, ":", after_)) : "";
}

}  // namespace isoscope::server
