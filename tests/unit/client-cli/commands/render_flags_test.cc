#include "client-cli/commands/render_flags.h"

#include <algorithm>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "core/cli/flag_set.h"
#include "core/view/camera.h"
#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

RenderFlags Parse(const std::vector<std::string>& arguments) {
  RenderFlags flags;
  FlagSet set;
  AddRenderFlags(&set, &flags);
  std::vector<std::string> all{"v.nrrd", "--isovalue", "3", "--output", "o.png"};
  all.insert(all.end(), arguments.begin(), arguments.end());
  ISOSCOPE_EXPECT_OK(set.Parse(all));
  FillFirstLook(&flags);
  return flags;
}

TEST(FillFirstLookTest, SamplesAndMaterialAreThoseOfTheTableWhereNoFlagHasThem) {
  const RenderFlags first = Parse({});
  EXPECT_TRUE(first.shows_first_look());
  EXPECT_EQ(first.effects.samples, 4);
  EXPECT_EQ(first.look.material, client::MaterialChoice::kSoft);
  EXPECT_EQ(first.drawn_size(), (view::Viewport{2048, 2048})) << "the memory that is expected";
  const RenderFlags given = Parse({"--samples", "1", "--material", "glossy"});
  EXPECT_TRUE(given.shows_first_look());
  EXPECT_EQ(given.effects.samples, 1);
  EXPECT_EQ(given.look.material, client::MaterialChoice::kGlossy);
}

TEST(FillFirstLookTest, AFlagOfTheCameraOrARecordKeepsTheServersDefaults) {
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"--azimuth", "0"},
                                             {"--view", "front"},
                                             {"--fit", "volume"},
                                             {"--camera", "c.json"},
                                             {"--like", "p.png"}}) {
    const RenderFlags flags = Parse(arguments);
    EXPECT_FALSE(flags.shows_first_look()) << arguments[0];
    EXPECT_FALSE(flags.effects.samples.has_value()) << arguments[0];
    EXPECT_FALSE(flags.look.material.has_value()) << arguments[0];
  }
}

// A region of a poster has its pixels, so both have as many samples.
TEST(FillFirstLookTest, PostersAndTheirRegionsHaveTheSamplesOfPictures) {
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"--width", "4096", "--height", "4096"},
           {"--width", "12000", "--height", "12000"},
           {"--width", "9000", "--height", "100"},
           {"--width", "32768", "--height", "32768"},
           {"--width", "12000", "--height", "12000", "--culling", "mask"},
           {"--width", "12000", "--height", "12000", "--region", "0,0,100,100"}}) {
    const RenderFlags flags = Parse(arguments);
    EXPECT_EQ(flags.effects.samples, 4) << arguments[1];
    EXPECT_EQ(flags.look.material, client::MaterialChoice::kSoft);
  }
  const view::Viewport drawn = Parse({"--width", "12000", "--height", "12000"}).drawn_size();
  EXPECT_LE(std::max(drawn.width_px, drawn.height_px), view::kMaxViewportPx);
}

TEST(FillFirstLookTest, WhatCannotBeDrawnWithMoreAndPlanesKeepOneSample) {
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"--width", "32769", "--height", "100"},
           {"--width", "32769", "--height", "100", "--region", "0,0,100,100"},
           {"--width", "9000", "--height", "100", "--culling", "mask"}}) {
    const RenderFlags flags = Parse(arguments);
    EXPECT_FALSE(flags.effects.samples.has_value()) << arguments[1];
    EXPECT_EQ(flags.look.material, client::MaterialChoice::kSoft);
  }
  RenderFlags planes;
  FlagSet set;
  AddRenderFlags(&set, &planes);
  ISOSCOPE_ASSERT_OK(set.Parse({"v.nrrd", "--isovalue", "3", "--depth", "d.npy"}));
  FillFirstLook(&planes);
  EXPECT_FALSE(planes.effects.samples.has_value());
}

}  // namespace
}  // namespace isoscope::cli
