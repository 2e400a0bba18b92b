// Pictures as the bytes that terminals draw: kitty's graphics protocol, iTerm2's inline images,
// sixel, and coloured half blocks. None moves the cursor first; all are thread-safe.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_PICTURE_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_PICTURE_H_

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/image/png_codec.h"
#include "core/view/camera.h"

namespace isoscope::cli {

// Size of the picture in characters; 0: as large as its pixels.
struct CellBox {
  int columns = 0;
  int rows = 0;
};

struct KittyOptions {
  CellBox box = {};
  // > 0: the number of the picture, for KittyRemoval; the cursor stays. 0: the cursor moves behind
  // the picture.
  int image_number = 0;
};
// `png`: a PNG file.
std::string KittyPicture(absl::string_view png, const KittyOptions& options);
// Removes a picture that KittyPicture has shown.
std::string KittyRemoval(int image_number);

// `file`: a PNG or JPEG file, shown `size` large, or in the box if it has columns.
std::string ITerm2Picture(absl::string_view file, const view::Viewport& size, const CellBox& box);

enum class SixelQuality {
  kFast,  // for pictures that move
  kBest,  // error diffusion between the colours of the palette
};
// Uses up to 256 colours, chosen from the picture. Pixels with alpha below 128 leave the terminal
// unchanged; the alpha of others is ignored. INTERNAL with the library's message if it fails.
absl::StatusOr<std::string> SixelPicture(const image::RgbaImage& picture, SixelQuality quality);

enum class BlockColors {
  k24Bit,
  k256,  // xterm's cube and greys
  k16,   // black, and the seven bright ones of ANSI's colours
  k8,    // ANSI's eight: the Linux console has no bright ones behind a character
};
// Returns rows of half blocks, each two pixels high, separated by `line_end`. Alpha as
// SixelPicture. The colours of a palette are dithered by a fixed matrix: their mean is the
// picture's, a picture always gives the same bytes, and a pixel in a colour of xterm's cube or greys
// keeps it.
std::string BlockPicture(const image::RgbaImage& picture, BlockColors colors,
                         absl::string_view line_end);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_PICTURE_H_
