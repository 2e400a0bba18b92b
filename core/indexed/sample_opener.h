// Opens the sources of index-only datasets, and reads blocks from them.

#ifndef ISOSCOPE_CORE_INDEXED_SAMPLE_OPENER_H_
#define ISOSCOPE_CORE_INDEXED_SAMPLE_OPENER_H_

#include <cstddef>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/units.h"
#include "core/store/sample_reader.h"

namespace isoscope::indexed {

// Sources below `actual` may be read. A manifest that records one below `recorded` means `actual`.
struct AllowedSource {
  std::string recorded;
  std::string actual;

  friend bool operator==(const AllowedSource&, const AllowedSource&) = default;
};

// "PREFIX" or "RECORDED=ACTUAL": absolute paths, or addresses. INVALID_ARGUMENT.
absl::StatusOr<AllowedSource> ParseAllowedSource(absl::string_view text);

struct SourceAccess {
  // Whatever local file this process may read, as for a user who opens a dataset of his own.
  bool allows_local_files = false;
  std::vector<AllowedSource> allowed{};
  // Of units, kept or in the making, of all datasets together (unit_cache.h).
  std::size_t max_bytes = static_cast<std::size_t>(256 * base::kMiB);
  // Of indexes of shards that are kept, of all sources of the process together (shard_indexes.h).
  std::size_t max_index_bytes = static_cast<std::size_t>(64 * base::kMiB);
};

// What commands of a user read: any local file, and what ISOSCOPE_ALLOW_SOURCE names, such as an
// address. INVALID_ARGUMENT as ParseAllowedSource.
absl::StatusOr<SourceAccess> AccessOfUser();

// The memory of SourceAccess::max_bytes by default, for plans of others.
inline constexpr std::size_t kDefaultSourceBytes = static_cast<std::size_t>(256 * base::kMiB);

// Returns a function that opens sources, and bounds the indexes of shards in the process. Readers of
// one dataset share its source. The function and
// its readers share one cache, and are thread-safe. Readers take the whole of the unit that has a
// block's first own sample.
//
//   NOT_FOUND            nothing is there
//   PERMISSION_DENIED    the access does not allow one of the source's files, links resolved, or
//                        the system or a server does not
//   UNAUTHENTICATED      a server wants credentials
//   UNAVAILABLE          a server does not answer
//   FAILED_PRECONDITION  a server does what can't be read from, such as to ignore ranges
//   DATA_LOSS            it can't be opened as it was, or has other dimensions or another type
//   FAILED_PRECONDITION  the manifest asks for what this program does not know
//
// Readers give the same errors, since a source may vanish or change while it is open, and
// RESOURCE_EXHAUSTED of UnitCache::Get. The first five have ErrorReason::kSourceUnreadable: a source
// that is back as it was is read again.
store::OpenSamples MakeSampleOpener(const SourceAccess& access);

}  // namespace isoscope::indexed

#endif  // ISOSCOPE_CORE_INDEXED_SAMPLE_OPENER_H_
