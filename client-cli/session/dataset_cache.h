// Datasets made from source volumes given to `render` and `export`, kept so that the next call
// starts at once. Each is an entry of one folder (cache_entry.h). After one was made, the least
// recently used entries are removed until the rest keep to a limit.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_DATASET_CACHE_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_DATASET_CACHE_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "client-cli/session/cache_entry.h"
#include "core/base/units.h"

namespace isoscope::cli {

// Returns the folder of the cache, and creates it if needed: $XDG_CACHE_HOME/isoscope, else
// $HOME/.cache/isoscope, else isoscope-<user id> in $TMPDIR or /tmp. The first that can be created
// and belongs to this user is taken. FAILED_PRECONDITION lists the attempts.
absl::StatusOr<std::string> CacheDirectory();

// Resolves links as far as the path exists: `path` need not be a file.
absl::StatusOr<std::string> AbsolutePath(const std::string& path);

// Returns the name of a source volume's entry: the dataset's name from the file name, '-', and 16
// hexadecimal digits of SHA-256. The digest covers the absolute path, then path, size and time of
// change of each of the `files` (SourceFiles), then `parameters` (all else that the dataset depends
// on). The source path may also name a dataset of an HDF5 file, or a pattern. NOT_FOUND,
// PERMISSION_DENIED.
absl::StatusOr<std::string> CacheKey(const std::string& source_path,
                                     const std::vector<std::string>& files,
                                     absl::string_view parameters);

// Makes the dataset in `directory`, which does not exist; its parent does.
using MakeDataset = absl::FunctionRef<absl::Status(const std::string& directory)>;
// OK if the dataset in `directory` is whole and readable.
using VerifyDataset = absl::FunctionRef<absl::Status(const std::string& directory)>;

// A dataset of the cache, in use: it is not removed while this object lives.
struct CachedDataset {
  std::string directory = {};
  EntryLock lock = {};
  bool was_made = false;  // by this call
};

// Returns the dataset directory `cache_directory`/`key`: as it is if `verify` accepts it, else made
// anew. It is made under another name and renamed, so that a crash leaves no partial entry. The
// next call that makes an entry removes the leftovers of a crash. If two processes make the same
// entry, both use the one that was finished first. `source`: the path of the source volume, for the
// user.
absl::StatusOr<CachedDataset> FindOrMakeDataset(const std::string& cache_directory,
                                                const std::string& key, absl::string_view source,
                                                MakeDataset make, VerifyDataset verify);

// Returns the limit for all entries together: `flag`, else $ISOSCOPE_CACHE_LIMIT. Without both it
// is 20 GiB, or a tenth of the file system's free space without the cache, whichever is less.
// UsageError if the variable holds no size.
absl::StatusOr<std::int64_t> CacheLimitBytes(const std::optional<std::int64_t>& flag,
                                             const std::string& cache_directory);

// Removes entries, the least recently used first, until all together have at most `limit_bytes`,
// and returns those removed. Entries in use stay, whatever their size, including the one just made.
absl::StatusOr<std::vector<CacheEntry>> TrimCache(const std::string& cache_directory,
                                                  std::int64_t limit_bytes);

// Returns one line, without its end, about the entry made in `directory` if it has more than
// kLargeEntryBytes: its size, its path, and how to remove it. Else "".
inline constexpr std::int64_t kLargeEntryBytes = base::kGiB;
std::string DescribeLargeEntry(const std::string& cache_directory, std::int64_t limit_bytes,
                               const std::vector<CacheEntry>& entries,
                               const std::string& directory);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_DATASET_CACHE_H_
