// isoscope-vertex-values FOLDER: extracts a surface of one field with the values of another one at
// its vertices, and writes what somebody else needs to compute the values again:
//
//   grid.txt     samples on each axis, spacing, origin: nine numbers
//   field.raw    the other field's samples, float64, x fastest
//   points.raw   vertices in world space, three float64 each, as the blocks have them
//   values.raw   their values, float64

#include <fstream>
#include <iostream>
#include <string>

#include "core/base/coding.h"
#include "core/extract/block_extractor.h"
#include "tests/support/block_cutter.h"
#include "tests/support/synthetic_fields.h"

namespace isoscope {
namespace {

constexpr math::Index3 kDims{49, 45, 41};
constexpr double kIsovalue = 128;

void Write(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

void Run(const std::string& folder) {
  volume::GridGeometry geometry;
  geometry.sample_dims = kDims;
  geometry.spacing = {0.5, 0.75, 2};
  geometry.origin = {-12.5, 40, 3.25};
  const auto layout = volume::BlockLayout::Make(kDims, {8, 8, 8}).value();
  const std::string drawn = testing::SampleField(testing::GyroidField(3), kDims,
                                                 volume::ScalarType::kUint8, 80, kIsovalue);
  const std::string field = testing::SampleField(testing::RandomField(3, 40, 9.0), kDims,
                                                 volume::ScalarType::kFloat64, 5, 300);
  std::string points;
  std::string values;
  extract::BlockExtractor extractor(geometry, layout);
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const std::string a = testing::CutBlock(layout, volume::ScalarType::kUint8, drawn, id);
    const std::string b = testing::CutBlock(layout, volume::ScalarType::kFloat64, field, id);
    const mesh::BlockMeshView mesh =
        extractor.ExtractWithField({id, volume::ScalarType::kUint8, a.data()}, kIsovalue,
                                   {id, volume::ScalarType::kFloat64, b.data()});
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
      const math::Vec3f& p = mesh.positions[v];
      base::AppendLittleEndian(geometry.origin.x + geometry.spacing.x * static_cast<double>(p.x),
                               &points);
      base::AppendLittleEndian(geometry.origin.y + geometry.spacing.y * static_cast<double>(p.y),
                               &points);
      base::AppendLittleEndian(geometry.origin.z + geometry.spacing.z * static_cast<double>(p.z),
                               &points);
      base::AppendLittleEndian(mesh.values[v], &values);
    }
  }
  std::ofstream(folder + "/grid.txt") << "49 45 41 0.5 0.75 2 -12.5 40 3.25\n";
  Write(folder + "/field.raw", field);
  Write(folder + "/points.raw", points);
  Write(folder + "/values.raw", values);
}

}  // namespace
}  // namespace isoscope

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: isoscope-vertex-values FOLDER\n";
    return 2;
  }
  isoscope::Run(argv[1]);
  return 0;
}
