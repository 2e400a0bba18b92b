// Seeing inside a cluster of real processes: traces, request ids in every log, metrics and the
// tables of docs/operations.md that explain them, `isoscope top`.

#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <regex>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <arpa/inet.h>
#include <grpcpp/client_context.h>
#include <netinet/in.h>
#include <nlohmann/json.hpp>
#include <sys/socket.h>

#include "core/base/monotonic_time.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "rpc/request_context.h"
#include "tests/integration/cli_fixture.h"
#include "wire/proto_convert.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::ProcessCluster;
using testing::ServerProcess;
using testing::SmallRequest;

constexpr char kTraceId[] = "4bf92f3577b34da6a3ce929d0e0e4736";
constexpr char kTraceparent[] = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";
constexpr int kShardCount = 3;

struct Answer {
  absl::Status status;
  v1::RenderIsosurfaceResponse response;
  std::string request_id;
};

Answer Ask(const std::string& address, const v1::RenderIsosurfaceRequest& request,
           const std::string& traceparent = "") {
  const auto stub = v1::IsosurfaceService::NewStub(rpc::MakeFreshChannel(address));
  grpc::ClientContext context;
  context.set_deadline(base::MonotonicNow() + testing::kPatience);
  if (!traceparent.empty()) {
    context.AddMetadata("traceparent", traceparent);
  }
  Answer answer;
  answer.status = rpc::ToAbslStatus(stub->RenderIsosurface(&context, request, &answer.response));
  answer.request_id = rpc::RequestIdOf(context);
  return answer;
}

struct Interval {
  absl::Duration begin;
  absl::Duration end;
};

Interval IntervalOf(const v1::TraceSpan& span) {
  const absl::Duration begin = wire::DurationFromProto(span.start_duration());
  return {begin, begin + wire::DurationFromProto(span.span_duration())};
}

std::vector<Interval> SpansNamed(const v1::ProcessTrace& process, const std::string& name) {
  std::vector<Interval> found;
  for (const v1::TraceTrack& track : process.tracks()) {
    for (const v1::TraceSpan& span : track.spans()) {
      if (span.name() == name) {
        found.push_back(IntervalOf(span));
      }
    }
  }
  return found;
}

// The part of `whole` that is covered by any of `parts`.
double CoverOf(const Interval& whole, std::vector<Interval> parts) {
  std::sort(parts.begin(), parts.end(),
            [](const Interval& a, const Interval& b) { return a.begin < b.begin; });
  absl::Duration covered;
  absl::Duration reached = whole.begin;
  for (const Interval& part : parts) {
    const absl::Duration begin = std::max(part.begin, reached);
    const absl::Duration end = std::min(part.end, whole.end);
    covered += std::max(end - begin, absl::ZeroDuration());
    reached = std::max(reached, end);
  }
  return absl::FDivDuration(covered, whole.end - whole.begin);
}

// Two spans of a track are apart, or one holds the other.
void ExpectNested(const v1::ProcessTrace& process) {
  for (const v1::TraceTrack& track : process.tracks()) {
    std::vector<Interval> open;
    for (const v1::TraceSpan& span : track.spans()) {
      const Interval interval = IntervalOf(span);
      EXPECT_GE(interval.end, interval.begin);
      while (!open.empty() && open.back().end <= interval.begin) {
        open.pop_back();
      }
      if (!open.empty()) {
        EXPECT_LE(interval.end, open.back().end)
            << process.name() << ", " << track.name() << ": " << span.name();
      }
      open.push_back(interval);
    }
  }
}

class ObserveTest : public CliTest {
 protected:
  void SetUp() override {
    ISOSCOPE_ASSERT_OK(
        testing::MakeDataset(testing::GyroidVolume({61, 55, 49}), Path("gyroid"), kShardCount, 8));
  }
  void StartCluster(const std::vector<std::string>& coordinator_flags = {}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        cluster_, ProcessCluster::Start(Path("gyroid"), kShardCount, coordinator_flags));
  }

  static v1::RenderIsosurfaceRequest Traced(v1::RenderIsosurfaceRequest request) {
    request.set_with_trace(true);
    return request;
  }

  std::unique_ptr<ProcessCluster> cluster_;
};

