// netrc files: user names and passwords by host, as curl, wget and ftp read them.
//
//   machine data.example.org login ada password engine
//
// `default` entries are passed over: a password is sent to hosts that are named, and to no other.
// Source: GNU inetutils, "The .netrc file".

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_NETRC_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_NETRC_H_

#include <optional>
#include <string>

#include "absl/strings/string_view.h"

#include "core/source/remote/secret.h"

namespace isoscope::source {

struct NetrcEntry {
  std::string login;
  Secret password;
};

// Returns the first entry of `host` with a login. Words that are unknown are passed over.
std::optional<NetrcEntry> FindInNetrc(absl::string_view text, absl::string_view host);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_NETRC_H_
