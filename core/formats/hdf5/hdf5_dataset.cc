#include "core/formats/hdf5/hdf5_dataset.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"

#include "core/base/shell_word.h"
#include "core/base/status_macros.h"
#include "core/formats/hdf5/hdf5_listing.h"
#include "core/formats/hdf5/nexus_data.h"
#include "core/source/grid/axis_order.h"
#include "core/source/hdf5/hdf5_external_links.h"
#include "core/source/hdf5/hdf5_file.h"
#include "core/source/hdf5/hdf5_filters.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

// Its rank alone is checked first: the library gives no more than 32.
std::vector<std::int64_t> DimsOfSpace(hid_t space) {
  const int rank = H5Sget_simple_extent_ndims(space);
  if (rank < 0 || rank > H5S_MAX_RANK) {
    return {};
  }
  std::vector<hsize_t> dims(static_cast<std::size_t>(rank));
  H5Sget_simple_extent_dims(space, dims.data(), nullptr);
  return {dims.begin(), dims.end()};
}

// Those that a path without a name may mean. The only volume of plain numbers goes before all
// others.
std::vector<std::string> Candidates(const std::vector<Hdf5Entry>& entries, std::size_t axes) {
  std::vector<std::string> plain;
  std::vector<std::string> all;
  for (const Hdf5Entry& entry : entries) {
    if (!IsHdf5Volume(entry, axes)) {
      continue;
    }
    all.push_back(entry.name);
    if (entry.is_plain && PlainAxisOrder(entry.dims).has_value()) {
      plain.push_back(entry.name);
    }
  }
  return axes == 0 && plain.size() == 1 ? plain : all;
}

// Returns the dataset that a NeXus file plots by default, if it is a volume; else "".
std::string DefaultVolume(hid_t file, std::size_t axes) {
  const std::string name = FindNexusDefault(file);
  const Hdf5Handle dataset(
      name.empty() ? H5I_INVALID_HID : H5Dopen2(file, name.c_str(), H5P_DEFAULT), H5Dclose);
  if (!dataset.is_valid()) {
    return "";
  }
  const Hdf5Entry entry{.name = name,
                        .dims = Hdf5DimsOf(dataset.get()),
                        .is_samples = Hdf5SampleTypeOf(dataset.get()).ok()};
  return IsHdf5Volume(entry, axes) ? name : "";
}

// The dataset that `parts` mean but do not name.
absl::StatusOr<std::string> ChooseDataset(hid_t file, const Hdf5Path& parts, std::size_t axes) {
  if (std::string name = DefaultVolume(file, axes); !name.empty()) {
    return name;
  }
  const std::vector<Hdf5Entry> entries = ListHdf5Entries(file);
  const std::vector<std::string> candidates = Candidates(entries, axes);
  if (candidates.size() == 1) {
    return candidates.front();
  }
  const std::string which =
      candidates.empty()
          ? (axes > 0 ? absl::StrCat("no dataset of ", axes, " axes; ") : "")
          : absl::StrCat("say which dataset, as in ",
                         base::ShellWord(absl::StrCat(parts.file, ":", candidates.front())),
                         " (--field chooses none of them); ");
  return absl::InvalidArgumentError(
      absl::StrCat(parts.file, ": ", which, "it holds ", DescribeHdf5Entries(entries)));
}

}  // namespace

std::vector<std::int64_t> Hdf5DimsOf(hid_t dataset) {
  if (!CheckHdf5Sources(dataset).ok()) {
    return {};
  }
  const Hdf5Handle space(H5Dget_space(dataset), H5Sclose);
  return DimsOfSpace(space.get());
}

absl::StatusOr<NamedHdf5Dataset> OpenHdf5ByName(const std::string& path, std::size_t axes) {
  Hdf5Path parts;
  if (!SplitHdf5Path(path, &parts)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": no name of an HDF5 dataset"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(Hdf5Handle file, OpenHdf5File(parts.file));
  if (parts.dataset.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(parts.dataset, ChooseDataset(file.get(), parts, axes));
  }
  Hdf5Handle object(H5Oopen(file.get(), parts.dataset.c_str(), H5P_DEFAULT), H5Oclose);
  if (object.is_valid() && H5Iget_type(object.get()) == H5I_GROUP) {
    // The group of a plot of NeXus means what it plots.
    if (const std::string signal = FindNexusSignal(object.get()); !signal.empty()) {
      parts.dataset = absl::StrCat(absl::StripSuffix(parts.dataset, "/"), "/", signal);
      object = Hdf5Handle(H5Oopen(file.get(), parts.dataset.c_str(), H5P_DEFAULT), H5Oclose);
    }
  }
  if (!object.is_valid() || H5Iget_type(object.get()) != H5I_DATASET) {
    return absl::NotFoundError(absl::StrCat(
        parts.file, object.is_valid() ? ": a group, not a dataset, " : ": no dataset ",
        parts.dataset, "; it holds ", DescribeHdf5Entries(ListHdf5Entries(file.get()))));
  }
  Hdf5Handle dataset(H5Dopen2(file.get(), parts.dataset.c_str(), H5P_DEFAULT), H5Dclose);
  if (const absl::Status sources = CheckHdf5Sources(dataset.get()); !sources.ok()) {
    return absl::Status(sources.code(), absl::StrCat(parts.name(), ": ", sources.message()));
  }
  if (const absl::Status filters = CheckHdf5Filters(dataset.get()); !filters.ok()) {
    return absl::Status(filters.code(), absl::StrCat(parts.name(), ": ", filters.message()));
  }
  return NamedHdf5Dataset{
      .parts = std::move(parts), .file = std::move(file), .dataset = std::move(dataset)};
}

}  // namespace isoscope::source
