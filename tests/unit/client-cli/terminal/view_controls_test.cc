#include "client-cli/terminal/view_controls.h"

#include <cstddef>
#include <limits>
#include <optional>
#include <string>

#include "absl/strings/str_split.h"
#include "gtest/gtest.h"

#include "core/view/camera_fit.h"

namespace isoscope::cli {
namespace {

using Effect = ViewControls::Effect;
using Kind = Key::Kind;

const ViewedVolume kVolume{
    .bounds = {{0, 0, 0}, {2, 4, 6}}, .patient_frame = std::nullopt, .values = {0, 255}};

void Type(const std::string& keys, ViewControls* controls) {
  for (const char c : keys) {
    controls->Press({.kind = Kind::kCharacter, .character = c});
  }
}

void ExpectNear(const math::Vec3d& a, const math::Vec3d& b) {
  EXPECT_NEAR(a.x, b.x, 1e-9);
  EXPECT_NEAR(a.y, b.y, 1e-9);
  EXPECT_NEAR(a.z, b.z, 1e-9);
}

TEST(ViewControlsTest, BeginsWithTheFirstCameraAndGoesBackToIt) {
  const ViewControls controls(kVolume, 60);
  EXPECT_EQ(controls.camera(), view::MakeDefaultCamera(kVolume.bounds));
  EXPECT_EQ(controls.isovalue(), 60);
  ViewedVolume volume = kVolume;
  volume.first_camera = view::MakeDefaultCamera(kVolume.bounds);
  view::Azimuth(0.5, &*volume.first_camera);
  ViewControls given(volume, 60);
  EXPECT_EQ(given.camera(), *volume.first_camera);
  Type("]+h", &given);
  EXPECT_EQ(given.Press({.kind = Kind::kHome}), Effect::kReset);
  EXPECT_EQ(given.camera(), *volume.first_camera);
  EXPECT_EQ(given.isovalue(), 62) << "Home keeps the isovalue";
  EXPECT_EQ(given.Press({.kind = Kind::kCharacter, .character = '0'}), Effect::kReset);
  EXPECT_EQ(given.isovalue(), 60);
}

TEST(ViewControlsTest, TakesTheCameraThatTheServerHasChosen) {
  ViewControls controls(kVolume, 60);
  view::Camera chosen = view::MakeDefaultCamera(kVolume.bounds);
  view::Elevation(0.3, &chosen);
  controls.SetCamera(chosen);
  EXPECT_EQ(controls.camera(), chosen);
}

TEST(ViewControlsTest, TheSceneTurnsWithTheArrow) {
  ViewControls controls(kVolume, 60);
  const view::Camera before = controls.camera();
  EXPECT_EQ(controls.Press({.kind = Kind::kRight}), Effect::kMoved);
  EXPECT_LT(controls.camera().eye.x, before.eye.x);  // the eye goes the other way
  controls.Press({.kind = Kind::kLeft});
  ExpectNear(controls.camera().eye, before.eye);
  controls.Press({.kind = Kind::kUp});
  EXPECT_LT(controls.camera().eye.y, before.eye.y);
  controls.Press({.kind = Kind::kDown});
  ExpectNear(controls.camera().eye, before.eye);
}

TEST(ViewControlsTest, AFullTurnOverThePoleEndsWhereItBegan) {
  ViewControls controls(kVolume, 60);
  const view::Camera before = controls.camera();
  for (int i = 0; i < 72; ++i) {
    controls.Press({.kind = Kind::kUp});
    EXPECT_TRUE(view::Validate(controls.camera()).ok()) << i;
  }
  ExpectNear(controls.camera().eye, before.eye);
  ExpectNear(controls.camera().up, before.up);
}

TEST(ViewControlsTest, LettersAreArrowsAndCapitalsMove) {
  ViewControls letters(kVolume, 60);
  ViewControls arrows(kVolume, 60);
  Type("hjkl", &letters);
  for (const Kind kind : {Kind::kLeft, Kind::kDown, Kind::kUp, Kind::kRight}) {
    arrows.Press({.kind = kind});
  }
  EXPECT_EQ(letters.camera(), arrows.camera());
  ViewControls moved(kVolume, 60);
  const view::Camera before = moved.camera();
  Type("L", &moved);
  EXPECT_LT(moved.camera().target.x, before.target.x);
  ExpectNear(moved.camera().eye - moved.camera().target, before.eye - before.target);
}

TEST(ViewControlsTest, ZoomHasLimits) {
  ViewControls controls(kVolume, 60);
  const double distance = math::Length(controls.camera().eye - controls.camera().target);
  Type("+-", &controls);
  EXPECT_NEAR(math::Length(controls.camera().eye - controls.camera().target), distance, 1e-9);
  for (const char c : {'+', '-'}) {
    Type(std::string(1000, c), &controls);
    EXPECT_TRUE(view::Validate(controls.camera()).ok());
  }
}

TEST(ViewControlsTest, NamedViewsAndReset) {
  ViewControls controls(kVolume, 60);
  Type("5", &controls);
  EXPECT_EQ(controls.camera(),
            view::MakeNamedCamera(view::NamedView::kTop, kVolume.bounds, std::nullopt).value());
  const ViewedVolume patient{
      .bounds = kVolume.bounds, .patient_frame = volume::PatientFrame(), .values = {0, 255}};
  ViewControls patient_controls(patient, 60);
  Type("5", &patient_controls);
  EXPECT_EQ(patient_controls.camera(), view::MakeNamedCamera(view::NamedView::kSuperior,
                                                             kVolume.bounds, volume::PatientFrame())
                                           .value());
  Type("]+hr", &controls);
  EXPECT_EQ(controls.camera(), view::MakeDefaultCamera(kVolume.bounds));
  EXPECT_EQ(controls.isovalue(), 60);
}

TEST(ViewControlsTest, RollKeepsTheDirection) {
  ViewControls controls(kVolume, 60);
  const view::Camera before = controls.camera();
  Type(",", &controls);
  EXPECT_EQ(controls.camera().eye, before.eye);
  EXPECT_NE(controls.camera().up, before.up);
  Type(".", &controls);
  ExpectNear(controls.camera().up, before.up);
}

TEST(ViewControlsTest, IsovaluesStepOnRoundNumbersInsideTheRange) {
  EXPECT_EQ(IsovalueStep({0, 255}), 2);
  EXPECT_EQ(IsovalueStep({0, 1}), 0.01);
  EXPECT_EQ(IsovalueStep({-1024, 3071}), 20);
  EXPECT_EQ(IsovalueStep({5, 5}), 1);
  EXPECT_EQ(IsovalueStep({}), 1);
  const double largest = std::numeric_limits<double>::max();
  EXPECT_GT(IsovalueStep({-largest, largest}), 0);
  ViewControls controls(kVolume, 61);
  Type("]", &controls);
  EXPECT_EQ(controls.isovalue(), 64);  // 61 is nearest to 62, or 60
  Type("}", &controls);
  EXPECT_EQ(controls.isovalue(), 84);
  Type(std::string(50, '}'), &controls);
  EXPECT_EQ(controls.isovalue(), 255);
  Type(std::string(50, '{'), &controls);
  EXPECT_EQ(controls.isovalue(), 0);
}

TEST(ViewControlsTest, LabelsAreShownAloneOneAfterTheOtherAndThenAllAgain) {
  ViewControls controls(kVolume, std::nullopt, 3);
  EXPECT_EQ(controls.labels().chosen(), std::nullopt);
  for (const std::optional<std::size_t> next :
       {std::optional<std::size_t>(0), std::optional<std::size_t>(1), std::optional<std::size_t>(2),
        std::optional<std::size_t>()}) {
    EXPECT_EQ(controls.Press({.kind = Kind::kCharacter, .character = 'n'}), Effect::kMoved);
    EXPECT_EQ(controls.labels().chosen(), next);
  }
  Type("N", &controls);
  EXPECT_EQ(controls.labels().chosen(), 2) << "before all is the last one";
  Type("N", &controls);
  EXPECT_EQ(controls.labels().chosen(), 1);
  Type("a", &controls);
  EXPECT_EQ(controls.labels().chosen(), std::nullopt);
  EXPECT_EQ(controls.Press({.kind = Kind::kCharacter, .character = 'a'}), Effect::kNone);
  Type("nx", &controls);
  EXPECT_EQ(controls.labels().hidden_count(), 1);
  Type("d", &controls);
  EXPECT_TRUE(controls.labels().is_highlighted());
  Type("h0", &controls);
  EXPECT_EQ(controls.labels().chosen(), std::nullopt) << "the first view has all";
  EXPECT_EQ(controls.labels().hidden_count(), 0);
  EXPECT_EQ(controls.Press({.kind = Kind::kCharacter, .character = ']'}), Effect::kNone);
  EXPECT_EQ(controls.isovalue(), std::nullopt) << "no surface has one";
}

TEST(ViewControlsTest, WithoutLabelsTheirKeysDoNothing) {
  ViewControls controls(kVolume, 60);
  for (const char c : {'n', 'N', 'a', 'x', 'd'}) {
    EXPECT_EQ(controls.Press({.kind = Kind::kCharacter, .character = c}), Effect::kNone);
  }
}

TEST(ViewControlsTest, OtherKeysDoNothing) {
  ViewControls controls(kVolume, 60);
  for (const char c : std::string("aZ7 \t\n")) {
    EXPECT_EQ(controls.Press({.kind = Kind::kCharacter, .character = c}), Effect::kNone);
  }
  EXPECT_EQ(controls.Press({.kind = Kind::kCharacter, .character = 'q'}), Effect::kQuit);
  EXPECT_EQ(controls.Press({.kind = Kind::kCharacter, .character = '?'}), Effect::kHelp);
}

TEST(DescribeKeysTest, FitsASmallWindow) {
  for (const absl::string_view line : absl::StrSplit(DescribeKeys(), '\n')) {
    EXPECT_LE(line.size(), 78);
  }
}

}  // namespace
}  // namespace isoscope::cli
