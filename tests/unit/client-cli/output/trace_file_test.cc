#include "client-cli/output/trace_file.h"

#include <map>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "wire/proto_convert.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

void AddSpan(const std::string& name, int start_ms, int length_ms, v1::TraceTrack* track) {
  v1::TraceSpan* const span = track->add_spans();
  span->set_name(name);
  *span->mutable_start_duration() = wire::ToProto(absl::Milliseconds(start_ms));
  *span->mutable_span_duration() = wire::ToProto(absl::Milliseconds(length_ms));
}

v1::FrameTrace SmallTrace() {
  v1::FrameTrace trace;
  trace.set_frame_number(17);
  trace.set_request_id("4bf92f3577b34da6a3ce929d0e0e4736");
  v1::ProcessTrace* const coordinator = trace.add_processes();
  coordinator->set_name("coordinator");
  v1::TraceTrack* const frame = coordinator->add_tracks();
  frame->set_name("frame 7");
  AddSpan("frame", 1, 79, frame);
  v1::ProcessTrace* const agent = trace.add_processes();
  agent->set_name("agent \"a\":1\n");
  agent->set_dropped_span_count(4);
  *agent->mutable_clock_error_duration() = wire::ToProto(absl::Microseconds(35));
  v1::TraceTrack* const worker = agent->add_tracks();
  worker->set_name("worker 9");
  AddSpan("draw", 10, 20, worker);
  return trace;
}

nlohmann::json EventsOf(const std::string& text, const std::string& phase) {
  const nlohmann::json file = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
  EXPECT_TRUE(file.is_object()) << text;
  nlohmann::json found = nlohmann::json::array();
  for (const nlohmann::json& event : file.at("traceEvents")) {
    if (event.at("ph") == phase) {
      found.push_back(event);
    }
  }
  return found;
}

TEST(TraceFileTest, SpansAreCompleteEventsInMicrosecondsInTheMiddleOfTheClientsTime) {
  // The server's 80 ms lie in the middle of the client's 100.
  const nlohmann::json spans = EventsOf(TraceToJson(SmallTrace(), absl::Milliseconds(100)), "X");
  ASSERT_EQ(spans.size(), 3u);
  EXPECT_EQ(spans[0].at("name"), "request");
  EXPECT_EQ(spans[0].at("ts"), 0);
  EXPECT_EQ(spans[0].at("dur"), 100'000);
  EXPECT_EQ(spans[1].at("name"), "frame");
  EXPECT_EQ(spans[1].at("ts"), 11'000);
  EXPECT_EQ(spans[1].at("dur"), 79'000);
  EXPECT_EQ(spans[2].at("name"), "draw");
  EXPECT_EQ(spans[2].at("ts"), 20'000);
  EXPECT_NE(spans[1].at("pid"), spans[2].at("pid"));
}

TEST(TraceFileTest, ProcessesAndTracksHaveTheirNamesAndWhatIsLessSure) {
  const std::string text = TraceToJson(SmallTrace(), absl::Milliseconds(100));
  std::map<std::string, std::vector<std::string>> names;
  for (const nlohmann::json& event : EventsOf(text, "M")) {
    const std::string kind = event.at("name");
    if (event.at("args").contains("name")) {
      names[kind].push_back(event.at("args").at("name"));
    } else if (event.at("args").contains("labels")) {
      names[kind].push_back(event.at("args").at("labels"));
    }
  }
  EXPECT_EQ(names["process_name"],
            (std::vector<std::string>{"client", "coordinator", "agent \"a\":1\n"}));
  EXPECT_EQ(names["thread_name"], (std::vector<std::string>{"request", "frame 7", "worker 9"}));
  EXPECT_EQ(names["process_labels"],
            (std::vector<std::string>{"clock +- 10000 us", "clock +- 35 us, 4 spans dropped"}));
  const nlohmann::json file = nlohmann::json::parse(text);
  EXPECT_EQ(file.at("otherData").at("request_id"), "4bf92f3577b34da6a3ce929d0e0e4736");
  EXPECT_EQ(file.at("otherData").at("frame_number"), 17);
}

TEST(TraceFileTest, NoTraceAndTextThatIsNoUtf8StillGiveAFileThatOpens) {
  EXPECT_EQ(EventsOf(TraceToJson({}, absl::Milliseconds(3)), "X").size(), 1u);
  v1::FrameTrace trace = SmallTrace();
  trace.mutable_processes(0)->set_name("\xff\xfe");
  // The client's clock may say less than the server's.
  EXPECT_EQ(EventsOf(TraceToJson(trace, absl::ZeroDuration()), "X").size(), 3u);
}

}  // namespace
}  // namespace isoscope::cli
