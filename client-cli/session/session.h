// The input of `render` and `export`, opened: a source volume, a dataset directory or a server.
//
// 1. CheckUsage checks that exactly one input is given, with flags that fit it.
// 2. PrepareInput partitions a source volume into the cache, and locks the entry while it is used.
// 3. Session::Open starts an embedded cluster on the dataset, or connects to the server.

#ifndef ISOSCOPE_CLIENT_CLI_SESSION_SESSION_H_
#define ISOSCOPE_CLIENT_CLI_SESSION_SESSION_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "client-cli/session/connection_flags.h"
#include "client-cli/session/dataset_cache.h"
#include "client-cli/session/source_flags.h"
#include "client-cli/session/wanted_volumes.h"
#include "clients/cpp/request/selection_flags.h"
#include "core/cli/command.h"
#include "core/cli/flag_set.h"
#include "core/render/renderer_kind.h"
#include "core/view/camera.h"
#include "isoscope/v1/dataset.pb.h"

namespace grpc {  // NOLINT(readability-identifier-naming): theirs
class Channel;
}  // namespace grpc

namespace isoscope::client {
class ServiceClient;
}  // namespace isoscope::client

namespace isoscope::cli {

class EmbeddedCluster;

struct SessionFlags {
  std::optional<std::string> input;      // source volume or dataset directory
  std::vector<std::string> more_inputs;  // served with it; the flags of a source are for all
  std::optional<std::string> server;     // HOST:PORT
  ConnectionFlags connection;            // for the server
  std::optional<std::string> dataset;
  SourceFlags source;
  std::optional<std::int64_t> shard_count;
  std::optional<std::int64_t> thread_count;
  std::optional<std::int64_t> memory_limit_bytes;
  std::optional<std::int64_t> cache_limit_bytes;
  std::optional<render::RendererKind> renderer;
  std::optional<absl::Duration> timeout;
  bool is_verbose = false;
  // Not a flag: EmbeddedClusterOptions::expected_layers.
  int expected_layers = 0;
  // Not a flag: EmbeddedClusterOptions::draws_once.
  bool draws_once = false;
};

// Register the flags of an input, or of an input, a server and drawing here. `flags` must outlive
// the parsing.
void AddInputFlags(FlagSet* set, SessionFlags* flags, const SourceFlagNames& names = {});
// `names` as AddSourceFlags has it.
void AddSessionFlags(FlagSet* set, SessionFlags* flags, const SourceFlagNames& names = {});
// Registers --cache-limit.
void AddCacheLimitFlag(FlagSet* set, std::optional<std::int64_t>* limit_bytes);
// Registers --renderer, which only `render` has.
void AddRendererFlag(FlagSet* set, SessionFlags* flags);

// UsageError if not exactly one of input and server is given, or if flags do not fit that one.
absl::Status CheckUsage(const SessionFlags& flags);

// NOT_FOUND if the input is neither a dataset folder nor a source. Other errors are left to
// PrepareInput. For messages: whoever mistyped a path need not hear first that a flag is missing.
absl::Status CheckInputExists(const SessionFlags& flags);

// Returns the dataset directory of flags.input: itself, or the cache entry of a source, which is
// partitioned first if needed. The entry of a source of several volumes has the `wanted` ones;
// null: all. Says on standard error what a dataset directory lacks, and what is taken of a source
// without a choice. UsageError if --shards differs from the dataset's. Other errors as
// source::OpenIdentified, ChooseVolumes and partition::Partition.
absl::StatusOr<CachedDataset> PrepareInput(const SessionFlags& flags, const WantedVolumes* wanted,
                                           const Context& context);

// Requests frames of one dataset. Thread-safe.
class Session {
 public:
  // Connects to a server, or starts an embedded cluster for dataset directories or sources, as
  // PrepareInput. Memory is allocated early for frames of `expected_viewport`; null: none are
  // expected. UsageError if two inputs are datasets of one name. Other errors as PrepareInput and
  // EmbeddedCluster::Start.
  static absl::StatusOr<std::unique_ptr<Session>> Open(
      const SessionFlags& flags, const WantedVolumes* wanted,
      const std::optional<view::Viewport>& expected_viewport, const Context& context);

  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  // Lives as long as the session.
  client::ServiceClient& client() { return *client_; }
  // The client's channel, for other users of the same coordinator.
  [[nodiscard]] const std::shared_ptr<grpc::Channel>& channel() const;
  // The token that the client sends to the server; empty: none.
  [[nodiscard]] const std::string& token() const { return token_; }
  // Name of the dataset in requests, that of the first input; "" is the only one of the cluster.
  [[nodiscard]] const std::string& dataset_name() const { return dataset_name_; }
  // The description of the dataset. NOT_FOUND suggests a name of the server that is near.
  [[nodiscard]] absl::StatusOr<isoscope::v1::Dataset> GetDataset();
  // Takes out what chooses the only volume of a source: its dataset has neither fields nor steps.
  // That the choice is right was checked when the source was opened.
  void AdaptSelection(client::SelectionFlags* selection) const;
  // The status of the command, or that with a hint if files of the cache were damaged: then the
  // next call makes them anew.
  absl::Status Finish(const absl::Status& status);
  // Sets a web gateway's address for GetCapabilities, if the coordinator is in this process.
  // Otherwise its operator does that.
  void SetGatewayAddress(const std::string& address);
  // Time limits of requests: --timeout for each of them. Without it a question has
  // kQuestionTimeout.
  [[nodiscard]] absl::Duration question_timeout() const;
  // Without --timeout a frame or a pick has the limit of the coordinator in this process, or
  // kAnswerTimeout: then the server's own limit applies, too.
  [[nodiscard]] absl::Duration frame_timeout() const { return timeout_.value_or(frame_timeout_); }
  // Without --timeout an export has none, because a mesh may take any time. ServiceClient ends it
  // if no data comes.
  [[nodiscard]] absl::Duration export_timeout() const {
    return timeout_.value_or(absl::InfiniteDuration());
  }

 private:
  Session();

  // Prepares flags.more_inputs, and names the dataset of the first input.
  absl::Status PrepareMore(const SessionFlags& flags, const WantedVolumes* wanted,
                           const Context& context);

  CachedDataset dataset_;  // its lock outlives the cluster, as those of the others
  std::vector<CachedDataset> more_datasets_;
  std::unique_ptr<EmbeddedCluster> cluster_;  // null with a server
  std::unique_ptr<client::ServiceClient> client_;
  std::string token_;
  std::string dataset_name_;
  std::optional<absl::Duration> timeout_;
  absl::Duration frame_timeout_;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_SESSION_SESSION_H_
