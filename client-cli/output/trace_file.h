// The trace of a frame as a file that Perfetto (ui.perfetto.dev) and chrome://tracing open:
// Chrome's trace events in JSON.
//
// Each process of the trace is a process of the file, each track a thread, each span a complete
// event ("X"); times are microseconds on one axis. The client is a process of its own. Only the
// times of its request and answer bound the coordinator's axis. So that axis is centred: the
// network takes half of the rest in each direction.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_TRACE_FILE_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_TRACE_FILE_H_

#include <string>

#include "absl/time/time.h"

#include "isoscope/v1/trace.pb.h"

namespace isoscope::cli {

// client_duration: from sending the request to receiving the answer.
std::string TraceToJson(const isoscope::v1::FrameTrace& trace, absl::Duration client_duration);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_TRACE_FILE_H_
