// OME-XML, which microscopes write into the first page of a TIFF stack.

#ifndef ISOSCOPE_CORE_FORMATS_STACKS_OME_STACK_H_
#define ISOSCOPE_CORE_FORMATS_STACKS_OME_STACK_H_

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/grid/stack_layout.h"

namespace isoscope::source {

bool IsOmeXml(absl::string_view description);

struct OmeStack {
  StackLayout layout;       // of the first image; planes that nobody names have no file
  std::int64_t size_x = 0;  // samples of a plane, as the XML has them
  std::int64_t size_y = 0;
  // A file of the same folder that holds the XML in place of this one; else empty.
  std::string companion{};
};

// Parses the XML. `own_name` is the name of its file, without a folder, and `own_planes` the number
// of planes in it. Sizes of pixels are in the unit of the first axis; if some are missing, the
// layout says so (StackLayout::distances). INVALID_ARGUMENT: as ParseXmlTags; sizes that are none;
// a plane of two pages, or a page of two planes; pages of the file that are no plane, if the XML
// has but one image;
// more than kMaxStackPlanes; another order of axes; a file outside the folder. The messages name
// `path`.
absl::StatusOr<OmeStack> ParseOmeXml(absl::string_view xml, const std::string& path,
                                     const std::string& own_name, std::int64_t own_planes);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_STACKS_OME_STACK_H_
