// The text of a command, from the top: summary, usage, flags under their headings, the way to the
// flags that are left out, examples. Each part but the examples is wrapped.

#include "core/cli/help_text.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/algorithm/container.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"

namespace isoscope::cli {
namespace {

constexpr int kDefaultColumns = 80;
constexpr int kMinColumns = 40;
// Longer lines are hard to read.
constexpr int kMaxColumns = 120;
// Where the texts of flags begin, and at most this share of a narrow line.
constexpr int kFlagIndent = 28;
// The heading of flags that were declared without one (CLI11).
constexpr char kNoHeading[] = "Options";

std::string Spaces(int count) { return std::string(static_cast<std::size_t>(count), ' '); }

int WidthOf(int columns) {
  return std::clamp(columns > 0 ? columns : kDefaultColumns, kMinColumns, kMaxColumns);
}

// Returns the words of `text` in lines of at most `width` characters, without the last line's end.
// The second line and those after it begin with `indent` spaces; the first has `used` characters
// already. A longer word has a line of its own.
std::string Wrapped(absl::string_view text, int used, int indent, int width) {
  std::string lines;
  int column = used;
  bool is_first_of_line = true;
  for (const absl::string_view word : absl::StrSplit(text, ' ', absl::SkipEmpty())) {
    const int length = static_cast<int>(word.size());
    if (!is_first_of_line && column + 1 + length > width) {
      absl::StrAppend(&lines, "\n", Spaces(indent));
      column = indent;
      is_first_of_line = true;
    }
    absl::StrAppend(&lines, is_first_of_line ? "" : " ", word);
    column += length + (is_first_of_line ? 0 : 1);
    is_first_of_line = false;
  }
  return lines;
}

// "A|B" of CLI11's "TEXT:{A,B}".
std::string ValueOf(const FlagDescription& flag) {
  return absl::StrContains(flag.value_name, ":{") ? absl::StrJoin(flag.choices, "|")
                                                  : flag.value_name;
}

// "-o, --output FILE.png", "--caps[=MAP]", "INPUT|DIR".
std::string TagOf(const FlagDescription& flag) {
  std::vector<std::string> names(flag.names.rbegin(), flag.names.rend());  // short ones first
  const std::string value = ValueOf(flag);
  std::string tag = absl::StrJoin(names, ", ");
  if (flag.has_optional_value && !names.empty() && !value.empty()) {
    absl::string_view inner = value;
    if (absl::ConsumePrefix(&inner, "[") && !absl::ConsumeSuffix(&inner, "]")) {
      inner = value;
    }
    absl::StrAppend(&tag, "[=", inner, "]");
  } else {
    absl::StrAppend(&tag, tag.empty() || value.empty() ? "" : " ", value);
  }
  return absl::StrCat(tag, flag.is_repeatable ? " ..." : "");
}

std::string TextOf(const FlagDescription& flag) {
  return absl::StrCat(
      flag.help,
      flag.default_value.empty() ? "" : absl::StrCat(" (default: ", flag.default_value, ")"),
      flag.environment.empty() ? "" : absl::StrCat(" (or $", flag.environment, ")"));
}

// How many flags --help leaves out, and their headings.
struct Hidden {
  int count = 0;
  std::vector<std::string> headings;
};

// The flags under their headings. `common`: those that are shown; null: all are.
std::string Flags(const CommandDescription& command, const std::vector<std::string>* common,
                  int columns, Hidden* hidden) {
  std::string text;
  std::string heading;
  for (const FlagDescription& flag : command.flags) {
    if (common != nullptr && !absl::c_linear_search(*common, KeyOf(flag))) {
      ++hidden->count;
      if (hidden->headings.empty() || hidden->headings.back() != flag.group) {
        hidden->headings.push_back(flag.group);
      }
      continue;
    }
    if (flag.group != heading) {
      heading = flag.group;
      absl::StrAppend(&text, "\n", heading, ":\n");
    }
    absl::StrAppend(&text, HelpEntry(TagOf(flag), TextOf(flag), kFlagIndent, columns));
  }
  return text;
}

}  // namespace

std::string KeyOf(const FlagDescription& flag) {
  return flag.names.empty() ? flag.value_name : flag.names.front();
}

void Arrange(const HelpLayout& layout, CommandDescription* command) {
  const std::vector<HelpHeading>& headings = layout.headings;
  for (FlagDescription& flag : command->flags) {
    // Positional arguments stand first.
    const auto own = flag.names.empty()
                         ? headings.begin()
                         : std::find_if(headings.begin(), headings.end(),
                                        [key = KeyOf(flag)](const HelpHeading& heading) {
                                          return absl::c_linear_search(heading.flags, key);
                                        });
    if (flag.group == kNoHeading && own != headings.end()) {
      flag.group = own->name;
    }
  }
  std::vector<std::string> order;
  for (const HelpHeading& heading : headings) {
    order.push_back(heading.name);
  }
  for (const FlagDescription& flag : command->flags) {
    if (!absl::c_linear_search(order, flag.group)) {
      order.push_back(flag.group);
    }
  }
  // The place of the heading, then that of the flag in the layout's list, behind positional
  // arguments. Flags that are in no list follow in the order of their declaration.
  const auto place = [&](const FlagDescription& flag) {
    const auto heading =
        static_cast<std::size_t>(std::find(order.begin(), order.end(), flag.group) - order.begin());
    std::ptrdiff_t position = flag.names.empty() ? -1 : 0;
    if (heading < headings.size() && !flag.names.empty()) {
      const std::vector<std::string>& listed = headings[heading].flags;
      position = std::find(listed.begin(), listed.end(), KeyOf(flag)) - listed.begin();
    }
    return std::pair(heading, position);
  };
  std::stable_sort(
      command->flags.begin(), command->flags.end(),
      [&](const FlagDescription& a, const FlagDescription& b) { return place(a) < place(b); });
}

void AddWords(const std::vector<ValueWords>& words, CommandDescription* command) {
  for (FlagDescription& flag : command->flags) {
    for (const ValueWords& own : words) {
      if (own.flag != KeyOf(flag) ||
          (!own.value_name.empty() && own.value_name != flag.value_name)) {
        continue;
      }
      for (const std::string& word : own.words) {
        if (!absl::c_linear_search(flag.choices, word)) {
          flag.choices.push_back(word);
        }
      }
    }
  }
}

std::string HelpEntry(const std::string& name, const std::string& text, int indent, int columns) {
  const int width = WidthOf(columns);
  const int begin = std::min(indent, width / 2);
  std::string entry = absl::StrCat("  ", name);
  if (text.empty()) {
    return entry + "\n";
  }
  const int used = static_cast<int>(entry.size());
  // Two spaces stand between a name and its text.
  absl::StrAppend(&entry,
                  used + 2 <= begin ? Spaces(begin - used) : absl::StrCat("\n", Spaces(begin)));
  return absl::StrCat(entry, Wrapped(text, begin, begin, width), "\n");
}

std::string HelpText(const std::string& program, const CommandDescription& command,
                     const HelpLayout& layout, HelpPart part, int columns) {
  constexpr char kUsage[] = "Usage: ";
  constexpr int kUsageIndent = sizeof(kUsage) - 1;
  const int width = WidthOf(columns);
  const auto common = layout.common.find(command.name);
  const bool shows_common = part == HelpPart::kCommon && common != layout.common.end();
  Hidden hidden;
  const std::string flags =
      Flags(command, shows_common ? &common->second : nullptr, columns, &hidden);
  std::string text =
      absl::StrCat(Wrapped(command.summary, 0, 0, width), "\n\n", kUsage,
                   Wrapped(absl::StrCat(program, " ", command.name, " ", command.usage),
                           kUsageIndent, kUsageIndent, width),
                   "\n", flags);
  if (hidden.count > 0) {
    absl::StrAppend(&text, "\n",
                    Wrapped(absl::StrCat("--help-all lists ", hidden.count,
                                         " more: ", absl::StrJoin(hidden.headings, ", ")),
                            0, 0, width),
                    "\n");
  }
  return command.examples.empty() ? text : absl::StrCat(text, "\nExamples:\n", command.examples);
}

}  // namespace isoscope::cli
