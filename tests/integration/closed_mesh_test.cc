// Meshes for printing and measuring as users get them: closed surfaces, areas and volumes, a file
// for each label, and volumes far from the origin.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <numbers>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "core/base/coding.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/math/vec.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

using nlohmann::json;
using testing::CommandResult;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

std::vector<std::string> Join(std::vector<std::string> a, const std::vector<std::string>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

struct ObjMesh {
  std::vector<math::Vec3d> positions;
  std::vector<std::array<std::size_t, 3>> triangles;

  // True if each edge has two triangles, which run along it both ways.
  [[nodiscard]] bool is_closed() const {
    std::map<std::pair<std::size_t, std::size_t>, int> sides;
    for (const auto& corners : triangles) {
      for (std::size_t k = 0; k < 3; ++k) {
        ++sides[{corners[k], corners[(k + 1) % 3]}];
      }
    }
    for (const auto& [side, count] : sides) {
      if (count != 1 || sides.count({side.second, side.first}) == 0) {
        return false;
      }
    }
    return true;
  }
  [[nodiscard]] double volume() const {
    double sum = 0;
    const math::Vec3d from = positions.empty() ? math::Vec3d() : positions[0];
    for (const auto& [a, b, c] : triangles) {
      sum +=
          math::Dot(positions[a] - from, math::Cross(positions[b] - from, positions[c] - from)) / 6;
    }
    return sum;
  }
  [[nodiscard]] std::size_t distinct_count() const {
    std::set<std::array<double, 3>> places;
    for (const math::Vec3d& p : positions) {
      places.insert({p.x, p.y, p.z});
    }
    return places.size();
  }
};

// The triangles by the places of their corners, each turned to begin at the least, in order.
std::vector<std::array<std::array<double, 3>, 3>> SortedTriangles(const ObjMesh& mesh) {
  std::vector<std::array<std::array<double, 3>, 3>> triangles;
  for (const std::array<std::size_t, 3>& corners : mesh.triangles) {
    std::array<std::array<double, 3>, 3>& places = triangles.emplace_back();
    for (std::size_t k = 0; k < 3; ++k) {
      const math::Vec3d& p = mesh.positions[corners[k]];
      places[k] = {p.x, p.y, p.z};
    }
    std::rotate(places.begin(), std::min_element(places.begin(), places.end()), places.end());
  }
  std::sort(triangles.begin(), triangles.end());
  return triangles;
}

ObjMesh ReadObj(const std::string& text) {
  ObjMesh mesh;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream in(line);
    std::string word;
    in >> word;
    if (word == "v") {
      math::Vec3d& p = mesh.positions.emplace_back();
      in >> p.x >> p.y >> p.z;
    } else if (word == "f") {
      std::array<std::size_t, 3>& corners = mesh.triangles.emplace_back();
      for (std::size_t& corner : corners) {
        std::string text_of_corner;
        in >> text_of_corner;
        corner = std::stoul(text_of_corner) - 1;
      }
    }
  }
  return mesh;
}

class ClosedMeshTest : public ::testing::Test {
 protected:
  [[nodiscard]] std::string Path(const std::string& name) const { return directory_.Sub(name); }

  static CommandResult MustRun(const std::vector<std::string>& arguments) {
    CommandResult result = testing::RunIsoscope(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return result;
  }
  // Exports to a file and returns its bytes.
  std::string MustExport(const std::string& name, const std::vector<std::string>& arguments) {
    result_ = MustRun(Join({"export", "--output", Path(name)}, arguments));
    return io::ReadWholeFile(Path(name), 64 * base::kMiB).value_or("");
  }

  testing::TempDir directory_;
  CommandResult result_;  // of the last MustExport
};

// At 100.5 the ball's surface goes through no sample, at 128 through many. Any number of shards
// gives the same bytes. Other blocks give the same vertices and triangles in another order.
TEST_F(ClosedMeshTest, ClosedSurfacesAndTheirMeasuresAreTheSameForAnyShardsAndBlocks) {
  const testing::TestVolume volume = testing::BallVolume({40, 38, 36}, 0.9);
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(volume, Path("one"), 1, 16));
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(volume, Path("three"), 3, 16));
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(volume, Path("small"), 3, 8));
  for (const char* const isovalue : {"128", "100.5"}) {
    const std::vector<std::string> flags = {
        "--isovalue",          isovalue,     "--close",
        "--clip-plane",        "1,0.2,0,12", "--clip-box",
        "0,33.5,0,99,3.25,30", "--stats",    Path("stats.json")};
    const auto read_stats = [&] {
      return io::ReadWholeFile(Path("stats.json"), base::kMiB).value();
    };
    const std::string one = MustExport("m.obj", Join({Path("one")}, flags));
    const std::string stats = read_stats();
    const ObjMesh mesh = ReadObj(one);
    EXPECT_GT(mesh.triangles.size(), 1000U);
    EXPECT_TRUE(mesh.is_closed());
    const json surface = json::parse(stats).at("surfaces").at(0);
    // Text has the shortest digits of a float32, which is what is measured. The sum here rounds
    // 8000 times, at most: 8000 * 2^-53 * 65000, the sum of absolute terms.
    ObjMesh floats = mesh;
    for (math::Vec3d& p : floats.positions) {
      for (int axis = 0; axis < 3; ++axis) {
        p[axis] = double{static_cast<float>(p[axis])};
      }
    }
    EXPECT_NEAR(surface.at("volume").get<double>(), floats.volume(), 1e-7);
    EXPECT_EQ(surface.at("open_edge_count"), 0);
    EXPECT_EQ(surface.at("triangle_count"), mesh.triangles.size());
    EXPECT_TRUE(MustExport("m.obj", Join({Path("three")}, flags)) == one);
    EXPECT_EQ(read_stats(), stats);
    const ObjMesh small = ReadObj(MustExport("m.obj", Join({Path("small")}, flags)));
    EXPECT_TRUE(SortedTriangles(small) == SortedTriangles(mesh));
    EXPECT_EQ(small.positions.size(), mesh.positions.size());
    EXPECT_TRUE(small.is_closed());
    EXPECT_EQ(json::parse(read_stats()).at("surfaces").at(0), surface);
  }
}

