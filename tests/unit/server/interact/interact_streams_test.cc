// The open streams as tables: callers that come, and those that are cut off for them.
//
// Events:   a, or a x 3: caller a opens streams, named a1, a2, ... in order of arrival. They open
//           one by one; the answer is that of the last. close a2: it has ended by itself. stop.
// Answers:  "" if it is open; "cut a3" if it is open since a3 was cut off; the error that the
//           stream gets. stop returns the number of streams that ended.

#include "server/interact/interact_streams.h"

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "gtest/gtest.h"

#include "tests/support/event_table.h"
#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

class Stream;
using Streams = InteractStreams<Stream>;

// A stream that removes itself when it ends, as the real one does. So a lock that is held while it
// ends would be taken twice.
class Stream : public std::enable_shared_from_this<Stream> {
 public:
  Stream(std::string caller, Streams* streams) : caller_(std::move(caller)), streams_(*streams) {}

  void End(absl::Status status) {
    end_ = std::move(status);
    Close();
  }
  void CutOff(CutReason reason, absl::Status status) {
    EXPECT_EQ(reason, CutReason::kMadeRoom);
    End(std::move(status));
  }
  void Close() { streams_.Remove(caller_, shared_from_this()); }

  [[nodiscard]] const absl::Status& end() const { return end_; }

 private:
  const std::string caller_;
  Streams& streams_;
  absl::Status end_;
};

// Streams that are told and answer in words.
class Table {
 public:
  std::string Tell(const std::string& event) {
    const std::vector<std::string> words = absl::StrSplit(event, ' ');
    if (words[0] == "close") {
      opened_.at(words[1])->Close();
      return "";
    }
    if (words[0] == "stop") {
      streams_.EndAll();
      return absl::StrCat(NewlyEnded().size());
    }
    int count = 1;
    EXPECT_TRUE(words.size() < 3 || absl::SimpleAtoi(words[2], &count)) << event;
    std::string answer;
    for (int i = 0; i < count; ++i) {
      answer = Open(words[0]);
    }
    return answer;
  }
  [[nodiscard]] const absl::Status& EndOf(const std::string& name) const {
    return opened_.at(name)->end();
  }

 private:
  std::string Open(const std::string& caller) {
    const auto stream = std::make_shared<Stream>(caller, &streams_);
    const absl::Status status = streams_.Add(caller, stream);
    const std::vector<std::string> ended = NewlyEnded();
    if (!status.ok()) {
      EXPECT_TRUE(ended.empty());
      EXPECT_EQ(base::RetryDelayOf(status).has_value(), absl::IsResourceExhausted(status));
      return std::string(status.message());
    }
    opened_[absl::StrCat(caller, ++last_of_[caller])] = stream;
    return ended.empty() ? "" : absl::StrCat("cut ", ended.front());
  }
  // Returns the names of the streams that have ended since the last call.
  std::vector<std::string> NewlyEnded() {
    std::vector<std::string> names;
    for (const auto& [name, stream] : opened_) {
      if (!stream->end().ok() && !ended_.contains(name)) {
        names.push_back(name);
        ended_[name] = stream;
      }
    }
    return names;
  }

  Streams streams_;
  std::map<std::string, int> last_of_;
  std::map<std::string, std::shared_ptr<Stream>> opened_;
  std::map<std::string, std::shared_ptr<Stream>> ended_;
};

void Check(absl::string_view rows, Table* table) {
  testing::CheckEvents(rows, [&](const std::string& event) { return table->Tell(event); });
}
void Check(absl::string_view rows) {
  Table table;
  Check(rows, &table);
}

TEST(InteractStreamsTest, OneCallerMayHaveAllUntilAnotherComes) {
  Table table;
  Check(R"(
      a x 256  ->
      a        -> 256 interactive streams are open, 256 of them of this caller:
                  retry later, with back-off
      b        -> cut a256
      b        -> cut a255
      a        -> 256 interactive streams are open, 254 of them of this caller:
                  retry later, with back-off)",
        &table);
  EXPECT_THAT(table.EndOf("a256"),
              StatusIs(absl::StatusCode::kResourceExhausted,
                       HasSubstr("this one made room for that of another caller")));
  EXPECT_TRUE(base::RetryDelayOf(table.EndOf("a256")).has_value());
}

TEST(InteractStreamsTest, ACallerGetsNoMoreThanTheOneWithMost) {
  Check(R"(
      a x 129  ->
      b x 127  ->
      b        -> cut a129
      b        -> 256 interactive streams are open, 128 of them of this caller:
                  retry later, with back-off
      a        -> 256 interactive streams are open, 128 of them of this caller:
                  retry later, with back-off
      c        -> cut a128)");
  Check(R"(
      a x 100  ->
      b x 99   ->
      c x 57   ->
      b        -> 256 interactive streams are open, 99 of them of this caller:
                  retry later, with back-off
      c        -> cut a100)");
}

TEST(InteractStreamsTest, TheNewestOfTheCallerWithMostMakesRoom) {
  Check(R"(
      b x 2    ->
      a x 100  ->
      c x 154  ->
      b        -> cut c154
      close c153  ->
      a           ->
      d           -> cut c152)");
}

TEST(InteractStreamsTest, AStreamThatEndsLeavesItsPlaceOnce) {
  Check(R"(
      a x 256     ->
      close a7    ->
      close a7    ->
      a           ->
      a           -> 256 interactive streams are open, 256 of them of this caller:
                     retry later, with back-off
      b           -> cut a257
      close a257  ->
      a           -> 256 interactive streams are open, 255 of them of this caller:
                     retry later, with back-off)");
}

TEST(InteractStreamsTest, AServerThatStopsEndsPresentAndFutureStreams) {
  Table table;
  Check(R"(
      a x 3  ->
      b      ->
      stop   -> 4
      a      -> the coordinator stops: connect again)",
        &table);
  EXPECT_THAT(table.EndOf("a2"), StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_EQ(base::ReasonOf(table.EndOf("a2")), base::ErrorReason::kServerStops);
}

}  // namespace
}  // namespace isoscope::server
