#include "web-gateway/api/film_answer.h"

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "clients/cpp/connection/film_file.h"
#include "core/image/png_codec.h"
#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

constexpr int kWidth = 128;
constexpr int kHeight = 96;
constexpr char kSmall[] = "isovalue=1&width=128&height=96";

// A picture that is of one colour.
v1::RenderIsosurfaceResponse Answer(std::uint8_t red) {
  v1::RenderIsosurfaceResponse response;
  const std::vector<image::Rgba8> pixels(std::size_t{kWidth} * kHeight,
                                         image::Rgba8{red, 0, 0, 255});
  response.set_png(image::EncodePng(kWidth, kHeight, pixels));
  v1::Camera& camera = *response.mutable_camera();
  camera.mutable_eye()->set_z(9);
  camera.mutable_target();
  camera.mutable_up()->set_y(1);
  camera.mutable_perspective()->set_fov_y_degrees(30);
  return response;
}

v1::Dataset MakeDataset() {
  v1::Dataset dataset;
  dataset.set_name("head");
  v1::GridGeometry& geometry = *dataset.mutable_geometry();
  geometry.mutable_sample_dims()->set_x(9);
  geometry.mutable_sample_dims()->set_y(9);
  geometry.mutable_sample_dims()->set_z(9);
  geometry.mutable_spacing()->set_x(1);
  geometry.mutable_spacing()->set_y(1);
  geometry.mutable_spacing()->set_z(1);
  return dataset;
}

FilmQuery Query(const std::string& text) {
  absl::StatusOr<FilmQuery> film =
      FilmQueryFromQuery(ParseTarget(absl::StrCat("/?", text))->query, MakeDataset());
  EXPECT_THAT(film, testing::IsOk()) << text;
  return *std::move(film);
}

// Films whose files are in a folder of the test.
class FilmAnswerTest : public ::testing::Test {
 protected:
  FilmAnswerTest() { setenv("TMPDIR", folder_.path().c_str(), /*replace=*/1); }
  ~FilmAnswerTest() override { unsetenv("TMPDIR"); }

  absl::StatusOr<std::unique_ptr<FilmAnswer>> Begin(
      const std::string& text, client::AnimationFormat format = client::AnimationFormat::kWebp,
      std::int64_t max_disk_bytes = 1 << 20) {
    return FilmAnswer::Begin(format, Query(text), MakeDataset(), "me", max_disk_bytes, &budget_);
  }
  static absl::Status AddNext(FilmAnswer* film, v1::RenderIsosurfaceResponse answer) {
    const absl::StatusOr<v1::RenderIsosurfaceRequest> request = film->NextRequest();
    return request.ok() ? film->Add(*request, std::move(answer)) : request.status();
  }
  [[nodiscard]] bool HasFiles() const { return !std::filesystem::is_empty(folder_.path()); }

  testing::TempDir folder_;
  testing::TempDir other_;
  MeshBudget budget_{/*max_per_caller=*/1, /*max_bytes=*/1 << 20};
};

TEST_F(FilmAnswerTest, AFilmHasTheBytesOfTheCommandLinesWriter) {
  for (const client::AnimationFormat format : client::kAnimationFormats) {
    const std::string suffix(client::NameOf(format));
    const std::string expected_path = other_.Sub("a." + suffix);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto writer, client::CreateFilm(expected_path, Query(kSmall).first, 3, /*fps=*/5));
    HttpResponse response;
    {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          const auto film, Begin(absl::StrCat(kSmall, "&repeat=3&orbit=20&fps=5"), format));
      for (int i = 0; i < 3; ++i) {
        const v1::RenderIsosurfaceResponse answer = Answer(static_cast<std::uint8_t>(20 * i));
        ISOSCOPE_ASSERT_OK(writer->AddFrame(answer.png()));
        EXPECT_FALSE(film->is_complete());
        ISOSCOPE_ASSERT_OK(AddNext(film.get(), answer));
      }
      EXPECT_TRUE(film->is_complete());
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(response, film->Finish());
    }
    ISOSCOPE_ASSERT_OK(writer->Finish());
    EXPECT_EQ(response.content_type, "image/" + suffix);
    EXPECT_EQ(io::ReadWholeFile(response.file_path, 1 << 20).value(),
              io::ReadWholeFile(expected_path, 1 << 20).value());
    EXPECT_FALSE(Begin(kSmall).ok()) << "the answer holds the caller's place";
    response.hold.reset();
    ISOSCOPE_EXPECT_OK(Begin(kSmall));
    RemoveTemporaryFile(response.file_path);
    EXPECT_FALSE(HasFiles());
  }
}

