// Colours in CIELab as sRGB.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_CIELAB_COLOR_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_CIELAB_COLOR_H_

#include "core/math/vec.h"
#include "core/volume/label.h"

namespace isoscope::source {

// The nearest sRGB colour of L (0 to 100), a and b (-128 to 127), with the white point D65; what
// lies outside of sRGB is clamped. The same bits on every machine. REQUIRES: finite.
volume::LabelColor ColorOfCieLab(const math::Vec3d& lab);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_CIELAB_COLOR_H_
