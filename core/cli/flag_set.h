// The flags of one command line: declared once, then parsed, and described in the text of --help.
//
//   FlagSet set({.name = "isoscope render", .summary = "Renders a picture"});
//   set.Add("--output", "FILE.png", store_path, "the picture").Group("Files");
//   set.AddSwitch("--verbose", &is_verbose, "more log lines");
//   ISOSCOPE_RETURN_IF_ERROR(set.Parse(arguments));
//
// flag_set.cc is the only source that sees CLI11, the library underneath.

#ifndef ISOSCOPE_CORE_CLI_FLAG_SET_H_
#define ISOSCOPE_CORE_CLI_FLAG_SET_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "core/cli/command_description.h"

namespace CLI {  // NOLINT(readability-identifier-naming): theirs
class Option;
}  // namespace CLI

namespace isoscope::cli {

// Reads the text of one value and stores the value. The error says what is wrong with the text, as
// in "'x' is not a number"; the name of the flag is put before it.
using ValueParser = std::function<absl::Status(absl::string_view text)>;

// A handle to a flag of a FlagSet, which sets its further properties. Copyable; valid as long as
// the set has the flag. Each function returns the flag itself.
class Flag {
 public:
  // Puts the flag under `heading` in the text of --help; the default heading is "Options".
  Flag Group(const std::string& heading) const;  // NOLINT(modernize-use-nodiscard)
  // Reads the value from this environment variable if the flag is not given.
  Flag Environment(const std::string& variable) const;  // NOLINT(modernize-use-nodiscard)
  // The default, as --help shows it.
  Flag DefaultText(const std::string& text) const;  // NOLINT(modernize-use-nodiscard)

 private:
  friend class FlagSet;

  explicit Flag(CLI::Option* option) : option_(option) {}

  CLI::Option* option_;
};

struct FlagSetOptions {
  std::string name = {};     // as the user calls the program: "isoscope render"
  std::string summary = {};  // the first line of --help
  // The line "Usage: " of --help, without that word; empty: made of the flags.
  std::string usage = {};
  std::string notes = {};    // the last lines of --help
  std::string version = {};  // the line that --version prints; empty: there is no such flag
  bool has_help = true;      // whether there is --help
  // Whether the error about an unknown flag names the nearest one, or all unexpected arguments.
  bool names_nearest_flag = false;
};

// The names of a flag are one or several, apart by commas: "--output,-o"; without dashes it is a
// positional argument. Whatever is stored into must outlive the parsing. Thread-compatible.
class FlagSet {
 public:
  explicit FlagSet(const FlagSetOptions& options = {});
  FlagSet(const FlagSet&) = delete;
  FlagSet& operator=(const FlagSet&) = delete;
  ~FlagSet();

  // A flag with one value. `value_name`: as --help shows it, "FILE.png"; "a|b" also says to shells
  // which words there are.
  Flag Add(const std::string& names, const std::string& value_name, ValueParser parser,
           const std::string& help);
  // A flag whose value may be left out: last, before another flag, or with "=true". The parser then
  // gets an empty text.
  Flag AddOptional(const std::string& names, const std::string& value_name, ValueParser parser,
                   const std::string& help);
  // A flag that may be given several times, with one value each. The parser adds that value.
  Flag AddRepeatable(const std::string& names, const std::string& value_name, ValueParser parser,
                     const std::string& help);
  // A flag with one or more values, apart by spaces or commas: "--shards 1 4" is "--shards 1,4".
  // The parser adds one value.
  Flag AddList(const std::string& names, const std::string& value_name, ValueParser parser,
               const std::string& help);
  // A flag without a value. "--verbose=false" unsets it.
  Flag AddSwitch(const std::string& names, bool* is_set, const std::string& help);

  // Any text; `value` holds the default, which --help does not show.
  Flag AddText(const std::string& names, const std::string& value_name, std::string* value,
               const std::string& help);
  // One or more texts, one an argument; the flag may be repeated. The environment variable has them
  // apart by spaces if `splits_at_spaces`, which then splits arguments, too.
  Flag AddTexts(const std::string& names, const std::string& value_name,
                std::vector<std::string>* values, const std::string& help,
                bool splits_at_spaces = false);
  // The four below show the range and the default of `value` in --help.
  Flag AddChoice(const std::string& names, std::string* value,
                 const std::vector<std::string>& choices, const std::string& help);
  Flag AddInteger(const std::string& names, int* value, int min, int max, const std::string& help);
  Flag AddNumber(const std::string& names, double* value, double min, double max,
                 const std::string& help);
  // A number of bytes, as in "256MiB" or "4GB".
  Flag AddByteSize(const std::string& names, std::int64_t* value, double min, double max,
                   const std::string& help);

  // Refuses both flags together: "--a excludes --b". --help names what a flag excludes in the order
  // of these calls. REQUIRES: both flags are of this set.
  void Exclude(Flag a, Flag b);

  // Takes the flag `name` out again. REQUIRES: there is one, and no exclusion names it.
  void Remove(const std::string& name);

  // Reads the arguments, those behind the program's name, then the environment variables of flags
  // that are not among them. Call it once. Returns a UsageError (usage.h) if a flag is unknown,
  // its value is missing or wrong, or flags exclude each other.
  absl::Status Parse(const std::vector<std::string>& arguments);

  // The text that --help or --version asked for, to be printed in place of any work; empty:
  // neither was given. REQUIRES: Parse returned OK.
  [[nodiscard]] const std::string& requested_text() const;

  // The names of the flags that were given, without dashes, in the order of declaration.
  [[nodiscard]] std::vector<std::string> GivenNames() const;

  // The text of --help.
  [[nodiscard]] std::string Help() const;
  // The same as data, in the order of declaration, for shell completions and man pages.
  [[nodiscard]] std::vector<FlagDescription> Describe() const;

 private:
  struct Parts;

  std::unique_ptr<Parts> parts_;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_FLAG_SET_H_
