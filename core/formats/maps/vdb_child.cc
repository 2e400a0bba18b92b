// A tree of OpenVDB ends in leaves of 8 x 8 x 8 voxels, and a larger node has one value for each
// part of it without a leaf. So each aligned cube of 8 x 8 x 8 voxels is either a leaf or constant.
//
// Files are mapped, and the box of the active voxels needs the masks alone. The values of a leaf
// are loaded when its first voxel is read, into a copy of its buffer: the tree would keep them. The
// copies are dropped at the next layer of cubes, so that memory holds one layer.
//
// Grids are never freed, because the library does that by TBB. After a fork, TBB may wait for a
// lock of a thread that is no more. The process holds one volume, and ends with it.

#include "core/formats/maps/vdb_child.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <exception>
#include <limits>
#include <map>
#include <new>
#include <stdexcept>
#include <tuple>
#include <type_traits>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <openvdb/openvdb.h>

#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

using openvdb::Coord;
using openvdb::CoordBBox;
using openvdb::GridBase;
using volume::ScalarType;

constexpr std::int64_t kMaxVdbGrids = 4096;
constexpr std::size_t kMaxVdbName = 255;
constexpr std::int64_t kCubeSide = 8;
constexpr int kLog2CubeSide = 3;
constexpr std::int64_t kAllocationBytes = 16;  // of the allocator, for each piece of memory
constexpr std::int64_t kOpenFileBytes = std::int64_t{1} << 20;  // metadata, streams, buffers

// Calls `act`, whose result is a StatusOr or a Status, and turns exceptions into errors.
template <typename Act>
auto Caught(const std::string& path, Act act) -> decltype(act()) {
  try {
    return act();
  } catch (const std::bad_alloc&) {
    return absl::DataLossError(absl::StrCat(
        path, ": OpenVDB needs more memory than such a file should: it is damaged, or too large"));
  } catch (const openvdb::LookupError& error) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": OpenVDB does not know the types of all its grids: ", error.what(),
                     ": write the others into a file of their own"));
  } catch (const std::exception& error) {
    return absl::DataLossError(
        absl::StrCat(path, ": OpenVDB can't read it, it is damaged or cut: ", error.what()));
  }
}

// The grid types that are read.
template <typename Visitor>
bool VisitVdbGrid(const GridBase& grid, Visitor&& visitor) {
  const auto visit = [&]<typename GridType>(const GridType* /*type*/) {
    if (!grid.isType<GridType>()) {
      return false;
    }
    visitor(static_cast<const GridType&>(grid));
    return true;
  };
  const auto any_of = [&]<typename... GridTypes>(const std::tuple<GridTypes...>* /*types*/) {
    return (visit(static_cast<const GridTypes*>(nullptr)) || ...);
  };
  using Types = std::tuple<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid,
                           openvdb::Int64Grid, openvdb::BoolGrid, openvdb::MaskGrid,
                           openvdb::Vec3SGrid, openvdb::Vec3DGrid, openvdb::Vec3IGrid>;
  return any_of(static_cast<const Types*>(nullptr));
}

template <typename Value>
constexpr bool kIsVdbVector = openvdb::VecTraits<Value>::IsVec;

template <typename Value>
constexpr ScalarType VdbScalarType() {
  using Element = typename openvdb::VecTraits<Value>::ElementType;
  return std::is_same_v<Element, float>          ? ScalarType::kFloat32
         : std::is_same_v<Element, std::int32_t> ? ScalarType::kInt32
         : std::is_same_v<Element, bool>         ? ScalarType::kUint8
                                                 : ScalarType::kFloat64;  // and of int64, its bits
}

// True for grids of bits, which are in memory as a whole with the tree.
template <typename GridType>
constexpr bool kIsVdbBits = std::is_same_v<typename GridType::ValueType, bool>;

// The tree without the values of the leaves that are still in the file.
template <typename GridType>
std::int64_t TreeBytes(const GridType& grid) {
  using Upper = typename GridType::TreeType::RootNodeType::ChildNodeType;
  using Lower = typename Upper::ChildNodeType;
  const std::vector<openvdb::Index32> counts = grid.tree().nodeCount();  // leaves first
  std::int64_t bytes = static_cast<std::int64_t>(sizeof(Lower)) * counts[1] +
                       static_cast<std::int64_t>(sizeof(Upper)) * counts[2];
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
    bytes += static_cast<std::int64_t>(leaf->memUsage()) + 2 * kAllocationBytes;
  }
  return bytes;
}

