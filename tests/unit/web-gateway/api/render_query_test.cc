#include "web-gateway/api/render_query.h"

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::gateway {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::IsOk;
using ::testing::Not;
using testing::StatusIs;
namespace v1 = isoscope::v1;

v1::Dataset MakeDataset() {
  v1::Dataset dataset;
  dataset.set_name("head");
  v1::GridGeometry* const geometry = dataset.mutable_geometry();
  geometry->mutable_sample_dims()->set_x(11);
  geometry->mutable_sample_dims()->set_y(11);
  geometry->mutable_sample_dims()->set_z(11);
  geometry->mutable_spacing()->set_x(1);
  geometry->mutable_spacing()->set_y(1);
  geometry->mutable_spacing()->set_z(1);
  return dataset;
}

v1::Dataset MakeSeries() {
  v1::Dataset dataset = MakeDataset();
  dataset.add_fields()->set_name("pressure");
  return dataset;
}

// The request of a query.
absl::StatusOr<v1::RenderIsosurfaceRequest> ParseFor(const std::string& query,
                                                     const v1::Dataset& dataset) {
  const absl::StatusOr<Target> target = ParseTarget(absl::StrCat("/?", query));
  EXPECT_THAT(target, IsOk());
  absl::StatusOr<PictureQuery> picture = PictureQueryFromQuery(target->query, dataset);
  if (!picture.ok()) {
    return picture.status();
  }
  return std::move(picture->request);
}

absl::StatusOr<v1::RenderIsosurfaceRequest> Parse(const std::string& query) {
  return ParseFor(query, MakeDataset());
}

TEST(RenderQueryTest, ParametersAreTheFlagsOfTheCommandLine) {
  const absl::StatusOr<v1::RenderIsosurfaceRequest> request = Parse(
      "isovalue=60&width=640&height=480&azimuth=30&elevation=-10&zoom=2&fit=surface&"
      "background=1,1,1&samples=4&clip_plane=0,0,1,2&clip-plane=1,0,0,-3&clip-box=0,5,0,5,0,5&"
      "color-by=z:turbo&light=1,1,1:2&ambient-occlusion=&silhouette=3:1,0,0&max_layers=4&"
      "culling=none&region=1,2,30,40&max-spacing=1.1");
  ASSERT_THAT(request, IsOk());
  EXPECT_EQ(request->dataset(), "head");
  EXPECT_EQ(request->surfaces(0).isovalue(), 60);  // color-by needs a surface
  EXPECT_EQ(request->viewport().width_px(), 640);
  EXPECT_EQ(request->viewport().height_px(), 480);
  EXPECT_EQ(request->camera_fit(), v1::CAMERA_FIT_SURFACE);
  EXPECT_EQ(request->background_color().red(), 1);
  EXPECT_EQ(request->samples(), 4);
  EXPECT_EQ(request->clip().half_spaces_size(), 2);
  EXPECT_TRUE(request->clip().has_box());
  EXPECT_EQ(request->lights_size(), 1);
  EXPECT_TRUE(request->has_ambient_occlusion());
  EXPECT_EQ(request->silhouette().width_px(), 3);
  EXPECT_EQ(request->max_layers(), 4);
  EXPECT_EQ(request->culling(), v1::CULLING_NONE);
  EXPECT_EQ(request->region().width_px(), 30);
  EXPECT_EQ(request->level().max_spacing_px(), 1.1);
  EXPECT_NE(request->camera().eye().x(), 5);  // turned
  EXPECT_FALSE(request->has_output());
}

// Symptom: the command lost its dashes, and failed when it was typed.
TEST(RenderQueryTest, CommandsInErrorsKeepTheirDashesAndParametersHaveNone) {
  EXPECT_THAT(Parse("width=64"),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("`isoscope info INPUT --histogram`"),
                             HasSubstr("isovalue V is missing"), Not(HasSubstr("--isovalue")))));
}

