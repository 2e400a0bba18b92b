// The command line as its users type it: partition, info, serve, render, export, and what they
// promise about each other.

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "core/base/coding.h"
#include "core/base/monotonic_time.h"
#include "core/base/units.h"
#include "core/image/png_codec.h"
#include "core/io/file.h"
#include "tests/integration/cli_fixture.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/reference_extractor.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"

namespace isoscope {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using testing::CommandResult;
using ::testing::HasSubstr;
using testing::RunIsoscope;

std::set<std::string> KeysOf(const json& object) {
  std::set<std::string> keys;
  for (const auto& [key, value] : object.items()) {
    keys.insert(key);
  }
  return keys;
}

// A mesh read back from a file of `isoscope export`.
struct PlyMesh {
  std::vector<std::array<float, 3>> positions;
  std::vector<std::array<float, 3>> normals;
  std::vector<std::array<std::int32_t, 3>> triangles;
};

// Reads a binary PLY whose layout the header declares; any deviation is a failure of the test.
PlyMesh ReadPly(const std::string& bytes) {
  PlyMesh mesh;
  constexpr char kEnd[] = "end_header\n";
  const std::size_t header_end = bytes.find(kEnd);
  EXPECT_NE(header_end, std::string::npos);
  if (header_end == std::string::npos) {
    return mesh;
  }
  const std::string header = bytes.substr(0, header_end);
  EXPECT_TRUE(absl::StartsWith(header, "ply\nformat binary_little_endian 1.0\n")) << header;
  const auto count_of = [&](const std::string& element) {
    const std::size_t at = header.find("element " + element + " ");
    EXPECT_NE(at, std::string::npos) << header;
    return std::stoull(header.substr(at + 9 + element.size()));
  };
  const std::size_t vertex_count = count_of("vertex");
  const std::size_t face_count = count_of("face");
  const char* data = bytes.data() + header_end + std::strlen(kEnd);
  constexpr std::size_t kVertexBytes = 24;
  constexpr std::size_t kFaceBytes = 13;
  EXPECT_EQ(bytes.size(),
            header_end + std::strlen(kEnd) + vertex_count * kVertexBytes + face_count * kFaceBytes)
      << "the counts of the header do not match the size of the file";
  if (bytes.size() - header_end - std::strlen(kEnd) !=
      vertex_count * kVertexBytes + face_count * kFaceBytes) {
    return mesh;
  }
  for (std::size_t i = 0; i < vertex_count; ++i, data += kVertexBytes) {
    std::array<float, 6> values{};
    std::memcpy(values.data(), data, kVertexBytes);
    mesh.positions.push_back({values[0], values[1], values[2]});
    mesh.normals.push_back({values[3], values[4], values[5]});
  }
  for (std::size_t i = 0; i < face_count; ++i, data += kFaceBytes) {
    EXPECT_EQ(data[0], 3);
    std::array<std::int32_t, 3> corners{};
    std::memcpy(corners.data(), data + 1, kFaceBytes - 1);
    mesh.triangles.push_back(corners);
  }
  return mesh;
}

// The triangles by their corners, each from its smallest corner on, in ascending order: what does
// not depend on how vertices are numbered.
std::vector<std::array<std::array<float, 3>, 3>> TrianglesOf(const PlyMesh& mesh) {
  std::vector<std::array<std::array<float, 3>, 3>> triangles;
  for (const std::array<std::int32_t, 3>& corners : mesh.triangles) {
    std::array<std::array<float, 3>, 3> triangle{};
    for (std::size_t k = 0; k < 3; ++k) {
      triangle[k] = mesh.positions.at(static_cast<std::size_t>(corners[k]));
    }
    std::rotate(triangle.begin(), std::min_element(triangle.begin(), triangle.end()),
                triangle.end());
    triangles.push_back(triangle);
  }
  std::sort(triangles.begin(), triangles.end());
  return triangles;
}

TEST_F(CliTest, RawFileWithHeaderAndBigEndianIsTheSameVolumeAsNrrd) {
  testing::TestVolume volume = gyroid_;
  volume.type = volume::ScalarType::kInt16;
  volume.geometry.spacing = {0.5, 0.75, 1.25};
  volume.geometry.origin = {-3, 4, 10};
  std::string little;
  std::string big = "17 bytes of head.";
  for (const char c : gyroid_.samples) {
    const auto value = static_cast<std::int16_t>(static_cast<unsigned char>(c) * 10 - 1280);
    base::AppendLittleEndian(value, &little);
    const auto bits = static_cast<std::uint16_t>(value);
    big += {static_cast<char>(bits >> 8), static_cast<char>(bits & 0xff)};
  }
  volume.samples = little;
  const std::string nrrd =
      "NRRD0004\ntype: short\ndimension: 3\nspace dimension: 3\nsizes: 43 37 29\n"
      "space directions: (0.5,0,0) (0,0.75,0) (0,0,1.25)\nspace origin: (-3,4,10)\n"
      "endian: little\nencoding: raw\n\n" +
      little;
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(Path("a.nrrd"), nrrd));
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(Path("a.raw"), big));
  const std::string said = MustRun({"partition", Path("a.nrrd"), "--output", Path("from_nrrd"),
                                    "--shards", "2", "--block-cells", "8x16x4"});
  EXPECT_TRUE(absl::StrContains(said, "43 x 37 x 29 samples of int16")) << said;
  MustRun(Join({"partition", Path("a.raw"), "--output", Path("from_raw"), "--shards", "2",
                "--block-cells", "8x16x4", "--endian", "big", "--header-bytes", "17",
                "--distribution", "greedy", "--memory-limit", "64MiB"},
               testing::RawFlags(volume)));

  for (const char* name : {"from_nrrd", "from_raw"}) {
    SCOPED_TRACE(name);
    const json info = ParseJson(MustRun({"info", Path(name), "--json"}));
    ASSERT_EQ(info.at("datasets").size(), 1U);
    const json& dataset = info.at("datasets").at(0);
    EXPECT_EQ(dataset.at("name"), name);
    EXPECT_EQ(dataset.at("sample_dims"), json({43, 37, 29}));
    EXPECT_EQ(dataset.at("sample_type"), "int16");
    EXPECT_EQ(dataset.at("spacing"), json({0.5, 0.75, 1.25}));
    EXPECT_EQ(dataset.at("origin"), json({-3.0, 4.0, 10.0}));
    EXPECT_EQ(dataset.at("block_cells"), json({8, 16, 4}));
    EXPECT_EQ(dataset.at("block_count"), 6 * 3 * 7);
    EXPECT_EQ(dataset.at("shard_count"), 2);
    EXPECT_TRUE(dataset.at("missing_shards").empty());
    const std::string text = MustRun({"info", Path(name)});
    EXPECT_TRUE(absl::StrContains(text, "43 x 37 x 29 of int16")) << text;
  }
  // The range from the files' headers, before they are partitioned.
  const json range = ParseJson(MustRun({"info", Path("from_nrrd"), "--json"}))
                         .at("datasets")
                         .at(0)
                         .at("value_range");
  for (const auto& [name, raw_flags] : std::map<std::string, std::vector<std::string>>{
           {"a.nrrd", {}},
           {"a.raw",
            Join({"--endian", "big", "--header-bytes", "17"}, testing::RawFlags(volume))}}) {
    SCOPED_TRACE(name);
    const json info = ParseJson(MustRun(Join({"info", Path(name), "--json"}, raw_flags)));
    const json& described = info.at("volume");
    EXPECT_EQ(described.at("name"), Path(name));
    EXPECT_EQ(described.at("value_range"), range);
    EXPECT_EQ(described.at("sample_dims"), json({43, 37, 29}));
    EXPECT_EQ(described.at("sample_type"), "int16");
    EXPECT_EQ(described.at("spacing"), json({0.5, 0.75, 1.25}));
    EXPECT_EQ(described.at("origin"), json({-3.0, 4.0, 10.0}));
    const std::string text = MustRun(Join({"info", Path(name)}, raw_flags));
    EXPECT_TRUE(absl::StrContains(text, "43 x 37 x 29 of int16")) << text;
  }
  const auto render = [&](const char* name) {
    MustRun({"render", Path(name), "--isovalue", "0", "--width", "96", "--height", "96", "--output",
             Path("p.png"), "--renderer", "cpu"});
    return ReadFile(Path("p.png"));
  };
  EXPECT_EQ(render("from_nrrd"), render("from_raw"));
}