// The values of the leaves in the layer of cubes that has the most.
template <typename GridType>
std::int64_t LayerBytes(const GridType& grid) {
  std::int64_t most = 0;
  if constexpr (!kIsVdbBits<GridType>) {
    constexpr auto kLoadedBytes = static_cast<std::int64_t>(
        sizeof(typename GridType::TreeType::LeafNodeType::Buffer) +
        GridType::TreeType::LeafNodeType::SIZE * sizeof(typename GridType::ValueType) +
        2 * kAllocationBytes + 4 * sizeof(void*));
    std::map<int, std::int64_t> layers;
    for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) {
      if (leaf->buffer().isOutOfCore()) {
        std::int64_t& bytes = layers[leaf->origin().z()];
        bytes += kLoadedBytes;
        most = std::max(most, bytes);
      }
    }
  }
  return most;
}

// One sample, at `out`.
template <typename Value>
void PutVdbSample(const Value& value, int component, char* out) {
  if constexpr (kIsVdbVector<Value>) {
    std::memcpy(out, value.asPointer() + component, sizeof(value[0]));
  } else if constexpr (std::is_same_v<Value, bool>) {
    *out = value ? 1 : 0;
  } else {
    std::memcpy(out, &value, sizeof(value));
  }
}

template <typename GridType>
class GridVolume final : public VdbVolume {
 public:
  GridVolume(std::string path, const GridType& grid, int component, const Coord& first,
             const Header& header)
      : path_(std::move(path)),
        tree_(grid.constTree()),
        component_(component),
        first_(first),
        header_(header) {}

  [[nodiscard]] const Header& header() const override { return header_; }

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    return Caught(path_, [&] { return ReadCubes(begin_row, end_row, out); });
  }

 private:
  using Value = typename GridType::ValueType;
  using Leaf = typename GridType::TreeType::LeafNodeType;
  using Buffer = typename Leaf::Buffer;
  static_assert(Leaf::DIM == kCubeSide);

  static std::int64_t InCube(std::int64_t index) { return index & (kCubeSide - 1); }

  // Throws.
  absl::Status ReadCubes(std::int64_t begin_row, std::int64_t end_row, char* out) {
    const std::int64_t rows = header_.dims.y;
    while (begin_row < end_row) {
      // The rows of one plane that lie in one row of cubes.
      const std::int64_t y = begin_row % rows;
      const std::int64_t z = begin_row / rows;
      const std::int64_t in_cube = kCubeSide - InCube(first_.y() + y);
      const std::int64_t count = std::min({end_row - begin_row, rows - y, in_cube});
      ReadPlaneRows(y, z, count, out);
      begin_row += count;
      out += count * row_bytes_;
    }
    return absl::OkStatus();
  }

  // The value of a cube without a leaf.
  [[nodiscard]] Value ConstantAt(const Coord& at) const {
    if constexpr (std::is_same_v<GridType, openvdb::MaskGrid>) {
      return tree_.isValueOn(at);
    } else {
      return tree_.getValue(at);
    }
  }

  // The values of a leaf, loaded if they are not. Valid until the next layer of cubes is read.
  const Value* ValuesOf(const Leaf& leaf) {
    if (!leaf.buffer().isOutOfCore()) {
      return leaf.buffer().data();
    }
    std::unique_ptr<Buffer>& copy = loaded_[&leaf];
    if (copy == nullptr) {
      copy = std::make_unique<Buffer>(leaf.buffer());
    }
    return std::as_const(*copy).data();
  }

  void ReadPlaneRows(std::int64_t y, std::int64_t z, std::int64_t count, char* out) {
    const std::int64_t layer = (first_.z() + z) >> kLog2CubeSide;
    if (layer != loaded_layer_) {
      loaded_.clear();
      loaded_layer_ = layer;
    }
    std::int64_t x = 0;
    while (x < header_.dims.x) {
      const std::int64_t side = kCubeSide - InCube(first_.x() + x);
      const std::int64_t run = std::min(header_.dims.x - x, side);
      const Coord begin =
          first_.offsetBy(static_cast<int>(x), static_cast<int>(y), static_cast<int>(z));
      const Leaf* const leaf = tree_.probeConstLeaf(begin);
      const Value constant = leaf == nullptr ? ConstantAt(begin) : Value();
      const Value* values = nullptr;
      if constexpr (!kIsVdbBits<GridType>) {
        values = leaf != nullptr ? ValuesOf(*leaf) : nullptr;
      }
      for (std::int64_t row = 0; row < count; ++row) {
        char* next = out + row * row_bytes_ + x * sample_bytes_;
        for (std::int64_t i = 0; i < run; ++i) {
          const Coord at = begin.offsetBy(static_cast<int>(i), static_cast<int>(row), 0);
          if constexpr (kIsVdbBits<GridType>) {
            PutVdbSample<Value>(leaf != nullptr ? leaf->getValue(at) : constant, component_, next);
          } else {
            PutVdbSample<Value>(leaf != nullptr ? values[Leaf::coordToOffset(at)] : constant,
                                component_, next);
          }
          next += sample_bytes_;
        }
      }
      x += run;
    }
  }

  const std::string path_;
  const typename GridType::TreeType& tree_;  // not by an accessor, which loads leaves
  const int component_;
  const Coord first_;
  const Header header_;
  const std::int64_t sample_bytes_ = static_cast<std::int64_t>(volume::SizeOf(header_.type));
  const std::int64_t row_bytes_ = header_.dims.x * sample_bytes_;
  std::int64_t loaded_layer_ = std::numeric_limits<std::int64_t>::min();
  std::unordered_map<const Leaf*, std::unique_ptr<Buffer>> loaded_;  // in that layer
};