TEST_F(ObserveTest, ATraceChangesNeitherPictureNorCountsAndNobodyGetsOneUnasked) {
  StartCluster();
  const Answer plain = Ask(cluster_->address(), SmallRequest());
  const Answer traced = Ask(cluster_->address(), Traced(SmallRequest()));
  ISOSCOPE_ASSERT_OK(plain.status);
  ISOSCOPE_ASSERT_OK(traced.status);
  EXPECT_TRUE(plain.response.png() == traced.response.png());
  EXPECT_FALSE(plain.response.has_trace());
  ASSERT_TRUE(traced.response.has_trace());
  EXPECT_EQ(plain.response.statistics().triangle_count(),
            traced.response.statistics().triangle_count());
  // The first frame also carried the lists of active blocks; the trace is not in the count.
  EXPECT_LT(traced.response.statistics().network_bytes(),
            plain.response.statistics().network_bytes());
}

TEST_F(ObserveTest, SpansNestAndThoseOfAgentsLieWithinTheCoordinatorsWaiting) {
  StartCluster();
  v1::RenderIsosurfaceRequest request = Traced(SmallRequest());
  request.mutable_viewport()->set_width_px(512);
  request.mutable_viewport()->set_height_px(512);
  const Answer answer = Ask(cluster_->address(), request);
  ISOSCOPE_ASSERT_OK(answer.status);
  const v1::FrameTrace& trace = answer.response.trace();
  EXPECT_EQ(trace.request_id(), answer.request_id);
  ASSERT_EQ(trace.processes_size(), 1 + kShardCount);
  const v1::ProcessTrace& coordinator = trace.processes(0);
  EXPECT_EQ(coordinator.name(), "coordinator");
  for (const v1::ProcessTrace& process : trace.processes()) {
    ExpectNested(process);
    EXPECT_EQ(process.dropped_span_count(), 0);
  }

  const std::vector<Interval> root = SpansNamed(coordinator, "frame");
  const std::vector<Interval> queue = SpansNamed(coordinator, "queue");
  const std::vector<Interval> waiting = SpansNamed(coordinator, "agents");
  ASSERT_EQ(root.size(), 1u);
  ASSERT_EQ(queue.size(), 1u);
  ASSERT_EQ(waiting.size(), 1u);
  EXPECT_EQ(queue[0].begin, absl::ZeroDuration());
  EXPECT_EQ(queue[0].end, root[0].begin);
  for (const char* name : {"composite", "cull", "png"}) {
    EXPECT_FALSE(SpansNamed(coordinator, name).empty()) << name;
  }

  for (int i = 1; i <= kShardCount; ++i) {
    const v1::ProcessTrace& agent = trace.processes(i);
    EXPECT_THAT(agent.name(), HasSubstr("agent 127.0.0.1:"));
    for (const char* name : {"queue", "select occluders", "index", "render occluders", "extract",
                             "draw", "shade", "encode", "render visible", "network"}) {
      EXPECT_FALSE(SpansNamed(agent, name).empty()) << agent.name() << ": " << name;
    }
    EXPECT_EQ(SpansNamed(agent, "network").size(), 6u);
    for (const v1::TraceTrack& track : agent.tracks()) {
      for (const v1::TraceSpan& span : track.spans()) {
        EXPECT_GE(IntervalOf(span).begin, waiting[0].begin) << agent.name() << ": " << span.name();
        EXPECT_LE(IntervalOf(span).end, waiting[0].end) << agent.name() << ": " << span.name();
      }
    }
  }
}

// The share of a span of the coordinator that spans with certain names cover.
double CoverOf(const v1::ProcessTrace& process, const std::string& whole,
               const std::vector<std::string>& names) {
  std::vector<Interval> parts;
  for (const std::string& name : names) {
    const std::vector<Interval> found = SpansNamed(process, name);
    parts.insert(parts.end(), found.begin(), found.end());
  }
  return CoverOf(SpansNamed(process, whole).at(0), parts);
}

