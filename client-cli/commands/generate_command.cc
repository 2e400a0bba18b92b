// isoscope generate FIELD --dims X,Y,Z --output FILE
//
// kFields has a row for each field. GenerateFlags has the flags of all fields. A check by field
// makes a flag without effect wrong usage.
//
// To add a field: its function in core, a row in kFields, and its flags.

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"

#include "client-cli/commands/program.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/progress_line.h"
#include "core/cli/usage.h"
#include "core/math/vec.h"
#include "core/source/volume_file.h"
#include "core/source/volume_generator.h"
#include "core/volume/scalar_type.h"

namespace isoscope::cli {
namespace {

using source::GeneratedField;

struct FieldRow {
  GeneratedField field;
  const char* name;
  const char* summary;  // for --help: the field, and the isovalues of its surfaces
};
constexpr std::array<FieldRow, 5> kFields{{
    {GeneratedField::kRandom, "random",
     "waves of a seeded power spectrum: many sheets; 0.5 cuts it in halves, 0.7 leaves blobs"},
    {GeneratedField::kGyroid, "gyroid", "one sheet all over the volume at 0.5; tubes at 0.2, 0.8"},
    {GeneratedField::kMarschnerLobb, "marschner-lobb",
     "ripples around the z axis, finest at the rim: 0.5"},
    {GeneratedField::kShells, "shells", "nested spheres, each hiding the next: 0.5 (any in 0..1)"},
    {GeneratedField::kMixing, "mixing",
     "two fluids stirred where they meet, bubbles and spikes: 0.5 (0.1, 0.9 are their rims)"},
}};

struct GenerateFlags {
  bool is_quiet = false;
  std::optional<GeneratedField> field;
  std::optional<std::string> output;
  std::optional<math::Index3> dims;
  std::optional<volume::ScalarType> type;
  std::optional<std::uint64_t> seed;
  std::optional<math::Vec3d> spacing;
  std::optional<math::Vec3d> origin;
  std::optional<std::int64_t> wave_count;
  std::optional<double> max_wave_number;
  std::optional<double> spectrum_exponent;
  std::optional<double> periods;
  std::optional<double> frequency;
  std::optional<double> alpha;
  std::optional<std::int64_t> shell_count;
  std::optional<double> thickness;
};

absl::StatusOr<GeneratedField> ParseField(absl::string_view text) {
  std::vector<std::pair<std::string, GeneratedField>> choices;
  for (const FieldRow& row : kFields) {
    choices.emplace_back(row.name, row.field);
  }
  return client::ParseChoice<GeneratedField>(text, choices);
}

absl::StatusOr<std::int64_t> ParseWaveCount(absl::string_view text) {
  return client::ParseInteger(text, 1, source::GeneratorParameters::kMaxWaves);
}

absl::StatusOr<std::int64_t> ParseShellsInBall(absl::string_view text) {
  return client::ParseInteger(text, 1, 1000);
}

const char* NameOf(GeneratedField field) {
  for (const FieldRow& row : kFields) {
    if (row.field == field) {
      return row.name;
    }
  }
  return "";
}

absl::Status CheckUsage(const GenerateFlags& flags) {
  if (!flags.field) {
    return UsageError("FIELD is missing: random, gyroid, marschner-lobb, shells or mixing");
  }
  if (!flags.dims) {
    return UsageError("--dims X,Y,Z is missing: the samples on each axis");
  }
  if (!flags.output) {
    return UsageError("--output FILE is missing: a .nrrd, .nhdr, .mha or .raw file to write");
  }
  const absl::Status kind = source::VolumeFileKindOf(*flags.output).status();
  if (!kind.ok()) {
    return UsageError(kind.message());
  }
  const bool has_waves =
      *flags.field == GeneratedField::kRandom || *flags.field == GeneratedField::kMixing;
  const struct {
    const char* name;
    bool is_given;
    bool is_used;
  } rows[] = {
      {"--waves", flags.wave_count.has_value(), has_waves},
      {"--wave-number", flags.max_wave_number.has_value(), has_waves},
      {"--exponent", flags.spectrum_exponent.has_value(), has_waves},
      {"--periods", flags.periods.has_value(), *flags.field == GeneratedField::kGyroid},
      {"--frequency", flags.frequency.has_value(), *flags.field == GeneratedField::kMarschnerLobb},
      {"--alpha", flags.alpha.has_value(), *flags.field == GeneratedField::kMarschnerLobb},
      {"--shells", flags.shell_count.has_value(), *flags.field == GeneratedField::kShells},
      {"--thickness", flags.thickness.has_value(), *flags.field == GeneratedField::kMixing},
  };
  for (const auto& row : rows) {
    if (row.is_given && !row.is_used) {
      return UsageError(absl::StrCat(row.name, " has no meaning for the field ",
                                     NameOf(*flags.field), "; --help lists what belongs to which"));
    }
  }
  return absl::OkStatus();
}

source::GeneratorParameters ParametersOf(const GenerateFlags& flags) {
  source::GeneratorParameters p;
  p.field = *flags.field;
  p.seed = flags.seed.value_or(p.seed);
  p.wave_count = static_cast<int>(flags.wave_count.value_or(p.wave_count));
  p.max_wave_number = flags.max_wave_number.value_or(p.max_wave_number);
  p.spectrum_exponent = flags.spectrum_exponent.value_or(p.spectrum_exponent);
  p.periods = flags.periods.value_or(p.periods);
  p.frequency = flags.frequency.value_or(p.frequency);
  p.alpha = flags.alpha.value_or(p.alpha);
  p.shell_count = static_cast<int>(flags.shell_count.value_or(p.shell_count));
  p.thickness = flags.thickness.value_or(p.thickness);
  return p;
}

// Returns the sample value of `type` for a generated value of 0.5.
double MiddleOf(volume::ScalarType type) {
  return volume::VisitScalarType(type, []<typename T>() {
    if constexpr (std::is_floating_point_v<T>) {
      return 0.5;
    } else {
      return 0.5 * (static_cast<double>(std::numeric_limits<T>::lowest()) +
                    static_cast<double>(std::numeric_limits<T>::max()));
    }
  });
}

absl::Status Run(const GenerateFlags& flags, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  const volume::ScalarType type = flags.type.value_or(volume::ScalarType::kUint16);
  const absl::Time start = absl::Now();
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeGenerator> generator,
                            source::VolumeGenerator::Make(ParametersOf(flags), *flags.dims, type));
  absl::StatusOr<std::int64_t> bytes;
  {
    ProgressLine line(context.err, context.err_is_terminal);
    bytes = source::WriteVolumeFile(
        *generator,
        {.path = *flags.output,
         .spacing = flags.spacing.value_or(math::Vec3d{1, 1, 1}),
         .origin = flags.origin.value_or(math::Vec3d{}),
         .progress = [&line](std::int64_t done,
                             std::int64_t total) { line.Update("generating", done, total); }},
        context.interrupt->cancellation());
  }
  if (!bytes.ok() && context.interrupt->cancellation().is_cancelled()) {
    return absl::CancelledError("interrupted while generating; nothing was left behind");
  }
  ISOSCOPE_RETURN_IF_ERROR(bytes.status());
  const math::Index3& dims = *flags.dims;
  *context.out << *flags.output << ": " << NameOf(*flags.field) << ", " << dims.x << " x " << dims.y
               << " x " << dims.z << " samples of " << volume::NameOf(type) << ", "
               << FormatMebibytes(*bytes) << ", middle value "
               << absl::StrFormat("%.10g", MiddleOf(type)) << ", in "
               << FormatElapsed(absl::Now() - start) << "\n";
  return absl::OkStatus();
}

Action RegisterGenerateFlags(FlagSet* set) {
  const auto flags = std::make_shared<GenerateFlags>();
  AddFlag(set, "field", "FIELD", &flags->field, ParseField,
          "random, gyroid, marschner-lobb, shells or mixing; see below");
  AddFlag(set, "-o,--output", "FILE", &flags->output, ParseText,
          "the volume: .nrrd, .mha, .nhdr with a .raw beside it, or .raw");
  AddFlag(set, "--dims", "X,Y,Z", &flags->dims, client::ParseDims,
          "samples on each axis, x fastest");
  AddFlag(set, "--type", "TYPE", &flags->type, volume::ScalarTypeFromName,
          "uint8, int8, uint16, int16, uint32, int32, float32 or float64 (default: uint16)");
  AddFlag(set, "--seed", "S", &flags->seed, client::ParseUnsigned,
          "of the fields with chance in them: random, mixing (default: 1)");
  AddFlag(set, "--spacing", "X,Y,Z", &flags->spacing, client::ParsePositiveVector,
          "world units between samples, for the header (default: 1,1,1)");
  AddFlag(set, "--origin", "X,Y,Z", &flags->origin, client::ParseVector,
          "world position of the first sample, for the header (default: 0,0,0)");
  const auto add = [](Flag flag) { flag.Group("Fields"); };
  add(AddFlag(set, "--waves", "N", &flags->wave_count, ParseWaveCount,
              "random, mixing: plane waves that are summed up (default: 64)"));
  add(AddFlag(set, "--wave-number", "K", &flags->max_wave_number, client::ParsePositiveNumber,
              "random, mixing: of the finest wave, half-periods over the longest axis, 2 or more "
              "(default: 24)"));
  add(AddFlag(set, "--exponent", "P", &flags->spectrum_exponent, client::ParseNumber,
              "random, mixing: energy falls as wave number^-P (default: 3)"));
  add(AddFlag(set, "--periods", "N", &flags->periods, client::ParsePositiveNumber,
              "gyroid: over the longest axis (default: 8)"));
  add(AddFlag(set, "--frequency", "F", &flags->frequency, client::ParsePositiveNumber,
              "marschner-lobb (default: 6)"));
  add(AddFlag(set, "--alpha", "A", &flags->alpha, client::ParsePositiveNumber,
              "marschner-lobb: height of the ripples (default: 0.25)"));
  add(AddFlag(set, "--shells", "N", &flags->shell_count, ParseShellsInBall,
              "shells: walls, of two spheres each (default: 8)"));
  add(AddFlag(set, "--thickness", "H", &flags->thickness, client::ParsePositiveNumber,
              "mixing: half the height of the stirred layer, 1 being half the longest axis "
              "(default: 0.4)"));
  AddQuietFlag(set, &flags->is_quiet);
  return [flags](const Context& context) {
    return Run(*flags, flags->is_quiet ? QuietContext(context) : context);
  };
}

std::string HelpOfFields() {
  std::string text =
      "  isoscope generate random --dims 512,512,512 --seed 7 --output random.nrrd\n"
      "  isoscope generate shells --dims 256,256,256 --type uint8 --output s.nrrd\n"
      "  isoscope render s.nrrd --isovalue 127.5 --output s.png\n"
      "\nFields, and levels that show something:\n";
  for (const FieldRow& row : kFields) {
    absl::StrAppendFormat(&text, "  %-15s %s\n", row.name, row.summary);
  }
  absl::StrAppend(
      &text,
      "Levels are fractions of the type's range: of uint8 0.5 is 127.5, of uint16 32767.5,\n"
      "of signed types the middle is -0.5; float32 and float64 hold 0 to 1 themselves.\n");
  return text;
}

}  // namespace

Command GenerateCommand() {
  return {.name = "generate",
          .summary = "Writes a test volume of any size: random fields, gyroids, shells and more",
          .usage = "FIELD --dims X,Y,Z --output FILE [OPTIONS]",
          .examples = HelpOfFields(),
          .register_flags = RegisterGenerateFlags};
}

}  // namespace isoscope::cli