TEST(RenderQueryTest, LongValuesAreCutInErrors) {
  for (const char* name : {"culling", "samples", "fit", "format", "caps", "light-space"}) {
    const absl::StatusOr<v1::RenderIsosurfaceRequest> request =
        Parse(absl::StrCat("isovalue=1&", name, "=", std::string(12000, 'Z')));
    EXPECT_FALSE(request.ok()) << name;
    EXPECT_LT(request.status().message().size(), 1000U) << name;
  }
}

TEST(RenderQueryTest, SurfacesAreInTheOrderOfTheAddress) {
  const absl::StatusOr<v1::RenderIsosurfaceRequest> request =
      Parse("surface=60:1,0,0:0.5&surface=30&format=jpeg&quality=80");
  ASSERT_THAT(request, IsOk());
  ASSERT_EQ(request->surfaces_size(), 2);
  EXPECT_EQ(request->surfaces(0).isovalue(), 60);
  EXPECT_EQ(request->surfaces(0).color().alpha(), 0.5F);
  EXPECT_EQ(request->surfaces(1).isovalue(), 30);
  EXPECT_EQ(request->output().image_format(), v1::OutputOptions::IMAGE_FORMAT_JPEG);
  EXPECT_EQ(request->output().jpeg_quality(), 80);
}

v1::Dataset MakeSegmentation() {
  v1::Dataset dataset = MakeDataset();
  for (const auto& [value, name] : {std::pair{0, "air"}, {3, "left lung"}, {7, "liver"}}) {
    v1::Label* const label = dataset.add_labels();
    label->set_value(value);
    label->set_name(name);
  }
  dataset.mutable_labels(1)->mutable_color()->set_green(1);
  return dataset;
}

absl::StatusOr<v1::RenderIsosurfaceRequest> ParseLabels(const std::string& query) {
  return ParseFor(query, MakeSegmentation());
}

TEST(RenderQueryTest, LabelsAreSurfacesByTheNamesOfTheDataset) {
  const auto all = ParseLabels("labels=all&width=8");
  ASSERT_THAT(all, IsOk());
  ASSERT_EQ(all->surfaces_size(), 2);  // not the air, whose value is 0
  EXPECT_THAT(all->surfaces(0).labels(), ElementsAre(3));
  EXPECT_EQ(all->surfaces(0).color().green(), 1);
  EXPECT_EQ(all->surfaces(0).color().red(), 0);
  EXPECT_THAT(all->surfaces(1).labels(), ElementsAre(7));
  const auto sets = ParseLabels("isovalue=60&label=Left%20Lung::0.5&label=3,5-6,liver:red");
  ASSERT_THAT(sets, IsOk());
  ASSERT_EQ(sets->surfaces_size(), 3);
  EXPECT_EQ(sets->surfaces(0).isovalue(), 60);
  EXPECT_THAT(sets->surfaces(1).labels(), ElementsAre(3));
  EXPECT_EQ(sets->surfaces(1).color().alpha(), 0.5F);
  EXPECT_EQ(sets->surfaces(1).color().green(), 1);
  EXPECT_THAT(sets->surfaces(2).labels(), ElementsAre(3, 5, 6, 7));
  EXPECT_EQ(sets->surfaces(2).color().red(), 1);
}

TEST(RenderQueryTest, SmoothLabelsAreASwitchWithOrWithoutAValue) {
  for (const char* const text : {"smooth-labels=", "smooth_labels=true", "smooth-labels=1"}) {
    const auto request = ParseLabels(absl::StrCat("isovalue=60&labels=all&", text));
    ASSERT_THAT(request, IsOk()) << text;
    EXPECT_FALSE(request->surfaces(0).smooth_labels());
    EXPECT_TRUE(request->surfaces(1).smooth_labels());
    EXPECT_TRUE(request->surfaces(2).smooth_labels());
    const auto mesh = MeshQueryFromQuery(client::MeshFormat::kGlb,
                                         ParseTarget(absl::StrCat("/?label=liver&", text))->query,
                                         MakeSegmentation());
    ASSERT_THAT(mesh.status(), IsOk()) << text;
    EXPECT_TRUE(mesh->request.surfaces(0).smooth_labels());
  }
  EXPECT_FALSE(ParseLabels("labels=all")->surfaces(0).smooth_labels());
}

