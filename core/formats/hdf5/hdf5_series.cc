// The child process finds out what the axes mean, and says it in texts "key=value"; nothing in them
// is taken for granted:
//
//   name=run.h5:/fields/u
//   axes=TZYX                one letter an axis, '-' for an axis of one element; of space, Z is the
//                            slowest, X the fastest
//   dims=50 64 64 64
//   times=0 0.05 0.1 ...     none if no scale says it
//   distances_z=0 2 3 6      only of an axis that is not even: where its samples lie
//   unit=, long_name=, time_unit=, length_unit=
//
// A volume is then asked for by its part: "TZYX 3 0 even s--": the letters that --axes gave, or
// "*"; step and component; whether the grid must be even ("uneven": it is resampled here); what of
// the grid the user gives (walled_series.h).

#include "core/formats/hdf5/hdf5_series.h"

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
#include "absl/strings/string_view.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/formats/hdf5/hdf5_attributes.h"
#include "core/formats/hdf5/hdf5_boxes.h"
#include "core/formats/hdf5/hdf5_chunk_table.h"
#include "core/formats/hdf5/hdf5_coordinates.h"
#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/formats/hdf5/hdf5_storage.h"
#include "core/source/adapt/resampled_source.h"
#include "core/source/child/walled_series.h"
#include "core/source/child/walled_source.h"
#include "core/source/grid/axis_order.h"
#include "core/source/series_parts.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxHdf5Steps = 100'000;
// Words of a part.
constexpr absl::string_view kAsFileSays = "*";
constexpr absl::string_view kEvenGrid = "even";
constexpr absl::string_view kUnevenGrid = "uneven";

absl::Status Named(const std::string& name, const absl::Status& status) {
  return status.ok() ? status
                     : absl::Status(status.code(), absl::StrCat(name, ": ", status.message()));
}

// ---- The child. ---------------------------------------------------------------------------------

// A dataset, and what its axes are.
struct FoundDataset {
  NamedHdf5Dataset named;
  std::vector<std::int64_t> dims;
  std::vector<CfAxis> axes;
  Hdf5Layout layout;
};

// `letters` are those of --axes, "" if there are none.
absl::StatusOr<FoundDataset> FindDataset(const std::string& path, const std::string& letters) {
  FoundDataset found;
  ISOSCOPE_ASSIGN_OR_RETURN(found.named, OpenHdf5ByName(path, letters.size()));
  const std::string name = found.named.parts.name();
  found.dims = Hdf5DimsOf(found.named.dataset.get());
  auto axes = Hdf5AxesOf(found.named);
  ISOSCOPE_RETURN_IF_ERROR(Named(name, axes.status()));
  found.axes = *std::move(axes);
  auto layout = Hdf5LayoutOf(found.axes, letters, name);
  ISOSCOPE_RETURN_IF_ERROR(Named(name, layout.status()));
  found.layout = *std::move(layout);
  return found;
}

std::string JoinedHdf5Numbers(const std::vector<double>& numbers) {
  return absl::StrJoin(numbers, " ", [](std::string* out, double number) {
    absl::StrAppendFormat(out, "%.17g", number);
  });
}

