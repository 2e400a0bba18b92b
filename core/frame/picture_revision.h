// The code, back end and driver that decide an agent's pixels, together with the request and
// samples. A frame uses agents of one revision, because pictures of two revisions may differ.

#ifndef ISOSCOPE_CORE_FRAME_PICTURE_REVISION_H_
#define ISOSCOPE_CORE_FRAME_PICTURE_REVISION_H_

#include <string>

#include "core/image/fragment.h"

namespace isoscope::frame {

// Raise it with every change of code that can change a pixel for an unchanged request: extraction,
// normals, projection, rasterising, shading, the order of fragments. docs/numerics.md lists what
// each revision changed.
inline constexpr int kPictureRevisionNumber = 4;

enum class BackEnd { kCpu, kEgl };

struct PictureRevision {
  int number = kPictureRevisionNumber;
  BackEnd back_end = BackEnd::kCpu;
  // The OpenGL that draws for kEgl: vendor, renderer and version. Empty for kCpu.
  std::string driver;

  friend bool operator==(const PictureRevision&, const PictureRevision&) = default;
};

// Returns "4 cpu", "4 egl (llvmpipe ..., OpenGL 4.5 ...)", for messages and logs.
std::string ToString(const PictureRevision& revision);

// OpenGL settles fragments of equal depth before their colours can be compared.
constexpr image::TieRule TieRuleOf(BackEnd back_end) {
  return back_end == BackEnd::kCpu ? image::TieRule::kColor : image::TieRule::kOwner;
}

}  // namespace isoscope::frame

#endif  // ISOSCOPE_CORE_FRAME_PICTURE_REVISION_H_
