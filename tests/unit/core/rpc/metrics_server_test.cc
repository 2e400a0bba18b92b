#include "core/rpc/metrics_server.h"

#include <unistd.h>

#include <array>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include "tests/support/status_matchers.h"

namespace isoscope::rpc {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;
using testing::StatusIs;

// Sends `request` to 127.0.0.1 and returns the whole answer.
std::string Ask(int port, const std::string& request) {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  EXPECT_GE(socket, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(::connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  EXPECT_EQ(::send(socket, request.data(), request.size(), MSG_NOSIGNAL),
            static_cast<ssize_t>(request.size()));
  std::string answer;
  std::array<char, 4096> piece{};
  for (ssize_t count = 0; (count = ::recv(socket, piece.data(), piece.size(), 0)) > 0;) {
    answer.append(piece.data(), static_cast<std::size_t>(count));
  }
  ::close(socket);
  return answer;
}

std::string Scrape(int port) {
  return Ask(port, "GET /metrics HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
}

std::vector<base::MetricFamily> Families(const base::DurationHistogram& histogram) {
  using Type = base::MetricFamily::Type;
  return {{.name = "isoscope_things_total",
           .help = "Things.",
           .type = Type::kCounter,
           .samples = {base::MetricSample::Of(3, {{"kind", "a \"b\"\n\\"}})}},
          {.name = "isoscope_level_bytes",
           .help = "A level.",
           .type = Type::kGauge,
           .samples = {base::MetricSample::Of(2.5)}},
          {.name = "isoscope_wait_seconds",
           .help = "A wait.",
           .type = Type::kHistogram,
           .samples = {base::MetricSample::Of(histogram, {{"for", "thread"}})}}};
}

TEST(MetricsServerTest, AScrapeHasNamesHelpsTypesAndValuesInPrometheusText) {
  base::DurationHistogram histogram;
  histogram.Observe(absl::Milliseconds(500));
  histogram.Observe(absl::Hours(1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto server,
                                MetricsServer::Start("0", [&] { return Families(histogram); }));
  EXPECT_EQ(server->address(), absl::StrCat("127.0.0.1:", server->port()));
  const std::string text = Scrape(server->port());
  EXPECT_THAT(text, StartsWith("HTTP/1.1 200 OK"));
  EXPECT_THAT(text, HasSubstr("# HELP isoscope_things_total Things.\n"
                              "# TYPE isoscope_things_total counter\n"
                              "isoscope_things_total{kind=\"a \\\"b\\\"\\n\\\\\"} 3"));
  EXPECT_THAT(text, HasSubstr("# TYPE isoscope_level_bytes gauge\nisoscope_level_bytes 2.5"));
  EXPECT_THAT(text, AllOf(HasSubstr("isoscope_wait_seconds_count{for=\"thread\"} 2"),
                          HasSubstr("isoscope_wait_seconds_bucket{for=\"thread\",le=\"0.25\"} 0"),
                          HasSubstr("isoscope_wait_seconds_bucket{for=\"thread\",le=\"0.5\"} 1"),
                          HasSubstr("isoscope_wait_seconds_bucket{for=\"thread\",le=\"300\"} 1"),
                          HasSubstr("isoscope_wait_seconds_bucket{for=\"thread\",le=\"+Inf\"} 2"),
                          HasSubstr("isoscope_wait_seconds_sum{for=\"thread\"} 3600.5")));
}

TEST(MetricsServerTest, ScrapesSideBySideAreAllAnsweredAndOtherPathsAreNot) {
  const base::DurationHistogram histogram;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto server, MetricsServer::Start("localhost:0", [&] { return Families(histogram); }));
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back(
        [&] { EXPECT_THAT(Scrape(server->port()), HasSubstr("isoscope_things_total")); });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  for (const char* path : {"/", "/../../etc/passwd", "/metrics/../../etc/passwd"}) {
    EXPECT_THAT(Ask(server->port(), absl::StrCat("GET ", path, " HTTP/1.1\r\nHost: x\r\n",
                                                 "Connection: close\r\n\r\n")),
                AllOf(Not(HasSubstr("root:")), Not(HasSubstr("isoscope_things_total"))))
        << path;
  }
}

TEST(MetricsServerTest, AMalformedOrTakenAddressIsRefusedWithTheFlagsName) {
  const base::DurationHistogram histogram;
  const auto collect = [&] { return Families(histogram); };
  for (const char* bad : {"host:", "1.2.3.4:x", ":", "127.0.0.1:65536", "-1", "a,b:1"}) {
    EXPECT_THAT(MetricsServer::Start(bad, collect),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         AllOf(HasSubstr("--metrics-listen"), HasSubstr(bad))))
        << bad;
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, MetricsServer::Start(":0", collect));
  EXPECT_THAT(MetricsServer::Start(absl::StrCat(first->port()), collect),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr(first->address())));
  EXPECT_THAT(MetricsServer::Start("no-such-host:0", collect),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("no-such-host")));
}

TEST(MetricsServerTest, NobodyListensUnlessAsked) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto none, MetricsServer::StartIfAsked("", nullptr));
  EXPECT_EQ(none, nullptr);
}

}  // namespace
}  // namespace isoscope::rpc
