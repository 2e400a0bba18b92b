// Entity tags: an answer that a client has cached is not made again.

#ifndef ISOSCOPE_WEB_GATEWAY_HTTP_ETAG_H_
#define ISOSCOPE_WEB_GATEWAY_HTTP_ETAG_H_

#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace isoscope::gateway {

// Returns a strong tag with its quotes: a digest of the parts and their boundaries.
std::string MakeEtag(const std::vector<absl::string_view>& parts);

// Returns true if the header If-None-Match names `etag`: "*", or one of its list, weak or strong.
bool MatchesEtag(absl::string_view if_none_match, absl::string_view etag);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_HTTP_ETAG_H_
