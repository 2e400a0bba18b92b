// `isoscope export` as its users type it: formats, islands, simplification.

#include <algorithm>
#include <cstdint>
#include <map>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

using testing::CommandResult;
using testing::Join;

// The indices of a binary PLY of this program, by its header.
struct PlyCounts {
  std::size_t vertex_count = 0;
  std::vector<std::uint32_t> triangles;
};
PlyCounts ReadPly(const std::string& bytes, std::size_t vertex_bytes) {
  PlyCounts mesh;
  const auto count_of = [&](const std::string& element) {
    return std::stoull(bytes.substr(bytes.find(element) + element.size()));
  };
  mesh.vertex_count = count_of("element vertex ");
  const std::size_t face_count = count_of("element face ");
  const std::size_t faces = bytes.find("end_header\n") + 11 + mesh.vertex_count * vertex_bytes;
  EXPECT_EQ(bytes.size(), faces + 13 * face_count);
  for (std::size_t i = 0; i < face_count; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto vertex =
          base::LoadLittleEndian<std::uint32_t>(bytes.data() + faces + 13 * i + 1 + 4 * k);
      EXPECT_LT(vertex, mesh.vertex_count);
      mesh.triangles.push_back(vertex);
    }
  }
  return mesh;
}

// True if each edge has as many triangles on one side as on the other.
bool HasNoHole(const std::vector<std::uint32_t>& triangles) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const std::uint32_t a = triangles[i];
    const std::uint32_t b = triangles[i % 3 == 2 ? i - 2 : i + 1];
    edges[std::minmax(a, b)] += a < b ? 1 : -1;
  }
  for (const auto& [edge, balance] : edges) {
    if (balance != 0) {
      return false;
    }
  }
  return true;
}

class ExportTest : public ::testing::Test {
 protected:
  void SetUp() override {
    // A ball, and samples of 255 alone: islands of 8 triangles each.
    testing::TestVolume volume = testing::BallVolume({40, 38, 36}, 0.6);
    for (const std::size_t at : {std::size_t{2 + 40 * (2 + 38 * 2)}, std::size_t{36 + 40 * 80}}) {
      volume.samples[at] = static_cast<char>(255);
    }
    ISOSCOPE_ASSERT_OK(testing::MakeDataset(volume, Path("one"), 1, 8));
    ISOSCOPE_ASSERT_OK(testing::MakeDataset(volume, Path("three"), 3, 8));
  }

  [[nodiscard]] std::string Path(const std::string& name) const { return directory_.Sub(name); }
  [[nodiscard]] CommandResult Export(const std::string& output,
                                     const std::vector<std::string>& flags,
                                     const std::string& dataset = "one",
                                     const std::string& isovalue = "127.5") const {
    return testing::RunIsoscope(
        Join({"export", Path(dataset), "--isovalue", isovalue, "--output", Path(output)}, flags));
  }
  std::string MustExport(const std::string& output, const std::vector<std::string>& flags,
                         const std::string& dataset = "one",
                         const std::string& isovalue = "127.5") {
    const CommandResult result = Export(output, flags, dataset, isovalue);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    out_ = result.out;
    absl::StatusOr<std::string> bytes = io::ReadWholeFile(Path(output), 64 * base::kMiB);
    EXPECT_THAT(bytes, testing::IsOk());
    return bytes.value_or("");
  }

  testing::TempDir directory_;
  std::string out_;  // what the last MustExport said
};