TEST(RenderQueryTest, WrongLabelsAreNamedInTheWordsOfAnAddress) {
  const auto expect = [](const absl::StatusOr<v1::RenderIsosurfaceRequest>& request,
                         const std::string& said) {
    EXPECT_THAT(request.status(), StatusIs(absl::StatusCode::kInvalidArgument,
                                           AllOf(HasSubstr(said), Not(HasSubstr("--label")))));
  };
  expect(ParseLabels("label=livr"), "did you mean 'liver'?");
  expect(ParseLabels("labels=3,7"), "'3,7' is not all; label 3,7 draws the surface of a set");
  expect(ParseLabels("labels=all&label=3"), "leave label out");
  expect(Parse("labels=all"), "a gateway does not list them: give label with values");
  expect(Parse("label=liver"), "dataset 'head' has no names of labels");
  expect(ParseLabels("isovalue=60&smooth-labels="), "smooth-labels smooths surfaces of labels");
}

TEST(RenderQueryTest, FieldTimeAndColorByAFieldAreThoseOfTheCommandLine) {
  const auto parse = [](const std::string& query) {
    return ParseFor(absl::StrCat("isovalue=1&", query), MakeSeries());
  };
  const auto frame = parse("field=velocity:x&time=0.25&color_by=temperature:magma:1,2");
  ASSERT_THAT(frame, IsOk());
  EXPECT_EQ(frame->selection().ShortDebugString(), "field: \"velocity:x\" time: 0.25");
  EXPECT_EQ(frame->surfaces(0).color_by().ShortDebugString(),
            "quantity: QUANTITY_FIELD color_map: COLOR_MAP_MAGMA range { min: 1 max: 2 } field: "
            "\"temperature\"");
  EXPECT_EQ(parse("component=y&step=last")->selection().ShortDebugString(),
            "component: \"y\" time_step: -1");
  EXPECT_FALSE(parse("width=8")->has_selection());
  const auto missing = parse("color_by=temperature&nan-color=teal");
  ASSERT_THAT(missing, IsOk());
  EXPECT_EQ(missing->nan_color().alpha(), 1);
  EXPECT_EQ(missing->nan_color().red(), 0);
  EXPECT_FALSE(frame->has_nan_color());
}

TEST(RenderQueryTest, AHistogramHasBinsAndASelection) {
  const auto request = HistogramRequestFromQuery(
      {{"bins", "8"}, {"field", "velocity"}, {"step", "3"}}, MakeSeries());
  ASSERT_THAT(request, IsOk());
  EXPECT_EQ(request->ShortDebugString(),
            "dataset: \"head\" max_bin_count: 8 selection { field: \"velocity\" time_step: 3 }");
  const auto plain = HistogramRequestFromQuery({}, MakeDataset());
  ASSERT_THAT(plain, IsOk());
  EXPECT_FALSE(plain->has_selection());
  for (const QueryParameters& wrong :
       {QueryParameters{{"bins", "0"}}, QueryParameters{{"bins", "4097"}},
        QueryParameters{{"bins", "x"}}, QueryParameters{{"isovalue", "1"}},
        QueryParameters{{"time", "1"}, {"step", "3"}}}) {
    EXPECT_THAT(HistogramRequestFromQuery(wrong, MakeSeries()).status(),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(wrong[0].first)));
  }
}

TEST(RenderQueryTest, SwitchesNeedNoValue) {
  const auto extras_of = [](const std::string& query) {
    return PictureQueryFromQuery(ParseTarget(absl::StrCat("/?isovalue=1&", query))->query,
                                 MakeDataset());
  };
  const auto drawn = extras_of("axes&scale_bar=true&legend=false&caption=a+b&record=");
  ASSERT_THAT(drawn, IsOk());
  EXPECT_TRUE(drawn->extras.annotations.has_axes);
  EXPECT_TRUE(drawn->extras.annotations.has_scale_bar);
  EXPECT_FALSE(drawn->extras.annotations.has_legend);
  EXPECT_EQ(drawn->extras.annotations.caption, "a b");
  EXPECT_TRUE(drawn->extras.has_record);
  EXPECT_FALSE(extras_of("")->extras.any());
  EXPECT_THAT(extras_of("caption=").status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("caption has no value")));
  EXPECT_THAT(extras_of("axes=perhaps").status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("axes")));
}

