// From the arguments to an exit code:
//
// 1. Dispatch finds the command: one word or two ("cache list"); `help X` is `X --help`.
// 2. Run reads its flags. An unknown one is an error, which names the nearest flag.
// 3. The action works. Its error is printed in one line, and decides the exit code: 2 for wrong
//    usage, 130 after Ctrl-C, whatever error the interrupted work gave, else 1.

#include "core/cli/program.h"

#include <algorithm>
#include <cstddef>
#include <fstream>
#include <ostream>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/base/version.h"
#include "core/cli/man_page.h"
#include "core/cli/usage.h"

namespace isoscope::cli {
namespace {

constexpr char kHelpAll[] = "--help-all";
// Where the summaries of commands begin.
constexpr int kCommandIndent = 15;

bool IsHelp(const std::string& argument) {
  return argument == "--help" || argument == "-h" || argument == kHelpAll;
}

// FlagSet reads "-.5" as flags of one letter, but "-0.5" as a number.
std::string ReadableNumber(const std::string& argument) {
  if (argument.size() > 2 && absl::StartsWith(argument, "-.") &&
      absl::ascii_isdigit(static_cast<unsigned char>(argument[2]))) {
    return absl::StrCat("-0", argument.substr(1));
  }
  return argument;
}

// Declares the flags of a command. --help-all is for commands whose --help leaves flags out.
Action Declare(const Program& program, const Command& command, bool* wants_all, FlagSet* set) {
  Action action = command.register_flags(set);
  if (program.help.common.contains(command.name)) {
    set->AddSwitch(kHelpAll, wants_all, "Print the help of all flags and exit");
  }
  return action;
}

// `set`: with the flags of the command.
CommandDescription DescribeCommand(const Program& program, const Command& command,
                                   const FlagSet& set) {
  CommandDescription description{.name = command.name,
                                 .summary = command.summary,
                                 .usage = command.usage,
                                 .examples = command.examples,
                                 .flags = set.Describe()};
  Arrange(program.help, &description);
  AddWords(program.words, &description);
  return description;
}

// Reads `arguments`, those behind the command's name, and runs the command.
absl::Status Run(const Command& command, const std::vector<std::string>& arguments,
                 const Context& context) {
  const Program& program = *context.program;
  FlagSet set({.name = absl::StrCat(program.name, " ", command.name), .names_nearest_flag = true});
  bool wants_all = false;
  const Action action = Declare(program, command, &wants_all, &set);

  std::vector<std::string> readable;
  for (const std::string& argument : arguments) {
    // As --help it wins over whatever is wrong with other arguments.
    wants_all = wants_all || argument == kHelpAll;
    readable.push_back(argument == kHelpAll ? "--help" : ReadableNumber(argument));
  }
  ISOSCOPE_RETURN_IF_ERROR(set.Parse(readable));
  if (!set.requested_text().empty()) {
    *context.out << HelpText(program.name, DescribeCommand(program, command, set), program.help,
                             wants_all ? HelpPart::kAll : HelpPart::kCommon, context.out_columns);
    return absl::OkStatus();
  }
  return action(context);
}

// Writes a new file. Only the build needs it.
absl::Status WriteText(const std::string& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  file.close();
  return file ? absl::OkStatus()
              : absl::UnavailableError(absl::StrCat("writing ", path, " failed"));
}

// Writes a man page for the program, and one for each command, into `directory`: for the build.
absl::Status WriteManPages(const Program& program, const std::string& directory) {
  const ProgramDescription description = DescribeProgram(program);
  const auto path = [&](const std::string& command) {
    return absl::StrCat(directory, "/", ManPageName(description, command), ".1");
  };
  ISOSCOPE_RETURN_IF_ERROR(WriteText(path(""), ProgramManPage(description, program.example)));
  for (const CommandDescription& command : description.commands) {
    ISOSCOPE_RETURN_IF_ERROR(WriteText(path(command.name), CommandManPage(description, command)));
  }
  return absl::OkStatus();
}

// The commands of the program, found by name.
class CommandTable {
 public:
  explicit CommandTable(const Program& program) : program_(program), commands_(program.commands) {}

  // Null if there is none.
  [[nodiscard]] const Command* Find(const std::string& name) const {
    const auto found = std::find_if(commands_.begin(), commands_.end(),
                                    [&](const Command& command) { return command.name == name; });
    return found == commands_.end() ? nullptr : &*found;
  }

  // An entry for each command whose name starts with `prefix`, in lines of `columns` characters.
  [[nodiscard]] std::string List(const std::string& prefix, int columns) const {
    std::string text;
    for (const Command& command : commands_) {
      if (absl::StartsWith(command.name, prefix)) {
        absl::StrAppend(&text, HelpEntry(command.name, command.summary, kCommandIndent, columns));
      }
    }
    return text;
  }

  // "partition, info, ...".
  [[nodiscard]] std::string JoinedNames() const { return absl::StrJoin(Names(), ", "); }

