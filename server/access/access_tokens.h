// The file of bearer tokens (docs/security.md): which datasets their holders may see, and their
// limits.
//
//   {"tokens": [{"name": "alice", "sha256": "9f86...", "datasets": ["head"],
//                "max_viewport_px": 2048, "max_frames_per_second": 10,
//                "max_concurrent_frames": 4, "max_streams": 8, "max_exports": 1,
//                "max_bytes_per_second": 10e6}]}
//
// It holds digests, so a reader of the file can't use the tokens. SHA-256 without salt is right for
// tokens of at least 128 random bits; users' passwords do not belong here.

#ifndef ISOSCOPE_SERVER_ACCESS_ACCESS_TOKENS_H_
#define ISOSCOPE_SERVER_ACCESS_ACCESS_TOKENS_H_

#include <cstddef>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::server {

struct AccessToken {
  std::string name = {};    // name of its holder, for logs and messages; unique
  std::string digest = {};  // the 32 bytes of SHA-256 of the token; unique
  bool sees_all_datasets = false;
  std::vector<std::string> datasets = {};  // ascending; those that it may see
  int max_viewport_px = 0;                 // of a side of the viewport; 0: the service's own limit
  double max_frames_per_second = 0;        // 0: no limit, as of those below
  int max_concurrent_frames = 0;           // in work and waiting
  int max_streams = 0;                     // interactive ones that are open
  int max_exports = 0;                     // in work and waiting
  double max_bytes_per_second = 0;         // of pictures, planes and meshes

  friend bool operator==(const AccessToken&, const AccessToken&) = default;
};

inline constexpr std::size_t kMaxAccessTokens = 1000;

// Reads the text of a file. `where`: its path, for messages. INVALID_ARGUMENT names the entry, the
// member and the expected value. Unknown members are refused, so that a misspelt limit is an error.
absl::StatusOr<std::vector<AccessToken>> ParseAccessTokens(absl::string_view text,
                                                           absl::string_view where);

// Returns the 32 bytes of the SHA-256 digest.
std::string DigestOfToken(absl::string_view token);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ACCESS_ACCESS_TOKENS_H_
