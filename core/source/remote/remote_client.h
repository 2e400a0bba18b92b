// Requests for objects: the URL of an address, and the credentials that belong to it.
//
//   s3://BUCKET/KEY   https://BUCKET.s3.REGION.amazonaws.com/KEY, signed, or an endpoint's own URL
//   https://...       with a token or a password where the options name the host
//
// Credentials go to the host that they are for. They follow no redirect to another host.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_REMOTE_CLIENT_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_REMOTE_CLIENT_H_

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"

#include "core/base/mutex.h"
#include "core/source/remote/address.h"
#include "core/source/remote/remote_options.h"
#include "core/source/remote/transfer_engine.h"

namespace isoscope::source {

struct RequestSpec {
  Address address;
  std::vector<std::pair<std::string, std::string>> query = {};  // of S3: not encoded
  std::string range = {};                                       // "bytes=0-9"; empty: all
  std::string if_match = {};       // an ETag with its quotes; empty: any
  bool allows_credentials = true;  // false behind a redirect
};

struct PreparedRequest {
  TransferRequest transfer;
  Address url;  // of HTTP
  enum class Credentials { kNone, kSignature, kToken, kPassword };
  Credentials credentials = Credentials::kNone;
};

// Thread-safe.
class RemoteClient {
 public:
  RemoteClient(RemoteOptions options, std::shared_ptr<TransferEngine> engine)
      : options_(std::move(options)), engine_(std::move(engine)) {}

  // Signs with the time of now, so it is called when the request begins. FAILED_PRECONDITION and
  // NOT_FOUND for credentials that can't be read; s3.problem.
  [[nodiscard]] absl::StatusOr<PreparedRequest> Prepare(const RequestSpec& spec) const;

  // AWS told that a bucket lies in `region`. Returns true if later requests for it differ.
  bool LearnRegion(const std::string& bucket, const std::string& region);

  [[nodiscard]] const RemoteOptions& options() const { return options_; }
  [[nodiscard]] const std::shared_ptr<TransferEngine>& engine() const { return engine_; }

 private:
  // The address of HTTP that stands for one of S3.
  [[nodiscard]] absl::StatusOr<Address> UrlOfS3(const Address& address,
                                                const std::string& region) const;
  [[nodiscard]] std::string RegionOf(const std::string& bucket) const;
  absl::Status AddHttpCredentials(PreparedRequest* request) const;

  const RemoteOptions options_;
  const std::shared_ptr<TransferEngine> engine_;
  mutable base::Mutex mutex_;
  std::map<std::string, std::string> region_of_bucket_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_REMOTE_CLIENT_H_
