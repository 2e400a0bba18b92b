// The child process finds out what the axes mean, and says it in texts "key=value"; nothing in them
// is taken for granted:
//
//   name=run.h5:/fields/u
//   axes=TZYX                one letter an axis, '-' for an axis of one element
//   dims=50 64 64 64
//   times=0 0.05 0.1 ...     none if no scale says it
//   unit=, long_name=, time_unit=
//
// A volume is then asked for by its part: "TZYX 3 0", letters, step and component.

#include "core/source/hdf5_series.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "core/base/check.h"
#include "core/base/shell_word.h"
#include "core/base/status_macros.h"
#include "core/source/axis_order.h"
#include "core/source/hdf5_attributes.h"
#include "core/source/hdf5_dataset.h"
#include "core/source/hdf5_storage.h"
#include "core/source/walled_source.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxHdf5Steps = 100'000;

absl::Status Named(const std::string& name, const absl::Status& status) {
  return status.ok() ? status
                     : absl::Status(status.code(), absl::StrCat(name, ": ", status.message()));
}

// ---- The child. ---------------------------------------------------------------------------------

absl::StatusOr<AxisOrder> FindAxes(const NamedHdf5Dataset& named,
                                   const std::vector<std::int64_t>& dims,
                                   const std::string& letters) {
  const std::string name = named.parts.name();
  const std::string shape = absl::StrJoin(dims, " x ");
  if (!letters.empty()) {
    auto order = ParseAxisOrder(letters);
    if (!order.ok() || letters.size() != dims.size()) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %d axes (%s elements): --axes %s: %s", name, dims.size(), shape, letters,
          order.ok() ? absl::StrCat("expected ", dims.size(), " letters")
                     : std::string(order.status().message())));
    }
    for (std::size_t axis = 0; axis < letters.size(); ++axis) {
      if (letters[axis] == '-' && dims[axis] != 1) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "%s: --axes %s leaves out axis %d of %s elements", name, letters, axis, shape));
      }
    }
    return order;
  }
  std::optional<AxisOrder> order = PlainAxisOrder(dims);
  if (!order.has_value()) {
    order = Hdf5AxisOrder(named.dataset.get(), dims.size());
  }
  if (order.has_value()) {
    return *order;
  }
  const std::string choices = AxisChoices(dims.size());
  return absl::InvalidArgumentError(
      choices.empty()
          ? absl::StrFormat("%s: %d axes (%s elements); expected 3 to 5; %s", name, dims.size(),
                            shape, ListHdf5Volumes(named.file.get()))
          : absl::StrFormat(
                "%s: %d axes (%s elements), and no attribute says what they mean: %s; say "
                "it, slowest first (T time, C components), as in `isoscope partition "
                "%s --axes %s --output DIR`",
                name, dims.size(), shape, choices, base::ShellWord(name),
                choices.substr(0, choices.find_first_of(", "))));
}

absl::StatusOr<std::vector<std::string>> Describe(const std::string& path,
                                                  const std::string& letters) {
  ISOSCOPE_ASSIGN_OR_RETURN(const NamedHdf5Dataset named,
                            OpenHdf5ByName(path, Hdf5Types::kAll, letters.size()));
  const std::string name = named.parts.name();
  const hid_t dataset = named.dataset.get();
  ISOSCOPE_RETURN_IF_ERROR(FindHdf5Files(dataset, name).status());
  ISOSCOPE_RETURN_IF_ERROR(Named(name, Hdf5SampleTypeOf(dataset, Hdf5Types::kAll).status()));
  const std::vector<std::int64_t> dims = Hdf5DimsOf(dataset);
  ISOSCOPE_ASSIGN_OR_RETURN(const AxisOrder order, FindAxes(named, dims, letters));
  std::vector<std::string> texts{absl::StrCat("name=", name),
                                 absl::StrCat("axes=", AxisLetters(order, dims.size())),
                                 absl::StrCat("dims=", absl::StrJoin(dims, " ")),
                                 absl::StrCat("unit=", Hdf5Text(dataset, {"units", "unit"})),
                                 absl::StrCat("long_name=", Hdf5Text(dataset, {"long_name"}))};
  if (!order.t.has_value()) {
    return texts;
  }
  const std::int64_t steps = dims[*order.t];
  if (steps < 1 || steps > kMaxHdf5Steps) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d steps of time; expected 1 to %d", name, steps, kMaxHdf5Steps));
  }
  const Hdf5Handle scale = Hdf5ScaleOf(dataset, *order.t, dims.size());
  if (scale.is_valid()) {
    auto times = Hdf5ScaleValues(scale.get(), steps);
    ISOSCOPE_RETURN_IF_ERROR(Named(name, times.status()));
    texts.push_back(
        absl::StrCat("times=", absl::StrJoin(*times, " ", [](std::string* out, double time) {
                       absl::StrAppendFormat(out, "%.17g", time);
                     })));
    texts.push_back(absl::StrCat("time_unit=", Hdf5Text(scale.get(), {"units", "unit"})));
  }
  return texts;
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenPart(const std::string& path,
                                                       const std::string& part) {
  const std::vector<std::string> words = absl::StrSplit(part, ' ');
  std::int64_t step = 0;
  std::int64_t component = 0;
  ISOSCOPE_CHECK(words.size() == 3 && absl::SimpleAtoi(words[1], &step) &&
                 absl::SimpleAtoi(words[2], &component));
  ISOSCOPE_ASSIGN_OR_RETURN(NamedHdf5Dataset named,
                            OpenHdf5ByName(path, Hdf5Types::kAll, words[0].size()));
  const std::string name = named.parts.name();
  const std::vector<std::int64_t> dims = Hdf5DimsOf(named.dataset.get());
  ISOSCOPE_ASSIGN_OR_RETURN(const AxisOrder order, FindAxes(named, dims, words[0]));
  if ((order.t.has_value() && step >= dims[*order.t]) ||
      (order.c.has_value() && component >= dims[*order.c])) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: no step %d and component %d in %s elements (%s): it has changed", name,
                        step, component, absl::StrJoin(dims, " x "), words[0]));
  }
  auto type = Hdf5SampleTypeOf(named.dataset.get(), Hdf5Types::kAll);
  ISOSCOPE_RETURN_IF_ERROR(Named(name, type.status()));
  return OpenHdf5Volume(std::move(named), *std::move(type), order, step, component);
}

