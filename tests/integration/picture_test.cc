// Pictures as people keep them: the record of how they were made, pictures made again from it,
// sweeps and animations.

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "clients/cpp/connection/png_metadata.h"
#include "clients/cpp/picture_file/png_chunks.h"
#include "core/base/units.h"
#include "core/image/png_codec.h"
#include "core/io/file.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

using testing::CommandResult;
using testing::Join;
using testing::RunIsoscope;

class PictureTest : public ::testing::Test {
 protected:
  void SetUp() override {
    ISOSCOPE_ASSERT_OK(testing::WriteRawFile(gyroid_, Path("volume.raw")));
    ISOSCOPE_ASSERT_OK(testing::MakeDataset(gyroid_, Path("one"), 1, 8));
    ISOSCOPE_ASSERT_OK(testing::MakeDataset(gyroid_, Path("three"), 3, 5));
  }

  [[nodiscard]] std::string Path(const std::string& name) const { return directory_.Sub(name); }
  [[nodiscard]] std::string Read(const std::string& name) const {
    absl::StatusOr<std::string> bytes = io::ReadWholeFile(Path(name), 64 * base::kMiB);
    EXPECT_THAT(bytes, testing::IsOk());
    return bytes.value_or("");
  }
  [[nodiscard]] CommandResult Render(const std::vector<std::string>& arguments) const {
    return RunIsoscope(Join({"render"}, arguments),
                       {.environment = {"XDG_CACHE_HOME=" + Path("cache")}});
  }
  // Renders a small picture to `name` and returns the file.
  // NOLINTNEXTLINE(modernize-use-nodiscard): the file may be all that is wanted
  std::string MustRender(const std::string& name, const std::vector<std::string>& arguments) const {
    const CommandResult result = Render(Join({"--output", Path(name)}, arguments));
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return Read(name);
  }
  // `from` is an input; the picture is small.
  static std::vector<std::string> Small(const std::vector<std::string>& from) {
    return Join(from, {"--isovalue", "128", "--width", "90", "--height", "70", "--azimuth", "20",
                       "--elevation", "10", "--background", "0.1,0.2,0.3,0.5"});
  }
  [[nodiscard]] std::vector<std::string> Cpu(const std::string& dataset) const {
    return {Path(dataset), "--renderer", "cpu"};
  }

  testing::TempDir directory_;
  // Blocks of 8 and of 5 do not divide it, on any axis.
  const testing::TestVolume gyroid_ = testing::GyroidVolume({43, 37, 29});
};

TEST_F(PictureTest, RecordDoesNotDependOnCutsSeedsNamesOrWhereThePictureIsMade) {
  const std::string png = MustRender("a.png", Small(Cpu("one")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const client::RecordedPng recorded, client::SplitRecordedPng(png));
  EXPECT_EQ(recorded.record.request.viewport().width_px(), 90);
  EXPECT_EQ(recorded.record.request.isovalue(), 128);
  EXPECT_TRUE(recorded.record.request.camera().has_perspective());
  EXPECT_EQ(recorded.record.samples_digest.size(), 32U);
  EXPECT_TRUE(absl::EndsWith(recorded.record.picture_revision, " cpu"));
  EXPECT_FALSE(absl::StrContains(png, directory_.path())) << "a path is in the picture";

  EXPECT_EQ(MustRender("b.png", Small(Cpu("three"))), png) << "other blocks, three shards";
  EXPECT_EQ(MustRender("b.png", Join(Small(Cpu("one")), {"--culling", "none"})), png);
  EXPECT_EQ(MustRender("b.png", Small(Join({Path("volume.raw"), "--renderer", "cpu"},
                                           testing::RawFlags(gyroid_)))),
            png)
      << "straight from the volume";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                testing::ProcessCluster::Start(Path("three"), 3));
  EXPECT_EQ(MustRender("b.png", Small({"--server", cluster->address()})), png) << "a cluster";

  const std::string plain = MustRender("plain.png", Join(Small(Cpu("one")), {"--no-metadata"}));
  EXPECT_EQ(plain, recorded.plain_png) << "the record is the only difference";
  EXPECT_FALSE(absl::StrContains(plain, "isoscope"));
  // The RPC's bytes are a function of the request.
  isoscope::v1::RenderIsosurfaceRequest request = recorded.record.request;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const isoscope::v1::RenderIsosurfaceResponse response,
                                testing::Render(cluster->address(), request));
  EXPECT_EQ(response.png(), plain);
}

