// Entity tags: an answer that a client has already is not made again.

#ifndef ISOSCOPE_WEB_GATEWAY_ETAG_H_
#define ISOSCOPE_WEB_GATEWAY_ETAG_H_

#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace isoscope::gateway {

// A strong tag with its quotes: a digest of the parts and of where they end.
std::string MakeEtag(const std::vector<absl::string_view>& parts);

// Whether the header If-None-Match names `etag`: "*", or one of its list, weak or strong.
bool MatchesEtag(absl::string_view if_none_match, absl::string_view etag);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_ETAG_H_
