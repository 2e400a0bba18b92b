// Isoscope's public services as blocking calls: the same over the network and in-process.
//
// This header declares messages and gRPC without including their headers, which compile slowly. A
// user of a message includes the message's header.

#ifndef ISOSCOPE_CLIENTS_CPP_CONNECTION_SERVICE_CLIENT_H_
#define ISOSCOPE_CLIENTS_CPP_CONNECTION_SERVICE_CLIENT_H_

#include <memory>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/monotonic_time.h"
#include "core/cli/interrupt.h"

namespace grpc {
class Channel;
class ClientContext;
class Status;
}  // namespace grpc

namespace isoscope::v1 {
class Dataset;
class ExportIsosurfaceRequest;
class ExportIsosurfaceResponse;
class GetCapabilitiesResponse;
class GetClusterStatusResponse;
class GetHistogramRequest;
class GetHistogramResponse;
class InteractRequest;
class InteractResponse;
class ListDatasetsResponse;
class PickSurfaceRequest;
class PickSurfaceResponse;
class RenderIsosurfaceRequest;
class RenderIsosurfaceResponse;
}  // namespace isoscope::v1

namespace isoscope::client {

class CoordinatorChannel;

// The time limit of a question that servers answer from memory or in one pass over the ranges of
// blocks. Servers need a minute at most.
inline constexpr absl::Duration kQuestionTimeout = absl::Minutes(2);
// The time limit of a frame or a pick, and the longest silence of a server during an export. A
// server has its own limit, of minutes, and then names the late agent. This one is for servers that
// fail to answer.
inline constexpr absl::Duration kAnswerTimeout = absl::Hours(1);

// A stream of InteractService, without a deadline: it lasts until its viewer closes it. One thread
// reads, any thread writes.
class InteractStream {
 public:
  // Cancels a stream that has not ended.
  virtual ~InteractStream() = default;

  // Returns false once the stream has ended.
  virtual bool Write(const isoscope::v1::InteractRequest& request) = 0;
  virtual bool Read(isoscope::v1::InteractResponse* response) = 0;
  virtual void Cancel() = 0;
  // Returns the status of the service. REQUIRES: Read has returned false.
  virtual absl::Status Finish() = 0;
};

// Every call belongs to the trace of the environment variable TRACEPARENT (W3C Trace Context), if
// it is set. Errors that servers' logs may explain end in the id of the request.
//
// Every call ends with DEADLINE_EXCEEDED after its `timeout`, and with CANCELLED on an interrupt.
// Thread-safe.
class ServiceClient {
 public:
  // `address`: for messages; "" for an in-process channel. `token`: sent with each call; empty:
  // none. `interrupt`: outlives the client, and needs no signal handler. Its Trigger() ends all
  // calls, including later ones. Null: calls end with their timeouts only.
  ServiceClient(std::shared_ptr<grpc::Channel> channel, std::string address,
                cli::Interrupt* interrupt, std::string token);
  ~ServiceClient();

  // For other users of the same coordinator.
  [[nodiscard]] const std::shared_ptr<grpc::Channel>& channel() const;

  // Errors of the service; UNAVAILABLE has advice on starting a server.
  absl::StatusOr<isoscope::v1::Dataset> GetDataset(const std::string& name, absl::Duration timeout);
  absl::StatusOr<isoscope::v1::GetHistogramResponse> GetHistogram(
      const isoscope::v1::GetHistogramRequest& request, absl::Duration timeout);
  absl::StatusOr<isoscope::v1::ListDatasetsResponse> ListDatasets(absl::Duration timeout);
  absl::StatusOr<isoscope::v1::GetCapabilitiesResponse> GetCapabilities(absl::Duration timeout);
  absl::StatusOr<isoscope::v1::GetClusterStatusResponse> GetClusterStatus(absl::Duration timeout);
  absl::StatusOr<isoscope::v1::RenderIsosurfaceResponse> RenderIsosurface(
      const isoscope::v1::RenderIsosurfaceRequest& request, absl::Duration timeout);

  // The same in parts, for large pictures and planes.
  absl::StatusOr<isoscope::v1::RenderIsosurfaceResponse> RenderIsosurfaceStream(
      const isoscope::v1::RenderIsosurfaceRequest& request, absl::Duration timeout);
  absl::StatusOr<isoscope::v1::PickSurfaceResponse> PickSurface(
      const isoscope::v1::PickSurfaceRequest& request, absl::Duration timeout);

  // Opens a stream. The client outlives it.
  [[nodiscard]] std::unique_ptr<InteractStream> Interact() const;

  // Calls `visit` for every chunk, in order; its error ends the call and is returned. A mesh may
  // take any time, so `timeout` may be infinite. DEADLINE_EXCEEDED also if nothing arrives for
  // `max_silence`, not even a sign of life, which `visit` does not get.
  absl::Status ExportIsosurface(
      const isoscope::v1::ExportIsosurfaceRequest& request, absl::Duration timeout,
      absl::FunctionRef<absl::Status(const isoscope::v1::ExportIsosurfaceResponse&)> visit,
      absl::Duration max_silence = kAnswerTimeout);

 private:
  // The error of a call; OK stays OK.
  absl::Status Explain(const grpc::Status& status, base::MonotonicTime deadline) const;
  // Makes one call: deadline, interrupt, errors.
  absl::Status Call(absl::Duration timeout,
                    absl::FunctionRef<grpc::Status(grpc::ClientContext*)> call) const;
  // Returns the answer of a stub's method, with the retries of Call.
  template <typename Response, typename Stub, typename Request>
  absl::StatusOr<Response> CallUnary(Stub* stub,
                                     grpc::Status (Stub::*method)(grpc::ClientContext*,
                                                                  const Request&, Response*),
                                     const Request& request, absl::Duration timeout) const;

  const std::unique_ptr<CoordinatorChannel> channel_;
  const base::Cancellation never_;  // stands in for an interrupt that is null
  const base::Cancellation& interrupt_;
};

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_SERVICE_CLIENT_H_
