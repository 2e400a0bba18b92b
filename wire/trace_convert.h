// The trace of a frame between core types and messages.
//
// All times come from monotonic clocks. An agent reports its times since `begin` arrived, and when
// it received and sent each message of its stream. The coordinator knows when it sent and received
// the same messages. So base::ClockAlignment gives it the difference of the clocks, by which it
// moves the agent's spans to its own axis. The times between sending and receiving become spans of
// the tracks "network in" and "network out". A message counts there from the arrival of the one
// before it, so that the spans of a track do not overlap.

#ifndef ISOSCOPE_WIRE_TRACE_CONVERT_H_
#define ISOSCOPE_WIRE_TRACE_CONVERT_H_

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "core/base/trace_recorder.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/trace.pb.h"

namespace isoscope::wire {

// When messages were sent and received, in their order.
struct MessageTimes {
  std::vector<base::TraceTime> sent;
  std::vector<base::TraceTime> received;
};

// `zero`: the zero of the axis.
isoscope::v1::ProcessTrace ToProto(const base::RecordedTrace& trace, base::TraceTime zero);

// The agent's side. `times`: its own.
isoscope::internal::v1::AgentTrace ToProto(const base::RecordedTrace& trace,
                                           const MessageTimes& times, base::TraceTime zero);

// The coordinator's side: the agent's spans on the axis with that zero. `times`: the coordinator's,
// of the same stream. A trace whose lists of messages do not fit is aligned by those that do.
isoscope::v1::ProcessTrace AlignAgentTrace(isoscope::internal::v1::AgentTrace trace,
                                           const MessageTimes& times, base::TraceTime zero,
                                           const std::string& agent_address);

// Drops and counts the last of all spans, by their begin, so that at most `max_spans` are left.
void KeepFirstSpans(std::size_t max_spans, isoscope::v1::ProcessTrace* trace);

// Returns how many spans each of the agents of a frame records, so that the traces that a
// coordinator gets are bounded.
inline std::size_t MaxSpansOfAgent(int agent_count) {
  constexpr std::size_t kOfAllAgents = 2 * base::TraceRecorder::kMaxSpans;
  constexpr std::size_t kLeast = 256;
  return std::clamp(kOfAllAgents / static_cast<std::size_t>(std::max(agent_count, 1)), kLeast,
                    base::TraceRecorder::kMaxSpans);
}

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_TRACE_CONVERT_H_
