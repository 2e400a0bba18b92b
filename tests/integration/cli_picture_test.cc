// Pictures of the command line: the same for any culling, shards and place where they are made;
// regions, posters, cameras and views.

#include <png.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "core/image/png_codec.h"
#include "core/io/file.h"
#include "tests/integration/cli_fixture.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"

namespace isoscope {
namespace {

using nlohmann::json;
using testing::CommandResult;
using ::testing::HasSubstr;
using testing::RunIsoscope;

// Decodes a PNG that is wider than DecodePng takes.
std::vector<image::Rgba8> ReadWide(const std::string& png, int width, int height) {
  png_image image;
  std::memset(&image, 0, sizeof(image));
  image.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_memory(&image, png.data(), png.size()), 0) << image.message;
  EXPECT_EQ(image.width, static_cast<unsigned>(width));
  EXPECT_EQ(image.height, static_cast<unsigned>(height));
  image.format = PNG_FORMAT_RGBA;
  std::vector<image::Rgba8> pixels(std::size_t{image.width} * image.height);
  EXPECT_NE(png_image_finish_read(&image, nullptr, pixels.data(), 0, nullptr), 0) << image.message;
  return pixels;
}

TEST_F(CliTest, PictureDoesNotDependOnCullingShardsOrWhereItIsMade) {
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "one", 1));
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "three", 3));
  const std::vector<std::string> view{"--azimuth", "35", "--elevation", "20", "--zoom", "1.3"};
  const std::vector<std::string> cpu{"--renderer", "cpu"};

  json stats_of_one;
  json stats_of_three;
  const std::string png = Render(Join({Path("one")}, Join(view, cpu)), &stats_of_one);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage decoded, image::DecodePng(png));
  EXPECT_EQ(decoded.width, 160);
  EXPECT_EQ(decoded.height, 120);
  // Defends the test: an empty picture never depends on anything.
  const auto lit = std::count_if(decoded.pixels.begin(), decoded.pixels.end(),
                                 [](const image::Rgba8& p) { return p.r + p.g + p.b > 0; });
  EXPECT_GT(lit, 160 * 120 / 4);

  EXPECT_EQ(Render(Join({Path("three")}, Join(view, cpu)), &stats_of_three), png);
  EXPECT_EQ(stats_of_one.at("frames").at(0).at("triangle_count"),
            stats_of_three.at("frames").at(0).at("triangle_count"));
  EXPECT_EQ(Render(Join({Path("one"), "--culling", "none"}, Join(view, cpu))), png) << "culling";
  EXPECT_EQ(Render(Join({Path("one"), "--threads", "1"}, Join(view, cpu))), png) << "threads";

  const std::vector<std::string> source = Join({Path("volume.raw")}, testing::RawFlags(gyroid_));
  EXPECT_EQ(Render(Join(source, Join(view, cpu))), png) << "straight from the volume";
  EXPECT_EQ(Render(Join(source, Join(view, cpu))), png) << "from the cache";
  EXPECT_EQ(Render(Join(source, Join({"--shards", "3"}, Join(view, cpu)))), png)
      << "from the volume, in three shards";

  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                testing::ProcessCluster::Start(Path("three"), 3));
  EXPECT_EQ(Render(Join({"--server", cluster->address()}, view)), png) << "from a cluster";
}

