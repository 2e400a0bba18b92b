#include "core/cli/man_page.h"

#include <algorithm>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"

namespace isoscope::cli {
namespace {

// The date of the pages' form, not of the build: the same program gives the same bytes.
constexpr char kDate[] = "2026-11-23";

// Text of a page: no byte of it is a command of roff.
std::string Escaped(absl::string_view text) {
  const std::string escaped = absl::StrReplaceAll(text, {{"\\", "\\e"},
                                                         {"-", "\\-"},
                                                         {"'", "\\(aq"},
                                                         {"`", "\\(ga"},
                                                         {"^", "\\(ha"},
                                                         {"~", "\\(ti"}});
  return absl::StartsWith(escaped, ".") ? absl::StrCat("\\&", escaped) : escaped;
}

// Lines as they are.
std::string Verbatim(absl::string_view text) {
  std::string lines = ".nf\n";
  for (const absl::string_view line :
       absl::StrSplit(absl::StripTrailingAsciiWhitespace(text), '\n')) {
    absl::StrAppend(&lines, line.empty() ? "\\&" : Escaped(line), "\n");
  }
  return lines + ".fi\n";
}

std::string Header(const ProgramDescription& program, const std::string& page,
                   absl::string_view summary) {
  return absl::StrCat(".TH ", absl::AsciiStrToUpper(page), " 1 ", kDate, " \"", program.name, " ",
                      program.version, "\" \"Isoscope\"\n.SH NAME\n", Escaped(page), " \\- ",
                      Escaped(summary), "\n");
}

// "\fB\-\-output\fR \fIFILE.png\fR".
std::string Tag(const FlagDescription& flag) {
  std::string tag = absl::StrJoin(flag.names, ", ", [](std::string* out, const std::string& name) {
    absl::StrAppend(out, "\\fB", Escaped(name), "\\fR");
  });
  if (!flag.value_name.empty()) {
    const std::string value = absl::StrCat("\\fI", Escaped(flag.value_name), "\\fR");
    absl::StrAppend(&tag,
                    tag.empty()               ? ""
                    : flag.has_optional_value ? "[="
                                              : " ",
                    value, flag.has_optional_value && !flag.names.empty() ? "]" : "");
  }
  return absl::StrCat(tag, flag.is_repeatable ? " ..." : "");
}

void AppendFlag(const FlagDescription& flag, std::string* text) {
  absl::StrAppend(text, ".TP\n", Tag(flag), "\n", flag.help.empty() ? "\\&" : Escaped(flag.help));
  if (!flag.default_value.empty()) {
    absl::StrAppend(text, " (default: ", Escaped(flag.default_value), ")");
  }
  if (!flag.environment.empty()) {
    absl::StrAppend(text, "\n.br\nEnvironment: \\fB", Escaped(flag.environment), "\\fR");
  }
  absl::StrAppend(text, "\n");
}

// Under the headings of --help, each group where its first flag stands.
std::string Options(const CommandDescription& command) {
  std::vector<std::string> groups;
  for (const FlagDescription& flag : command.flags) {
    if (std::find(groups.begin(), groups.end(), flag.group) == groups.end()) {
      groups.push_back(flag.group);
    }
  }
  std::string text = ".SH OPTIONS\n";
  for (const std::string& group : groups) {
    if (groups.size() > 1 && (group != "Options" || group != groups.front())) {
      absl::StrAppend(&text, ".SS ", Escaped(group), "\n");
    }
    for (const FlagDescription& flag : command.flags) {
      if (flag.group == group) {
        AppendFlag(flag, &text);
      }
    }
  }
  return text;
}

constexpr char kExitStatus[] =
    ".SH EXIT STATUS\n.TP\n0\nDone.\n.TP\n1\nThe request failed; standard error says why.\n.TP\n2\n"
    "Wrong usage; standard error says how it is right.\n.TP\n130\nEnded by Ctrl-C (128 and the "
    "number of another signal).\n";

}  // namespace

std::string ManPageName(const ProgramDescription& program, const std::string& command) {
  return command.empty()
             ? program.name
             : absl::StrCat(program.name, "-", absl::StrReplaceAll(command, {{" ", "-"}}));
}

std::string CommandManPage(const ProgramDescription& program, const CommandDescription& command) {
  const std::string page = ManPageName(program, command.name);
  const std::string call =
      command.name.empty() ? program.name : absl::StrCat(program.name, " ", command.name);
  std::string text = Header(program, page, command.summary);
  absl::StrAppend(&text, ".SH SYNOPSIS\n\\fB", Escaped(call), "\\fR ", Escaped(command.usage),
                  "\n.SH DESCRIPTION\n", Escaped(command.summary), ".\n", Options(command));
  if (!command.examples.empty()) {
    absl::StrAppend(&text, ".SH EXAMPLES\n", Verbatim(command.examples));
  }
  absl::StrAppend(&text, kExitStatus);
  if (!command.name.empty()) {
    absl::StrAppend(&text, ".SH SEE ALSO\n.BR ", Escaped(program.name), " (1)\n");
  }
  return text;
}

std::string ProgramManPage(const ProgramDescription& program, const std::string& notes) {
  std::string text = Header(program, program.name, program.summary);
  absl::StrAppend(&text, ".SH SYNOPSIS\n\\fB", Escaped(program.name), "\\fR \\fICOMMAND\\fR ...\n",
                  ".SH DESCRIPTION\n", Escaped(program.summary), ".\n.SH COMMANDS\n");
  std::vector<std::string> pages;
  for (const CommandDescription& command : program.commands) {
    absl::StrAppend(&text, ".TP\n\\fB", Escaped(command.name), "\\fR\n", Escaped(command.summary),
                    "\n");
    pages.push_back(absl::StrCat(".BR ", Escaped(ManPageName(program, command.name)), " (1)"));
  }
  absl::StrAppend(&text, kExitStatus);
  if (!notes.empty()) {
    absl::StrAppend(&text, ".SH EXAMPLES\n", Verbatim(notes));
  }
  return absl::StrCat(text, ".SH SEE ALSO\n", absl::StrJoin(pages, " ,\n"), "\n");
}

}  // namespace isoscope::cli
