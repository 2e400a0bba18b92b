// The file has an XML header of a fixed length, which has the field and the step of a series, and
// declares the arrays with their offsets. After
// its "_" follow the arrays, each preceded by its size in bytes (uint64):
//
//   Points (Float32, or Float64 of a mesh with an origin), Normals, Colors (if wanted),
//   SurfaceIndex (of several surfaces: UInt8, or Int32 of more than 256), connectivity (Int32),
//   offsets (Int64)
//
// Connectivity fits 32 bits because there are at most 2^31 - 1 vertices. The offsets 3, 6, 9, ...
// are written at the end.

#include "clients/cpp/mesh_file/vtp_writer.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

#include "clients/cpp/mesh_file/sectioned_file.h"
#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/cli/format.h"

namespace isoscope::client {
namespace {

constexpr std::size_t kHeaderBytes = 2048;
constexpr std::int64_t kSizeBytes = sizeof(std::uint64_t);
constexpr std::int64_t kOffsetsPerWrite = 1 << 16;
constexpr char kTail[] = "\n  </AppendedData>\n</VTKFile>\n";

// An array of one text: VTK writes the codes of its bytes, and a 0.
std::string TextArray(absl::string_view name, const std::string& text) {
  std::string array = absl::StrCat("      <DataArray type=\"String\" Name=\"", name,
                                   "\" NumberOfTuples=\"1\" format=\"ascii\">");
  for (const char c : text) {
    absl::StrAppend(&array, static_cast<int>(static_cast<unsigned char>(c)), " ");
  }
  return absl::StrCat(array, "0</DataArray>\n");
}

std::string NumberArray(absl::string_view type, absl::string_view name, const std::string& number) {
  return absl::StrCat("      <DataArray type=\"", type, "\" Name=\"", name,
                      "\" NumberOfTuples=\"1\" format=\"ascii\">", number, "</DataArray>\n");
}

// The field data of a file; "" if it says none.
std::string FieldDataOf(const std::optional<MeshField>& field) {
  if (!field.has_value()) {
    return "";
  }
  std::string data = TextArray("Field", field->name);
  const auto add_text = [&](absl::string_view name, const std::string& text) {
    data += text.empty() ? "" : TextArray(name, text);
  };
  add_text("FieldComponent", field->component);
  add_text("FieldUnit", field->unit);
  if (field->step.has_value()) {
    data += NumberArray("Int32", "TimeStep", absl::StrCat(*field->step));
  }
  if (field->time.has_value()) {
    data += NumberArray("Float64", "TimeValue", cli::FormatShortest(*field->time));
    add_text("TimeUnit", field->time_unit);
  }
  return absl::StrCat("    <FieldData>\n", data, "    </FieldData>\n");
}

std::string SizePrefix(std::int64_t bytes) {
  std::string prefix;
  base::AppendLittleEndian(static_cast<std::uint64_t>(bytes), &prefix);
  return prefix;
}

absl::string_view BytesOf(const auto& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(values[0])};
}

class VtpWriter : public MeshWriter {
 public:
  explicit VtpWriter(const MeshFileOptions& options)
      : options_(options), field_data_(FieldDataOf(options.field)) {}

  absl::Status Open() {
    ISOSCOPE_ASSIGN_OR_RETURN(
        file_, SectionedFile::Create(options_.path, header_bytes(), connectivity() + 2));
    return absl::OkStatus();
  }

  absl::Status AddPiece(const MeshPiece& piece) override {
    has_doubles_ = piece.origin.has_value();
    ISOSCOPE_RETURN_IF_ERROR(has_doubles_ ? file_->Append(0, BytesOf(WorldPositionsOf(piece)))
                                          : file_->Append(0, BytesOf(piece.positions)));
    ISOSCOPE_RETURN_IF_ERROR(file_->Append(1, BytesOf(piece.normals)));
    if (has_colors()) {
      const std::array<std::uint8_t, 3> color = ToBytes(options_.ColorOf(piece.surface_index));
      std::string colors;
      for (std::int64_t i = 0; i < piece.vertex_count(); ++i) {
        absl::StrAppend(&colors, BytesOf(color));
      }
      ISOSCOPE_RETURN_IF_ERROR(file_->Append(2, colors));
    }
    if (has_indices()) {
      const auto count = static_cast<std::size_t>(piece.vertex_count());
      ISOSCOPE_RETURN_IF_ERROR(
          has_wide_indices()
              ? file_->Append(connectivity() - 1,
                              BytesOf(std::vector<std::int32_t>(count, piece.surface_index)))
              : file_->Append(connectivity() - 1,
                              std::string(count, static_cast<char>(piece.surface_index))));
    }
    return file_->Append(connectivity(), BytesOf(piece.triangles));
  }

