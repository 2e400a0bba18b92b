// A connection is one Scraper, which owns itself through the callbacks of its stream:
//
//   Read -> OnHeader -> Answer -> Write -> Read, until the peer or the server ends it -> Close
//
// Connections limits them: a place from TryAdd on, and work from BeginWork to EndWork. The text is
// Prometheus' format 0.0.4:
//
//   # HELP isoscope_frames_total Frames by outcome.
//   # TYPE isoscope_frames_total counter
//   isoscope_frames_total{outcome="done"} 17

#include "core/http/metrics_server.h"

#include <array>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/time/time.h"

#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/http/connections.h"
#include "core/http/peer_address.h"
#include "core/http/peer_listener.h"
#include "core/http/request_rules.h"

namespace isoscope::http {
namespace {

constexpr int kThreads = 2;
constexpr ConnectionLimits kLimits = {
    .max_count = 16, .max_entering = 16, .max_strangers = 16, .max_of_address = 8};
constexpr absl::Duration kHeaderTimeout = absl::Seconds(10);
constexpr absl::Duration kIdleTimeout = absl::Minutes(5);  // longer than between two scrapes
constexpr absl::Duration kWriteTimeout = absl::Seconds(20);
constexpr absl::Duration kDrainTime = absl::Seconds(1);
constexpr absl::Duration kCloseGrace = absl::Seconds(5);

const char* NameOf(base::MetricFamily::Type type) {
  switch (type) {
    case base::MetricFamily::Type::kCounter:
      return "counter";
    case base::MetricFamily::Type::kGauge:
      return "gauge";
    case base::MetricFamily::Type::kHistogram:
      return "histogram";
  }
  return "untyped";
}

// The shortest text that is read back as this number.
std::string NumberText(double value) {
  if (value == std::numeric_limits<double>::infinity()) {
    return "+Inf";
  }
  std::array<char, 32> text{};
  const std::to_chars_result end = std::to_chars(text.data(), text.data() + text.size(), value);
  return std::string(text.data(), end.ptr);
}

// `{name="value",...}`; empty without labels.
std::string LabelsText(const base::MetricLabels& labels) {
  std::string text;
  for (const auto& [name, value] : labels) {
    absl::StrAppend(&text, text.empty() ? "{" : ",", name, "=\"",
                    absl::StrReplaceAll(value, {{"\\", "\\\\"}, {"\"", "\\\""}, {"\n", "\\n"}}),
                    "\"");
  }
  return text.empty() ? text : text + "}";
}

void AppendHistogram(const std::string& name, const base::MetricSample& sample, std::string* text) {
  const std::vector<std::int64_t>& counts = sample.cumulative_counts;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    base::MetricLabels labels = sample.labels;
    labels.emplace_back("le", NumberText(i < base::DurationHistogram::kBounds.size()
                                             ? base::DurationHistogram::kBounds[i]
                                             : std::numeric_limits<double>::infinity()));
    absl::StrAppend(text, name, "_bucket", LabelsText(labels), " ", counts[i], "\n");
  }
  const std::string labels = LabelsText(sample.labels);
  absl::StrAppend(text, name, "_count", labels, " ", counts.empty() ? 0 : counts.back(), "\n");
  absl::StrAppend(text, name, "_sum", labels, " ", NumberText(sample.value), "\n");
}

// One connection: scrapes one after the other. Runs on the strand of its stream.
class Scraper : public std::enable_shared_from_this<Scraper> {
 public:
  Scraper(std::shared_ptr<PeerStream> stream, std::shared_ptr<Connections::Lease> lease,
          const base::CollectMetrics* collect)
      : stream_(std::move(stream)), lease_(std::move(lease)), collect_(*collect) {}

  void Run() {
    stream_->Post([self = shared_from_this()] {
      self->lease_->SetCloser([weak = self->weak_from_this()](bool at_once) {
        if (const std::shared_ptr<Scraper> scraper = weak.lock()) {
          scraper->stream_->Post([scraper, at_once] { scraper->End(at_once); });
        }
      });
      self->Read(kHeaderTimeout);
    });
  }

