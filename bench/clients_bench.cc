// 1. Prepare draws the picture once: every client must get the same bytes.
// 2. For each client count a round begins: every client is a thread with a connection of its own.
// 3. All begin together. Frames count if they end after the warm-up and before the end of the
//    round, so that those under way at either end are counted evenly.
// 4. A refused client retries after the server's delay; refusals and retries are counted.

#include "bench/clients_bench.h"

#include <algorithm>
#include <atomic>
#include <memory>
#include <thread>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include <nlohmann/json.hpp>

#include "bench/sample_statistics.h"
#include "client-cli/session/connection_flags.h"
#include "clients/cpp/connection/retries.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/request/json_text.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/cli/interrupt.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "rpc/channel.h"
#include "rpc/transport.h"

namespace isoscope::bench {
namespace {

namespace v1 = isoscope::v1;

constexpr absl::Duration kMaxClientsWait = absl::Minutes(2);

// The record of one client. Its thread alone writes it; it is read after that has ended.
struct ClientLog {
  std::unique_ptr<client::ServiceClient> client;
  std::vector<double> times_ms;  // of the frames that count
  std::int64_t wrong_count = 0;
  std::int64_t failed_count = 0;
  std::string first_error;
};

class ClientsBench {
 public:
  ClientsBench(const ClientsBenchPlan& plan, const cli::Context& context)
      : plan_(plan), context_(context) {}

  absl::StatusOr<std::vector<ClientsRound>> Run() {
    ISOSCOPE_RETURN_IF_ERROR(Prepare());
    std::vector<ClientsRound> rounds;
    for (const int count : plan_.client_counts) {
      ISOSCOPE_ASSIGN_OR_RETURN(ClientsRound round, RunRound(count));
      rounds.push_back(std::move(round));
    }
    return rounds;
  }

 private:
  [[nodiscard]] std::unique_ptr<client::ServiceClient> Connect() const {
    const std::string& address = *plan_.session.server;
    return std::make_unique<client::ServiceClient>(rpc::MakeFreshChannel(address, dialing_),
                                                   address, context_.interrupt, token_);
  }

  // Makes the request, and draws the picture that all clients must get.
  absl::Status Prepare() {
    const cli::ConnectionFlags& connection = plan_.session.connection;
    ISOSCOPE_ASSIGN_OR_RETURN(token_, cli::ReadToken(connection, *plan_.session.server));
    ISOSCOPE_ASSIGN_OR_RETURN(dialing_, rpc::MakeDialing(connection.transport, /*own_role=*/""));
    const std::unique_ptr<client::ServiceClient> client = Connect();
    ISOSCOPE_ASSIGN_OR_RETURN(
        const Scene scene,
        FindScene(plan_.request, plan_.session.dataset.value_or(""), client.get()));
    request_ = scene.Frame();
    ISOSCOPE_ASSIGN_OR_RETURN(v1::RenderIsosurfaceResponse response,
                              client->RenderIsosurface(request_, kMaxClientsWait));
    expected_ = std::move(*response.mutable_png());
    return absl::OkStatus();
  }

