// The request by which the source of an index-only dataset is opened again, as its manifest keeps it
// (docs/format/dataset.md, "Index-only datasets").

#ifndef ISOSCOPE_CORE_INDEXED_SOURCE_REQUEST_H_
#define ISOSCOPE_CORE_INDEXED_SOURCE_REQUEST_H_

#include <map>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/formats/open_request.h"

namespace isoscope::indexed {

// Whether the text is an address ("https://...") and no path.
bool IsAddress(absl::string_view path);

// Returns the members that decide samples, as text by name. Those that decide positions, names and
// times are left out: the manifest has these. The path is absolute, without links. Errors as
// source::ResolvedPath; INVALID_ARGUMENT: a name of a field with a line break.
absl::StatusOr<std::map<std::string, std::string>> EncodeSourceRequest(
    const source::OpenRequest& request);

// Returns the request of such members, but for those of DecodeSourceVolume. FAILED_PRECONDITION: one that this program does not know.
// DATA_LOSS: one that is no text of EncodeSourceRequest. `where` is for messages.
absl::StatusOr<source::OpenRequest> DecodeSourceRequest(
    const std::map<std::string, std::string>& members, absl::string_view where);

// A volume of a source that has several.
struct SourceVolume {
  std::string field;
  int component = 0;  // behind the last of several: the magnitude
  int step = 0;

  friend bool operator==(const SourceVolume&, const SourceVolume&) = default;
};

// Returns the volume that such members name; not set: they name none, and the source has one only.
// DATA_LOSS as DecodeSourceRequest.
absl::StatusOr<std::optional<SourceVolume>> DecodeSourceVolume(
    const std::map<std::string, std::string>& members, absl::string_view where);

}  // namespace isoscope::indexed

#endif  // ISOSCOPE_CORE_INDEXED_SOURCE_REQUEST_H_