 private:
  void End(bool at_once) {
    is_ending_ = true;
    if (at_once || is_reading_) {
      stream_->CloseSocket();
    }
  }

  void Read(absl::Duration idle_timeout) {
    if (is_ending_) {
      Close();
      return;
    }
    is_reading_ = true;
    stream_->ReadHeader(idle_timeout, kHeaderTimeout,
                        [self = shared_from_this()](ReadError error, const std::string& message) {
                          self->is_reading_ = false;
                          self->OnHeader(error, message);
                        });
  }

  void OnHeader(ReadError error, const std::string& message) {
    if (error == ReadError::kEnd) {
      Close();
      return;
    }
    const PeerRequest& request = *stream_->request();
    has_unread_bytes_ = error != ReadError::kNone || request.has_body;
    is_ending_ = is_ending_ || has_unread_bytes_ || !request.keeps_alive;
    if (error != ReadError::kNone) {
      Write(400, absl::StrCat("this is no HTTP/1.1: ", message, "\n"));
    } else if (const std::optional<Refusal> refusal = CheckRequest(request)) {
      is_ending_ = true;
      Write(refusal->status, absl::StrCat(refusal->reason, "\n"));
    } else if (request.method != "GET" && request.method != "HEAD") {
      Write(405, "only GET and HEAD\n");
    } else if (WithoutQuery(WithoutHost(request.target)) != "/metrics") {
      Write(404, "there is only /metrics here\n");
    } else {
      Answer();
    }
  }

  static std::string WithoutQuery(const std::string& target) {
    return target.substr(0, target.find('?'));
  }

  void Answer() {
    switch (lease_->BeginWork(Caller::kStranger, PeerKey(stream_->RemoteAddress()))) {
      case Placement::kTaken:
        Write(200, MetricsText(collect_()));
        return;
      case Placement::kDropped:
        Close();
        return;
      case Placement::kFull:
      case Placement::kAddressFull:
        is_ending_ = true;
        Write(503, "too many scrapes are in work\n");
        return;
    }
  }

  void Write(int status, std::string body) {
    PeerAnswer answer{.status = status};
    answer.fields = {{"Content-Type", status == 200 ? "text/plain; version=0.0.4; charset=utf-8"
                                                    : "text/plain; charset=utf-8"},
                     {"Content-Length", absl::StrCat(body.size())},
                     {"Cache-Control", "no-store"},
                     {"X-Content-Type-Options", "nosniff"}};
    if (status == 405) {
      answer.fields.emplace_back("Allow", "GET, HEAD");
    }
    if (is_ending_) {
      answer.fields.emplace_back("Connection", "close");
    }
    if (stream_->request()->method != "HEAD") {
      answer.body = std::move(body);
    }
    stream_->WriteAnswer(std::move(answer), {.piece_timeout = kWriteTimeout},
                         [self = shared_from_this()](bool is_ok) {
                           if (is_ok && !self->is_ending_) {
                             self->lease_->EndWork();
                             self->Read(kIdleTimeout);
                           } else {
                             self->Close();
                           }
                         });
  }

  void Close() {
    stream_->End(has_unread_bytes_, kDrainTime,
                 [self = shared_from_this()] { self->lease_ = nullptr; });
  }

