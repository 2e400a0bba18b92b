// The identity of a request on its way through processes, as W3C Trace Context has it:
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
  // That of a traceparent; none if W3C says to ignore it: wrong length, capital letters, an id of
  // zeros, version ff. Of later versions it takes what version 00 has.
  static std::optional<TraceContext> Parse(absl::string_view traceparent);
  // That of a traceparent, or a new one.
  static TraceContext ParseOrRandom(absl::string_view traceparent);

  // The trace id: 32 hexadecimal digits in lower case, not all 0.
  [[nodiscard]] const std::string& request_id() const { return trace_id_; }
  // The traceparent for a process that this one asks: same trace id, a new parent id. Thread-safe.
  [[nodiscard]] std::string MakeTraceparent() const;

 private:
  TraceContext(std::string trace_id, bool is_sampled)
      : trace_id_(std::move(trace_id)), is_sampled_(is_sampled) {}

  std::string trace_id_;
  bool is_sampled_;
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_TRACE_CONTEXT_H_