TEST_F(ObserveTest, SpansCoverTheCoordinatorsTime) {
  StartCluster();
  v1::RenderIsosurfaceRequest request = Traced(SmallRequest());
  request.mutable_viewport()->set_width_px(512);
  request.mutable_viewport()->set_height_px(512);
  // On a busy machine a thread may stand still between two spans: what counts is the best frame.
  double frame_cover = 0;
  double agents_cover = 0;
  for (int i = 0; i < 20 && (frame_cover < 0.95 || agents_cover < 0.95); ++i) {
    const Answer answer = Ask(cluster_->address(), request);
    ISOSCOPE_ASSERT_OK(answer.status);
    const v1::ProcessTrace& coordinator = answer.response.trace().processes(0);
    frame_cover = std::max(
        frame_cover,
        CoverOf(coordinator, "frame", {"memory", "find dataset", "agents", "finish picture"}));
    agents_cover = std::max(
        agents_cover,
        CoverOf(coordinator, "agents",
                {"take image", "occluder selection", "occluder rendering", "visibility culling",
                 "wait for agents", "finish compositing", "end streams"}));
  }
  EXPECT_GE(frame_cover, 0.95);
  EXPECT_GE(agents_cover, 0.95);
}

TEST_F(ObserveTest, FramesWithoutCullingWithLayersAndDrawnTwiceHaveTracesToo) {
  StartCluster();
  v1::RenderIsosurfaceRequest all = Traced(SmallRequest());
  all.set_culling(v1::CULLING_NONE);
  v1::RenderIsosurfaceRequest translucent = Traced(SmallRequest());
  translucent.clear_isovalue();
  v1::Surface* const surface = translucent.add_surfaces();
  surface->set_isovalue(128);
  surface->mutable_color()->set_red(1);
  surface->mutable_color()->set_alpha(0.5F);
  v1::RenderIsosurfaceRequest twice = Traced(SmallRequest());
  twice.mutable_output()->set_normal(true);
  const std::vector<std::pair<v1::RenderIsosurfaceRequest, int>> cases = {
      {all, 1 + kShardCount}, {translucent, 1 + kShardCount}, {twice, 1 + 2 * kShardCount}};
  for (const auto& [request, process_count] : cases) {
    const Answer answer = Ask(cluster_->address(), request);
    ISOSCOPE_ASSERT_OK(answer.status);
    EXPECT_EQ(answer.response.trace().processes_size(), process_count);
    for (const v1::ProcessTrace& process : answer.response.trace().processes()) {
      ExpectNested(process);
    }
  }
}

TEST_F(ObserveTest, ARequestIdIsInTheLogOfEveryProcessAndInTheAnswer) {
  StartCluster();
  for (int i = 0; i < kShardCount; ++i) {
    cluster_->agent(i).Signal(SIGUSR1);  // an agent's lines of frames come at debug
    ISOSCOPE_ASSERT_OK(cluster_->agent(i).WaitForErrLine("log_level"));
  }
  const Answer answer = Ask(cluster_->address(), SmallRequest(), kTraceparent);
  ISOSCOPE_ASSERT_OK(answer.status);
  EXPECT_EQ(answer.request_id, kTraceId);
  const std::string field = absl::StrCat("request=", kTraceId);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string line,
                                cluster_->coordinator().WaitForErrLine(field));
  EXPECT_THAT(line, AllOf(HasSubstr("frame_done"), HasSubstr("caller="), HasSubstr("peer=ipv4:")));
  for (int i = 0; i < kShardCount; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string agent_text,
                                  cluster_->agent(i).WaitForErrLine(field));
    EXPECT_THAT(agent_text, HasSubstr("frame_done"));
  }
  const Answer without = Ask(cluster_->address(), SmallRequest(), "00-nonsense");
  ISOSCOPE_ASSERT_OK(without.status);
  EXPECT_EQ(without.request_id.size(), 32u);
  EXPECT_NE(without.request_id, kTraceId);
}