TEST_F(CliTest, StatisticsHaveTheMembersThatScriptsReadAndAddUp) {
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "d", 3));
  for (const char* culling : {"depth", "mask", "none"}) {
    SCOPED_TRACE(culling);
    json stats;
    const std::string png =
        Render({Path("d"), "--renderer", "cpu", "--culling", culling, "--no-metadata"}, &stats);
    ASSERT_EQ(stats.at("frames").size(), 1U);
    const json& frame = stats.at("frames").at(0);
    const std::set<std::string> expected{"wall_ms",
                                         "active_block_count",
                                         "ray_hit_block_count",
                                         "occluding_block_count",
                                         "visible_block_count",
                                         "culled_block_count",
                                         "triangle_count",
                                         "unique_vertex_count",
                                         "read_bytes",
                                         "network_bytes",
                                         "png_bytes",
                                         "durations_ms",
                                         "measures",
                                         "agents"};
    EXPECT_EQ(KeysOf(frame), expected);
    const std::set<std::string> expected_durations{"occluder_selection", "occluder_rendering",
                                                   "visibility_culling", "composite", "encode"};
    EXPECT_EQ(KeysOf(frame.at("durations_ms")), expected_durations);
    double duration_sum = 0;
    for (const auto& [key, value] : frame.at("durations_ms").items()) {
      EXPECT_GE(value.get<double>(), 0) << key;
      duration_sum += value.get<double>();
    }
    EXPECT_LE(duration_sum, frame.at("wall_ms").get<double>());
    EXPECT_GT(duration_sum, 0);

    const auto number = [&](const char* key) { return frame.at(key).get<std::int64_t>(); };
    EXPECT_EQ(number("png_bytes"), static_cast<std::int64_t>(png.size()));
    EXPECT_EQ(number("active_block_count"),
              number("visible_block_count") + number("culled_block_count"));
    EXPECT_GT(number("visible_block_count"), 0);
    EXPECT_EQ(number("network_bytes"), 0) << "agents of this process send no bytes";
    if (std::string(culling) == "none") {
      EXPECT_EQ(number("ray_hit_block_count"), 0);
      EXPECT_EQ(number("occluding_block_count"), 0);
      EXPECT_EQ(number("culled_block_count"), 0);
    } else {
      EXPECT_GT(number("ray_hit_block_count"), 0);
      EXPECT_LE(number("ray_hit_block_count"), number("occluding_block_count"));
      EXPECT_LE(number("occluding_block_count"), number("active_block_count"));
    }

    ASSERT_EQ(frame.at("agents").size(), 3U);
    std::map<std::string, std::int64_t> sums;
    int shard = 0;
    for (const json& agent : frame.at("agents")) {
      EXPECT_EQ(agent.at("shard"), shard++);
      for (const char* key : {"active_block_count", "triangle_count", "read_bytes", "extract_ms",
                              "render_ms", "busy_ms"}) {
        ASSERT_TRUE(agent.contains(key)) << key;
        EXPECT_GE(agent.at(key).get<double>(), 0) << key;
      }
      for (const char* key : {"active_block_count", "triangle_count", "read_bytes"}) {
        sums[key] += agent.at(key).get<std::int64_t>();
      }
    }
    for (const auto& [key, sum] : sums) {
      EXPECT_EQ(sum, number(key.c_str())) << key;
    }
  }
}

