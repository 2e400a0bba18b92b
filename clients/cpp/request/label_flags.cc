// A set of labels is text: values, ranges and names, with commas between.
//
//   3,7-9              the values 3, 7, 8 and 9
//   left lung:teal     the label of that name, in a colour
//   3:#ff0000:0.5      with a colour and an opacity
//
// ParseLabel takes colour and opacity from the end, because names may have colons. ResolveLabels
// looks names up once the dataset is known: first the whole text, because a name may have commas,
// then item by item. A name in another case counts if only one label has it so.
//
// The colour is the given one, else that of the set's first label in the dataset, else one of 16 by
// its value.

#include "clients/cpp/request/label_flags.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "clients/cpp/request/parse_value.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/usage.h"
#include "core/frame/frame_spec.h"
#include "core/volume/inside_rule.h"
#include "core/volume/label.h"
#include "isoscope/v1/dataset_service.pb.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;

constexpr absl::string_view kLabelExpected =
    "SET, SET:COLOR or SET:COLOR:OPACITY, a set of values, ranges and names with commas between "
    "(3,7-9,left lung), a colour or none, and a number above 0, at most 1";

absl::Status MalformedLabel(absl::string_view text) {
  return absl::InvalidArgumentError(
      absl::StrCat(base::Quoted(text, '\''), " is not ", kLabelExpected));
}

// True for "3" and "3,7-9": what can't be a part of a name.
bool IsOfNumbers(absl::string_view text) {
  return !text.empty() && text.find_first_not_of("0123456789.,- ") == absl::string_view::npos;
}

absl::StatusOr<bool> ParseAll(absl::string_view text) {
  if (text != "all") {
    return absl::InvalidArgumentError(absl::StrCat(base::Quoted(text, '\''),
                                                   " is not all; --label ", base::CutText(text),
                                                   " draws the surface of a set"));
  }
  return true;
}

// "3-7": whole numbers, the first at most the last.
std::optional<std::pair<std::int64_t, std::int64_t>> RangeOf(absl::string_view item) {
  const std::vector<absl::string_view> ends = absl::StrSplit(item, '-');
  std::pair<std::int64_t, std::int64_t> range;
  if (ends.size() != 2 || !absl::SimpleAtoi(ends[0], &range.first) ||
      !absl::SimpleAtoi(ends[1], &range.second) || range.first > range.second) {
    return std::nullopt;
  }
  return range;
}

// Resolves the names of one dataset.
class Names {
 public:
  explicit Names(const v1::Dataset& dataset) : dataset_(dataset) {}

  // The value of the label of that name, in any case if only one has it so. NOT_FOUND,
  // INVALID_ARGUMENT if there are several.
  [[nodiscard]] absl::StatusOr<double> Find(absl::string_view name) const {
    std::vector<double> exact;
    std::vector<double> in_any_case;
    for (const v1::Label& label : dataset_.labels()) {
      if (!name.empty() && label.name() == name) {
        exact.push_back(label.value());
      }
      if (!name.empty() && absl::EqualsIgnoreCase(label.name(), name)) {
        in_any_case.push_back(label.value());
      }
    }
    const std::vector<double>& found = exact.empty() ? in_any_case : exact;
    if (found.empty()) {
      return absl::NotFoundError("");
    }
    if (found.size() > 1) {
      return absl::InvalidArgumentError(absl::StrCat(
          "'", base::Printable(name), "' is the name of the labels ",
          absl::StrJoin(found, ", ",
                        [](std::string* out, double v) { *out += cli::FormatValue(v); }),
          ": give one of these values"));
    }
    return found[0];
  }