// The texts of the steps; none without a time axis.
absl::Status AddTimes(const FoundDataset& found, std::vector<std::string>* texts) {
  const std::string name = found.named.parts.name();
  const CfAxis& axis = found.axes[*found.layout.order.t];
  if (axis.size < 1 || axis.size > kMaxHdf5Steps) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d steps of time; expected 1 to %d", name, axis.size, kMaxHdf5Steps));
  }
  if (!axis.values.empty()) {
    const auto times = CfTimesOf(axis);
    ISOSCOPE_RETURN_IF_ERROR(Named(name, times.status()));
    texts->push_back(absl::StrCat("times=", JoinedHdf5Numbers(*times)));
    texts->push_back(absl::StrCat("time_unit=", axis.units));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<std::string>> Describe(const std::string& path,
                                                  const std::string& letters) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FoundDataset found, FindDataset(path, letters));
  const std::string name = found.named.parts.name();
  const hid_t dataset = found.named.dataset.get();
  ISOSCOPE_RETURN_IF_ERROR(FindHdf5Files(dataset, name).status());
  ISOSCOPE_RETURN_IF_ERROR(Named(name, Hdf5SampleTypeOf(dataset).status()));
  std::vector<std::string> texts{
      absl::StrCat("name=", name),
      absl::StrCat("axes=", AxisLetters(found.layout.order, found.dims.size())),
      absl::StrCat("dims=", absl::StrJoin(found.dims, " ")),
      absl::StrCat("unit=", Hdf5Text(dataset, {"units", "unit"})),
      absl::StrCat("long_name=", Hdf5Text(dataset, {"long_name"}))};
  if (found.layout.order.t.has_value()) {
    ISOSCOPE_RETURN_IF_ERROR(AddTimes(found, &texts));
  }
  // Whoever opens a volume gets the error.
  if (const auto grid =
          Hdf5GridOf(found.named, found.axes, found.layout.roles, true, {.has_spacing = true});
      grid.ok()) {
    texts.push_back(absl::StrCat("length_unit=", grid->length_unit));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!grid->distances[axis].empty()) {
        texts.push_back(absl::StrCat("distances_", std::string(1, "xyz"[axis]), "=",
                                     JoinedHdf5Numbers(grid->distances[axis])));
      }
    }
  }
  return texts;
}

// The dataset that the first three words of a part mean.
absl::StatusOr<FoundDataset> FindPart(const std::string& path,
                                      const std::vector<std::string>& words, std::int64_t* step,
                                      std::int64_t* component) {
  ISOSCOPE_CHECK(words.size() >= 5 && absl::SimpleAtoi(words[1], step) &&
                 absl::SimpleAtoi(words[2], component));
  const std::string letters = words[0] == kAsFileSays ? "" : words[0];
  ISOSCOPE_ASSIGN_OR_RETURN(FoundDataset found, FindDataset(path, letters));
  const std::string name = found.named.parts.name();
  const AxisOrder& order = found.layout.order;
  if ((order.t.has_value() && *step >= found.dims[*order.t]) ||
      (order.c.has_value() && *component >= found.dims[*order.c])) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: no step %d and component %d in %s elements: it has changed", name,
                        *step, *component, absl::StrJoin(found.dims, " x ")));
  }
  return found;
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenPart(const std::string& path,
                                                       const std::string& part) {
  const std::vector<std::string> words = absl::StrSplit(part, ' ');
  std::int64_t step = 0;
  std::int64_t component = 0;
  ISOSCOPE_ASSIGN_OR_RETURN(FoundDataset found, FindPart(path, words, &step, &component));
  const std::string name = found.named.parts.name();
  const AxisOrder order = found.layout.order;
  auto type = Hdf5SampleTypeOf(found.named.dataset.get());
  ISOSCOPE_RETURN_IF_ERROR(Named(name, type.status()));
  const auto grid = Hdf5GridOf(found.named, found.axes, found.layout.roles, words[3] == kUnevenGrid,
                               GivenRules(words[4]));
  ISOSCOPE_RETURN_IF_ERROR(Named(name, grid.status()));
  return OpenHdf5Volume(std::move(found.named), *std::move(type), order, step, component,
                        grid->geometry);
}

// The chunks of a part, from the number on that is its last word.
absl::StatusOr<std::vector<std::string>> DescribeChunks(const std::string& path,
                                                        const std::string& part) {
  const std::vector<std::string> words = absl::StrSplit(part, ' ');
  std::int64_t step = 0;
  std::int64_t component = 0;
  std::int64_t first = 0;
  ISOSCOPE_CHECK(words.size() == 6 && absl::SimpleAtoi(words[5], &first));
  ISOSCOPE_ASSIGN_OR_RETURN(const FoundDataset found, FindPart(path, words, &step, &component));
  const auto type = Hdf5SampleTypeOf(found.named.dataset.get());
  ISOSCOPE_RETURN_IF_ERROR(Named(found.named.parts.name(), type.status()));
  return ListHdf5Chunks(found.named, *type, found.layout.order, step, component, first);
}

// ---- The parent. --------------------------------------------------------------------------------

constexpr WalledLibrary kHdf5Parts = {
    .name = "HDF5", .open = OpenPart, .find_files = nullptr, .describe = Describe};
