// Timed waits of abseil, which end by the monotonic clock once this is linked.
//
// The absl::CondVar of Debian's abseil waits until a date. So a wait that began before somebody set
// the clock back by an hour would take an hour more. gRPC's timers wait so: deadlines, alarms,
// keepalive, and its looks at files of certificates. Our own code waits with base::CondVar.
//
// abseil lets a program replace the function that a thread waits in. absl_waits.cc does.

#ifndef ISOSCOPE_CORE_BASE_ABSL_WAITS_H_
#define ISOSCOPE_CORE_BASE_ABSL_WAITS_H_

namespace isoscope::base {

// Whether abseil waits by the monotonic clock in this process. A call of this links the function.
bool AreAbslWaitsMonotonic();

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_ABSL_WAITS_H_