  [[nodiscard]] absl::Status Unknown(absl::string_view name) const {
    std::vector<std::string> known;
    for (const v1::Label& label : dataset_.labels()) {
      if (!label.name().empty()) {
        known.push_back(label.name());
      }
    }
    const std::string head = absl::StrCat("--label: there is no label ", base::Quoted(name, '\''));
    if (known.empty()) {
      return absl::InvalidArgumentError(
          absl::StrCat(head, ", for dataset '", dataset_.name(),
                       "' has no names of labels: give a value, or make it with --label-names"));
    }
    const std::string nearest = cli::NearestName(name, known);
    return absl::InvalidArgumentError(absl::StrCat(
        head,
        nearest.empty() ? "" : absl::StrCat(", did you mean '", base::Printable(nearest), "'?"),
        " `isoscope info` lists the ", known.size(), " names"));
  }

 private:
  const v1::Dataset& dataset_;
};

absl::Status TooMany(absl::string_view set) {
  return absl::InvalidArgumentError(absl::StrCat("--label ", base::Printable(set),
                                                 " has more than ", volume::kMaxLabels, " values"));
}

absl::StatusOr<std::vector<double>> ValuesOf(const std::string& set, const Names& names) {
  if (const absl::StatusOr<double> value = names.Find(set); !absl::IsNotFound(value.status())) {
    ISOSCOPE_RETURN_IF_ERROR(value.status());
    return std::vector<double>{*value};
  }
  std::vector<double> values;
  for (absl::string_view item : absl::StrSplit(set, ',')) {
    item = absl::StripAsciiWhitespace(item);
    const absl::StatusOr<double> named = names.Find(item);
    double number = 0;
    if (!absl::IsNotFound(named.status())) {
      ISOSCOPE_RETURN_IF_ERROR(named.status());
      values.push_back(*named);
    } else if (absl::SimpleAtod(item, &number) && std::isfinite(number)) {
      values.push_back(number + 0.0);  // -0 is 0
    } else if (const auto range = RangeOf(item)) {
      if (range->second - range->first >= static_cast<std::int64_t>(volume::kMaxLabels)) {
        return TooMany(set);
      }
      for (std::int64_t value = range->first; value <= range->second; ++value) {
        values.push_back(static_cast<double>(value));
      }
    } else {
      return names.Unknown(item);
    }
  }
  std::sort(values.begin(), values.end());
  values.erase(std::unique(values.begin(), values.end()), values.end());
  return values.size() > volume::kMaxLabels ? TooMany(set)
                                            : absl::StatusOr<std::vector<double>>(values);
}

const v1::Label* FindIn(const v1::Dataset& dataset, double value) {
  const auto found = std::find_if(dataset.labels().begin(), dataset.labels().end(),
                                  [&](const v1::Label& label) { return label.value() == value; });
  return found == dataset.labels().end() ? nullptr : &*found;
}

LabelSurface SurfaceOf(std::vector<double> values, const LabelValue& given,
                       const v1::Dataset& dataset) {
  LabelSurface surface;
  const v1::Label* const first = FindIn(dataset, values[0]);
  if (given.color) {
    surface.color = *given.color;
  } else if (first != nullptr && first->has_color()) {
    const v1::Color& color = first->color();
    surface.color = {.red = color.red(), .green = color.green(), .blue = color.blue()};
  } else {
    const volume::LabelColor color = volume::DefaultLabelColor(values[0]);
    constexpr float kMaxByte = 255;
    surface.color = {.red = static_cast<float>(color.red) / kMaxByte,
                     .green = static_cast<float>(color.green) / kMaxByte,
                     .blue = static_cast<float>(color.blue) / kMaxByte};
  }
  surface.color.alpha = given.opacity.value_or(1);
  surface.is_color_given = given.color.has_value();
  surface.name = NameOfLabels(values, dataset);
  surface.values = std::move(values);
  return surface;
}

