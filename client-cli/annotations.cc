// Each item is drawn on a transparent surface of its own, no larger than it needs, and laid over
// the picture pixel by pixel. So pixels that no ink touches keep their bits, also where the picture
// is not opaque, which Cairo would round.
//
// Lengths are multiples of the text's size, which is a part of the picture's shorter side. Text and
// lines have an outline in the opposite lightness, so that they show on any surface.

#include "client-cli/annotations.h"

#include <cairo.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <numeric>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include <CLI/CLI.hpp>

#include "client-cli/flags.h"
#include "core/base/status_macros.h"

namespace isoscope::cli {
namespace {

constexpr double kTextShare = 0.022;  // of the shorter side
constexpr double kMinTextPx = 11;
constexpr char kFontFamily[] = "DejaVu Sans";
constexpr double kOutlineShare = 0.22;  // of the text's size
constexpr double kLineSpacing = 1.3;
constexpr std::ptrdiff_t kPixelBytes = 4;  // of Cairo's ARGB32

struct Ink {
  double red = 1;
  double green = 1;
  double blue = 1;
};

// Red, green and blue, light enough for black and dark enough for white.
constexpr std::array<Ink, 3> kAxisInks = {
    {{0.95, 0.30, 0.28}, {0.25, 0.75, 0.30}, {0.30, 0.50, 1.00}}};

struct SurfaceDeleter {
  void operator()(cairo_surface_t* surface) const { cairo_surface_destroy(surface); }
};
struct ContextDeleter {
  void operator()(cairo_t* context) const { cairo_destroy(context); }
};

// A transparent sheet whose top left corner lies on pixel (x, y) of the picture.
class Sheet {
 public:
  Sheet(int x, int y, int width, int height, double text_px, bool is_light)
      : x_(x),
        y_(y),
        surface_(cairo_image_surface_create(CAIRO_FORMAT_ARGB32, std::max(1, width),
                                            std::max(1, height))),
        context_(cairo_create(surface_.get())),
        text_px_(text_px),
        ink_(is_light ? Ink{0, 0, 0} : Ink{1, 1, 1}),
        outline_(is_light ? Ink{1, 1, 1} : Ink{0, 0, 0}) {
    cairo_select_font_face(cr(), kFontFamily, CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
    SetTextPx(text_px);
    cairo_font_options_t* const options = cairo_font_options_create();
    cairo_font_options_set_antialias(options, CAIRO_ANTIALIAS_GRAY);
    cairo_font_options_set_hint_style(options, CAIRO_HINT_STYLE_NONE);
    cairo_font_options_set_hint_metrics(options, CAIRO_HINT_METRICS_OFF);
    cairo_set_font_options(cr(), options);
    cairo_font_options_destroy(options);
    cairo_set_line_cap(cr(), CAIRO_LINE_CAP_ROUND);
    cairo_set_line_join(cr(), CAIRO_LINE_JOIN_ROUND);
  }

  [[nodiscard]] cairo_t* cr() const { return context_.get(); }
  [[nodiscard]] const Ink& ink() const { return ink_; }

  void SetTextPx(double text_px) {
    text_px_ = text_px;
    cairo_set_font_size(cr(), text_px);
  }

  [[nodiscard]] double WidthOf(const std::string& text) const {
    cairo_text_extents_t extents;
    cairo_text_extents(cr(), text.c_str(), &extents);
    return extents.x_advance;
  }

  // Text whose baseline begins at (x, y).
  void DrawText(double x, double y, const std::string& text, const Ink& ink) const {
    cairo_move_to(cr(), x, y);
    cairo_text_path(cr(), text.c_str());
    Outline(kOutlineShare * text_px_);
    SetInk(ink, 1);
    cairo_fill(cr());
  }

  // A line as thick as `width`.
  void DrawLine(double x0, double y0, double x1, double y1, double width, const Ink& ink) const {
    cairo_move_to(cr(), x0, y0);
    cairo_line_to(cr(), x1, y1);
    Outline(width + kOutlineShare * text_px_);
    SetInk(ink, 1);
    cairo_set_line_width(cr(), width);
    cairo_stroke(cr());
  }

  // Fills the rectangles of the path as one shape. Its edges are exact; they may lie between
  // pixels.
  void FillPath() const {
    Outline(kOutlineShare * text_px_);
    SetInk(ink_, 1);
    cairo_fill(cr());
  }

  // Lays the sheet over the picture and adds the box of the pixels that it has touched.
  absl::Status LayOver(image::RgbaImage* picture, std::vector<view::PixelRect>* boxes) const {
    cairo_surface_flush(surface_.get());
    if (const cairo_status_t status = cairo_status(cr()); status != CAIRO_STATUS_SUCCESS) {
      return status == CAIRO_STATUS_INVALID_STRING
                 ? absl::InvalidArgumentError("--caption: the text is not valid UTF-8")
                 : absl::InternalError(absl::StrCat("Cairo: ", cairo_status_to_string(status)));
    }
    const unsigned char* const data = cairo_image_surface_get_data(surface_.get());
    const int stride = cairo_image_surface_get_stride(surface_.get());
    view::PixelRect box{.begin_x = picture->width, .begin_y = picture->height};
    for (int y = std::max(0, -y_); y < cairo_image_surface_get_height(surface_.get()); ++y) {
      for (int x = std::max(0, -x_); x < cairo_image_surface_get_width(surface_.get()); ++x) {
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

 private:
  void SetInk(const Ink& ink, double alpha) const {
    cairo_set_source_rgba(cr(), ink.red, ink.green, ink.blue, alpha);
  }

  // Strokes the current path in the opposite lightness, and keeps it.
  void Outline(double width) const {
    SetInk(outline_, 0.7);
    cairo_set_line_width(cr(), width);
    cairo_stroke_preserve(cr());
  }

  // `argb`: premultiplied, as Cairo has it; the pixel is straight.
  static void BlendOver(std::uint32_t argb, image::Rgba8* pixel) {
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

  const int x_;
  const int y_;
  const std::unique_ptr<cairo_surface_t, SurfaceDeleter> surface_;
  const std::unique_ptr<cairo_t, ContextDeleter> context_;
  double text_px_;
  const Ink ink_;
  const Ink outline_;
};

double TextPx(const image::RgbaImage& picture) {
  return std::max(kMinTextPx, kTextShare * std::min(picture.width, picture.height));
}

int Ceil(double value) { return static_cast<int>(std::ceil(value)); }

// The bottom left corner: arrows from a common point, the farthest first.
absl::Status DrawAxes(const AnnotationScene& scene, Annotated* annotated) {
  const double text = TextPx(annotated->picture);
  const double arm = 3 * text;
  const int side = Ceil(2 * (arm + 2 * text));
  Sheet sheet(0, annotated->picture.height - side, side, side, text, scene.is_background_light);
  const std::array<math::Vec3d, 3> directions = AxisDirections(scene.camera);
  std::array<std::size_t, 3> order{};
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return directions[a].z > directions[b].z; });
  const double center = side / 2.0;
  for (const std::size_t axis : order) {
    const math::Vec3d& d = directions[axis];
    sheet.DrawLine(center, center, center + arm * d.x, center - arm * d.y, 0.22 * text,
                   kAxisInks[axis]);
    // The letter lies beyond the tip; of an axis that points at the eye, beside it.
    const double length = std::hypot(d.x, d.y);
    const double beyond = arm * length + 0.9 * text;
    const double x = center + (length > 1e-6 ? d.x / length : 0.7) * beyond;
    const double y = center - (length > 1e-6 ? d.y / length : 0.7) * beyond;
    sheet.DrawText(x - sheet.WidthOf(scene.axis_names[axis]) / 2, y + 0.36 * text,
                   scene.axis_names[axis], kAxisInks[axis]);
  }
  return sheet.LayOver(&annotated->picture, &annotated->boxes);
}

// The bottom right corner.
absl::Status DrawScaleBar(const AnnotationScene& scene, Annotated* annotated) {
  const image::RgbaImage& picture = annotated->picture;
  const double text = TextPx(picture);
  const ScaleBar bar = MakeScaleBar(scene, 0.25 * picture.width);
  const int width =
      Ceil(std::max(bar.length_px, 0.7 * text * static_cast<double>(bar.label.size())) + 2 * text);
  const int height = Ceil(3.2 * text);
  Sheet sheet(picture.width - width, picture.height - height, width, height, text,
              scene.is_background_light);
  const double right = width - text;
  const double left = right - bar.length_px;
  const double thickness = std::max(2.0, std::round(0.16 * text));
  const double y = std::round(height - 1.2 * text);
  const double tick_height = 0.6 * text + thickness;
  cairo_rectangle(sheet.cr(), left, y, bar.length_px, thickness);
  cairo_rectangle(sheet.cr(), left, y - 0.3 * text, thickness, tick_height);
  cairo_rectangle(sheet.cr(), right - thickness, y - 0.3 * text, thickness, tick_height);
  sheet.FillPath();
  sheet.DrawText(right - sheet.WidthOf(bar.label), y - 0.7 * text, bar.label, sheet.ink());
  return sheet.LayOver(&annotated->picture, &annotated->boxes);
}

std::string IsovalueText(const AnnotationScene& scene) {
  return absl::StrJoin(scene.isovalues, ", ", [](std::string* out, double isovalue) {
    absl::StrAppend(out, absl::StrFormat("%.9g", isovalue));
  });
}

// The top left corner; lines that are too long for the picture make all of them smaller.
absl::Status DrawCaption(const std::string& caption, const AnnotationScene& scene,
                         Annotated* annotated) {
  const image::RgbaImage& picture = annotated->picture;
  const std::string replaced =
      absl::StrReplaceAll(caption, {{"{isovalue}", IsovalueText(scene)}, {"\\n", "\n"}});
  const std::vector<std::string> lines = absl::StrSplit(replaced, '\n');
  double text = TextPx(picture);
  const int height = Ceil((kLineSpacing * static_cast<double>(lines.size()) + 1) * text);
  Sheet sheet(0, 0, picture.width, height, text, scene.is_background_light);
  double widest = 0;
  for (const std::string& line : lines) {
    widest = std::max(widest, sheet.WidthOf(line));
  }
  const double room = std::max(1.0, picture.width - 2 * text);
  if (widest > room) {
    text *= room / widest;
    sheet.SetTextPx(text);
  }
  for (std::size_t i = 0; i < lines.size(); ++i) {
    sheet.DrawText(TextPx(picture) * 0.8, (kLineSpacing * static_cast<double>(i) + 1.5) * text,
                   lines[i], sheet.ink());
  }
  return sheet.LayOver(&annotated->picture, &annotated->boxes);
}

// Without a font Cairo draws no letters and says nothing.
absl::Status CheckFont() {
  const Sheet sheet(0, 0, 1, 1, 100, false);
  cairo_text_extents_t extents;
  cairo_text_extents(sheet.cr(), "X", &extents);
  return extents.width > 1 ? absl::OkStatus()
                           : absl::FailedPreconditionError(
                                 "annotations need a font, and there is none: install "
                                 "one, as in apt-get install fonts-dejavu-core");
}

}  // namespace

void AddAnnotationFlags(CLI::App* app, AnnotationFlags* flags) {
  const std::string group = "Annotations (drawn over the picture)";
  app->add_flag("--axes", flags->has_axes, "orientation axes X, Y, Z in the bottom left corner")
      ->group(group);
  app->add_flag("--scale-bar", flags->has_scale_bar,
                "a bar of a round number of world units in the bottom right corner; of a "
                "perspective camera it holds at the target's distance")
      ->group(group);
  AddFlag(app, "--caption", "TEXT", &flags->caption, ParseText,
          "text in the top left corner; {isovalue} becomes the frame's, \\n begins a line")
      ->group(group);
}

ScaleBar MakeScaleBar(const AnnotationScene& scene, double max_px) {
  const view::Camera& camera = scene.camera;
  const bool is_perspective = camera.projection == view::Projection::kPerspective;
  const double world_height = is_perspective ? 2 * math::Length(camera.target - camera.eye) *
                                                   std::tan(camera.fov_y_radians / 2)
                                             : camera.view_height;
  const double world_per_px = world_height / scene.viewport_height_px;
  const double max_world = max_px * world_per_px;
  const double power = std::pow(10, std::floor(std::log10(max_world)));
  ScaleBar bar;
  bar.world_length = power;
  for (const double factor : {2.0, 5.0, 10.0}) {  // 10: log10 may have rounded down
    if (factor * power <= max_world) {
      bar.world_length = factor * power;
    }
  }
  bar.length_px = bar.world_length / world_per_px;
  bar.label =
      absl::StrFormat("%.9g units%s", bar.world_length, is_perspective ? " at the target" : "");
  return bar;
}

std::array<math::Vec3d, 3> AxisDirections(const view::Camera& camera) {
  const math::Vec3d forward = math::Normalized(camera.target - camera.eye);
  const math::Vec3d right = math::Normalized(math::Cross(forward, camera.up));
  const math::Vec3d up = math::Cross(right, forward);
  return {math::Vec3d{right.x, up.x, forward.x}, math::Vec3d{right.y, up.y, forward.y},
          math::Vec3d{right.z, up.z, forward.z}};
}

absl::StatusOr<Annotated> Annotate(const AnnotationFlags& flags, const AnnotationScene& scene,
                                   image::RgbaImage picture) {
  Annotated annotated{.picture = std::move(picture), .boxes = {}};
  ISOSCOPE_RETURN_IF_ERROR(CheckFont());
  if (flags.has_axes) {
    ISOSCOPE_RETURN_IF_ERROR(DrawAxes(scene, &annotated));
  }
  if (flags.has_scale_bar) {
    ISOSCOPE_RETURN_IF_ERROR(DrawScaleBar(scene, &annotated));
  }
  if (flags.caption) {
    ISOSCOPE_RETURN_IF_ERROR(DrawCaption(*flags.caption, scene, &annotated));
  }
  return annotated;
}

}  // namespace isoscope::cli
