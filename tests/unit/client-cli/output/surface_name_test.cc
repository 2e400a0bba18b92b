#include "client-cli/output/surface_name.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string NameOf(absl::string_view pattern, const NamedSurface& surface) {
  EXPECT_THAT(CheckSurfaceName(pattern), IsOk()) << pattern;
  const auto names = SurfaceFileNames(pattern, {surface});
  EXPECT_THAT(names, IsOk());
  return names.value_or(std::vector<std::string>{""})[0];
}

TEST(SurfaceNameTest, APatternHasAFileForEachSurfaceIfItNamesThem) {
  for (const char* const pattern : {"label-%l.stl", "%03l.ply", "a/%n.obj", "%%%l"}) {
    EXPECT_TRUE(HasSurfaceName(pattern)) << pattern;
  }
  for (const char* const pattern : {"mesh.stl", "50%.ply", "%%l.ply", "%d.ply", "%", "%3n.ply"}) {
    EXPECT_FALSE(HasSurfaceName(pattern)) << pattern;
    EXPECT_THAT(CheckSurfaceName(pattern), IsOk()) << "verbatim";
  }
}

TEST(SurfaceNameTest, ALabelIsItsValueWithAllDigits) {
  EXPECT_EQ(NameOf("label-%l.stl", {.labels = {7}}), "label-7.stl");
  EXPECT_EQ(NameOf("label-%l.stl", {.labels = {-3}}), "label--3.stl");
  EXPECT_EQ(NameOf("%l.stl", {.labels = {1000000}}), "1000000.stl");
  EXPECT_EQ(NameOf("%l.stl", {.labels = {0x1p53}}), "9007199254740992.stl");
  EXPECT_EQ(NameOf("%l.stl", {.labels = {0.5}}), "0.5.stl");
  EXPECT_EQ(NameOf("%l.stl", {.labels = {3, 7, 8, 9}}), "3+7-9.stl");
  EXPECT_EQ(NameOf("%l.stl", {.labels = {3, 4}}), "3+4.stl");
  EXPECT_EQ(NameOf("%l.stl", {.labels = {0.5, 1.5}}), "0.5+1.5.stl");
}

TEST(SurfaceNameTest, LeadingZerosAreOfSingleWholeNumbers) {
  EXPECT_EQ(NameOf("%03l.stl", {.labels = {7}}), "007.stl");
  EXPECT_EQ(NameOf("%3l.stl", {.labels = {7}}), "007.stl");
  EXPECT_EQ(NameOf("%03l.stl", {.labels = {12345}}), "12345.stl");
  EXPECT_EQ(NameOf("%03l.stl", {.labels = {0.5}}), "0.5.stl");
  EXPECT_EQ(NameOf("%03l.stl", {.labels = {1, 2}}), "1+2.stl");
}

TEST(SurfaceNameTest, AnIsovalueStandsWhereALabelWould) {
  EXPECT_EQ(NameOf("at-%l.ply", {.isovalue = 60}), "at-60.ply");
  EXPECT_EQ(NameOf("at-%n.ply", {.isovalue = -0.25}), "at--0.25.ply");
  EXPECT_EQ(NameOf("at-%l.ply", {.isovalue = 100000}), "at-100000.ply");
}

TEST(SurfaceNameTest, ANameHasNoPartThatIsAPath) {
  EXPECT_EQ(NameOf("%n.stl", {.labels = {1}, .name = "left lung/../x"}), "left_lung_.._x.stl");
  EXPECT_EQ(NameOf("%n.stl", {.labels = {1}, .name = "\xc3\x84rger-1_2.b"}),
            "\xc3\x84rger-1_2.b.stl");
  EXPECT_EQ(NameOf("%n.stl", {.labels = {1}, .name = "a\nb"}), "a_b.stl");
  EXPECT_EQ(NameOf("%l_%n%%.stl", {.labels = {1}, .name = "a"}), "1_a%.stl");
}

TEST(SurfaceNameTest, OtherPercentSignsBesideALabelAreErrors) {
  for (const char* const pattern :
       {"%l-%d.stl", "%l%", "%l%5%", "%3n-%l", "%0999999999999l%l", "%10l-%l"}) {
    EXPECT_TRUE(IsUsageError(CheckSurfaceName(pattern))) << pattern;
  }
  EXPECT_THAT(CheckSurfaceName("%l-%d.stl"),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("'%d' is not known: write %l for the label")));
}

TEST(SurfaceNameTest, TwoSurfacesOfOneNameAreAnError) {
  const std::vector<NamedSurface> surfaces = {{.labels = {1}, .name = "lung"},
                                              {.labels = {2}, .name = "lung"}};
  EXPECT_THAT(SurfaceFileNames("%n.stl", surfaces),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("surfaces 0 and 1 would both be 'lung.stl'")));
  EXPECT_THAT(SurfaceFileNames("%l.stl", surfaces).value(), ElementsAre("1.stl", "2.stl"));
}

TEST(SurfaceNameTest, ANameThatIsTooLongIsAnError) {
  NamedSurface surface;
  for (int i = 0; i < 100; ++i) {
    surface.labels.push_back(2 * i);
  }
  EXPECT_THAT(SurfaceFileNames("%l.stl", {surface}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("longer than 255 bytes")));
  EXPECT_THAT(SurfaceFileNames("%n.stl", {{.labels = {1}, .name = std::string(251, 'a')}}), IsOk());
}

}  // namespace
}  // namespace isoscope::cli
