// The file:
//
//   "glTF", 2, length                               12 bytes
//   length, "JSON", text                            padded with spaces to a fixed length, because
//                                                   counts and bounds are known last
//   length, "BIN\0", positions, normals, indices    each of all surfaces
//
// A surface is a primitive of the single mesh: it has its own accessors into the three arrays, and
// a material if the file has colours. The field and the step of a series are asset.extras. The
// origin of a mesh is the translation of its node. Example: with surfaces of 10 and 20 vertices,
// the second one's positions begin at byte 120 of the first array, and its indices count from 0.
//
// Sources: glTF 2.0 specification, sections 3.6 (buffers, accessors), 3.9 (materials), 4 (GLB).

#include "clients/cpp/mesh_file/glb_writer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include <nlohmann/json.hpp>

#include "clients/cpp/mesh_file/sectioned_file.h"
#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/volume/label.h"

namespace isoscope::client {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kFileHeadBytes = 12;
constexpr std::size_t kChunkHeadBytes = 8;
// Bytes reserved for the common part, and for each surface.
constexpr std::size_t kJsonBytes = 1024;
// Room for the name of a part, each of whose bytes may be escaped.
constexpr std::size_t kNameBytes = 2 * volume::kMaxLabelNameBytes;
// Three floats of a vertex, three indices of a triangle.
constexpr std::int64_t kGlbVectorBytes = 3 * sizeof(float);
constexpr std::int64_t kMaxFileBytes = std::numeric_limits<std::uint32_t>::max();
// Constants of the specification.
constexpr int kFloat = 5126;
constexpr int kUnsignedInt = 5125;
constexpr int kArrayBuffer = 34962;
constexpr int kElementArrayBuffer = 34963;
constexpr int kTriangles = 4;

enum Section : std::size_t { kPositions, kNormals, kIndices, kSectionCount };

// sRGB to linear (IEC 61966-2-1): glTF's factors are linear.
double Linear(float value) {
  const auto v = static_cast<double>(value);
  return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
}

absl::string_view BytesOf(const auto& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(values[0])};
}

// Vertices and triangles of one surface: a primitive.
struct Part {
  std::int64_t first_vertex = 0;
  std::int64_t first_triangle = 0;
  std::int64_t vertex_count = 0;
  std::int64_t triangle_count = 0;
  std::array<float, 3> min{std::numeric_limits<float>::infinity(),
                           std::numeric_limits<float>::infinity(),
                           std::numeric_limits<float>::infinity()};
  std::array<float, 3> max{-std::numeric_limits<float>::infinity(),
                           -std::numeric_limits<float>::infinity(),
                           -std::numeric_limits<float>::infinity()};
};

Json ToJson(const std::array<float, 3>& v) {
  return {static_cast<double>(v[0]), static_cast<double>(v[1]), static_cast<double>(v[2])};
}

class GlbWriter : public MeshWriter {
 public:
  explicit GlbWriter(const MeshFileOptions& options)
      : options_(options), parts_(options.surfaces.size()) {}

  absl::Status Open() {
    ISOSCOPE_ASSIGN_OR_RETURN(file_,
                              SectionedFile::Create(options_.path, header_bytes(), kSectionCount));
    return absl::OkStatus();
  }