TEST_F(CliTest, UniqueVertexCountIsTheNumberOfCrossedGridEdges) {
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "d", 2));
  const testing::ReferenceSurface reference =
      testing::ReferenceExtractor(gyroid_.geometry, gyroid_.type, gyroid_.samples).Extract(128);
  json stats;
  Render({Path("d"), "--renderer", "cpu", "--culling", "none"}, &stats);
  const json& frame = stats.at("frames").at(0);
  EXPECT_EQ(frame.at("unique_vertex_count"), reference.crossed_edge_count);
  EXPECT_EQ(frame.at("triangle_count"), reference.triangles.size());
}

TEST_F(CliTest, ServeAnswersUntilSigtermAndExitsWithZero) {
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "d", 2));
  const std::string png = Render({Path("d"), "--renderer", "cpu"});
  for (const int signal : {SIGTERM, SIGINT}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<testing::Process> server,
                                  testing::StartIsoscope({"serve", Path("d"), "--listen",
                                                          "127.0.0.1:0", "--renderer", "cpu"}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string address, server->WaitForOutLine("127.0.0.1:"));
    EXPECT_EQ(Render({"--server", address}), png);
    EXPECT_EQ(Render({"--server", address, "--dataset", "d"}), png);
    const json info = ParseJson(MustRun({"info", "--server", address, "--json"}));
    EXPECT_EQ(info.at("datasets").at(0).at("name"), "d");
    EXPECT_EQ(info.at("agents").size(), 2U);
    EXPECT_EQ(info.at("agents").at(0).at("state"), "reachable");
    server->Signal(signal);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const int exit_code, server->Wait(testing::kPatience));
    EXPECT_EQ(exit_code, 0) << server->err();
  }
}

TEST_F(CliTest, ServeTakesAVolumeAndKeepsItInTheCache) {
  ISOSCOPE_ASSERT_OK(testing::WriteRawFile(gyroid_, Path("volume.raw")));
  const std::vector<std::string> serve = Join({"serve", Path("volume.raw"), "--listen",
                                               "127.0.0.1:0", "--shards", "2", "--renderer", "cpu"},
                                              testing::RawFlags(gyroid_));
  for (int i = 0; i < 2; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto server, testing::StartIsoscope(serve, Options()));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string address, server->WaitForOutLine("127.0.0.1:"));
    const json info = ParseJson(MustRun({"info", "--server", address, "--json"}));
    EXPECT_EQ(info.at("datasets").at(0).at("name"), "volume");
    EXPECT_EQ(info.at("datasets").at(0).at("shard_count"), 2);
    const testing::CommandResult near =
        testing::RunIsoscope({"render", "--server", address, "--dataset", "volme", "--isovalue",
                              kIsovalue, "--output", Path("o.png")},
                             Options());
    EXPECT_EQ(near.exit_code, 1);
    EXPECT_THAT(near.err, HasSubstr("did you mean \"volume\"?"));
    server->Signal(SIGINT);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const int exit_code, server->Wait(testing::kPatience));
    EXPECT_EQ(exit_code, 0) << server->err();
  }
  const json cache = ParseJson(MustRun({"cache", "list", "--json"}, Options()));
  EXPECT_EQ(cache.at("entries").size(), 1U);
  const testing::CommandResult without = testing::RunIsoscope({"serve"}, Options());
  EXPECT_EQ(without.exit_code, 2);
  EXPECT_THAT(without.err, HasSubstr("INPUT or DIR is missing"));
}

