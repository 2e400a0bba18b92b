// A path is a group or an array:
//
//   an array   a level of an image, if a group above it has an image of OME-Zarr with that level;
//              else a field of its group
//   a group    the finest level of its image; else the arrays of it that are volumes; else the only
//              one below it
//
// Of a group without an image the grid is that of the array that was asked for; otherwise that of
// the most arrays, the first of those, and among arrays with and without time one of those with it.

#include "core/formats/zarr/zarr_volumes.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"

#include "core/base/printable.h"
#include "core/base/shell_word.h"
#include "core/base/status_macros.h"
#include "core/formats/zarr/cf_arrays.h"
#include "core/formats/zarr/ome_image.h"
#include "core/source/bytes/object_key.h"
#include "core/source/grid/axis_order.h"
#include "core/source/grid/cf_grid.h"
#include "core/source/series_parts.h"
#include "core/source/series_selection.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxZarrSteps = 100'000;
constexpr std::int64_t kMaxZarrComponents = 4096;
constexpr std::size_t kMaxSearchedNodes = 2000;
constexpr std::size_t kMaxShownPaths = 20;
constexpr char kOmeLabels[] = "labels";

std::string ParentOf(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return slash == std::string::npos ? "" : path.substr(0, slash);
}
std::string LastNameOf(const std::string& path) { return path.substr(path.rfind('/') + 1); }
std::string Joined(const std::string& group, const std::string& path) {
  return group.empty() ? path : absl::StrCat(group, "/", path);
}

// "scan" of "/d/scan.ome.zarr" and "/d/scan.zarr.zip".
std::string StoreFieldName(const std::string& store_name) {
  std::string name = LastPartOfPath(store_name);
  for (const absl::string_view ending : {".zip", ".ozx", ".zarr", ".ome"}) {
    if (name.size() > ending.size() && absl::EndsWithIgnoreCase(name, ending)) {
      name.resize(name.size() - ending.size());
    }
  }
  return name.empty() ? "zarr" : name;
}

absl::Status InZarr(const std::string& name, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat(name, ": ", status.message()));
}

absl::StatusOr<std::int64_t> CheckedCount(const ZarrStore& store, const std::string& path,
                                          std::int64_t count, std::int64_t most,
                                          absl::string_view what) {
  return count >= 1 && count <= most
             ? absl::StatusOr<std::int64_t>(count)
             : absl::InvalidArgumentError(absl::StrFormat("%s: %d %s; expected 1 to %d",
                                                          store.NameOf(path), count, what, most));
}

// ---- OME-Zarr. ----------------------------------------------------------------------------------

// Names of fields: the labels of channels if each has one of its own.
std::vector<std::string> ChannelNames(const OmeImage& image, std::int64_t count,
                                      const std::string& only) {
  std::vector<std::string> names;
  std::set<std::string> unique;
  for (std::int64_t i = 0; i < count; ++i) {
    const auto place = static_cast<std::size_t>(i);
    const std::string label = place < image.channels.size() ? image.channels[place] : "";
    names.push_back(std::string(absl::StripAsciiWhitespace(label)));
    unique.insert(names.back());
  }
  if (unique.size() == names.size() && !unique.contains("")) {
    return names;
  }
  for (std::int64_t i = 0; i < count; ++i) {
    names[static_cast<std::size_t>(i)] = count == 1 ? only : absl::StrCat("channel ", i);
  }
  return names;
}

absl::Status TakeOmeTimes(const ZarrStore& store, const OmeImage& image, const OmeLevel& level,
                          std::size_t axis, const ZarrArray& array, SeriesInfo* info) {
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::int64_t steps,
      CheckedCount(store, array.path, array.dims[axis], kMaxZarrSteps, "steps of time"));
  if (steps == 1) {
    return absl::OkStatus();
  }
  const double scale = level.scale[axis];
  const double first = level.translation[axis];
  if (!std::isfinite(first) || !std::isfinite(scale) || scale <= 0 ||
      !std::isfinite(first + scale * static_cast<double>(steps))) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: OME-Zarr: the scale of axis t is %g; expected a finite number above 0: correct it",
        store.NameOf(array.path), scale));
  }
  for (std::int64_t i = 0; i < steps; ++i) {
    info->times.push_back(first + scale * static_cast<double>(i));
    if (i > 0 && !(info->times.back() > info->times[info->times.size() - 2])) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: OME-Zarr: the steps of axis t, %g, vanish beside its start, %g",
                          store.NameOf(array.path), scale, first));
    }
  }
  info->time_unit = image.axes[axis].unit;
  return absl::OkStatus();
}

