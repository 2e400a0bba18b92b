// A sheet is a surface of Cairo, of minimal size, that LayOver blends over the picture pixel by
// pixel. So pixels without ink keep their bits, even in a translucent picture, which Cairo would
// round.
//
// Pango shapes text: letters of any script, from the fonts of the machine, right to left if the
// script requires it.

#include "clients/cpp/picture_file/annotation_sheet.h"

#include <cairo.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "absl/strings/str_cat.h"
#include <fontconfig/fontconfig.h>
#include <pango/pangocairo.h>

namespace isoscope::client {
namespace {

constexpr char kFontFamily[] = "DejaVu Sans";  // others for letters that it lacks
constexpr double kOutlineShare = 0.22;         // of the text's size
constexpr std::ptrdiff_t kPixelBytes = 4;      // of Cairo's ARGB32

struct SurfaceDeleter {
  void operator()(cairo_surface_t* surface) const { cairo_surface_destroy(surface); }
};
struct ContextDeleter {
  void operator()(cairo_t* context) const { cairo_destroy(context); }
};
struct ObjectDeleter {
  void operator()(gpointer object) const { g_object_unref(object); }
};
struct FontDeleter {
  void operator()(PangoFontDescription* font) const { pango_font_description_free(font); }
};

// `argb`: premultiplied, in Cairo's format; the pixel has straight alpha.
void BlendOver(std::uint32_t argb, image::Rgba8* pixel) {
  const std::uint32_t over_alpha = argb >> 24;
  const std::uint32_t under_weight = pixel->a * (255 - over_alpha);  // of 255 * 255
  const std::uint32_t alpha = 255 * over_alpha + under_weight;
  const auto channel = [&](std::uint32_t over, std::uint32_t under) {
    return static_cast<std::uint8_t>(std::min<std::uint32_t>(
        255, (over * 255 * 255 + under * under_weight + alpha / 2) / alpha));
  };
  pixel->r = channel(argb >> 16 & 0xff, pixel->r);
  pixel->g = channel(argb >> 8 & 0xff, pixel->g);
  pixel->b = channel(argb & 0xff, pixel->b);
  pixel->a = static_cast<std::uint8_t>((alpha + 127) / 255);
}

}  // namespace

struct Sheet::Canvas {
  Canvas(int width, int height)
      : surface(cairo_image_surface_create(CAIRO_FORMAT_ARGB32, std::max(1, width),
                                           std::max(1, height))),
        context(cairo_create(surface.get())),
        fonts(pango_cairo_font_map_new()),
        shaping(pango_font_map_create_context(fonts.get())),
        layout(pango_layout_new(shaping.get())) {}