TEST_F(ObserveTest, AFailedRequestHasItsIdInTheAnswerTheLogAndTheClientsError) {
  StartCluster();
  cluster_->agent(1).Kill();
  const Answer answer = Ask(cluster_->address(), SmallRequest(), kTraceparent);
  EXPECT_FALSE(answer.status.ok());
  EXPECT_EQ(answer.request_id, kTraceId);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string line, cluster_->coordinator().WaitForErrLine(
                                                            absl::StrCat("request=", kTraceId)));
  EXPECT_THAT(cluster_->coordinator().err(), HasSubstr("frame_failed request="));
  const testing::CommandResult result =
      testing::RunIsoscope({"render", "--server", cluster_->address(), "--dataset", "gyroid",
                            "--isovalue", "128", "--output", Path("p.png")},
                           {.environment = {absl::StrCat("TRACEPARENT=", kTraceparent)}});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr(absl::StrCat("(request ", kTraceId, ")")));
}

TEST_F(ObserveTest, TheCommandLineWritesATraceAndThePictureIsTheOneWithout) {
  StartCluster();
  const std::vector<std::string> arguments = {"--server", cluster_->address()};
  const std::string plain = Render(arguments);
  const std::string traced = Render(Join(arguments, {"--trace", Path("t.json")}));
  EXPECT_TRUE(plain == traced) << "the trace shows in the file";
  EXPECT_THAT(traced, Not(HasSubstr("trace")));
  const nlohmann::json file = ParseJson(ReadFile(Path("t.json")));
  std::map<std::string, int> spans;
  std::set<std::string> processes;
  for (const nlohmann::json& event : file.at("traceEvents")) {
    if (event.at("ph") == "X") {
      ++spans[event.at("name")];
      EXPECT_GE(event.at("ts").get<double>(), 0);
      EXPECT_GE(event.at("dur").get<double>(), 0);
    } else if (event.at("name") == "process_name") {
      processes.insert(event.at("args").at("name").get<std::string>());
    }
  }
  EXPECT_EQ(processes.size(), 2u + kShardCount);
  for (const char* name : {"request", "queue", "frame", "rays", "extract", "draw", "encode",
                           "network", "composite", "png"}) {
    EXPECT_GE(spans[name], 1) << name;
  }
  // Again from its record, with a trace.
  MustRun({"render", "--server", cluster_->address(), "--like", Path("picture.png"), "--trace",
           Path("t2.json"), "--output", Path("again.png")});
  EXPECT_TRUE(ReadFile(Path("again.png")) == plain);
  EXPECT_TRUE(ParseJson(ReadFile(Path("t2.json"))).contains("traceEvents"));
}

TEST_F(ObserveTest, ATraceOfSeveralFramesIsRefusedBeforeAnyWork) {
  for (const std::vector<std::string>& more : std::vector<std::vector<std::string>>{
           {"--repeat", "3", "--output", Path("p-%d.png")},
           {"--width", "16000", "--height", "16000", "--output", Path("p.png")}}) {
    const testing::CommandResult result = testing::RunIsoscope(
        Join({"render", Path("gyroid"), "--isovalue", "128", "--trace", Path("t.json")}, more),
        Options());
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_THAT(result.err, HasSubstr("--trace is for one frame"));
  }
}

