#include "partition-agent/shard/point_gradients.h"

#include <cmath>
#include <filesystem>
#include <map>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/volume/field_gradient.h"
#include "tests/support/block_cutter.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using ::isoscope::testing::SmallDataset;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

const base::Cancellation& Never() {
  static const base::Cancellation* const never = new base::Cancellation();
  return *never;
}

// Points all over the volume, some on faces between blocks; unit spacing, so world is index space.
std::vector<math::Vec3d> MakePoints() {
  std::vector<math::Vec3d> points;
  for (std::uint64_t i = 0; i < 300; ++i) {
    math::Vec3d point{40 * base::RandomUnit(1, i), 36 * base::RandomUnit(2, i),
                      32 * base::RandomUnit(3, i)};
    if (i % 4 == 0) {
      point.y = 8 * std::floor(point.y / 8);
    }
    points.push_back(point);
  }
  points.push_back({40, 36, 32});
  return points;
}

TEST(PointGradientsTest, EachPointIsAnsweredByOneShardHoweverManyThereAre) {
  const std::vector<math::Vec3d> points = MakePoints();
  std::vector<PointGradient> one_shard_gradients;
  for (const int shard_count : {1, 3}) {
    const SmallDataset dataset(shard_count);
    std::map<std::size_t, PointGradient> answers;
    for (const std::shared_ptr<const Shard>& shard : dataset.OpenShards()) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<PointGradient> part,
                                    GradientsAt({shard}, points, Never()));
      for (const PointGradient& gradient : part) {
        EXPECT_TRUE(answers.try_emplace(gradient.point_index, gradient).second);
      }
    }
    ASSERT_EQ(answers.size(), points.size());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<PointGradient> together,
                                  GradientsAt(dataset.OpenShards(), points, Never()));
    for (std::size_t i = 0; i < points.size(); ++i) {
      EXPECT_EQ(together[i], answers.at(i));
    }
    if (one_shard_gradients.empty()) {
      one_shard_gradients = together;
    }
    EXPECT_EQ(together, one_shard_gradients);
  }
  const SmallDataset dataset(1);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const volume::BlockLayout layout = dataset.layout();
    const volume::BlockId id = volume::BlockOfCell(layout, volume::CellAt(layout, points[i]));
    const std::string block =
        isoscope::testing::CutBlock(layout, volume::ScalarType::kUint8, dataset.samples(), id);
    EXPECT_EQ(one_shard_gradients[i].gradient,
              volume::GradientAt(dataset.geometry(), layout,
                                 {id, volume::ScalarType::kUint8, block.data()}, points[i]));
  }
}

// The same differences as the normals of the mesh, but for their length.
TEST(PointGradientsTest, GradientsAtVerticesAreOppositeToTheirNormals) {
  const SmallDataset dataset(1);
  std::vector<math::Vec3d> points;
  std::vector<math::Vec3f> normals;
  for (const mesh::BlockMesh& mesh : isoscope::testing::ExtractAllBlocks(
           dataset.geometry(), dataset.layout(), volume::ScalarType::kUint8, dataset.samples(),
           SmallDataset::kIsovalue)) {
    for (std::size_t i = 0; i < mesh.positions.size(); i += 37) {
      const math::Vec3f& p = mesh.positions[i];
      points.push_back({double{p.x}, double{p.y}, double{p.z}});
      normals.push_back(mesh.normals[i]);
    }
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<PointGradient> gradients,
                                GradientsAt(dataset.OpenShards(), points, Never()));
  ASSERT_EQ(gradients.size(), points.size());
  ASSERT_GT(points.size(), 100U);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const math::Vec3d unit = math::Normalized(gradients[i].gradient);
    const math::Vec3d normal{double{normals[i].x}, double{normals[i].y}, double{normals[i].z}};
    EXPECT_NEAR(math::Length(unit + normal), 0, 1e-5) << i;
  }
}

TEST(PointShardsTest, EachBlockIsInTheShardThatHoldsItWhereverThePointLies) {
  const SmallDataset dataset(3);
  const Shards shards = dataset.OpenShards();
  std::map<volume::BlockId, int> expected;
  for (const std::shared_ptr<const Shard>& shard : shards) {
    for (std::uint32_t i = 0; i < shard->reader->block_count(); ++i) {
      expected[shard->reader->block_id(i)] = shard->reader->shard_index();
    }
  }
  // Every block twice, interleaved with points without a block.
  std::vector<std::optional<volume::BlockId>> block_ids;
  for (const auto& [block, shard] : expected) {
    block_ids.insert(block_ids.end(), {block, std::nullopt, block});
  }
  const std::vector<PointShard> found = ShardsOf(shards, block_ids);
  ASSERT_EQ(found.size(), 2 * expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_EQ(found[i].point_index, 3 * (i / 2) + 2 * (i % 2));
    EXPECT_EQ(found[i].shard_index, expected.at(*block_ids[found[i].point_index]));
  }
  EXPECT_TRUE(ShardsOf(shards, {}).empty());
}

TEST(PointGradientsTest, DamageIsDataLossAndACancelledQuestionEnds) {
  const SmallDataset dataset(1);
  const std::string blocks = dataset.shard_directory(0) + "/" + store::kBlocksFileName;
  const Shards shards = dataset.OpenShards();
  isoscope::testing::FlipBit(blocks,
                             static_cast<std::int64_t>(std::filesystem::file_size(blocks) / 2));
  EXPECT_THAT(GradientsAt(shards, MakePoints(), Never()),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("block ")));
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(GradientsAt(shards, {{1, 2, 3}}, cancelled), StatusIs(absl::StatusCode::kCancelled));
}

}  // namespace
}  // namespace isoscope::agent
