// The library follows links without a word, and tells the file of the object at the end alone:
//
//   scan.h5:/entry/data -> soft link "raw/frames"          in scan.h5
//   scan.h5:/entry/raw  -> external link run.h5:/group     a change of run.h5 is a change of data
//   run.h5:/group/frames -> external link disk7.h5:/d      and so is one of disk7.h5
//   disk7.h5:/d         virtual: planes of a.h5 and b.h5   and of a.h5, b.h5
//
// So a walk goes along the names itself:
//
//   1. Follow takes one name of a path after the other. A hard link leads on, a soft one replaces
//      the path so far, an external one adds its file and goes on there.
//   2. VisitObject looks at what the path leads to. It follows all links below a group, and visits
//      all datasets there.
//   3. VisitDataset follows the sources of a virtual dataset, and adds raw files.
//
// Each object is visited once, which ends circles of objects; kMaxLinks ends those of links.

#include "core/formats/hdf5/hdf5_links.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include <sys/types.h>

#include "core/formats/hdf5/hdf5_attributes.h"
#include "core/io/file.h"
#include "core/source/child/walled_source.h"
#include "core/source/hdf5/hdf5_external_links.h"
#include "core/source/hdf5/hdf5_far_file.h"
#include "core/source/hdf5/hdf5_file.h"
#include "core/source/hdf5/hdf5_file_lookup.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"

namespace isoscope::source {
namespace {

constexpr int kMaxLinks = 64;  // on the way to one object
constexpr std::size_t kMaxOpenFiles = 256;

// A link below a group that is not hard.
struct LinkBelow {
  std::string name;  // from the group
  H5L_type_t type = H5L_TYPE_SOFT;
};

std::vector<LinkBelow> LinksBelow(hid_t group) {
  std::vector<LinkBelow> links;
  const auto visit = [](hid_t /*group*/, const char* name, const H5L_info_t* info,
                        void* out) -> herr_t {
    if (info->type == H5L_TYPE_SOFT || info->type == H5L_TYPE_EXTERNAL) {
      static_cast<std::vector<LinkBelow>*>(out)->push_back({.name = name, .type = info->type});
    }
    return 0;
  };
  H5Lvisit(group, H5_INDEX_NAME, H5_ITER_NATIVE, visit, &links);
  return links;
}

// Datasets below a group, without links, whose samples lie elsewhere.
std::vector<std::string> SpreadDatasetsBelow(hid_t group) {
  std::vector<std::string> names;
  const auto visit = [](hid_t root, const char* name, const H5O_info_t* info, void* out) -> herr_t {
    if (info->type != H5O_TYPE_DATASET) {
      return 0;
    }
    const Hdf5Handle dataset(H5Dopen2(root, name, H5P_DEFAULT), H5Dclose);
    const Hdf5Handle properties(H5Dget_create_plist(dataset.get()), H5Pclose);
    if (properties.is_valid() && (H5Pget_layout(properties.get()) == H5D_VIRTUAL ||
                                  H5Pget_external_count(properties.get()) > 0)) {
      static_cast<std::vector<std::string>*>(out)->push_back(name);
    }
    return 0;
  };
  H5Ovisit2(group, H5_INDEX_NAME, H5_ITER_NATIVE, visit, &names, H5O_INFO_BASIC);
  return names;
}

std::string JoinedNames(absl::string_view before, absl::string_view behind) {
  return behind.empty() ? std::string(before) : absl::StrCat(before, "/", behind);
}

class LinkWalk {
 public:
  void Begin(const std::string& path, const std::string& object) {
    Add(path);
    if (const OpenFile file = Open(path); file.id >= 0) {
      Follow(file.id, "", object, 0);
    }
  }

  std::vector<std::string> TakeFiles() { return std::move(files_); }

 private:
  struct OpenFile {
    hid_t id = -1;     // below 0: not HDF5
    Hdf5Handle own{};  // if it is not kept
  };

  // Files stay open, because the library numbers them, and so their objects, anew each time.
  OpenFile Open(const std::string& path) {
    if (const auto known = open_.find(path); known != open_.end()) {
      return {.id = known->second.get()};
    }
    if (!io::CheckIsRegularFile(path).ok()) {
      return {};  // the library would wait for the writer of a pipe
    }
    Hdf5Handle file = OpenHdf5ToRead(path);
    const hid_t id = file.get();
    if (open_.size() >= kMaxOpenFiles) {
      return {.id = id, .own = std::move(file)};
    }
    open_.emplace(path, std::move(file));
    return {.id = id};
  }