// The paths of the other levels, of the other images and of label images.
absl::StatusOr<std::vector<std::string>> OmeElsewhere(ZarrStore* store, const std::string& group,
                                                      const std::vector<OmeImage>& images,
                                                      const std::string& chosen) {
  std::vector<std::string> paths;
  for (const OmeImage& image : images) {
    for (const OmeLevel& level : image.levels) {
      std::string path = Joined(group, level.path);
      if (path != chosen && std::find(paths.begin(), paths.end(), path) == paths.end()) {
        paths.push_back(std::move(path));
      }
    }
  }
  const std::string labels = Joined(group, kOmeLabels);
  const auto node = store->Node(labels);
  if (node.ok()) {
    for (const std::string& name : OmeLabelsIn(node->attributes)) {
      paths.push_back(Joined(labels, name));
    }
  } else if (!absl::IsNotFound(node.status())) {
    return node.status();
  }
  return paths;
}

// `image`: which of the group's images.
absl::StatusOr<ZarrVolumes> OmeVolumes(ZarrStore* store, const std::string& group,
                                       const std::vector<OmeImage>& images,
                                       std::size_t image_number, std::size_t level,
                                       const GridRules& rules) {
  const OmeImage& image = images[image_number];
  const OmeLevel& chosen = image.levels[level];
  const std::string path = Joined(group, chosen.path);
  store->Expect({path, Joined(group, image.levels[0].path), Joined(group, kOmeLabels)});
  ISOSCOPE_ASSIGN_OR_RETURN(const ZarrNode node, store->Node(path));
  if (!node.is_array) {
    return absl::InvalidArgumentError(
        absl::StrCat(store->NameOf(path), ": a group; expected the array of a level"));
  }
  ISOSCOPE_RETURN_IF_ERROR(node.array.status());
  const ZarrArray& array = *node.array;
  const auto space = OmeSpaceOf(image.axes);
  if (array.dims.size() != image.axes.size() || !space.has_value()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: OME-Zarr: its axes are %s, and its array has the sizes %s; expected z, y and x",
        store->NameOf(path), DescribeOmeAxes(image.axes), DescribeIndex(array.dims)));
  }
  ZarrVolumes volumes{.info = {.name = store->name()}};
  // 1. The grid.
  auto grid = OmeGridOf(image, level, array.dims, rules);
  if (grid.ok()) {
    volumes.geometry = grid->geometry;
    volumes.info.length_unit = grid->unit;
  } else {
    volumes.geometry = InZarr(store->NameOf(path), grid.status());
  }
  // 2. Channels and times.
  std::optional<std::size_t> time;
  std::optional<std::size_t> channel;
  for (std::size_t axis = 0; axis < image.axes.size(); ++axis) {
    time = image.axes[axis].letter == 'T' ? axis : time;
    channel = image.axes[axis].letter == 'C' ? axis : channel;
  }
  if (time.has_value()) {
    ISOSCOPE_RETURN_IF_ERROR(TakeOmeTimes(*store, image, chosen, *time, array, &volumes.info));
  }
  std::int64_t channels = 1;
  if (channel.has_value()) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        channels, CheckedCount(*store, path, array.dims[*channel], kMaxZarrComponents, "channels"));
  }
  const std::vector<std::string> names =
      ChannelNames(image, channels, StoreFieldName(group.empty() ? store->name() : group));
  for (std::int64_t i = 0; i < channels; ++i) {
    ZarrField field{.field = {.name = names[static_cast<std::size_t>(i)]},
                    .array = array,
                    .part = {.space = *space, .index = ChunkIndex(array.dims.size(), 0)},
                    .time = time};
    if (channel.has_value()) {
      field.part.index[*channel] = i;
    }
    volumes.info.fields.push_back(field.field);
    volumes.fields.push_back(std::move(field));
  }
  // 3. What else there is.
  ISOSCOPE_ASSIGN_OR_RETURN(volumes.info.fields_elsewhere,
                            OmeElsewhere(store, group, images, path));
  volumes.arrays = {path};
  if (level > 0) {
    ISOSCOPE_ASSIGN_OR_RETURN(const ZarrNode finest,
                              store->Node(Joined(group, image.levels[0].path)));
    if (finest.array.ok() && finest.array->dims.size() == array.dims.size()) {
      volumes.note = OmeLevelNote(image, level, finest.array->dims, array.dims);
    }
  }
  return volumes;
}

