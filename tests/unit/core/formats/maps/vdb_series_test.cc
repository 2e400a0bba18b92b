// Files that the library writes are compared voxel by voxel. Damaged ones end in a sentence, and
// this process goes on.

#include "core/formats/maps/vdb_series.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "core/source/volume_source.h"
#include "core/volume/scalar_type.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/vdb_file.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::VdbFileGrid;
using ::isoscope::testing::VdbVoxelAt;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using volume::ScalarType;

struct Box {
  math::Index3 begin{std::numeric_limits<std::int64_t>::max(),
                     std::numeric_limits<std::int64_t>::max(),
                     std::numeric_limits<std::int64_t>::max()};
  math::Index3 end{std::numeric_limits<std::int64_t>::min(),
                   std::numeric_limits<std::int64_t>::min(),
                   std::numeric_limits<std::int64_t>::min()};
};

template <typename Visitor>
void ForEachVoxel(const math::Index3& begin, const math::Index3& end, Visitor visit) {
  for (math::Index3 at{0, 0, begin.z}; at.z < end.z; ++at.z) {
    for (at.y = begin.y; at.y < end.y; ++at.y) {
      for (at.x = begin.x; at.x < end.x; ++at.x) {
        visit(at);
      }
    }
  }
}

// The box of the active voxels, found the plain way.
Box ActiveBox(const VdbFileGrid& grid) {
  Box box;
  for (const testing::VdbFill& fill : grid.fills) {
    ForEachVoxel(fill.begin, fill.end, [&](const math::Index3& at) {
      if (VdbVoxelAt(grid, at, 0).is_active) {
        for (int axis = 0; axis < 3; ++axis) {
          box.begin[axis] = std::min(box.begin[axis], at[axis]);
          box.end[axis] = std::max(box.end[axis], at[axis] + 1);
        }
      }
    });
  }
  return box;
}

// Compares all samples of the volume with the voxels of the box.
void ExpectVoxels(const VdbFileGrid& grid, int component, const Box& box, VolumeSource* volume) {
  ASSERT_EQ(volume->info().geometry.sample_dims, box.end - box.begin);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 3));
  std::size_t next = 0;
  std::int64_t wrong = 0;
  volume::VisitScalarType(volume->info().type, [&]<typename T>() {
    ForEachVoxel(box.begin, box.end, [&](const math::Index3& at) {
      T sample{};
      std::memcpy(&sample, read.data() + next, sizeof(T));
      next += sizeof(T);
      wrong += static_cast<double>(sample) == VdbVoxelAt(grid, at, component).value ? 0 : 1;
    });
  });
  EXPECT_EQ(next, read.size());
  EXPECT_EQ(wrong, 0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string again, ReadAll(*volume, 1000));
  EXPECT_EQ(again, read);
}

// Leaves, tiles of three sizes, active and not, around the origin.
VdbFileGrid Patchwork(const std::string& type) {
  return {.name = "density",
          .type = type,
          .background = 3,
          .fills = {{.begin = {-8, -16, 0}, .end = {0, 8, 16}, .value = 7},
                    {.begin = {-8, 0, 0}, .end = {8, 8, 8}, .value = 9, .is_active = false},
                    {.begin = {-13, -20, 3}, .end = {5, -2, 9}, .value = 20, .has_pattern = true},
                    {.begin = {-2, -2, -2}, .end = {1, 1, 20}, .value = 50, .is_active = false}}};
}