  void Add(const std::string& file) {
    if (known_.insert(file).second) {
      files_.push_back(file);
    }
  }

  // 1. `path` is from the root if it begins with '/', else from `group`, whose path has hard links
  // alone. `links`: those that were followed to get here.
  void Follow(hid_t file, const std::string& group, const std::string& path, int links) {
    if (links > kMaxLinks) {
      return;
    }
    std::string reached = path.starts_with('/') ? "" : group;
    const std::vector<std::string> names = absl::StrSplit(path, '/', absl::SkipEmpty());
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (names[i] == ".") {
        continue;
      }
      const std::string here = absl::StrCat(reached, "/", names[i]);
      H5L_info_t info{};
      if (H5Lget_info(file, here.c_str(), &info, H5P_DEFAULT) < 0) {
        return;
      }
      if (info.type == H5L_TYPE_HARD) {
        reached = here;
        continue;
      }
      const std::string rest =
          absl::StrJoin(names.begin() + static_cast<std::ptrdiff_t>(i) + 1, names.end(), "/");
      std::string value(info.u.val_size, '\0');
      if (value.empty() ||
          H5Lget_val(file, here.c_str(), value.data(), value.size(), H5P_DEFAULT) < 0) {
        return;
      }
      if (info.type == H5L_TYPE_SOFT) {
        Follow(file, reached, JoinedNames(value.c_str(), rest), links + 1);
      } else if (info.type == H5L_TYPE_EXTERNAL) {
        FollowExternal(Hdf5FileOf(file), value, rest, links + 1);
      }
      return;
    }
    const Hdf5Handle object(H5Oopen(file, reached.empty() ? "/" : reached.c_str(), H5P_DEFAULT),
                            H5Oclose);
    if (object.is_valid()) {
      VisitObject(file, reached, object.get(), links);
    }
  }

  void FollowExternal(const std::string& owner, const std::string& value, const std::string& rest,
                      int links) {
    unsigned flags = 0;
    const char* name = nullptr;
    const char* object = nullptr;
    if (H5Lunpack_elink_val(value.data(), value.size(), &flags, &name, &object) >= 0) {
      FollowInto(Hdf5PathsOf(Hdf5OtherFile::kOfLink, name, owner),
                 JoinedNames(absl::StrCat("/", object), rest), links);
    }
  }

  // Goes on in the first of the files that opens, as the library does. Another one that is there
  // counts, too: it may not open today alone. True if one has opened.
  bool FollowInto(const std::vector<std::string>& paths, const std::string& object, int links) {
    bool is_open = false;
    for (const std::string& path : paths) {
      if (!io::PathExists(path) || !io::CheckIsRegularFile(path).ok()) {
        continue;
      }
      Add(path);
      const OpenFile file = is_open ? OpenFile() : Open(path);
      if (file.id >= 0) {
        is_open = true;
        Follow(file.id, "", object, links);
      }
    }
    return is_open;
  }

  // 2. `path` is that of the object, by hard links alone.
  void VisitObject(hid_t file, const std::string& path, hid_t object, int links) {
    H5O_info_t info{};
    if (H5Oget_info2(object, &info, H5O_INFO_BASIC) < 0 ||
        !visited_.insert({info.fileno, info.addr}).second) {
      return;
    }
    if (info.type == H5O_TYPE_DATASET) {
      VisitDataset(file, object, links);
    }
    if (info.type != H5O_TYPE_GROUP) {
      return;
    }
    for (const std::string& name : SpreadDatasetsBelow(object)) {
      const Hdf5Handle dataset(H5Oopen(object, name.c_str(), H5P_DEFAULT), H5Oclose);
      VisitObject(file, absl::StrCat(path, "/", name), dataset.get(), links);
    }
    for (const LinkBelow& link : LinksBelow(object)) {
      Follow(file, path, link.name, links);
    }
  }