// The image above an array that has it as a level.
struct OmeLevelOf {
  std::string group{};
  std::vector<OmeImage> images{};
  std::size_t image = 0;
  std::size_t level = 0;
};
absl::StatusOr<std::optional<OmeLevelOf>> FindOmeLevel(ZarrStore* store, const std::string& path) {
  std::string group = path;
  while (!group.empty()) {
    group = ParentOf(group);
    const auto node = store->Node(group);
    if (!node.ok()) {
      continue;  // between the levels of its path there need be no groups
    }
    ISOSCOPE_ASSIGN_OR_RETURN(OmeImages found, OmeImagesIn(node->attributes, store->NameOf(group)));
    for (std::size_t i = 0; i < found.images.size(); ++i) {
      const std::vector<OmeLevel>& levels = found.images[i].levels;
      for (std::size_t k = 0; k < levels.size(); ++k) {
        if (Joined(group, levels[k].path) == path) {
          return OmeLevelOf{
              .group = group, .images = std::move(found.images), .image = i, .level = k};
        }
      }
    }
    // It may be a level of the image that can't be read.
    ISOSCOPE_RETURN_IF_ERROR(found.others);
  }
  return std::nullopt;
}

// ---- Arrays by the CF conventions, or without any. ----------------------------------------------

absl::StatusOr<CfRoles> ZarrRolesOf(const CfArray& described, const std::string& letters) {
  if (!letters.empty()) {
    return CfRolesFrom(letters, described.axes);
  }
  const std::optional<CfRoles> roles = CfRolesOf(described.axes);
  return roles.has_value() ? absl::StatusOr<CfRoles>(*roles) : absl::NotFoundError("");
}

absl::Status NoZarrVolume(const ZarrStore& store, const CfArray& described) {
  const std::string letters = SuggestCfAxes(described.axes);
  const std::string name = store.NameOf(described.array.path);
  return absl::InvalidArgumentError(absl::StrCat(
      name, ": its axes are ", DescribeCfAxes(described.axes),
      ", by the names of axes and CF's attributes; expected one Z, one Y and one X of 2 samples or "
      "more",
      letters.empty()
          ? ""
          : absl::StrCat(": if the file does not say it, you can, slowest first (T "
                         "time, C components, - an axis of 1 element), as in "
                         "`isoscope partition ",
                         base::ShellWord(name), " --axes ", letters, " --output DIR`")));
}

bool AreOnOneZarrGrid(const CfArray& a, const CfArray& b) {
  const auto are_alike = [&](std::size_t i, std::size_t k) {
    return a.axes[i].name == b.axes[k].name && a.axes[i].size == b.axes[k].size &&
           a.axes[i].fault == b.axes[k].fault;
  };
  for (std::size_t i = 0; i < 3; ++i) {
    if (!are_alike(a.roles.space[i], b.roles.space[i]) ||
        a.roles.letters[i] != b.roles.letters[i]) {
      return false;
    }
  }
  return a.roles.time.has_value() == b.roles.time.has_value() &&
         (!a.roles.time.has_value() || are_alike(*a.roles.time, *b.roles.time));
}

const CfArray& ChooseZarrGrid(const std::vector<CfArray>& volumes, const std::string& wanted) {
  const CfArray* chosen = nullptr;
  std::pair<bool, std::ptrdiff_t> best{};
  for (const CfArray& candidate : volumes) {
    if (candidate.array.path == wanted) {
      return candidate;
    }
    const std::ptrdiff_t alike =
        std::count_if(volumes.begin(), volumes.end(),
                      [&](const CfArray& other) { return AreOnOneZarrGrid(candidate, other); });
    const std::pair<bool, std::ptrdiff_t> rank{candidate.roles.time.has_value(), alike};
    if (chosen == nullptr || rank > best) {
      chosen = &candidate;
      best = rank;
    }
  }
  return *chosen;
}

