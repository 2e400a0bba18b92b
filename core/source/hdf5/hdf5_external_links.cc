// The library has a class of functions for each type of link, and lets its own ones be replaced
// (H5Lregister). Ours open a file as H5L__extern_traverse of version 1.10 does: with the access
// properties of the file that has the link, and closed with the last object in it.

#include "core/source/hdf5/hdf5_external_links.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "absl/strings/str_cat.h"
#include <sys/types.h>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "core/source/hdf5/hdf5_file_lookup.h"
#include "core/source/hdf5/hdf5_handle.h"

namespace isoscope::source {
namespace {

struct ExternalLink {
  std::string file;
  std::string object;
};

// An empty file if the value makes no sense.
ExternalLink LinkOf(const void* value, std::size_t size) {
  unsigned flags = 0;
  const char* file = nullptr;
  const char* object = nullptr;
  if (H5Lunpack_elink_val(value, size, &flags, &file, &object) < 0) {
    return {};
  }
  return {.file = file, .object = object};
}

hid_t FollowLink(const char* /*name*/, hid_t group, const void* value, std::size_t size,
                 hid_t access, hid_t /*transfer*/) {
  const ExternalLink link = LinkOf(value, size);
  if (link.file.empty()) {
    return H5I_INVALID_HID;
  }
  const Hdf5Handle owner(H5Iget_file_id(group), H5Fclose);
  const Hdf5Handle properties(H5Fget_access_plist(owner.get()), H5Pclose);
  H5Pset_fclose_degree(properties.get(), H5F_CLOSE_WEAK);
  for (const std::string& path :
       Hdf5PathsOf(Hdf5OtherFile::kOfLink, link.file, Hdf5FileOf(group))) {
    if (!io::PathExists(path) || !io::CheckIsRegularFile(path).ok()) {
      continue;
    }
    const Hdf5Handle file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, properties.get()), H5Fclose);
    if (file.is_valid()) {
      return H5Oopen(file.get(), link.object.c_str(), access);
    }
  }
  return H5I_INVALID_HID;
}

// Returns the value as it is stored, as H5L__extern_query does.
ssize_t ValueOfLink(const char* /*name*/, const void* value, std::size_t size, void* out,
                    std::size_t out_size) {
  if (out != nullptr) {
    std::memcpy(out, value, std::min(size, out_size));
  }
  return static_cast<ssize_t>(size);
}

}  // namespace

void FollowLinksToRegularFiles() {
  const H5L_class_t links{.version = H5L_LINK_CLASS_T_VERS,
                          .id = H5L_TYPE_EXTERNAL,
                          .comment = "external, to regular files",
                          .create_func = nullptr,
                          .move_func = nullptr,
                          .copy_func = nullptr,
                          .trav_func = FollowLink,
                          .del_func = nullptr,
                          .query_func = ValueOfLink};
  ISOSCOPE_CHECK(H5Lregister(&links) >= 0);
}

std::string WhyLinkIsBroken(hid_t group, const std::string& name) {
  H5L_info_t info{};
  if (H5Lget_info(group, name.c_str(), &info, H5P_DEFAULT) < 0 || info.type != H5L_TYPE_EXTERNAL) {
    return "";
  }
  std::vector<char> value(info.u.val_size);
  const bool is_read =
      H5Lget_val(group, name.c_str(), value.data(), value.size(), H5P_DEFAULT) >= 0;
  const ExternalLink link = is_read ? LinkOf(value.data(), value.size()) : ExternalLink();
  if (link.file.empty()) {
    return "";
  }
  const std::string owner = Hdf5FileOf(group);
  if (io::IsMounted(owner)) {
    return absl::StrCat("in ", link.file, ", to which a file at an address can't lead");
  }
  for (const std::string& path : Hdf5PathsOf(Hdf5OtherFile::kOfLink, link.file, owner)) {
    if (const absl::Status regular = io::CheckIsRegularFile(path); !regular.ok()) {
      return std::string(regular.message());
    }
  }
  return absl::StrCat("in ", link.file, ", which is missing");
}

absl::Status CheckHdf5Sources(hid_t dataset) {
  const Hdf5Handle properties(H5Dget_create_plist(dataset), H5Pclose);
  std::size_t count = 0;
  if (!properties.is_valid() || H5Pget_layout(properties.get()) != H5D_VIRTUAL ||
      H5Pget_virtual_count(properties.get(), &count) < 0) {
    return absl::OkStatus();
  }
  const std::string owner = Hdf5FileOf(dataset);
  for (std::size_t i = 0; i < count; ++i) {
    const std::string file = Hdf5TextFrom([&](char* out, std::size_t size) {
      return H5Pget_virtual_filename(properties.get(), i, out, size);
    });
    bool is_numbered = false;
    bool is_there = file != ".";
    // A numbered series ends where the first one is missing.
    for (std::int64_t number = 0; is_there && (number == 0 || is_numbered); ++number) {
      is_there = false;
      for (const std::string& path :
           Hdf5PathsOf(Hdf5OtherFile::kOfVirtualDataset,
                       Hdf5NumberedName(file, number, &is_numbered), owner)) {
        ISOSCOPE_RETURN_IF_ERROR(io::CheckIsRegularFile(path));
        is_there = is_there || io::PathExists(path);
      }
    }
  }
  return absl::OkStatus();
}

}  // namespace isoscope::source