  absl::Status Finish() override {
    std::vector<std::int64_t> offsets;
    for (std::int64_t done = 0; done < triangle_count(); done += kOffsetsPerWrite) {
      offsets.clear();
      for (std::int64_t i = done; i < std::min(done + kOffsetsPerWrite, triangle_count()); ++i) {
        offsets.push_back(3 * (i + 1));
      }
      ISOSCOPE_RETURN_IF_ERROR(file_->Append(connectivity() + 1, BytesOf(offsets)));
    }
    std::vector<std::string> between;
    for (std::size_t section = 1; section < connectivity() + 2; ++section) {
      between.push_back(SizePrefix(file_->section_bytes(section)));
    }
    return file_->Finish(MakeHeader(), between, kTail);
  }

  [[nodiscard]] std::int64_t size_bytes() const override { return file_->size_bytes(); }
  [[nodiscard]] DiskUse disk_use() const override {
    DiskUse use = file_->disk_use();
    // The offsets come last.
    const std::int64_t offset_bytes =
        triangle_count() * static_cast<std::int64_t>(sizeof(std::int64_t));
    use.file_bytes += offset_bytes;
    use.peak_bytes += offset_bytes;
    return use;
  }

 private:
  [[nodiscard]] std::size_t header_bytes() const { return kHeaderBytes + field_data_.size(); }
  [[nodiscard]] bool has_colors() const { return options_.has_colors(); }
  [[nodiscard]] bool has_indices() const { return options_.surfaces.size() > 1; }
  [[nodiscard]] bool has_wide_indices() const { return options_.surfaces.size() > kMaxByteIndices; }
  // Returns the section of the connectivity; that of surface indices, if any, is before it.
  [[nodiscard]] std::size_t connectivity() const {
    return std::size_t{2} + (has_colors() ? 1 : 0) + (has_indices() ? 1 : 0);
  }

  // Returns the declaration of an array; the next one follows it.
  std::string Declare(std::size_t section, absl::string_view type, absl::string_view name,
                      int components, std::int64_t* offset) const {
    std::string text =
        absl::StrCat("<DataArray type=\"", type, "\" Name=\"", name, "\" NumberOfComponents=\"",
                     components, "\" format=\"appended\" offset=\"", *offset, "\"/>");
    *offset += kSizeBytes + file_->section_bytes(section);
    return text;
  }

  [[nodiscard]] std::string MakeHeader() const {
    std::int64_t offset = 0;
    const std::string points =
        Declare(0, has_doubles_ ? "Float64" : "Float32", "Points", 3, &offset);
    std::string data = Declare(1, "Float32", "Normals", 3, &offset);
    if (has_colors()) {
      absl::StrAppend(&data, "\n        ", Declare(2, "UInt8", "Colors", 3, &offset));
    }
    if (has_indices()) {
      absl::StrAppend(&data, "\n        ",
                      Declare(connectivity() - 1, has_wide_indices() ? "Int32" : "UInt8",
                              "SurfaceIndex", 1, &offset));
    }
    std::string cells = Declare(connectivity(), "Int32", "connectivity", 1, &offset);
    absl::StrAppend(&cells, "\n        ",
                    Declare(connectivity() + 1, "Int64", "offsets", 1, &offset));
    const std::string head = absl::StrCat(
        "<?xml version=\"1.0\"?>\n"
        "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" "
        "header_type=\"UInt64\">\n"
        "  <PolyData>\n",
        field_data_, "    <Piece NumberOfPoints=\"", vertex_count(), "\" NumberOfPolys=\"",
        triangle_count(), "\">\n      <PointData Normals=\"Normals\"",
        has_colors()    ? " Scalars=\"Colors\""
        : has_indices() ? " Scalars=\"SurfaceIndex\""
                        : "",
        ">\n        ", data, "\n      </PointData>\n      <Points>\n        ", points,
        "\n      </Points>\n      <Polys>\n        ", cells,
        "\n      </Polys>\n    </Piece>\n  </PolyData>\n"
        "  <AppendedData encoding=\"raw\">\n");
    // Spaces up to the fixed length, then the mark and the size of the first array.
    ISOSCOPE_CHECK_LE(head.size() + 1 + kSizeBytes, header_bytes());
    const std::string padding(header_bytes() - head.size() - 1 - kSizeBytes, ' ');
    return absl::StrCat(head, padding, "_", SizePrefix(file_->section_bytes(0)));
  }

  const MeshFileOptions options_;
  const std::string field_data_;
  bool has_doubles_ = false;
  std::unique_ptr<SectionedFile> file_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<MeshWriter>> CreateVtp(const MeshFileOptions& options) {
  auto writer = std::make_unique<VtpWriter>(options);
  ISOSCOPE_RETURN_IF_ERROR(writer->Open());
  return writer;
}

}  // namespace isoscope::client