// Components of an ensemble are numbers, those of vectors have their names.
std::vector<std::string> ZarrComponents(const CfArray& volume, std::int64_t count) {
  std::vector<std::string> names = ComponentNames(count);
  const bool is_vector = !volume.roles.component.has_value() ||
                         AxisLetterOf(volume.axes[*volume.roles.component].name) == 'C';
  for (std::int64_t i = 0; !is_vector && count > 1 && i < count; ++i) {
    names[static_cast<std::size_t>(i)] = absl::StrCat(i);
  }
  return names;
}

absl::Status TakeCfTimes(const ZarrStore& store, const CfArray& chosen, SeriesInfo* info) {
  const CfAxis& time = chosen.axes[*chosen.roles.time];
  ISOSCOPE_RETURN_IF_ERROR(
      CheckedCount(store, chosen.array.path, time.size, kMaxZarrSteps, "steps of time").status());
  if (!time.fault.empty() && time.size > 1) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: axis \"%s\": %s",
                                                      store.NameOf(chosen.array.path),
                                                      base::Printable(time.name), time.fault));
  }
  auto times = CfTimesOf(time);
  if (!times.ok()) {
    return InZarr(store.NameOf(chosen.array.path), times.status());
  }
  info->times = *std::move(times);
  info->time_unit = time.units;
  return absl::OkStatus();
}

void TakeCfGrid(const ZarrStore& store, const CfArray& chosen, const GridRules& rules,
                ZarrVolumes* volumes) {
  absl::Status status;
  if (rules.resamples) {
    auto grid = CfUnevenGridOf(chosen.axes, chosen.roles, rules);
    if (grid.ok()) {
      volumes->geometry = grid->geometry;
      volumes->distances = std::move(grid->distances);
    }
    status = grid.status();
  } else {
    volumes->geometry = CfGridOf(chosen.axes, chosen.roles, rules);
    status = volumes->geometry.status();
  }
  if (status.ok()) {
    status = volume::Validate(*volumes->geometry);
  }
  if (!status.ok()) {
    volumes->geometry = InZarr(store.NameOf(chosen.array.path), status);
  }
}

ZarrField CfField(const ZarrStore& store, const CfArray& volume, std::int64_t components) {
  const ZarrArray& array = volume.array;
  std::string long_name = TextOf(array.attributes, "long_name");
  long_name = long_name.empty() ? TextOf(array.attributes, "standard_name") : long_name;
  ZarrField field{
      .field = {.name = array.path.empty() ? StoreFieldName(store.name()) : LastNameOf(array.path),
                .long_name = std::move(long_name),
                .unit = TextOf(array.attributes, "units"),
                .components = ZarrComponents(volume, components)},
      .array = array,
      .part = {.space = volume.roles.space, .index = ChunkIndex(array.dims.size(), 0)},
      .time = volume.roles.time,
      .component = volume.roles.component,
      .packing = ZarrPackingOf(array)};
  if (!field.packing.ok()) {
    field.packing = InZarr(store.NameOf(array.path), field.packing.status());
  }
  return field;
}

// `volumes` have their roles. REQUIRES: at least one.
absl::StatusOr<ZarrVolumes> CfVolumes(ZarrStore* store, const std::vector<CfArray>& found,
                                      const std::string& wanted, const GridRules& rules) {
  const CfArray& chosen = ChooseZarrGrid(found, wanted);
  ZarrVolumes volumes{
      .info = {.name = store->name(), .length_unit = CfLengthUnit(chosen.axes, chosen.roles)}};
  TakeCfGrid(*store, chosen, rules, &volumes);
  if (chosen.roles.time.has_value()) {
    ISOSCOPE_RETURN_IF_ERROR(TakeCfTimes(*store, chosen, &volumes.info));
  }
  volumes.arrays = chosen.coordinates;
  for (const CfArray& volume : found) {
    if (!AreOnOneZarrGrid(chosen, volume)) {
      volumes.info.fields_elsewhere.push_back(volume.array.path);
      continue;
    }
    const std::int64_t components =
        volume.roles.component.has_value() ? volume.axes[*volume.roles.component].size : 1;
    if (components < 1 || components > kMaxZarrComponents) {
      continue;
    }
    volumes.fields.push_back(CfField(*store, volume, components));
    volumes.info.fields.push_back(volumes.fields.back().field);
    volumes.arrays.push_back(volume.array.path);
  }
  if (wanted.empty()) {
    volumes.left_out = OtherGridsNote(volumes.info);
  }
  if (volumes.fields.empty()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: more than %d components", store->NameOf(wanted), kMaxZarrComponents));
  }
  return volumes;
}

