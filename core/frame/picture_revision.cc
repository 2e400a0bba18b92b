#include "core/frame/picture_revision.h"

#include "absl/strings/str_cat.h"

namespace isoscope::frame {

std::string ToString(const PictureRevision& revision) {
  return revision.back_end == BackEnd::kCpu
             ? absl::StrCat(revision.number, " cpu")
             : absl::StrCat(revision.number, " egl (", revision.driver, ")");
}

}  // namespace isoscope::frame