// Returns the answer of GET /metrics at 127.0.0.1.
std::string Scrape(const std::string& address) {
  const std::vector<std::string> parts = absl::StrSplit(address, ':');
  int port = 0;
  EXPECT_TRUE(absl::SimpleAtoi(parts.back(), &port)) << address;
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in peer{};
  peer.sin_family = AF_INET;
  peer.sin_port = htons(static_cast<std::uint16_t>(port));
  peer.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(::connect(socket, reinterpret_cast<const sockaddr*>(&peer), sizeof(peer)), 0);
  const std::string request = "GET /metrics HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n";
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

std::string MetricsOf(const testing::Process& process) {
  const std::string log = process.err();
  std::smatch found;
  EXPECT_TRUE(std::regex_search(log, found, std::regex("metrics_started address=(\\S+)"))) << log;
  return Scrape(found[1]);
}

// The first cells of the tables below `heading`, as far as they are code, with the second cell.
std::map<std::string, std::string> TableOf(const std::string& document,
                                           const std::string& heading) {
  std::map<std::string, std::string> rows;
  bool is_in = false;
  for (const absl::string_view line : absl::StrSplit(document, '\n')) {
    if (absl::StartsWith(line, "## ")) {
      is_in = line == absl::StrCat("## ", heading);
    }
    const std::vector<std::string> cells = absl::StrSplit(line, '|');
    if (is_in && cells.size() > 3) {
      const std::regex code("`([a-z_]+)`");
      for (std::sregex_iterator i(cells[1].begin(), cells[1].end(), code), end; i != end; ++i) {
        absl::StrAppend(&rows[(*i)[1]], cells[2]);
      }
    }
  }
  return rows;
}

std::string OperationsDocument() { return ReadFile(ISOSCOPE_OPERATIONS_DOCUMENT); }

TEST_F(ObserveTest, TheTableOfMetricsIsWhatTheProgramsExport) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ServerProcess agent,
      testing::StartAgent({Path("gyroid")}, "127.0.0.1:0", {"--metrics-listen", "0"}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ServerProcess coordinator,
      testing::StartCoordinator({agent.address}, {"--metrics-listen", "127.0.0.1:0"}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ServerProcess gateway,
      testing::StartGateway(coordinator.address, {"--metrics-listen", ":0"}));
  for (int i = 0; i < 2; ++i) {
    ISOSCOPE_ASSERT_OK(Ask(coordinator.address, SmallRequest()).status);
  }
  const std::map<std::string, std::string> table = TableOf(OperationsDocument(), "Metrics");
  EXPECT_GT(table.size(), 30u);
  const std::string coordinator_metrics = MetricsOf(*coordinator.process);
  const std::string agent_text = MetricsOf(*agent.process);
  for (const auto& [letter, text] : std::map<std::string, std::string>{
           {"C", coordinator_metrics}, {"A", agent_text}, {"G", MetricsOf(*gateway.process)}}) {
    std::set<std::string> exported;
    for (const absl::string_view line : absl::StrSplit(text, '\n')) {
      const std::vector<std::string> words = absl::StrSplit(line, ' ');
      if (words.size() == 4 && words[1] == "TYPE") {
        exported.insert(words[2]);
      }
    }
    std::set<std::string> documented;
    for (const auto& [name, programs] : table) {
      if (absl::StrContains(programs, letter)) {
        documented.insert(name);
      }
    }
    EXPECT_EQ(exported, documented) << letter;
  }
  EXPECT_THAT(coordinator_metrics,
              AllOf(HasSubstr("isoscope_frames_total{outcome=\"done\"} 2"),
                    HasSubstr("isoscope_requests_total{method=\"RenderIsosurface\",code=\"OK\"} 2"),
                    HasSubstr("isoscope_agents{state=\"reachable\"} 1"),
                    HasSubstr("isoscope_cache_lookups_total{cache=\"active_blocks\",result="
                              "\"hit\"} 1")));
  EXPECT_THAT(agent_text, AllOf(HasSubstr("isoscope_agent_frames_total{outcome=\"done\"} 2"),
                                HasSubstr("isoscope_agent_shards 3"),
                                Not(HasSubstr("isoscope_agent_triangles_total 0\n")),
                                Not(HasSubstr("isoscope_agent_read_bytes_total 0\n"))));
}

TEST_F(ObserveTest, EveryLogEventOfTheSourcesIsInTheTable) {
  const std::map<std::string, std::string> table = TableOf(OperationsDocument(), "Log events");
  const std::regex call("Log(?:Info|Warning|Error|Debug)?\\(([^{;]*)[{;]");
  const std::regex name("\"([a-z][a-z_]+)\"");
  std::set<std::string> events;
  for (const char* folder :
       {"core", "clients/cpp", "server", "partition-agent", "web-gateway", "client-cli", "bench"}) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(
             std::filesystem::path(ISOSCOPE_SOURCE_DIRECTORY) / folder)) {
      if (entry.path().extension() != ".cc") {
        continue;
      }
      const std::string source = ReadFile(entry.path().string());
      for (std::sregex_iterator i(source.begin(), source.end(), call), end; i != end; ++i) {
        const std::string arguments = (*i)[1];
        for (std::sregex_iterator k(arguments.begin(), arguments.end(), name); k != end; ++k) {
          events.insert((*k)[1]);
        }
      }
    }
  }
  EXPECT_GT(events.size(), 20u);
  for (const std::string& event : events) {
    EXPECT_TRUE(event == "_stopped" || table.count(event) > 0)
        << event << " is not in the table of docs/operations.md";
  }
}

