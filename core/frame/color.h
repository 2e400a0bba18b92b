// Colours as people and requests give them.

#ifndef ISOSCOPE_CORE_FRAME_COLOR_H_
#define ISOSCOPE_CORE_FRAME_COLOR_H_

namespace isoscope::frame {

// sRGB values with straight alpha, each in [0, 1].
struct Color {
  float red = 0;
  float green = 0;
  float blue = 0;
  float alpha = 1;

  friend bool operator==(const Color&, const Color&) = default;
};

}  // namespace isoscope::frame

#endif  // ISOSCOPE_CORE_FRAME_COLOR_H_