TEST_F(ExportTest, EveryFormatIsTheSameForAnyNumberOfShards) {
  for (const char* name : {"m.ply", "m.stl", "m.obj", "m.glb", "m.vtp"}) {
    SCOPED_TRACE(name);
    const std::string one = MustExport(name, {});
    EXPECT_GT(one.size(), 10'000U);
    EXPECT_TRUE(MustExport(name, {}, "three") == one);
  }
  EXPECT_TRUE(MustExport("m.stl", {}) == MustExport("m", {"--format", "stl"}));
}

TEST_F(ExportTest, IslandsAreDroppedAndSaid) {
  const PlyCounts all = ReadPly(MustExport("all.ply", {}), 24);
  const PlyCounts large = ReadPly(MustExport("large.ply", {"--min-component", "9"}), 24);
  EXPECT_TRUE(absl::StrContains(out_, "dropped 2 of 3 components, 16 of ")) << out_;
  EXPECT_EQ(all.triangles.size(), large.triangles.size() + std::size_t{48});
  EXPECT_EQ(all.vertex_count, large.vertex_count + 12);
  EXPECT_TRUE(HasNoHole(large.triangles));
  EXPECT_EQ(ReadPly(MustExport("same.ply", {"--min-component", "8"}), 24).triangles.size(),
            all.triangles.size());
}

// Two surfaces of the ball, and half of each: the same bytes for one shard, three shards, and three
// agents.
TEST_F(ExportTest, ClippedSurfacesAreTheSameForAnyNumberOfShards) {
  const std::vector<std::string> flags{"--surface",  "127.5:1,0.5,0",      "--surface",
                                       "60",         "--clip-plane",       "1,0.2,0,20",
                                       "--clip-box", "0,33.5,0,99,3.25,30"};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                testing::ProcessCluster::Start(Path("three"), 3));
  for (const char* name : {"m.ply", "m.obj", "m.glb", "m.vtp"}) {
    SCOPED_TRACE(name);
    const auto run = [&](const std::vector<std::string>& from) {
      const CommandResult result =
          testing::RunIsoscope(Join(Join({"export", "--output", Path(name)}, from), flags));
      EXPECT_EQ(result.exit_code, 0) << result.err;
      return io::ReadWholeFile(Path(name), 64 * base::kMiB).value_or("");
    };
    const std::string one = run({Path("one")});
    EXPECT_GT(one.size(), 10'000U);
    EXPECT_TRUE(run({Path("three")}) == one);
    EXPECT_TRUE(run({"--server", cluster->address()}) == one);
  }
}

// Nothing lies outside, open edges lie on the borders alone, and the first surface is what it is
// without the second.
TEST_F(ExportTest, ClippedSurfaceIsOpenAtTheBordersAlone) {
  const auto read = [&](const std::vector<std::string>& surfaces) {
    const std::vector<std::string> all = Join(
        {"export", Path("one"), "--output", Path("m.obj"), "--clip-plane", "0,0,1,12.5"}, surfaces);
    const CommandResult result = testing::RunIsoscope(all);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return io::ReadWholeFile(Path("m.obj"), 64 * base::kMiB).value_or("");
  };
  const std::string one = read({"--isovalue", "127.5"});
  std::vector<double> heights;
  std::map<std::pair<std::size_t, std::size_t>, int> edges;
  std::istringstream lines(one);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream in(line);
    std::string word;
    in >> word;
    if (word == "v") {
      double x = 0;
      double y = 0;
      in >> x >> y >> heights.emplace_back();
      EXPECT_GE(heights.back(), 12.5 - 1e-5);
    } else if (word == "f") {
      std::vector<std::size_t> corners;
      for (std::string corner; in >> corner;) {
        corners.push_back(std::stoul(corner) - 1);
      }
      for (std::size_t k = 0; k < 3; ++k) {
        ++edges[std::minmax(corners[k], corners[(k + 1) % 3])];
      }
    }
  }
  int open_count = 0;
  for (const auto& [edge, count] : edges) {
    if (count == 1) {
      ++open_count;
      EXPECT_NEAR(heights[edge.first], 12.5, 1e-5);
      EXPECT_NEAR(heights[edge.second], 12.5, 1e-5);
    }
  }
  EXPECT_GT(open_count, 50);
  const std::string two = read({"--surface", "127.5", "--surface", "60"});
  const std::string head = "# isoscope\no surface_0_isovalue_127.5\n";
  EXPECT_EQ(two.substr(0, head.size()), head);
  EXPECT_TRUE(two.substr(head.size(), one.size() - 11) == one.substr(11));
}

