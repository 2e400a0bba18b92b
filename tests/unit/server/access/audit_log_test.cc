#include "server/access/audit_log.h"

#include <cstddef>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::server {
namespace {

using testing::StatusIs;

std::vector<std::string> LinesOf(const std::string& path) {
  const absl::StatusOr<std::string> text = io::ReadWholeFile(path, 1 << 20);
  return text.ok() ? std::vector<std::string>(absl::StrSplit(*text, '\n', absl::SkipEmpty()))
                   : std::vector<std::string>();
}

TEST(AuditLogTest, ALineIsAJsonObjectWhateverNamesHold) {
  const AuditRecord record{.caller = "a \"b\"",
                           .certificate = "cn",
                           .peer = "ipv4:1.2.3.4:5",
                           .dataset = "x\ny\x1b",
                           .dataset_id = "01"};
  EXPECT_EQ(
      FormatAuditLine(absl::UnixEpoch() + absl::Milliseconds(1500), "PickSurface", record, "77",
                      absl::NotFoundError("no")),
      R"({"time":"1970-01-01T00:00:01.500Z","caller":"a \"b\"","certificate":"cn",)"
      R"("peer":"ipv4:1.2.3.4:5","method":"PickSurface","dataset":"x\ny\u001b","dataset_id":"01",)"
      R"("request":"77","code":"NOT_FOUND","reason":"DATASET_UNKNOWN"})"
      "\n");
  EXPECT_FALSE(absl::StrContains(
      FormatAuditLine(absl::UnixEpoch(), "PickSurface", record, "77", absl::OkStatus()), "reason"));
}

// Symptom: a dataset name of 900 kB was a line of the audit log, before anybody knew who called.
TEST(AuditLogTest, NamesOfCallersAreCut) {
  const std::string name(900'000, 'x');
  const AuditRecord record{.caller = name, .certificate = name, .peer = name, .dataset = name};
  const std::string line =
      FormatAuditLine(absl::UnixEpoch(), "GetDataset", record, "77", absl::NotFoundError(name));
  EXPECT_LT(line.size(), 2000u);
  for (const char* member : {"caller", "certificate", "peer", "dataset"}) {
    EXPECT_TRUE(absl::StrContains(line, absl::StrCat("\"", member, "\":\"", name.substr(0, 256),
                                                     "... (cut, 900000 bytes)\"")))
        << member;
  }
}

TEST(AuditLogTest, LinesOfManyThreadsAreAppendedWhole) {
  const testing::TempDir folder;
  const std::string path = folder.Sub("audit.log");
  constexpr int kThreads = 8;
  constexpr int kLines = 50;
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto log, AuditLog::Open(path));
    std::vector<std::thread> threads;
    for (int i = 0; i < kThreads; ++i) {
      threads.emplace_back([&log, i] {
        for (int line = 0; line < kLines; ++line) {
          log->Write("Interact",
                     {.dataset = std::string(static_cast<std::size_t>(100 * (i + 1)), 'd')}, "1",
                     absl::OkStatus());
        }
      });
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
    EXPECT_EQ(log->written_lines(), kThreads * kLines);
    EXPECT_EQ(log->failed_lines(), 0);
  }
  const std::vector<std::string> lines = LinesOf(path);
  ASSERT_EQ(lines.size(), std::size_t{kThreads * kLines});
  for (const std::string& line : lines) {
    EXPECT_TRUE(absl::StartsWith(line, "{\"time\":") && absl::EndsWith(line, "\"code\":\"OK\"}"))
        << line;
  }
  // A program that starts again goes on behind them.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto again, AuditLog::Open(path));
  again->Write("Interact", {}, "1", absl::OkStatus());
  EXPECT_EQ(LinesOf(path).size(), std::size_t{kThreads * kLines + 1});
}

TEST(AuditLogTest, AFileThatWasMovedAwayIsMadeAnew) {
  const testing::TempDir folder;
  const std::string path = folder.Sub("audit.log");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto log, AuditLog::Open(path));
  log->Write("Interact", {}, "1", absl::OkStatus());
  ASSERT_EQ(std::rename(path.c_str(), folder.Sub("audit.log.1").c_str()), 0);
  log->Write("Interact", {}, "2", absl::OkStatus());
  EXPECT_EQ(LinesOf(folder.Sub("audit.log.1")).size(), 1u);
  ASSERT_EQ(LinesOf(path).size(), 1u);
  EXPECT_TRUE(absl::StrContains(LinesOf(path)[0], "\"request\":\"2\""));
}

TEST(AuditLogTest, LinesThatCannotBeWrittenAreCounted) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto log, AuditLog::Open("/dev/full"));
  log->Write("Interact", {}, "1", absl::OkStatus());
  EXPECT_EQ(log->failed_lines(), 1);
  EXPECT_THAT(AuditLog::Open("/nonexistent/audit.log"), StatusIs(absl::StatusCode::kNotFound));
}

}  // namespace
}  // namespace isoscope::server
