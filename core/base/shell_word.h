// Text as a word that a shell takes as it is, for commands that messages advise.

#ifndef ISOSCOPE_CORE_BASE_SHELL_WORD_H_
#define ISOSCOPE_CORE_BASE_SHELL_WORD_H_

#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"

namespace isoscope::base {

// The text itself, or between single quotation marks if a shell would change it.
inline std::string ShellWord(absl::string_view text) {
  constexpr absl::string_view kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./:,+=@%";
  const bool is_plain = !text.empty() && text.find_first_not_of(kPlain) == absl::string_view::npos;
  return is_plain ? std::string(text)
                  : absl::StrCat("'", absl::StrReplaceAll(text, {{"'", "'\\''"}}), "'");
}

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_SHELL_WORD_H_
