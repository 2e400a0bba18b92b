// Datasets made on the way from source volumes that were given to `render` and `export`, kept so
// that the next call starts at once. Each is an entry of one folder (cache_entry.h). After one was
// made, those least recently used go until all keep to a limit.

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

// The folder of the cache, made if there is none: $XDG_CACHE_HOME/isoscope, else
// $HOME/.cache/isoscope, else isoscope-<user id> in $TMPDIR or /tmp; the first that can be made and
// belongs to this user. FAILED_PRECONDITION says what was tried.
absl::StatusOr<std::string> CacheDirectory();

// With links resolved, as far as it exists: `path` need be no file.
absl::StatusOr<std::string> AbsolutePath(const std::string& path);

// The name of the entry of a source volume: the name of its dataset, which is that of its file,
// '-', and 16 hexadecimal digits of SHA-256 over its absolute path, over that, the size and the
// time of change of each of the `files` it is read from (SourceFiles), and over `parameters`
// (everything else that the dataset depends on). The path may have more to it than a file has, such
// as a dataset of an HDF5 file or a pattern. NOT_FOUND, PERMISSION_DENIED.
absl::StatusOr<std::string> CacheKey(const std::string& source_path,
                                     const std::vector<std::string>& files,
                                     absl::string_view parameters);

// Makes the dataset in `directory`, which does not exist; its parent does.
using MakeDataset = absl::FunctionRef<absl::Status(const std::string& directory)>;
// OK if the dataset in `directory` is whole and readable.
using VerifyDataset = absl::FunctionRef<absl::Status(const std::string& directory)>;

// A dataset of the cache, in use: nobody removes it as long as this lives.
struct CachedDataset {
  std::string directory = {};
  EntryLock lock = {};
  bool was_made = false;  // by this call
};

// The dataset directory `cache_directory`/`key`: as it is if `verify` accepts it, else made anew.
// It is made under another name and renamed, so that a crash leaves nothing that looks whole. The
// next call that makes something removes the leftovers of a crash. Of two processes that make the
// same at the same time, both use what the first has finished. `source`: the path of the source
// volume, for people.
absl::StatusOr<CachedDataset> FindOrMakeDataset(const std::string& cache_directory,
                                                const std::string& key, absl::string_view source,
                                                MakeDataset make, VerifyDataset verify);

// How large all entries together may become: `flag`, else $ISOSCOPE_CACHE_LIMIT, else 20 GiB or a
// tenth of what the file system would have free without the cache, whichever is less. UsageError if
// the variable holds no size.
absl::StatusOr<std::int64_t> CacheLimitBytes(const std::optional<std::int64_t>& flag,
                                             const std::string& cache_directory);

// Removes entries, the least recently used first, until all together have at most `limit_bytes`,
// and returns those removed. Entries in use stay, whatever their size: so does the one that was
// just made.
absl::StatusOr<std::vector<CacheEntry>> TrimCache(const std::string& cache_directory,
                                                  std::int64_t limit_bytes);

// One line, without its end, about the entry that was made in `directory` if it has more than
// kLargeEntryBytes: how large it is, where, and how to remove it. Else "".
inline constexpr std::int64_t kLargeEntryBytes = base::kGiB;
std::string DescribeLargeEntry(const std::string& cache_directory, std::int64_t limit_bytes,
                               const std::vector<CacheEntry>& entries,
                               const std::string& directory);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_DATASET_CACHE_H_