TEST(RenderQueryTest, APostedRequestHasTheExtrasAlone) {
  EXPECT_TRUE(ExtrasFromQuery({{"axes", ""}})->annotations.has_axes);
  EXPECT_THAT(ExtrasFromQuery({{"width", "8"}}).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no parameter 'width'")));
}

TEST(RenderQueryTest, DepthIsAPlaneWithoutAPicture) {
  const absl::StatusOr<v1::RenderIsosurfaceRequest> request = Parse("isovalue=60&format=depth");
  ASSERT_THAT(request, IsOk());
  EXPECT_EQ(request->output().image_format(), v1::OutputOptions::IMAGE_FORMAT_NONE);
  EXPECT_TRUE(request->output().depth());
}

// The coordinator knows no WebP: the gateway makes it of the PNG.
TEST(RenderQueryTest, AWebpAsksForThePngOfTheSamePicture) {
  const absl::StatusOr<PictureQuery> webp =
      PictureQueryFromQuery({{"isovalue", "60"}, {"format", "webp"}}, MakeDataset());
  const absl::StatusOr<PictureQuery> png =
      PictureQueryFromQuery({{"isovalue", "60"}}, MakeDataset());
  ASSERT_THAT(webp, IsOk());
  ASSERT_THAT(png, IsOk());
  EXPECT_TRUE(webp->extras.is_webp);
  EXPECT_FALSE(png->extras.is_webp);
  EXPECT_EQ(webp->request.SerializeAsString(), png->request.SerializeAsString());
}

v1::Dataset MakeSteps() {
  v1::Dataset dataset = MakeSeries();
  for (const int number : {0, 1, 2, 5}) {
    dataset.add_time_steps()->set_number(number);
  }
  return dataset;
}

absl::StatusOr<FilmQuery> ParseFilm(const std::string& query) {
  const absl::StatusOr<Target> target = ParseTarget(absl::StrCat("/?", query));
  EXPECT_THAT(target, IsOk());
  return FilmQueryFromQuery(target->query, MakeSteps());
}

TEST(RenderQueryTest, AFilmBeginsWithThePictureOfTheSameParameters) {
  const std::string same = "width=64&height=48&azimuth=30&color-by=z&samples=4&fit=surface";
  const absl::StatusOr<FilmQuery> film =
      ParseFilm(absl::StrCat(same, "&isovalue=60:80:10&orbit=5&fps=2.5&axes&caption=a"));
  ASSERT_THAT(film, IsOk());
  const absl::StatusOr<v1::RenderIsosurfaceRequest> picture =
      ParseFor(absl::StrCat(same, "&isovalue=60"), MakeSteps());
  ASSERT_THAT(picture, IsOk());
  EXPECT_EQ(film->first.SerializeAsString(), picture->SerializeAsString());
  EXPECT_EQ(film->sweep.frame_count(), 3);
  EXPECT_EQ(film->sweep.fps(), 2.5);
  EXPECT_TRUE(film->annotations.has_axes);
  EXPECT_EQ(film->annotations.caption, "a");
}

TEST(RenderQueryTest, AFilmOfStepsHasThoseThatAreServedAndTellsTheirTimes) {
  const absl::StatusOr<FilmQuery> film = ParseFilm("isovalue=60&step=1:last:2");
  ASSERT_THAT(film, IsOk());
  EXPECT_THAT(film->sweep.steps, ElementsAre(1, 5));
  EXPECT_EQ(film->first.selection().time_step(), 1);
  EXPECT_EQ(film->annotations.caption, "{time}");
  EXPECT_EQ(ParseFilm("isovalue=60&step=0:2&caption=t")->annotations.caption, "t");
  EXPECT_FALSE(ParseFilm("isovalue=60&step=2&repeat=3")->annotations.caption.has_value());
}

TEST(RenderQueryTest, WrongFilmsSayWhy) {
  const struct {
    std::string query;
    std::string said;
  } cases[] = {{"repeat=3", "isovalue V is missing"},
               {"isovalue=1:3", "START:STOP:STEP"},
               {"isovalue=1:3:1&repeat=2", "repeat can't be used"},
               {"isovalue=1&orbit=5", "it needs repeat N"},
               {"isovalue=1&step=0:2&repeat=2", "leave repeat out"},
               {"isovalue=1&step=0:2&time=1", "time and step exclude"},
               {"isovalue=1&step=3:4", "step names no step that is served"},
               {"isovalue=1&fps=0", "0.1 to 120"},
               {"isovalue=1&format=png", "no parameter 'format'"},
               {"isovalue=1&record", "no parameter 'record'"}};
  for (const auto& c : cases) {
    EXPECT_THAT(ParseFilm(c.query).status(),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(c.said)))
        << c.query;
  }
}

