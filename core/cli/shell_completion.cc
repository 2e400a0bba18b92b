// Each shell has a section below: bash, zsh, fish. A script is made in the same steps in each:
//
// 1. The first word is completed from FirstWords, the second one from SecondWords.
// 2. Behind a known command, names of flags are completed.
// 3. Behind a flag with a value, its words, files or folders are completed. Words with a colon,
//    "z:viridis", are offered once one is typed.
//
// Every text goes through the quoting function of its shell (Quoted, ZshText, FishQuoted), so no
// help text can end a string of the script or start a command.

#include "core/cli/shell_completion.h"

#include <cstddef>
#include <functional>
#include <set>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"

namespace isoscope::cli {
namespace {

// The name of a shell function: letters, digits and underscores.
std::string Identifier(absl::string_view name) {
  return absl::StrCat("_", absl::StrReplaceAll(name, {{"-", "_"}, {" ", "_"}}));
}

// Text between the single quotes of a POSIX shell.
std::string Quoted(absl::string_view text) {
  return absl::StrCat("'", absl::StrReplaceAll(text, {{"'", "'\\''"}}), "'");
}

// The help up to its first ';' or '(': one line of a menu.
std::string ShortHelp(absl::string_view help) {
  const std::string text(help.substr(0, help.find_first_of(";(\n")));
  return std::string(absl::StripAsciiWhitespace(text));
}

bool HasCommands(const ProgramDescription& program) {
  return program.commands.size() != 1 || !program.commands[0].name.empty();
}

struct Word {
  std::string name;
  std::string summary;
};

// The first words of commands, in their order, and "help".
std::vector<Word> FirstWords(const ProgramDescription& program) {
  std::vector<Word> words;
  std::set<std::string> known;
  for (const CommandDescription& command : program.commands) {
    const std::vector<std::string> parts = absl::StrSplit(command.name, ' ');
    if (known.insert(parts[0]).second) {
      std::string summary = command.summary;
      if (parts.size() > 1) {
        std::vector<std::string> seconds;
        for (const CommandDescription& other : program.commands) {
          if (absl::StartsWith(other.name, parts[0] + " ")) {
            seconds.push_back(other.name.substr(parts[0].size() + 1));
          }
        }
        summary = absl::StrJoin(seconds, ", ");
      }
      words.push_back({parts[0], summary});
    }
  }
  words.push_back({"help", "Tells about a command"});
  return words;
}

// The second words behind a first one; empty for commands of one word.
std::vector<Word> SecondWords(const ProgramDescription& program, absl::string_view first) {
  std::vector<Word> words;
  for (const CommandDescription& command : program.commands) {
    const std::vector<std::string> parts = absl::StrSplit(command.name, ' ');
    if (parts.size() > 1 && parts[0] == first) {
      words.push_back({parts[1], command.summary});
    }
  }
  return words;
}

std::string Names(const std::vector<Word>& words) {
  return absl::StrJoin(words, " ",
                       [](std::string* out, const Word& word) { absl::StrAppend(out, word.name); });
}

// --- bash ----------------------------------------------------------------------------------------

// Returns the command of the script that completes the value of a flag.
std::string BashValue(const FlagDescription& flag) {
  std::string action;
  if (!flag.choices.empty()) {
    absl::StrAppend(&action, "words=", Quoted(absl::StrJoin(flag.choices, " ")), "; ");
  }
  absl::StrAppend(&action, "kind=",
                  flag.takes_files     ? "file"
                  : flag.takes_folders ? "folder"
                                       : "none");
  return action;
}

std::string BashCommand(const CommandDescription& command) {
  std::string text;
  std::vector<std::string> all;
  std::string positional = "none";
  for (const FlagDescription& flag : command.flags) {
    all.insert(all.end(), flag.names.begin(), flag.names.end());
    if (flag.names.empty()) {
      positional = BashValue(flag);
    }
  }
  absl::StrAppend(&text, "      flags=", Quoted(absl::StrJoin(all, " ")), "\n",
                  "      case $flag in\n");
  for (const FlagDescription& flag : command.flags) {
    if (!flag.names.empty() && !flag.value_name.empty()) {
      absl::StrAppend(&text, "        ", absl::StrJoin(flag.names, "|"), ") ", BashValue(flag),
                      " ;;\n");
    }
  }
  absl::StrAppend(&text, "        *) is_value= ; ", positional == "none" ? "kind=none" : positional,
                  " ;;\n      esac\n");
  return text;
}

constexpr char kBashBegin[] = R"(() {
  local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD-1]}
  local flag= flags= words= kind=none is_value=1 command= stem= at=$COMP_CWORD word
  COMPREPLY=()
  # "--flag=value" comes as three words, and so does "z:value", of which the last is replaced.
  if [[ $cur == : || $prev == : ]]; then
    local text=$cur
    while (( at > 1 )) && [[ ${COMP_WORDS[at]} == : || ${COMP_WORDS[at-1]} == : ]]; do
      (( at-- ))
      text=${COMP_WORDS[at]}$text
    done
    cur=$text stem=${text%"${text##*:}"} prev=${COMP_WORDS[at-1]}
  fi
  if [[ $cur == = ]]; then
    flag=$prev cur=
  elif [[ $prev == = && $at -ge 2 ]]; then
    flag=${COMP_WORDS[at-2]}
  elif [[ $prev == -* ]]; then
    flag=$prev
  fi
)";

