#include "core/formats/zarr/zarr_series.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <iterator>
#include <map>
#include <system_error>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/formats/zarr/zarr_source.h"
#include "core/formats/zarr/zarr_volumes.h"
#include "core/io/file.h"
#include "core/source/adapt/resampled_source.h"
#include "core/source/bytes/local_bytes.h"
#include "core/source/bytes/zip_store.h"
#include "core/source/chunks/stored_array.h"
#include "core/source/series_parts.h"
#include "core/volume/field_name.h"

namespace isoscope::source {
namespace {

namespace fs = std::filesystem;

constexpr const char* kZarrFiles[] = {"zarr.json", ".zarray", ".zgroup", ".zmetadata", ".zattrs"};
constexpr std::size_t kMaxZarrFiles = std::size_t{16} << 20;
constexpr int kMaxFoldersAbove = 16;

// A node, and the field or component of it.
struct ZarrTarget {
  std::string path{};
  std::string field{};
};
absl::StatusOr<ZarrTarget> TargetOf(ZarrStore* store, const std::string& part) {
  if (part.empty()) {
    return ZarrTarget{};
  }
  // The longest path in front of a colon, or without any.
  std::string path = part;
  absl::Status first_error;
  while (true) {
    while (!path.empty() && path.back() == '/') {
      path.pop_back();
    }
    const auto node = path.empty() ? absl::NotFoundError("") : store->Node(path);
    if (node.ok()) {
      return ZarrTarget{.path = path,
                        .field = path.size() < part.size() && part[path.size()] == ':'
                                     ? part.substr(path.size() + 1)
                                     : ""};
    }
    if (!absl::IsNotFound(node.status()) && !absl::IsInvalidArgument(node.status())) {
      return node.status();
    }
    first_error = first_error.ok() ? node.status() : first_error;
    const std::size_t colon = path.rfind(':');
    if (colon == std::string::npos) {
      break;
    }
    path.resize(colon);
  }
  // A field of the root; a path with '/' can be none.
  return part.find('/') == std::string::npos
             ? absl::StatusOr<ZarrTarget>(ZarrTarget{.path = "", .field = part})
             : first_error;
}

struct ZarrOpened {
  ZarrVolumes volumes{};
  std::string part{};  // of their fields; "": all
};
// Arrays of other fields than the part's decide nothing of it: not that they have changed, and there
// may be very many files of them.
void LeaveOutOtherFields(ZarrOpened* opened) {
  const std::vector<ZarrField>& fields = opened->volumes.fields;
  const auto name = volume::FindFieldName(
      opened->part, [&](absl::string_view text) -> std::optional<std::size_t> {
        for (std::size_t i = 0; i < fields.size(); ++i) {
          if (fields[i].field.name == text) {
            return i;
          }
        }
        return std::nullopt;
      });
  if (!name.has_value()) {
    return;
  }
  const std::string& wanted = fields[name->field].array.path;
  std::vector<std::string>& arrays = opened->volumes.arrays;
  arrays.erase(std::remove_if(arrays.begin(), arrays.end(),
                              [&](const std::string& array) {
                                return array != wanted &&
                                       std::any_of(fields.begin(), fields.end(),
                                                   [&](const ZarrField& field) {
                                                     return field.array.path == array;
                                                   });
                              }),
               arrays.end());
}

absl::StatusOr<ZarrOpened> FindPart(ZarrStore* store, const std::string& part,
                                    const std::string& axes, const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(ZarrTarget target, TargetOf(store, part));
  ZarrOpened opened;
  ISOSCOPE_ASSIGN_OR_RETURN(
      opened.volumes, FindZarrVolumes(store, {.path = target.path, .axes = axes, .rules = rules}));
  opened.part = std::move(target.field);
  // An array that shares its group with others is one field of them.
  if (!target.path.empty() && opened.volumes.fields.size() > 1) {
    for (const ZarrField& field : opened.volumes.fields) {
      const bool is_only = std::count_if(opened.volumes.fields.begin(), opened.volumes.fields.end(),
                                         [&](const ZarrField& other) {
                                           return other.array.path == field.array.path;
                                         }) == 1;
      if (field.array.path == target.path && is_only) {
        opened.part = opened.part.empty() ? field.field.name
                                          : absl::StrCat(field.field.name, ":", opened.part);
      }
    }
  }
  if (!target.path.empty() && opened.volumes.fields.size() == 1 && !opened.part.empty() &&
      opened.part != opened.volumes.fields[0].field.name) {
    opened.part = absl::StrCat(opened.volumes.fields[0].field.name, ":", opened.part);
  }
  LeaveOutOtherFields(&opened);
  if (opened.part.empty() && !opened.volumes.left_out.empty()) {
    absl::StrAppend(&opened.volumes.note, opened.volumes.note.empty() ? "" : "; ",
                    opened.volumes.left_out);
  }
  return opened;
}

absl::StatusOr<std::vector<std::string>> ListFolder(const std::string& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    const std::string name = entry->path().filename().string();
    // Chunks of Zarr 2 may be folders of numbers: no nodes, and many.
    if (entry->is_directory(ignored) && IsZarrFolder(entry->path().string())) {
      names.push_back(name);
    }
  }
  return error && error != std::errc::no_such_file_or_directory
             ? absl::StatusOr<std::vector<std::string>>(
                   io::ErrnoToStatus(error.value(), "list", folder))
             : names;
}

absl::Status AddFilesBelow(const std::string& folder, std::vector<std::string>* files) {
  std::error_code error;
  const auto options = fs::directory_options::follow_directory_symlink;
  for (fs::recursive_directory_iterator entry(folder, options, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code ignored;
    if (entry.depth() > static_cast<int>(kMaxChunkAxes) + 2) {
      entry.disable_recursion_pending();
    }
    if (entry->is_regular_file(ignored)) {
      files->push_back(entry->path().string());
      if (files->size() > kMaxZarrFiles) {
        return absl::ResourceExhaustedError(absl::StrFormat(
            "%s: more than %d files; expected fewer: write it in shards (Zarr 3), or as a ZIP "
            "archive",
            folder, kMaxZarrFiles));
      }
    }
  }
  return error ? io::ErrnoToStatus(error.value(), "list", folder) : absl::OkStatus();
}

// Returns true if a folder of an archive has the metadata of a node.
bool HasZarrRoot(const ZipStore& store, const std::string& folder) {
  const std::vector<std::string> names = store.NamesBelow(folder);
  return std::any_of(std::begin(kZarrFiles), std::end(kZarrFiles) - 1, [&](const char* name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  });
}

// The files of a store's folder that decide samples and positions of its volumes.
struct ZarrFiles {
  std::vector<std::string> of_all{};  // whatever the step
  // Chunks of some steps alone, by how many there are in one, and which of these it is.
  std::map<std::pair<std::int64_t, std::int64_t>, std::vector<std::string>> by_layer{};
};

// The place of a chunk's file along an axis; not set if it is no chunk. `key`: below its array.
std::optional<std::int64_t> PlaceOfChunk(const ZarrArray& array, absl::string_view key,
                                         std::size_t axis) {
  std::vector<absl::string_view> numbers = absl::StrSplit(key, absl::ByAnyChar("/."));
  if (array.has_key_prefix && !numbers.empty() && numbers.front() == "c") {
    numbers.erase(numbers.begin());
  }
  if (numbers.size() != array.dims.size()) {
    return std::nullopt;
  }
  std::int64_t place = 0;
  for (std::size_t i = numbers.size(); i-- > 0;) {
    std::int64_t number = 0;
    if (!absl::SimpleAtoi(numbers[i], &number) || number < 0) {
      return std::nullopt;
    }
    place = i == axis ? number : place;
  }
  return place;
}

absl::StatusOr<ZarrFiles> ListZarrFiles(const std::string& file, const ZarrVolumes& volumes) {
  ZarrFiles files;
  const auto add_metadata = [&files](const std::string& folder) {
    for (const char* const name : kZarrFiles) {
      const std::string path = absl::StrCat(folder, "/", name);
      if (io::PathExists(path)) {
        files.of_all.push_back(path);
      }
    }
  };
  for (const std::string& array : volumes.arrays) {
    std::string folder = file;
    add_metadata(folder);
    for (const absl::string_view name : absl::StrSplit(array, '/', absl::SkipEmpty())) {
      absl::StrAppend(&folder, "/", name);
      add_metadata(folder);
    }
    const auto field = std::find_if(
        volumes.fields.begin(), volumes.fields.end(),
        [&](const ZarrField& f) { return f.array.path == array && f.time.has_value(); });
    std::vector<std::string> below;
    ISOSCOPE_RETURN_IF_ERROR(AddFilesBelow(folder, &below));
    for (std::string& path : below) {
      const std::optional<std::int64_t> place =
          field == volumes.fields.end()
              ? std::nullopt
              : PlaceOfChunk(field->array, absl::string_view(path).substr(folder.size() + 1),
                             *field->time);
      if (place.has_value()) {
        files.by_layer[{field->array.chunk_dims[*field->time], *place}].push_back(std::move(path));
      } else {
        files.of_all.push_back(std::move(path));
      }
    }
  }
  std::sort(files.of_all.begin(), files.of_all.end());
  files.of_all.erase(std::unique(files.of_all.begin(), files.of_all.end()), files.of_all.end());
  return files;
}

class ZarrSeries final : public VolumeSeries {
 public:
  ZarrSeries(std::unique_ptr<ZarrStore> store, ZarrVolumes volumes, const GridRules& rules)
      : VolumeSeries(volumes.info),
        store_(std::move(store)),
        volumes_(std::move(volumes)),
        rules_(rules) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    const ZarrField& wanted = volumes_.fields[static_cast<std::size_t>(field)];
    ISOSCOPE_RETURN_IF_ERROR(volumes_.geometry.status());
    ISOSCOPE_RETURN_IF_ERROR(wanted.packing.status());
    const std::string name = store_->NameOf(wanted.array.path);
    ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const ChunkedArray> array,
                              OpenStoredArray(store_->objects(), wanted.array.SpecOf(name)));
    ZarrPart part = wanted.part;
    if (wanted.time.has_value()) {
      part.index[*wanted.time] = step;
    }
    if (wanted.component.has_value()) {
      part.index[*wanted.component] = component;
    }
    std::unique_ptr<VolumeSource> volume =
        MakeZarrSource({.name = name, .geometry = *volumes_.geometry, .note = volumes_.note},
                       std::move(array), std::move(part), *wanted.packing);
    return rules_.resamples ? ResampleSource(std::move(volume), volumes_.distances, rules_.fill)
                            : absl::StatusOr<std::unique_ptr<VolumeSource>>(std::move(volume));
  }