TEST(RenderQueryTest, WrongParametersAreNamedWithWhatIsAllowed) {
  const struct {
    std::string query;
    std::vector<std::string> said;
  } cases[] = {
      {"", {"isovalue", "missing"}},
      {"isovalue=abc", {"isovalue", "'abc'", "finite number"}},
      {"isovalue=nan", {"isovalue", "'nan'"}},
      {"isovalue=", {"isovalue", "no value"}},
      {"isovalue=1&isovalue=2", {"isovalue", "2 times"}},
      {"clip-plane=1&isovalue=1", {"clip-plane", "'1'"}},
      {"isovalue=60&width=0", {"width", "'0'", "1 to 65536"}},
      {"isovalue=60&width=65537", {"width", "65537"}},
      {"isovalue=60&height=-1", {"height", "'-1'"}},
      {"isovalue=60&azimuth=x", {"azimuth"}},
      {"isovalue=60&zoom=0", {"zoom", "above 0"}},
      {"isovalue=60&view=side", {"view", "'side'", "front"}},
      {"isovalue=60&view=anterior", {"patient"}},
      {"isovalue=60&fit=all", {"fit", "surface"}},
      {"isovalue=60&eye=1,2,3&azimuth=3", {"eye", "azimuth"}},
      {"isovalue=60&format=gif", {"format", "'gif'", "png, jpeg, webp, depth"}},
      {"isovalue=60&format=jpeg&quality=0", {"quality", "1 to 100"}},
      {"isovalue=60&quality=90", {"quality", "format=jpeg"}},
      {"isovalue=60&samples=5", {"samples", "1, 4, 9, 16"}},
      {"isovalue=60&surface=70", {"surface", "isovalue"}},
      {"isovalue=60&level=24", {"level", "'24'", "0 to 23"}},
      {"isovalue=60&max-spacing=0", {"max-spacing", "'0'", "above 0"}},
      {"isovalue=60&level=1&max-spacing=2", {"level and max-spacing exclude each other"}},
      {"isovalue=60&background=2,0,0", {"background"}},
      {"isovalu=60", {"'isovalu'", "did you mean 'isovalue'"}},
      {"isovalue=60&help=1", {"'help'"}},
      {"isovalue=60&=1", {"''"}},
      {"isovalue=60&--width=5", {"'--width'"}},
      {"isovalue=60&output=x.png", {"'output'"}},
      {"isovalue=60&field=", {"field", "no value"}},
      {"isovalue=60&field=velocity:", {"field", "'velocity:'", "NAME:COMPONENT"}},
      {"isovalue=60&step=-1", {"step", "'-1'", "first or last"}},
      {"isovalue=60&step=1:9:2", {"step", "'1:9:2'"}},
      {"isovalue=60&time=now", {"time", "'now'"}},
      {"isovalue=60&time=1&step=2", {"time and step exclude each other"}},
      {"isovalue=60&nan-color=red", {"nan-color is the colour of missing samples", "color-by"}},
      {"isovalue=60&color-by=hue", {"color-by", "'hue'", "gradient", "no other fields"}},
  };
  for (const auto& c : cases) {
    const absl::Status status = Parse(c.query).status();
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument)) << c.query;
    for (const std::string& said : c.said) {
      EXPECT_THAT(std::string(status.message()), HasSubstr(said)) << c.query;
    }
    if (c.query.find("--") == std::string::npos && !absl::StrContains(status.message(), '`')) {
      EXPECT_THAT(std::string(status.message()), Not(HasSubstr("--"))) << c.query;
    }
  }
}