constexpr WalledLibrary kHdf5Chunks = {
    .name = "HDF5", .open = OpenPart, .find_files = nullptr, .describe = DescribeChunks};

struct Hdf5Description {
  std::string name;  // with the dataset's name
  SeriesInfo info;   // but the names of series and field
  AxisDistances distances;
};

bool ParseHdf5Numbers(const std::string& text, std::vector<double>* numbers) {
  for (const absl::string_view word : absl::StrSplit(text, ' ', absl::SkipEmpty())) {
    if (!absl::SimpleAtod(word, &numbers->emplace_back())) {
      return false;
    }
  }
  return true;
}

// False if the texts make no sense.
bool ParseDescription(const std::vector<std::string>& texts, Hdf5Description* description) {
  std::map<std::string, std::string> values;
  for (const std::string& text : texts) {
    const std::pair<std::string, std::string> pair = absl::StrSplit(text, absl::MaxSplits('=', 1));
    values.insert(pair);
  }
  description->name = values["name"];
  const std::string& letters = values["axes"];
  const auto order = ParseAxisOrder(letters);
  if (!order.ok()) {
    return false;
  }
  std::vector<std::int64_t> dims;
  for (const absl::string_view word : absl::StrSplit(values["dims"], ' ', absl::SkipEmpty())) {
    if (!absl::SimpleAtoi(word, &dims.emplace_back()) || dims.back() < 1) {
      return false;
    }
  }
  if (dims.size() != letters.size()) {
    return false;
  }
  std::vector<double>& times = description->info.times;
  AxisDistances& distances = description->distances;
  const bool are_numbers = ParseHdf5Numbers(values["times"], &times) &&
                           ParseHdf5Numbers(values["distances_x"], &distances[0]) &&
                           ParseHdf5Numbers(values["distances_y"], &distances[1]) &&
                           ParseHdf5Numbers(values["distances_z"], &distances[2]);
  for (std::size_t i = 0; i < times.size(); ++i) {
    if (!std::isfinite(times[i]) || (i > 0 && !(times[i] > times[i - 1]))) {
      return false;
    }
  }
  const std::int64_t steps = order->t.has_value() ? dims[*order->t] : 1;
  const auto time_count = static_cast<std::int64_t>(times.size());
  if (!are_numbers || steps > kMaxHdf5Steps || (time_count != 0 && time_count != steps)) {
    return false;
  }
  for (std::int64_t i = 0; time_count == 0 && steps > 1 && i < steps; ++i) {
    times.push_back(static_cast<double>(i));
  }
  description->info.fields = {
      {.name = "",
       .long_name = values["long_name"],
       .unit = values["unit"],
       .components = ComponentNames(order->c.has_value() ? dims[*order->c] : 1)}};
  description->info.time_unit = values["time_unit"];
  description->info.length_unit = values["length_unit"];
  return true;
}

class Hdf5Series final : public VolumeSeries {
 public:
  // `letters`: those of --axes.
  Hdf5Series(const std::string& letters, const GridRules& rules, Hdf5Description description)
      : VolumeSeries(std::move(description.info)),
        dataset_(std::move(description.name)),
        distances_(std::move(description.distances)),
        letters_(letters.empty() ? std::string(kAsFileSays) : letters),
        rules_(rules) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_CHECK(field == 0);
    const std::string part =
        absl::StrCat(letters_, " ", step, " ", component, " ",
                     rules_.resamples ? kUnevenGrid : kEvenGrid, " ", GivenWord(rules_));
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> volume,
                              OpenWalled(kHdf5Parts, dataset_, part));
    return rules_.resamples ? ResampleSource(std::move(volume), distances_, rules_.fill)
                            : WithHdf5Boxes(std::move(volume), kHdf5Chunks, dataset_, part);
  }

 private:
  const std::string dataset_;  // with its file
  const AxisDistances distances_;
  const std::string letters_;
  const GridRules rules_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenHdf5Series(const std::string& path,
                                                             const std::string& axes,
                                                             const GridRules& rules) {
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
  description.info.name = path;
  description.info.fields.front().name = dataset.empty() ? "volume" : dataset;
  return std::make_unique<Hdf5Series>(axes, rules, std::move(description));
}

}  // namespace isoscope::source
