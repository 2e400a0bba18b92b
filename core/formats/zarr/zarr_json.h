// The JSON of Zarr's metadata, as strangers write it.

#ifndef ISOSCOPE_CORE_FORMATS_ZARR_ZARR_JSON_H_
#define ISOSCOPE_CORE_FORMATS_ZARR_ZARR_JSON_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include <nlohmann/json.hpp>

namespace isoscope::source {

using ZarrJson = nlohmann::json;

// Of one object of metadata, that of a consolidated one included.
inline constexpr std::int64_t kMaxZarrJsonBytes = std::int64_t{64} << 20;

// Parses an object. NaN, Infinity and -Infinity outside of quotation marks, which Python writes,
// become the strings of that name. INVALID_ARGUMENT: no JSON object, more than 64 levels deep, or
// more than kMaxZarrJsonBytes; the message begins with `name`.
absl::StatusOr<ZarrJson> ParseZarrJson(absl::string_view text, const std::string& name);

// A member of an object; null if it is none, or has no such one.
const ZarrJson* MemberOf(const ZarrJson& object, const char* name);
// A text, "" if the member is none.
std::string TextOf(const ZarrJson& object, const char* name);
// A number; a text "NaN", "Infinity" or "-Infinity" is one, too.
std::optional<double> NumberOf(const ZarrJson& value);
// One number or a list of at most 64; empty for anything else.
std::vector<double> NumbersOf(const ZarrJson& object, const char* name);
// What is shown of a stranger's value in an error.
std::string ShownJson(const ZarrJson& value);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ZARR_ZARR_JSON_H_