TEST(RenderQueryTest, NoParameterReadsOrWritesAFileOfTheGateway) {
  for (const char* name : {"camera", "save-camera", "save_camera", "like", "output", "depth",
                           "normal", "stats", "config"}) {
    EXPECT_THAT(Parse(absl::StrCat("isovalue=60&", name, "=/tmp/x")).status(),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no parameter")))
        << name;
  }
}

TEST(RenderQueryTest, MeshesHaveSurfacesAndAClip) {
  constexpr client::MeshFormat kGlb = client::MeshFormat::kGlb;
  const absl::StatusOr<MeshQuery> one =
      MeshQueryFromQuery(kGlb, {{"isovalue", "60"}, {"clip_box", "0,1,0,1,0,1"}}, MakeDataset());
  ASSERT_THAT(one, IsOk());
  EXPECT_EQ(one->request.dataset(), "head");
  EXPECT_EQ(one->request.isovalue(), 60);
  EXPECT_TRUE(one->request.clip().has_box());
  ASSERT_EQ(one->surfaces.size(), 1U);
  EXPECT_EQ(one->request.level(), 0);
  const absl::StatusOr<MeshQuery> coarse =
      MeshQueryFromQuery(kGlb, {{"isovalue", "60"}, {"level", "2"}}, MakeDataset());
  ASSERT_THAT(coarse, IsOk());
  EXPECT_EQ(coarse->request.level(), 2);
  const absl::StatusOr<MeshQuery> two =
      MeshQueryFromQuery(kGlb, {{"surface", "60:1,0,0:0.5"}, {"surface", "30"}}, MakeDataset());
  ASSERT_THAT(two, IsOk());
  EXPECT_EQ(two->request.surfaces_size(), 2);
  EXPECT_EQ(two->surfaces[0].color->alpha, 1);
  const absl::StatusOr<MeshQuery> step_query = MeshQueryFromQuery(
      kGlb, {{"isovalue", "1"}, {"field", "velocity:z"}, {"step", "2"}}, MakeSeries());
  ASSERT_THAT(step_query, IsOk());
  EXPECT_EQ(step_query->request.selection().ShortDebugString(),
            "field: \"velocity:z\" time_step: 2");
  for (const QueryParameters& wrong :
       {QueryParameters{}, QueryParameters{{"isovalue", "1"}, {"time", "2"}, {"step", "2"}},
        QueryParameters{{"isovalue", "1"}, {"surface", "2"}},
        QueryParameters{{"isovalue", "1"}, {"width", "2"}}}) {
    EXPECT_THAT(MeshQueryFromQuery(kGlb, wrong, MakeDataset()).status(),
                StatusIs(absl::StatusCode::kInvalidArgument));
  }
}

TEST(RenderQueryTest, AnStlHasNoColorsAndLabelsDoNotBringTheirs) {
  constexpr client::MeshFormat kStl = client::MeshFormat::kStl;
  const absl::StatusOr<MeshQuery> labels =
      MeshQueryFromQuery(kStl, {{"label", "1"}}, MakeSegmentation());
  ASSERT_THAT(labels, IsOk());
  EXPECT_FALSE(labels->surfaces[0].color.has_value());
  EXPECT_TRUE(MeshQueryFromQuery(client::MeshFormat::kPly, {{"label", "1"}}, MakeSegmentation())
                  ->surfaces[0]
                  .color.has_value());
  EXPECT_THAT(MeshQueryFromQuery(kStl, {{"isovalue", "1"}, {"color", "teal"}}, MakeDataset()),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("STL")));
}

}  // namespace
}  // namespace isoscope::gateway
