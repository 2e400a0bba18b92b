// From the arguments to an exit code:
//
// 1. Dispatch finds the command: one word or two ("bench frame"); `help X` is `X --help`.
// 2. Run reads its flags with CLI11. What is left over is an error, which names the nearest flag.
// 3. The action works. Its error is printed in one line, and decides the exit code: 2 for wrong
//    usage, else 1.
//
// Only CLI11 throws, and only from parse; it is caught there.

#include "client-cli/command.h"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <ostream>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include <CLI/CLI.hpp>

#include "client-cli/usage.h"
#include "core/base/status_macros.h"
#include "core/base/version.h"
#include "core/cli/man_page.h"
#include "core/io/atomic_file.h"

namespace isoscope::cli {
namespace {

constexpr char kSummary[] = "isosurfaces of volumes too large for one machine";
constexpr char kExample[] = "  isoscope render head.nii.gz --isovalue 60 --output head.png\n";

bool IsHelp(const std::string& argument) { return argument == "--help" || argument == "-h"; }

// CLI11 takes "-.5" for flags of one letter; "-0.5" it knows.
std::string ReadableNumber(const std::string& argument) {
  if (argument.size() > 2 && absl::StartsWith(argument, "-.") &&
      absl::ascii_isdigit(static_cast<unsigned char>(argument[2]))) {
    return absl::StrCat("-0", argument.substr(1));
  }
  return argument;
}

absl::Status UnknownArgument(const CLI::App& app, const std::string& argument) {
  if (!absl::StartsWith(argument, "-")) {
    return UsageError(absl::StrCat("'", argument, "' is one argument too many"));
  }
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    for (const std::string& name : option->get_lnames()) {
      names.push_back(absl::StrCat("--", name));
    }
  }
  const std::string typed = argument.substr(0, argument.find('='));
  const std::string nearest = NearestName(typed, names);
  return UsageError(absl::StrCat("unknown flag ", typed,
                                 nearest.empty() ? "" : "; did you mean " + nearest + "?"));
}

// The help of a command, with our own first line.
class CommandFormatter : public CLI::Formatter {
 public:
  explicit CommandFormatter(const Command& command)
      : usage_(absl::StrCat("\nUsage: isoscope ", command.name, " ", command.usage, "\n")) {
    column_width(34);
  }

  std::string make_usage(const CLI::App* /*app*/, std::string /*name*/) const override {
    return usage_;
  }

 private:
  const std::string usage_;
};

// Reads `arguments`, those behind the command's name, and runs the command.
absl::Status Run(const Command& command, const std::vector<std::string>& arguments,
                 const Context& context) {
  CLI::App app(command.summary);
  app.name(absl::StrCat("isoscope ", command.name));
  app.allow_extras();
  app.footer(absl::StrCat("\nExamples:\n", command.examples));
  app.formatter(std::make_shared<CommandFormatter>(command));
  const Action action = command.register_flags(&app);

  std::vector<std::string> reversed;  // as CLI11 wants them
  std::transform(arguments.rbegin(), arguments.rend(), std::back_inserter(reversed),
                 ReadableNumber);
  try {
    app.parse(reversed);
  } catch (const CLI::CallForHelp&) {
    *context.out << app.help();
    return absl::OkStatus();
  } catch (const CLI::ParseError& error) {
    return UsageError(error.what());
  }
  const std::vector<std::string> extras = app.remaining();
  if (!extras.empty()) {
    return UnknownArgument(app, extras.front());
  }
  return action(context);
}

// Writes a man page for the program, and one for each command, into `directory`: for the build.
absl::Status WriteManPages(const std::vector<Command>& commands, const std::string& directory) {
  const ProgramDescription program = DescribeProgram(commands);
  const auto path = [&](const std::string& command) {
    return absl::StrCat(directory, "/", ManPageName(program, command), ".1");
  };
  ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(path(""), ProgramManPage(program, kExample)));
  for (const CommandDescription& command : program.commands) {
    ISOSCOPE_RETURN_IF_ERROR(
        io::WriteFileAtomically(path(command.name), CommandManPage(program, command)));
  }
  return absl::OkStatus();
}

// The commands of the program, found by name.
class CommandTable {
 public:
  explicit CommandTable(const std::vector<Command>& commands) : commands_(commands) {}

  // Null if there is none.
  [[nodiscard]] const Command* Find(const std::string& name) const {
    const auto found = std::find_if(commands_.begin(), commands_.end(),
                                    [&](const Command& command) { return command.name == name; });
    return found == commands_.end() ? nullptr : &*found;
  }

