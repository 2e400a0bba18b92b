// The file:
//
//   "glTF", 2, length                   12 bytes
//   length, "JSON", text                the text is filled up with spaces to a fixed length,
//   because
//                                       its counts and bounds are known last
//   length, "BIN\0", positions, normals, indices
//
// Sources: glTF 2.0 specification, sections 3.6 (buffers, accessors), 3.9 (materials), 4 (GLB).

#include "client-cli/glb_writer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

#include "absl/strings/str_cat.h"
#include <nlohmann/json.hpp>

#include "client-cli/sectioned_file.h"
#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"

namespace isoscope::cli {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kFileHeadBytes = 12;
constexpr std::size_t kChunkHeadBytes = 8;
constexpr std::size_t kJsonBytes = 2048;
constexpr std::size_t kHeaderBytes = kFileHeadBytes + 2 * kChunkHeadBytes + kJsonBytes;
constexpr std::int64_t kMaxFileBytes = std::numeric_limits<std::uint32_t>::max();
// Values of the specification.
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

class GlbWriter : public MeshWriter {
 public:
  explicit GlbWriter(const MeshFileOptions& options) : color_(options.color) {}

  absl::Status Open(const std::string& path) {
    ISOSCOPE_ASSIGN_OR_RETURN(file_, SectionedFile::Create(path, kHeaderBytes, kSectionCount));
    return absl::OkStatus();
  }

  absl::Status AddPiece(const MeshPiece& piece) override {
    for (std::size_t i = 0; i < piece.positions.size(); ++i) {
      min_[i % 3] = std::min(min_[i % 3], piece.positions[i]);
      max_[i % 3] = std::max(max_[i % 3], piece.positions[i]);
    }
    ISOSCOPE_RETURN_IF_ERROR(file_->Append(kPositions, BytesOf(piece.positions)));
    ISOSCOPE_RETURN_IF_ERROR(file_->Append(kNormals, BytesOf(piece.normals)));
    ISOSCOPE_RETURN_IF_ERROR(file_->Append(kIndices, BytesOf(piece.triangles)));
    if (data_bytes() > kMaxFileBytes - static_cast<std::int64_t>(kHeaderBytes)) {
      return absl::OutOfRangeError(
          "the isosurface is larger than 4 GiB, where a GLB ends: write a .ply, or --simplify it");
    }
    return absl::OkStatus();
  }

  absl::Status Finish() override {
    const auto data = static_cast<std::uint32_t>(data_bytes());
    std::string json = Describe().dump();
    ISOSCOPE_CHECK_LE(json.size(), kJsonBytes);
    json.resize(kJsonBytes, ' ');
    std::string header = "glTF";
    base::AppendLittleEndian(std::uint32_t{2}, &header);
    base::AppendLittleEndian(static_cast<std::uint32_t>(kHeaderBytes) + data, &header);
    base::AppendLittleEndian(static_cast<std::uint32_t>(kJsonBytes), &header);
    absl::StrAppend(&header, "JSON", json);
    base::AppendLittleEndian(data, &header);
    header.append("BIN\0", 4);
    return file_->Finish(header);
  }

  [[nodiscard]] std::int64_t size_bytes() const override { return file_->size_bytes(); }

 private:
  [[nodiscard]] std::int64_t data_bytes() const {
    return file_->section_bytes(kPositions) + file_->section_bytes(kNormals) +
           file_->section_bytes(kIndices);
  }

  [[nodiscard]] Json Describe() const {
    Json json;
    json["asset"] = {{"version", "2.0"}, {"generator", "isoscope"}};
    json["scene"] = 0;
    if (triangle_count() == 0) {  // accessors of no elements are not allowed
      json["scenes"] = Json::array({Json::object()});
      return json;
    }
    json["scenes"] = Json::array({{{"nodes", {0}}}});
    json["nodes"] = Json::array({{{"mesh", 0}}});
    Json primitive = {
        {"attributes", {{"POSITION", 0}, {"NORMAL", 1}}}, {"indices", 2}, {"mode", kTriangles}};
    if (color_) {
      primitive["material"] = 0;
      json["materials"] =
          Json::array({{{"pbrMetallicRoughness",
                         {{"baseColorFactor",
                           {Linear(color_->red), Linear(color_->green), Linear(color_->blue), 1.0}},
                          {"metallicFactor", 0.0},
                          {"roughnessFactor", 0.6}}},
                        {"doubleSided", true}}});
    }
    json["meshes"] = Json::array({{{"primitives", Json::array({primitive})}}});
    json["buffers"] = Json::array({{{"byteLength", data_bytes()}}});
    const auto view = [&](Section section, std::int64_t offset, int target) {
      return Json{{"buffer", 0},
                  {"byteOffset", offset},
                  {"byteLength", file_->section_bytes(section)},
                  {"target", target}};
    };
    const std::int64_t vector_bytes = file_->section_bytes(kPositions);
    json["bufferViews"] = {view(kPositions, 0, kArrayBuffer),
                           view(kNormals, vector_bytes, kArrayBuffer),
                           view(kIndices, 2 * vector_bytes, kElementArrayBuffer)};
    const auto accessor = [](int view_index, int type, std::int64_t count, const char* shape) {
      return Json{
          {"bufferView", view_index}, {"componentType", type}, {"count", count}, {"type", shape}};
    };
    Json positions = accessor(0, kFloat, vertex_count(), "VEC3");
    positions["min"] = {static_cast<double>(min_[0]), static_cast<double>(min_[1]),
                        static_cast<double>(min_[2])};
    positions["max"] = {static_cast<double>(max_[0]), static_cast<double>(max_[1]),
                        static_cast<double>(max_[2])};
    json["accessors"] = {positions, accessor(1, kFloat, vertex_count(), "VEC3"),
                         accessor(2, kUnsignedInt, 3 * triangle_count(), "SCALAR")};
    return json;
  }

  const std::optional<Color> color_;
  std::unique_ptr<SectionedFile> file_;
  std::array<float, 3> min_{std::numeric_limits<float>::infinity(),
                            std::numeric_limits<float>::infinity(),
                            std::numeric_limits<float>::infinity()};
  std::array<float, 3> max_{-std::numeric_limits<float>::infinity(),
                            -std::numeric_limits<float>::infinity(),
                            -std::numeric_limits<float>::infinity()};
};

}  // namespace

absl::StatusOr<std::unique_ptr<MeshWriter>> CreateGlb(const MeshFileOptions& options) {
  auto writer = std::make_unique<GlbWriter>(options);
  ISOSCOPE_RETURN_IF_ERROR(writer->Open(options.path));
  return writer;
}

}  // namespace isoscope::cli