  absl::StatusOr<std::optional<std::vector<std::string>>> FilesOfStep(int step) override {
    const bool has_times = std::any_of(volumes_.fields.begin(), volumes_.fields.end(),
                                       [](const ZarrField& f) { return f.time.has_value(); });
    if (!has_times || !io::IsDirectory(store_->name())) {
      return std::nullopt;
    }
    if (!files_.has_value()) {
      ISOSCOPE_ASSIGN_OR_RETURN(files_, ListZarrFiles(store_->name(), volumes_));
    }
    std::vector<std::string> files = files_->of_all;
    for (const auto& [layer, paths] : files_->by_layer) {
      const auto& [chunk_steps, number] = layer;
      if (number == step / chunk_steps) {
        files.insert(files.end(), paths.begin(), paths.end());
      }
    }
    std::sort(files.begin(), files.end());
    return std::optional(std::move(files));
  }

 private:
  const std::unique_ptr<ZarrStore> store_;
  const ZarrVolumes volumes_;
  const GridRules rules_;
  std::optional<ZarrFiles> files_;  // once a step was asked for
};

}  // namespace

bool IsZarrFolder(const std::string& folder) {
  // .zattrs alone makes no node.
  return std::any_of(std::begin(kZarrFiles), std::end(kZarrFiles) - 1, [&](const char* name) {
    return io::PathExists(absl::StrCat(folder, "/", name));
  });
}

