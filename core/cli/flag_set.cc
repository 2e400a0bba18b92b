// CLI11 reads the results of a flag in three steps: each text is checked, the number of texts is
// checked, a callback stores them. An error of the first step wins over one of the second. So the
// parser of a flag runs as a check, exactly once for each text. The callback of the third step is
// left for an empty text of an optional value, which CLI11 does not check.
//
// CLI11 throws, and only from parse; FlagSet::Parse catches it.

#include "core/cli/flag_set.h"

#include <map>
#include <memory>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include <CLI/CLI.hpp>

#include "core/cli/usage.h"

namespace isoscope::cli {
namespace {

// Which flags exclude a flag, in the order of the calls. CLI11 has them in the order of their
// addresses, which changes from run to run.
using Exclusions = std::map<const CLI::Option*, std::vector<const CLI::Option*>>;

// The text of --help, with the line of usage of a command if it has its own.
class HelpFormatter : public CLI::Formatter {
 public:
  HelpFormatter(const std::string& usage, const Exclusions* exclusions)
      : usage_(usage), exclusions_(exclusions) {
    if (!usage.empty()) {
      constexpr std::size_t kColumnWidth = 34;
      column_width(kColumnWidth);
    }
  }

  std::string make_usage(const CLI::App* app, std::string name) const override {
    return usage_.empty() ? CLI::Formatter::make_usage(app, std::move(name))
                          : absl::StrCat("\nUsage: ", usage_, "\n");
  }

  std::string make_option_opts(const CLI::Option* option) const override {
    std::string text = CLI::Formatter::make_option_opts(option);
    const auto excluded = exclusions_->find(option);
    if (excluded != exclusions_->end()) {
      constexpr char kLastPart[] = " Excludes:";
      text.resize(text.rfind(kLastPart));
      absl::StrAppend(&text, kLastPart);
      for (const CLI::Option* const other : excluded->second) {
        absl::StrAppend(&text, " ", other->get_name());
      }
    }
    return text;
  }

 private:
  const std::string usage_;
  const Exclusions* const exclusions_;
};

// The error for the first flag that is given together with one that it excludes.
absl::Status ExclusionError(const CLI::App& app, const Exclusions& exclusions) {
  for (const CLI::Option* const option : app.get_options()) {
    const auto excluded = exclusions.find(option);
    if (option->count() == 0 || excluded == exclusions.end()) {
      continue;
    }
    for (const CLI::Option* const other : excluded->second) {
      if (other->count() > 0) {
        return UsageError(absl::StrCat(option->get_name(), " excludes ", other->get_name()));
      }
    }
  }
  return absl::OkStatus();
}

// Returns the error for arguments that CLI11 did not match.
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

// The parser as a check of CLI11, which returns the complaint, or "".
std::function<std::string(const std::string&)> CheckOf(const ValueParser& parser) {
  return [parser](const std::string& text) { return std::string(parser(text).message()); };
}

// A flag with several values.
CLI::Option* AddValues(const std::string& names, const std::string& value_name,
                       const std::string& help, const ValueParser& parser, CLI::App* app) {
  CLI::Option* const option = app->add_option_function<std::vector<std::string>>(
      names, [](const std::vector<std::string>& /*texts*/) {}, help);
  return option->check(CheckOf(parser))->type_name(value_name);
}

FlagDescription DescriptionOf(const CLI::Option& option) {
  FlagDescription flag;
  for (const std::string& name : option.get_lnames()) {
    flag.names.push_back(absl::StrCat("--", name));
  }
  for (const std::string& name : option.get_snames()) {
    flag.names.push_back(absl::StrCat("-", name));
  }
  flag.help = option.get_description();
  flag.group = option.get_group();
  flag.environment = option.get_envname();
  flag.default_value = option.get_default_str();
  flag.is_repeatable = option.get_items_expected_max() > 1;
  if (option.get_type_size_max() == 0) {
    return flag;  // a switch
  }
  flag.has_optional_value = option.get_expected_min() == 0;
  SetValueName(option.get_type_name(), &flag);
  return flag;
}

}  // namespace

Flag Flag::Group(const std::string& heading) const {
  option_->group(heading);
  return *this;
}

Flag Flag::Environment(const std::string& variable) const {
  option_->envname(variable);
  return *this;
}

Flag Flag::DefaultText(const std::string& text) const {
  option_->default_str(text);
  return *this;
}

struct FlagSet::Parts {
  explicit Parts(const FlagSetOptions& options)
      : app(options.summary, options.name), version(options.version) {}