  absl::Status AddPiece(const MeshPiece& piece) override {
    Part& part = parts_[static_cast<std::size_t>(piece.surface_index)];
    if (part.vertex_count == 0) {
      part.first_vertex = vertex_count();
      part.first_triangle = triangle_count();
    }
    origin_ = piece.origin;
    part.vertex_count += piece.vertex_count();
    part.triangle_count += piece.triangle_count();
    for (std::size_t i = 0; i < piece.positions.size(); ++i) {
      part.min[i % 3] = std::min(part.min[i % 3], piece.positions[i]);
      part.max[i % 3] = std::max(part.max[i % 3], piece.positions[i]);
    }
    // The indices of a primitive count from its own first vertex.
    std::vector<std::uint32_t> indices = piece.triangles;
    for (std::uint32_t& index : indices) {
      index -= static_cast<std::uint32_t>(part.first_vertex);
    }
    ISOSCOPE_RETURN_IF_ERROR(file_->Append(kPositions, BytesOf(piece.positions)));
    ISOSCOPE_RETURN_IF_ERROR(file_->Append(kNormals, BytesOf(piece.normals)));
    ISOSCOPE_RETURN_IF_ERROR(file_->Append(kIndices, BytesOf(indices)));
    if (data_bytes() > kMaxFileBytes - static_cast<std::int64_t>(header_bytes())) {
      return absl::OutOfRangeError(
          "the isosurface is larger than 4 GiB, where a GLB ends: write a .ply, or --simplify it");
    }
    return absl::OkStatus();
  }

  absl::Status Finish() override {
    const auto data = static_cast<std::uint32_t>(data_bytes());
    std::string json = Describe().dump(-1, ' ', false, Json::error_handler_t::replace);
    ISOSCOPE_CHECK_LE(json.size(), json_bytes());
    json.resize(json_bytes(), ' ');
    std::string header = "glTF";
    base::AppendLittleEndian(std::uint32_t{2}, &header);
    base::AppendLittleEndian(static_cast<std::uint32_t>(header_bytes()) + data, &header);
    base::AppendLittleEndian(static_cast<std::uint32_t>(json_bytes()), &header);
    absl::StrAppend(&header, "JSON", json);
    base::AppendLittleEndian(data, &header);
    header.append("BIN\0", 4);
    return file_->Finish(header);
  }

  [[nodiscard]] std::int64_t size_bytes() const override { return file_->size_bytes(); }
  [[nodiscard]] DiskUse disk_use() const override { return file_->disk_use(); }

 private:
  // A multiple of 4, as the format wants it.
  [[nodiscard]] std::size_t json_bytes() const {
    const std::size_t extras_bytes =
        options_.field.has_value()
            ? Extras().dump(-1, ' ', false, Json::error_handler_t::replace).size() + 16
            : 0;
    return kJsonBytes + (kJsonBytes + kNameBytes) * parts_.size() + extras_bytes / 4 * 4;
  }
  [[nodiscard]] std::size_t header_bytes() const {
    return kFileHeadBytes + 2 * kChunkHeadBytes + json_bytes();
  }
  [[nodiscard]] std::int64_t data_bytes() const {
    return file_->section_bytes(kPositions) + file_->section_bytes(kNormals) +
           file_->section_bytes(kIndices);
  }

  // The field and the step. REQUIRES: options_.field is set.
  [[nodiscard]] Json Extras() const {
    const MeshField& field = *options_.field;
    Json extras = {{"field", field.name}, {"component", field.component}, {"unit", field.unit}};
    if (field.step.has_value()) {
      extras["step"] = *field.step;
    }
    if (field.time.has_value()) {
      extras["time"] = *field.time;
      extras["time_unit"] = field.time_unit;
    }
    return extras;
  }