TEST_F(CliTest, ARegionAndAPosterHaveThePixelsOfTheWhole) {
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "three", 3));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const image::RgbaImage whole,
      image::DecodePng(Render({Path("three"), "--azimuth", "35", "--renderer", "cpu"})));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const image::RgbaImage part,
      image::DecodePng(Render(
          {Path("three"), "--azimuth", "35", "--renderer", "cpu", "--region", "50,20,70,61"})));
  ASSERT_EQ(part.width, 70);
  ASSERT_EQ(part.height, 61);
  int lit = 0;
  for (int y = 0; y < part.height; ++y) {
    for (int x = 0; x < part.width; ++x) {
      const image::Rgba8 pixel = part.pixels[static_cast<std::size_t>(y * part.width + x)];
      ASSERT_EQ(pixel, whole.pixels[static_cast<std::size_t>((y + 20) * whole.width + x + 50)]);
      lit += pixel.r > 0 ? 1 : 0;
    }
  }
  EXPECT_GT(lit, 70 * 61 / 4);

  // A picture that no frame can be: 17000 pixels wide. Tiles make it; one region shows one of them.
  const auto render_wide = [&](const std::vector<std::string>& more) {
    const std::string png = Path("wide.png");
    const std::string out =
        MustRun(Join({"render", Path("three"), "--isovalue", kIsovalue, "--renderer", "cpu",
                      "--width", "17000", "--height", "60", "--output", png},
                     more),
                Options());
    return std::pair(ReadFile(png), out);
  };
  const auto [poster, text] = render_wide({"--stats", Path("regions.json")});
  EXPECT_TRUE(absl::StrContains(text, "17000 x 60 pixels in 3 regions")) << text;
  EXPECT_EQ(ParseJson(ReadFile(Path("regions.json"))).at("frames").size(), 3U);
  const auto [middle_png, middle_text] = render_wide({"--region", "8450,7,100,50"});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage middle, image::DecodePng(middle_png));
  const std::vector<image::Rgba8> pixels = ReadWide(poster, 17000, 60);
  lit = 0;
  for (int y = 0; y < 50; ++y) {
    for (int x = 0; x < 100; ++x) {
      const image::Rgba8 pixel = middle.pixels[static_cast<std::size_t>(y * 100 + x)];
      ASSERT_EQ(pixel, pixels[static_cast<std::size_t>((y + 7) * 17000 + x + 8450)]);
      lit += pixel.r > 0 ? 1 : 0;
    }
  }
  EXPECT_GT(lit, 100);
}

TEST_F(CliTest, EglBackEndCullsWithoutTouchingThePicture) {
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "one", 1));
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "three", 3));
  json stats;
  json all_stats;
  const std::string png = Render({Path("three"), "--renderer", "egl"}, &stats);
  EXPECT_EQ(Render({Path("one"), "--renderer", "egl", "--culling", "none"}, &all_stats), png);
  EXPECT_LE(stats.at("frames").at(0).at("triangle_count"),
            all_stats.at("frames").at(0).at("triangle_count"));
}

TEST_F(CliTest, TheOutputDashIsThePictureOnStandardOutput) {
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "d", 1));
  const std::vector<std::string> base{"render", Path("d"),  "--isovalue", kIsovalue,    "--width",
                                      "80",     "--height", "80",         "--renderer", "cpu"};
  MustRun(Join(base, {"--output", Path("file.png")}));
  const testing::ProcessOptions options = Options();
  const CommandResult piped = RunIsoscope(Join(base, {"-o", "-"}), options);
  EXPECT_EQ(piped.exit_code, 0) << piped.err;
  EXPECT_TRUE(piped.out == ReadFile(Path("file.png"))) << "text, or another picture";
  EXPECT_THAT(piped.err, HasSubstr("standard output: 80 x 80 pixels"));
  for (const std::vector<std::string>& more :
       {std::vector<std::string>{"--stats", "-"}, {"--show", "sixel"}}) {
    const auto refused = RunIsoscope(Join(Join(base, {"-o", "-"}), more), options);
    EXPECT_EQ(refused.exit_code, 2);
    EXPECT_THAT(refused.err, HasSubstr("both write to standard output"));
  }
  const auto mesh =
      testing::RunIsoscope({"export", Path("d"), "--isovalue", kIsovalue, "-o", "-"}, options);
  EXPECT_EQ(mesh.exit_code, 2);
  EXPECT_THAT(mesh.err, HasSubstr("--output -: a mesh is written to a file"));
}