TEST_F(CliTest, RenderPrintsTablesOnlyWithStatsAndNothingWithQuiet) {
  Partition(gyroid_, "one", 1);
  const std::vector<std::string> render = {"render",  Path("one"),  "--isovalue", kIsovalue,
                                           "--width", "32",         "--height",   "32",
                                           "-o",      Path("o.png")};
  EXPECT_EQ(MustRun(render), Path("o.png") + ": 32 x 32 pixels\n");
  EXPECT_THAT(MustRun(Join(render, {"--stats", Path("s.json")})),
              HasSubstr("occluder selection ms"));
  EXPECT_EQ(MustRun(Join(render, {"-q"})), "");
  EXPECT_EQ(MustRun(Join(render, {"--quiet", "--stats", Path("s.json")})), "");
  EXPECT_FALSE(MustRun(Join(render, {"-q", "--stats", "-"})).empty()) << "it was asked for";
  EXPECT_EQ(MustRun({"export", Path("one"), "--isovalue", kIsovalue, "-q", "-o", Path("o.ply")}),
            "");
  EXPECT_EQ(MustRun({"generate", "gyroid", "--dims", "8,8,8", "-q", "-o", Path("g.nrrd")}), "");
  EXPECT_EQ(MustRun({"partition", Path("g.nrrd"), "-q", "-o", Path("g")}), "");
  const testing::CommandResult failed = testing::RunIsoscope(
      {"render", Path("absent"), "--isovalue", "1", "-q", "-o", Path("p.png")}, Options());
  EXPECT_EQ(failed.exit_code, 1);
  EXPECT_THAT(failed.err, HasSubstr("NOT_FOUND")) << "quiet is not silent about errors";
}

TEST_F(CliTest, InterruptedFlowLeavesNothing) {
  std::filesystem::create_directory(Path("flow"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::unique_ptr<testing::Process> process,
      testing::StartIsoscope({"generate", "flow", "--dims", "64,64,64", "--steps", "400",
                              "--output", Path("flow/f.pvd")}));
  const base::MonotonicTime deadline = base::MonotonicNow() + testing::kPatience;
  // A step is whole, and the next is begun.
  while (std::distance(std::filesystem::directory_iterator(Path("flow")), {}) < 2 &&
         base::MonotonicNow() < deadline) {
    absl::SleepFor(absl::Milliseconds(5));
  }
  process->Signal(SIGINT);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const int exit_code, process->Wait(testing::kPatience));
  EXPECT_EQ(exit_code, 130) << process->err();
  EXPECT_THAT(process->err(), HasSubstr("nothing was left behind"));
  EXPECT_TRUE(std::filesystem::is_empty(Path("flow")));
}

TEST_F(CliTest, PartsOfASourceKeepTheirPositions) {
  std::string samples;
  for (int i = 0; i < 8 * 7 * 6; ++i) {
    samples.push_back(static_cast<char>(i % 8));  // x
  }
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(Path("p.raw"), samples));
  const std::vector<std::string> flags = {"--dims",   "8,7,6",    "--type",   "uint8",  "--spacing",
                                          "0.5,1,2",  "--origin", "10,20,30", "--crop", "2:8,:,1:6",
                                          "--stride", "2",        "--fill",   "4"};
  const json volume =
      ParseJson(MustRun(Join({"info", Path("p.raw"), "--json"}, flags))).at("volume");
  MustRun(Join({"partition", Path("p.raw"), "--output", Path("p")}, flags));
  const json dataset = ParseJson(MustRun({"info", Path("p"), "--json"})).at("datasets").at(0);
  for (const json& described : {volume, dataset}) {
    EXPECT_EQ(described.at("sample_dims"), json({3, 4, 3}));
    EXPECT_EQ(described.at("spacing"), json({1.0, 2.0, 4.0}));
    EXPECT_EQ(described.at("origin"), json({11.0, 20.0, 32.0}));
    EXPECT_EQ(described.at("sample_type"), "float32");
    EXPECT_EQ(described.at("value_range"), json({2.0, 6.0}));
  }
  EXPECT_EQ(volume.at("fields").at(0).at("name"), "p");
  EXPECT_GT(volume.at("partition").at("disk_bytes"), 0);
  EXPECT_THAT(volume.at("commands").at(0).get<std::string>(),
              HasSubstr("--crop 2:8,0:,1:6 --stride 2 --fill 4 --isovalue 4"));
  const testing::CommandResult beyond = testing::RunIsoscope(
      {"info", Path("p.raw"), "--dims", "8,7,6", "--type", "uint8", "--crop", ":,:,2:7"}, {});
  EXPECT_EQ(beyond.exit_code, 1);
  EXPECT_THAT(beyond.err, HasSubstr("--crop 2:7 on axis z, which has 6 samples, 0 to 5"));
}

