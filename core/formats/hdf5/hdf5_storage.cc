// FileFinder::Visit walks from a dataset to all files that its samples lie in:
//
// 1. Add the file of the dataset itself.
// 2. External storage: for each raw file, find its path and check that it is long enough.
// 3. Virtual dataset: for each source, find its file and dataset, and visit that in the same way.
//    A name with "%b" stands for numbered sources 0, 1, 2, ... up to the first missing one.
//
// Invariant: a dataset is visited once, and one that leads back to itself is an error (open_).

#include "core/formats/hdf5/hdf5_storage.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include <sys/types.h>

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "core/source/hdf5/hdf5_far_file.h"
#include "core/source/hdf5/hdf5_file_lookup.h"
#include "core/source/hdf5/hdf5_handle.h"

namespace isoscope::source {
namespace {

namespace fs = std::filesystem;

class FileFinder {
 public:
  explicit FileFinder(const std::string& name) : name_(name) {}

  absl::Status Visit(hid_t dataset) {
    H5O_info_t info{};
    const Hdf5Handle properties(H5Dget_create_plist(dataset), H5Pclose);
    if (!properties.is_valid() || H5Oget_info2(dataset, &info, H5O_INFO_BASIC) < 0) {
      return absl::DataLossError(
          absl::StrCat(name_, ": how it is stored can't be read: ", LastHdf5Error()));
    }
    const std::string owner = Hdf5FileOf(dataset);
    const Address address(info.fileno, info.addr);
    // The library would follow such a circle until its stack overflows.
    if (open_.contains(address)) {
      return absl::InvalidArgumentError(
          absl::StrCat(name_, ": a virtual dataset in '", owner, "' that is made of itself"));
    }
    if (!visited_.insert(address).second) {
      return absl::OkStatus();
    }
    Add(owner);
    if (H5Pget_layout(properties.get()) != H5D_VIRTUAL) {
      return CheckExternalFiles(dataset, properties.get(), owner);
    }
    open_.insert(address);
    absl::Status status = VisitSources(properties.get(), owner);
    open_.erase(address);
    return status;
  }

  std::vector<std::string> TakeFiles() { return std::move(files_); }

 private:
  // What an address sends names no file of this machine.
  [[nodiscard]] absl::Status OtherFilesOfAddress(const std::string& owner) const {
    return absl::InvalidArgumentError(
        absl::StrCat(name_,
                     ": its samples are in other files, which can't be read at an address; bring "
                     "them all to a folder, each with: isoscope copy ADDRESS DIR; it is of ",
                     owner));
  }

  void Add(const std::string& file) {
    if (std::find(files_.begin(), files_.end(), file) == files_.end()) {
      files_.push_back(file);
    }
  }

  absl::Status CheckExternalFiles(hid_t dataset, hid_t properties, const std::string& owner) {
    const int count = H5Pget_external_count(properties);
    if (count <= 0) {
      return absl::OkStatus();
    }
    if (io::IsMounted(owner)) {
      return OtherFilesOfAddress(owner);
    }
    const Hdf5Handle space(H5Dget_space(dataset), H5Sclose);
    const Hdf5Handle type(H5Dget_type(dataset), H5Tclose);
    double missing_bytes = static_cast<double>(H5Sget_simple_extent_npoints(space.get())) *
                           static_cast<double>(H5Tget_size(type.get()));
    for (int i = 0; i < count; ++i) {
      // No function tells the length of the name.
      std::array<char, 4096> file_name{};
      off_t offset = 0;
      hsize_t size = 0;
      if (H5Pget_external(properties, static_cast<unsigned>(i), file_name.size() - 1,
                          file_name.data(), &offset, &size) < 0) {
        return absl::DataLossError(
            absl::StrCat(name_, ": its external files can't be read: ", LastHdf5Error()));
      }
      const std::string path = Hdf5RawFilePath(file_name.data(), owner);
      if (!io::PathExists(path)) {
        return absl::NotFoundError(absl::StrCat(
            name_, ": its samples lie in '", path,
            "', which does not exist; HDF5_EXTFILE_PREFIX can name the folder it is in"));
      }
      ISOSCOPE_RETURN_IF_ERROR(io::CheckIsRegularFile(path));  // HDF5 would wait for a writer
      const double wanted_bytes = std::min(static_cast<double>(size), missing_bytes);
      std::error_code error;
      const std::uintmax_t file_bytes = fs::file_size(path, error);
      if (error) {
        return io::ErrnoToStatus(error.value(), "can't look at", path);
      }
      if (static_cast<double>(file_bytes) < static_cast<double>(offset) + wanted_bytes) {
        return absl::DataLossError(absl::StrFormat(
            "%s: its samples lie in '%s', which has %d bytes; expected at least %.0f: it is cut",
            name_, path, file_bytes, static_cast<double>(offset) + wanted_bytes));
      }
      missing_bytes -= wanted_bytes;
      Add(path);
    }
    return absl::OkStatus();
  }