TEST_F(CliTest, RepeatWithOrbitTurnsTheCameraOneStepAFrame) {
  ASSERT_NO_FATAL_FAILURE(Partition(gyroid_, "d", 2));
  const std::vector<std::string> base{"render",     Path("d"), "--isovalue", kIsovalue,
                                      "--width",    "80",      "--height",   "80",
                                      "--renderer", "cpu",     "--view",     "front"};
  const std::string out = MustRun(
      Join(base, {"--output", Path("f%d.png"), "--repeat", "3", "--orbit", "30", "--stats", "-"}));
  EXPECT_EQ(ParseJson(out).at("frames").size(), 3U);
  std::set<std::string> pictures;
  for (const int frame : {0, 1, 2}) {
    const std::string picture = ReadFile(Path(absl::StrCat("f", frame, ".png")));
    pictures.insert(picture);
    MustRun(Join(base, {"--azimuth", absl::StrCat(30 * frame), "--output", Path("turned.png")}));
    EXPECT_EQ(ReadFile(Path("turned.png")), picture) << "frame " << frame;
  }
  EXPECT_EQ(pictures.size(), 3U) << "the camera did not move";

  // Leading zeros, as in ffmpeg: names in the order of the frames.
  MustRun(Join(base, {"--output", Path("z%03d%%.png"), "--repeat", "3", "--orbit", "30"}));
  for (const int frame : {0, 1, 2}) {
    EXPECT_EQ(ReadFile(Path(absl::StrCat("z00", frame, "%.png"))),
              ReadFile(Path(absl::StrCat("f", frame, ".png"))));
  }
  // Frames that would overwrite each other: refused before the first.
  const testing::CommandResult refused = testing::RunIsoscope(
      Join(base, {"--output", Path("w%3x.png"), "--repeat", "3", "--orbit", "30"}), Options());
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.err.find("'%3x' is no number of a frame"), std::string::npos) << refused.err;
  EXPECT_FALSE(io::PathExists(Path("w%3x.png")));

  // Without a place for the number only the last frame stays.
  MustRun(Join(base, {"--output", Path("last.png"), "--repeat", "3", "--orbit", "30"}));
  EXPECT_EQ(ReadFile(Path("last.png")), ReadFile(Path("f2.png")));
}

TEST_F(CliTest, TheFrontIsTheDefaultCameraOfVtk) {
  testing::TestVolume volume = gyroid_;
  volume.geometry.spacing = {1, 2, 0.5};
  volume.geometry.origin = {100, -50, 7};
  ASSERT_NO_FATAL_FAILURE(Partition(volume, "d", 1));
  const math::Vec3d size{42 * 1.0, 36 * 2.0, 28 * 0.5};
  const math::Vec3d center = volume.geometry.origin + size * 0.5;
  const double distance = 0.5 * math::Length(size) / std::sin(15 * std::acos(-1.0) / 180);
  const auto triple = [](const math::Vec3d& v) {
    return absl::StrFormat("%.17g,%.17g,%.17g", v.x, v.y, v.z);
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const image::RgbaImage by_default,
      image::DecodePng(Render({Path("d"), "--renderer", "cpu", "--view", "front"})));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const image::RgbaImage explicitly,
      image::DecodePng(Render({Path("d"), "--renderer", "cpu", "--eye",
                               triple(center + math::Vec3d{0, 0, distance}), "--target",
                               triple(center), "--up", "0,1,0", "--fov-y", "30"})));
  // The two eyes may differ in the last bit; a pixel on an edge may then fall to the other side.
  int different = 0;
  for (std::size_t i = 0; i < by_default.pixels.size(); ++i) {
    different += by_default.pixels[i] == explicitly.pixels[i] ? 0 : 1;
  }
  EXPECT_LE(different, 20) << "of " << by_default.pixels.size();
}