TEST_F(ExportTest, IslandsAndSharesAreThoseOfEachSurface) {
  const auto export_to = [&](const std::string& name, const std::vector<std::string>& flags) {
    const CommandResult result =
        testing::RunIsoscope(Join({"export", Path("one"), "--output", Path(name)}, flags));
    EXPECT_EQ(result.exit_code, 0) << result.err;
    out_ = result.out;
    return io::ReadWholeFile(Path(name), 64 * base::kMiB).value_or("");
  };
  const std::vector<std::string> filters{"--min-component", "9", "--simplify", "0.3"};
  std::vector<std::uint32_t> expected;
  std::size_t vertex_count = 0;
  for (const char* isovalue : {"127.5", "60"}) {
    const PlyCounts alone =
        ReadPly(export_to("a.ply", Join({"--isovalue", isovalue}, filters)), 24);
    for (const std::uint32_t vertex : alone.triangles) {
      expected.push_back(static_cast<std::uint32_t>(vertex_count) + vertex);
    }
    vertex_count += alone.vertex_count;
  }
  const PlyCounts both =
      ReadPly(export_to("b.ply", Join({"--surface", "127.5", "--surface", "60"}, filters)), 25);
  EXPECT_TRUE(absl::StrContains(out_, "dropped 4 of 6 components, 32 of ")) << out_;
  EXPECT_EQ(both.vertex_count, vertex_count);
  EXPECT_TRUE(both.triangles == expected);
}

TEST_F(ExportTest, SimplifiedSurfaceHasTheShareAndNoHole) {
  const PlyCounts all = ReadPly(MustExport("all.ply", {"--min-component", "9"}), 24);
  const PlyCounts few = ReadPly(
      MustExport("few.ply", {"--min-component", "9", "--simplify", "0.25", "--color", "1,0,0"}),
      27);
  EXPECT_NEAR(static_cast<double>(few.triangles.size()),
              0.25 * static_cast<double>(all.triangles.size()), 30);
  EXPECT_TRUE(HasNoHole(few.triangles));
  EXPECT_TRUE(MustExport("again.ply", {"--simplify-error", "0.3"}) ==
              MustExport("again.ply", {"--simplify-error", "0.3"}, "three"));
}

// All samples are whole numbers, so at a whole isovalue many vertices have one place.
TEST_F(ExportTest, WholeIsovaluesSimplifyAsWellAsOthers) {
  const PlyCounts few = ReadPly(MustExport("few.ply", {"--simplify", "0.25"}, "one", "128"), 24);
  const PlyCounts all = ReadPly(MustExport("all.ply", {}, "one", "128"), 24);
  EXPECT_LT(static_cast<double>(few.triangles.size()),
            0.26 * static_cast<double>(all.triangles.size()));
  EXPECT_TRUE(HasNoHole(few.triangles));
}

TEST_F(ExportTest, FlagsThatDoNotFitAreWrongUsageAndLeaveNoFile) {
  struct Case {
    std::string output;
    std::vector<std::string> flags;
    std::string message;
  };
  for (const Case& c : std::vector<Case>{{"m.fbx", {}, ".ply, .stl, .obj, .glb, .vtp"},
                                         {"m.stl", {"--format", "ply"}, "--format ply"},
                                         {"m.stl", {"--color", "1,1,1"}, "has none"},
                                         {"m.ply", {"--surface", "1"}, "exclude each other"},
                                         {"m.ply", {"--clip-plane", "0,0,0,1"}, "--clip-plane"},
                                         {"m.ply", {"--clip-box", "1,0,0,1,0,1"}, "--clip-box"},
                                         {"m.ply", {"--format", "fbx"}, "none of: ply"},
                                         {"m.ply", {"--simplify", "1"}, "above 0 and below 1"},
                                         {"m.ply", {"--simplify", "0"}, "above 0 and below 1"},
                                         {"m.ply", {"--simplify", "nan"}, "above 0 and below 1"},
                                         {"m.ply", {"--simplify-error", "0"}, "--simplify-error"},
                                         {"m.ply", {"--min-component", "0"}, "--min-component"}}) {
    const CommandResult result = Export(c.output, c.flags);
    EXPECT_EQ(result.exit_code, 2) << c.message << ": " << result.err;
    EXPECT_TRUE(absl::StrContains(result.err, c.message)) << result.err;
    EXPECT_FALSE(io::PathExists(Path(c.output)));
  }
}

TEST_F(ExportTest, FullDiskIsAnErrorAndLeavesNothing) {
  for (const char* name : {"m.stl", "m.glb"}) {
    const CommandResult result = testing::RunIsoscope(
        {"export", Path("one"), "--isovalue", "127.5", "--output", Path(name), "--simplify", "0.9"},
        {.environment = {}, .max_file_bytes = 20'000});
    EXPECT_EQ(result.exit_code, 1) << result.err;
    EXPECT_FALSE(io::PathExists(Path(name)));
  }
}

}  // namespace
}  // namespace isoscope
