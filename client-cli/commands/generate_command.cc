// isoscope generate FIELD --dims X,Y,Z --output FILE
//
// Every field but one is a volume; flow is a series of several fields and time steps. kFields has a
// row for each field; the flags of a field are in GenerateFlags, and which flags belong to which
// field is checked, so that a flag without effect is wrong usage.

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
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
#include "absl/strings/str_join.h"

#include "client-cli/commands/program.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/cancellation.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/progress_line.h"
#include "core/cli/usage.h"
#include "core/math/vec.h"
#include "core/synthetic/flow_file.h"
#include "core/synthetic/flow_generator.h"
#include "core/synthetic/generated_regions.h"
#include "core/synthetic/volume_file.h"
#include "core/synthetic/volume_generator.h"
#include "core/volume/scalar_type.h"

namespace isoscope::cli {
namespace {

using source::GeneratedField;

struct FieldRow {
  std::optional<GeneratedField> field;  // unset: flow
  const char* name;
  const char* summary;  // for --help: the field, and the isovalues of its surfaces
};
constexpr std::array<FieldRow, 7> kFields{{
    {GeneratedField::kRandom, "random",
     "waves of a seeded power spectrum: many sheets; 0.5 cuts it in halves, 0.7 leaves blobs"},
    {GeneratedField::kGyroid, "gyroid", "one sheet all over the volume at 0.5; tubes at 0.2, 0.8"},
    {GeneratedField::kMarschnerLobb, "marschner-lobb",
     "ripples around the z axis, finest at the rim: 0.5"},
    {GeneratedField::kShells, "shells", "nested spheres, each hiding the next: 0.5 (any in 0..1)"},
    {GeneratedField::kMixing, "mixing",
     "two fluids stirred where they meet, bubbles and spikes: 0.5 (0.1, 0.9 are their rims)"},
    {GeneratedField::kLabels, "labels",
     "a segmentation: a core within cells that touch each other, with names: --labels all"},
    {std::nullopt, "flow",
     "a series of time steps: pressure, temperature and velocity of a vortex; see below"},
}};

// As the head of core/synthetic/flow_generator.h has it.
constexpr char kHelpOfFlow[] = R"(
flow is a decaying vortex that is carried along with a warm cloud, on a grid of 1 m (its longest
axis) around (0, 0, 0). It writes a ParaView collection, .pvd, and a .vti for each of N steps beside
it. Step i is at time t = i DT, in s. At (x, y, z), in m:
  (X, Y, Z)   = (x + 0.08 - 0.03 t, y + 0.05 - 0.02 t, z + 0.12 - 0.05 t)
  v           = 0.1 exp(-0.4 t) (sin kZ + 0.6 cos kY, 0.8 sin kX + cos kZ,
                                 0.6 sin kY + 0.8 cos kX),  k = 4 pi /m
  velocity    = (0.03, 0.02, 0.05) + v      m/s, 3 components
  pressure    = -500 |v|^2                  Pa, relative to rest; tubes at half its lowest value
  temperature = 293.15 + 60 g(X', 0.1) g(Y', 0.1) g(Z', 0.2)
                                            K; the cloud's rim at 300, its core at 330
  g(q, h)     = h / b exp(-q^2 / (2 b^2)),  b^2 = h^2 + 0.0002 t
(X', Y', Z') is (X, Y, Z) carried back along v: two times, with s = (1 - exp(-0.4 t)) / 8,
  X -= s (sin kZ + 0.6 cos kY), then Y -= s (0.8 sin kX + cos kZ), then Z -= s (0.6 sin kY +
  0.8 cos kX).
All samples are float32, with the same bits on every machine.
)";

struct GenerateFlags {
  bool is_quiet = false;
  std::optional<const FieldRow*> field;
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
  std::optional<std::int64_t> region_count;
  std::optional<std::int64_t> step_count;
  std::optional<double> time_step;
  std::optional<std::int64_t> thread_count;
};

std::string FieldNames(absl::string_view separator) {
  return absl::StrJoin(kFields, separator,
                       [](std::string* out, const FieldRow& row) { out->append(row.name); });
}

absl::StatusOr<const FieldRow*> ParseField(absl::string_view text) {
  std::vector<std::pair<std::string, const FieldRow*>> choices;
  choices.reserve(kFields.size());
  for (const FieldRow& row : kFields) {
    choices.emplace_back(row.name, &row);
  }
  return client::ParseChoice<const FieldRow*>(text, choices);
}

absl::StatusOr<std::int64_t> ParseWaveCount(absl::string_view text) {
  return client::ParseInteger(text, 1, source::GeneratorParameters::kMaxWaves);
}

absl::StatusOr<std::int64_t> ParseShellsInBall(absl::string_view text) {
  return client::ParseInteger(text, 1, 1000);
}

absl::StatusOr<std::int64_t> ParseRegionCount(absl::string_view text) {
  return client::ParseInteger(text, 2, source::GeneratedRegions::kMaxRegions);
}

absl::StatusOr<std::int64_t> ParseStepCount(absl::string_view text) {
  return client::ParseInteger(text, 1, source::kMaxFlowSteps);
}

absl::StatusOr<std::int64_t> ParseThreadCount(absl::string_view text) {
  return client::ParseInteger(text, 1, 1024);
}

absl::Status CheckOutput(const GenerateFlags& flags, bool is_flow) {
  if (!flags.output) {
    return UsageError(is_flow ? "--output FILE.pvd is missing: the collection to write"
                              : "--output FILE is missing: a .nrrd, .nhdr, .mha or .raw file to "
                                "write");
  }
  const absl::Status kind = is_flow ? source::CheckFlowPath(*flags.output)
                                    : source::VolumeFileKindOf(*flags.output).status();
  return kind.ok() ? kind : UsageError(kind.message());
}

absl::Status CheckUsage(const GenerateFlags& flags) {
  if (!flags.field) {
    return UsageError(absl::StrCat("FIELD is missing, one of: ", FieldNames(", ")));
  }
  if (!flags.dims) {
    return UsageError("--dims X,Y,Z is missing: the samples on each axis");
  }
  const std::optional<GeneratedField>& field = (*flags.field)->field;
  const bool is_flow = !field;
  ISOSCOPE_RETURN_IF_ERROR(CheckOutput(flags, is_flow));
  const bool has_waves = field == GeneratedField::kRandom || field == GeneratedField::kMixing;
  const struct {
    const char* name;
    bool is_given;
    bool is_used;
  } rows[] = {
      {"--waves", flags.wave_count.has_value(), has_waves},
      {"--wave-number", flags.max_wave_number.has_value(), has_waves},
      {"--exponent", flags.spectrum_exponent.has_value(), has_waves},
      {"--periods", flags.periods.has_value(), field == GeneratedField::kGyroid},
      {"--frequency", flags.frequency.has_value(), field == GeneratedField::kMarschnerLobb},
      {"--alpha", flags.alpha.has_value(), field == GeneratedField::kMarschnerLobb},
      {"--shells", flags.shell_count.has_value(), field == GeneratedField::kShells},
      {"--thickness", flags.thickness.has_value(), field == GeneratedField::kMixing},
      {"--regions", flags.region_count.has_value(), field == GeneratedField::kLabels},
      {"--type", flags.type.has_value(), !is_flow},
      {"--seed", flags.seed.has_value(), !is_flow},
      {"--spacing", flags.spacing.has_value(), !is_flow},
      {"--origin", flags.origin.has_value(), !is_flow},
      {"--steps", flags.step_count.has_value(), is_flow},
      {"--time-step", flags.time_step.has_value(), is_flow},
  };
  for (const auto& row : rows) {
    if (row.is_given && !row.is_used) {
      return UsageError(absl::StrCat(row.name, " has no meaning for the field ",
                                     (*flags.field)->name, "; --help lists what belongs to which"));
    }
  }
  return !is_flow || flags.step_count
             ? absl::OkStatus()
             : UsageError("--steps N is missing: the time steps of the flow");
}

source::GeneratorParameters ParametersOf(const GenerateFlags& flags) {
  source::GeneratorParameters p;
  p.field = (*flags.field)->field.value_or(p.field);
  p.seed = flags.seed.value_or(p.seed);
  p.wave_count = static_cast<int>(flags.wave_count.value_or(p.wave_count));
  p.max_wave_number = flags.max_wave_number.value_or(p.max_wave_number);
  p.spectrum_exponent = flags.spectrum_exponent.value_or(p.spectrum_exponent);
  p.periods = flags.periods.value_or(p.periods);
  p.frequency = flags.frequency.value_or(p.frequency);
  p.alpha = flags.alpha.value_or(p.alpha);
  p.shell_count = static_cast<int>(flags.shell_count.value_or(p.shell_count));
  p.thickness = flags.thickness.value_or(p.thickness);
  p.region_count = static_cast<int>(flags.region_count.value_or(p.region_count));
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

// Says which values show something.
std::string ValuesOf(const source::VolumeGenerator& generator) {
  const std::size_t label_count = generator.labels().size();
  return label_count > 0 ? absl::StrCat("labels 1 to ", label_count)
                         : absl::StrFormat("middle value %.10g", MiddleOf(generator.type()));
}

// Begins the line about what was written.
std::string FileAndDims(const GenerateFlags& flags) {
  const math::Index3& dims = *flags.dims;
  return absl::StrFormat("%s: %s, %d x %d x %d samples", *flags.output, (*flags.field)->name,
                         dims.x, dims.y, dims.z);
}

using Progress = std::function<void(std::int64_t done_bytes, std::int64_t total_bytes)>;

// Writes the volume. Returns a text that says what was written.
absl::StatusOr<std::string> GenerateVolume(const GenerateFlags& flags, const Progress& progress,
                                           const base::Cancellation& cancellation) {
  const volume::ScalarType type = flags.type.value_or(
      (*flags.field)->field == GeneratedField::kLabels ? volume::ScalarType::kUint8
                                                       : volume::ScalarType::kUint16);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeGenerator> generator,
                            source::VolumeGenerator::Make(ParametersOf(flags), *flags.dims, type));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::int64_t bytes,
      source::WriteVolumeFile(*generator,
                              {.path = *flags.output,
                               .spacing = flags.spacing.value_or(math::Vec3d{1, 1, 1}),
                               .origin = flags.origin.value_or(math::Vec3d{}),
                               .progress = progress},
                              cancellation));
  return absl::StrCat(FileAndDims(flags), " of ", volume::NameOf(type), ", ",
                      FormatMebibytes(bytes), ", ", ValuesOf(*generator));
}

// Writes the series of a flow. Returns a text that says what was written.
absl::StatusOr<std::string> GenerateFlow(const GenerateFlags& flags, const Progress& progress,
                                         const base::Cancellation& cancellation) {
  source::FlowFileOptions options{.path = *flags.output,
                                  .dims = *flags.dims,
                                  .step_count = *flags.step_count,
                                  .progress = progress};
  options.time_step = flags.time_step.value_or(options.time_step);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t bytes, source::WriteFlow(options, cancellation));
  std::string fields;
  for (const source::FlowFieldRow& row : source::kFlowFields) {
    absl::StrAppend(&fields, ", ", row.name, " [", row.unit, "]");
  }
  return absl::StrCat(FileAndDims(flags), fields, ", ", options.step_count,
                      options.step_count == 1 ? " step" : " steps", " of ",
                      absl::StrFormat("%.10g s, ", options.time_step), FormatMebibytes(bytes));
}

absl::Status Run(const GenerateFlags& flags, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  const base::MonotonicTime start = base::MonotonicNow();
  const base::Cancellation& cancellation = context.interrupt->cancellation();
  absl::StatusOr<std::string> written;
  {
    ProgressLine line(context.err, context.err_is_terminal);
    const Progress progress = [&line](std::int64_t done, std::int64_t total) {
      line.Update("generating", done, total);
    };
    const std::shared_ptr<base::TaskArena> arena =
        std::make_shared<base::TaskArena>(static_cast<int>(flags.thread_count.value_or(0)));
    written = base::RunIn(arena.get(), [&] {
      return (*flags.field)->field ? GenerateVolume(flags, progress, cancellation)
                                   : GenerateFlow(flags, progress, cancellation);
    });
  }
  if (!written.ok() && cancellation.is_cancelled()) {
    return absl::CancelledError("interrupted while generating; nothing was left behind");
  }
  ISOSCOPE_RETURN_IF_ERROR(written.status());
  *context.out << *written << ", in " << FormatElapsed(base::MonotonicNow() - start) << "\n";
  return absl::OkStatus();
}

Action RegisterGenerateFlags(FlagSet* set) {
  const auto flags = std::make_shared<GenerateFlags>();
  AddFlag(set, "field", FieldNames("|"), &flags->field, ParseField,
          "the field: random waves, sheets, ripples, spheres, mixing fluids, a segmentation, or a "
          "flow; see below");
  AddFlag(set, "-o,--output", "FILE", &flags->output, ParseText,
          "the volume: .nrrd, .mha, .nhdr with a .raw beside it, or .raw; of a flow: .pvd");
  AddFlag(set, "--dims", "X,Y,Z", &flags->dims, client::ParseDims,
          "samples on each axis, x fastest");
  AddFlag(
      set, "--type", "TYPE", &flags->type, volume::ScalarTypeFromName,
      "uint8, int8, uint16, int16, uint32, int32, float32 or float64 (default: uint16, of labels "
      "uint8)");
  AddFlag(set, "--seed", "S", &flags->seed, client::ParseUnsigned,
          "of the fields with chance in them: random, mixing, labels (default: 1)");
  AddFlag(set, "--spacing", "X,Y,Z", &flags->spacing, client::ParsePositiveVector,
          "world units between samples, for the header (default: 1,1,1)");
  AddFlag(set, "--origin", "X,Y,Z", &flags->origin, client::ParseVector,
          "world position of the first sample, for the header (default: 0,0,0)");
  AddFlag(set, "--threads", "T", &flags->thread_count, ParseThreadCount,
          "threads (default: one for each core); the bytes do not depend on it");
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
  add(AddFlag(set, "--regions", "N", &flags->region_count, ParseRegionCount,
              "labels: the core and the cells around it, 2 to 100 (default: 12)"));
  add(AddFlag(set, "--steps", "N", &flags->step_count, ParseStepCount,
              "flow: time steps, the first at 0 s"));
  add(AddFlag(set, "--time-step", "DT", &flags->time_step, client::ParsePositiveNumber,
              "flow: seconds between steps (default: 0.1)"));
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
      "  isoscope generate labels --dims 128,128,128 --output ball.nrrd\n"
      "  isoscope render ball.nrrd --labels all --output b.png\n"
      "  isoscope generate flow --dims 128,128,128 --steps 50 --output flow.pvd\n"
      "  isoscope render flow_00020.vti:temperature --isovalue 300 --output f.png\n"
      "\nFields, and levels that show something:\n";
  for (const FieldRow& row : kFields) {
    absl::StrAppendFormat(&text, "  %-15s %s\n", row.name, row.summary);
  }
  absl::StrAppend(
      &text,
      "Levels are fractions of the type's range: of uint8 0.5 is 127.5, of uint16 32767.5,\n"
      "of signed types the middle is -0.5; float32 and float64 hold 0 to 1 themselves.\n"
      "Labels are 0 outside, 1, 2, ... of every type; .nrrd and .nhdr have their names and "
      "colours.\n",
      kHelpOfFlow);
  return text;
}

}  // namespace

Command GenerateCommand() {
  return {.name = "generate",
          .summary =
              "Writes a test volume or flow of any size: random fields, gyroids, shells and more",
          .usage = "FIELD --dims X,Y,Z --output FILE [OPTIONS]",
          .examples = HelpOfFields(),
          .register_flags = RegisterGenerateFlags};
}

}  // namespace isoscope::cli
