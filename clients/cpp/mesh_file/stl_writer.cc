#include "clients/cpp/mesh_file/stl_writer.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <span>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "clients/cpp/mesh_file/sectioned_file.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/io/file_array.h"
#include "core/math/vec.h"

namespace isoscope::client {
namespace {

constexpr std::size_t kTextBytes = 80;
constexpr std::size_t kFacetBytes = 12 * sizeof(float) + sizeof(std::uint16_t);
constexpr std::int64_t kMaxTriangleCount = std::numeric_limits<std::uint32_t>::max();

std::string MakeHeader(const std::optional<MeshField>& field,
                       const std::optional<math::Vec3d>& origin, std::int64_t triangle_count) {
  // Must not begin with "solid", which marks the text format.
  std::string header = "isoscope, binary STL";
  if (origin.has_value()) {
    absl::StrAppend(&header, ", origin ", TextOfOrigin(*origin));
  }
  if (field.has_value()) {
    absl::StrAppend(&header, ", ", absl::StrJoin(LinesOf(*field), ", "));
  }
  header.resize(kTextBytes, ' ');
  base::AppendLittleEndian(static_cast<std::uint32_t>(triangle_count), &header);
  return header;
}

void AppendVector(const math::Vec3d& v, std::string* out) {
  base::AppendLittleEndian(static_cast<float>(v.x), out);
  base::AppendLittleEndian(static_cast<float>(v.y), out);
  base::AppendLittleEndian(static_cast<float>(v.z), out);
}

void AppendFacet(std::span<const float> positions, const std::uint32_t* corners, std::string* out) {
  math::Vec3d p[3];
  for (std::size_t k = 0; k < 3; ++k) {
    const float* const at = positions.data() + 3 * std::size_t{corners[k]};
    p[k] = {static_cast<double>(at[0]), static_cast<double>(at[1]), static_cast<double>(at[2])};
  }
  const math::Vec3d area = math::Cross(p[1] - p[0], p[2] - p[0]);
  const double length = math::Length(area);
  AppendVector(length > 0 ? area * (1 / length) : math::Vec3d{}, out);
  for (const math::Vec3d& corner : p) {
    AppendVector(corner, out);
  }
  base::AppendLittleEndian(std::uint16_t{0}, out);
}

class StlWriter : public MeshWriter {
 public:
  explicit StlWriter(const MeshFileOptions& options) : options_(options) {}

  absl::Status Open() {
    std::string folder = std::filesystem::path(options_.path).parent_path().string();
    ISOSCOPE_ASSIGN_OR_RETURN(io::FileArray<float> positions,
                              io::FileArray<float>::Create(folder.empty() ? "." : folder));
    positions_ = std::move(positions);
    ISOSCOPE_ASSIGN_OR_RETURN(file_, SectionedFile::Create(options_.path, Header().size(), 1));
    return absl::OkStatus();
  }

  absl::Status AddPiece(const MeshPiece& piece) override {
    if (triangle_count() + piece.triangle_count() > kMaxTriangleCount) {
      return absl::OutOfRangeError(absl::StrCat("the isosurface has more than ", kMaxTriangleCount,
                                                " triangles, the most that an STL can hold: "
                                                "write a .ply"));
    }
    origin_ = piece.origin;
    ISOSCOPE_RETURN_IF_ERROR(positions_->Append(piece.positions));
    const std::span<const float> positions = positions_->values();
    std::string facets;
    facets.reserve(static_cast<std::size_t>(piece.triangle_count()) * kFacetBytes);
    for (std::size_t i = 0; i < piece.triangles.size(); i += 3) {
      AppendFacet(positions, &piece.triangles[i], &facets);
    }
    return file_->Append(0, facets);
  }

  absl::Status Finish() override { return file_->Finish(Header()); }

  [[nodiscard]] std::int64_t size_bytes() const override { return file_->size_bytes(); }
  [[nodiscard]] DiskUse disk_use() const override {
    DiskUse use = file_->disk_use();
    use.peak_bytes += static_cast<std::int64_t>(positions_->values().size_bytes());
    return use;
  }

 private:
  [[nodiscard]] std::string Header() const {
    return MakeHeader(options_.field, origin_, triangle_count());
  }

  const MeshFileOptions options_;
  std::optional<io::FileArray<float>> positions_;  // of all vertices so far
  std::optional<math::Vec3d> origin_;
  std::unique_ptr<SectionedFile> file_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<MeshWriter>> CreateStl(const MeshFileOptions& options) {
  auto writer = std::make_unique<StlWriter>(options);
  ISOSCOPE_RETURN_IF_ERROR(writer->Open());
  return writer;
}

}  // namespace isoscope::client
