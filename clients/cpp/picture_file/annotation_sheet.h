// A transparent sheet for text and shapes, laid over a picture. Only its source knows Cairo, Pango
// and Fontconfig.

#ifndef ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_ANNOTATION_SHEET_H_
#define ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_ANNOTATION_SHEET_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "core/image/png_codec.h"
#include "core/view/view.h"

namespace isoscope::client {

// In [0, 1].
struct Ink {
  double red = 1;
  double green = 1;
  double blue = 1;
};

// On a sheet, in pixels; edges may lie between pixels.
struct SheetRectangle {
  double x = 0;
  double y = 0;
  double width = 0;
  double height = 0;
};

// A transparent sheet whose top left corner lies on pixel (x, y) of the picture. Text and lines
// have an outline of the opposite lightness, so that they are visible on any surface.
// Thread-compatible.
class Sheet {
 public:
  // text_px: the size of the text, and the measure of outlines
  // is_light: the background is light, so the ink is dark
  Sheet(int x, int y, int width, int height, double text_px, bool is_light);
  ~Sheet();
  Sheet(const Sheet&) = delete;
  Sheet& operator=(const Sheet&) = delete;

  [[nodiscard]] const Ink& ink() const { return ink_; }
  void SetTextPx(double text_px);
  [[nodiscard]] double WidthOf(const std::string& text) const;

  // Text whose baseline begins at (x, y).
  void DrawText(double x, double y, const std::string& text, const Ink& ink) const;
  // A line as thick as `width`.
  void DrawLine(double x0, double y0, double x1, double y1, double width, const Ink& ink) const;
  // Fills the rectangles as one shape, with an outline.
  void FillRectangles(const std::vector<SheetRectangle>& rectangles) const;
  // Covers a rectangle with a colour, without an outline.
  void Paint(const SheetRectangle& rectangle, const Ink& ink, double opacity) const;

  // Blends the sheet over the picture and adds the box of the changed pixels. Pixels without ink
  // keep their bits.
  absl::Status LayOver(image::RgbaImage* picture, std::vector<view::PixelRect>* boxes) const;

 private:
  struct Canvas;  // of Cairo and Pango

  void SetText(const std::string& text) const;
  void SetInk(const Ink& ink, double alpha) const;
  // Strokes the current path in the opposite lightness, and keeps it.
  void Outline(double width) const;

  const int x_;
  const int y_;
  const std::unique_ptr<Canvas> canvas_;
  double text_px_;
  const Ink ink_;
  const Ink outline_;
};

bool IsUtf8(absl::string_view text);

// FAILED_PRECONDITION if there is no font: Pango draws boxes then.
absl::Status CheckFont();

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_ANNOTATION_SHEET_H_