// ---- The parent. --------------------------------------------------------------------------------

constexpr WalledLibrary kHdf5Parts = {
    .name = "HDF5", .open = OpenPart, .find_files = nullptr, .describe = Describe};

struct Hdf5Description {
  std::string name;
  std::string letters;
  AxisOrder order;
  std::vector<std::int64_t> dims;
  std::vector<double> times;
  SourceField field;
  std::string time_unit;
};

// False if the texts make no sense.
bool ParseDescription(const std::vector<std::string>& texts, Hdf5Description* description) {
  std::map<std::string, std::string> values;
  for (const std::string& text : texts) {
    const std::pair<std::string, std::string> pair = absl::StrSplit(text, absl::MaxSplits('=', 1));
    values.insert(pair);
  }
  description->name = values["name"];
  description->letters = values["axes"];
  const auto order = ParseAxisOrder(description->letters);
  if (!order.ok()) {
    return false;
  }
  description->order = *order;
  for (const absl::string_view word : absl::StrSplit(values["dims"], ' ', absl::SkipEmpty())) {
    if (!absl::SimpleAtoi(word, &description->dims.emplace_back()) ||
        description->dims.back() < 1) {
      return false;
    }
  }
  if (description->dims.size() != description->letters.size()) {
    return false;
  }
  for (const absl::string_view word : absl::StrSplit(values["times"], ' ', absl::SkipEmpty())) {
    double& time = description->times.emplace_back();
    const std::size_t count = description->times.size();
    if (!absl::SimpleAtod(word, &time) || !std::isfinite(time) ||
        (count > 1 && !(time > description->times[count - 2]))) {
      return false;
    }
  }
  const std::int64_t steps = order->t.has_value() ? description->dims[*order->t] : 1;
  const auto time_count = static_cast<std::int64_t>(description->times.size());
  description->field.long_name = values["long_name"];
  description->field.unit = values["unit"];
  description->time_unit = values["time_unit"];
  return steps <= kMaxHdf5Steps && (time_count == 0 || time_count == steps);
}

class Hdf5Series final : public VolumeSeries {
 public:
  Hdf5Series(std::string path, Hdf5Description description)
      : path_(std::move(path)), description_(std::move(description)) {
    const AxisOrder& order = description_.order;
    const std::int64_t steps = order.t.has_value() ? description_.dims[*order.t] : 1;
    for (std::int64_t i = 0; description_.times.empty() && steps > 1 && i < steps; ++i) {
      times_.push_back(static_cast<double>(i));
    }
    if (!description_.times.empty()) {
      times_ = description_.times;
    }
    SourceField& field = description_.field;
    const std::int64_t components = order.c.has_value() ? description_.dims[*order.c] : 1;
    if (components > 1) {
      field.components.clear();
      for (std::int64_t i = 0; i < components; ++i) {
        field.components.push_back(components == 3 ? std::string(1, "xyz"[i]) : absl::StrCat(i));
      }
    }
    fields_ = {field};
  }

  [[nodiscard]] const std::string& name() const override { return path_; }
  [[nodiscard]] const std::vector<SourceField>& fields() const override { return fields_; }
  [[nodiscard]] const std::vector<double>& times() const override { return times_; }
  [[nodiscard]] const std::string& time_unit() const override { return description_.time_unit; }
  [[nodiscard]] const std::string& length_unit() const override { return no_unit_; }

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_CHECK(field == 0);
    return OpenWalled(kHdf5Parts, description_.name,
                      absl::StrCat(description_.letters, " ", step, " ", component));
  }

 private:
  const std::string path_;
  Hdf5Description description_;
  const std::string no_unit_;
  std::vector<SourceField> fields_;
  std::vector<double> times_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenHdf5Series(const std::string& path,
                                                             const std::string& axes) {
  constexpr std::size_t kMaxAxes = 32;
  if (axes.size() > kMaxAxes) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": --axes of ", axes.size(), " letters; expected 3 to 5"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> texts,
                            DescribeWalled(kHdf5Parts, path, axes));
  Hdf5Description description;
  Hdf5Path given;
  Hdf5Path named;
  if (!ParseDescription(texts, &description) || !SplitHdf5Path(path, &given) ||
      !SplitHdf5Path(description.name, &named) || named.file != given.file) {
    return absl::DataLossError(
        absl::StrCat(path, ": what HDF5 says of it makes no sense: the file is damaged"));
  }
  const std::string dataset = named.dataset.substr(named.dataset.rfind('/') + 1);
  description.field.name = dataset.empty() ? "volume" : dataset;
  return std::make_unique<Hdf5Series>(path, std::move(description));
}

}  // namespace isoscope::source