  // The text of --help.
  [[nodiscard]] std::string Overview(int columns) const {
    return absl::StrCat(
        program_.name, ": ", program_.summary, "\n\nUsage: ", program_.name,
        " COMMAND ...\n\nCommands:\n", List("", columns),
        "\nOptions:\n"
        "  -h, --help  this text; '",
        program_.name,
        " COMMAND --help' tells about a command\n"
        "  --version   print the version\n"
        "\nExit codes: 0 done, 1 the request failed, 2 wrong usage, 130 ended by Ctrl-C\n"
        "\nExample:\n",
        program_.example);
  }

  // The error for a `name` that Find doesn't know, and the word behind it, if any: names the
  // commands that may have been meant.
  [[nodiscard]] absl::Status Unknown(const std::string& name, const std::string& second) const {
    if (absl::StartsWith(name, "-")) {
      return UsageError(
          absl::StrCat("unknown flag ", name, "; a command comes first: ", JoinedNames()));
    }
    if (const auto moved = program_.moved.find(name); moved != program_.moved.end()) {
      return UsageError(absl::StrCat("'", name, "' is no command; ", moved->second));
    }
    std::vector<std::string> longer;  // where `name` is the first of two words
    for (const std::string& known : Names()) {
      if (absl::StartsWith(known, name + " ")) {
        longer.push_back(known);
      }
    }
    if (!longer.empty() && (second.empty() || absl::StartsWith(second, "-"))) {
      return UsageError(absl::StrCat(
          "'", name, "' is the first of two words; there are: ", absl::StrJoin(longer, ", ")));
    }
    if (!longer.empty()) {
      return NoCommand(absl::StrCat(name, " ", second), longer);
    }
    return NoCommand(name, Names());
  }

 private:
  // `known`: the commands that are meant, by all that is known of `name`.
  static absl::Status NoCommand(const std::string& name, const std::vector<std::string>& known) {
    const std::string nearest = NearestName(name, known);
    return UsageError(absl::StrCat("'", name, "' is no command",
                                   nearest.empty() ? "." : ", did you mean '" + nearest + "'?",
                                   " There are: ", absl::StrJoin(known, ", ")));
  }

  [[nodiscard]] std::vector<std::string> Names() const {
    std::vector<std::string> names;
    names.reserve(commands_.size());
    for (const Command& command : commands_) {
      names.push_back(command.name);
    }
    return names;
  }

  const Program& program_;
  const std::vector<Command>& commands_;
};

absl::Status Dispatch(const CommandTable& commands, const std::vector<std::string>& arguments,
                      std::string* command_name, const Context& context) {
  if (arguments.empty()) {
    return UsageError(absl::StrCat("a command is missing; there are: ", commands.JoinedNames()));
  }
  if (IsHelp(arguments[0]) || (arguments[0] == "help" && arguments.size() == 1)) {
    *context.out << commands.Overview(context.out_columns);
    return absl::OkStatus();
  }
  if (arguments[0] == "--version") {
    *context.out << context.program->name << " " << base::Version() << "\n";
    return absl::OkStatus();
  }
  if (arguments[0] == "--man-pages" && arguments.size() == 2) {
    return WriteManPages(*context.program, arguments[1]);
  }
  std::vector<std::string> rest(arguments.begin() + 1, arguments.end());
  std::string name = arguments[0];
  if (name == "help") {
    name = absl::StrJoin(rest, " ");
    rest = {"--help"};
  } else if (!rest.empty() && commands.Find(absl::StrCat(name, " ", rest[0])) != nullptr) {
    absl::StrAppend(&name, " ", rest[0]);
    rest.erase(rest.begin());
  }
  const Command* command = commands.Find(name);
  if (command == nullptr) {
    const std::string two_word_commands = commands.List(name + " ", context.out_columns);
    if (!two_word_commands.empty() && !rest.empty() && IsHelp(rest[0])) {
      *context.out << "Commands:\n" << two_word_commands;
      return absl::OkStatus();
    }
    return commands.Unknown(name, rest.empty() ? "" : rest[0]);
  }
  *command_name = name;
  return Run(*command, rest, context);
}

}  // namespace

ProgramDescription DescribeProgram(const Program& program) {
  ProgramDescription description{.name = program.name,
                                 .summary = program.summary,
                                 .version = std::string(base::Version()),
                                 .commands = {}};
  for (const Command& command : program.commands) {
    FlagSet set;
    bool wants_all = false;
    const Action action = Declare(program, command, &wants_all, &set);
    description.commands.push_back(DescribeCommand(program, command, set));
  }
  return description;
}

int RunProgram(const Program& program, const std::vector<std::string>& arguments,
               const Context& context) {
  std::string command;
  Context command_context = context;
  command_context.program = &program;
  const absl::Status status = Dispatch(CommandTable(program), arguments, &command, command_context);
  context.out->flush();
  if (!status.ok()) {
    *context.err << FormatError(program.name, command, status) << std::endl;
  } else if (!context.out->good()) {
    *context.err << program.name << ": DATA_LOSS: standard output could not be written"
                 << std::endl;
    return kExitFailed;
  }
  if (!status.ok() && context.interrupt != nullptr && context.interrupt->signal_number() != 0) {
    return kExitInterrupted + context.interrupt->signal_number();
  }
  return ExitCodeOf(status);
}

}  // namespace isoscope::cli