absl::StatusOr<std::vector<double>> AllLabels(const v1::Dataset& dataset,
                                              const std::optional<std::vector<double>>& present,
                                              std::size_t max_surfaces, const std::string& why) {
  std::vector<double> values;
  if (present) {
    values = *present;
  } else {
    for (const v1::Label& label : dataset.labels()) {
      values.push_back(label.value());
    }
  }
  values.erase(std::remove(values.begin(), values.end(), 0.0), values.end());
  if (values.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("--labels all: ",
                     present       ? "all samples are 0, which is no label"
                     : why.empty() ? "the dataset has no names of labels, and the values of its "
                                     "samples are not known: a gateway does not list them"
                                   : absl::StrCat("the dataset has no names of labels, and ", why),
                     ": give --label with values"));
  }
  if (values.size() > max_surfaces) {
    return absl::InvalidArgumentError(
        absl::StrCat("--labels all: there are ", values.size(), " labels, and a frame has at most ",
                     max_surfaces,
                     " surfaces: choose some with --label 3 --label 7, or make one surface "
                     "of several with --label 3,7-9"));
  }
  return values;
}

}  // namespace

absl::StatusOr<LabelValue> ParseLabel(absl::string_view text) {
  LabelValue value{.set = std::string(text)};
  std::vector<absl::string_view> parts = absl::StrSplit(text, ':');
  double opacity = 0;
  // From the end, so that a name may have colons.
  if (parts.size() > 2 && absl::SimpleAtod(parts.back(), &opacity)) {
    const absl::string_view color = parts[parts.size() - 2];
    const absl::StatusOr<frame::Color> parsed = ParseColor(color);
    if (color.empty() || parsed.ok()) {
      if (!(opacity > 0 && opacity <= 1)) {
        return MalformedLabel(text);
      }
      value.opacity = static_cast<float>(opacity);
      value.color = color.empty() ? std::nullopt : std::optional<frame::Color>(*parsed);
      parts.resize(parts.size() - 2);
      value.set = absl::StrJoin(parts, ":");
    }
  } else if (parts.size() > 1) {
    if (const absl::StatusOr<frame::Color> parsed = ParseColor(parts.back()); parsed.ok()) {
      value.color = *parsed;
      parts.pop_back();
      value.set = absl::StrJoin(parts, ":");
    }
  }
  value.set = std::string(absl::StripAsciiWhitespace(value.set));
  const bool has_wrong_color =
      absl::StrContains(value.set, ':') && IsOfNumbers(value.set.substr(0, value.set.find(':')));
  if (value.set.empty() || has_wrong_color) {
    return MalformedLabel(text);
  }
  return value;
}

void AddLabelFlags(cli::FlagSet* set, LabelFlags* flags, bool has_opacity) {
  const char* const form = has_opacity ? "SET[:COLOR[:OPACITY]]" : "SET[:COLOR]";
  cli::AddRepeatableFlag(
      set, "--label", form, &flags->sets, ParseLabel,
      "the surface of the samples whose value is in the set: values, ranges and names of labels "
      "with commas between, as in 3,7-9 or \"left lung\"; once for each surface (default colour: "
      "that of the label in the dataset, else one of 16 by its value)");
  const auto wants_all = [flags](absl::string_view text) -> absl::Status {
    ISOSCOPE_ASSIGN_OR_RETURN(flags->wants_all, ParseAll(text));
    return absl::OkStatus();
  };
  set->Add("--labels", "all", wants_all,
           "a surface for each label: each value of the samples but 0, if all are whole numbers; "
           "else each that has a name");
  set->AddSwitch("--smooth-labels", &flags->smooths,
                 "move vertices by at most a quarter of a sample: small steps between labels "
                 "become slopes, long ones stay; neighbours still meet without gaps");
}

absl::Status CheckUsage(const LabelFlags& flags, std::size_t max_surfaces) {
  if (flags.smooths && flags.empty()) {
    return cli::UsageError(
        "--smooth-labels smooths surfaces of labels: give --label SET or --labels all");
  }
  if (flags.wants_all && !flags.sets.empty()) {
    return cli::UsageError("--labels all draws every label: leave --label out");
  }
  if (flags.sets.size() > max_surfaces) {
    return cli::UsageError(absl::StrCat("--label is given ", flags.sets.size(), " times: at most ",
                                        max_surfaces, " surfaces are allowed"));
  }
  return absl::OkStatus();
}