class VdbFile {
 public:
  // Throws.
  explicit VdbFile(const std::string& path) : file_(path) {
    file_.setCopyMaxBytes(0);
    file_.open(true);
    for (auto name = file_.beginName(); name != file_.endName(); ++name) {
      names_.push_back(name.gridName());
    }
  }

  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  // The grid without its voxels. Throws.
  GridBase& ReadHead(std::size_t grid) { return Keep(file_.readGridMetadata(names_[grid])); }
  // Throws.
  GridBase& Read(std::size_t grid) { return Keep(file_.readGrid(names_[grid])); }

 private:
  // Never frees it.
  static GridBase& Keep(GridBase::Ptr grid) {
    if (grid == nullptr) {
      throw std::runtime_error("a grid is missing");
    }
    static auto* const kept = new std::vector<GridBase::Ptr>();
    return *kept->emplace_back(std::move(grid));
  }

  openvdb::io::File file_;
  std::vector<std::string> names_;
};

// Opens it, for good. Throws.
absl::StatusOr<VdbFile*> OpenVdbFile(const std::string& path) {
  openvdb::initialize();
  static auto* const kept = new std::vector<std::unique_ptr<VdbFile>>();
  VdbFile* const file = kept->emplace_back(std::make_unique<VdbFile>(path)).get();
  if (file->names().size() > kMaxVdbGrids) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: %d grids; expected at most %d", path,
                                                      file->names().size(), kMaxVdbGrids));
  }
  return file;
}

// Describes grid `index`, but for `alike`. Throws.
VdbGrid Describe(std::size_t index, VdbFile* file) {
  const GridBase& grid = file->ReadHead(index);
  VdbGrid listed;
  listed.name = file->names()[index];
  listed.type = grid.type();
  listed.grid_class = GridBase::gridClassToString(grid.getGridClass());
  listed.is_linear = grid.transform().isLinear();
  VisitVdbGrid(grid, [&]<typename GridType>(const GridType& /*typed*/) {
    listed.components = kIsVdbVector<typename GridType::ValueType> ? 3 : 1;
  });
  return listed;
}

absl::StatusOr<std::vector<VdbGrid>> ListOpened(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(VdbFile* const file, OpenVdbFile(path));
  std::vector<VdbGrid> list;
  std::vector<const openvdb::math::Transform*> transforms;
  for (std::size_t i = 0; i < file->names().size(); ++i) {
    const std::string& name = file->names()[i];
    if (name.size() > kMaxVdbName) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: a grid has a name of %d bytes; expected at most %d: rename it", path,
                          name.size(), kMaxVdbName));
    }
    list.push_back(Describe(i, file));
    const openvdb::math::Transform& own = file->ReadHead(i).transform();
    transforms.push_back(&own);
    while (*transforms[static_cast<std::size_t>(list.back().alike)] != own) {
      ++list.back().alike;
    }
  }
  return list;
}

