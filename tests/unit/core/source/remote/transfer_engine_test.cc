// The engine by itself: results, and what happens to a caller that leaves.

#include "core/source/remote/transfer_engine.h"

#include <unistd.h>

#include <atomic>
#include <future>
#include <memory>
#include <string>
#include <thread>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/scripted_server.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::source {
namespace {

using testing::Answer;
using testing::ScriptedServer;
using testing::ServedConnection;
using testing::ServedRequest;
using testing::StatusIs;
using Outcome = TransferResult::Outcome;

class KeepingSink : public TransferSink {
 public:
  absl::Status OnHead(const ResponseHead& head) override {
    head_ = head;
    return head_error_;
  }
  absl::Status OnBytes(absl::string_view bytes) override {
    body_.append(bytes.data(), bytes.size());
    return body_error_;
  }

  ResponseHead head_;
  std::string body_;
  absl::Status head_error_;
  absl::Status body_error_;
};

TransferRequest RequestFor(const ScriptedServer& server) {
  TransferRequest request;
  request.url = Secret(server.origin() + "/a");
  request.origin = server.origin();
  request.headers = {Secret("X-One: 1"), Secret("X-Two: 2")};
  request.max_per_origin = 4;
  request.proxy = "";
  return request;
}

constexpr base::MonotonicTime kForever = base::MonotonicTime::InfiniteFuture();

TEST(TransferEngineTest, GivesHeadAndBody) {
  const ScriptedServer server([](const ServedRequest& request, ServedConnection* c) {
    EXPECT_EQ(request.Header("x-two"), "2");
    c->Send("HTTP/1.1 100 Continue\r\nX-Interim: y\r\n\r\n");
    c->Send(Answer(404, "X-Name:  a value \r\nx-folded: a\r\n b\r\n", "body"));
  });
  const base::Cancellation never;
  TransferGroup group(TransferEngine::OfProcess());
  KeepingSink sink;
  group.Start(7, RequestFor(server), &sink);
  EXPECT_EQ(group.running_count(), 1u);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto finished, group.Await(never, kForever));
  ASSERT_TRUE(finished.has_value());
  EXPECT_EQ(finished->id, 7u);
  EXPECT_EQ(finished->result.outcome, Outcome::kComplete);
  EXPECT_EQ(group.running_count(), 0u);
  EXPECT_EQ(sink.head_.status, 404);
  EXPECT_EQ(sink.head_.Header("x-name"), "a value");
  EXPECT_EQ(sink.head_.Header("x-interim"), "");
  EXPECT_EQ(sink.body_, "body");
}

TEST(TransferEngineTest, SinksStopTransfers) {
  const ScriptedServer server([](const ServedRequest&, ServedConnection* c) {
    c->Send(Answer(200, "", std::string(100'000, 'x')));
  });
  const base::Cancellation never;
  TransferGroup group(TransferEngine::OfProcess());
  KeepingSink at_head;
  at_head.head_error_ = absl::DataLossError("no such head");
  group.Start(0, RequestFor(server), &at_head);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto finished, group.Await(never, kForever));
  EXPECT_EQ(finished->result.outcome, Outcome::kStopped);
  EXPECT_THAT(finished->result.status, StatusIs(absl::StatusCode::kDataLoss, "no such head"));
  EXPECT_EQ(at_head.body_, "");
  KeepingSink at_body;
  at_body.body_error_ = absl::DataLossError("no such body");
  group.Start(0, RequestFor(server), &at_body);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(finished, group.Await(never, kForever));
  EXPECT_EQ(finished->result.outcome, Outcome::kStopped);
  EXPECT_THAT(finished->result.status, StatusIs(absl::StatusCode::kDataLoss, "no such body"));
}

TEST(TransferEngineTest, AwaitEndsByItsTime) {
  const ScriptedServer server([](const ServedRequest&, ServedConnection* c) { c->Hang(); });
  const base::Cancellation never;
  TransferGroup group(TransferEngine::OfProcess());
  KeepingSink sink;
  group.Start(0, RequestFor(server), &sink);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto finished,
                                group.Await(never, base::MonotonicNow() + absl::Milliseconds(10)));
  EXPECT_FALSE(finished.has_value());
  EXPECT_EQ(group.running_count(), 1u);
}

// The first request of a server has no answer: the second one has, with TLS and without.
TEST(TransferEngineTest, OtherRequestsDoNotWaitForTheFirstAnswer) {
  const testing::TestIdentity identity = testing::MakeTestIdentity();
  const testing::TempDir dir;
  const std::string ca_file = dir.Write("ca.pem", identity.certificate);
  for (const bool has_tls : {false, true}) {
    SCOPED_TRACE(has_tls);
    std::promise<void> has_first;
    const ScriptedServer server(
        [&](const ServedRequest& request, ServedConnection* c) {
          if (request.index == 0) {
            has_first.set_value();
            c->Hang();
          } else {
            c->Send(Answer(200, "", "body"));
          }
        },
        has_tls ? &identity : nullptr);
    const base::Cancellation never;
    TransferGroup group(TransferEngine::OfProcess());
    KeepingSink first;
    KeepingSink second;
    TransferRequest request = RequestFor(server);
    request.ca_file = has_tls ? ca_file : "";
    group.Start(0, request, &first);
    has_first.get_future().wait();
    group.Start(1, request, &second);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto finished, group.Await(never, kForever));
    ASSERT_TRUE(finished.has_value());
    EXPECT_EQ(finished->id, 1u);
    EXPECT_EQ(finished->result.outcome, Outcome::kComplete);
    EXPECT_EQ(second.body_, "body");
  }
}

// Callers that leave at any moment, while bytes come: their sinks are not called any more.
TEST(TransferEngineTest, CallersMayLeave) {
  const ScriptedServer server([](const ServedRequest&, ServedConnection* c) {
    c->Send("HTTP/1.1 200 X\r\n\r\n");
    while (c->Send(std::string(1000, 'x'))) {
    }
  });
  const base::Cancellation never;
  for (int round = 0; round < 50; ++round) {
    std::atomic<bool> has_left{false};
    class LeftSink : public TransferSink {
     public:
      explicit LeftSink(std::atomic<bool>* has_left) : has_left_(has_left) {}
      absl::Status OnHead(const ResponseHead& /*head*/) override { return Check(); }
      absl::Status OnBytes(absl::string_view /*bytes*/) override { return Check(); }

     private:
      absl::Status Check() {
        EXPECT_FALSE(*has_left_);
        return absl::OkStatus();
      }
      std::atomic<bool>* const has_left_;
    };
    auto sink = std::make_unique<LeftSink>(&has_left);
    {
      TransferGroup group(TransferEngine::OfProcess());
      for (std::size_t id = 0; id < 6; ++id) {  // two of them wait for a place
        group.Start(id, RequestFor(server), sink.get());
      }
      usleep(static_cast<useconds_t>(round * 100));
    }
    has_left = true;
    sink.reset();
  }
}

// An engine of its own begins and ends with its thread.
TEST(TransferEngineTest, EnginesEnd) {
  const ScriptedServer server([](const ServedRequest&, ServedConnection* c) { c->Hang(); });
  for (int round = 0; round < 5; ++round) {
    KeepingSink sink;
    TransferGroup group(std::make_shared<TransferEngine>());
    group.Start(0, RequestFor(server), &sink);
    usleep(1000);
  }
}

}  // namespace
}  // namespace isoscope::source