bool HasExactBins(const v1::Dataset& dataset) {
  constexpr double kMaxBins = 4096;
  const bool is_integer = dataset.sample_type() != v1::SAMPLE_TYPE_FLOAT32 &&
                          dataset.sample_type() != v1::SAMPLE_TYPE_FLOAT64;
  return is_integer && dataset.has_value_range() &&
         dataset.value_range().max() - dataset.value_range().min() < kMaxBins;
}

std::string WhyNoLabels(const v1::GetHistogramResponse& histogram) {
  if (!histogram.has_label_values()) {
    return "";
  }
  const v1::LabelValues& listed = histogram.label_values();
  if (listed.has_other_value()) {
    return absl::StrCat("a sample is ", cli::FormatValue(listed.other_value()),
                        ", and labels are whole numbers from -2^53 to 2^53");
  }
  return listed.has_more() ? absl::StrCat("its samples have more than ", listed.values_size(),
                                          " different values")
                           : "";
}

std::optional<std::vector<double>> PresentValues(const v1::Dataset& dataset,
                                                 const v1::GetHistogramResponse& histogram) {
  if (histogram.has_label_values()) {
    const v1::LabelValues& listed = histogram.label_values();
    if (listed.has_more() || listed.has_other_value()) {
      return std::nullopt;
    }
    return std::vector<double>(listed.values().begin(), listed.values().end());
  }
  const bool is_integer = dataset.sample_type() != v1::SAMPLE_TYPE_FLOAT32 &&
                          dataset.sample_type() != v1::SAMPLE_TYPE_FLOAT64;
  if (!is_integer || !histogram.has_sample_counts()) {
    return std::nullopt;
  }
  std::vector<double> values;
  for (const v1::HistogramBin& bin : histogram.bins()) {
    if (bin.max() - bin.min() != 1) {
      return std::nullopt;
    }
    if (bin.sample_count() > 0) {
      values.push_back(bin.min());
    }
  }
  return values;
}

absl::Status ResolveLabels(const v1::Dataset& dataset,
                           const std::optional<std::vector<double>>& present, LabelFlags* flags,
                           std::size_t max_surfaces, const std::string& why) {
  flags->surfaces.clear();
  if (flags->wants_all) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> values,
                              AllLabels(dataset, present, max_surfaces, why));
    for (const double value : values) {
      flags->surfaces.push_back(SurfaceOf({value}, {}, dataset));
      flags->surfaces.back().is_smooth = flags->smooths;
    }
    return absl::OkStatus();
  }
  const Names names(dataset);
  for (const LabelValue& given : flags->sets) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::vector<double> values, ValuesOf(given.set, names));
    flags->surfaces.push_back(SurfaceOf(std::move(values), given, dataset));
    flags->surfaces.back().is_smooth = flags->smooths;
  }
  return absl::OkStatus();
}

std::string NameOfLabels(const std::vector<double>& values, const v1::Dataset& dataset) {
  std::vector<std::string> names;
  for (const double value : values) {
    const v1::Label* const label = FindIn(dataset, value);
    names.push_back(label != nullptr && !label->name().empty() ? label->name()
                    : names.empty() ? absl::StrCat("label ", cli::FormatValue(value))
                                    : cli::FormatValue(value));
  }
  return absl::StrJoin(names, ", ");
}

void AddTo(const LabelSurface& surface, v1::Surface* proto) {
  for (const double value : surface.values) {
    proto->add_labels(value);
  }
  proto->set_smooth_labels(surface.is_smooth);
  proto->mutable_color()->set_red(surface.color.red);
  proto->mutable_color()->set_green(surface.color.green);
  proto->mutable_color()->set_blue(surface.color.blue);
  proto->mutable_color()->set_alpha(surface.color.alpha);
}

}  // namespace isoscope::client
