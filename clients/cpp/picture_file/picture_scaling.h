// Scales pictures by any factor, in linear light.

#ifndef ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_PICTURE_SCALING_H_
#define ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_PICTURE_SCALING_H_

#include <cstddef>
#include <vector>

#include "core/image/png_codec.h"
#include "core/view/camera.h"

namespace isoscope::client {

// Returns the largest size inside `limit` with the aspect of `picture`, at most `picture` itself,
// and at least 1 x 1. `pixel_aspect`: the height of a pixel of the result over its width. REQUIRES:
// sides >= 1, pixel_aspect > 0.
view::Viewport FitInside(const view::Viewport& picture, const view::Viewport& limit,
                         double pixel_aspect);

// Makes a picture of another size from pieces. Each pixel becomes the mean of the area that it
// covers, in linear light, with colours weighted by their alpha. Thread-compatible.
class PictureScaler {
 public:
  // REQUIRES: all sides >= 1.
  PictureScaler(const view::Viewport& from, const view::Viewport& to);

  // Adds a piece whose left upper pixel is at `x`, `y` of the picture. REQUIRES: it lies inside,
  // and no pixel is added twice.
  void Add(int x, int y, const image::RgbaImage& piece);
  // Returns the new picture, once all pieces are added.
  [[nodiscard]] image::RgbaImage Finish() const;

 private:
  // Sums of a pixel: light times weight and alpha, and alpha times weight.
  struct Sum {
    float r = 0;
    float g = 0;
    float b = 0;
    float a = 0;
  };
  // A pixel of the new picture that an old one overlaps, and the overlapped share of the new one.
  struct Share {
    int index = 0;
    float weight = 0;
  };
  // The shares of every old pixel of a side; those of pixel i begin at begins[i].
  struct Shares {
    std::vector<Share> shares;
    std::vector<std::size_t> begins;
  };
  static Shares SharesOf(int from, int to);

  const view::Viewport to_;
  const Shares columns_;
  const Shares rows_;
  std::vector<Sum> sums_;
};

// Scales a whole picture at once; returns it unchanged if it has that size.
image::RgbaImage ScalePicture(image::RgbaImage picture, const view::Viewport& to);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_PICTURE_SCALING_H_