TEST_F(CliTest, ShearedAndUnevenGridsAreTakenByTheirFlags) {
  std::string sheared = testing::NiftiHeaderBytes({.dims = {4, 3, 2}});
  const float lean = 0.5F;
  std::memcpy(sheared.data() + 280, &lean, sizeof(lean));
  std::string ramp;
  for (int i = 0; i < 24; ++i) {
    ramp += {static_cast<char>(i), '\0'};
  }
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(Path("s.nii"), sheared + ramp));
  const std::string uneven =
      "# vtk DataFile Version 3.0\nt\nASCII\nDATASET RECTILINEAR_GRID\nDIMENSIONS 4 2 2\n"
      "X_COORDINATES 4 float\n0 1 3 4\nY_COORDINATES 2 float\n0 1\nZ_COORDINATES 2 float\n0 1\n"
      "POINT_DATA 16\nSCALARS p short\nLOOKUP_TABLE default\n"
      "0 1 3 4 0 1 3 4 0 1 3 4 0 1 3 4\n";
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(Path("r.vtk"), uneven));
  struct Case {
    const char* file;
    const char* flag;
    const char* note;
    std::vector<int> dims;
  };
  for (const Case& c : {Case{"s.nii",
                             "--ignore-shear",
                             "axes x and y, which meet at 108.4 degrees, were made",
                             {4, 3, 2}},
                        Case{"r.vtk",
                             "--resample",
                             "axis x was resampled: 4 samples, 1 to 2 apart, became 5, 1",
                             {5, 2, 2}}}) {
    SCOPED_TRACE(c.file);
    for (const std::vector<std::string>& command :
         {std::vector<std::string>{"info"}, std::vector<std::string>{"partition", "-o", Path("no")},
          std::vector<std::string>{"render", "--isovalue", "2", "-o", Path("no.png")}}) {
      const testing::CommandResult refused =
          testing::RunIsoscope(Join(command, {Path(c.file)}), Options());
      EXPECT_EQ(refused.exit_code, 1);
      EXPECT_THAT(refused.err, HasSubstr(c.flag));
    }
    const json volume = ParseJson(MustRun({"info", Path(c.file), c.flag, "--json"})).at("volume");
    EXPECT_THAT(volume.at("note").get<std::string>(), HasSubstr(c.note));
    EXPECT_EQ(volume.at("sample_dims"), json(c.dims));
    EXPECT_THAT(volume.at("commands").at(0).get<std::string>(), HasSubstr(c.flag));
    EXPECT_THAT(MustRun({"info", Path(c.file), c.flag}), HasSubstr(c.note));
    const std::string folder = Path(std::string(c.file) + ".d");
    const testing::CommandResult made =
        testing::RunIsoscope({"partition", Path(c.file), c.flag, "-o", folder}, Options());
    EXPECT_EQ(made.exit_code, 0) << made.err;
    EXPECT_THAT(made.err, HasSubstr(c.note));
    EXPECT_EQ(ParseJson(MustRun({"info", folder, "--json"})).at("datasets").at(0).at("sample_dims"),
              json(c.dims));
  }
  // The cached dataset of a flag is not that of another.
  const testing::CommandResult drawn = testing::RunIsoscope(
      {"render", Path("r.vtk"), "--resample", "--isovalue", "2", "-o", Path("r.png")}, Options());
  EXPECT_EQ(drawn.exit_code, 0) << drawn.err;
  EXPECT_THAT(drawn.err, HasSubstr("was resampled"));
  EXPECT_EQ(testing::RunIsoscope({"render", Path("r.vtk"), "--isovalue", "2", "-o", Path("r.png")},
                                 Options())
                .exit_code,
            1);
}

TEST_F(CliTest, InfoHasTheRangeOfEachFieldAndErrorsTheSameList) {
  std::string header =
      testing::NiftiHeaderBytes({.dims = {2, 2, 2}, .dim_count = 4, .dim4 = 3, .datatype = 2});
  std::string samples;
  for (int i = 0; i < 24; ++i) {
    samples.push_back(static_cast<char>(i + 1));
  }
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(Path("t.nii"), header + samples));
  const std::string text = MustRun({"info", Path("t.nii")});
  EXPECT_THAT(text, HasSubstr("fields        t\n"));
  EXPECT_THAT(text, HasSubstr("steps         3, from 0 to 2 s\n"));
  EXPECT_THAT(text, HasSubstr("values        t  1.0 to 24.0\n"));
  EXPECT_THAT(text, HasSubstr("--isovalue 12.5"));
  const testing::CommandResult drawn = testing::RunIsoscope(
      {"render", Path("t.nii"), "--isovalue", "2", "-o", Path("t.png")}, Options());
  EXPECT_EQ(drawn.exit_code, 0);
  EXPECT_THAT(drawn.err, HasSubstr("takes step 2 of 0 to 2; --step chooses"));
}

TEST_F(CliTest, FormatsAreListedAndForced) {
  EXPECT_THAT(MustRun({"info", "--list-formats"}),
              AllOf(HasSubstr("nrrd"), HasSubstr("par/rec"), HasSubstr("--dims and --type")));
  const std::string nrrd =
      "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nspacings: 1 2 3\nencoding: ascii\n\n"
      "1 2 3 4 5 6 7 8\n";
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(Path("v.unknown"), nrrd));
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(Path("v.mgz"), nrrd));
  EXPECT_THAT(MustRun({"info", Path("v.unknown")}), HasSubstr("values        1.0 to 8.0"));
  EXPECT_EQ(testing::RunIsoscope({"info", Path("v.mgz")}, {}).exit_code, 1);
  EXPECT_THAT(MustRun({"info", Path("v.mgz"), "--format", "nrrd"}),
              HasSubstr("values        1.0 to 8.0"));
  const testing::CommandResult unknown =
      testing::RunIsoscope({"info", Path("v.mgz"), "--format", "vdb"}, {});
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("known are nifti, nrrd"));
}

