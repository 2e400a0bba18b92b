// Log lines on standard error: one event a line, `time level event key=value ...`, or JSON.
//
//   base::LogInfo("frame_done", {{"dataset", "head"}, {"duration_ms", "41.2"}});
//
// A value may be a stranger's. So each is bounded: 256 bytes (kMaxForeignBytes), or kMaxOwnLogBytes
// of a status and of OwnText; a longer one ends in "... (cut, N bytes)". Values with spaces, quotes
// or control characters are quoted and escaped (printable.h). Backed by spdlog. Thread-safe.

#ifndef ISOSCOPE_CORE_BASE_LOG_H_
#define ISOSCOPE_CORE_BASE_LOG_H_

#include <concepts>
#include <cstddef>
#include <initializer_list>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/base/printable.h"

namespace isoscope::base {

// Bytes of a value that is no stranger's.
inline constexpr std::size_t kMaxOwnLogBytes = 4096;

// A value that no peer decides: a path, a list of the operator's, a sentence of the program.
struct OwnText {
  absl::string_view text;
};

struct LogField {
  LogField(absl::string_view field_key, const absl::AlphaNum& field_value)
      : key(field_key), value(CutText(field_value.Piece())) {}
  template <std::same_as<ForeignText> Text>
  LogField(absl::string_view field_key, const Text& field_value)
      : key(field_key), value(field_value.text()) {}
  LogField(absl::string_view field_key, OwnText field_value)
      : key(field_key), value(CutText(field_value.text, kMaxOwnLogBytes)) {}
  // Errors bound the names of strangers that they repeat: Quoted.
  LogField(absl::string_view field_key, const absl::Status& status)
      : key(field_key), value(CutText(status.ToString(), kMaxOwnLogBytes)) {}

  std::string key;
  std::string value;
};

enum class LogLevel { kDebug, kInfo, kWarning, kError, kOff };

// Lines below `level` are dropped. Default: kInfo.
void SetLogLevel(LogLevel level);

// How lines are written: as above, or as a JSON object each, whose members are time, level, event
// and the fields, all of them strings. Default: kText. Call before other threads log.
enum class LogFormat { kText, kJson };
void SetLogFormat(LogFormat format);

void Log(LogLevel level, absl::string_view event, std::initializer_list<LogField> fields);

inline void LogDebug(absl::string_view event, std::initializer_list<LogField> fields = {}) {
  Log(LogLevel::kDebug, event, fields);
}
inline void LogInfo(absl::string_view event, std::initializer_list<LogField> fields = {}) {
  Log(LogLevel::kInfo, event, fields);
}
inline void LogWarning(absl::string_view event, std::initializer_list<LogField> fields = {}) {
  Log(LogLevel::kWarning, event, fields);
}
inline void LogError(absl::string_view event, std::initializer_list<LogField> fields = {}) {
  Log(LogLevel::kError, event, fields);
}

// Returns `event key=value ...`, which Log writes after time and level.
std::string FormatLogLine(absl::string_view event, std::initializer_list<LogField> fields);

// Returns the members of the JSON object behind time and level: `"event":"...","key":"value",...`.
std::string FormatLogJson(absl::string_view event, std::initializer_list<LogField> fields);

// Returns a duration in milliseconds, as a field: "12.3".
std::string LogMilliseconds(absl::Duration duration);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_LOG_H_