TEST_F(FilmAnswerTest, AFilmThatIsDroppedLeavesNothing) {
  for (const client::AnimationFormat format : client::kAnimationFormats) {
    {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto film,
                                    Begin(absl::StrCat(kSmall, "&repeat=3"), format));
      ISOSCOPE_ASSERT_OK(AddNext(film.get(), Answer(1)));
      EXPECT_TRUE(HasFiles());
    }
    EXPECT_FALSE(HasFiles());
    ISOSCOPE_EXPECT_OK(Begin(kSmall)) << "nor does it hold the place";
  }
}

// Symptom: a colour meant another value in each frame.
TEST_F(FilmAnswerTest, RangesOfWhatIsVisibleAreThoseOfTheFirstFrame) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto film,
      Begin(absl::StrCat(kSmall, "&repeat=3&orbit=20&color-by=z&color-range=visible")));
  v1::RenderIsosurfaceResponse answer = Answer(1);
  for (const double max : {2.0, 3.0}) {
    v1::SurfaceColoring coloring;
    *coloring.mutable_color_by() = film->NextRequest()->surfaces(0).color_by();
    coloring.mutable_color_by()->mutable_range()->set_source(v1::ColorRange::SOURCE_UNSPECIFIED);
    coloring.mutable_color_by()->mutable_range()->set_max(max);
    answer.clear_colorings();
    *answer.add_colorings() = coloring;
    ISOSCOPE_ASSERT_OK(AddNext(film.get(), answer));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceRequest next, film->NextRequest());
    EXPECT_EQ(next.surfaces(0).color_by().range().max(), 2.0);
    EXPECT_NE(next.surfaces(0).color_by().range().source(), v1::ColorRange::SOURCE_VISIBLE);
  }
}

TEST_F(FilmAnswerTest, AFilmMayTakeItsShareOfTheDiskAndNoMore) {
  const auto picture_bytes = static_cast<std::int64_t>(Answer(1).png().size());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto film,
      Begin(absl::StrCat(kSmall, "&repeat=3"), client::AnimationFormat::kApng, 2 * picture_bytes));
  ISOSCOPE_EXPECT_OK(AddNext(film.get(), Answer(1)));
  ISOSCOPE_EXPECT_OK(AddNext(film.get(), Answer(1)));
  EXPECT_THAT(AddNext(film.get(), Answer(1)),
              StatusIs(absl::StatusCode::kResourceExhausted,
                       HasSubstr(absl::StrCat(3 * picture_bytes, " bytes at frame 3 of 3"))));
}

TEST_F(FilmAnswerTest, APictureThatCantBeAddedIsAnError) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto film, Begin(absl::StrCat(kSmall, "&repeat=2")));
  v1::RenderIsosurfaceResponse answer = Answer(1);
  answer.set_png("no PNG");
  EXPECT_THAT(AddNext(film.get(), answer), StatusIs(absl::StatusCode::kDataLoss));
}

TEST_F(FilmAnswerTest, WithoutAFolderForTemporaryFilesItSaysSo) {
  setenv("TMPDIR", (folder_.path() + "/none").c_str(), /*replace=*/1);
  EXPECT_THAT(Begin(kSmall), StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("TMPDIR")));
}

TEST(CheckFilmTest, FilmsAreBoundedByFramesAndPixels) {
  const auto check = [](const std::string& text, client::AnimationFormat format) {
    return CheckFilm(format, Query(text));
  };
  const struct {
    const char* text;
    const char* said;  // null: it is allowed
  } cases[] = {
      {"isovalue=1&width=64&height=64&repeat=720", nullptr},
      {"isovalue=1&width=64&height=64&repeat=721", "721 frames, and the gateway's limit is 720"},
      {"isovalue=0:999999:1&width=64&height=64", "1000000 frames"},
      {"isovalue=1&width=4096&height=2048&repeat=64", nullptr},
      {"isovalue=1&width=4096&height=2048&repeat=65", "545259520 pixels together"},
      {"isovalue=1&width=8192&height=4096", nullptr},
      {"isovalue=1&width=8192&height=4097", "33554432 of one"},
      {"isovalue=1&width=60000&height=60000&region=0,0,64,64&repeat=720", nullptr},
      {"isovalue=1&width=16384&height=64", "16384 x 64 pixels: a WebP has at most 16383"},
      {"isovalue=1&legend", "color-by"},
  };
  for (const auto& c : cases) {
    const absl::Status status = check(c.text, client::AnimationFormat::kWebp);
    if (c.said == nullptr) {
      ISOSCOPE_EXPECT_OK(status) << c.text;
    } else {
      EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(c.said)))
          << c.text;
    }
  }
  ISOSCOPE_EXPECT_OK(check("isovalue=1&width=16384&height=64", client::AnimationFormat::kApng));
}

}  // namespace
}  // namespace isoscope::gateway
