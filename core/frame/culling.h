// The ways of leaving out invisible blocks.

#ifndef ISOSCOPE_CORE_FRAME_CULLING_H_
#define ISOSCOPE_CORE_FRAME_CULLING_H_

namespace isoscope::frame {

enum class Culling {
  kDepth,  // exact: the picture of kNone, bit for bit
  kMask,   // the paper's one-bit mask: approximate, for comparison
  kNone,   // everything is drawn: for reference
};

}  // namespace isoscope::frame

#endif  // ISOSCOPE_CORE_FRAME_CULLING_H_
