#include "core/source/remote/netrc.h"

#include <algorithm>
#include <cstddef>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"

namespace isoscope::source {
namespace {

bool IsSpace(char c) { return absl::ascii_isspace(static_cast<unsigned char>(c)); }

// The next word from *at on, which may stand in quotation marks with \" and \\ in it. Empty at the
// end.
std::string NextWord(absl::string_view text, std::size_t* at) {
  while (*at < text.size()) {
    if (IsSpace(text[*at])) {
      ++*at;
    } else if (text[*at] == '#') {
      *at = std::min(text.find('\n', *at), text.size());
    } else {
      break;
    }
  }
  std::string word;
  if (*at < text.size() && text[*at] == '"') {
    for (++*at; *at < text.size() && text[*at] != '"'; ++*at) {
      if (text[*at] == '\\' && *at + 1 < text.size()) {
        ++*at;
      }
      word.push_back(text[*at]);
    }
    *at = std::min(*at + 1, text.size());
    return word;
  }
  for (; *at < text.size() && !IsSpace(text[*at]); ++*at) {
    word.push_back(text[*at]);
  }
  return word;
}

}  // namespace

std::optional<NetrcEntry> FindInNetrc(absl::string_view text, absl::string_view host) {
  std::optional<NetrcEntry> entry;  // while the words are those of an entry of `host`
  for (std::size_t at = 0; at < text.size();) {
    const std::string word = NextWord(text, &at);
    if (word == "machine" || word == "default") {
      if (entry && !entry->login.empty()) {
        return entry;
      }
      const bool is_host = word == "machine" && absl::EqualsIgnoreCase(NextWord(text, &at), host);
      entry = is_host ? std::optional<NetrcEntry>(NetrcEntry{}) : std::nullopt;
    } else if (word == "login" || word == "password" || word == "account") {
      const std::string value = NextWord(text, &at);
      if (entry && word == "login") {
        entry->login = value;
      } else if (entry && word == "password") {
        entry->password = Secret(value);
      }
    } else if (word == "macdef") {  // ends at an empty line
      const std::size_t end = text.find("\n\n", at);
      at = end == absl::string_view::npos ? text.size() : end;
    }
  }
  return entry && !entry->login.empty() ? entry : std::nullopt;
}

}  // namespace isoscope::source