  // One line for each command whose name starts with `prefix`.
  [[nodiscard]] std::string List(const std::string& prefix) const {
    std::string text;
    for (const Command& command : commands_) {
      if (absl::StartsWith(command.name, prefix)) {
        absl::StrAppendFormat(&text, "  %-12s %s\n", command.name, command.summary);
      }
    }
    return text;
  }

  // "partition, info, ...".
  [[nodiscard]] std::string JoinedNames() const { return absl::StrJoin(Names(), ", "); }

  // The text of `isoscope --help`.
  [[nodiscard]] std::string Overview() const {
    return absl::StrCat("isoscope: ", kSummary,
                        "\n\n"
                        "Usage: isoscope COMMAND ...\n\nCommands:\n",
                        List(""),
                        "\nOptions:\n"
                        "  -h, --help  this text; 'isoscope COMMAND --help' tells about a command\n"
                        "  --version   print the version\n"
                        "\nExit codes: 0 done, 1 the request failed, 2 wrong usage\n"
                        "\nExample:\n",
                        kExample);
  }

  // The error for a `name` that Find doesn't know: names the commands that may have been meant.
  [[nodiscard]] absl::Status Unknown(const std::string& name) const {
    if (absl::StartsWith(name, "-")) {
      return UsageError(
          absl::StrCat("unknown flag ", name, "; a command comes first: ", JoinedNames()));
    }
    std::vector<std::string> longer;  // where `name` is the first of two words
    for (const std::string& known : Names()) {
      if (absl::StartsWith(known, name + " ")) {
        longer.push_back(known);
      }
    }
    if (!longer.empty()) {
      return UsageError(absl::StrCat(
          "'", name, "' is the first of two words; there are: ", absl::StrJoin(longer, ", ")));
    }
    const std::string nearest = NearestName(name, Names());
    return UsageError(absl::StrCat("'", name, "' is no command",
                                   nearest.empty() ? "." : ", did you mean '" + nearest + "'?",
                                   " There are: ", JoinedNames()));
  }

 private:
  [[nodiscard]] std::vector<std::string> Names() const {
    std::vector<std::string> names;
    names.reserve(commands_.size());
    for (const Command& command : commands_) {
      names.push_back(command.name);
    }
    return names;
  }

  const std::vector<Command>& commands_;
};

absl::Status Dispatch(const CommandTable& commands, const std::vector<std::string>& arguments,
                      std::string* command_name, const Context& context) {
  if (arguments.empty()) {
    return UsageError(absl::StrCat("a command is missing; there are: ", commands.JoinedNames()));
  }
  if (IsHelp(arguments[0]) || (arguments[0] == "help" && arguments.size() == 1)) {
    *context.out << commands.Overview();
    return absl::OkStatus();
  }
  if (arguments[0] == "--version") {
    *context.out << "isoscope " << base::Version() << "\n";
    return absl::OkStatus();
  }
  if (arguments[0] == "--man-pages" && arguments.size() == 2) {
    return WriteManPages(*context.commands, arguments[1]);
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
    const std::string of_two_words = commands.List(name + " ");
    if (!of_two_words.empty() && !rest.empty() && IsHelp(rest[0])) {
      *context.out << "Commands:\n" << of_two_words;
      return absl::OkStatus();
    }
    return commands.Unknown(name);
  }
  *command_name = name;
  return Run(*command, rest, context);
}

}  // namespace

std::vector<Command> Commands() {
  return {PartitionCommand(), InfoCommand(),       ServeCommand(),     RenderCommand(),
          PickCommand(),      ExportCommand(),     GenerateCommand(),  TopCommand(),
          CacheListCommand(), CacheClearCommand(), CompletionCommand()};
}

ProgramDescription DescribeProgram(const std::vector<Command>& commands) {
  ProgramDescription program{.name = "isoscope",
                             .summary = kSummary,
                             .version = std::string(base::Version()),
                             .commands = {}};
  for (const Command& command : commands) {
    CLI::App app(command.summary);
    const Action action = command.register_flags(&app);
    program.commands.push_back({.name = command.name,
                                .summary = command.summary,
                                .usage = command.usage,
                                .examples = command.examples,
                                .flags = DescribeFlags(app)});
  }
  return program;
}

int RunCommandLine(const std::vector<std::string>& arguments, const std::vector<Command>& commands,
                   const Context& context) {
  std::string command;
  Context of_command = context;
  of_command.commands = &commands;
  const absl::Status status = Dispatch(CommandTable(commands), arguments, &command, of_command);
  context.out->flush();
  if (!status.ok()) {
    *context.err << FormatError(command, status) << std::endl;
  } else if (!context.out->good()) {
    *context.err << "isoscope: DATA_LOSS: standard output could not be written" << std::endl;
    return kExitFailed;
  }
  return ExitCodeOf(status);
}

}  // namespace isoscope::cli