TEST_F(CliTest, InfoReadsALargeVolumesValuesOnlyIfItIsAsked) {
  const std::string path = Path("large.raw");
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(path, ""));
  std::filesystem::resize_file(path, std::uintmax_t{512} * 512 * 257);  // without disk space
  const std::vector<std::string> info = {"info", path, "--dims", "512,512,257", "--type", "uint8"};
  EXPECT_THAT(MustRun(info), HasSubstr("values        not read: --values reads them all\n"));
  EXPECT_FALSE(ParseJson(MustRun(Join(info, {"--json"}))).at("volume").contains("value_range"));
  EXPECT_THAT(MustRun(Join(info, {"--values"})), HasSubstr("values        0.0 to 0.0\n"));
  EXPECT_EQ(ParseJson(MustRun(Join(info, {"--values", "--json"}))).at("volume").at("value_range"),
            (nlohmann::json{0.0, 0.0}));
  // With a file that ends early, the header is told before the error.
  std::filesystem::resize_file(path, std::uintmax_t{512} * 512 * 257 - 1);
  EXPECT_EQ(testing::RunIsoscope(info, {}).exit_code, 1);
}

TEST_F(CliTest, RenderWithoutALevelNamesTheCommandThatSuggestsOne) {
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(Path("v.nrrd"), ""));
  const testing::CommandResult result =
      testing::RunIsoscope({"render", Path("v.nrrd"), "-o", Path("o.png")}, {});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_THAT(result.err, HasSubstr("isoscope info INPUT --histogram"));
}

TEST_F(CliTest, ALevelWithoutASurfaceIsSaidForEveryKindOfInput) {
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "d", 2));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::unique_ptr<testing::Process> server,
      testing::StartIsoscope({"serve", Path("d"), "--listen", "127.0.0.1:0", "--renderer", "cpu"}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string address, server->WaitForOutLine("127.0.0.1:"));
  const json range =
      ParseJson(MustRun({"info", Path("d"), "--json"})).at("datasets").at(0).at("value_range");
  const std::string said = absl::StrFormat(
      "isovalue 300 has no surface: the values of the volume "
      "are in [%g, %g]",
      range[0].get<double>(), range[1].get<double>());
  const std::vector<std::string> raw = Join({Path("volume.raw")}, testing::RawFlags(gyroid_));
  for (const std::vector<std::string>& input :
       std::vector<std::vector<std::string>>{raw, {Path("d")}, {"--server", address}}) {
    SCOPED_TRACE(input[0]);
    for (const char* command : {"render", "export"}) {
      const std::string output = Path(std::string(command) == "render" ? "empty.png" : "empty.ply");
      const CommandResult empty =
          RunIsoscope(Join({command, "--isovalue", "300", "--output", output}, input), Options());
      EXPECT_EQ(empty.exit_code, 0) << empty.err;
      EXPECT_TRUE(absl::StrContains(empty.err, said)) << command << ": " << empty.err;
      EXPECT_TRUE(io::PathExists(output));
      const CommandResult full = RunIsoscope(
          Join({command, "--isovalue", kIsovalue, "--output", output}, input), Options());
      EXPECT_EQ(full.err, "") << command;
    }
  }
}