// ---- Paths. -------------------------------------------------------------------------------------

// Arrays of three axes or more, in the group and in those below it.
absl::StatusOr<std::vector<std::string>> ArraysBelow(ZarrStore* store, const std::string& group) {
  std::vector<std::string> found;
  std::vector<std::string> groups = {group};
  std::size_t searched = 0;
  for (std::size_t i = 0; i < groups.size() && searched < kMaxSearchedNodes; ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> children, store->Children(groups[i]));
    for (const std::string& child : children) {
      if (++searched > kMaxSearchedNodes) {
        break;
      }
      const auto node = store->Node(child);
      if (!node.ok()) {
        continue;
      }
      if (!node->is_array) {
        groups.push_back(child);
        if (MemberOf(node->attributes, "multiscales") != nullptr ||
            MemberOf(node->attributes, "ome") != nullptr) {
          const auto image = OmeImageIn(node->attributes, store->NameOf(child));
          if (image.ok() && image->has_value()) {
            found.push_back(child);
            groups.pop_back();
          }
        }
      } else if (node->array.ok() && node->array->dims.size() >= 3 &&
                 !node->array->time.has_value()) {
        found.push_back(child);
      }
    }
  }
  return found;
}

absl::StatusOr<ZarrVolumes> VolumesBelow(ZarrStore* store, const ZarrChoice& choice) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<std::string> below, ArraysBelow(store, choice.path));
  if (below.size() == 1) {
    return FindZarrVolumes(store, {.path = below[0], .axes = choice.axes, .rules = choice.rules});
  }
  if (below.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        store->NameOf(choice.path),
        ": a group of Zarr without an array of three axes or more, or its place can't be listed; "
        "give an array: ",
        store->name(), ":PATH"));
  }
  const std::size_t count = below.size();
  below.resize(std::min(count, kMaxShownPaths));
  for (std::string& path : below) {
    path = base::Printable(path);
  }
  return absl::InvalidArgumentError(absl::StrCat(
      store->NameOf(choice.path), ": ", count,
      " volumes in groups below it: ", absl::StrJoin(below, ", "),
      count > below.size() ? ", ..." : "", "; give one of them: ", store->name(), ":", below[0]));
}

