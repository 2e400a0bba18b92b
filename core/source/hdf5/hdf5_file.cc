// A program that writes a file locks it, and marks newer files (version 3 of the superblock) as
// open until it closes them. The mark stays in the file if the program ends before that.

#include "core/source/hdf5/hdf5_file.h"

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/bytes/file_content.h"
#include "core/source/hdf5/hdf5_external_links.h"
#include "core/source/hdf5/hdf5_far_file.h"
#include "core/source/hdf5/hdf5_filters.h"
#include "hdf5.h"

namespace isoscope::source {

void PrepareHdf5() {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // errors are ours to report
  FollowLinksToRegularFiles();
  PrepareHdf5Filters();
}

absl::Status Hdf5OpenError(const std::string& path, const std::string& said) {
  constexpr char kCopy[] =
      "read a copy of it as it is now: cp FILE COPY, then h5clear --status COPY (Debian's package "
      "hdf5-tools)";
  if (absl::StrContains(said, "already open for write")) {
    return absl::UnavailableError(absl::StrCat(
        path,
        ": marked as open for writing: a program still writes it, or ended before it closed it; "
        "wait until it is closed, or ",
        kCopy));
  }
  if (absl::StrContains(said, "unable to lock file")) {
    const bool is_held = absl::StrContains(said, "errno = 11,");  // EAGAIN
    return absl::UnavailableError(
        is_held ? absl::StrCat(path,
                               ": locked by a program that writes it: wait until it is "
                               "closed, or ",
                               kCopy)
                : absl::StrCat(path, ": its file system gives no lock (", said,
                               "); if no program writes it, set HDF5_USE_FILE_LOCKING=FALSE"));
  }
  if (absl::StrContains(said, "truncated file")) {
    return absl::DataLossError(absl::StrCat(path, ": can't be opened as HDF5: ", said,
                                            ": it is cut; copy or download it again"));
  }
  if (absl::Status rights = io::OpenRandomAccessFile(path).status();
      absl::IsPermissionDenied(rights)) {
    return rights;
  }
  if (const auto content = DescribeContent(path); content.has_value()) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", *content));
  }
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": can't be opened as HDF5: ", said, ": no HDF5 file, or it is damaged"));
}

absl::StatusOr<Hdf5Handle> OpenHdf5File(const std::string& path) {
  if (!io::PathExists(path)) {
    return absl::NotFoundError(absl::StrCat(path, ": no such file"));
  }
  ISOSCOPE_RETURN_IF_ERROR(io::CheckIsRegularFile(path));  // HDF5 would wait for a writer
  PrepareHdf5();
  Hdf5Handle file = OpenHdf5ToRead(path);
  if (!file.is_valid()) {
    return Hdf5OpenError(path, LastHdf5Error());
  }
  return file;
}

}  // namespace isoscope::source
