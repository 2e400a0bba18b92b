// Type-checked reading of JSON members. Internal to core/store: only this file and the encoders
// know the JSON library, and none of its exceptions escapes.

#ifndef ISOSCOPE_CORE_STORE_JSON_FIELDS_H_
#define ISOSCOPE_CORE_STORE_JSON_FIELDS_H_

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include <nlohmann/json_fwd.hpp>

namespace isoscope::store {

using Json = nlohmann::ordered_json;

// The largest integer of a member.
inline constexpr std::int64_t kMaxInt64 = std::numeric_limits<std::int64_t>::max();

// Numbers that JSON lacks become the strings "inf" and "-inf". REQUIRES: `value` is not NaN.
Json JsonFromDouble(double value);
// 8 lower-case hex digits.
Json JsonFromCrc32c(std::uint32_t crc32c);
// Indented by two, with a final newline. Bytes that are not UTF-8 become U+FFFD.
std::string DumpJson(const Json& json);

// Reads members and remembers the first error, so that a decoder checks status() once at the end.
// After an error, every read leaves its target as it was. Errors are DATA_LOSS and name `where`,
// the member and the expected type. `json` and `where` must outlive the object. Thread-compatible.
class JsonFields {
 public:
  JsonFields(const Json& json, absl::string_view where);

  // Whether an optional member is there.
  [[nodiscard]] bool Has(const char* name) const;

  void Read(const char* name, std::string* value);
  // Reads an integer in [min, max].
  void Read(const char* name, std::int64_t min, std::int64_t max, std::int64_t* value);
  void Read(const char* name, std::uint64_t* value);
  // Reads an array of exactly `count` elements.
  void ReadDoubles(const char* name, std::size_t count, double* values);
  void ReadIntegers(const char* name, std::size_t count, std::int64_t min, std::int64_t max,
                    std::int64_t* values);
  void ReadDouble(const char* name, double* value);
  void ReadCrc32c(const char* name, std::uint32_t* value);
  // Returns a member that is an array or an object; null after an error.
  const Json* ReadArray(const char* name);
  const Json* ReadObject(const char* name);

  // Records an error found elsewhere, unless there is one already. OK is ignored.
  void Fail(const absl::Status& status);
  [[nodiscard]] const absl::Status& status() const { return status_; }

 private:
  const Json* Find(const char* name);
  void Expected(const char* name, absl::string_view what);

  const Json& json_;
  const absl::string_view where_;
  absl::Status status_;
};

// Parses sealed text whose seal was verified, and checks its members "format" and "format_version".
// DATA_LOSS: no JSON object of that format. FAILED_PRECONDITION: of a newer version. A pointer,
// because readers of members need not know the type.
absl::StatusOr<std::shared_ptr<const Json>> ParseJsonFile(absl::string_view text,
                                                          absl::string_view where,
                                                          absl::string_view format,
                                                          std::int64_t newest_version);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_JSON_FIELDS_H_
