#include "partition-agent/supply/point_values.h"

#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <string>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/extract/block_extractor.h"
#include "core/volume/field_gradient.h"
#include "tests/support/block_cutter.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/partition-agent/small_dataset.h"

namespace isoscope::agent {
namespace {

using ::testing::HasSubstr;
using testing::SmallDataset;
using testing::StatusIs;
using volume::ScalarType;

double Linear(const math::Vec3d& p) { return 3 + p.x - 2 * p.y + 0.25 * p.z; }

// The gyroid of a SmallDataset, and two other fields on its grid.
class Fields {
 public:
  explicit Fields(int shard_count) : drawn(shard_count), shards(drawn.OpenShards()) {
    const math::Index3& dims = drawn.geometry().sample_dims;
    for (std::int64_t z = 0; z < dims.z; ++z) {
      for (std::int64_t y = 0; y < dims.y; ++y) {
        for (std::int64_t x = 0; x < dims.x; ++x) {
          base::AppendLittleEndian(
              Linear({static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)}),
              &linear);
        }
      }
    }
    random = testing::SampleField(testing::RandomField(5, 20, 8), dims, ScalarType::kFloat32, 3, 0);
    volumes = {Open(ScalarType::kFloat64, linear, shard_count),
               Open(ScalarType::kFloat32, random, shard_count), shards};
  }

  Shards Open(ScalarType type, const std::string& samples, int shard_count,
              const math::Index3& block_cells = {8, 8, 8}) {
    partition::PartitionOptions options;
    options.output_directory = temp_.Sub(absl::StrCat("field", ++count_));
    options.shard_count = shard_count;
    options.block_cells = block_cells;
    const auto source = testing::MakeMemorySource(drawn.geometry(), type, samples, "field");
    ISOSCOPE_CHECK(partition::Partition(*source, options, never).ok());
    Shards opened;
    for (int i = 0; i < shard_count; ++i) {
      auto shard =
          OpenShard(options.output_directory + "/" + store::ShardDirectoryName(i, shard_count));
      ISOSCOPE_CHECK(shard.ok());
      opened.push_back(*std::move(shard));
    }
    return opened;
  }

  const SmallDataset drawn;
  const base::Cancellation never;
  Shards shards;
  std::string linear;
  std::string random;
  std::vector<Shards> volumes;

 private:
  testing::TempDir temp_;
  int count_ = 0;
};

struct Expected {
  SurfacePoint point;
  double random_value = 0;  // by the vertices of the triangle
};

// Middles of some triangles of two surfaces.
std::vector<Expected> MakePoints(const Fields& fields) {
  const volume::BlockLayout layout = fields.drawn.layout();
  extract::BlockExtractor extractor(fields.drawn.geometry(), layout);
  std::vector<Expected> points;
  for (volume::BlockId id = 0; id < layout.block_count(); id += 3) {
    const std::string drawn =
        testing::CutBlock(layout, ScalarType::kUint8, fields.drawn.samples(), id);
    const std::string random = testing::CutBlock(layout, ScalarType::kFloat32, fields.random, id);
    const double isovalue = SmallDataset::kIsovalue + (id % 2 == 0 ? 0 : 20.5);
    const mesh::BlockMeshView mesh =
        extractor.ExtractWithField({id, ScalarType::kUint8, drawn.data()}, isovalue,
                                   {id, ScalarType::kFloat32, random.data()});
    for (std::size_t i = 0; i + 3 <= mesh.indices.size(); i += 3 * 29) {
      Expected expected{.point = {.block_id = id, .rule = {.isovalue = isovalue}}};
      for (std::size_t k = 0; k < 3; ++k) {
        const math::Vec3f& p = mesh.positions[mesh.indices[i + k]];
        expected.point.position = expected.point.position +
                                  math::Vec3d{double{p.x}, double{p.y}, double{p.z}} * (1.0 / 3);
        expected.random_value += mesh.values[mesh.indices[i + k]] / 3;
      }
      points.push_back(expected);
    }
  }
  return points;
}

std::vector<SurfacePoint> PointsOf(const std::vector<Expected>& expected) {
  std::vector<SurfacePoint> points;
  for (const Expected& one : expected) {
    points.push_back(one.point);
  }
  return points;
}

TEST(PointValuesTest, ValuesAreThoseOfTheTrianglesForAnyNumberOfShards) {
  std::vector<PointValues> one_shard_values;
  for (const int shard_count : {1, 3}) {
    Fields fields(shard_count);
    const std::vector<Expected> expected = MakePoints(fields);
    ASSERT_GT(expected.size(), 50U);
    const std::vector<SurfacePoint> points = PointsOf(expected);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<PointValues> together,
                                  ValuesAt(fields.shards, fields.volumes, points, fields.never));
    ASSERT_EQ(together.size(), points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      EXPECT_EQ(together[i].point_index, i);
      ASSERT_EQ(together[i].values.size(), 3U);
      EXPECT_NEAR(together[i].values[0], Linear(points[i].position), 1e-5);
      EXPECT_NEAR(together[i].values[1], expected[i].random_value, 1e-6);
      EXPECT_NEAR(together[i].values[2], points[i].rule.isovalue, 1e-4) << "the drawn field";
    }
    std::map<std::size_t, PointValues> apart;
    for (std::size_t shard = 0; shard < fields.shards.size(); ++shard) {
      std::vector<Shards> volumes;
      for (const Shards& volume : fields.volumes) {
        volumes.push_back({volume[shard]});
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          const std::vector<PointValues> part,
          ValuesAt({fields.shards[shard]}, volumes, points, fields.never));
      for (const PointValues& values : part) {
        EXPECT_TRUE(apart.try_emplace(values.point_index, values).second) << "two shards answer";
      }
    }
    ASSERT_EQ(apart.size(), points.size());
    for (const PointValues& values : together) {
      EXPECT_EQ(apart.at(values.point_index), values);
    }
    one_shard_values = one_shard_values.empty() ? together : one_shard_values;
    EXPECT_EQ(together, one_shard_values) << "bit for bit";
  }
}