TEST_F(ClosedMeshTest, SimplifiedClosedSurfacesStayClosed) {
  ISOSCOPE_ASSERT_OK(
      testing::MakeDataset(testing::GyroidVolume({30, 31, 32}), Path("gyroid"), 1, 16));
  for (const char* const isovalue : {"128", "100.5"}) {
    const ObjMesh all =
        ReadObj(MustExport("m.obj", {Path("gyroid"), "--isovalue", isovalue, "--close"}));
    const ObjMesh few = ReadObj(MustExport(
        "m.obj", {Path("gyroid"), "--isovalue", isovalue, "--close", "--simplify", "0.3"}));
    EXPECT_TRUE(all.is_closed());
    EXPECT_TRUE(few.is_closed());
    EXPECT_LT(few.triangles.size(), all.triangles.size() * 35 / 100);
    EXPECT_NEAR(few.volume() / all.volume(), 1, 0.03);
  }
}

// Area and volume of a ball of radius 0.6 * 24.5; open once it is cut; measured of what is written.
TEST_F(ClosedMeshTest, MeasuresAreToldByExportInfoAndRender) {
  testing::TestVolume volume = testing::BallVolume({50, 50, 50}, 0.6);
  volume.geometry.spacing = {0.5, 0.5, 0.5};
  ISOSCOPE_ASSERT_OK(testing::WriteRawFile(volume, Path("ball.raw")));
  const std::vector<std::string> input = Join({Path("ball.raw")}, testing::RawFlags(volume));
  const double radius = 0.6 * 24.5 * 0.5;
  const CommandResult info = MustRun(Join({"info", "--json", "--isovalue", "128"}, input));
  const json measured = json::parse(info.out).at("measures").at("surfaces").at(0);
  EXPECT_NEAR(measured.at("area").get<double>() / (4 * std::numbers::pi * radius * radius), 1,
              0.02);
  EXPECT_NEAR(
      measured.at("volume").get<double>() / (4 * std::numbers::pi / 3 * radius * radius * radius),
      1, 0.02);
  const CommandResult exported = MustRun(
      Join({"export", "--isovalue", "128", "--stats", "-", "--output", Path("m.stl")}, input));
  const json stats = json::parse(exported.out);
  EXPECT_EQ(stats.at("surfaces").at(0), measured);
  EXPECT_EQ(stats.at("files").at(0).at("path"), Path("m.stl"));
  const CommandResult rendered =
      MustRun(Join({"render", "--isovalue", "128", "--width", "64", "--height", "64", "--stats",
                    "-", "--output", Path("m.png")},
                   input));
  EXPECT_EQ(json::parse(rendered.out).at("frames").at(0).at("measures").at("surfaces").at(0),
            measured);
  const CommandResult without =
      MustRun(Join({"render", "--isovalue", "128", "--width", "64", "--height", "64", "--stats",
                    "-", "--no-measures", "--output", Path("m.png")},
                   input));
  EXPECT_FALSE(json::parse(without.out).at("frames").at(0).contains("measures"));

  const CommandResult cut =
      MustRun(Join({"info", "--isovalue", "128", "--clip-plane", "0,0,1,12"}, input));
  EXPECT_THAT(cut.out, HasSubstr("open at "));
  const CommandResult closed = MustRun(Join(
      {"info", "--json", "--isovalue", "128", "--clip-plane", "0,0,1,12.25", "--close"}, input));
  EXPECT_NEAR(
      json::parse(closed.out).at("measures").at("surfaces").at(0).at("volume").get<double>(),
      measured.at("volume").get<double>() / 2, 0.05 * measured.at("volume").get<double>());
  const CommandResult wrong = testing::RunIsoscope(Join({"info", "--close"}, input));
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_THAT(wrong.err, HasSubstr("--isovalue"));
}