  absl::Status VisitSources(hid_t properties, const std::string& owner) {
    std::size_t count = 0;
    H5Pget_virtual_count(properties, &count);
    for (std::size_t i = 0; i < count; ++i) {
      const std::string file = Hdf5TextFrom([&](char* out, std::size_t size) {
        return H5Pget_virtual_filename(properties, i, out, size);
      });
      const std::string dataset = Hdf5TextFrom([&](char* out, std::size_t size) {
        return H5Pget_virtual_dsetname(properties, i, out, size);
      });
      bool is_numbered = false;
      // A numbered series ends where the first one is missing; it has at least one.
      for (std::int64_t number = 0; number == 0 || is_numbered; ++number) {
        const std::string source_file = Hdf5NumberedName(file, number, &is_numbered);
        const std::string source = Hdf5NumberedName(dataset, number, &is_numbered);
        bool is_there = false;
        const absl::Status status = VisitSource(source_file, source, owner, &is_there);
        if (number > 0 && !is_there && absl::IsNotFound(status)) {
          break;
        }
        ISOSCOPE_RETURN_IF_ERROR(status);
      }
    }
    return absl::OkStatus();
  }

  // Sets `is_there` if the source exists, even if there is another error.
  absl::Status VisitSource(const std::string& file_name, const std::string& dataset_name,
                           const std::string& owner, bool* is_there) {
    if (file_name != "." && io::IsMounted(owner)) {
      return OtherFilesOfAddress(owner);
    }
    const std::vector<std::string> paths =
        file_name == "." ? std::vector<std::string>{owner}
                         : Hdf5PathsOf(Hdf5OtherFile::kOfVirtualDataset, file_name, owner);
    const auto path = std::find_if(paths.begin(), paths.end(), io::PathExists);
    if (path == paths.end()) {
      return absl::NotFoundError(absl::StrCat(name_, ": part of its samples lies in '", file_name,
                                              "', which was not found; looked for ",
                                              absl::StrJoin(paths, ", ")));
    }
    ISOSCOPE_RETURN_IF_ERROR(io::CheckIsRegularFile(*path));  // HDF5 would wait for a writer
    const Hdf5Handle file = OpenHdf5ToRead(*path);
    if (!file.is_valid()) {
      return absl::DataLossError(absl::StrCat(name_, ": part of its samples lies in '", *path,
                                              "', which can't be opened: ", LastHdf5Error()));
    }
    const Hdf5Handle dataset(H5Dopen2(file.get(), dataset_name.c_str(), H5P_DEFAULT), H5Dclose);
    if (!dataset.is_valid()) {
      return absl::NotFoundError(absl::StrCat(name_, ": part of its samples lies in dataset ",
                                              dataset_name, " of '", *path,
                                              "', which does not have it"));
    }
    *is_there = true;
    return Visit(dataset.get());
  }

  using Address = std::pair<unsigned long, haddr_t>;  // of a file and of an object in it

  const std::string& name_;
  std::vector<std::string> files_;
  std::set<Address> visited_;
  std::set<Address> open_;  // the datasets on the path to the visited one
};

}  // namespace

absl::StatusOr<std::vector<std::string>> FindHdf5Files(hid_t dataset, const std::string& name) {
  FileFinder finder(name);
  ISOSCOPE_RETURN_IF_ERROR(finder.Visit(dataset));
  return finder.TakeFiles();
}

}  // namespace isoscope::source
