// Sources at an address: what a path such as "https://host/run.zarr:0" or "s3://bucket/head.nrrd"
// names. An object becomes a mounted file (core/io/mounted_file.h), which readers open as any other.
// A folder of Zarr becomes a store.
//
//   https://host/a/run.zarr/0:DAPI?sig=...   the address, as a user gives it
//   https://host/a/run.zarr/0:DAPI           its name: the path, for messages and records
//   https://host/a/run.zarr, 0:DAPI          the store and the part of it
//
// Only addresses that a user gave are read: no name in a file leads to another one.

#ifndef ISOSCOPE_CORE_FORMATS_ADDRESS_SOURCE_H_
#define ISOSCOPE_CORE_FORMATS_ADDRESS_SOURCE_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/formats/zarr/zarr_store.h"
#include "core/source/grid/grid_rules.h"

namespace isoscope::source {

// Returns the path for what is at an address: without its query, which may hold secrets, and which
// this process remembers. Other paths stay as they are. Asks no server. INVALID_ARGUMENT: no address
// that can be read; or another one with the same path, but another query, was given before.
absl::StatusOr<std::string> PathOfSource(absl::string_view text);

// A file that is mounted, or a folder of Zarr.
struct AddressSource {
  std::string file;    // its name: the beginning of the path
  std::string part{};  // of a folder: what the path names of it
  bool is_store = false;
};
// Finds what the path of an address names, and opens it by the credentials of the environment
// (RemoteOptionsFromEnvironment). The first call asks the server. Later ones return the same: a file
// that changes in between is DATA_LOSS of a read. Errors as OpenAddress (core/source/remote), also
// with advice: NOT_FOUND if there is neither an object nor a store. An error is returned again for
// some seconds. Thread-safe: calls of one path wait for each other, until the process's interrupt.
absl::StatusOr<AddressSource> FindAtAddress(const std::string& path);

// Opens the store, a folder, or an archive that is mounted. REQUIRES: FindAtAddress returned `file`.
absl::StatusOr<std::unique_ptr<ZarrStore>> OpenZarrAtAddress(const std::string& file);
// The documents of metadata that decide the volumes of a folder, each mounted: they tell not all.
// Errors as OpenZarrSeries.
absl::StatusOr<std::vector<std::string>> FilesOfZarrAtAddress(const std::string& file,
                                                              const std::string& part,
                                                              const std::string& axes,
                                                              const GridRules& rules);

// The next FindAtAddress of the path asks the server again, because another object may stand there.
// Files that are open keep their bytes.
void ForgetAddress(absl::string_view text);

// From now on no server of this process may redirect to another host: for programs that read what
// others' manifests name.
void RefuseOtherHosts();

// "PATH: WHAT at an address needs the whole file; bring it with: isoscope copy PATH".
absl::Status NeedsWholeFile(const std::string& path, absl::string_view what);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ADDRESS_SOURCE_H_