class VdbSeriesTest : public ::testing::Test {
 protected:
  std::string Write(const std::vector<VdbFileGrid>& grids, bool is_stream = false) {
    std::string path = dir_.Sub("a.vdb");
    testing::WriteVdbFile(path, grids, is_stream);
    return path;
  }
  // Opens and reads a grid alone, and compares it.
  static void ExpectGrid(const std::string& path, const VdbFileGrid& grid, ScalarType type) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
    ASSERT_EQ(series->info().fields.size(), 1);
    EXPECT_EQ(series->info().fields[0].name, grid.name);
    const auto components = static_cast<int>(series->info().fields[0].components.size());
    EXPECT_EQ(components, grid.type.rfind("vec", 0) == 0 ? 3 : 1);
    const Box box = ActiveBox(grid);
    for (int component = 0; component < components; ++component) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, component, 0));
      EXPECT_EQ(volume->info().type, type);
      ExpectVoxels(grid, component, box, volume.get());
    }
  }
  const testing::TempDir dir_;
};

TEST_F(VdbSeriesTest, EachTypeGivesEachVoxelOfItsBox) {
  struct Case {
    const char* type;
    ScalarType read;
  };
  for (const Case& c : {Case{"float", ScalarType::kFloat32}, Case{"half", ScalarType::kFloat32},
                        Case{"double", ScalarType::kFloat64}, Case{"int32", ScalarType::kInt32},
                        Case{"int64", ScalarType::kFloat64}, Case{"bool", ScalarType::kUint8},
                        Case{"mask", ScalarType::kUint8}, Case{"vec3f", ScalarType::kFloat32},
                        Case{"vec3d", ScalarType::kFloat64}, Case{"vec3i", ScalarType::kInt32}}) {
    SCOPED_TRACE(c.type);
    const VdbFileGrid grid = Patchwork(c.type);
    ExpectGrid(Write({grid}), grid, c.read);
  }
}

TEST_F(VdbSeriesTest, LargeTilesAndStreams) {
  const VdbFileGrid grid{
      .name = "solid",
      .background = -1,
      .fills = {{.begin = {-128, 0, 0}, .end = {0, 128, 128}, .value = 5},
                {.begin = {3, 130, 131}, .end = {4, 131, 132}, .value = 1, .has_pattern = true}}};
  ExpectGrid(Write({grid}), grid, ScalarType::kFloat32);
  ExpectGrid(Write({grid}, true), grid, ScalarType::kFloat32);
}

TEST_F(VdbSeriesTest, IsKnownByItsContent) {
  const VdbFileGrid grid = Patchwork("float");
  testing::WriteFile(dir_.Sub("unnamed"), testing::ReadFile(Write({grid})));
  ExpectGrid(dir_.Sub("unnamed"), grid, ScalarType::kFloat32);
}

TEST_F(VdbSeriesTest, TransformsPlaceTheBox) {
  VdbFileGrid grid = Patchwork("float");
  grid.world = {{{0, -2, 0, 100}, {1.5, 0, 0, 200}, {0, 0, 4, 300}}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(Write({grid})));
  const Box box = ActiveBox(grid);
  EXPECT_EQ(volume->info().geometry.spacing, (math::Vec3d{1.5, 2, 4}));
  const math::Mat4d world = volume->info().geometry.world_from_index();
  for (const math::Index3& corner : {box.begin, box.end - math::Index3{1, 1, 1}}) {
    const math::Index3 index = corner - box.begin;
    math::Vec3d expected;
    for (int r = 0; r < 3; ++r) {
      const auto& row = grid.world.at(static_cast<std::size_t>(r));
      expected[r] = row[3];
      for (int c = 0; c < 3; ++c) {
        expected[r] += row.at(static_cast<std::size_t>(c)) * static_cast<double>(corner[c]);
      }
    }
    EXPECT_EQ(
        math::TransformPoint(world, {static_cast<double>(index.x), static_cast<double>(index.y),
                                     static_cast<double>(index.z)}),
        expected);
  }
}

TEST_F(VdbSeriesTest, AShearAndAFrustumAreRefused) {
  VdbFileGrid grid = Patchwork("float");
  grid.world[0][1] = 0.5;
  const std::string path = Write({grid});
  EXPECT_THAT(OpenVolumeFile(path), StatusIs(absl::StatusCode::kInvalidArgument,
                                             AllOf(HasSubstr("a.vdb:density"), HasSubstr("sheared"),
                                                   HasSubstr("--ignore-shear"))));
  ISOSCOPE_EXPECT_OK(OpenVolumeFile(path, "", {.ignores_shear = true}).status());
  EXPECT_THAT(OpenVolumeFile(Write({{.is_frustum = true}})),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("Frustum"), HasSubstr("density"))));
}

