// Datasets made from source volumes given to `render` and `export`, kept so that the next call
// starts at once. Each is an entry of one folder (cache_entry.h). After one was made, the least
// recently used entries are removed until the rest keep to a limit.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_DATASET_CACHE_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_DATASET_CACHE_H_

#include <cstdint>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "client-cli/session/cache_entry.h"
#include "core/base/units.h"
#include "core/formats/open_request.h"

namespace isoscope::cli {

// The folder of the cache.
struct CacheFolder {
  std::string path;
  // Why a folder that goes before it was not taken, a sentence without its end; "": it is the
  // first.
  std::string passed_over = {};
};
// Returns the folder of the cache, and creates it if needed: $XDG_CACHE_HOME/isoscope, else
// $HOME/.cache/isoscope, else isoscope-<user id> in $TMPDIR or /tmp. The first that can be created
// and belongs to this user is taken. It may be a link of this user to a folder of this user, but
// for the one in $TMPDIR, where others can make links. FAILED_PRECONDITION lists the attempts.
absl::StatusOr<CacheFolder> FindCacheFolder();
// Its path; prints on `err` what was passed over.
absl::StatusOr<std::string> CacheDirectory(std::ostream* err);

// Returns the name of a source's entry: the dataset's name from the file name, '-', and 16
// hexadecimal digits of SHA-256. The digest covers all that decides the dataset: source::Describe,
// source::StampsOf the files (SourceFiles), and `parameters`, all else. Errors as those three.
absl::StatusOr<std::string> CacheKey(const source::OpenRequest& request,
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
  bool was_made = false;        // by this call
  bool is_cached = false;       // of the cache, not a folder of the user
  bool is_only_volume = false;  // of a source that has no other
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
