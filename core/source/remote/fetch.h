// Fetches objects and their parts: retries, redirects, and the checks that what comes is what was
// asked for.
//
//   answer                       then
//   206 with the right range     its bytes go to the sink
//   200 to a range               FAILED_PRECONDITION before its body: the server knows no ranges
//   other range, more bytes      DATA_LOSS: never other bytes than those asked for
//   other ETag or size, 412      DATA_LOSS: the object has changed
//   301, 302, 303, 307, 308      followed on the same host; elsewhere only without credentials
//   408, 429, 500, 502-504       retried, after Retry-After if there is one
//   401, 403, 404, 410           UNAUTHENTICATED, PERMISSION_DENIED, NOT_FOUND
//   a body that ends early       retried; of an exact range from where it ended
//
// UNAVAILABLE after all attempts says the last reason.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_FETCH_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_FETCH_H_

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/types/span.h"

#include "core/base/cancellation.h"
#include "core/source/remote/address.h"
#include "core/source/remote/remote_client.h"

namespace isoscope::source {

// An object as a server describes it. Empty or -1: it does not say.
struct ObjectVersion {
  std::string etag = {};  // with quotes; "W/" begins a weak one
  std::string last_modified = {};
  std::int64_t size = -1;
};

// Takes the bytes of one job, on the engine's thread. Must not block.
class FetchSink {
 public:
  virtual ~FetchSink() = default;
  // The body begins, perhaps again: what came before is void. `size`: of the body; -1: unknown.
  virtual absl::Status Begin(std::int64_t size) = 0;
  virtual absl::Status Append(absl::string_view bytes) = 0;
};

struct FetchJob {
  Address address;
  std::vector<std::pair<std::string, std::string>> query = {};  // of S3
  // Where an earlier redirect of this address led to: asked first. Set by redirects.
  std::optional<Address> redirected = {};
  enum class Kind {
    kWhole,   // without a range
    kExact,   // bytes [first, last] of an object of known size
    kWithin,  // bytes [first, last] as far as there are any; last < 0: to the end
    kSuffix,  // the last `last` bytes, or all if there are fewer
  };
  Kind kind = Kind::kWhole;
  std::int64_t first = 0;
  std::int64_t last = -1;
  const ObjectVersion* expected = nullptr;  // must not have changed since; null: any
  FetchSink* sink = nullptr;

  // The answer. A range that begins at the object's end, where kWithin finds no bytes, is OK with
  // version.size set, and no call of the sink.
  absl::Status status = {};
  ObjectVersion version = {};
  bool ignores_ranges =
      false;  // a range was answered by the whole object, which `version` describes
};

// Runs all jobs, some at a time. Each has its status then. Returns the first error. If
// `stops_at_error`, it ends all: jobs without a result are CANCELLED. A cancellation ends all with its
// error, at once.
absl::Status Fetch(RemoteClient* client, absl::Span<FetchJob> jobs, bool stops_at_error,
                   const base::Cancellation& cancellation);

// The parts of "bytes 0-9/100"; total -1: "*". Of "bytes */100", first and last are -1.
struct ContentRange {
  std::int64_t first = -1;
  std::int64_t last = -1;
  std::int64_t total = -1;
};
std::optional<ContentRange> ParseContentRange(absl::string_view text);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_FETCH_H_
