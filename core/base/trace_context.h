// The identity of a request across processes, in the format of W3C Trace Context:
//
//   traceparent: 00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01
//                version  trace id                   parent id        flags
//
// The trace id stays the same from process to process; it is our request id. The parent id is new
// at each hop.

#ifndef ISOSCOPE_CORE_BASE_TRACE_CONTEXT_H_
#define ISOSCOPE_CORE_BASE_TRACE_CONTEXT_H_

#include <optional>
#include <string>
#include <utility>

#include "absl/strings/string_view.h"

namespace isoscope::base {

// Immutable.
class TraceContext {
 public:
  // A new trace id of 128 random bits. Thread-safe.
  static TraceContext Random();
  // Parses a traceparent. Returns none if W3C says to ignore it: wrong length, capital letters, an
  // id of zeros, version ff. In later versions it reads the fields of version 00 alone.
  static std::optional<TraceContext> Parse(absl::string_view traceparent);
  // Parses a traceparent; returns a new identity if there is none to use.
  static TraceContext ParseOrRandom(absl::string_view traceparent);

  // The trace id: 32 hexadecimal digits in lower case, not all 0.
  [[nodiscard]] const std::string& request_id() const { return trace_id_; }
  // Returns the traceparent for a request to another process: same trace id, a new parent id.
  // Thread-safe.
  [[nodiscard]] std::string MakeTraceparent() const;

 private:
  TraceContext(std::string trace_id, bool is_sampled)
      : trace_id_(std::move(trace_id)), is_sampled_(is_sampled) {}

  std::string trace_id_;
  bool is_sampled_;
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_TRACE_CONTEXT_H_
