// A VTK image with all its arrays: one file (.vti, .vtr), or pieces that tile it (.pvti).

#ifndef ISOSCOPE_CORE_FORMATS_VTK_VTK_IMAGE_H_
#define ISOSCOPE_CORE_FORMATS_VTK_VTK_IMAGE_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/vtk/vti_header.h"
#include "core/source/bytes/part_path.h"
#include "core/source/grid/grid_rules.h"
#include "core/source/volume_series.h"

namespace isoscope::source {

// Thread-compatible.
class VtkImage {
 public:
  virtual ~VtkImage() = default;

  [[nodiscard]] const std::string& path() const { return path_; }
  // The arrays that are fields: at least one, all of points, or all of cells if no point array is
  // of numbers. Names are unique and not empty.
  [[nodiscard]] const std::vector<VtiArray>& arrays() const { return arrays_; }
  // The grid of the points, or of the cells' centres.
  [[nodiscard]] const volume::GridGeometry& geometry() const { return geometry_; }
  // The component of the only array that the path names; not set if it names none.
  [[nodiscard]] const std::optional<std::int64_t>& component() const { return component_; }
  // TimeValue, of the first piece.
  [[nodiscard]] const std::optional<double>& time() const { return time_; }
  // UNITS_LABEL of TimeValue, and the attribute Unit of ImageData, which isoscope writes; or empty.
  [[nodiscard]] const std::string& time_unit() const { return time_unit_; }
  [[nodiscard]] const std::string& length_unit() const { return length_unit_; }

  // Opens one component of arrays()[array]. Errors as OpenVtiArray. REQUIRES: indices in range.
  virtual absl::StatusOr<std::unique_ptr<VolumeSource>> Open(std::size_t array,
                                                             std::int64_t component) = 0;

 protected:
  // "run.vti:velocity:2"; where the path names all that there is, the path. It is the source of a
  // dataset, and a part of its id.
  [[nodiscard]] std::string NameOf(std::size_t array, std::int64_t component) const;

  // Takes the units of `header`, and its arrays that are fields: that which `part` names, or all.
  // Errors as OpenVtkImage.
  absl::Status SetArrays(const VtiHeader& header, const std::string& part);

  std::string path_;
  std::string part_;  // that the path names; may be empty
  std::vector<VtiArray> arrays_;
  std::optional<std::int64_t> component_;
  volume::GridGeometry geometry_;
  std::optional<double> time_;
  std::string time_unit_;
  std::string length_unit_;
};

// True, with the parts, if the name is that of such a file, with or without an array.
bool SplitVtkImagePath(const std::string& path, PartPath* parts);

// Opens the image, with that only which `part` names, if it is not empty: an array ("velocity") or
// a component of one ("velocity:2"). Reads headers, of .pvti those of all pieces, and checks that
// these tile its extent; pieces may overlap, then the first one that has a sample counts. Arrays of
// points, else of cells; of those numbers alone, and not VTK's marks of ghosts. NOT_FOUND: a file,
// or the array (lists those there are). INVALID_ARGUMENT: no such file; no array of numbers; two
// arrays of one name; a piece that has not the extent, the grid or an array that it should have;
// part of the extent that no piece has.
absl::StatusOr<std::unique_ptr<VtkImage>> OpenVtkImage(const std::string& path,
                                                       const std::string& part = "",
                                                       const GridRules& rules = {});

// Returns an array as a field.
SourceField FieldOfVtiArray(const VtiArray& array);

// Returns a .pvti file and the files of its pieces. Errors as OpenVtkImage, of the file alone.
absl::StatusOr<std::vector<std::string>> FilesOfPvti(const std::string& path);

// Opens a .pvti file (pvti_image.cc). As OpenVtkImage.
absl::StatusOr<std::unique_ptr<VtkImage>> OpenPvtiImage(const std::string& path,
                                                        const std::string& part,
                                                        const GridRules& rules = {});

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_VTK_VTK_IMAGE_H_
