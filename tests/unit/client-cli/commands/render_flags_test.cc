#include "client-cli/commands/render_flags.h"

#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "core/cli/flag_set.h"
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
TEST(FillFirstLookTest, PostersTheirRegionsAndPlanesKeepOneSample) {
  EXPECT_TRUE(Parse({"--width", "4096", "--height", "4096"}).effects.samples.has_value());
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"--width", "5000", "--height", "5000"},
           {"--width", "9000", "--height", "100"},
           {"--width", "5000", "--height", "5000", "--region", "0,0,100,100"}}) {
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
