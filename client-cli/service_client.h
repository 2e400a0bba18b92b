// Isoscope's public services as blocking calls: the same over the network and in-process.

#ifndef ISOSCOPE_CLIENT_CLI_SERVICE_CLIENT_H_
#define ISOSCOPE_CLIENT_CLI_SERVICE_CLIENT_H_

#include <memory>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include "core/base/mutex.h"
#include "core/cli/interrupt.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"

namespace isoscope::cli {

// The time of a question that servers answer from memory or in one pass over the ranges of blocks.
// They take a minute at most.
inline constexpr absl::Duration kQuestionTimeout = absl::Minutes(2);
// The time of a frame or a pick, and the longest time in which a server sends nothing of an export.
// A server keeps a limit of its own, of minutes, and then says which agent is late. This one is for
// servers that fail to.
inline constexpr absl::Duration kAnswerTimeout = absl::Hours(1);

// A stream of InteractService, which has no deadline: it lasts as long as its viewer looks at it.
// One thread reads, any thread writes.
class InteractStream {
 public:
  InteractStream(const std::shared_ptr<grpc::Channel>& channel, const std::string& token);
  // Cancels a stream that has not ended.
  ~InteractStream();

  // Returns false once the stream has ended.
  bool Write(const isoscope::v1::InteractRequest& request) ABSL_LOCKS_EXCLUDED(write_mutex_);
  bool Read(isoscope::v1::InteractResponse* response) { return stream_->Read(response); }
  void Cancel() { context_.TryCancel(); }
  // Says that nothing more will be written. Read then returns false soon.
  void CloseWrites() ABSL_LOCKS_EXCLUDED(write_mutex_);
  // Returns the status of the service. REQUIRES: Read has returned false.
  absl::Status Finish();

 private:
  const std::unique_ptr<isoscope::v1::InteractService::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<
      grpc::ClientReaderWriter<isoscope::v1::InteractRequest, isoscope::v1::InteractResponse>>
      stream_;
  base::Mutex write_mutex_;
};

// Every call is part of the trace that the environment variable TRACEPARENT names (W3C Trace
// Context), if it does. Errors that servers' logs may explain end in the id of the request.
//
// Every call ends with DEADLINE_EXCEEDED after its `timeout`, and with CANCELLED on an interrupt.
// Thread-safe.
class ServiceClient {
 public:
  // `address`: for messages; "" for an in-process channel. `interrupt` must outlive the client.
  // `token`: goes with each call; empty: none.
  ServiceClient(std::shared_ptr<grpc::Channel> channel, std::string address, Interrupt* interrupt,
                std::string token);

  // Errors of the service; UNAVAILABLE says how to start a server if none is there.
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

  // Opens a stream.
  [[nodiscard]] std::unique_ptr<InteractStream> Interact() const {
    return std::make_unique<InteractStream>(channel_, token_);
  }

  // Calls `visit` for every chunk, in order; an error of it ends the call and is returned. A mesh
  // may take any time, and `timeout` be infinite, as long as chunks come: DEADLINE_EXCEEDED too if
  // none does for `max_silence`.
  absl::Status ExportIsosurface(
      const isoscope::v1::ExportIsosurfaceRequest& request, absl::Duration timeout,
      absl::FunctionRef<absl::Status(const isoscope::v1::ExportIsosurfaceResponse&)> visit,
      absl::Duration max_silence = kAnswerTimeout);

 private:
  // The error of a call; OK stays OK.
  absl::Status Explain(const grpc::Status& status, absl::Time deadline) const;
  // Makes one call: deadline, interrupt, errors.
  absl::Status Call(absl::Duration timeout,
                    absl::FunctionRef<grpc::Status(grpc::ClientContext*)> call) const;

  const std::shared_ptr<grpc::Channel> channel_;
  const std::string address_;
  Interrupt* const interrupt_;
  const std::string token_;
  const std::unique_ptr<isoscope::v1::IsosurfaceService::Stub> isosurface_;
  const std::unique_ptr<isoscope::v1::DatasetService::Stub> dataset_;
  const std::unique_ptr<isoscope::v1::ClusterService::Stub> cluster_;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SERVICE_CLIENT_H_