std::optional<ZarrPath> FindZarrPath(const std::string& path) {
  // 1. The folder, in front of the first colon that has one.
  ZarrPath found{.file = path};
  for (std::size_t colon = path.find(':');
       !(io::IsDirectory(found.file) && IsZarrFolder(found.file)) && colon != std::string::npos;
       colon = path.find(':', colon + 1)) {
    found = {.file = path.substr(0, colon), .part = path.substr(colon + 1)};
  }
  if (!io::IsDirectory(found.file) || !IsZarrFolder(found.file)) {
    const std::size_t slash = path.rfind('/');
    const std::string name = slash == std::string::npos ? path : path.substr(slash + 1);
    const std::string folder = slash == std::string::npos ? "." : path.substr(0, slash);
    const bool is_metadata =
        std::find(std::begin(kZarrFiles), std::end(kZarrFiles), name) != std::end(kZarrFiles);
    if (!is_metadata || !io::IsDirectory(folder) || !IsZarrFolder(folder)) {
      return std::nullopt;
    }
    found = {.file = folder};
  }
  // 2. The groups around it.
  while (found.file.size() > 1 && found.file.back() == '/') {
    found.file.pop_back();
  }
  for (int i = 0; i < kMaxFoldersAbove; ++i) {
    const std::size_t slash = found.file.rfind('/');
    if (slash == std::string::npos || slash == 0) {
      break;
    }
    const std::string above = found.file.substr(0, slash);
    const std::string name = found.file.substr(slash + 1);
    if (name.empty() || name == "." || name == ".." || !IsZarrFolder(above)) {
      break;
    }
    if (!found.part.empty()) {
      // A node below it, or a field.
      const bool is_node =
          io::PathExists(absl::StrCat(found.file, "/", found.part.substr(0, found.part.find(':'))));
      found.part.insert(0, is_node ? "/" : ":");
    }
    found.part.insert(0, name);
    found.file = above;
  }
  return found;
}