TEST_F(VdbSeriesTest, GridsOfOneTransformShareABoxAndAloneHaveTheirOwn) {
  const VdbFileGrid a{.name = "a",
                      .fills = {{.begin = {0, 0, 0}, .end = {4, 5, 6}, .has_pattern = true}}};
  const VdbFileGrid v{
      .name = "v",
      .type = "vec3f",
      .background = 2,
      .fills = {{.begin = {-3, 2, 2}, .end = {2, 9, 4}, .value = 1, .has_pattern = true}},
      .is_level_set = true};
  VdbFileGrid other{.name = "other", .fills = a.fills};
  other.world[2][3] = 1;
  const std::string path = Write({a, v, other, {.name = "text", .type = "points"}});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
  ASSERT_EQ(series->info().fields.size(), 2);
  EXPECT_EQ(series->info().fields[0].name, "a");
  EXPECT_EQ(series->info().fields[1].name, "v");
  EXPECT_EQ(series->info().fields[1].long_name, "level set");
  EXPECT_THAT(series->info().fields[1].components, ElementsAre("x", "y", "z"));
  const Box both{.begin = {-3, 0, 0}, .end = {4, 9, 6}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto scalar, series->Open(0, 0, 0));
  ExpectVoxels(a, 0, both, scalar.get());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto vector, series->Open(1, 2, 0));
  ExpectVoxels(v, 2, both, vector.get());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto alone, OpenVolumeFile(absl::StrCat(path, ":v:y")));
  ExpectVoxels(v, 1, ActiveBox(v), alone.get());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto third, OpenVolumeFile(absl::StrCat(path, ":other")));
  EXPECT_EQ(third->info().geometry.origin, (math::Vec3d{0, 0, 1}));
  EXPECT_THAT(OpenVolumeFile(absl::StrCat(path, ":text")),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("ptdata")));
  EXPECT_THAT(OpenVolumeFile(absl::StrCat(path, ":b")),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("a, other, v (x, y, z)")));
}

TEST_F(VdbSeriesTest, ATypeThatTheLibraryDoesNotKnowIsNamed) {
  std::string bytes = testing::ReadFile(Write({Patchwork("float")}));
  const std::size_t at = bytes.find("Tree_float_5_4_3");
  ASSERT_NE(at, std::string::npos);
  bytes.replace(at, 10, "Tree_gravy");
  testing::WriteFile(dir_.Sub("b.vdb"), bytes);
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("b.vdb")),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("Tree_gravy_5_4_3")));
}

TEST_F(VdbSeriesTest, NamesThatAreMissingOrThereTwice) {
  const std::vector<testing::VdbFill> fills{{.begin = {0, 0, 0}, .end = {2, 2, 2}, .value = 1}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto nameless,
                                OpenVolumeSeries(Write({{.name = "", .fills = fills}})));
  EXPECT_EQ(nameless->info().fields[0].name, "a");
  ISOSCOPE_EXPECT_OK(nameless->Open(0, 0, 0).status());
  const std::string path = Write({{.name = "p", .fills = fills}, {.name = "p", .fills = fills}});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
  ASSERT_EQ(series->info().fields.size(), 2);
  for (const int field : {0, 1}) {
    EXPECT_EQ(series->info().fields[static_cast<std::size_t>(field)].name,
              absl::StrCat("p[", field, "]"));
    ISOSCOPE_EXPECT_OK(series->Open(field, 0, 0).status());
  }
}