TEST_F(CliTest, FittedAndSavedCamerasAreTheSameForAnyShardsAndMakeThePictureAgain) {
  const testing::TestVolume ball = testing::BallVolume({50, 46, 42}, 0.3);
  ASSERT_NO_FATAL_FAILURE(Partition(ball, "one", 1));
  ASSERT_NO_FATAL_FAILURE(Partition(ball, "three", 3));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                testing::ProcessCluster::Start(Path("three"), 3));
  const std::vector<std::vector<std::string>> inputs{{Path("one"), "--renderer", "cpu"},
                                                     {Path("three"), "--renderer", "cpu"},
                                                     {"--server", cluster->address()}};
  const std::string whole = Render({Path("one"), "--renderer", "cpu"});
  for (const std::vector<std::string>& flags : std::vector<std::vector<std::string>>{
           {"--fit", "surface"},
           {"--fit", "cells"},
           {"--fit", "cells", "--view", "left", "--zoom", "1.5"},
           {"--fit", "surface", "--view", "top", "--azimuth", "20", "--zoom", "1.2"},
           {"--view", "left"}}) {
    SCOPED_TRACE(::testing::PrintToString(flags));
    std::string camera;
    std::string png;
    for (const std::vector<std::string>& input : inputs) {
      const std::string made = Render(Join(Join(flags, {"--save-camera", Path("c.json")}), input));
      const std::string saved = ReadFile(Path("c.json"));
      if (png.empty()) {
        png = made;
        camera = saved;
        EXPECT_NE(png, whole);
      }
      EXPECT_EQ(saved, camera) << input[0];
      EXPECT_TRUE(made == png) << input[0];
      EXPECT_TRUE(Render(Join({"--camera", Path("c.json")}, input)) == png) << input[0];
      EXPECT_EQ(ReadFile(Path("c.json")), camera);
    }
  }
  // The surface fills the picture: the eye is nearer by the ratio of the boxes.
  const auto distance_of = [&](const std::vector<std::string>& flags) {
    Render(Join(flags, {Path("one"), "--renderer", "cpu", "--save-camera", Path("c.json")}));
    const json camera = ParseJson(ReadFile(Path("c.json")));
    return camera.at("eye").at(2).get<double>() - camera.at("target").at(2).get<double>();
  };
  EXPECT_LT(distance_of({"--fit", "surface"}), 0.75 * distance_of({"--view", "front"}));
  EXPECT_EQ(distance_of({"--fit", "volume"}), distance_of({"--view", "front"}));
  EXPECT_LT(distance_of({"--fit", "cells"}), distance_of({"--fit", "surface"}));
  EXPECT_EQ(distance_of({"--fit", "surface", "--clip-box", "0,99,0,99,0,99"}),
            distance_of({"--fit", "surface"}));
  EXPECT_NEAR(distance_of({"--fit", "surface", "--clip-box", "22,26,17,21,18,22"}) /
                  distance_of({"--fit", "surface", "--clip-box", "22,24,17,19,18,20"}),
              2, 1e-9)
      << "the box is smaller than the blocks in it";
  // Nothing to fit to: the volume, as without.
  const CommandResult empty = RunIsoscope(
      {"render", Path("one"), "--isovalue", "300", "--fit", "surface", "--width", "160", "--height",
       "120", "--renderer", "cpu", "--output", Path("e.png"), "--save-camera", Path("e.json")});
  EXPECT_EQ(empty.exit_code, 0) << empty.err;
  distance_of({"--view", "front"});
  EXPECT_EQ(ReadFile(Path("e.json")), ReadFile(Path("c.json")));
}

// Blocks of another size, shards, the file itself, a cluster; and the flags that make it again.
TEST_F(CliTest, TheFirstLookIsTheSameForAnyCutAndHasFlagsOfItsOwn) {
  const testing::TestVolume ball = testing::BallVolume({50, 46, 42}, 0.3);
  ASSERT_NO_FATAL_FAILURE(Partition(ball, "three", 3));
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(ball, Path("other"), 2, 5));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                testing::ProcessCluster::Start(Path("three"), 3));
  const std::vector<std::string> saved{"--save-camera", Path("c.json")};
  const std::string png = Render(Join({Path("three"), "--renderer", "cpu"}, saved));
  const std::string camera = ReadFile(Path("c.json"));
  for (const std::vector<std::string>& input : std::vector<std::vector<std::string>>{
           {Path("other"), "--renderer", "cpu"},
           Join({Path("volume.raw"), "--renderer", "cpu"}, testing::RawFlags(ball)),
           {"--server", cluster->address()}}) {
    EXPECT_TRUE(Render(Join(input, saved)) == png) << input[0];
    EXPECT_EQ(ReadFile(Path("c.json")), camera) << input[0];
  }
  const std::vector<std::string> cpu{Path("three"), "--renderer", "cpu"};
  EXPECT_TRUE(Render(Join(cpu, {"--camera", Path("c.json"), "--samples", "4", "--material",
                                "soft"})) == png);
  EXPECT_FALSE(Render(Join(cpu, {"--camera", Path("c.json")})) == png);
  EXPECT_FALSE(Render(Join(cpu, {"--samples", "1"})) == png) << "a given flag counts";
  EXPECT_FALSE(Render(Join(cpu, {"--material", "glossy"})) == png);

  // No pixel of the ball is burnt out where it faces the eye.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage soft,
                                image::DecodePng(Render(Join(cpu, {"--color", "1,1,0.5"}))));
  const auto burnt = std::count_if(soft.pixels.begin(), soft.pixels.end(),
                                   [](const image::Rgba8& p) { return p.b > 160; });
  EXPECT_EQ(burnt, 0) << "white was added";
  // The ball is as high as the picture, but for the margins.
  int first_row = soft.height;
  int last_row = 0;
  for (int y = 0; y < soft.height; ++y) {
    for (int x = 0; x < soft.width; ++x) {
      if (soft.pixels[static_cast<std::size_t>(y * soft.width + x)].r > 0) {
        first_row = std::min(first_row, y);
        last_row = y;
      }
    }
  }
  EXPECT_GT(first_row, 0);
  EXPECT_LT(last_row, soft.height - 1);
  EXPECT_GT(last_row - first_row, soft.height / 2);

  // A pick means the pixels of this picture.
  const auto depth_of = [&](const std::vector<std::string>& flags) {
    return ParseJson(MustRun(Join(Join({"pick", "--isovalue", kIsovalue, "--width", "160",
                                        "--height", "120", "--pixel", "80,60", "--json"},
                                       cpu),
                                  flags),
                             Options()))
        .at("points")
        .at(0)
        .at("depth");
  };
  EXPECT_EQ(depth_of({}), depth_of({"--camera", Path("c.json")}));

  // Without a surface: the volume.
  MustRun({"render", Path("three"), "--isovalue", "300", "--width", "160", "--height", "120",
           "--renderer", "cpu", "--output", Path("e.png"), "--save-camera", Path("e.json")},
          Options());
  const json empty = ParseJson(ReadFile(Path("e.json")));
  EXPECT_EQ(empty.at("target").at(0).get<double>(), 24.5);
  // A film has one camera that shows all frames: that of the volume.
  MustRun(Join({"render", "--isovalue", "128", "--repeat", "2", "--orbit", "90", "--output",
                Path("o.png"), "--width", "160", "--height", "120"},
               Join(cpu, saved)),
          Options());
  EXPECT_EQ(ParseJson(ReadFile(Path("c.json"))).at("target"), empty.at("target"));
}