constexpr char kBashEnd[] = R"(  if [[ -z $is_value && $cur == -* ]]; then
    COMPREPLY=($(compgen -W "$flags" -- "$cur"))
    return
  fi
  for word in $(compgen -W "$words" -- "$cur"); do
    [[ $word == *:* && $cur != *:* ]] || COMPREPLY+=("$word")
  done
  # A colon may follow.
  [[ ${#COMPREPLY[@]} -eq 1 && " $words" == *" ${COMPREPLY[0]}:"* ]] &&
    compopt -o nospace 2>/dev/null
  local IFS=$'\n'
  if [[ $kind == file ]]; then
    compopt -o filenames 2>/dev/null
    COMPREPLY+=($(compgen -f -- "$cur"))
  elif [[ $kind == folder ]]; then
    compopt -o filenames 2>/dev/null
    COMPREPLY+=($(compgen -d -- "$cur"))
  fi
  COMPREPLY=("${COMPREPLY[@]#"$stem"}")
}
)";

// Finds the command in the words before the cursor, or completes it.
std::string BashDispatch(const ProgramDescription& program) {
  std::string text = absl::StrCat(
      "  if [[ $COMP_CWORD -eq 1 || ( $COMP_CWORD -eq 2 && ${COMP_WORDS[1]} == help ) ]]; then\n",
      "    COMPREPLY=($(compgen -W ", Quoted(Names(FirstWords(program)) + " --help --version"),
      " -- \"$cur\"))\n    return\n  fi\n  case ${COMP_WORDS[1]} in\n");
  for (const Word& first : FirstWords(program)) {
    const std::vector<Word> seconds = SecondWords(program, first.name);
    if (!seconds.empty()) {
      absl::StrAppend(&text, "    ", first.name, ")\n      if [[ $COMP_CWORD -eq 2 ]]; then\n",
                      "        COMPREPLY=($(compgen -W ", Quoted(Names(seconds)),
                      " -- \"$cur\"))\n        return\n      fi\n",
                      "      command=\"${COMP_WORDS[1]} ${COMP_WORDS[2]}\" ;;\n");
    }
  }
  return absl::StrCat(text, "    *) command=${COMP_WORDS[1]} ;;\n  esac\n");
}

std::string BashScript(const ProgramDescription& program) {
  const std::string function = Identifier(program.name);
  std::string text =
      absl::StrCat("# Completion of ", program.name, " for bash.\n", function, kBashBegin);
  if (HasCommands(program)) {
    absl::StrAppend(&text, BashDispatch(program));
  }
  absl::StrAppend(&text, "  case $command in\n");
  for (const CommandDescription& command : program.commands) {
    absl::StrAppend(&text, "    ", Quoted(command.name), ")\n", BashCommand(command), "      ;;\n");
  }
  return absl::StrCat(text, "    *) return ;;\n  esac\n", kBashEnd, "complete -F ", function, " ",
                      program.name, "\n");
}

// --- zsh -----------------------------------------------------------------------------------------

// Text inside of a specification of _arguments.
std::string ZshText(absl::string_view text) {
  return absl::StrReplaceAll(text, {{"\\", "\\\\"}, {"[", "\\["}, {"]", "\\]"}, {":", "\\:"}});
}

std::string ZshAction(const FlagDescription& flag) {
  if (flag.takes_files) {
    return "_files";
  }
  if (flag.takes_folders) {
    return "_files -/";
  }
  if (flag.choices.empty()) {
    return " ";
  }
  const std::string all = absl::StrJoin(flag.choices, " ");
  if (!absl::StrContains(all, ":")) {
    return absl::StrCat("(", all, ")");
  }
  std::vector<std::string> longer;  // with a colon
  std::vector<std::string> heads;   // a colon may follow
  std::vector<std::string> plain;
  for (const std::string& choice : flag.choices) {
    const bool is_head = absl::StrContains(absl::StrCat(" ", all), absl::StrCat(" ", choice, ":"));
    (absl::StrContains(choice, ":") ? longer : is_head ? heads : plain).push_back(choice);
  }
  return absl::StrCat("{ if [[ $PREFIX == *\\:* ]]; then compadd -- ",
                      ZshText(absl::StrJoin(longer, " ")), "; else compadd -S \"\" -- ",
                      absl::StrJoin(heads, " "), "; compadd -- ", absl::StrJoin(plain, " "),
                      "; fi }");
}

std::string ZshCommand(const CommandDescription& command, absl::string_view indent) {
  std::string text = absl::StrCat(indent, "_arguments -s");
  for (const FlagDescription& flag : command.flags) {
    // CLI11 writes a description of its checks behind a ':'. It is no part of the name.
    const std::string name_of_value = flag.value_name.substr(0, flag.value_name.find(":{"));
    const std::string value = absl::StrCat(":", ZshText(name_of_value), ":", ZshAction(flag));
    const std::string repeats = flag.is_repeatable ? "*" : "";
    if (flag.names.empty()) {
      absl::StrAppend(&text, " \\\n", indent, "  ", Quoted(absl::StrCat(repeats, value)));
    }
    for (const std::string& name : flag.names) {
      const std::string help = absl::StrCat("[", ZshText(ShortHelp(flag.help)), "]");
      const bool is_long = absl::StartsWith(name, "--");
      const std::string spec = flag.value_name.empty() ? absl::StrCat(name, help)
                               : flag.has_optional_value
                                   ? absl::StrCat(name, "=-", help, ":", value)
                                   : absl::StrCat(name, is_long ? "=" : "", help, value);
      absl::StrAppend(&text, " \\\n", indent, "  ", Quoted(repeats + spec));
    }
  }
  return text + "\n";
}

std::string ZshDescribe(absl::string_view tag, const std::vector<Word>& words,
                        absl::string_view indent) {
  std::string text = absl::StrCat(indent, "local -a known=(\n");
  for (const Word& word : words) {
    absl::StrAppend(
        &text, indent, "  ",
        Quoted(absl::StrCat(word.name, ":", absl::StrReplaceAll(word.summary, {{":", "\\:"}}))),
        "\n");
  }
  return absl::StrCat(text, indent, ")\n", indent, "_describe ", tag, " known\n");
}

std::string ZshScript(const ProgramDescription& program) {
  // The file has the same name: zsh loads the function by it.
  const std::string function = absl::StrCat("_", program.name);
  std::string text = absl::StrCat("#compdef ", program.name, "\n# Completion of ", program.name,
                                  " for zsh.\n", function, "() {\n");
  if (!HasCommands(program)) {
    absl::StrAppend(&text, ZshCommand(program.commands[0], "  "));
  } else {
    absl::StrAppend(&text, "  if (( CURRENT == 2 )) || [[ $words[2] == help ]]; then\n",
                    ZshDescribe("command", FirstWords(program), "    "), "    return\n  fi\n");
    absl::StrAppend(&text, "  local command=$words[2]\n  shift words\n  (( CURRENT-- ))\n",
                    "  case $command in\n");
    for (const Word& first : FirstWords(program)) {
      const std::vector<Word> seconds = SecondWords(program, first.name);
      if (!seconds.empty()) {
        absl::StrAppend(&text, "    ", first.name, ")\n      if (( CURRENT == 2 )); then\n",
                        ZshDescribe("command", seconds, "        "),
                        "        return\n      fi\n      command=\"$command $words[2]\"\n",
                        "      shift words\n      (( CURRENT-- ))\n      ;;\n");
      }
    }
    absl::StrAppend(&text, "  esac\n  case $command in\n");
    for (const CommandDescription& command : program.commands) {
      absl::StrAppend(&text, "    ", Quoted(command.name), ")\n", ZshCommand(command, "      "),
                      "      ;;\n");
    }
    absl::StrAppend(&text, "  esac\n");
  }
  // Works both as a file of $fpath and when it is sourced.
  return absl::StrCat(text, "}\nif [[ $funcstack[1] == ", function, " ]]; then\n  ", function,
                      " \"$@\"\nelse\n  compdef ", function, " ", program.name, "\nfi\n");
}

// --- fish ----------------------------------------------------------------------------------------

// Text between fish's single quotes.
std::string FishQuoted(absl::string_view text) {
  return absl::StrCat("'", absl::StrReplaceAll(text, {{"\\", "\\\\"}, {"'", "\\'"}}), "'");
}

// `words_function`: the one of the script that chooses among words with colons.
std::string FishFlag(const std::string& begin, const std::string& words_function,
                     const FlagDescription& flag) {
  std::string text = begin;
  for (const std::string& name : flag.names) {
    absl::StrAppend(&text, absl::StartsWith(name, "--") ? " -l " : " -s ",
                    absl::StripPrefix(absl::StripPrefix(name, "-"), "-"));
  }
  if (!flag.choices.empty()) {
    const std::string words = absl::StrJoin(flag.choices, " ");
    absl::StrAppend(&text, " -a ",
                    FishQuoted(absl::StrContains(words, ":")
                                   ? absl::StrCat("(", words_function, " ", words, ")")
                                   : words));
  }
  const bool wants_files = flag.takes_files || flag.takes_folders;
  if (flag.takes_folders && !flag.takes_files) {
    absl::StrAppend(&text, " -a '(__fish_complete_directories)'");
  } else if (wants_files) {
    absl::StrAppend(&text, " -F");
  }
  if (!flag.value_name.empty() && !flag.has_optional_value && !flag.names.empty()) {
    absl::StrAppend(&text, flag.takes_files ? " -r" : " -x");
  }
  if (!flag.names.empty()) {
    absl::StrAppend(&text, " -d ", FishQuoted(ShortHelp(flag.help)));
  }
  return text + "\n";
}

std::string FishScript(const ProgramDescription& program) {
  const std::string is_command = absl::StrCat("_", Identifier(program.name), "_is");
  const std::string words_function = absl::StrCat("_", Identifier(program.name), "_words");
  std::string text =
      absl::StrCat("# Completion of ", program.name, " for fish.\nfunction ", words_function, R"(
    set -l typed (commandline -ct)
    if string match -q '*:*' -- $typed
        printf '%s\n' $argv
    else
        string match -v '*:*' -- $argv
    end
end
)");
  const std::string begin = absl::StrCat("complete -c ", program.name);
  absl::StrAppend(&text, begin, " -f\n");
  if (HasCommands(program)) {
    absl::StrAppend(&text, "function ", is_command, R"(
    set -l words (commandline -opc)
    set -e words[1]
    set -l count (count (string split ' ' -- $argv[1]))
    test (count $words) -ge $count; and test "$words[1..$count]" = "$argv[1]"
end
function )",
                    is_command, R"(_at
    set -l words (commandline -opc)
    test "$words[2..-1]" = "$argv[1]"
end
)");
    const auto add_words = [&](const std::string& condition, const std::vector<Word>& words) {
      for (const Word& word : words) {
        absl::StrAppend(&text, begin, " -n ", FishQuoted(condition), " -a ", word.name, " -d ",
                        FishQuoted(word.summary), "\n");
      }
    };
    add_words("test (count (commandline -opc)) -eq 1", FirstWords(program));
    add_words(is_command + "_at help", FirstWords(program));
    for (const Word& first : FirstWords(program)) {
      add_words(absl::StrCat(is_command, "_at ", first.name), SecondWords(program, first.name));
    }
  }
  for (const CommandDescription& command : program.commands) {
    const std::string command_condition =
        command.name.empty()
            ? begin
            : absl::StrCat(begin, " -n ",
                           FishQuoted(absl::StrCat(is_command, " \"", command.name, "\"")));
    for (const FlagDescription& flag : command.flags) {
      if (!flag.names.empty() || flag.takes_files || flag.takes_folders || !flag.choices.empty()) {
        absl::StrAppend(&text, FishFlag(command_condition, words_function, flag));
      }
    }
  }
  return text;
}

}  // namespace

absl::StatusOr<Shell> ShellFromName(absl::string_view name) {
  if (name == "bash") {
    return Shell::kBash;
  }
  if (name == "zsh") {
    return Shell::kZsh;
  }
  if (name == "fish") {
    return Shell::kFish;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("'", name, "' is no shell with completions: bash, zsh or fish"));
}

std::string CompletionScript(Shell shell, const ProgramDescription& program) {
  switch (shell) {
    case Shell::kBash:
      return BashScript(program);
    case Shell::kZsh:
      return ZshScript(program);
    case Shell::kFish:
      return FishScript(program);
  }
  return "";
}

}  // namespace isoscope::cli