  absl::StatusOr<ClientsRound> RunRound(int count) {
    std::vector<ClientLog> logs(static_cast<std::size_t>(count));
    for (ClientLog& log : logs) {
      log.client = Connect();
    }
    const client::RetryCounts before = client::CountRetries();
    const base::MonotonicTime begin = base::MonotonicNow() + plan_.warm_up;
    const base::MonotonicTime end = begin + plan_.duration;
    std::vector<std::thread> threads;
    threads.reserve(logs.size());
    for (ClientLog& log : logs) {
      threads.emplace_back([this, begin, end, &log] { Ask(begin, end, &log); });
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
    ISOSCOPE_RETURN_IF_ERROR(context_.interrupt->cancellation().Check());
    ClientsRound round = Summarize(logs);
    round.refusal_count = client::CountRetries().refusals - before.refusals;
    round.retry_count = client::CountRetries().retries - before.retries;
    return round;
  }

  void Ask(base::MonotonicTime begin, base::MonotonicTime end, ClientLog* log) {
    while (!context_.interrupt->cancellation().is_cancelled()) {
      const base::MonotonicTime start = base::MonotonicNow();
      if (start >= end) {
        return;
      }
      const absl::StatusOr<v1::RenderIsosurfaceResponse> response =
          log->client->RenderIsosurface(request_, kMaxClientsWait);
      const base::MonotonicTime done = base::MonotonicNow();
      if (!response.ok()) {
        if (log->failed_count++ == 0) {
          log->first_error = response.status().ToString();
        }
        absl::SleepFor(absl::Milliseconds(100));  // limits the rate of immediate errors
        continue;
      }
      log->wrong_count += response->png() == expected_ ? 0 : 1;
      if (done >= begin && done < end) {
        log->times_ms.push_back(absl::ToDoubleMilliseconds(done - start));
      }
    }
  }

  [[nodiscard]] ClientsRound Summarize(const std::vector<ClientLog>& logs) const {
    ClientsRound round;
    round.client_count = static_cast<int>(logs.size());
    std::vector<double> times;
    for (const ClientLog& log : logs) {
      const auto frames = static_cast<std::int64_t>(log.times_ms.size());
      times.insert(times.end(), log.times_ms.begin(), log.times_ms.end());
      round.most_frames = std::max(round.most_frames, frames);
      round.least_frames = &log == &logs.front() ? frames : std::min(round.least_frames, frames);
      round.wrong_count += log.wrong_count;
      round.failed_count += log.failed_count;
      if (round.first_error.empty()) {
        round.first_error = log.first_error;
      }
    }
    round.frame_count = static_cast<std::int64_t>(times.size());
    round.frames_per_second =
        static_cast<double>(times.size()) / absl::ToDoubleSeconds(plan_.duration);
    round.p50_ms = Percentile(times, 0.5);
    round.p95_ms = Percentile(times, 0.95);
    round.p99_ms = Percentile(times, 0.99);
    round.max_ms = Percentile(times, 1);
    return round;
  }

  const ClientsBenchPlan& plan_;
  const cli::Context& context_;
  std::string token_;
  rpc::Dialing dialing_;
  v1::RenderIsosurfaceRequest request_;
  std::string expected_;
};

}  // namespace

absl::StatusOr<std::vector<ClientsRound>> RunClientsBench(const ClientsBenchPlan& plan,
                                                          const cli::Context& context) {
  return ClientsBench(plan, context).Run();
}

std::string DescribeClientsBench(const std::vector<ClientsRound>& rounds) {
  std::string text = absl::StrFormat("%7s %9s %9s %9s %9s %9s %15s %9s %9s %6s %6s\n", "clients",
                                     "frames/s", "p50 ms", "p95 ms", "p99 ms", "max ms",
                                     "a client got", "refusals", "retries", "wrong", "failed");
  for (const ClientsRound& round : rounds) {
    absl::StrAppendFormat(
        &text, "%7d %9.1f %9.0f %9.0f %9.0f %9.0f %15s %9d %9d %6d %6d\n", round.client_count,
        round.frames_per_second, round.p50_ms, round.p95_ms, round.p99_ms, round.max_ms,
        absl::StrCat(round.least_frames, " to ", round.most_frames), round.refusal_count,
        round.retry_count, round.wrong_count, round.failed_count);
  }
  for (const ClientsRound& round : rounds) {
    if (!round.first_error.empty()) {
      absl::StrAppend(&text, round.client_count, " clients, first error: ", round.first_error,
                      "\n");
    }
  }
  return text;
}

std::string ClientsBenchJson(const Occasion& occasion, const ClientsBenchPlan& plan,
                             const std::vector<ClientsRound>& rounds) {
  nlohmann::ordered_json json = JsonHead(occasion);
  json["server"] = plan.session.server.value_or("");
  json["isovalues"] = plan.request.isovalues();
  AddSize(plan.request, &json);
  json["seconds"] = absl::ToDoubleSeconds(plan.duration);
  json["rounds"] = nlohmann::ordered_json::array();
  for (const ClientsRound& round : rounds) {
    json["rounds"].push_back({{"clients", round.client_count},
                              {"frames", round.frame_count},
                              {"frames_per_second", round.frames_per_second},
                              {"p50_ms", round.p50_ms},
                              {"p95_ms", round.p95_ms},
                              {"p99_ms", round.p99_ms},
                              {"max_ms", round.max_ms},
                              {"most_frames", round.most_frames},
                              {"least_frames", round.least_frames},
                              {"refusals", round.refusal_count},
                              {"retries", round.retry_count},
                              {"wrong", round.wrong_count},
                              {"failed", round.failed_count}});
  }
  return client::JsonText(json);
}

}  // namespace isoscope::bench