  CLI::App app;
  Exclusions exclusions;
  const std::string version;
  std::string requested_text;
};

FlagSet::FlagSet(const FlagSetOptions& options) : parts_(std::make_unique<Parts>(options)) {
  CLI::App& app = parts_->app;
  if (!options.has_help) {
    app.set_help_flag("");
  }
  if (!options.version.empty()) {
    app.set_version_flag("--version", options.version);
  }
  app.footer(options.notes);
  app.formatter(std::make_shared<HelpFormatter>(options.usage, &parts_->exclusions));
  app.allow_extras(options.names_nearest_flag);
}

FlagSet::~FlagSet() = default;

Flag FlagSet::Add(const std::string& names, const std::string& value_name, ValueParser parser,
                  const std::string& help) {
  CLI::Option* const option = parts_->app.add_option_function<std::string>(
      names, [](const std::string& /*text*/) {}, help);
  return Flag(option->check(CheckOf(parser))->type_name(value_name));
}

Flag FlagSet::AddOptional(const std::string& names, const std::string& value_name,
                          ValueParser parser, const std::string& help) {
  // CLI11 gives "true" for no value.
  const ValueParser parse_given = [parser = std::move(parser)](absl::string_view text) {
    return parser(text == "true" ? absl::string_view() : text);
  };
  const auto name = std::make_shared<std::string>();
  CLI::Option* const option = parts_->app.add_option_function<std::string>(
      names,
      [parse_given, name](const std::string& text) {
        const absl::Status status = text.empty() ? parse_given(text) : absl::OkStatus();
        if (!status.ok()) {
          throw CLI::ValidationError(*name, std::string(status.message()));
        }
      },
      help);
  *name = option->get_name();
  return Flag(option->check(CheckOf(parse_given))->type_name(value_name)->expected(0, 1));
}

Flag FlagSet::AddRepeatable(const std::string& names, const std::string& value_name,
                            ValueParser parser, const std::string& help) {
  return Flag(AddValues(names, value_name, help, parser, &parts_->app)->allow_extra_args(false));
}

Flag FlagSet::AddList(const std::string& names, const std::string& value_name, ValueParser parser,
                      const std::string& help) {
  return Flag(AddValues(names, value_name, help, parser, &parts_->app)->delimiter(','));
}

Flag FlagSet::AddSwitch(const std::string& names, bool* is_set, const std::string& help) {
  return Flag(parts_->app.add_flag(names, *is_set, help));
}

Flag FlagSet::AddText(const std::string& names, const std::string& value_name, std::string* value,
                      const std::string& help) {
  return Flag(parts_->app.add_option(names, *value, help)->type_name(value_name));
}

Flag FlagSet::AddTexts(const std::string& names, const std::string& value_name,
                       std::vector<std::string>* values, const std::string& help,
                       bool splits_at_spaces) {
  return Flag(parts_->app.add_option(names, *values, help)
                  ->type_name(value_name)
                  ->delimiter(splits_at_spaces ? ' ' : '\0'));
}

Flag FlagSet::AddChoice(const std::string& names, std::string* value,
                        const std::vector<std::string>& choices, const std::string& help) {
  return Flag(parts_->app.add_option(names, *value, help)
                  ->check(CLI::IsMember(choices))
                  ->capture_default_str());
}

Flag FlagSet::AddInteger(const std::string& names, int* value, int min, int max,
                         const std::string& help) {
  return Flag(parts_->app.add_option(names, *value, help)
                  ->check(CLI::Range(min, max))
                  ->capture_default_str());
}

Flag FlagSet::AddNumber(const std::string& names, double* value, double min, double max,
                        const std::string& help) {
  return Flag(parts_->app.add_option(names, *value, help)
                  ->check(CLI::Range(min, max))
                  ->capture_default_str());
}

Flag FlagSet::AddByteSize(const std::string& names, std::int64_t* value, double min, double max,
                          const std::string& help) {
  return Flag(parts_->app.add_option(names, *value, help)
                  ->type_name("BYTES")
                  ->transform(CLI::AsSizeValue(/*kb_is_1000=*/false))
                  ->check(CLI::Range(min, max))
                  ->capture_default_str());
}

void FlagSet::Exclude(Flag a, Flag b) {
  a.option_->excludes(b.option_);
  parts_->exclusions[a.option_].push_back(b.option_);
  parts_->exclusions[b.option_].push_back(a.option_);
}

void FlagSet::Remove(const std::string& name) {
  parts_->app.remove_option(parts_->app.get_option(name));
}

absl::Status FlagSet::Parse(const std::vector<std::string>& arguments) {
  CLI::App& app = parts_->app;
  std::vector<std::string> reversed(arguments.rbegin(), arguments.rend());  // as CLI11 wants them
  try {
    app.parse(reversed);
  } catch (const CLI::CallForHelp&) {
    parts_->requested_text = app.help();
    return absl::OkStatus();
  } catch (const CLI::CallForVersion&) {
    parts_->requested_text = absl::StrCat(parts_->version, "\n");
    return absl::OkStatus();
  } catch (const CLI::ExcludesError& error) {
    const absl::Status status = ExclusionError(app, parts_->exclusions);
    return status.ok() ? UsageError(error.what()) : status;
  } catch (const CLI::ParseError& error) {
    return UsageError(error.what());
  }
  if (!app.get_allow_extras()) {
    return absl::OkStatus();  // parse throws for extras, but lets "--" be one of them
  }
  const std::vector<std::string> extras = app.remaining();
  return extras.empty() ? absl::OkStatus() : UnknownArgument(app, extras.front());
}

const std::string& FlagSet::requested_text() const { return parts_->requested_text; }

std::vector<std::string> FlagSet::GivenNames() const {
  std::vector<std::string> names;
  const CLI::App& app = parts_->app;
  for (const CLI::Option* const option : app.get_options()) {
    if (option->count() > 0) {
      names.push_back(option->get_single_name());
    }
  }
  return names;
}

std::string FlagSet::Help() const { return parts_->app.help(); }

std::vector<FlagDescription> FlagSet::Describe() const {
  std::vector<FlagDescription> flags;
  const CLI::App& app = parts_->app;
  for (const CLI::Option* const option : app.get_options()) {
    flags.push_back(DescriptionOf(*option));
  }
  return flags;
}

}  // namespace isoscope::cli
