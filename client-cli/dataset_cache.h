// Datasets made on the way from source volumes that were given to `render` and `export`, kept so
// that the next call starts at once.

#ifndef ISOSCOPE_CLIENT_CLI_DATASET_CACHE_H_
#define ISOSCOPE_CLIENT_CLI_DATASET_CACHE_H_

#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::cli {

// The folder of the cache, made if there is none: $XDG_CACHE_HOME/isoscope, else
// $HOME/.cache/isoscope, else isoscope-<user id> in $TMPDIR or /tmp; the first that can be made and
// belongs to this user. FAILED_PRECONDITION says what was tried.
absl::StatusOr<std::string> CacheDirectory();

// The name of the dataset of a source volume: its own name and 16 hexadecimal digits of SHA-256
// over its absolute path, over that, the size and the time of change of each of the `files` it is
// read from (SourceFiles), and over `parameters` (everything else that the dataset depends on). The
// path may have more to it than a file has, such as a dataset of an HDF5 file or a pattern.
// NOT_FOUND, PERMISSION_DENIED.
absl::StatusOr<std::string> CacheKey(const std::string& source_path,
                                     const std::vector<std::string>& files,
                                     absl::string_view parameters);

// Makes the dataset in `directory`, which does not exist; its parent does.
using MakeDataset = absl::FunctionRef<absl::Status(const std::string& directory)>;
// OK if the dataset in `directory` is whole and readable.
using VerifyDataset = absl::FunctionRef<absl::Status(const std::string& directory)>;

// The dataset directory `cache_directory`/`key`: as it is if `verify` accepts it, else made anew.
// It is made under another name and renamed, so that a crash leaves nothing that looks whole; what
// a crash has left is removed by the next call that makes something. Of two processes that make the
// same at the same time, both use what the first has finished.
absl::StatusOr<std::string> FindOrMakeDataset(const std::string& cache_directory,
                                              const std::string& key, MakeDataset make,
                                              VerifyDataset verify);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_DATASET_CACHE_H_