TEST_F(PictureTest, LikeMakesThePictureAgainByteForByteFromAnyCutOfTheSamples) {
  const std::string png = MustRender("a.png", Small(Cpu("one")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                testing::ProcessCluster::Start(Path("three"), 3));
  for (const std::vector<std::string>& from : std::vector<std::vector<std::string>>{
           Cpu("one"),
           Cpu("three"),
           Join(Cpu("three"), {"--culling", "none"}),
           Join({Path("volume.raw"), "--renderer", "cpu"}, testing::RawFlags(gyroid_)),
           {"--server", cluster->address()}}) {
    SCOPED_TRACE(from[0]);
    const CommandResult result =
        Render(Join(from, {"--like", Path("a.png"), "--output", Path("b.png")}));
    EXPECT_EQ(result.exit_code, 0) << result.err;
    EXPECT_TRUE(absl::StrContains(result.out, "byte for byte")) << result.out;
    EXPECT_EQ(Read("b.png"), png);
  }
}

TEST_F(PictureTest, LikeRepeatsCapsAndTheirMaps) {
  const std::vector<std::string> cut{"--clip-plane", "1,1,0,30"};
  std::vector<std::string> pictures;
  for (const std::string caps : {"--caps", "--caps=viridis:0,300"}) {
    pictures.push_back(MustRender("caps.png", Small(Join(Cpu("one"), Join(cut, {caps})))));
    const CommandResult result =
        Render(Join(Cpu("three"), {"--like", Path("caps.png"), "--output", Path("b.png")}));
    EXPECT_EQ(result.exit_code, 0) << result.err;
    EXPECT_TRUE(absl::StrContains(result.out, "byte for byte")) << result.out;
    EXPECT_EQ(Read("b.png"), pictures.back());
  }
  pictures.push_back(MustRender("open.png", Small(Join(Cpu("one"), cut))));
  EXPECT_NE(pictures[0], pictures[1]);
  EXPECT_NE(pictures[0], pictures[2]);
  const CommandResult uncut = Render(Small(Join(Cpu("one"), {"--caps"})));
  EXPECT_EQ(uncut.exit_code, 2) << uncut.err;
  EXPECT_TRUE(absl::StrContains(uncut.err, "--clip-plane")) << uncut.err;
}

TEST_F(PictureTest, LikeRefusesOtherSamplesChangedPicturesAndPicturesWithoutARecord) {
  const std::string png = MustRender("a.png", Small(Cpu("one")));
  const auto like = [&](const std::string& dataset, const std::string& picture) {
    return Render(Join(Cpu(dataset), {"--like", Path(picture), "--output", Path("unwanted.png")}));
  };
  testing::TestVolume other = gyroid_;
  other.samples[1000] = static_cast<char>(other.samples[1000] ^ 1);
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(other, Path("other"), 1, 8));
  CommandResult result = like("other", "a.png");
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(absl::StrContains(result.err, "other samples")) << result.err;
  EXPECT_FALSE(io::PathExists(Path("unwanted.png")));

  testing::TestVolume stretched = gyroid_;
  stretched.geometry.spacing.z = 1.5;
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(stretched, Path("stretched"), 1, 8));
  EXPECT_EQ(like("stretched", "a.png").exit_code, 1) << "the grid decides the picture, too";

  MustRender("plain.png", Join(Small(Cpu("one")), {"--no-metadata"}));
  result = like("one", "plain.png");
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(absl::StrContains(result.err, "NOT_FOUND") &&
              absl::StrContains(result.err, "no record"))
      << result.err;

  // Three pixels are painted over; the record stays.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const client::RecordedPng recorded, client::SplitRecordedPng(png));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(image::RgbaImage painted, image::DecodePng(png));
  for (const std::size_t i : {std::size_t{10}, std::size_t{500}, painted.pixels.size() - 1}) {
    painted.pixels[i] = {static_cast<std::uint8_t>(painted.pixels[i].r ^ 128), 0, 0, 255};
  }
  const auto repainted = [&](const client::PictureRecord& record) {
    return client::AddPictureRecord(image::EncodePng(90, 70, painted.pixels), record).value();
  };
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(Path("painted.png"), repainted(recorded.record)));
  result = like("one", "painted.png");
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(absl::StrContains(result.err, "3 of 6,300 pixels differ")) << result.err;

  // Pictures of another revision may differ: the differing pixels are counted.
  client::PictureRecord older = recorded.record;
  older.picture_revision = "1 cpu";
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(Path("older.png"), repainted(older)));
  result = like("one", "older.png");
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_TRUE(absl::StrContains(result.out, "3 of 6,300 pixels differ")) << result.out;
  EXPECT_TRUE(absl::StrContains(result.out, "'1 cpu'")) << result.out;
}