  // 3.
  void VisitDataset(hid_t file, hid_t dataset, int links) {
    const Hdf5Handle properties(H5Dget_create_plist(dataset), H5Pclose);
    if (!properties.is_valid()) {
      return;
    }
    const std::string owner = Hdf5FileOf(dataset);
    if (H5Pget_layout(properties.get()) == H5D_VIRTUAL) {
      FollowSources(file, properties.get(), owner, links + 1);
    }
    const int raw_files = H5Pget_external_count(properties.get());
    for (int i = 0; i < raw_files; ++i) {
      std::array<char, 4096> name{};  // no function tells its length
      off_t offset = 0;
      hsize_t size = 0;
      if (H5Pget_external(properties.get(), static_cast<unsigned>(i), name.size() - 1, name.data(),
                          &offset, &size) < 0) {
        continue;
      }
      if (const std::string path = Hdf5RawFilePath(name.data(), owner); io::PathExists(path)) {
        Add(path);
      }
    }
    if (!CheckHdf5Sources(dataset).ok()) {
      return;
    }
    const Hdf5Handle space(H5Dget_space(dataset), H5Sclose);
    const int rank = H5Sget_simple_extent_ndims(space.get());
    for (int axis = 0; axis < rank; ++axis) {
      const Hdf5Handle scale =
          Hdf5ScaleOf(dataset, static_cast<std::size_t>(axis), static_cast<std::size_t>(rank));
      if (scale.is_valid()) {
        VisitObject(file, "", scale.get(), links);
      }
    }
  }

  void FollowSources(hid_t file, hid_t properties, const std::string& owner, int links) {
    std::size_t count = 0;
    H5Pget_virtual_count(properties, &count);
    for (std::size_t i = 0; i < count; ++i) {
      const std::string name = Hdf5TextFrom([&](char* out, std::size_t size) {
        return H5Pget_virtual_filename(properties, i, out, size);
      });
      const std::string dataset = Hdf5TextFrom([&](char* out, std::size_t size) {
        return H5Pget_virtual_dsetname(properties, i, out, size);
      });
      bool is_numbered = false;
      bool is_there = true;
      // A numbered series ends where the first one is missing.
      for (std::int64_t number = 0; is_there && (number == 0 || is_numbered); ++number) {
        const std::string of_file = Hdf5NumberedName(name, number, &is_numbered);
        const std::string of_dataset =
            absl::StrCat("/", Hdf5NumberedName(dataset, number, &is_numbered));
        if (of_file == ".") {
          is_there = H5Lexists(file, of_dataset.c_str(), H5P_DEFAULT) > 0;
          Follow(file, "", of_dataset, links);
        } else {
          is_there = FollowInto(Hdf5PathsOf(Hdf5OtherFile::kOfVirtualDataset, of_file, owner),
                                of_dataset, links) &&
                     (of_file != name || Has(of_file, owner, of_dataset));
        }
      }
    }
  }

  // Returns true if the first source file that opens has the dataset: only the dataset may be
  // numbered.
  bool Has(const std::string& name, const std::string& owner, const std::string& dataset) {
    for (const std::string& path : Hdf5PathsOf(Hdf5OtherFile::kOfVirtualDataset, name, owner)) {
      const OpenFile file = io::PathExists(path) ? Open(path) : OpenFile();
      if (file.id >= 0) {
        return H5Lexists(file.id, dataset.c_str(), H5P_DEFAULT) > 0;
      }
    }
    return false;
  }

  using Address = std::pair<unsigned long, haddr_t>;  // of a file and of an object in it

  std::vector<std::string> files_;
  std::set<std::string> known_;             // the same
  std::map<std::string, Hdf5Handle> open_;  // by path
  std::set<Address> visited_;
};

absl::StatusOr<std::vector<std::string>> FindTree(const std::string& file) {
  return FindHdf5LinkedFiles(file, "/");
}

constexpr WalledLibrary kHdf5Tree = {
    .name = "HDF5", .open = nullptr, .find_files = FindTree, .describe = nullptr};

}  // namespace

std::vector<std::string> FindHdf5LinkedFiles(const std::string& file, const std::string& object) {
  PrepareHdf5();
  LinkWalk walk;
  walk.Begin(file, object);
  return walk.TakeFiles();
}

absl::StatusOr<std::vector<std::string>> FilesOfHdf5Trees(const std::vector<std::string>& files) {
  return FindFilesWalled(kHdf5Tree, files);
}

}  // namespace isoscope::source
