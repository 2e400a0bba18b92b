// The trace of a frame as a file that Perfetto (ui.perfetto.dev) and chrome://tracing open:
// Chrome's trace events in JSON.
//
// Each process of the trace is a process of the file, each track a thread, each span a complete
// event ("X"); times are microseconds on one axis. The client is a process of its own. Its clock
// tells when it sent the request and had the answer, and nothing bounds it better, so the
// coordinator's axis is put into the middle: half of the rest is taken for either way.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_TRACE_FILE_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_TRACE_FILE_H_

#include <string>

#include "absl/time/time.h"

#include "isoscope/v1/trace.pb.h"

namespace isoscope::cli {

// client_duration: from sending the request to having the answer.
std::string TraceToJson(const isoscope::v1::FrameTrace& trace, absl::Duration client_duration);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_TRACE_FILE_H_