TEST_F(CliTest, ExportIsOneWeldedClosedMeshThatDoesNotDependOnShards) {
  testing::TestVolume ball = testing::BallVolume({30, 26, 22}, 0.8);
  ball.geometry.spacing = {0.5, 0.5, 0.5};
  ball.geometry.origin = {10, 20, 30};
  ASSERT_NO_FATAL_FAILURE(Partition(ball, "one", 1));
  ASSERT_NO_FATAL_FAILURE(Partition(ball, "three", 3));
  const auto export_from = [&](const std::vector<std::string>& from) {
    MustRun(Join({"export", "--isovalue", "127.5", "--output", Path("mesh.ply")}, from), Options());
    return ReadFile(Path("mesh.ply"));
  };
  const std::string bytes = export_from({Path("one")});
  EXPECT_TRUE(export_from({Path("three")}) == bytes) << "three shards";
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                  testing::ProcessCluster::Start(Path("three"), 3));
    EXPECT_TRUE(export_from({"--server", cluster->address()}) == bytes) << "cluster";
  }

  const PlyMesh mesh = ReadPly(bytes);
  // The blocks of the cache have another size: the same triangles in another order.
  const std::string cached = export_from(Join({Path("volume.raw")}, testing::RawFlags(ball)));
  EXPECT_TRUE(TrianglesOf(ReadPly(cached)) == TrianglesOf(mesh)) << "straight from the volume";
  const testing::ReferenceSurface reference =
      testing::ReferenceExtractor(ball.geometry, ball.type, ball.samples).Extract(127.5);
  EXPECT_EQ(mesh.positions.size(), reference.vertices.size());
  ASSERT_EQ(mesh.triangles.size(), reference.triangles.size());
  // No sample is 127.5, so no vertex lies on one: equal positions are the same grid edge.
  EXPECT_EQ(
      std::set<decltype(mesh.positions)::value_type>(mesh.positions.begin(), mesh.positions.end())
          .size(),
      mesh.positions.size())
      << "the mesh is not welded";

  std::map<std::pair<std::int32_t, std::int32_t>, int> edges;
  double volume = 0;
  for (const std::array<std::int32_t, 3>& triangle : mesh.triangles) {
    std::array<math::Vec3d, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) {
      ASSERT_GE(triangle[k], 0);
      ASSERT_LT(static_cast<std::size_t>(triangle[k]), mesh.positions.size());
      const std::array<float, 3>& p = mesh.positions[static_cast<std::size_t>(triangle[k])];
      corners[k] = {double{p[0]}, double{p[1]}, double{p[2]}};
      ++edges[{triangle[k], triangle[(k + 1) % 3]}];
    }
    volume += math::Dot(corners[0], math::Cross(corners[1], corners[2])) / 6;
  }
  for (const auto& [edge, count] : edges) {
    EXPECT_EQ(count, 1) << edge.first << " " << edge.second;
    EXPECT_EQ(edges.count({edge.second, edge.first}), 1U)
        << "a hole beside " << edge.first << " " << edge.second;
  }
  // Half axes in world units; positive, since triangles turn counter-clockwise seen from outside.
  const double pi = std::acos(-1.0);
  const double expected = 4.0 / 3 * pi * (0.8 * 7.25) * (0.8 * 6.25) * (0.8 * 5.25);
  EXPECT_NEAR(volume, expected, 0.03 * expected);

  const math::Vec3d center{10 + 7.25, 20 + 6.25, 30 + 5.25};
  for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
    const math::Vec3d p{double{mesh.positions[i][0]}, double{mesh.positions[i][1]},
                        double{mesh.positions[i][2]}};
    const math::Vec3d n{double{mesh.normals[i][0]}, double{mesh.normals[i][1]},
                        double{mesh.normals[i][2]}};
    ASSERT_NEAR(math::Length(n), 1, 1e-4);
    ASSERT_GT(math::Dot(n, p - center), 0) << "the normal points into the ball";
  }
}

TEST_F(CliTest, CompressionChangesFilesNotPictures) {
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "none", 2));
  const std::string png = Render({Path("none"), "--renderer", "cpu"});
  for (const char* compression : {"lz4", "zstd"}) {
    MustRun(Join({"partition", Path("volume.raw"), "--output", Path(compression), "--shards", "2",
                  "--compression", compression},
                 testing::RawFlags(gyroid_)));
    EXPECT_TRUE(Render({Path(compression), "--renderer", "cpu"}) == png) << compression;
  }
  for (const std::vector<std::string>& flags :
       {std::vector<std::string>{"--compact"}, {"--compact", "--compression", "packed"}}) {
    const std::string directory = Path(absl::StrCat("compact", flags.size()));
    MustRun(
        Join(Join({"partition", Path("volume.raw"), "--output", directory, "--shards", "2"}, flags),
             testing::RawFlags(gyroid_)));
    EXPECT_TRUE(Render({directory, "--renderer", "cpu"}) == png) << flags.size();
  }
}

TEST_F(CliTest, TheCacheKeepsToItsLimitAndSaysWhatItHas) {
  const std::vector<std::string> raw = testing::RawFlags(gyroid_);
  const auto render = [&](const std::string& name, const std::vector<std::string>& more) {
    if (!io::PathExists(Path(name))) {
      ISOSCOPE_EXPECT_OK(testing::WriteRawFile(gyroid_, Path(name)));
    }
    Render(Join(Join({Path(name), "--renderer", "cpu"}, raw), more));
  };
  const auto list = [&] {
    return ParseJson(MustRun({"cache", "list", "--json", "--cache-limit", "1G"}, Options()));
  };
  EXPECT_TRUE(list().at("entries").empty());
  render("a.raw", {});
  render("b.raw", {});
  render("a.raw", {});
  json listed = list();
  EXPECT_EQ(listed.at("folder"), Path("cache/isoscope"));
  EXPECT_EQ(listed.at("limit_bytes"), 1 << 30);
  ASSERT_EQ(listed.at("entries").size(), 2U);
  EXPECT_EQ(listed.at("entries")[0].at("source"), Path("a.raw")) << "the last one used is first";
  EXPECT_EQ(listed.at("entries")[1].at("source"), Path("b.raw"));
  const auto size_bytes = listed.at("entries")[0].at("size_bytes").get<std::int64_t>();
  EXPECT_GT(size_bytes, static_cast<std::int64_t>(gyroid_.samples.size()));
  EXPECT_EQ(listed.at("total_bytes"), 2 * size_bytes);
  EXPECT_EQ(listed.at("entries")[0].at("is_in_use"), false);

  // With room for two, the third drives out b, which was not used for longest.
  render("c.raw", {"--cache-limit", absl::StrCat(2 * size_bytes + 100)});
  listed = list();
  ASSERT_EQ(listed.at("entries").size(), 2U);
  EXPECT_EQ(listed.at("entries")[0].at("source"), Path("c.raw"));
  EXPECT_EQ(listed.at("entries")[1].at("source"), Path("a.raw"));

  const std::string text = MustRun({"cache", "list"}, Options());
  EXPECT_TRUE(absl::StrContains(text, Path("c.raw"))) << text;
  EXPECT_TRUE(absl::StrContains(text, "2 volumes, ")) << text;
  const CommandResult unknown = RunIsoscope({"cache", "clear", Path("b.raw")}, Options());
  EXPECT_EQ(unknown.exit_code, 1);
  EXPECT_TRUE(absl::StrContains(unknown.err, "NOT_FOUND")) << unknown.err;
  const std::string one = MustRun({"cache", "clear", Path("c.raw")}, Options());
  EXPECT_TRUE(absl::StrContains(one, "made of " + Path("c.raw"))) << one;
  EXPECT_EQ(list().at("entries").size(), 1U);
  MustRun({"cache", "clear"}, Options());
  EXPECT_TRUE(list().at("entries").empty());

  testing::ProcessOptions wrong = Options();
  wrong.environment.push_back("ISOSCOPE_CACHE_LIMIT=much");
  EXPECT_EQ(RunIsoscope({"cache", "list"}, wrong).exit_code, 2);
}