TEST_F(PictureTest, LikeWithWrongFlagsIsWrongUsage) {
  for (const std::vector<std::string>& flags :
       std::vector<std::vector<std::string>>{{"--output", Path("b.png"), "--width", "30"},
                                             {"--output", Path("b.png"), "--isovalue", "30"},
                                             {"--output", Path("b.png"), "--culling", "mask"},
                                             {"--output", Path("b.apng")},
                                             {}}) {
    const CommandResult result = Render(Join(Cpu("one"), Join({"--like", Path("a.png")}, flags)));
    EXPECT_EQ(result.exit_code, 2) << result.err;
  }
  const CommandResult missing =
      Render(Join(Cpu("one"), {"--like", Path("none.png"), "--output", Path("b.png")}));
  EXPECT_EQ(missing.exit_code, 1);
  EXPECT_TRUE(absl::StrContains(missing.err, "none.png")) << missing.err;
}

TEST_F(PictureTest, MaskPictureCarriesNoRecordForItDependsOnTheCut) {
  const std::string png = MustRender("a.png", Join(Small(Cpu("one")), {"--culling", "mask"}));
  EXPECT_EQ(client::SplitRecordedPng(png).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(PictureTest, LikeComparesAnAnnotatedPictureBesideItsAnnotations) {
  const std::vector<std::string> annotations{"--axes", "--scale-bar", "--caption", "at {isovalue}"};
  const std::string png = MustRender("a.png", Join(Small(Cpu("one")), annotations));
  const std::string plain = MustRender("plain.png", Small(Cpu("one")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage pixels, image::DecodePng(png));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage plain_pixels, image::DecodePng(plain));
  EXPECT_NE(pixels, plain_pixels);
  // The picture without annotations comes back, and the same with them if they are asked for.
  CommandResult result =
      Render(Join(Cpu("three"), {"--like", Path("a.png"), "--output", Path("b.png")}));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_TRUE(absl::StrContains(result.out, "byte for byte")) << result.out;
  EXPECT_EQ(Read("b.png"), plain);
  result = Render(
      Join(Cpu("one"), Join({"--like", Path("a.png"), "--output", Path("b.png")}, annotations)));
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(Read("b.png"), png);
}

// The frames of an APNG as RGBA.
std::vector<image::RgbaImage> FramesOfApng(const std::string& apng) {
  const absl::StatusOr<std::vector<client::PngChunk>> chunks = client::ParsePngChunks(apng);
  EXPECT_THAT(chunks, testing::IsOk());
  std::vector<std::string> pngs;
  for (const client::PngChunk& chunk : *chunks) {
    if (chunk.type == "fcTL") {
      pngs.push_back(absl::StrCat(client::kPngSignature, chunks->front().bytes));
    } else if (chunk.type == "IDAT") {
      absl::StrAppend(&pngs.back(), chunk.bytes);
    } else if (chunk.type == "fdAT") {
      absl::StrAppend(&pngs.back(), client::MakePngChunk("IDAT", chunk.data.substr(4)));
    }
  }
  std::vector<image::RgbaImage> frames;
  for (const std::string& png : pngs) {
    absl::StatusOr<image::RgbaImage> frame =
        image::DecodePng(png + client::MakePngChunk("IEND", ""));
    EXPECT_THAT(frame, testing::IsOk());
    frames.push_back(frame.value_or(image::RgbaImage{}));
  }
  return frames;
}

TEST_F(PictureTest, SweepIsTheSinglePicturesNumberedOrAsAnAnimation) {
  const std::vector<std::string> view =
      Join(Cpu("one"),
           {"--width", "90", "--height", "70", "--background", "0,0,0,0", "--view", "front"});
  const CommandResult numbered =
      Render(Join(view, {"--output", Path("s-%d.png"), "--isovalue", "90:150:30"}));
  ASSERT_EQ(numbered.exit_code, 0) << numbered.err;
  const CommandResult animated =
      Render(Join(view, {"--output", Path("s.apng"), "--isovalue", "90:150:30", "--fps", "5"}));
  ASSERT_EQ(animated.exit_code, 0) << animated.err;
  const std::vector<image::RgbaImage> frames = FramesOfApng(Read("s.apng"));
  ASSERT_EQ(frames.size(), 3U);
  for (int i = 0; i < 3; ++i) {
    const std::string single =
        MustRender("single.png", Join(view, {"--isovalue", absl::StrCat(90 + 30 * i)}));
    EXPECT_EQ(Read(absl::StrCat("s-", i, ".png")), single) << i;
    EXPECT_EQ(frames[static_cast<std::size_t>(i)], image::DecodePng(single).value()) << i;
  }
  EXPECT_NE(frames[0], frames[2]) << "the isovalue did not change";
}

TEST_F(PictureTest, TurntableIsOneAnimationOfEitherFormat) {
  const std::vector<std::string> view =
      Join(Cpu("one"), {"--width", "90", "--height", "70", "--isovalue", "128"});
  const std::vector<std::string> turn =
      Join(view, {"--view", "front", "--repeat", "4", "--orbit", "30"});
  MustRender("t.apng", turn);
  const std::string webp = MustRender("t.webp", turn);
  EXPECT_TRUE(absl::StartsWith(webp, "RIFF") && absl::StrContains(webp, "ANIM"));
  const std::vector<image::RgbaImage> frames = FramesOfApng(Read("t.apng"));
  ASSERT_EQ(frames.size(), 4U);
  for (int i = 0; i < 4; ++i) {
    const std::string single =
        MustRender("single.png", Join(view, {"--azimuth", absl::StrCat(30 * i)}));
    EXPECT_EQ(frames[static_cast<std::size_t>(i)], image::DecodePng(single).value()) << i;
  }
}

TEST_F(PictureTest, SweepThatCannotBeKeptIsWrongUsageBeforeAnyWork) {
  const CommandResult one_name =
      Render({Path("absent"), "--isovalue", "1:3:1", "--output", Path("a.png")});
  EXPECT_EQ(one_name.exit_code, 2) << one_name.err;
  EXPECT_TRUE(absl::StrContains(one_name.err, "put %d into")) << one_name.err;
  const CommandResult too_large = Render(
      {Path("absent"), "--isovalue", "1:3:1", "--width", "16384", "--output", Path("a.webp")});
  EXPECT_EQ(too_large.exit_code, 2) << too_large.err;
}

}  // namespace
}  // namespace isoscope
