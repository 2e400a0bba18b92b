// Writes a mesh of unknown size to a file, in the format of its name.

#ifndef ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_WRITER_H_
#define ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_WRITER_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "clients/cpp/mesh_file/mesh_field.h"
#include "clients/cpp/mesh_file/mesh_piece.h"
#include "clients/cpp/mesh_file/sectioned_file.h"
#include "core/frame/color.h"

namespace isoscope::client {

enum class MeshFormat { kPly, kStl, kObj, kGlb, kVtp };
inline constexpr std::array<MeshFormat, 5> kMeshFormats = {
    MeshFormat::kPly, MeshFormat::kStl, MeshFormat::kObj, MeshFormat::kGlb, MeshFormat::kVtp};

// "ply", "stl", "obj", "glb", "vtp".
absl::StatusOr<MeshFormat> ParseMeshFormat(absl::string_view text);
absl::string_view NameOf(MeshFormat format);

// Returns the format of a file: `format` if it is given, else that of the name's suffix; PLY for a
// name without one. INVALID_ARGUMENT if the suffix is unknown, or contradicts `format`.
absl::StatusOr<MeshFormat> MeshFormatOf(const std::string& path,
                                        const std::optional<MeshFormat>& format);

// A surface of a mesh file.
struct MeshSurface {
  double isovalue = 0;
  std::optional<frame::Color> color = std::nullopt;
  std::string name = {};  // of a surface of labels, written up to 256 bytes; empty: its isovalue
};

// The most surfaces whose indices are bytes; those of more are int32.
inline constexpr std::size_t kMaxByteIndices = 256;

struct MeshFileOptions {
  std::string path;
  MeshFormat format = MeshFormat::kPly;
  // At least one, by surface index. A file of several surfaces distinguishes them if its format
  // can: by a surface index of vertices (PLY, VTP), objects (OBJ) or primitives (GLB).
  std::vector<MeshSurface> surfaces = std::vector<MeshSurface>(1);
  // Written as comments (PLY, OBJ), into the title (STL, as far as it fits), as `asset.extras`
  // (GLB) or field data (VTP). Not set: the dataset has no fields, and the file does not say any.
  std::optional<MeshField> field = std::nullopt;

  // Returns false if no surface has a colour: then the file has none.
  [[nodiscard]] bool has_colors() const;
  // Returns the colour of a surface in a file with colours: its own, or the default one of frames.
  [[nodiscard]] frame::Color ColorOf(int surface_index) const;
};

// Returns true if a file of the format has doubles where pieces have an origin.
bool HasDoubles(MeshFormat format);

// INVALID_ARGUMENT if the format lacks a requested feature: STL has no colours.
absl::Status Validate(const MeshFileOptions& options);

// World positions of a piece, x, y, z of each vertex.
std::vector<double> WorldPositionsOf(const MeshPiece& piece);

// Red, green and blue, rounded to 8 bits.
std::array<std::uint8_t, 3> ToBytes(const frame::Color& color);

// A MeshSink that is a file. Where pieces have an origin, PLY, OBJ and VTP have world positions as
// doubles; STL and GLB keep offsets, and say the origin. Pieces go to disk as they arrive, so
// memory holds one at a time. STL is the exception: its triangles repeat their corners, so it keeps
// all positions in a file that is mapped into memory. `path` appears at Finish, in one step.
// Without Finish the destructor removes the written data.
class MeshWriter : public MeshSink {
 public:
  // REQUIRES: Validate is OK. Errors as io::CreateWritableFile.
  static absl::StatusOr<std::unique_ptr<MeshWriter>> Create(const MeshFileOptions& options);

  // Errors of writing. OUT_OF_RANGE, with advice, if the format can't hold as many.
  absl::Status Add(const MeshPiece& piece) final;

  [[nodiscard]] std::int64_t vertex_count() const { return vertex_count_; }
  [[nodiscard]] std::int64_t triangle_count() const { return triangle_count_; }
  // Size of the finished file.
  [[nodiscard]] virtual std::int64_t size_bytes() const = 0;
  // The disk that the pieces so far take, until Finish.
  [[nodiscard]] virtual DiskUse disk_use() const = 0;

 protected:
  MeshWriter() = default;
  // The counts do not include `piece` yet.
  virtual absl::Status AddPiece(const MeshPiece& piece) = 0;

 private:
  std::int64_t vertex_count_ = 0;
  std::int64_t triangle_count_ = 0;
};

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_MESH_FILE_MESH_WRITER_H_
