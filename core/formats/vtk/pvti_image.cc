// A .pvti file is a small XML file; the samples lie in pieces, each a .vti file of its own:
//
//   <VTKFile type="PImageData" version="0.1" byte_order="LittleEndian">
//    <PImageData WholeExtent="0 20 0 10 0 10" GhostLevel="0" Origin="0 0 0" Spacing="1 1 1">
//     <PPointData Scalars="p">
//      <PDataArray type="Float32" Name="p"/>
//     </PPointData>
//     <Piece Extent="0 10 0 10 0 10" Source="run_0.vti"/>
//     <Piece Extent="10 20 0 10 0 10" Source="run_1.vti"/>
//    </PImageData>
//   </VTKFile>
//
// Extents are of points, inclusive: neighbours share a plane of points, and no cell. The file of a
// piece may hold more around it (ghosts). Source: VTK's file format description, "XML File
// Formats", https://docs.vtk.org.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/formats/vtk/vti_grid.h"
#include "core/formats/vtk/vti_source.h"
#include "core/formats/vtk/vtk_image.h"
#include "core/io/file.h"
#include "core/source/adapt/pieces_source.h"
#include "core/source/bytes/xml_tags.h"
#include "core/source/grid/grid_faults.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMaxPieces = 4096;
constexpr std::size_t kMaxPieceArrays = 4096;
constexpr std::int64_t kMaxPieceComponents = 4096;

struct PvtiPiece {
  VtkExtent extent{};
  std::string file;  // as it is opened
};

// The XML: the header has the arrays that all pieces have, without a place in a file.
struct PvtiHeader {
  VtiHeader header;
  std::vector<PvtiPiece> pieces;
};

absl::Status AddArray(const XmlTag& tag, VtiHeader* header) {
  VtiArray array{
      .name = tag.Get("Name"), .type = tag.Get("type"), .is_of_cells = tag.parent == "PCellData"};
  const std::string components = tag.Get("NumberOfComponents");
  if (!components.empty() && (!absl::SimpleAtoi(components, &array.components) ||
                              array.components < 1 || array.components > kMaxPieceComponents)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("array \"%s\" of %s components; expected 1 to %d", array.name, components,
                        kMaxPieceComponents));
  }
  if (header->arrays.size() == kMaxPieceArrays) {
    return absl::InvalidArgumentError(absl::StrCat("more than ", kMaxPieceArrays, " arrays"));
  }
  header->arrays.push_back(std::move(array));
  return absl::OkStatus();
}

absl::StatusOr<PvtiHeader> ReadPvtiHeader(const std::string& path) {
  PvtiHeader read;
  const std::string folder = path.substr(0, path.rfind('/') + 1);  // "" if there is none
  ISOSCOPE_RETURN_IF_ERROR(
      ReadXmlTags(path, "VTK PImageData file", [&](const XmlTag& tag) -> absl::Status {
        if (tag.name == "PImageData") {
          read.header.is_image = true;
          read.header.image = tag.attributes;
        } else if (tag.name == "PDataArray" &&
                   (tag.parent == "PPointData" || tag.parent == "PCellData")) {
          return AddArray(tag, &read.header);
        } else if (tag.name == "Piece") {
          const std::string file = tag.Get("Source");
          if (file.empty() || read.pieces.size() == kMaxPieces) {
            return absl::InvalidArgumentError(
                absl::StrFormat("a piece without a Source, or more than %d pieces", kMaxPieces));
          }
          ISOSCOPE_ASSIGN_OR_RETURN(const VtkExtent extent,
                                    ParseVtkExtent(tag.Get("Extent"), "Extent", file));
          read.pieces.push_back(
              {.extent = extent, .file = absl::StartsWith(file, "/") ? file : folder + file});
        }
        return absl::OkStatus();
      }));
  read.header.piece_count = static_cast<int>(read.pieces.size());
  return read;
}

// Writers leave pieces without samples: "0 -1 0 -1 0 -1".
bool IsEmpty(const VtkExtent& extent, bool is_of_cells) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (extent[2 * axis + 1] - extent[2 * axis] < (is_of_cells ? 1 : 0)) {
      return true;
    }
  }
  return false;
}

bool Contains(const VtkExtent& outer, const VtkExtent& inner) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (inner[2 * axis] < outer[2 * axis] || inner[2 * axis + 1] > outer[2 * axis + 1]) {
      return false;
    }
  }
  return true;
}

