#include "tests/support/vdb_file.h"

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <type_traits>

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/points/PointDataGrid.h>

#include "core/base/check.h"

namespace isoscope::testing {
namespace {

openvdb::Coord CoordOf(const math::Index3& at) {
  return {static_cast<int>(at.x), static_cast<int>(at.y), static_cast<int>(at.z)};
}

template <typename Value>
Value ValueOf(double value) {
  if constexpr (openvdb::VecTraits<Value>::IsVec) {
    using Element = typename Value::value_type;
    return Value(static_cast<Element>(value), static_cast<Element>(value + 1),
                 static_cast<Element>(value + 2));
  } else if constexpr (std::is_same_v<Value, bool>) {
    return value != 0;
  } else {
    return static_cast<Value>(value);
  }
}

template <typename GridType>
void Fill(const VdbFill& fill, GridType* grid) {
  using Value = typename GridType::ValueType;
  // The value of a mask's voxel is whether it is active.
  const double value =
      std::is_same_v<GridType, openvdb::MaskGrid> ? (fill.is_active ? 1 : 0) : fill.value;
  const openvdb::CoordBBox box(CoordOf(fill.begin), CoordOf(fill.end).offsetBy(-1));
  if (!fill.has_pattern) {
    grid->fill(box, ValueOf<Value>(value), fill.is_active);
    return;
  }
  auto accessor = grid->getAccessor();
  for (auto at = box.begin(); at; ++at) {
    const openvdb::Coord& c = *at;
    const double pattern = std::is_same_v<GridType, openvdb::MaskGrid>
                               ? value
                               : VdbPattern(value, {c.x(), c.y(), c.z()});
    if (fill.is_active) {
      accessor.setValueOn(c, ValueOf<Value>(pattern));
    } else {
      accessor.setValueOff(c, ValueOf<Value>(pattern));
    }
  }
}

openvdb::math::Transform::Ptr TransformOf(const VdbFileGrid& grid) {
  if (grid.is_frustum) {
    return openvdb::math::Transform::createFrustumTransform(
        openvdb::BBoxd(openvdb::Vec3d(0), openvdb::Vec3d(10)), 0.5, 10);
  }
  openvdb::Mat4d matrix = openvdb::Mat4d::identity();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 4; ++c) {
      matrix(c, r) = grid.world.at(static_cast<std::size_t>(r)).at(static_cast<std::size_t>(c));
    }
  }
  return openvdb::math::Transform::createLinearTransform(matrix);
}

template <typename GridType>
openvdb::GridBase::Ptr Make(const VdbFileGrid& from) {
  typename GridType::Ptr grid;
  if constexpr (std::is_same_v<GridType, openvdb::MaskGrid>) {
    grid = GridType::create();
  } else if constexpr (openvdb::VecTraits<typename GridType::ValueType>::IsVec) {
    using Element = typename GridType::ValueType::value_type;
    grid = GridType::create(typename GridType::ValueType(static_cast<Element>(from.background)));
  } else {
    grid = GridType::create(ValueOf<typename GridType::ValueType>(from.background));
  }
  for (const VdbFill& fill : from.fills) {
    Fill(fill, grid.get());
  }
  grid->setTransform(TransformOf(from));
  grid->setName(from.name);
  grid->setSaveFloatAsHalf(from.type == "half");
  if (from.is_level_set) {
    grid->setGridClass(openvdb::GRID_LEVEL_SET);
  }
  return grid;
}

// Of no points.
openvdb::GridBase::Ptr MakePoints(const VdbFileGrid& from) {
  auto grid = openvdb::points::PointDataGrid::create();
  grid->setName(from.name);
  return grid;
}

openvdb::GridBase::Ptr MakeOfType(const VdbFileGrid& grid) {
  const std::string& type = grid.type;
  return type == "double"   ? Make<openvdb::DoubleGrid>(grid)
         : type == "int32"  ? Make<openvdb::Int32Grid>(grid)
         : type == "int64"  ? Make<openvdb::Int64Grid>(grid)
         : type == "bool"   ? Make<openvdb::BoolGrid>(grid)
         : type == "mask"   ? Make<openvdb::MaskGrid>(grid)
         : type == "vec3f"  ? Make<openvdb::Vec3SGrid>(grid)
         : type == "vec3d"  ? Make<openvdb::Vec3DGrid>(grid)
         : type == "vec3i"  ? Make<openvdb::Vec3IGrid>(grid)
         : type == "points" ? MakePoints(grid)
                            : Make<openvdb::FloatGrid>(grid);
}

}  // namespace

double VdbPattern(double value, const math::Index3& at) {
  const std::int64_t sum = at.x + 3 * at.y + 7 * at.z;
  return value + static_cast<double>((sum % 100 + 100) % 100);
}

VdbVoxel VdbVoxelAt(const VdbFileGrid& grid, const math::Index3& at, int component) {
  const bool is_vector = grid.type.rfind("vec", 0) == 0;
  VdbVoxel voxel{.value = grid.background, .is_active = false};
  for (const VdbFill& fill : grid.fills) {
    const bool is_inside = at.x >= fill.begin.x && at.x < fill.end.x && at.y >= fill.begin.y &&
                           at.y < fill.end.y && at.z >= fill.begin.z && at.z < fill.end.z;
    if (is_inside) {
      voxel = {.value = (fill.has_pattern ? VdbPattern(fill.value, at) : fill.value) +
                        (is_vector ? component : 0),
               .is_active = fill.is_active};
    }
  }
  if (grid.type == "bool" || grid.type == "mask") {
    voxel.value = (grid.type == "mask" ? voxel.is_active : voxel.value != 0) ? 1 : 0;
  }
  return voxel;
}

void WriteVdbFile(const std::string& path, const std::vector<VdbFileGrid>& grids, bool is_stream) {
  openvdb::initialize();
  openvdb::GridPtrVec written;
  for (const VdbFileGrid& grid : grids) {
    written.push_back(MakeOfType(grid));
  }
  if (is_stream) {
    std::ofstream file(path, std::ios::binary);
    openvdb::io::Stream(file).write(written);
    ISOSCOPE_CHECK(file.good());
    return;
  }
  openvdb::io::File(path).write(written);
}

}  // namespace isoscope::testing