bool IsZarrArchive(const std::string& file) {
  auto bytes = OpenFileBytes(file);
  const auto zip = bytes.ok() ? OpenZipStore(*std::move(bytes)) : bytes.status();
  if (!zip.ok()) {
    return false;
  }
  const std::vector<std::string> top = (*zip)->NamesBelow("");
  return HasZarrRoot(**zip, "") ||
         std::any_of(top.begin(), top.end(),
                     [&](const std::string& name) { return HasZarrRoot(**zip, name); });
}

absl::StatusOr<std::unique_ptr<ZarrStore>> OpenLocalZarr(const std::string& file) {
  if (!io::IsDirectory(file)) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const ByteSource> bytes, OpenFileBytes(file));
    return OpenZippedZarr(std::move(bytes));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const ObjectStore> objects, OpenFolderStore(file));
  return ZarrStore::Open(std::move(objects), [file](const std::string& path) {
    return ListFolder(path.empty() ? file : absl::StrCat(file, "/", path));
  });
}

absl::StatusOr<std::unique_ptr<ZarrStore>> OpenZippedZarr(std::shared_ptr<const ByteSource> bytes) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const ZipStore> zip, OpenZipStore(bytes));
  if (!HasZarrRoot(*zip, "")) {
    const std::vector<std::string> top = zip->NamesBelow("");
    const bool is_folder = top.size() == 1 && HasZarrRoot(*zip, top[0]);
    if (!is_folder) {
      return absl::InvalidArgumentError(
          absl::StrCat(bytes->name(),
                       ": a ZIP archive without a Zarr store: neither zarr.json nor .zgroup or "
                       ".zarray at its top: unpack it, and give a file of it"));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(zip, OpenZipStore(bytes, top[0]));
  }
  return ZarrStore::Open(zip, [zip](const std::string& path) {
    return absl::StatusOr<std::vector<std::string>>(zip->NamesBelow(path));
  });
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenZarrSeries(std::unique_ptr<ZarrStore> store,
                                                             const std::string& part,
                                                             const std::string& axes,
                                                             const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(ZarrOpened opened, FindPart(store.get(), part, axes, rules));
  const std::string name = store->name();
  auto series = std::make_unique<ZarrSeries>(std::move(store), std::move(opened.volumes), rules);
  return opened.part.empty() ? absl::StatusOr<std::unique_ptr<VolumeSeries>>(std::move(series))
                             : SelectPart(std::move(series), name, opened.part);
}

absl::StatusOr<std::vector<volume::Label>> ZarrLabelsOf(ZarrStore* store, const std::string& part) {
  ISOSCOPE_ASSIGN_OR_RETURN(const ZarrTarget target, TargetOf(store, part));
  return FindZarrLabels(store, target.path);
}

absl::StatusOr<std::vector<std::string>> FilesOfZarr(const std::string& file,
                                                     const std::string& part,
                                                     const std::string& axes,
                                                     const GridRules& rules) {
  if (!io::IsDirectory(file)) {
    return std::vector<std::string>{file};
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<ZarrStore> store, OpenLocalZarr(file));
  ISOSCOPE_ASSIGN_OR_RETURN(const ZarrOpened opened, FindPart(store.get(), part, axes, rules));
  ISOSCOPE_ASSIGN_OR_RETURN(ZarrFiles listed, ListZarrFiles(file, opened.volumes));
  std::vector<std::string> files = std::move(listed.of_all);
  for (auto& [layer, paths] : listed.by_layer) {
    files.insert(files.end(), std::make_move_iterator(paths.begin()),
                 std::make_move_iterator(paths.end()));
  }
  std::sort(files.begin(), files.end());
  files.erase(std::unique(files.begin(), files.end()), files.end());
  return files;
}

}  // namespace isoscope::source
