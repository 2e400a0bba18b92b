#include "core/http/metrics_server.h"

#include <string>
#include <thread>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/raw_connection.h"
#include "tests/support/status_matchers.h"

namespace isoscope::http {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;
using testing::StatusIs;

// Sends `request` to 127.0.0.1 and returns the whole answer.
std::string Ask(int port, const std::string& request) {
  testing::RawConnection connection(port);
  connection.Send(request);
  return connection.ReadAll();
}

constexpr char kScrape[] = "GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n";

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

TEST(MetricsServerTest, ConnectionsWithoutARequestShutNobodyOut) {
  const base::DurationHistogram histogram;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto server,
                                MetricsServer::Start("0", [&] { return Families(histogram); }));
  testing::RawConnection scraper(server->port(), "127.0.0.2");
  scraper.Send(kScrape);
  EXPECT_THAT(scraper.ReadAnswer(), StartsWith("HTTP/1.1 200"));
  std::vector<testing::RawConnection> idle;
  for (int i = 0; i < 200; ++i) {
    idle.emplace_back(server->port()).Send(i % 2 == 0 ? "" : "GET /metrics HTTP/1.1\r\nHo");
  }
  EXPECT_THAT(Scrape(server->port()), HasSubstr("isoscope_things_total"));
  testing::RawConnection other(server->port(), "127.0.0.3");
  other.Send(kScrape);
  EXPECT_THAT(other.ReadAnswer(), HasSubstr("isoscope_things_total"));
  scraper.Send(kScrape);  // on the connection that it has kept
  EXPECT_THAT(scraper.ReadAnswer(), HasSubstr("isoscope_things_total"));
}

TEST(MetricsServerTest, OtherRequestsAreAnsweredByTheirRules) {
  const base::DurationHistogram histogram;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto server,
                                MetricsServer::Start("0", [&] { return Families(histogram); }));
  const struct {
    std::string request;
    const char* answer;
  } cases[] = {
      {"POST /metrics HTTP/1.1\r\nHost: x\r\nContent-Length: 1\r\n\r\n", "HTTP/1.1 405"},
      {"GET /metrics HTTP/1.1\r\n\r\n", "HTTP/1.1 400"},
      {"GET /metrics HTTP/1.1\r\nHost: x\r\nHost: y\r\n\r\n", "HTTP/1.1 400"},
      {"garbage\r\n\r\n", "HTTP/1.1 400"},
      {"GET /metrics HTTP/1.1\r\nHost: x\r\nConnection: close\r\nExpect: tea\r\n\r\n",
       "HTTP/1.1 417"},
      {"GET /metrics?name=x HTTP/1.0\r\n\r\n", "HTTP/1.1 200"},
      {"GET http://x/metrics HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n", "HTTP/1.1 200"},
  };
  for (const auto& c : cases) {
    EXPECT_THAT(Ask(server->port(), c.request), StartsWith(c.answer)) << c.request;
  }
  testing::RawConnection head(server->port());
  head.Send("HEAD /metrics HTTP/1.1\r\nHost: x\r\n\r\nGET /no HTTP/1.1\r\nHost: x\r\n\r\n");
  EXPECT_THAT(head.ReadAnswer(/*is_of_head=*/true),
              AllOf(StartsWith("HTTP/1.1 200"), HasSubstr("version=0.0.4")));
  EXPECT_THAT(head.ReadAnswer(), StartsWith("HTTP/1.1 404"));
}

TEST(MetricsServerTest, ItEndsWhileConnectionsAreOpen) {
  const base::DurationHistogram histogram;
  auto server = MetricsServer::Start("0", [&] { return Families(histogram); });
  ISOSCOPE_ASSERT_OK(server);
  testing::RawConnection idle((*server)->port());
  testing::RawConnection half((*server)->port());
  half.Send("GET /met");
  server->reset();
  EXPECT_EQ(idle.ReadAll(), "");
  EXPECT_EQ(half.ReadAll(), "");
}

TEST(MetricsServerTest, NumbersAreReadBackAsTheyWere) {
  using Type = base::MetricFamily::Type;
  const std::string text =
      MetricsText({{.name = "a",
                    .help = "A \\ b\nc.",
                    .type = Type::kGauge,
                    .samples = {base::MetricSample::Of(0.1), base::MetricSample::Of(1e300),
                                base::MetricSample::Of(1.0 / 0.0)}}});
  EXPECT_EQ(text, "# HELP a A \\\\ b\\nc.\n# TYPE a gauge\na 0.1\na 1e+300\na +Inf\n");
}

TEST(MetricsServerTest, AMalformedOrTakenAddressIsRefusedWithTheFlagsName) {
  const base::DurationHistogram histogram;
  const auto collect = [&] { return Families(histogram); };
  for (const char* bad : {"host:", "1.2.3.4:x", ":", "127.0.0.1:65536", "-1", "a,b:1", "::1:0"}) {
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
}  // namespace isoscope::http
