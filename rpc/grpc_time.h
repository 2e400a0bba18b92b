// Lets gRPC take moments of the monotonic clock: deadlines of calls, alarms, and shutdowns.
//
//   context.set_deadline(base::MonotonicNow() + absl::Seconds(2));
//   alarm.Set(time, [](bool rang) { ... });
//
// Without this header such a call does not compile.

#ifndef ISOSCOPE_RPC_GRPC_TIME_H_
#define ISOSCOPE_RPC_GRPC_TIME_H_

#include "absl/time/time.h"
#include <grpc/support/time.h>
#include <grpcpp/support/time.h>

#include "core/base/monotonic_time.h"

namespace isoscope::rpc {

// In gRPC's monotonic clock. An infinite moment stays infinite.
inline gpr_timespec ToGrpcTime(base::MonotonicTime time) {
  if (time == base::MonotonicTime::InfiniteFuture()) {
    return gpr_inf_future(GPR_CLOCK_MONOTONIC);
  }
  if (time == base::MonotonicTime::InfinitePast()) {
    return gpr_inf_past(GPR_CLOCK_MONOTONIC);
  }
  // gRPC does not say where its clock begins.
  const gpr_timespec left =
      gpr_time_from_nanos(absl::ToInt64Nanoseconds(time - base::MonotonicNow()), GPR_TIMESPAN);
  return gpr_time_add(gpr_now(GPR_CLOCK_MONOTONIC), left);
}

// `time`: of any of gRPC's clocks. An infinite one stays infinite.
inline base::MonotonicTime FromGrpcTime(gpr_timespec time) {
  if (gpr_time_cmp(time, gpr_inf_future(time.clock_type)) == 0) {
    return base::MonotonicTime::InfiniteFuture();
  }
  if (gpr_time_cmp(time, gpr_inf_past(time.clock_type)) == 0) {
    return base::MonotonicTime::InfinitePast();
  }
  const gpr_timespec left =
      gpr_time_sub(gpr_convert_clock_type(time, GPR_CLOCK_MONOTONIC), gpr_now(GPR_CLOCK_MONOTONIC));
  return base::MonotonicNow() + absl::Seconds(left.tv_sec) + absl::Nanoseconds(left.tv_nsec);
}

}  // namespace isoscope::rpc

// gRPC's way to take further types as times.
template <>
class grpc::TimePoint<isoscope::base::MonotonicTime> {
 public:
  // NOLINTNEXTLINE(google-explicit-constructor): gRPC's functions convert by it
  TimePoint(isoscope::base::MonotonicTime time) : time_(isoscope::rpc::ToGrpcTime(time)) {}
  // NOLINTNEXTLINE(readability-identifier-naming): gRPC's functions call it
  [[nodiscard]] gpr_timespec raw_time() const { return time_; }

 private:
  const gpr_timespec time_;
};

#endif  // ISOSCOPE_RPC_GRPC_TIME_H_