  [[nodiscard]] Json Describe() const {
    Json json;
    json["asset"] = {{"version", "2.0"}, {"generator", "isoscope"}};
    if (options_.field.has_value()) {
      json["asset"]["extras"] = Extras();
    }
    json["scene"] = 0;
    if (triangle_count() == 0) {  // accessors of no elements are not allowed
      json["scenes"] = Json::array({Json::object()});
      return json;
    }
    json["scenes"] = Json::array({{{"nodes", {0}}}});
    json["nodes"] = Json::array({{{"mesh", 0}}});
    if (origin_.has_value()) {
      json["nodes"][0]["translation"] = {origin_->x, origin_->y, origin_->z};
    }
    Json primitives = Json::array();
    Json accessors = Json::array();
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      if (parts_[i].triangle_count > 0) {
        primitives.push_back(AddPrimitive(static_cast<int>(i), &accessors, &json));
      }
    }
    json["meshes"] = Json::array({{{"primitives", primitives}}});
    json["buffers"] = Json::array({{{"byteLength", data_bytes()}}});
    const std::int64_t vector_bytes = file_->section_bytes(kPositions);
    json["bufferViews"] = {View(kPositions, 0), View(kNormals, vector_bytes),
                           View(kIndices, 2 * vector_bytes)};
    json["accessors"] = accessors;
    return json;
  }

  [[nodiscard]] Json View(Section section, std::int64_t offset) const {
    Json view = {{"buffer", 0},
                 {"byteOffset", offset},
                 {"byteLength", file_->section_bytes(section)},
                 {"target", section == kIndices ? kElementArrayBuffer : kArrayBuffer}};
    if (parts_.size() > 1 && section != kIndices) {  // of attributes that share a view
      view["byteStride"] = kGlbVectorBytes;
    }
    return view;
  }

  // Returns the primitive of a surface, and adds its accessors and its material.
  Json AddPrimitive(int surface_index, Json* accessors, Json* json) const {
    const Part& part = parts_[static_cast<std::size_t>(surface_index)];
    const auto add_accessor = [&](Section section, int type, std::int64_t first, std::int64_t count,
                                  const char* shape) {
      Json accessor = {{"bufferView", static_cast<int>(section)}};
      if (first > 0) {
        accessor["byteOffset"] = first * kGlbVectorBytes;  // a triangle has the same size
      }
      accessor["componentType"] = type;
      accessor["count"] = count;
      accessor["type"] = shape;
      accessors->push_back(accessor);
      return accessors->size() - 1;
    };
    const std::size_t position =
        add_accessor(kPositions, kFloat, part.first_vertex, part.vertex_count, "VEC3");
    (*accessors)[position]["min"] = ToJson(part.min);
    (*accessors)[position]["max"] = ToJson(part.max);
    const std::size_t normal =
        add_accessor(kNormals, kFloat, part.first_vertex, part.vertex_count, "VEC3");
    const std::size_t indices = add_accessor(kIndices, kUnsignedInt, part.first_triangle,
                                             3 * part.triangle_count, "SCALAR");
    Json primitive = {{"attributes", {{"POSITION", position}, {"NORMAL", normal}}},
                      {"indices", indices},
                      {"mode", kTriangles}};
    if (options_.has_colors()) {
      Json& materials = (*json)["materials"];
      primitive["material"] = materials.size();
      materials.push_back(MakeMaterial(surface_index));
    }
    return primitive;
  }

  [[nodiscard]] Json MakeMaterial(int surface_index) const {
    const frame::Color color = options_.ColorOf(surface_index);
    Json material;
    if (parts_.size() > 1) {
      const MeshSurface& surface = options_.surfaces[static_cast<std::size_t>(surface_index)];
      material["name"] =
          absl::StrCat("surface ", surface_index, ", ",
                       surface.name.empty() ? absl::StrCat("isovalue ", surface.isovalue)
                                            : volume::CleanLabelName(surface.name));
    }
    material["pbrMetallicRoughness"] = {
        {"baseColorFactor", {Linear(color.red), Linear(color.green), Linear(color.blue), 1.0}},
        {"metallicFactor", 0.0},
        {"roughnessFactor", 0.6}};
    material["doubleSided"] = true;
    return material;
  }

  const MeshFileOptions options_;
  std::vector<Part> parts_;  // by surface index
  std::optional<math::Vec3d> origin_;
  std::unique_ptr<SectionedFile> file_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<MeshWriter>> CreateGlb(const MeshFileOptions& options) {
  auto writer = std::make_unique<GlbWriter>(options);
  ISOSCOPE_RETURN_IF_ERROR(writer->Open());
  return writer;
}

}  // namespace isoscope::client