std::array<std::array<double, 4>, 3> WorldFromBox(const openvdb::math::Transform& transform,
                                                  const Coord& first) {
  // Its rows are the world's steps along each axis of indices, and the origin.
  const openvdb::Mat4d matrix = transform.baseMap()->getAffineMap()->getMat4();
  const openvdb::Vec3d origin = transform.indexToWorld(first);
  std::array<std::array<double, 4>, 3> rows{};
  for (int r = 0; r < 3; ++r) {
    std::array<double, 4>& row = rows.at(static_cast<std::size_t>(r));
    row = {matrix(0, r), matrix(1, r), matrix(2, r), origin[r]};
  }
  return rows;
}

template <typename GridType>
std::unique_ptr<VdbVolume> MakeVolume(const std::string& path, const GridType& grid, int component,
                                      const CoordBBox& box, std::int64_t other_bytes) {
  using Value = typename GridType::ValueType;
  const auto size = [](int first, int last) { return std::int64_t{last} - first + 1; };
  const VdbVolume::Header header{
      .type = VdbScalarType<Value>(),
      .is_int64 = std::is_same_v<Value, std::int64_t>,
      .dims = {size(box.min().x(), box.max().x()), size(box.min().y(), box.max().y()),
               size(box.min().z(), box.max().z())},
      .world_from_index = WorldFromBox(grid.transform(), box.min()),
      .memory_bytes = kOpenFileBytes + TreeBytes(grid) + LayerBytes(grid) + other_bytes};
  return std::make_unique<GridVolume<GridType>>(path, grid, component, box.min(), header);
}

// Returns the box of the active voxels of the grid, or of all grids that can be read and have its
// transform. Adds the memory of the others to `other_bytes`. Throws.
CoordBBox BoxOf(const GridBase& grid, std::size_t index, bool is_joined, VdbFile* file,
                std::int64_t* other_bytes) {
  CoordBBox box = grid.evalActiveVoxelBoundingBox();
  for (std::size_t i = 0; is_joined && i < file->names().size(); ++i) {
    const bool is_alike = i != index && Describe(i, file).components > 0 &&
                          file->ReadHead(i).transform() == grid.transform();
    if (is_alike) {
      const GridBase& other = file->Read(i);
      VisitVdbGrid(other, [&](const auto& typed) { *other_bytes += TreeBytes(typed); });
      const CoordBBox other_box = other.evalActiveVoxelBoundingBox();
      if (!other_box.empty()) {
        box.expand(other_box);
      }
    }
  }
  return box;
}

absl::StatusOr<std::unique_ptr<VdbVolume>> OpenOpened(const std::string& path, std::int64_t number,
                                                      std::int64_t component, bool is_joined) {
  ISOSCOPE_ASSIGN_OR_RETURN(VdbFile* const file, OpenVdbFile(path));
  const auto index = static_cast<std::size_t>(number);
  if (number < 0 || index >= file->names().size()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: no grid %d: it has changed", path, number));
  }
  const std::string& name = file->names()[index];
  if (const auto& transform = file->ReadHead(index).transform(); !transform.isLinear()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: the transform of grid \"%s\" is a %s; expected a linear one: resample the grid (vdb "
        "tools: resampleToMatch)",
        path, name, std::string(transform.mapType())));
  }
  const GridBase& grid = file->Read(index);
  std::int64_t other_bytes = 0;
  const CoordBBox box = BoxOf(grid, index, is_joined, file, &other_bytes);
  if (box.empty()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: no voxel of grid \"%s\" is active, so that it has no box: write it with the voxels "
        "that matter active, or choose another grid",
        path, name));
  }
  std::unique_ptr<VdbVolume> volume;
  VisitVdbGrid(grid, [&]<typename GridType>(const GridType& typed) {
    if (component < (kIsVdbVector<typename GridType::ValueType> ? 3 : 1)) {
      volume = MakeVolume(path, typed, static_cast<int>(component), box, other_bytes);
    }
  });
  if (volume == nullptr) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: grid \"%s\" of %s has no component %d that can be read: it has changed", path, name,
        std::string(grid.type()), component));
  }
  return volume;
}

absl::StatusOr<std::vector<VdbGrid>> ListGrids(const std::string& path) {
  return Caught(path, [&] { return ListOpened(path); });
}

absl::StatusOr<std::unique_ptr<VdbVolume>> OpenGrid(const std::string& path, std::int64_t grid,
                                                    std::int64_t component, bool is_joined) {
  return Caught(path, [&] { return OpenOpened(path, grid, component, is_joined); });
}

}  // namespace

const VdbModule& VdbCalls() {
  static constexpr VdbModule kCalls{.list = ListGrids, .open = OpenGrid};
  return kCalls;
}

}  // namespace isoscope::source
