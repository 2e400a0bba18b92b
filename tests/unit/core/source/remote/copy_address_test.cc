#include "core/source/remote/copy_address.h"

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/mutex.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/io/file_lock.h"
#include "tests/support/folder_test.h"
#include "tests/support/scripted_server.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/source/remote/remote_test.h"

namespace isoscope::source {
namespace {

using testing::Answer;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::ScriptedServer;
using testing::ServedConnection;
using testing::ServedRequest;
using testing::StatusIs;

class CopyAddressTest : public testing::FolderTest {
 protected:
  CopyAddressTest()
      : bytes_(RemoteBytes(7 * base::kMiB + 5)),
        server_([this](const ServedRequest& request, ServedConnection* connection) {
          if (testing::AskedRange(request, 1 << 30).second >= end_) {
            connection->Send(Answer(404, "", ""));
          } else {
            testing::ServeObject(Served(), request, connection);
          }
        }) {
    Publish();
  }

  // What the server has from now on: bytes_ and etag_ are the test's own.
  void Publish() {
    const base::MutexLock lock(&mutex_);
    served_ = {.bytes = bytes_, .etag = etag_};
  }
  testing::ServedObject Served() {
    const base::MutexLock lock(&mutex_);
    return served_;
  }

  absl::StatusOr<CopyReport> Copy(const std::string& path = "/a/vol%20ume.raw") {
    Publish();
    notes_.clear();
    const base::Cancellation never;
    return CopyAddress(server_.origin() + path, dir_.Sub("out"), QuickOptions(),
                       {.progress =
                            [this](std::int64_t done, std::int64_t total) {
                              EXPECT_LE(done, total);
                              last_done_ = done;
                            },
                        .note = [this](const std::string& note) { notes_.push_back(note); }},
                       never);
  }
  std::string Copied() const {
    const auto bytes = io::ReadWholeFile(dir_.Sub("out/vol ume.raw"), 1 << 30);
    return bytes.ok() ? *bytes : std::string(bytes.status().message());
  }
  std::size_t FileCount() const {
    std::size_t count = 0;
    for (const auto& entry : std::filesystem::directory_iterator(dir_.Sub("out"))) {
      count += static_cast<std::size_t>(entry.is_regular_file());
    }
    return count;
  }
  // The server refuses ranges that end at this byte or behind it.
  void BreakAt(std::int64_t end) { end_ = end; }
  void Mend() { end_ = 1 << 30; }

  std::string bytes_;
  std::string etag_ = "\"v1\"";
  std::int64_t last_done_ = 0;
  std::vector<std::string> notes_;
  std::atomic<std::int64_t> end_{1 << 30};
  base::Mutex mutex_;
  testing::ServedObject served_ ABSL_GUARDED_BY(mutex_);
  // A copy that failed may leave requests behind: the server ends before what it refers to.
  ScriptedServer server_;
};

TEST_F(CopyAddressTest, CopiesTheBytes) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CopyReport report, Copy());
  EXPECT_EQ(report.path, dir_.Sub("out/vol ume.raw"));
  EXPECT_EQ(report.size_bytes, 7 * base::kMiB + 5);
  EXPECT_EQ(report.kept_bytes, 0);
  EXPECT_EQ(last_done_, report.size_bytes);
  EXPECT_EQ(Copied(), bytes_);
  EXPECT_EQ(FileCount(), 1u);
  EXPECT_THAT(notes_, IsEmpty());
  EXPECT_THAT(Copy(), StatusIs(absl::StatusCode::kAlreadyExists, HasSubstr("vol ume.raw")));
  EXPECT_EQ(FileCount(), 1u);
}

TEST_F(CopyAddressTest, GoesOnWhereItEnded) {
  BreakAt(3 * base::kMiB);  // in the second stretch
  EXPECT_THAT(Copy(), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_FALSE(std::filesystem::exists(dir_.Sub("out/vol ume.raw")));
  const std::size_t before = server_.requests().size();
  Mend();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CopyReport report, Copy());
  EXPECT_EQ(report.kept_bytes, 2 * base::kMiB);
  EXPECT_THAT(notes_, ElementsAre(HasSubstr("goes on after 2097152 of")));
  EXPECT_EQ(Copied(), bytes_);
  EXPECT_EQ(FileCount(), 1u);
  // Nothing is asked for twice but the first bytes, which open the object.
  const std::vector<ServedRequest> requests = server_.requests();
  for (std::size_t i = before; i < requests.size(); ++i) {
    const auto [first, last] = testing::AskedRange(requests[i], report.size_bytes);
    EXPECT_TRUE(first >= report.kept_bytes || last == 1) << first << " to " << last;
  }
}

