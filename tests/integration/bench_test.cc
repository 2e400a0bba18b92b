// `isoscope-bench` as users run it, with programs of other people played by scripts.

#include <csignal>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>
#include <sys/stat.h>

#include "core/base/units.h"
#include "core/io/file.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

using nlohmann::json;
using testing::CommandResult;
using ::testing::HasSubstr;
using testing::RunIsoscopeBench;

constexpr std::int64_t kMaxFileBytes = 64 * base::kMiB;

class BenchTest : public ::testing::Test {
 protected:
  BenchTest() : volume_(testing::GyroidVolume({25, 25, 25})) {
    EXPECT_THAT(io::CreateDirectory(folder_.Sub("tmp")), testing::IsOk());
    EXPECT_THAT(io::CreateDirectory(folder_.Sub("bin")), testing::IsOk());
    EXPECT_THAT(testing::WriteRawFile(volume_, folder_.Sub("gyroid.raw")), testing::IsOk());
  }

  // Everything temporary in a folder of the test's; `path`: where programs are looked for.
  [[nodiscard]] testing::ProcessOptions Options(const std::string& path) const {
    return {.environment = {"TMPDIR=" + folder_.Sub("tmp"), "PATH=" + path}};
  }
  [[nodiscard]] std::vector<std::string> Arguments(const std::vector<std::string>& head,
                                                   const std::vector<std::string>& tail) const {
    std::vector<std::string> arguments = head;
    arguments.push_back(folder_.Sub("gyroid.raw"));
    for (const std::vector<std::string>& more : {testing::RawFlags(volume_), tail}) {
      arguments.insert(arguments.end(), more.begin(), more.end());
    }
    return arguments;
  }
  [[nodiscard]] bool NothingIsLeftBehind() const {
    return std::filesystem::is_empty(folder_.Sub("tmp"));
  }
  // A program `name` in bin/.
  void MakeProgram(const std::string& name, const std::string& script) const {
    const std::string path = folder_.Sub("bin/" + name);
    std::ofstream(path) << "#!/bin/sh\n" << script;
    chmod(path.c_str(), S_IRWXU);
  }
  [[nodiscard]] std::string ReadFile(const std::string& name) const {
    absl::StatusOr<std::string> bytes = io::ReadWholeFile(folder_.Sub(name), kMaxFileBytes);
    EXPECT_THAT(bytes, testing::IsOk());
    return bytes.value_or("");
  }

  testing::TempDir folder_;
  const testing::TestVolume volume_;
};

constexpr char kSystemPath[] = "/usr/bin:/bin";

TEST_F(BenchTest, FramesAreTimedForEveryCaseBesideThePeer) {
  // It keeps what it is called with, and the samples that it is given.
  MakeProgram("xvfb-run", absl::StrCat("echo \"$*\" >> '", folder_.Sub("calls"), "'\ncp \"$6\" '",
                                       folder_.Sub("seen.raw"),
                                       "'\necho '{\"cold_total\": 100, \"next_total\": 50, "
                                       "\"triangles\": 7}'\n"));
  std::ofstream(folder_.Sub("yard.py")) << "# not run: xvfb-run is ours\n";
  const CommandResult result =
      RunIsoscopeBench(Arguments({"frame"}, {"--isovalue",
                                             "128",
                                             "--shards",
                                             "1,2",
                                             "--culling",
                                             "depth",
                                             "none",
                                             "--renderer",
                                             "cpu",
                                             "--runs",
                                             "2",
                                             "--frames",
                                             "3",
                                             "--width",
                                             "64",
                                             "--height",
                                             "64",
                                             "--peer",
                                             folder_.Sub("yard.py"),
                                             "--json",
                                             folder_.Sub("bench.json")}),
                       Options(absl::StrCat(folder_.Sub("bin"), ":", kSystemPath)));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("gyroid.raw"));
  EXPECT_THAT(result.out, HasSubstr("peer cold"));
  EXPECT_TRUE(NothingIsLeftBehind());
  EXPECT_EQ(ReadFile("seen.raw"), volume_.samples);
  const std::vector<std::string> calls = absl::StrSplit(ReadFile("calls"), '\n', absl::SkipEmpty());
  ASSERT_EQ(calls.size(), 2) << "once a run";
  EXPECT_THAT(calls[0], HasSubstr("--dims 25,25,25 --type uint8 --isovalue 128 --frames 3 "
                                  "--orbit 7 --size 64"));

  const json bench = json::parse(ReadFile("bench.json"), nullptr, /*allow_exceptions=*/false);
  ASSERT_EQ(bench["cases"].size(), 4);
  std::vector<double> triangles;
  for (const json& of : bench["cases"]) {
    EXPECT_EQ(of["wall_ms"].size(), 2);
    EXPECT_EQ(of["wall_ms"][0].size(), 3);
    EXPECT_GT(of["first"]["wall_ms"], 0.0);
    EXPECT_EQ(of["first"]["busy_ms"].size(), of["agents"]);
    triangles.push_back(of["first"]["triangle_count"].get<double>());
  }
  EXPECT_EQ(triangles[0], triangles[1]) << "culling depends on the number of agents";
  EXPECT_EQ(triangles[2], triangles[3]);
  EXPECT_LE(triangles[0], triangles[2]);
  EXPECT_EQ(bench["peers"][0]["cold_ms"], 100.0);
}

