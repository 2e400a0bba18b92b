#include "core/formats/vtk/vtr_image.h"

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/formats/vtk/vti_grid.h"
#include "core/formats/vtk/vti_header.h"
#include "core/formats/vtk/vti_source.h"
#include "core/io/file.h"
#include "core/source/adapt/resampled_source.h"
#include "core/source/grid/rectilinear_grid.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxVtrAxis = std::int64_t{1} << 24;

absl::StatusOr<RectilinearAxes> ReadVtrAxes(const io::RandomAccessFile& file,
                                            const VtiHeader& header) {
  ISOSCOPE_ASSIGN_OR_RETURN(const VtkExtent extent, WholeVtiExtent(header, file.path()));
  if (header.coordinates.size() != 3) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d arrays in its Coordinates; expected those of x, y and z",
                        file.path(), header.coordinates.size()));
  }
  RectilinearAxes axes;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::int64_t points = extent[2 * axis + 1] - extent[2 * axis] + 1;
    const VtiArray& array = header.coordinates[axis];
    if (points < 1 || points > kMaxVtrAxis) {
      return absl::InvalidArgumentError(absl::StrFormat("%s: %d points along %c; expected 1 to %d",
                                                        file.path(), points, "xyz"[axis],
                                                        kMaxVtrAxis));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(axes.points[axis], ReadVtiNumbers(file, header, array, points));
    axes.is_single = axes.is_single || array.type == "Float32";
  }
  return axes;
}

class VtrImage final : public VtkImage {
 public:
  static absl::StatusOr<std::unique_ptr<VtkImage>> Open(const std::string& path,
                                                        const std::string& part,
                                                        const GridRules& rules) {
    auto image = std::make_unique<VtrImage>();
    image->path_ = path;
    image->rules_ = rules;
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                              io::OpenRandomAccessFile(path));
    ISOSCOPE_ASSIGN_OR_RETURN(image->header_, ReadWholeVtiHeader(*file));
    if (!image->header_.is_rectilinear) {
      return absl::InvalidArgumentError(absl::StrCat(
          path, image->header_.is_image
                    ? ": ImageData; expected a RectilinearGrid: rename it to end in .vti"
                    : ": no VTK RectilinearGrid file, though its name says so"));
    }
    ISOSCOPE_RETURN_IF_ERROR(image->SetArrays(image->header_, part));
    ISOSCOPE_ASSIGN_OR_RETURN(RectilinearAxes axes, ReadVtrAxes(*file, image->header_));
    auto grid = RectilinearGridOf(std::move(axes), image->arrays_.front().is_of_cells, rules);
    if (!grid.ok()) {
      return absl::Status(grid.status().code(), absl::StrCat(path, ": ", grid.status().message()));
    }
    image->geometry_ = grid->geometry;
    image->distances_ = std::move(grid->distances);
    ISOSCOPE_ASSIGN_OR_RETURN(image->time_, ReadVtiTime(path, image->header_));
    return image;
  }

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(std::size_t array,
                                                     std::int64_t component) override {
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::unique_ptr<VolumeSource> source,
        OpenVtiArray(path_, header_, {.array = arrays_[array], .component = component}, geometry_,
                     NameOf(array, component)));
    return ResampleSource(std::move(source), distances_, rules_.fill);
  }

 private:
  VtiHeader header_;
  GridRules rules_;
  AxisDistances distances_{};
};

}  // namespace

absl::StatusOr<std::unique_ptr<VtkImage>> OpenVtrImage(const std::string& path,
                                                       const std::string& part,
                                                       const GridRules& rules) {
  return VtrImage::Open(path, part, rules);
}

}  // namespace isoscope::source