absl::StatusOr<VtiHeader> ReadPieceHeader(const std::string& file) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> opened,
                            io::OpenRandomAccessFile(file));
  ISOSCOPE_ASSIGN_OR_RETURN(VtiHeader header, ReadWholeVtiHeader(*opened));
  if (header.is_rectilinear) {
    return absl::InvalidArgumentError(
        absl::StrCat(file, ": a piece that is a RectilinearGrid; expected ImageData"));
  }
  return header;
}

const VtiArray* FindLike(const VtiHeader& header, const VtiArray& like) {
  const auto found =
      std::find_if(header.arrays.begin(), header.arrays.end(), [&](const VtiArray& array) {
        return array.name == like.name && array.is_of_cells == like.is_of_cells;
      });
  return found == header.arrays.end() ? nullptr : &*found;
}

class PvtiImage final : public VtkImage {
 public:
  static absl::StatusOr<std::unique_ptr<VtkImage>> Open(const std::string& path,
                                                        const std::string& part,
                                                        const GridRules& rules) {
    auto image = std::make_unique<PvtiImage>();
    image->path_ = path;
    image->rules_ = rules;
    ISOSCOPE_ASSIGN_OR_RETURN(PvtiHeader read, ReadPvtiHeader(path));
    ISOSCOPE_RETURN_IF_ERROR(image->SetArrays(read.header, part));
    ISOSCOPE_RETURN_IF_ERROR(image->SetGeometry(read.header));
    for (PvtiPiece& piece : read.pieces) {
      if (!IsEmpty(piece.extent, image->is_of_cells())) {
        image->pieces_.push_back(std::move(piece));
      }
    }
    ISOSCOPE_RETURN_IF_ERROR(image->CheckPieces());
    return image;
  }

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(std::size_t array,
                                                     std::int64_t component) override {
    // A copy of what is needed: the source may outlive the image.
    const OpenPiece open = [pieces = pieces_, grids = grids_, like = arrays_[array], component,
                            name = NameOf(array, component)](
                               std::size_t index) -> absl::StatusOr<std::unique_ptr<VolumeSource>> {
      const std::string& file = pieces[index].file;
      ISOSCOPE_ASSIGN_OR_RETURN(const VtiHeader header, ReadPieceHeader(file));
      const VtiArray* found = FindLike(header, like);
      if (found == nullptr || found->type != like.type || found->components != like.components) {
        return absl::DataLossError(
            absl::StrFormat("%s: array \"%s\" is not what it was", file, like.name));
      }
      return OpenVtiArray(file, header, {.array = *found, .component = component}, grids[index],
                          absl::StrCat(name, ", piece ", file));
    };
    std::int64_t piece_bytes = 0;
    volume::ScalarType type{};
    for (std::size_t index = 0; index < pieces_.size(); ++index) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<VolumeSource> piece, open(index));
      piece_bytes = std::max(piece_bytes, piece->info().memory_bytes);
      type = piece->info().type;
    }
    return MakePiecesSource({.name = NameOf(array, component), .geometry = geometry_, .type = type},
                            boxes_, piece_bytes, open);
  }

 private:
  [[nodiscard]] bool is_of_cells() const { return arrays_.front().is_of_cells; }

  absl::Status SetGeometry(const VtiHeader& header) {
    image_ = header.image;
    const auto whole = image_.find("WholeExtent");
    ISOSCOPE_ASSIGN_OR_RETURN(
        extent_, ParseVtkExtent(whole == image_.end() ? "" : whole->second, "WholeExtent", path_));
    ISOSCOPE_ASSIGN_OR_RETURN(geometry_, VtkGridOf(image_, extent_, is_of_cells(), path_));
    ISOSCOPE_RETURN_IF_ERROR(TakeGridByRules(path_, rules_, &geometry_));
    const absl::Status valid = volume::Validate(geometry_);
    if (!valid.ok()) {
      return absl::Status(valid.code(), absl::StrCat(path_, ": ", valid.message()));
    }
    return absl::OkStatus();
  }

  absl::Status CheckPieces() {
    for (std::size_t index = 0; index < pieces_.size(); ++index) {
      ISOSCOPE_RETURN_IF_ERROR(CheckPiece(index));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<math::Index3> gap,
                              FindGap(geometry_.sample_dims, boxes_));
    if (gap.has_value()) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: none of its %d pieces has the %s (%d, %d, %d) of its extent %s", path_,
          pieces_.size(), is_of_cells() ? "cell" : "point", gap->x + extent_[0],
          gap->y + extent_[2], gap->z + extent_[4], absl::StrJoin(extent_, " ")));
    }
    return absl::OkStatus();
  }

  absl::Status CheckPiece(std::size_t index) {
    const PvtiPiece& piece = pieces_[index];
    const VtkExtent& extent = piece.extent;
    ISOSCOPE_ASSIGN_OR_RETURN(const VtiHeader header, ReadPieceHeader(piece.file));
    ISOSCOPE_ASSIGN_OR_RETURN(const VtkExtent held,
                              ParseVtkExtent(header.piece_extent, "Extent", piece.file));
    if (header.piece_count != 1 || !Contains(held, extent) || !Contains(extent_, extent)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: piece %s has the extent %s, its file %s in %d pieces, of %s in all; expected each "
          "within the next, and a file of one piece",
          path_, piece.file, absl::StrJoin(extent, " "), header.piece_extent, header.piece_count,
          absl::StrJoin(extent_, " ")));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(volume::GridGeometry grid,
                              VtkGridOf(header.image, held, is_of_cells(), piece.file));
    ISOSCOPE_RETURN_IF_ERROR(TakeGridByRules(piece.file, rules_, &grid));
    ISOSCOPE_ASSIGN_OR_RETURN(volume::GridGeometry expected,
                              VtkGridOf(image_, held, is_of_cells(), path_));
    ISOSCOPE_RETURN_IF_ERROR(TakeGridByRules(path_, rules_, &expected));
    const math::Index3& dims = grid.sample_dims;
    if (grid != expected ||
        static_cast<double>(dims.x) * static_cast<double>(dims.y) * static_cast<double>(dims.z) >
            0x1p62) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: its Origin, Spacing or Direction is not that of %s, whose piece it "
                          "is; or it is too large",
                          piece.file, path_));
    }
    ISOSCOPE_RETURN_IF_ERROR(CheckArrays(header, piece.file));
    SamplePiece box;
    for (int axis = 0; axis < 3; ++axis) {
      const auto low = 2 * static_cast<std::size_t>(axis);
      box.begin[axis] = extent[low] - extent_[low];
      box.end[axis] = extent[low + 1] - extent_[low] + (is_of_cells() ? 0 : 1);
      box.first[axis] = held[low] - extent_[low];
    }
    boxes_.push_back(box);
    grids_.push_back(grid);
    if (index == 0) {
      ISOSCOPE_ASSIGN_OR_RETURN(time_, ReadVtiTime(piece.file, header));
    }
    return absl::OkStatus();
  }

  // Takes units and names of components from the first piece.
  absl::Status CheckArrays(const VtiHeader& header, const std::string& file) {
    for (VtiArray& array : arrays_) {
      const VtiArray* found = FindLike(header, array);
      if (found == nullptr || found->type != array.type || found->components != array.components) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "%s: expected a %s array \"%s\", %s of %d components, as %s says; it has %s", file,
            array.is_of_cells ? "cell" : "point", array.name, array.type, array.components, path_,
            found == nullptr ? "none of that name"
                             : absl::StrFormat("%s of %d", found->type, found->components)));
      }
      if (boxes_.empty()) {
        array.component_names = found->component_names;
        array.unit = found->unit;
      }
    }
    return absl::OkStatus();
  }

  GridRules rules_;
  VtiHeader::Attributes image_;
  VtkExtent extent_{};
  std::vector<PvtiPiece> pieces_;
  // By piece:
  std::vector<SamplePiece> boxes_;
  std::vector<volume::GridGeometry> grids_;  // of all samples in its file
};

}  // namespace

absl::StatusOr<std::vector<std::string>> FilesOfPvti(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const PvtiHeader read, ReadPvtiHeader(path));
  std::vector<std::string> files{path};
  for (const PvtiPiece& piece : read.pieces) {
    if (!IsEmpty(piece.extent, /*is_of_cells=*/false)) {
      files.push_back(piece.file);
    }
  }
  return files;
}

absl::StatusOr<std::unique_ptr<VtkImage>> OpenPvtiImage(const std::string& path,
                                                        const std::string& part,
                                                        const GridRules& rules) {
  return PvtiImage::Open(path, part, rules);
}

}  // namespace isoscope::source
