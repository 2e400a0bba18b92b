#include "clients/cpp/connection/like_picture.h"

#include <algorithm>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/sha256.h"
#include "core/cli/usage.h"
#include "core/image/png_codec.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;
namespace v1 = isoscope::v1;

std::string PngOf(const std::vector<image::Rgba8>& pixels) {
  return image::EncodePng(static_cast<int>(pixels.size()) / 2, 2, pixels);
}

RecordedPng Recorded(const std::vector<image::Rgba8>& pixels) {
  RecordedPng recorded;
  recorded.record.picture_revision = "2 cpu";
  recorded.plain_png = PngOf(pixels);
  return recorded;
}

std::vector<image::Rgba8> Pixels() { return std::vector<image::Rgba8>(8, {10, 20, 30, 255}); }

TEST(LikePictureTest, DifferentPixelsAreCountedWithTheLargestDifference) {
  const RecordedPng recorded = Recorded(Pixels());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(PictureComparison same, ComparePictures(recorded, PngOf(Pixels())));
  EXPECT_TRUE(same.has_same_bytes);
  EXPECT_EQ(same.different_count, 0);
  EXPECT_EQ(same.compared_count, 8);
  std::vector<image::Rgba8> changed = Pixels();
  changed[0].r = 17;
  changed[7].b = 0;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(PictureComparison other, ComparePictures(recorded, PngOf(changed)));
  EXPECT_FALSE(other.has_same_bytes);
  EXPECT_EQ(other.different_count, 2);
  EXPECT_EQ(other.largest_difference, 30);
}

TEST(LikePictureTest, AnnotatedPictureIsComparedBesideItsAnnotations) {
  std::vector<image::Rgba8> annotated = Pixels();
  annotated[1] = {255, 255, 255, 255};  // pixel (1, 0)
  RecordedPng recorded = Recorded(annotated);
  recorded.record.annotated =
      AnnotatedPicture{.plain_png_sha256 = base::Sha256Hex(PngOf(Pixels())),
                       .boxes = {{.begin_x = 1, .begin_y = 0, .end_x = 2, .end_y = 1},
                                 {.begin_x = 100, .begin_y = 100, .end_x = 200, .end_y = 200}}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(PictureComparison same, ComparePictures(recorded, PngOf(Pixels())));
  EXPECT_TRUE(same.has_same_bytes);
  EXPECT_EQ(same.different_count, 0);
  EXPECT_EQ(same.compared_count, 7);
  std::vector<image::Rgba8> changed = Pixels();
  changed[2].g = 0;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(PictureComparison other, ComparePictures(recorded, PngOf(changed)));
  EXPECT_FALSE(other.has_same_bytes);
  EXPECT_EQ(other.different_count, 1);
}

TEST(LikePictureTest, PictureThatWasScaledIsRefused) {
  const std::vector<image::Rgba8> small(4, image::Rgba8{1, 1, 1, 255});
  EXPECT_THAT(ComparePictures(Recorded(small), PngOf(Pixels())),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("2 x 2")));
}

TEST(LikePictureTest, EverySentenceFitsItsCase) {
  const auto describe = [](const PictureComparison& comparison, const std::string& revision) {
    return DescribeComparison(comparison, "a.png", "2 cpu", revision);
  };
  EXPECT_EQ(describe({.has_same_bytes = true, .compared_count = 8}, "2 cpu").value(),
            "byte for byte the picture of 'a.png'");
  EXPECT_THAT(describe({.compared_count = 8}, "2 cpu").value(), HasSubstr("encoded otherwise"));
  EXPECT_THAT(describe({.compared_count = 8}, "4 cpu").value(), HasSubstr("this is '4 cpu'"));
  const PictureComparison different{
      .different_count = 1234, .compared_count = 5000, .largest_difference = 9};
  EXPECT_THAT(describe(different, "4 cpu").value(),
              HasSubstr("1,234 of 5,000 pixels differ from 'a.png', by at most 9 of 255"));
  EXPECT_THAT(describe(different, "2 cpu"),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("1,234 of 5,000")));
  // The bytes of the plain picture are right, but pixels beside the annotations were changed.
  EXPECT_FALSE(
      describe({.has_same_bytes = true, .different_count = 1, .compared_count = 8}, "2 cpu").ok());
}

TEST(LikePictureTest, OtherOrUnknownSamplesAreAnError) {
  PictureRecord record;
  record.samples_digest = std::string(32, 'a');
  v1::Dataset dataset;
  dataset.set_name("head");
  EXPECT_THAT(CheckSameSamples(record, dataset),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("partition the volume")));
  dataset.set_samples_digest(std::string(32, 'b'));
  EXPECT_THAT(CheckSameSamples(record, dataset),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("other samples")));
  dataset.set_samples_digest(record.samples_digest);
  ISOSCOPE_EXPECT_OK(CheckSameSamples(record, dataset));
  record.samples_digest = "";
  EXPECT_THAT(CheckSameSamples(record, dataset), StatusIs(absl::StatusCode::kFailedPrecondition));
}

TEST(LikePictureTest, RevisionIsThatOfAReachableAgentOfTheDataset) {
  v1::Dataset dataset;
  dataset.set_dataset_id("id");
  v1::GetClusterStatusResponse cluster;
  EXPECT_EQ(PictureRevisionOf(cluster, dataset), "");
  const auto add = [&](v1::AgentStatus::State state, const char* id, const char* revision) {
    v1::AgentStatus* agent = cluster.add_agents();
    agent->set_state(state);
    agent->set_picture_revision(revision);
    agent->add_shards()->set_dataset_id(id);
  };
  add(v1::AgentStatus::STATE_UNREACHABLE, "id", "1 cpu");
  add(v1::AgentStatus::STATE_REACHABLE, "other", "7 cpu");
  add(v1::AgentStatus::STATE_REACHABLE, "id", "2 cpu");
  EXPECT_EQ(PictureRevisionOf(cluster, dataset), "2 cpu");
}

}  // namespace
}  // namespace isoscope::client