// What is written is measured: after islands are dropped.
TEST_F(ClosedMeshTest, MeasuresOfAnExportAreThoseBehindItsFilters) {
  testing::TestVolume volume = testing::BallVolume({40, 40, 40}, 0.5);
  volume.samples[2 + 40 * (2 + 40 * 2)] = static_cast<char>(255);
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(volume, Path("one"), 1, 16));
  const auto measures = [&](const std::vector<std::string>& flags) {
    const CommandResult result = MustRun(Join(
        {"export", Path("one"), "--isovalue", "127.5", "--stats", "-", "--output", Path("m.ply")},
        flags));
    return json::parse(result.out).at("surfaces").at(0);
  };
  const json all = measures({});
  const json large = measures({"--min-component", "9"});
  EXPECT_EQ(large.at("triangle_count").get<int>(), all.at("triangle_count").get<int>() - 8);
  EXPECT_LT(large.at("volume").get<double>(), all.at("volume").get<double>() - 0.1);
  EXPECT_GT(large.at("volume").get<double>(), all.at("volume").get<double>() - 1);
}

// 200 labels, each a cube of 2 samples.
testing::TestVolume ManyLabels() {
  testing::TestVolume volume;
  volume.geometry.sample_dims = {41, 41, 9};
  volume.samples.assign(41 * 41 * 9, '\0');
  for (int label = 1; label <= 200; ++label) {
    const int x = 1 + 4 * ((label - 1) % 10);
    const int y = 1 + 4 * ((label - 1) / 10 % 10);
    const int z = 1 + 4 * ((label - 1) / 100);
    for (int i = 0; i < 8; ++i) {
      volume
          .samples[static_cast<std::size_t>(x + i % 2 + 41 * (y + i / 2 % 2 + 41 * (z + i / 4)))] =
          static_cast<char>(label);
    }
  }
  return volume;
}

TEST_F(ClosedMeshTest, AnExportHasAnyNumberOfLabelsInOneFileOrInAFileEach) {
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(ManyLabels(), Path("many"), 1, 16));
  const ObjMesh all = ReadObj(MustExport("all.obj", {Path("many"), "--labels", "all"}));
  EXPECT_TRUE(all.is_closed());
  EXPECT_EQ(all.positions.size(), 200U * 24);
  EXPECT_THAT(
      testing::RunIsoscope({"render", Path("many"), "--labels", "all", "--output", Path("m.png")})
          .err,
      HasSubstr("there are 200 labels"));
  MustRun({"export", Path("many"), "--labels", "all", "--output", Path("label-%l.obj")});
  EXPECT_FALSE(io::PathExists(Path("label-0.obj")));
  double volume = 0;
  for (int label = 1; label <= 200; ++label) {
    const std::string path = Path(absl::StrCat("label-", label, ".obj"));
    ASSERT_TRUE(io::PathExists(path)) << path;
    const ObjMesh mesh = ReadObj(io::ReadWholeFile(path, base::kMiB).value());
    EXPECT_EQ(mesh.positions.size(), 24U);
    EXPECT_TRUE(mesh.is_closed());
    volume += mesh.volume();
  }
  EXPECT_NEAR(volume, all.volume(), 1e-3);
  // Filters, too, are those of each label.
  const CommandResult filtered =
      MustRun({"export", Path("many"), "--labels", "all", "--min-component", "100", "--output",
               Path("few-%03l.stl")});
  EXPECT_THAT(filtered.out, HasSubstr("dropped 200 of 200 components"));
  EXPECT_EQ(io::ReadWholeFile(Path("few-007.stl"), base::kMiB).value().size(), 84U);
}

// Nobody gave a colour, and STL has none.
TEST_F(ClosedMeshTest, LabelsFitIntoAnStlUnlessTheyAreGivenColours) {
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(ManyLabels(), Path("many"), 1, 16));
  const std::string stl = MustExport("m.stl", {Path("many"), "--label", "3", "--label", "7,9"});
  EXPECT_EQ(base::LoadLittleEndian<std::uint32_t>(stl.data() + 80), 3U * 44);
  EXPECT_THAT(result_.err, IsEmpty());
  const CommandResult refused = testing::RunIsoscope(
      {"export", Path("many"), "--label", "3:red", "--output", Path("red.stl")});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.err, HasSubstr("has none"));
  EXPECT_FALSE(io::PathExists(Path("red.stl")));
  EXPECT_THAT(MustExport("m.obj", {Path("many"), "--label", "3"}), Not(HasSubstr("o surface")));
}