TEST_F(BenchTest, AFolderIsTimedAsItIsAndAPeerNeedsTheVolume) {
  ASSERT_THAT(testing::MakeDataset(volume_, folder_.Sub("dataset"), 2, 8), testing::IsOk());
  const CommandResult result =
      RunIsoscopeBench({"frame", folder_.Sub("dataset"), "--isovalue", "128", "--runs", "1",
                        "--frames", "2", "--width", "64", "--height", "64", "--renderer", "cpu"},
                       Options(kSystemPath));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.out.find("peer"), std::string::npos);
  const CommandResult refused = RunIsoscopeBench(
      {"frame", folder_.Sub("dataset"), "--isovalue", "128", "--peer", folder_.Sub("yard.py")},
      Options(kSystemPath));
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("--peer is for volume files"));
}

TEST_F(BenchTest, APeerThatFailsIsQuotedAndNothingIsLeft) {
  MakeProgram("xvfb-run", "echo 'ModuleNotFoundError: no vtk' >&2\nexit 1\n");
  std::ofstream(folder_.Sub("yard.py")) << "";
  const CommandResult result =
      RunIsoscopeBench(Arguments({"frame"}, {"--isovalue", "128", "--runs", "1", "--width", "64",
                                             "--height", "64", "--peer", folder_.Sub("yard.py")}),
                       Options(absl::StrCat(folder_.Sub("bin"), ":", kSystemPath)));
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr("ModuleNotFoundError: no vtk"));
  EXPECT_TRUE(NothingIsLeftBehind());
}

TEST_F(BenchTest, AnInterruptLeavesNothingBehind) {
  // It never ends by itself.
  MakeProgram("xvfb-run", absl::StrCat("touch '", folder_.Sub("started"), "'\nsleep 1000\n"));
  std::ofstream(folder_.Sub("yard.py")) << "";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::unique_ptr<testing::Process> process,
      testing::StartIsoscopeBench(
          Arguments({"frame"}, {"--isovalue", "128", "--width", "64", "--height", "64", "--peer",
                                folder_.Sub("yard.py")}),
          Options(absl::StrCat(folder_.Sub("bin"), ":", kSystemPath))));
  while (!io::PathExists(folder_.Sub("started")) &&
         absl::IsDeadlineExceeded(process->Wait(absl::Milliseconds(10)).status())) {
  }
  process->Signal(SIGINT);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const int exit_code, process->Wait(testing::kPatience));
  EXPECT_EQ(exit_code, 130);
  EXPECT_THAT(process->err(), HasSubstr("CANCELLED"));
  EXPECT_TRUE(NothingIsLeftBehind());
}

// The pictures of both ways are compared inside: a difference is an error.
TEST_F(BenchTest, FramesOfTheOwnersAreTimedBesideWholeFrames) {
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(volume_, folder_.Sub("dataset"), 3, 4));
  const CommandResult result = RunIsoscopeBench(
      {"owners", folder_.Sub("dataset"), "--isovalue", "128", "--runs", "2", "--frames", "3",
       "--width", "96", "--height", "80", "--json", folder_.Sub("owners.json")},
      Options(kSystemPath));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("whole / owners: "));
  const json owners = json::parse(ReadFile("owners.json"), nullptr, /*allow_exceptions=*/false);
  EXPECT_GT(owners["owners"]["block_count"], 0);
  EXPECT_LE(owners["owners"]["block_count"], owners["whole"]["block_count"]);
  EXPECT_LE(owners["whole"]["block_count"], owners["active_block_count"]);
  EXPECT_GT(owners["owners"]["triangle_count"], 0);
  ASSERT_EQ(owners["whole_ms"].size(), 2);
  EXPECT_EQ(owners["owners_ms"][1].size(), 3);

  const CommandResult without = RunIsoscopeBench({"owners", folder_.Sub("dataset")});
  EXPECT_EQ(without.exit_code, 2);
  EXPECT_THAT(without.err, HasSubstr("--isovalue V is missing"));
}

TEST_F(BenchTest, ThePaperIsRepeatedWithoutGnuplotToo) {
  const std::vector<std::string> tail = {"--output",         folder_.Sub("paper"),
                                         "--isovalues",      "auto",
                                         "--levels",         "2",
                                         "--runs",           "1",
                                         "--size",           "64",
                                         "--agents",         "2",
                                         "--balance-agents", "2,3"};
  // bin/ is empty: there is no gnuplot.
  const CommandResult result =
      RunIsoscopeBench(Arguments({"paper"}, tail), Options(folder_.Sub("bin")));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.err, HasSubstr("no plots: gnuplot is not installed"));
  EXPECT_TRUE(NothingIsLeftBehind());
  for (const char* name : {"figure1_balance.csv", "figure1_bound.csv", "figure6.csv", "figure6.gp",
                           "figure7_agents.csv", "figure7_speedup.csv", "figure8.csv",
                           "figure9.csv", "figure9_c_side.png"}) {
    EXPECT_NE(ReadFile(absl::StrCat("paper/", name)), "") << name;
  }
  EXPECT_THAT(ReadFile("paper/report.md"), HasSubstr("one at a time"));
  const CommandResult again =
      RunIsoscopeBench(Arguments({"paper"}, tail), Options(folder_.Sub("bin")));
  EXPECT_EQ(again.exit_code, 1);
  EXPECT_THAT(again.err, HasSubstr("ALREADY_EXISTS"));
}

}  // namespace
}  // namespace isoscope