TEST_F(CopyAddressTest, BeginsAgainIfTheObjectHasChanged) {
  const auto restart = [&](const char* why) {
    Mend();
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CopyReport report, Copy());
    EXPECT_EQ(report.kept_bytes, 0);
    EXPECT_THAT(notes_, ElementsAre(::testing::AllOf(HasSubstr("begins again"), HasSubstr(why))));
    EXPECT_EQ(Copied(), bytes_);
    std::filesystem::remove(dir_.Sub("out/vol ume.raw"));
    EXPECT_EQ(FileCount(), 0u);
  };
  const auto begin = [&] {
    BreakAt(3 * base::kMiB);
    EXPECT_FALSE(Copy().ok());
  };
  begin();
  bytes_[5] ^= 1;
  etag_ = "\"v2\"";
  restart("its version was");
  begin();
  bytes_ += "more";
  restart("bytes, and has");
  begin();
  std::filesystem::resize_file(dir_.Sub("out/vol ume.raw.part"), 1000);
  restart("ends after 1000 bytes");
  begin();
  std::filesystem::remove(dir_.Sub("out/vol ume.raw.part.record"));
  restart("no record");
  begin();
  Write("out/vol ume.raw.part.record", "isoscope copy 1\nx\n\n9\n99\n");
  restart("no record");
  begin();
  Mend();
  ISOSCOPE_ASSERT_OK(Copy("/other/vol%20ume.raw"));
  EXPECT_THAT(notes_, ElementsAre(HasSubstr("is of http://")));
  std::filesystem::remove(dir_.Sub("out/vol ume.raw"));
  etag_ = "";
  begin();
  restart("no ETag and no time");
}

// A crash between a write and its record leaves more bytes than the record counts.
TEST_F(CopyAddressTest, BytesBehindTheRecordAreCut) {
  BreakAt(3 * base::kMiB);
  EXPECT_FALSE(Copy().ok());
  std::filesystem::resize_file(dir_.Sub("out/vol ume.raw.part"), 5'000'000);
  Mend();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CopyReport report, Copy());
  EXPECT_EQ(report.kept_bytes, 2 * base::kMiB);
  EXPECT_EQ(Copied(), bytes_);
}

TEST_F(CopyAddressTest, EmptyObjectsAreFiles) {
  bytes_.clear();
  ISOSCOPE_ASSERT_OK(Copy());
  EXPECT_EQ(Copied(), "");
  EXPECT_EQ(FileCount(), 1u);
}