TEST_F(VdbSeriesTest, BoxesThatAreNoVolumeAreRefusedWithTheirSizes) {
  EXPECT_THAT(OpenVolumeFile(Write({{.background = 1}})),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no voxel of grid")));
  EXPECT_THAT(
      OpenVolumeFile(Write({{.fills = {{.begin = {0, 0, 0}, .end = {4, 4, 1}, .value = 1}}}})),
      StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("4 x 4 x 1 samples")));
  const auto far = [&](std::int64_t end) {
    return Write({{.fills = {{.begin = {-end, 0, 0}, .end = {1 - end, 1, 1}, .value = 1},
                             {.begin = {0, end - 1, end - 1}, .end = {1, end, end}, .value = 1}}}});
  };
  EXPECT_THAT(OpenVolumeFile(far(100'000)),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("100001 x 100000 x 100000 samples"), HasSubstr("TiB"),
                             HasSubstr("clip or resample"), HasSubstr("--crop"))));
  EXPECT_THAT(OpenVolumeFile(far(2'000'000'000)),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("2^24")));
}

TEST_F(VdbSeriesTest, IntegersThatFloatsDoNotHoldAreNamed) {
  const std::string path = Write(
      {{.type = "int64", .fills = {{.begin = {0, 0, 0}, .end = {2, 2, 2}, .value = 0x1p60}}}});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path));
  EXPECT_THAT(ReadAll(*volume, 2),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("1152921504606846976")));
}

// Sanitizers have no limit of memory (decoder_process.h). Without it, a size that lies keeps the
// library busy until its limit of time.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
// Opens and reads a file, which may be damaged; true if that gave samples.
bool IsRead(const std::string& path) {
  const auto volume = OpenVolumeFile(path);
  if (!volume.ok()) {
    EXPECT_THAT(volume.status().message(), HasSubstr(path));
    return false;
  }
  const math::Index3& dims = (*volume)->info().geometry.sample_dims;
  constexpr std::int64_t kMaxSamples = std::int64_t{1} << 22;
  if (math::Volume(dims) > kMaxSamples) {  // a lie about the place of a node
    return false;
  }
  const auto read = ReadAll(**volume, dims.z);
  EXPECT_TRUE(read.ok() || !read.status().message().empty());
  return read.ok();
}

TEST_F(VdbSeriesTest, AFileThatIsCutAnywhereEndsInASentence) {
  const std::string bytes = testing::ReadFile(Write({Patchwork("float")}));
  const std::size_t step = std::max<std::size_t>(1, bytes.size() / 40);
  int read = 0;
  for (std::size_t size = 0; size < bytes.size(); size += step) {
    testing::WriteFile(dir_.Sub("cut.vdb"), bytes.substr(0, size));
    read += IsRead(dir_.Sub("cut.vdb")) ? 1 : 0;
  }
  EXPECT_EQ(read, 0);
}

TEST_F(VdbSeriesTest, FlippedBytesNeverEndThisProcess) {
  const std::string bytes = testing::ReadFile(Write({Patchwork("float")}));
  const std::size_t step = std::max<std::size_t>(1, bytes.size() / 60);
  for (std::size_t at = 0; at < bytes.size(); at += step) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ '\x55');
    testing::WriteFile(dir_.Sub("damaged.vdb"), damaged);
    IsRead(dir_.Sub("damaged.vdb"));
  }
}

TEST_F(VdbSeriesTest, SizesThatLieEndInASentence) {
  const std::string bytes = testing::ReadFile(Write({Patchwork("float")}));
  // Lengths and counts of 4 bytes lie at any place of the head.
  for (std::size_t at = 12; at + 4 < std::min<std::size_t>(bytes.size(), 1200); at += 23) {
    std::string lying = bytes;
    lying.replace(at, 4, "\xff\xff\xff\x7f");
    testing::WriteFile(dir_.Sub("lying.vdb"), lying);
    IsRead(dir_.Sub("lying.vdb"));
  }
}
#endif

}  // namespace
}  // namespace isoscope::source