// The arrays of a group that are volumes. `wanted`: the one that was asked for; "" for none.
absl::StatusOr<ZarrVolumes> VolumesOfGroup(ZarrStore* store, const std::string& group,
                                           const std::string& wanted, const ZarrChoice& choice) {
  std::vector<std::string> paths;
  if (wanted.empty() || choice.axes.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(paths, store->Children(group));
  }
  if (!wanted.empty() && std::find(paths.begin(), paths.end(), wanted) == paths.end()) {
    paths.push_back(wanted);
  }
  std::vector<CfArray> volumes;
  std::optional<CfArray> example;
  absl::Status unread;
  for (const std::string& path : paths) {
    const auto node = store->Node(path);
    if (!node.ok() || !node->is_array) {
      continue;
    }
    if (!node->array.ok() || node->array->dims.size() < 3 || node->array->time.has_value()) {
      unread = unread.ok() ? node->array.status() : unread;
      continue;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(CfArray described, DescribeCfArray(store, group, *node->array));
    const auto roles = ZarrRolesOf(described, choice.axes);
    if (roles.ok()) {
      described.roles = *roles;
      volumes.push_back(std::move(described));
    } else if (path == wanted) {
      return choice.axes.empty() ? NoZarrVolume(*store, described)
                                 : InZarr(store->NameOf(path), roles.status());
    } else if (!example.has_value()) {
      example = std::move(described);
    }
  }
  if (!volumes.empty()) {
    return CfVolumes(store, volumes, wanted, choice.rules);
  }
  if (example.has_value()) {
    return choice.axes.empty()
               ? NoZarrVolume(*store, *example)
               : absl::InvalidArgumentError(absl::StrFormat(
                     "%s: --axes %s: no array has such axes; \"%s\" has %s", store->NameOf(group),
                     choice.axes, base::Printable(example->array.path),
                     DescribeCfAxes(example->axes)));
  }
  if (!unread.ok()) {
    return unread;
  }
  return VolumesBelow(store, choice);
}

absl::StatusOr<ZarrVolumes> VolumeOfArray(ZarrStore* store, const ZarrNode& node,
                                          const ZarrChoice& choice) {
  ISOSCOPE_RETURN_IF_ERROR(node.array.status());
  if (choice.axes.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<OmeLevelOf> level,
                              FindOmeLevel(store, node.path));
    if (level.has_value()) {
      return OmeVolumes(store, level->group, level->images, level->image, level->level,
                        choice.rules);
    }
  }
  if (node.array->time.has_value()) {
    return absl::InvalidArgumentError(
        absl::StrCat(store->NameOf(node.path), ": an array of times; expected one of numbers"));
  }
  if (node.array->dims.size() < 3) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: an array of %d axes; expected 3 or more",
                                                      store->NameOf(node.path),
                                                      node.array->dims.size()));
  }
  if (node.path.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(CfArray described, DescribeCfArray(store, "", *node.array));
    const auto roles = ZarrRolesOf(described, choice.axes);
    if (!roles.ok()) {
      return choice.axes.empty() ? NoZarrVolume(*store, described)
                                 : InZarr(store->NameOf(""), roles.status());
    }
    described.roles = *roles;
    return CfVolumes(store, {std::move(described)}, "", choice.rules);
  }
  return VolumesOfGroup(store, ParentOf(node.path), node.path, choice);
}

}  // namespace

absl::StatusOr<std::vector<volume::Label>> FindZarrLabels(ZarrStore* store,
                                                          const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(ZarrNode node, store->Node(path));
  if (node.is_array) {  // a level of a label image
    ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<OmeLevelOf> level, FindOmeLevel(store, path));
    if (!level.has_value()) {
      return std::vector<volume::Label>();
    }
    ISOSCOPE_ASSIGN_OR_RETURN(node, store->Node(level->group));
  }
  auto labels = OmeLabelTableIn(node.attributes);
  return labels.ok() ? std::move(labels) : InZarr(store->NameOf(node.path), labels.status());
}

absl::StatusOr<ZarrVolumes> FindZarrVolumes(ZarrStore* store, const ZarrChoice& choice) {
  ISOSCOPE_ASSIGN_OR_RETURN(const ZarrNode node, store->Node(choice.path));
  if (node.is_array) {
    return VolumeOfArray(store, node, choice);
  }
  const std::string name = store->NameOf(choice.path);
  if (choice.axes.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(const OmeImages found, OmeImagesIn(node.attributes, name));
    if (!found.images.empty()) {
      return OmeVolumes(store, choice.path, found.images, 0, 0, choice.rules);
    }
    if (const std::string what = OmeCollectionIn(node.attributes); !what.empty()) {
      return absl::InvalidArgumentError(absl::StrCat(name, ": ", what, " behind a colon"));
    }
    // A collection of images, numbered from 0; most have one.
    if (MemberOf(node.attributes, "bioformats2raw.layout") != nullptr ||
        (MemberOf(node.attributes, "ome") != nullptr &&
         MemberOf(node.attributes["ome"], "bioformats2raw.layout") != nullptr)) {
      const std::string first = Joined(choice.path, "0");
      store->Expect({first, Joined(choice.path, "1")});
      if (store->Node(first).ok()) {
        ISOSCOPE_ASSIGN_OR_RETURN(
            ZarrVolumes volumes,
            FindZarrVolumes(store, {.path = first, .axes = "", .rules = choice.rules}));
        for (int i = 1; i < static_cast<int>(kMaxShownPaths); ++i) {
          const std::string other = Joined(choice.path, absl::StrCat(i));
          if (!store->Node(other).ok()) {
            break;
          }
          volumes.info.fields_elsewhere.push_back(other);
        }
        return volumes;
      }
    }
  }
  return VolumesOfGroup(store, choice.path, "", choice);
}

}  // namespace isoscope::source