TEST_F(ObserveTest, DashboardAndAlertsNameOnlyMetricsOfTheTable) {
  const std::map<std::string, std::string> table = TableOf(OperationsDocument(), "Metrics");
  const std::string folder = absl::StrCat(ISOSCOPE_SOURCE_DIRECTORY, "/deploy/observability/");
  EXPECT_TRUE(ParseJson(ReadFile(folder + "grafana_dashboard.json")).contains("panels"));
  const std::regex metric("(?:isoscope|process)_[a-z_]+");
  for (const char* file : {"grafana_dashboard.json", "alerts.yml", "alerts_test.yml"}) {
    const std::string text = ReadFile(folder + file);
    int count = 0;
    for (std::sregex_iterator i(text.begin(), text.end(), metric), end; i != end; ++i, ++count) {
      const std::string found = i->str();
      const std::string family = std::regex_replace(found, std::regex("_(bucket|sum|count)$"), "");
      EXPECT_TRUE(table.count(found) > 0 || table.count(family) > 0) << file << ": " << found;
    }
    EXPECT_GT(count, 10) << file;
  }
  const std::string document = OperationsDocument();
  const std::string alerts = ReadFile(folder + "alerts.yml");
  const std::regex alert("alert: ([A-Za-z]+)");
  for (std::sregex_iterator i(alerts.begin(), alerts.end(), alert), end; i != end; ++i) {
    EXPECT_THAT(document, HasSubstr(absl::StrCat("*", (*i)[1].str(), "*")));
  }
}

TEST_F(ObserveTest, TopShowsAgentsAndCountsAndNamesWhoIsNotThere) {
  StartCluster();
  ISOSCOPE_ASSERT_OK(Ask(cluster_->address(), SmallRequest()).status);
  const std::string text = MustRun({"top", "--server", cluster_->address(), "--once"});
  EXPECT_THAT(text, AllOf(HasSubstr("frames: 0 in work, 0 waiting"), HasSubstr("gyroid 0"),
                          HasSubstr("coordinator: up"), Not(HasSubstr("\x1b"))));
  for (int i = 0; i < kShardCount; ++i) {
    EXPECT_THAT(text, HasSubstr(cluster_->agent_address(i)));
  }
  const testing::CommandResult nobody =
      testing::RunIsoscope({"top", "--server", "127.0.0.1:1", "--once"});
  EXPECT_EQ(nobody.exit_code, 1);
  EXPECT_THAT(nobody.err, HasSubstr("127.0.0.1:1"));
  EXPECT_EQ(testing::RunIsoscope({"top"}).exit_code, 2);
}

TEST_F(ObserveTest, TopGoesOnWithoutATerminalAndEndsWellOnAnInterrupt) {
  StartCluster();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto top,
      testing::StartIsoscope({"top", "--server", cluster_->address(), "--interval", "0.1"}));
  ISOSCOPE_ASSERT_OK(top->WaitForOutLine("AGENT"));
  const base::MonotonicTime limit = base::MonotonicNow() + testing::kPatience;
  const auto tables = [&] {
    const std::string out = top->out();
    std::size_t count = 0;
    for (std::size_t at = 0; (at = out.find("AGENT", at)) != std::string::npos; ++at) {
      ++count;
    }
    return count;
  };
  while (tables() < 3 && base::MonotonicNow() < limit) {
    absl::SleepFor(absl::Milliseconds(20));
  }
  EXPECT_GE(tables(), 3u);
  top->Signal(SIGINT);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const int exit_code, top->Wait(testing::kPatience));
  EXPECT_EQ(exit_code, 0) << top->err();
  EXPECT_THAT(top->out(), Not(HasSubstr("\x1b")));
}

}  // namespace
}  // namespace isoscope
