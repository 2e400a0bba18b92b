// JSON text that carries its own CRC-32C: its member "crc32c" holds, as 8 lower-case hex digits,
// the CRC-32C of the text with these digits replaced by 00000000 (docs/format/dataset.md).

#ifndef ISOSCOPE_CORE_STORE_SEALED_JSON_H_
#define ISOSCOPE_CORE_STORE_SEALED_JSON_H_

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::store {

// Returns `text` with its checksum in place of the blank digits.
// REQUIRES: `text` holds `"crc32c": "00000000"` exactly once.
std::string SealJson(std::string text);

// Verifies sealed text and returns its checksum. DATA_LOSS, naming `where`, if the text has no seal
// or does not match it.
absl::StatusOr<std::uint32_t> VerifySeal(absl::string_view text, absl::string_view where);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SEALED_JSON_H_
