#include "clients/cpp/mesh_file/mesh_writer.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"

#include "clients/cpp/mesh_file/glb_writer.h"
#include "clients/cpp/mesh_file/obj_writer.h"
#include "clients/cpp/mesh_file/ply_writer.h"
#include "clients/cpp/mesh_file/stl_writer.h"
#include "clients/cpp/mesh_file/vtp_writer.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/cli/usage.h"
#include "core/frame/appearance.h"

namespace isoscope::client {
namespace {

constexpr std::array<std::pair<absl::string_view, MeshFormat>, 5> kFormats = {
    {{"ply", MeshFormat::kPly},
     {"stl", MeshFormat::kStl},
     {"obj", MeshFormat::kObj},
     {"glb", MeshFormat::kGlb},
     {"vtp", MeshFormat::kVtp}}};

}  // namespace

absl::string_view NameOf(MeshFormat format) {
  for (const auto& [name, value] : kFormats) {
    if (value == format) {
      return name;
    }
  }
  base::CheckFailed(__FILE__, __LINE__, "mesh format out of range");
}

absl::StatusOr<MeshFormat> ParseMeshFormat(absl::string_view text) {
  for (const auto& [name, value] : kFormats) {
    if (absl::AsciiStrToLower(text) == name) {
      return value;
    }
  }
  return absl::InvalidArgumentError(
      absl::StrCat("'", text, "' is none of: ply, stl, obj, glb, vtp"));
}

absl::StatusOr<MeshFormat> MeshFormatOf(const std::string& path,
                                        const std::optional<MeshFormat>& format) {
  const std::string suffix = std::filesystem::path(path).extension().string();
  if (suffix.empty()) {
    return format.value_or(MeshFormat::kPly);
  }
  const absl::StatusOr<MeshFormat> named_format = ParseMeshFormat(suffix.substr(1));
  if (!named_format.ok() && !format) {
    return absl::InvalidArgumentError(
        absl::StrCat("--output '", path, "': the suffix '", suffix,
                     "' is that of no format of meshes: .ply, .stl, .obj, .glb, "
                     ".vtp; or give --format"));
  }
  if (named_format.ok() && format && *named_format != *format) {
    return absl::InvalidArgumentError(absl::StrCat("--output '", path, "': the suffix '", suffix,
                                                   "' is not that of --format ", NameOf(*format)));
  }
  return format ? *format : *named_format;
}

bool MeshFileOptions::has_colors() const {
  return std::any_of(surfaces.begin(), surfaces.end(),
                     [](const MeshSurface& surface) { return surface.color.has_value(); });
}

frame::Color MeshFileOptions::ColorOf(int surface_index) const {
  const image::Rgba8 clay = frame::Appearance().base_color;
  constexpr float kMax = 255;
  return surfaces[static_cast<std::size_t>(surface_index)].color.value_or(
      frame::Color{.red = static_cast<float>(clay.r) / kMax,
                   .green = static_cast<float>(clay.g) / kMax,
                   .blue = static_cast<float>(clay.b) / kMax});
}

bool HasDoubles(MeshFormat format) {
  return format == MeshFormat::kPly || format == MeshFormat::kObj || format == MeshFormat::kVtp;
}

std::vector<double> WorldPositionsOf(const MeshPiece& piece) {
  const math::Vec3d origin = piece.origin.value_or(math::Vec3d{});
  std::vector<double> world(piece.positions.size());
  for (std::size_t i = 0; i < world.size(); ++i) {
    world[i] = origin[static_cast<int>(i % 3)] + static_cast<double>(piece.positions[i]);
  }
  return world;
}

absl::Status Validate(const MeshFileOptions& options) {
  if (options.format == MeshFormat::kStl && options.has_colors()) {
    return absl::InvalidArgumentError(
        "colours can't be written to STL, which has none: leave out --color, and the colours of "
        "--surface and --label");
  }
  return absl::OkStatus();
}

std::array<std::uint8_t, 3> ToBytes(const frame::Color& color) {
  const auto byte = [](float value) {
    return static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0F, 1.0F) * 255));
  };
  return {byte(color.red), byte(color.green), byte(color.blue)};
}

absl::StatusOr<std::unique_ptr<MeshWriter>> MeshWriter::Create(const MeshFileOptions& options) {
  switch (options.format) {
    case MeshFormat::kPly:
      return CreatePly(options);
    case MeshFormat::kStl:
      return CreateStl(options);
    case MeshFormat::kObj:
      return CreateObj(options);
    case MeshFormat::kGlb:
      return CreateGlb(options);
    case MeshFormat::kVtp:
      return CreateVtp(options);
  }
  base::CheckFailed(__FILE__, __LINE__, "mesh format out of range");
}

absl::Status MeshWriter::Add(const MeshPiece& piece) {
  ISOSCOPE_RETURN_IF_ERROR(AddPiece(piece));
  vertex_count_ += piece.vertex_count();
  triangle_count_ += piece.triangle_count();
  return absl::OkStatus();
}

}  // namespace isoscope::client