TEST_F(CopyAddressTest, RefusesByName) {
  for (const char* const path : {"", "/", "/a%2Fb", "/?x=1"}) {
    EXPECT_THAT(Copy(path), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no name of")))
        << path;
  }
  EXPECT_THAT(Copy("/a/"), StatusIs(absl::StatusCode::kNotFound, HasSubstr("no index")));
  EXPECT_THAT(Copy("/a/b%2Fc"), StatusIs(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(Copy("/" + std::string(250, 'n')), StatusIs(absl::StatusCode::kInvalidArgument));
  BreakAt(0);
  EXPECT_THAT(Copy(), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_FALSE(std::filesystem::exists(dir_.Sub("out")));
  Mend();
  const base::Cancellation never;
  EXPECT_THAT(CopyAddress("head.nrrd", dir_.path(), QuickOptions(), {}, never),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no scheme")));
  EXPECT_THAT(CopyAddress(server_.origin() + "/a", dir_.Sub("no/such"), QuickOptions(), {}, never),
              StatusIs(absl::StatusCode::kNotFound));
}

// Symptom: a redirect to a file left an empty folder behind.
TEST_F(CopyAddressTest, ACopyThatIsRefusedLeavesNoFolder) {
  const ScriptedServer server([](const ServedRequest&, ServedConnection* connection) {
    connection->Send(Answer(302, "Location: file:///etc/passwd\r\n", ""));
  });
  const base::Cancellation never;
  const auto copy = [&] {
    return CopyAddress(server.origin() + "/a.raw", dir_.Sub("out"), QuickOptions(), {}, never)
        .status();
  };
  EXPECT_THAT(copy(), StatusIs(absl::StatusCode::kFailedPrecondition));
  EXPECT_FALSE(std::filesystem::exists(dir_.Sub("out")));
  std::filesystem::create_directory(dir_.Sub("out"));
  EXPECT_THAT(copy(), StatusIs(absl::StatusCode::kFailedPrecondition));
  EXPECT_TRUE(std::filesystem::exists(dir_.Sub("out")));
}

TEST_F(CopyAddressTest, CancellationKeepsWhatCame) {
  base::Cancellation cancellation;
  const auto report = CopyAddress(
      server_.origin() + "/a/vol%20ume.raw", dir_.Sub("out"), QuickOptions(),
      {.progress = [&](std::int64_t, std::int64_t) { cancellation.Cancel(); }}, cancellation);
  EXPECT_THAT(report, StatusIs(absl::StatusCode::kCancelled));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CopyReport second, Copy());
  EXPECT_EQ(second.kept_bytes, 2 * base::kMiB);
  EXPECT_EQ(Copied(), bytes_);
}

// python3 -m http.server, for instance.
TEST_F(CopyAddressTest, TakesAnObjectWholeWhereThereAreNoRanges) {
  std::atomic<int> cut_count{2};
  ScriptedServer server([&](const ServedRequest& request, ServedConnection* connection) {
    if (request.target == "/folder") {
      connection->Send("HTTP/1.1 301 X\r\nLocation: /folder/\r\nContent-Length: 0\r\n\r\n");
      return;
    }
    if (request.target == "/folder/") {
      connection->Send(Answer(200, "", "<a href=\"x\">x</a>"));
      return;
    }
    const std::string answer = Answer(200, "", bytes_);
    const bool is_cut = request.Header("range").empty() && cut_count-- > 0;
    connection->Send(is_cut ? answer.substr(0, answer.size() / 2) : answer);
    if (is_cut || !request.Header("range").empty()) {
      connection->Close();
    }
  });
  const base::Cancellation never;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const CopyReport report,
      CopyAddress(server.origin() + "/vol%20ume.raw", dir_.Sub("out"), QuickOptions(), {}, never));
  EXPECT_EQ(report.size_bytes, static_cast<std::int64_t>(bytes_.size()));
  EXPECT_EQ(report.kept_bytes, 0);
  EXPECT_EQ(Copied(), bytes_);
  EXPECT_EQ(FileCount(), 1u);
  // A server that leads to the page of a folder has no object there.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const CopyReport folder,
      CopyAddress(server.origin() + "/folder", dir_.Sub("out"), QuickOptions(), {}, never));
  EXPECT_EQ(folder.object_count, 1);
  EXPECT_TRUE(std::filesystem::is_directory(dir_.Sub("out/folder")));
}

// A body with the length that its head says may be a part of the object all the same: only the answer
// before it tells. Without CopyWhole's `expected`, half of the object is copied.
TEST_F(CopyAddressTest, AWholeObjectHasTheSizeThatTheServerSaidBefore) {
  ScriptedServer server([&](const ServedRequest& request, ServedConnection* connection) {
    const bool is_whole = request.Header("range").empty();
    connection->Send(Answer(200, "", is_whole ? bytes_.substr(0, bytes_.size() / 2) : bytes_));
    connection->Close();
  });
  const base::Cancellation never;
  EXPECT_THAT(
      CopyAddress(server.origin() + "/vol%20ume.raw", dir_.Sub("out"), QuickOptions(), {}, never),
      StatusIs(absl::StatusCode::kDataLoss, HasSubstr("it had 7340037 bytes, and has 3670018")));
  EXPECT_FALSE(std::filesystem::exists(dir_.Sub("out/vol ume.raw")));
}

// An error of the first request does not say that the server knows no ranges.
TEST_F(CopyAddressTest, TakesNoObjectWholeAfterAnotherError) {
  ScriptedServer server([&](const ServedRequest& request, ServedConnection* connection) {
    connection->Send(Answer(request.Header("range").empty() ? 200 : 400, "", bytes_));
  });
  const base::Cancellation never;
  EXPECT_THAT(
      CopyAddress(server.origin() + "/vol%20ume.raw", dir_.Sub("out"), QuickOptions(), {}, never),
      StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("400")));
  EXPECT_FALSE(std::filesystem::exists(dir_.Sub("out/vol ume.raw")));
}

}  // namespace
}  // namespace isoscope::source