TEST_F(CliTest, HistogramAndSuggestionsDoNotDependOnShardsOrWhereTheyAreMade) {
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "one", 1));
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "three", 3));
  const auto histogram_of = [&](const std::vector<std::string>& input) {
    return ParseJson(
               MustRun(Join({"info", "--histogram", "--json", "--bins", "4096"}, input), Options()))
        .at("histogram");
  };
  const json histogram = histogram_of({Path("one")});
  EXPECT_EQ(histogram_of({Path("three")}), histogram);
  const std::vector<std::string> raw = Join({Path("volume.raw")}, testing::RawFlags(gyroid_));
  EXPECT_EQ(histogram_of(raw), histogram) << "straight from the volume";
  EXPECT_EQ(histogram_of(raw), histogram) << "from the cache";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                testing::ProcessCluster::Start(Path("three"), 3));
  EXPECT_EQ(histogram_of({"--server", cluster->address()}), histogram) << "from a cluster";

  // Against the samples themselves.
  std::map<int, std::int64_t> counts;
  for (const char c : gyroid_.samples) {
    ++counts[static_cast<unsigned char>(c)];
  }
  EXPECT_EQ(histogram.at("bins").size(),
            static_cast<std::size_t>(counts.rbegin()->first - counts.begin()->first + 1));
  for (const json& bin : histogram.at("bins")) {
    EXPECT_EQ(bin.at("sample_count"), counts[bin.at("min").get<int>()]) << bin;
    EXPECT_EQ(bin.at("max").get<double>(), bin.at("min").get<double>() + 1);
  }
  ASSERT_EQ(histogram.at("suggestions").size(), 2U);
  for (const json& suggestion : histogram.at("suggestions")) {
    const double isovalue = suggestion.at("isovalue").get<double>();
    std::int64_t inside = 0;
    for (const auto& [value, count] : counts) {
      inside += value >= isovalue ? count : 0;
    }
    EXPECT_NEAR(suggestion.at("inside_fraction").get<double>(),
                static_cast<double>(inside) / static_cast<double>(gyroid_.samples.size()), 1e-12);
  }

  // Statistics of a frame at a bin's centre.
  const json& middle = histogram.at("bins").at(histogram.at("bins").size() / 2);
  const double isovalue = middle.at("min").get<double>() + 0.5;
  MustRun({"render", Path("three"), "--isovalue", absl::StrCat(isovalue), "--culling", "none",
           "--output", Path("p.png"), "--stats", Path("s.json"), "--renderer", "cpu"});
  const json stats = ParseJson(ReadFile(Path("s.json"))).at("frames").at(0);
  EXPECT_EQ(stats.at("active_block_count"), middle.at("active_block_count"));
  const auto triangles = stats.at("triangle_count").get<double>();
  const auto estimate = middle.at("estimated_triangle_count").get<double>();
  EXPECT_LT(estimate, 3 * triangles);
  EXPECT_GT(estimate, triangles / 3);

  const std::string text = MustRun({"info", Path("one"), "--histogram", "--log"});
  EXPECT_TRUE(absl::StrContains(text, "suggested:")) << text;
  EXPECT_TRUE(absl::StrContains(text, "(logarithmic)")) << text;
}

TEST_F(CliTest, HelpAndVersionAreNoErrors) {
  EXPECT_TRUE(absl::StrContains(MustRun({"--help"}), "Commands:"));
  EXPECT_TRUE(absl::StartsWith(MustRun({"--version"}), "isoscope "));
  for (const char* command : {"partition", "info", "serve", "render", "export"}) {
    EXPECT_TRUE(absl::StrContains(MustRun({command, "--help"}), "Examples:")) << command;
  }
}

}  // namespace
}  // namespace isoscope