TEST(PointValuesTest, CapsHaveTheValuesOfTheirCells) {
  Fields fields(1);
  const volume::BlockLayout layout = fields.drawn.layout();
  for (const math::Vec3d& position :
       {math::Vec3d{3.25, 4.5, 5.75}, {12, 3.5, 8}, {39.5, 35.25, 31.5}}) {
    const volume::BlockId id = volume::BlockOfCell(layout, volume::CellAt(layout, position));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const std::vector<PointValues> values,
        ValuesAt(
            fields.shards, fields.volumes,
            {{.position = position, .block_id = id, .rule = {.isovalue = 1}, .is_on_cap = true}},
            fields.never));
    ASSERT_EQ(values.size(), 1U);
    EXPECT_DOUBLE_EQ(values[0].values[0], Linear(position));
  }
}

// At a vertex the label is the sample at the inside end of its grid edge.
TEST(PointValuesTest, LabelsAreThoseOfTheNearestEdgesForAnyNumberOfShards) {
  const auto rule = volume::InsideRule::OfLabels({118, 121, 122, 130, 131});
  std::vector<PointValues> one_shard_values;
  for (const int shard_count : {1, 3}) {
    Fields fields(shard_count);
    const volume::BlockLayout layout = fields.drawn.layout();
    const math::Index3& dims = layout.sample_dims();
    const auto sample_at = [&](std::int64_t index) {
      return static_cast<double>(
          static_cast<std::uint8_t>(fields.drawn.samples()[static_cast<std::size_t>(index)]));
    };
    extract::BlockExtractor extractor(fields.drawn.geometry(), layout);
    std::vector<SurfacePoint> points;
    std::vector<double> expected;
    for (volume::BlockId id = 0; id < layout.block_count(); id += 5) {
      const std::string drawn =
          testing::CutBlock(layout, ScalarType::kUint8, fields.drawn.samples(), id);
      mesh::BlockMesh mesh;
      extractor.ExtractWithEdgeKeys({id, ScalarType::kUint8, drawn.data()}, rule, &mesh);
      for (std::size_t i = 0; i < mesh.indices.size(); i += 31) {
        const std::size_t vertex = mesh.indices[i];
        const math::Vec3f& p = mesh.positions[vertex];
        points.push_back(
            {.position = {double{p.x}, double{p.y}, double{p.z}}, .block_id = id, .rule = rule});
        const std::array<std::int64_t, 3> steps = {1, dims.x, dims.x * dims.y};
        const std::int64_t lower = mesh.edge_keys[vertex] / 3;
        const std::int64_t upper =
            lower + steps[static_cast<std::size_t>(mesh.edge_keys[vertex] % 3)];
        ASSERT_NE(rule.IsInside(sample_at(lower)), rule.IsInside(sample_at(upper)));
        expected.push_back(sample_at(rule.IsInside(sample_at(lower)) ? lower : upper));
      }
    }
    ASSERT_GT(points.size(), 50U);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<PointValues> values,
                                  ValuesAt(fields.shards, {}, points, fields.never));
    ASSERT_EQ(values.size(), points.size());
    for (std::size_t i = 0; i < values.size(); ++i) {
      EXPECT_EQ(values[i].label, expected[i]) << i;
      EXPECT_TRUE(values[i].values.empty());
    }
    one_shard_values = one_shard_values.empty() ? values : one_shard_values;
    EXPECT_EQ(values, one_shard_values);
  }
}

// A request that lies may name any block for any point.
TEST(PointValuesTest, APointFarFromItsBlockIsAnsweredWithoutACrash) {
  Fields fields(1);
  for (const bool is_on_cap : {false, true}) {
    for (const double isovalue : {SmallDataset::kIsovalue, 1e300}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<PointValues> values,
                                    ValuesAt(fields.shards, fields.volumes,
                                             {{.position = {1e9, -1e9, 40},
                                               .block_id = 0,
                                               .rule = {.isovalue = isovalue},
                                               .is_on_cap = is_on_cap},
                                              {.position = {1, 1, 1}, .block_id = std::nullopt}},
                                             fields.never));
      ASSERT_EQ(values.size(), 1U) << "nobody asked for a block of the second one";
      EXPECT_TRUE(std::isfinite(values[0].values[0]));
    }
  }
}

TEST(PointValuesTest, AVolumeThatIsCutInAnotherWayAndACancellationAreErrors) {
  Fields fields(1);
  const std::vector<SurfacePoint> points = {
      {.position = {1, 1, 1}, .block_id = 0, .rule = {.isovalue = SmallDataset::kIsovalue}}};
  const Shards other = fields.Open(ScalarType::kFloat64, fields.linear, 1, {8, 9, 8});
  EXPECT_THAT(ValuesAt(fields.shards, {other}, points, fields.never).status(),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("must be cut alike")));
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(ValuesAt(fields.shards, fields.volumes, points, cancelled).status(),
              StatusIs(absl::StatusCode::kCancelled));
}

}  // namespace
}  // namespace isoscope::agent
