#include "clients/cpp/mesh_file/obj_writer.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstddef>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

#include "clients/cpp/mesh_file/sectioned_file.h"
#include "core/base/status_macros.h"
#include "core/volume/label.h"

namespace isoscope::client {
namespace {

constexpr std::size_t kTypicalLineBytes = 40;

template <typename T>
void AppendNumber(T value, std::string* out) {
  std::array<char, 32> text;
  const std::to_chars_result end = std::to_chars(text.data(), text.data() + text.size(), value);
  out->append(text.data(), end.ptr);
}

template <typename T>
void AppendVector(absl::string_view word, const T* v, absl::string_view rest, std::string* out) {
  out->append(word.data(), word.size());
  for (int k = 0; k < 3; ++k) {
    out->push_back(' ');
    AppendNumber(v[k], out);
  }
  out->append(rest.data(), rest.size());
}

// A name of an object ends at a space.
std::string ObjectName(std::string name) {
  std::replace_if(
      name.begin(), name.end(),
      [](unsigned char c) { return c <= ' ' || c == '#' || c == '\\' || c == 0x7f; }, '_');
  return name;
}

class ObjWriter : public MeshWriter {
 public:
  explicit ObjWriter(const MeshFileOptions& options) : options_(options) {}

  absl::Status Open() {
    ISOSCOPE_ASSIGN_OR_RETURN(file_, SectionedFile::Create(options_.path, Header().size(), 1));
    return absl::OkStatus();
  }

  // A line may refer to any earlier vertex, so one pass is enough.
  absl::Status AddPiece(const MeshPiece& piece) override {
    std::string text;
    if (piece.surface_index != surface_index_ && !piece.positions.empty()) {
      BeginSurface(piece.surface_index, &text);
    }
    text.reserve((2 * piece.positions.size() / 3 + piece.triangles.size() / 3) * kTypicalLineBytes);
    const std::vector<double> world =
        piece.origin.has_value() ? WorldPositionsOf(piece) : std::vector<double>();
    for (std::size_t i = 0; i < piece.positions.size(); i += 3) {
      if (piece.origin.has_value()) {
        AppendVector("v", &world[i], line_end_, &text);
      } else {
        AppendVector("v", &piece.positions[i], line_end_, &text);
      }
      AppendVector("vn", &piece.normals[i], "\n", &text);
    }
    for (std::size_t i = 0; i < piece.triangles.size(); ++i) {
      text += i % 3 == 0 ? "f " : " ";
      AppendNumber(std::size_t{piece.triangles[i]} + 1, &text);
      text += "//";
      AppendNumber(std::size_t{piece.triangles[i]} + 1, &text);
      if (i % 3 == 2) {
        text += "\n";
      }
    }
    return file_->Append(0, text);
  }

  absl::Status Finish() override { return file_->Finish(Header()); }

  [[nodiscard]] std::int64_t size_bytes() const override { return file_->size_bytes(); }
  [[nodiscard]] DiskUse disk_use() const override { return file_->disk_use(); }

 private:
  [[nodiscard]] std::string Header() const {
    std::string header = "# isoscope\n";
    if (options_.field.has_value()) {
      for (const std::string& line : LinesOf(*options_.field)) {
        absl::StrAppend(&header, "# ", line, "\n");
      }
    }
    return header;
  }

  // Writes one object for each of several surfaces. A triangle could refer to vertices of other
  // objects, but here it does not.
  void BeginSurface(int surface_index, std::string* text) {
    surface_index_ = surface_index;
    line_end_.clear();
    if (options_.has_colors()) {
      const frame::Color color = options_.ColorOf(surface_index);
      const std::array<float, 3> rgb{color.red, color.green, color.blue};
      AppendVector("", rgb.data(), "", &line_end_);
    }
    line_end_ += "\n";
    if (options_.surfaces.size() > 1) {
      const MeshSurface& surface = options_.surfaces[static_cast<std::size_t>(surface_index)];
      absl::StrAppend(text, "o surface_", surface_index, "_");
      if (surface.name.empty()) {
        *text += "isovalue_";
        AppendNumber(surface.isovalue, text);
      } else {
        *text += ObjectName(volume::CleanLabelName(surface.name));
      }
      *text += "\n";
    }
  }

  const MeshFileOptions options_;
  int surface_index_ = -1;  // of the last piece
  std::string line_end_;    // of a vertex of that surface
  std::unique_ptr<SectionedFile> file_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<MeshWriter>> CreateObj(const MeshFileOptions& options) {
  auto writer = std::make_unique<ObjWriter>(options);
  ISOSCOPE_RETURN_IF_ERROR(writer->Open());
  return writer;
}

}  // namespace isoscope::client