  const std::shared_ptr<PeerStream> stream_;
  std::shared_ptr<Connections::Lease> lease_;
  const base::CollectMetrics& collect_;
  bool is_reading_ = false;
  bool is_ending_ = false;
  bool has_unread_bytes_ = false;
};

struct Endpoint {
  std::string host;  // without brackets
  std::string port;
  std::string address;  // both, as a URL has them
};

absl::StatusOr<Endpoint> ParseListen(absl::string_view listen) {
  const absl::string_view::size_type colon = listen.rfind(':');
  const absl::string_view port =
      colon == absl::string_view::npos ? listen : listen.substr(colon + 1);
  std::string host(colon == absl::string_view::npos ? "" : listen.substr(0, colon));
  if (host.empty() || host == "localhost") {
    host = "127.0.0.1";
  }
  const bool is_bracketed = host.size() > 2 && host.front() == '[' && host.back() == ']';
  constexpr int kMaxPort = 65535;
  int number = 0;
  if (port.empty() || !absl::SimpleAtoi(port, &number) || number < 0 || number > kMaxPort ||
      absl::StrContains(host, ',') || (absl::StrContains(host, ':') && !is_bracketed)) {
    return absl::InvalidArgumentError(
        absl::StrCat("--metrics-listen is '", listen,
                     "': must be HOST:PORT, such as 0.0.0.0:9464, or a port alone, on 127.0.0.1"));
  }
  return Endpoint{.host = is_bracketed ? host.substr(1, host.size() - 2) : host,
                  .port = absl::StrCat(number),
                  .address = host};
}

class MetricsServerImpl final : public MetricsServer {
 public:
  explicit MetricsServerImpl(base::CollectMetrics collect)
      : collect_(std::move(collect)), connections_(kLimits), listener_(PeerListener::Make()) {}
  ~MetricsServerImpl() override {
    listener_->Close();
    connections_.Close(/*at_once=*/false);
    if (!connections_.AwaitNone(base::MonotonicNow() + kCloseGrace)) {
      connections_.Close(/*at_once=*/true);
      connections_.AwaitNone(base::MonotonicNow() + kCloseGrace);
    }
  }

  absl::Status Listen(const Endpoint& endpoint) {
    const absl::Status listening = listener_->Listen(
        endpoint.host, endpoint.port, absl::StrCat(endpoint.address, ":", endpoint.port),
        /*tls=*/nullptr, kThreads, [this](const std::shared_ptr<PeerStream>& stream) {
          std::shared_ptr<Connections::Lease> lease =
              connections_.TryAdd(PeerKey(stream->RemoteAddress()));
          if (lease != nullptr) {
            std::make_shared<Scraper>(stream, std::move(lease), &collect_)->Run();
          }
        });
    if (!listening.ok()) {
      return absl::UnavailableError(
          absl::StrCat("can't serve metrics (--metrics-listen): ", listening.message()));
    }
    address_ = absl::StrCat(endpoint.address, ":", listener_->port());
    return absl::OkStatus();
  }

  [[nodiscard]] int port() const override { return listener_->port(); }
  [[nodiscard]] const std::string& address() const override { return address_; }

 private:
  const base::CollectMetrics collect_;
  std::string address_;
  Connections connections_;
  std::unique_ptr<PeerListener> listener_;  // ends first: its threads use the others
};

}  // namespace

std::string MetricsText(const std::vector<base::MetricFamily>& families) {
  std::string text;
  for (const base::MetricFamily& family : families) {
    absl::StrAppend(&text, "# HELP ", family.name, " ",
                    absl::StrReplaceAll(family.help, {{"\\", "\\\\"}, {"\n", "\\n"}}), "\n# TYPE ",
                    family.name, " ", NameOf(family.type), "\n");
    for (const base::MetricSample& sample : family.samples) {
      if (family.type == base::MetricFamily::Type::kHistogram) {
        AppendHistogram(family.name, sample, &text);
      } else {
        absl::StrAppend(&text, family.name, LabelsText(sample.labels), " ",
                        NumberText(sample.value), "\n");
      }
    }
  }
  return text;
}

absl::StatusOr<std::unique_ptr<MetricsServer>> MetricsServer::Start(absl::string_view listen,
                                                                    base::CollectMetrics collect) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Endpoint endpoint, ParseListen(listen));
  auto server = std::make_unique<MetricsServerImpl>(std::move(collect));
  ISOSCOPE_RETURN_IF_ERROR(server->Listen(endpoint));
  return server;
}

absl::StatusOr<std::shared_ptr<MetricsServer>> MetricsServer::StartIfAsked(
    absl::string_view listen, base::CollectMetrics collect) {
  if (listen.empty()) {
    return std::shared_ptr<MetricsServer>();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<MetricsServer> server,
                            Start(listen, std::move(collect)));
  base::LogInfo("metrics_started", {{"address", base::OwnText{server->address()}}});
  return server;
}

}  // namespace isoscope::http