TEST_F(CliTest, ViewsOfAPatientFollowTheFrameOfTheFile) {
  const testing::TestVolume ball = testing::BallVolume({30, 26, 22}, 0.8);
  const auto write = [&](const std::string& name, const std::string& space) {
    ISOSCOPE_ASSERT_OK(io::WriteWholeFile(
        Path(name), absl::StrCat("NRRD0004\ntype: uchar\ndimension: 3\n", space,
                                 "\nsizes: 30 26 22\nspace directions: (1,0,0) (0,1,0) (0,0,1)\n"
                                 "space origin: (0,0,0)\nencoding: raw\n\n",
                                 ball.samples)));
  };
  ASSERT_NO_FATAL_FAILURE(write("lps.nrrd", "space: left-posterior-superior"));
  ASSERT_NO_FATAL_FAILURE(write("plain.nrrd", "space dimension: 3"));
  const auto camera_of = [&](const std::string& name, const char* view) {
    Render({Path(name), "--renderer", "cpu", "--view", view, "--save-camera", Path("c.json")});
    return ParseJson(ReadFile(Path("c.json")));
  };
  const json info =
      ParseJson(MustRun({"info", Path("lps.nrrd"), "--histogram", "--json"}, Options()));
  EXPECT_EQ(info.at("datasets").at(0).at("patient_frame"), "LPS");
  const json anterior = camera_of("lps.nrrd", "anterior");
  EXPECT_LT(anterior.at("eye").at(1), anterior.at("target").at(1));
  EXPECT_EQ(anterior.at("up"), json({0.0, 0.0, 1.0}));
  EXPECT_GT(camera_of("lps.nrrd", "left").at("eye").at(0).get<double>(), 30);
  EXPECT_LT(camera_of("plain.nrrd", "left").at("eye").at(0).get<double>(), 0);
  EXPECT_EQ(camera_of("lps.nrrd", "front"), camera_of("plain.nrrd", "front"));
  // The first look: from anterior, with superior up.
  Render({Path("lps.nrrd"), "--renderer", "cpu", "--save-camera", Path("c.json")});
  const json first = ParseJson(ReadFile(Path("c.json")));
  EXPECT_LT(first.at("eye").at(1), first.at("target").at(1));
  EXPECT_EQ(first.at("eye").at(0), first.at("target").at(0));
  EXPECT_EQ(first.at("up"), json({0.0, 0.0, 1.0}));
  const CommandResult refused = RunIsoscope({"render", Path("plain.nrrd"), "--isovalue", "128",
                                             "--view", "anterior", "--output", Path("p.png")},
                                            Options());
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_TRUE(absl::StrContains(refused.err, "no patient frame")) << refused.err;
}

}  // namespace
}  // namespace isoscope
