// Images of OME-Zarr, versions 0.4 and 0.5: axes, levels, positions and channels, as the attributes
// of a group say them. Versions before are read as far as they say the same.

#ifndef ISOSCOPE_CORE_FORMATS_ZARR_OME_IMAGE_H_
#define ISOSCOPE_CORE_FORMATS_ZARR_OME_IMAGE_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/formats/zarr/zarr_json.h"
#include "core/source/chunks/chunk_box.h"
#include "core/source/grid/grid_rules.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/label.h"

namespace isoscope::source {

struct OmeAxis {
  char letter = '?';   // T, C, Z, Y or X
  std::string unit{};  // "micrometer"; may be empty
};

// The place of element i along an axis: translation + scale * i.
struct OmeLevel {
  std::string path{};  // of its array, from the group on
  std::vector<double> scale{};
  std::vector<double> translation{};
};

struct OmeImage {
  std::string name{};  // may be empty
  std::vector<OmeAxis> axes{};
  std::vector<OmeLevel> levels{};       // the finest first
  std::vector<std::string> channels{};  // labels; may be fewer than channels, or empty
};

// The images of a group, at most 64; none if it has none. INVALID_ARGUMENT, with `name` in front: of
// the first one a version that is unknown; axes, levels or transformations that make no sense or are
// unknown.
struct OmeImages {
  std::vector<OmeImage> images{};
  absl::Status others;  // what is wrong with one of the others, which is left out
};
absl::StatusOr<OmeImages> OmeImagesIn(const ZarrJson& attributes, const std::string& name);
// The first one; not set if there is none.
absl::StatusOr<std::optional<OmeImage>> OmeImageIn(const ZarrJson& attributes,
                                                   const std::string& name);
// Values with names and colours, by value, as the attributes of a label image ("image-label") have
// them; none without such a table. The name is the member "name" of a property, else "label",
// "class", or the only text. INVALID_ARGUMENT: a table that makes no sense; volume::ValidateLabels.
// The message is to follow a name and a colon.
absl::StatusOr<std::vector<volume::Label>> OmeLabelTableIn(const ZarrJson& attributes);
// The names of label images that the attributes of a group "labels" list.
std::vector<std::string> OmeLabelsIn(const ZarrJson& attributes);
// Says why a group without an image is none: a plate, a collection. "" if it is neither.
std::string OmeCollectionIn(const ZarrJson& attributes);

// The axes of space in the order of the array, the fastest one last. Not set unless there are three.
std::optional<std::array<std::size_t, 3>> OmeSpaceOf(const std::vector<OmeAxis>& axes);
// "t, c, z, y, x"
std::string DescribeOmeAxes(const std::vector<OmeAxis>& axes);

// The grid of a level with that many elements, and the unit of its positions: that of the axes;
// metres if they have several. INVALID_ARGUMENT: distances of 0 or that are not finite, and units on
// some axes only, unless the rules give the distances; volume::Validate. The message is to follow a
// name and a colon. REQUIRES: OmeSpaceOf.
struct OmeGrid {
  volume::GridGeometry geometry{};
  std::string unit{};
};
absl::StatusOr<OmeGrid> OmeGridOf(const OmeImage& image, std::size_t level, const ChunkIndex& dims,
                                  const GridRules& rules);

// A sentence without its end if a level does not lie where means of samples of the finest level do:
// level 0's samples lie at the ends of its cells, the mean of n of them (n - 1) / 2 further. "" if
// it does.
std::string OmeLevelNote(const OmeImage& image, std::size_t level, const ChunkIndex& finest_dims,
                         const ChunkIndex& dims);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ZARR_OME_IMAGE_H_