  const std::unique_ptr<cairo_surface_t, SurfaceDeleter> surface;
  const std::unique_ptr<cairo_t, ContextDeleter> context;
  const std::unique_ptr<PangoFontMap, ObjectDeleter> fonts;
  const std::unique_ptr<PangoContext, ObjectDeleter> shaping;
  const std::unique_ptr<PangoLayout, ObjectDeleter> layout;
};

Sheet::Sheet(int x, int y, int width, int height, double text_px, bool is_light)
    : x_(x),
      y_(y),
      canvas_(std::make_unique<Canvas>(width, height)),
      text_px_(text_px),
      ink_(is_light ? Ink{0, 0, 0} : Ink{1, 1, 1}),
      outline_(is_light ? Ink{1, 1, 1} : Ink{0, 0, 0}) {
  SetTextPx(text_px);
  cairo_font_options_t* const options = cairo_font_options_create();
  cairo_font_options_set_antialias(options, CAIRO_ANTIALIAS_GRAY);
  cairo_font_options_set_hint_style(options, CAIRO_HINT_STYLE_NONE);
  cairo_font_options_set_hint_metrics(options, CAIRO_HINT_METRICS_OFF);
  pango_cairo_context_set_font_options(canvas_->shaping.get(), options);
  pango_context_set_round_glyph_positions(canvas_->shaping.get(), FALSE);
  pango_layout_set_single_paragraph_mode(canvas_->layout.get(), TRUE);
  cairo_font_options_destroy(options);
  cairo_set_line_cap(canvas_->context.get(), CAIRO_LINE_CAP_ROUND);
  cairo_set_line_join(canvas_->context.get(), CAIRO_LINE_JOIN_ROUND);
}

Sheet::~Sheet() = default;

void Sheet::SetTextPx(double text_px) {
  text_px_ = text_px;
  const std::unique_ptr<PangoFontDescription, FontDeleter> font(pango_font_description_new());
  pango_font_description_set_family_static(font.get(), kFontFamily);
  pango_font_description_set_absolute_size(font.get(), text_px * PANGO_SCALE);
  pango_layout_set_font_description(canvas_->layout.get(), font.get());
}

double Sheet::WidthOf(const std::string& text) const {
  SetText(text);
  PangoRectangle logical;
  pango_layout_get_extents(canvas_->layout.get(), nullptr, &logical);
  return static_cast<double>(logical.width) / PANGO_SCALE;
}

void Sheet::DrawText(double x, double y, const std::string& text, const Ink& ink) const {
  SetText(text);
  const double baseline = static_cast<double>(pango_layout_get_baseline(canvas_->layout.get()));
  cairo_move_to(canvas_->context.get(), x, y - baseline / PANGO_SCALE);
  pango_cairo_layout_path(canvas_->context.get(), canvas_->layout.get());
  Outline(kOutlineShare * text_px_);
  SetInk(ink, 1);
  cairo_fill(canvas_->context.get());
}

void Sheet::DrawLine(double x0, double y0, double x1, double y1, double width,
                     const Ink& ink) const {
  cairo_move_to(canvas_->context.get(), x0, y0);
  cairo_line_to(canvas_->context.get(), x1, y1);
  Outline(width + kOutlineShare * text_px_);
  SetInk(ink, 1);
  cairo_set_line_width(canvas_->context.get(), width);
  cairo_stroke(canvas_->context.get());
}

void Sheet::FillRectangles(const std::vector<SheetRectangle>& rectangles) const {
  for (const SheetRectangle& r : rectangles) {
    cairo_rectangle(canvas_->context.get(), r.x, r.y, r.width, r.height);
  }
  Outline(kOutlineShare * text_px_);
  SetInk(ink_, 1);
  cairo_fill(canvas_->context.get());
}

void Sheet::Paint(const SheetRectangle& rectangle, const Ink& ink, double opacity) const {
  SetInk(ink, opacity);
  cairo_rectangle(canvas_->context.get(), rectangle.x, rectangle.y, rectangle.width,
                  rectangle.height);
  cairo_fill(canvas_->context.get());
}

absl::Status Sheet::LayOver(image::RgbaImage* picture, std::vector<view::PixelRect>* boxes) const {
  cairo_surface_flush(canvas_->surface.get());
  if (const cairo_status_t status = cairo_status(canvas_->context.get());
      status != CAIRO_STATUS_SUCCESS) {
    return absl::InternalError(absl::StrCat("Cairo: ", cairo_status_to_string(status)));
  }
  const unsigned char* const data = cairo_image_surface_get_data(canvas_->surface.get());
  const int stride = cairo_image_surface_get_stride(canvas_->surface.get());
  view::PixelRect box{.begin_x = picture->width, .begin_y = picture->height};
  for (int y = std::max(0, -y_); y < cairo_image_surface_get_height(canvas_->surface.get()); ++y) {
    for (int x = std::max(0, -x_); x < cairo_image_surface_get_width(canvas_->surface.get()); ++x) {
      std::uint32_t argb = 0;
      std::memcpy(&argb, data + std::ptrdiff_t{y} * stride + std::ptrdiff_t{x} * kPixelBytes,
                  sizeof(argb));
      const int to_x = x_ + x;
      const int to_y = y_ + y;
      if (argb >> 24 == 0 || to_x >= picture->width || to_y >= picture->height) {
        continue;
      }
      BlendOver(argb, &picture->pixels[static_cast<std::size_t>(to_y) *
                                           static_cast<std::size_t>(picture->width) +
                                       static_cast<std::size_t>(to_x)]);
      box = {.begin_x = std::min(box.begin_x, to_x),
             .begin_y = std::min(box.begin_y, to_y),
             .end_x = std::max(box.end_x, to_x + 1),
             .end_y = std::max(box.end_y, to_y + 1)};
    }
  }
  if (!box.empty()) {
    boxes->push_back(box);
  }
  return absl::OkStatus();
}

void Sheet::SetText(const std::string& text) const {
  pango_layout_set_text(canvas_->layout.get(), text.data(), static_cast<int>(text.size()));
}

void Sheet::SetInk(const Ink& ink, double alpha) const {
  cairo_set_source_rgba(canvas_->context.get(), ink.red, ink.green, ink.blue, alpha);
}

void Sheet::Outline(double width) const {
  SetInk(outline_, 0.7);
  cairo_set_line_width(canvas_->context.get(), width);
  cairo_stroke_preserve(canvas_->context.get());
}

bool IsUtf8(absl::string_view text) {
  return g_utf8_validate(text.data(), static_cast<gssize>(text.size()), nullptr) != FALSE;
}

absl::Status CheckFont() {
  const FcFontSet* const fonts = FcConfigGetFonts(nullptr, FcSetSystem);
  return fonts != nullptr && fonts->nfont > 0
             ? absl::OkStatus()
             : absl::FailedPreconditionError(
                   "annotations need a font, and there is none: install one, as in apt-get install "
                   "fonts-dejavu-core");
}

}  // namespace isoscope::client
