// Requests of HTTP on one thread of the process: libcurl's multi interface, one pool of connections,
// HTTP/2 where a server has it.
//
//   caller                        engine's thread
//   TransferGroup::Start     ->   queued; begins when its host has a place
//                                 TransferSink::OnHead, OnBytes, ...
//   TransferGroup::Await     <-   TransferResult
//   ~TransferGroup           ->   what is left is broken off
//
// A transfer is one request and its answer: redirects, retries and credentials are its caller's. A
// caller that leaves is gone at once: it takes its sink away under the lock that the engine's thread
// holds while it calls a sink, and does not wait for libcurl (which may wait for a name server).
//
// Every transfer ends: connecting, the headers and each stretch of the body have a time of their own.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_TRANSFER_ENGINE_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_TRANSFER_ENGINE_H_

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/monotonic_time.h"
#include "core/source/remote/secret.h"

namespace isoscope::source {

struct TransferRequest {
  Secret url;                   // its query may hold a signature
  std::string origin;           // whose places are counted
  std::vector<Secret> headers;  // "Name: value"
  int max_per_origin = 1;       // transfers of this origin at a time
  // With TLS: waits for the first connection, which tells whether it takes all requests (HTTP/2). Else
  // each opens one of its own at once, which is quicker where a server has HTTP/1.1 alone.
  bool awaits_multiplexing = true;
  absl::Duration connect_timeout = absl::Seconds(10);
  absl::Duration head_timeout = absl::Seconds(60);
  absl::Duration stall_timeout = absl::Seconds(30);
  std::int64_t stall_bytes = 1;
  std::string ca_file;
  std::optional<std::string> proxy;
};

// The status and the headers of an answer.
struct ResponseHead {
  int status = 0;
  std::map<std::string, std::string> headers;  // names in lower case

  // Empty if there is none.
  [[nodiscard]] std::string Header(const char* name) const {
    const auto found = headers.find(name);
    return found == headers.end() ? "" : found->second;
  }
};

// Takes an answer, on the engine's thread. An error ends the transfer at once, and closes its
// connection. Must not block.
class TransferSink {
 public:
  virtual ~TransferSink() = default;
  virtual absl::Status OnHead(const ResponseHead& head) = 0;  // once, of any final status
  virtual absl::Status OnBytes(absl::string_view bytes) = 0;
};

struct TransferResult {
  enum class Outcome {
    kComplete,  // the answer came as it was announced
    kStopped,   // the sink's own error: status
    kBroken,    // the network, or a server that ended early: another attempt may work
    kFailed,    // no other attempt will work: a certificate, a forbidden address
  };
  Outcome outcome = Outcome::kComplete;
  absl::Status status = {};  // its message names no address: that is the caller's
};

class TransferEngine;

// The transfers of one caller. Thread-compatible.
class TransferGroup {
 public:
  struct Finished {
    std::size_t id = 0;
    TransferResult result = {};
  };

  explicit TransferGroup(std::shared_ptr<TransferEngine> engine);
  // Breaks off what is left; no sink is called from then on. Does not wait.
  ~TransferGroup();
  TransferGroup(const TransferGroup&) = delete;
  TransferGroup& operator=(const TransferGroup&) = delete;

  // `sink` lives until the transfer has finished, or the group ends. REQUIRES: no transfer with this
  // id is under way.
  void Start(std::size_t id, TransferRequest request, TransferSink* sink);
  // Waits for a result, at most until `until`: then it is none. The cancellation's error once it has
  // fired, at once.
  absl::StatusOr<std::optional<Finished>> Await(const base::Cancellation& cancellation,
                                                base::MonotonicTime until);
  [[nodiscard]] std::size_t running_count() const { return running_.size(); }

 private:
  friend class TransferEngine;
  struct Mailbox;
  struct Transfer;

  // Breaks off one transfer.
  void Abandon(std::size_t id);

  const std::shared_ptr<TransferEngine> engine_;
  const std::shared_ptr<Mailbox> mailbox_;
  std::map<std::size_t, std::shared_ptr<Transfer>> running_;
};

// Thread-safe.
class TransferEngine {
 public:
  // The engine of this process; its thread begins at the first call, and is joined when the process
  // exits.
  static std::shared_ptr<TransferEngine> OfProcess();

  TransferEngine();
  // Breaks off all transfers, and joins the thread.
  ~TransferEngine();
  TransferEngine(const TransferEngine&) = delete;
  TransferEngine& operator=(const TransferEngine&) = delete;

 private:
  friend class TransferGroup;
  class Loop;

  void Submit(std::shared_ptr<TransferGroup::Transfer> transfer);
  void Cancel(std::shared_ptr<TransferGroup::Transfer> transfer);

  const std::unique_ptr<Loop> loop_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_TRANSFER_ENGINE_H_
