// Log lines on standard error: one event a line, `time level event key=value ...`.
//
//   base::LogInfo("frame_done", {{"dataset", "head"}, {"duration_ms", "41.2"}});
//
// Values with spaces or quotes are quoted. Backed by spdlog. Thread-safe.

#ifndef ISOSCOPE_CORE_BASE_LOG_H_
#define ISOSCOPE_CORE_BASE_LOG_H_

#include <initializer_list>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace isoscope::base {

struct LogField {
  LogField(absl::string_view field_key, const absl::AlphaNum& field_value)
      : key(field_key), value(field_value.Piece()) {}
  LogField(absl::string_view field_key, const absl::Status& status)
      : key(field_key), value(status.ToString()) {}

  std::string key;
  std::string value;
};

enum class LogLevel { kDebug, kInfo, kWarning, kError, kOff };

// Lines below `level` are dropped. Default: kInfo.
void SetLogLevel(LogLevel level);

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

// Returns a duration in milliseconds, as a field: "12.3".
std::string LogMilliseconds(absl::Duration duration);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_LOG_H_