// The same labels as float32 and float64; one fraction makes a field no labels.
TEST_F(ClosedMeshTest, WholeNumbersOfEveryTypeAreLabels) {
  const testing::TestVolume bytes = ManyLabels();
  const auto write = [&]<typename T>(volume::ScalarType type, T scale, const std::string& name) {
    testing::TestVolume volume = bytes;
    volume.type = type;
    volume.samples.clear();
    for (const char sample : bytes.samples) {
      base::AppendLittleEndian(static_cast<T>(static_cast<unsigned char>(sample)) * scale,
                               &volume.samples);
    }
    ISOSCOPE_EXPECT_OK(testing::WriteRawFile(volume, Path(name)));
    return Join({Path(name)}, testing::RawFlags(volume));
  };
  const auto float_volume = write(volume::ScalarType::kFloat32, 1.0F, "f.raw");
  const auto double_volume = write(volume::ScalarType::kFloat64, 1e10, "d.raw");
  const auto fraction_volume = write(volume::ScalarType::kFloat32, 0.25F, "half.raw");
  const ObjMesh mesh = ReadObj(MustExport("m.obj", Join({"--labels", "all"}, float_volume)));
  EXPECT_EQ(mesh.positions.size(), 200U * 24);
  const CommandResult info = MustRun(Join({"info", "--json", "--labels", "all"}, float_volume));
  const json surfaces = json::parse(info.out).at("measures").at("surfaces");
  ASSERT_EQ(surfaces.size(), 200U);
  EXPECT_THAT(surfaces.at(199).at("labels"), ElementsAre(200.0));
  MustRun(Join({"export", "--label", "20000000000", "--output", Path("%l.obj")}, double_volume));
  EXPECT_TRUE(io::PathExists(Path("20000000000.obj")));
  const CommandResult refused = testing::RunIsoscope(
      Join({"export", "--labels", "all", "--output", Path("x.obj")}, fraction_volume));
  EXPECT_NE(refused.exit_code, 0);
  EXPECT_THAT(refused.err, HasSubstr("a sample is 0.25, and labels are whole numbers"));
}

TEST_F(ClosedMeshTest, VerticesFarFromTheOriginStayApart) {
  testing::TestVolume volume = testing::BallVolume({30, 30, 30}, 0.6);
  const auto export_at = [&](double spacing, const math::Vec3d& origin, const std::string& name) {
    volume.geometry.spacing = {spacing, spacing, spacing};
    volume.geometry.origin = origin;
    std::filesystem::remove(Path("ball.raw"));
    ISOSCOPE_EXPECT_OK(testing::WriteRawFile(volume, Path("ball.raw")));
    return MustExport(
        name, Join(Join({"--isovalue", "127.5"}, {Path("ball.raw")}), testing::RawFlags(volume)));
  };
  const ObjMesh near = ReadObj(export_at(1, {}, "m.obj"));
  EXPECT_EQ(near.distinct_count(), near.positions.size());
  struct Place {
    double spacing;
    math::Vec3d origin;
  };
  for (const Place& place : {Place{0.01, {500000, 4600000, 0}}, Place{1e-6, {1e3, 1e3, 1e3}},
                             Place{0.01, {-500000, -4600000, 0}}}) {
    const ObjMesh far = ReadObj(export_at(place.spacing, place.origin, "m.obj"));
    EXPECT_EQ(far.distinct_count(), near.distinct_count());
    EXPECT_THAT(result_.err, IsEmpty());
    for (std::size_t i = 0; i < near.positions.size(); ++i) {
      const math::Vec3d expected = place.origin + near.positions[i] * place.spacing;
      ASSERT_LT(math::Length(far.positions[i] - expected), place.spacing * 1e-4);
    }
  }
  const std::string stl = export_at(0.01, {500000, 4600000, 0}, "m.stl");
  EXPECT_TRUE(absl::StartsWith(stl, "isoscope, binary STL, origin 500000 4600000 0 "));
  EXPECT_THAT(result_.err, HasSubstr("from the origin 500000 4600000 0,"));
  EXPECT_THAT(export_at(0.01, {500000, 4600000, 0}, "m.glb"),
              HasSubstr("\"translation\":[500000.0,4600000.0,0.0]"));
}

}  // namespace
}  // namespace isoscope
