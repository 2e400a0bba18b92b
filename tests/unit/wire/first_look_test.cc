#include "wire/first_look.h"

#include <numbers>

#include "gtest/gtest.h"

#include "core/view/camera_fit.h"

namespace isoscope::wire {
namespace {

namespace v1 = isoscope::v1;

TEST(FirstLookTest, TheTableHasValuesThatTheServerTakes) {
  const v1::FirstLook& look = GetFirstLook();
  EXPECT_EQ(look.samples(), 4);
  EXPECT_GT(look.azimuth_degrees(), 0);
  EXPECT_GT(look.elevation_degrees(), 0);
  EXPECT_LT(look.elevation_degrees(), 90);
  EXPECT_GE(look.shininess(), 1);
  // With the default ambient share of Material: what faces the eye keeps its colour.
  EXPECT_NEAR(0.12F + look.diffuse() + look.specular(), 1.0F, 1e-6F);
}

TEST(FirstLookTest, TheCameraIsTheTurnedDefaultOneOrThePatientsFront) {
  const math::Box3d bounds{.min = {0, 0, 0}, .max = {1, 2, 3}};
  const double degree = std::numbers::pi / 180;
  view::Camera turned = view::MakeDefaultCamera(bounds);
  view::Azimuth(GetFirstLook().azimuth_degrees() * degree, &turned);
  view::Elevation(GetFirstLook().elevation_degrees() * degree, &turned);
  view::OrthogonalizeUp(&turned);
  EXPECT_EQ(FirstLookCamera(bounds, std::nullopt), turned);
  EXPECT_EQ(
      FirstLookCamera(bounds, volume::PatientFrame()),
      view::MakeNamedCamera(view::NamedView::kAnterior, bounds, volume::PatientFrame()).value());
}

TEST(FirstLookTest, SurfacesKeepTheMaterialThatTheyHave) {
  v1::RenderIsosurfaceRequest request;
  request.add_surfaces()->set_isovalue(1);
  request.add_surfaces()->mutable_material()->set_specular(0.5F);
  AddFirstMaterial(&request);
  EXPECT_EQ(request.surfaces(0).material().diffuse(), GetFirstLook().diffuse());
  EXPECT_EQ(request.surfaces(0).material().specular(), GetFirstLook().specular());
  EXPECT_EQ(request.surfaces(0).material().shininess(), GetFirstLook().shininess());
  EXPECT_FALSE(request.surfaces(1).material().has_diffuse());
  EXPECT_EQ(request.surfaces(1).material().specular(), 0.5F);
}

}  // namespace
}  // namespace isoscope::wire
