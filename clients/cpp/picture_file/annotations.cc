// Lengths are multiples of the text's size, which is a fraction of the picture's shorter side. Each
// item is drawn on a sheet of its own (annotation_sheet).

#include "clients/cpp/picture_file/annotations.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"

#include "clients/cpp/picture_file/annotation_sheet.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/picture/color_map.h"

namespace isoscope::client {
namespace {

constexpr double kTextShare = 0.022;  // of the shorter side
constexpr double kMinTextPx = 11;
constexpr double kLineSpacing = 1.3;
constexpr int kMaxLegendTicks = 8;
constexpr double kLeastArm = 0.35;  // least arm length for letters at both ends
// Of a caption with its isovalues and times: a request of some kilobytes could ask for gigabytes.
constexpr std::size_t kMaxCaptionBytes = 16384;

// Red, green and blue, light enough for black and dark enough for white.
constexpr std::array<Ink, 3> kAxisInks = {
    {{0.95, 0.30, 0.28}, {0.25, 0.75, 0.30}, {0.30, 0.50, 1.00}}};

double TextPx(const image::RgbaImage& picture) {
  return std::max(kMinTextPx, kTextShare * std::min(picture.width, picture.height));
}

int Ceil(double value) { return static_cast<int>(std::ceil(value)); }

// Draws an arm of the axes, from the centre, with its letter beyond the tip, or beside it if the
// arm points at the eye.
void DrawArm(const Sheet& sheet, double center, double arm, double text, const math::Vec3d& d,
             double thickness, const std::string& name, const Ink& ink) {
  sheet.DrawLine(center, center, center + arm * d.x, center - arm * d.y, thickness, ink);
  const double length = std::hypot(d.x, d.y);
  const double beyond = arm * length + 0.9 * text;
  const double x = center + (length > 1e-6 ? d.x / length : 0.7) * beyond;
  const double y = center - (length > 1e-6 ? d.y / length : 0.7) * beyond;
  sheet.DrawText(x - sheet.WidthOf(name) / 2, y + 0.36 * text, name, ink);
}

// The bottom left corner: arrows from a common point, the farthest first.
absl::Status DrawAxes(const AnnotationScene& scene, Annotated* annotated) {
  const double text = TextPx(annotated->picture);
  const double arm = 3 * text;
  const int side = Ceil(2 * (arm + 2 * text));
  Sheet sheet(0, annotated->picture.height - side, side, side, text, scene.is_background_light);
  const std::array<math::Vec3d, 3> directions = AxisDirections(scene.camera);
  struct Arm {
    std::size_t axis = 0;
    math::Vec3d direction;
    double length_px = 0;
    const std::string* name = nullptr;
  };
  std::vector<Arm> arms;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const math::Vec3d& d = directions[axis];
    const bool has_two = !scene.opposite_names[axis].empty();
    // The letters of an axis along the view direction would overlap: only the end towards the eye
    // gets one.
    const bool is_short = has_two && std::hypot(d.x, d.y) < kLeastArm;
    if (!is_short || d.z < 0) {
      arms.push_back({axis, d, arm, &scene.axis_names[axis]});
    }
    if (has_two && (!is_short || d.z >= 0)) {
      arms.push_back({axis, -d, 0.6 * arm, &scene.opposite_names[axis]});
    }
  }
  std::stable_sort(arms.begin(), arms.end(),
                   [](const Arm& a, const Arm& b) { return a.direction.z > b.direction.z; });
  for (const Arm& drawn : arms) {
    const bool is_opposite = drawn.name == &scene.opposite_names[drawn.axis];
    DrawArm(sheet, side / 2.0, drawn.length_px, text, drawn.direction,
            (is_opposite ? 0.1 : 0.22) * text, *drawn.name, kAxisInks[drawn.axis]);
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
  sheet.FillRectangles({{left, y, bar.length_px, thickness},
                        {left, y - 0.3 * text, thickness, tick_height},
                        {right - thickness, y - 0.3 * text, thickness, tick_height}});
  sheet.DrawText(right - sheet.WidthOf(bar.label), y - 0.7 * text, bar.label, sheet.ink());
  return sheet.LayOver(&annotated->picture, &annotated->boxes);
}

// One bar of the legend, or one line of text for normals, which have no map.
struct LegendItem {
  frame::ColorBy color_by;
  std::string title;
  std::optional<image::Rgba8> nan_color;  // of a swatch below the bar
};

std::string SurfaceText(const AnnotationScene& scene, std::size_t surface_index) {
  return surface_index < scene.label_names.size() && !scene.label_names[surface_index].empty()
             ? scene.label_names[surface_index]
             : absl::StrFormat("%.9g", scene.isovalues[surface_index]);
}

// Surfaces with the same colouring share an item.
std::vector<LegendItem> LegendItemsOf(const AnnotationScene& scene) {
  std::vector<LegendItem> items;
  std::vector<std::vector<std::string>> isovalues;
  for (const SurfaceColoring& coloring : scene.colorings) {
    std::size_t i = 0;
    while (i < items.size() && !(items[i].color_by == coloring.color_by)) {
      ++i;
    }
    if (i == items.size()) {
      items.push_back({coloring.color_by, coloring.field_title, std::nullopt});
      isovalues.emplace_back();
    }
    if (coloring.nan_color.has_value()) {
      items[i].nan_color = coloring.nan_color;
    }
    if (coloring.surface_index < scene.isovalues.size()) {
      isovalues[i].push_back(SurfaceText(scene, coloring.surface_index));
    }
  }
  const std::array<const char*, 6> quantities = {
      "x", "y", "z", "normal: red x, green y, blue z", "gradient magnitude", "field"};
  for (std::size_t i = 0; i < items.size(); ++i) {
    const bool is_all = isovalues[i].size() == scene.isovalues.size();
    items[i].title = base::CutText(absl::StrCat(
        items[i].title.empty() ? quantities[static_cast<std::size_t>(items[i].color_by.quantity)]
                               : items[i].title,
        is_all ? "" : absl::StrCat(" at ", absl::StrJoin(isovalues[i], ", "))));
  }
  if (scene.caps_coloring.has_value()) {
    const CapsColoring& caps = *scene.caps_coloring;
    items.push_back(
        {{.quantity = frame::ColorBy::Quantity::kField, .map = caps.map, .range = caps.range},
         caps.title,
         caps.nan_color});
  }
  return items;
}

// Draws light and dark grey squares in rows [begin_row, end_row) of a bar that begins at (x, y),
// two in a row: the background of translucent colours.
void DrawSquares(const Sheet& sheet, double x, int begin_row, int end_row, double y, double width) {
  const double side = std::max(1.0, std::round(width / 2));
  for (int row = begin_row; row < end_row; ++row) {
    const bool is_odd = static_cast<std::int64_t>((row - y) / side) % 2 != 0;
    for (const bool is_right : {false, true}) {
      const double grey = is_odd == is_right ? 0.85 : 0.45;
      sheet.Paint(
          {is_right ? x + side : x, static_cast<double>(row), is_right ? width - side : side, 1},
          {grey, grey, grey}, 1);
    }
  }
}

double StepOf(const std::vector<double>& ticks, const frame::ColorRange& range) {
  return ticks.size() > 1 ? ticks[1] - ticks[0] : range.max - range.min;
}

// Draws the colours of a map from bottom to top, with a frame and ticks, in [y, y + height).
void DrawBar(const Sheet& sheet, double x, double y, double width, double height, double text,
             const frame::ColorBy& color_by) {
  const picture::ColorMapTable& table = picture::ColorMapTableOf(color_by.map);
  sheet.FillRectangles({{x, y, width, height}});
  for (std::size_t i = 0; i < table.size(); ++i) {
    const auto edge = [&](std::size_t step) {
      return std::round(y + height * (1 - static_cast<double>(step) / picture::kColorMapSteps));
    };
    const double opacity = static_cast<double>(picture::OpacityOf(color_by, i));
    if (opacity < 1) {
      DrawSquares(sheet, x, static_cast<int>(edge(i + 1)), static_cast<int>(edge(i)), y, width);
    }
    sheet.Paint({x, edge(i + 1), width, edge(i) - edge(i + 1)},
                {table[i].r / 255.0, table[i].g / 255.0, table[i].b / 255.0}, opacity);
  }
  const frame::ColorRange range = color_by.range.value_or(frame::ColorRange());
  const int max_count = std::clamp(static_cast<int>(height / (2 * text)), 2, kMaxLegendTicks);
  const std::vector<double> ticks = LegendTicks(range, max_count);
  const double step = StepOf(ticks, range);
  for (const double value : ticks) {
    const double at = y + height * (1 - (value - range.min) / (range.max - range.min));
    sheet.DrawLine(x + width, at, x + width + 0.35 * text, at, 0.1 * text, sheet.ink());
    sheet.DrawText(x + width + 0.7 * text, at + 0.36 * text, TickLabel(value, step), sheet.ink());
  }
}

constexpr char kNoData[] = "no data";

// The width of a bar with its title, ticks and swatch.
int WidthOf(const LegendItem& item, double text, bool is_light) {
  const Sheet ruler(0, 0, 1, 1, text, is_light);
  const frame::ColorRange range = item.color_by.range.value_or(frame::ColorRange());
  double labels = item.nan_color.has_value() ? ruler.WidthOf(kNoData) : 0;
  const std::vector<double> ticks = LegendTicks(range, kMaxLegendTicks);
  for (const double value : ticks) {
    labels = std::max(labels, ruler.WidthOf(TickLabel(value, StepOf(ticks, range))));
  }
  return Ceil(std::max(ruler.WidthOf(item.title), 1.7 * text + labels) + text);
}

// A place for a bar, with the height of the bar alone.
struct BarPlace {
  double left = 0;
  double top = 0;
  int width = 0;
  double bar_height = 0;
};

absl::Status DrawBarItem(const AnnotationScene& scene, const LegendItem& item,
                         const BarPlace& place, Annotated* annotated) {
  const double text = TextPx(annotated->picture);
  const double swatch = item.nan_color.has_value() ? 1.8 * text : 0;
  Sheet sheet(static_cast<int>(place.left), static_cast<int>(place.top), place.width,
              Ceil(place.bar_height + 4 * text + swatch), text, scene.is_background_light);
  sheet.DrawText(0.5 * text, 1.2 * text, item.title, sheet.ink());
  const double side = std::round(text);
  // On whole pixels, so that each pixel of bar and swatch has the colour itself.
  const double x = std::round(0.5 * text);
  DrawBar(sheet, x, std::round(2.5 * text), side, place.bar_height, text, item.color_by);
  if (item.nan_color.has_value()) {
    const double y = std::round(2.5 * text) + place.bar_height + side;
    sheet.FillRectangles({{x, y, side, side}});
    sheet.Paint({x, y, side, side},
                {item.nan_color->r / 255.0, item.nan_color->g / 255.0, item.nan_color->b / 255.0},
                1);
    sheet.DrawText(x + 1.7 * side, y + 0.86 * side, kNoData, sheet.ink());
  }
  return sheet.LayOver(&annotated->picture, &annotated->boxes);
}

// Places bars of these widths from right to left, in as few rows as fit the picture.
std::vector<BarPlace> PlaceBars(const std::vector<int>& widths, const view::Viewport& size,
                                double text) {
  std::vector<BarPlace> places;
  for (int rows = 1;; ++rows) {
    places.clear();
    const double bar_height =
        std::round(rows == 1 ? 0.45 * size.height_px
                             : std::max(0.9 * size.height_px / rows - 6 * text, 2 * text));
    const double pitch = bar_height + 6 * text;
    const double first = rows == 1 ? std::floor((size.height_px - bar_height) / 2 - 2.5 * text)
                                   : std::floor((size.height_px - rows * pitch) / 2);
    const double end = size.width_px - 0.5 * text;
    double right = end;
    int row = 0;
    for (const int width : widths) {
      if (right - width < 0 && right < end) {
        right = end;
        ++row;
      }
      right = std::floor(right - width);
      places.push_back({right, first + row * pitch, width, bar_height});
    }
    if (row < rows || rows >= static_cast<int>(widths.size())) {
      return places;
    }
  }
}

// The right side: bars, and below them lines of text for normals.
absl::Status DrawLegend(const AnnotationScene& scene, Annotated* annotated) {
  const std::vector<LegendItem> items = LegendItemsOf(scene);
  if (items.empty()) {
    return absl::InvalidArgumentError(
        "--legend: neither a surface nor a cut shows a quantity; colour one, as with --color-by z "
        "or --caps viridis");
  }
  const view::Viewport size{annotated->picture.width, annotated->picture.height};
  const double text = TextPx(annotated->picture);
  const auto has_bar = [](const LegendItem& item) {
    return item.color_by.quantity != frame::ColorBy::Quantity::kNormal;
  };
  // A title that is too long is cut at the picture's side, not its bar.
  const int room = std::max(1, static_cast<int>(size.width_px - 0.5 * text));
  std::vector<int> widths;
  for (const LegendItem& item : items) {
    if (has_bar(item)) {
      widths.push_back(std::min(room, WidthOf(item, text, scene.is_background_light)));
    }
  }
  const std::vector<BarPlace> places = PlaceBars(widths, size, text);
  const BarPlace lowest = places.empty() ? PlaceBars({0}, size, text).back() : places.back();
  const bool has_swatch = std::any_of(items.begin(), items.end(), [](const LegendItem& item) {
    return item.nan_color.has_value();
  });
  double line_top = lowest.top + lowest.bar_height + (has_swatch ? 5.8 : 4) * text;
  std::size_t bar = 0;
  for (const LegendItem& item : items) {
    if (has_bar(item)) {
      ISOSCOPE_RETURN_IF_ERROR(DrawBarItem(scene, item, places[bar++], annotated));
      continue;
    }
    const Sheet ruler(0, 0, 1, 1, text, scene.is_background_light);
    const int width = std::min(room, Ceil(ruler.WidthOf(item.title) + text));
    Sheet sheet(size.width_px - width - Ceil(0.5 * text), static_cast<int>(line_top), width,
                Ceil(2 * text), text, scene.is_background_light);
    sheet.DrawText(0.5 * text, 1.2 * text, item.title, sheet.ink());
    ISOSCOPE_RETURN_IF_ERROR(sheet.LayOver(&annotated->picture, &annotated->boxes));
    line_top += kLineSpacing * text;
  }
  return absl::OkStatus();
}

std::string IsovalueText(const AnnotationScene& scene) {
  std::vector<std::string> texts;
  for (std::size_t i = 0; i < scene.isovalues.size(); ++i) {
    texts.push_back(SurfaceText(scene, i));
  }
  return absl::StrJoin(texts, ", ");
}

std::size_t CountOf(absl::string_view part, absl::string_view text) {
  std::size_t count = 0;
  for (std::size_t at = text.find(part); at != absl::string_view::npos;
       at = text.find(part, at + part.size())) {
    ++count;
  }
  return count;
}

// The top left corner; lines that are too long for the picture reduce the size of all. Lines below
// the picture are not drawn.
absl::Status DrawCaption(const std::string& caption, const AnnotationScene& scene,
                         Annotated* annotated) {
  const image::RgbaImage& picture = annotated->picture;
  if (!IsUtf8(caption)) {
    return absl::InvalidArgumentError("--caption: the text is not valid UTF-8");
  }
  const std::string isovalues = IsovalueText(scene);
  const std::size_t bytes = caption.size() + CountOf("{isovalue}", caption) * isovalues.size() +
                            CountOf("{time}", caption) * scene.time.size();
  if (bytes > kMaxCaptionBytes) {
    return absl::InvalidArgumentError(absl::StrCat("--caption: the text has ", bytes,
                                                   " bytes with its isovalues and times: at most ",
                                                   kMaxCaptionBytes, " are allowed"));
  }
  const std::string replaced = absl::StrReplaceAll(
      caption, {{"{isovalue}", isovalues}, {"{time}", scene.time}, {"\\n", "\n"}});
  const std::vector<std::string> lines = absl::StrSplit(replaced, '\n');
  double text = TextPx(picture);
  const int height =
      std::min(picture.height, Ceil((kLineSpacing * static_cast<double>(lines.size()) + 1) * text));
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
    const double baseline = (kLineSpacing * static_cast<double>(i) + 1.5) * text;
    if (baseline - 4 * text > picture.height) {
      break;
    }
    sheet.DrawText(TextPx(picture) * 0.8, baseline, lines[i], sheet.ink());
  }
  return sheet.LayOver(&annotated->picture, &annotated->boxes);
}

}  // namespace

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
  bar.label = absl::StrFormat("%.9g %s%s", bar.world_length,
                              scene.length_unit.empty() ? "units" : scene.length_unit,
                              is_perspective ? " at the target" : "");
  return bar;
}

void NameAxes(const volume::PatientFrame& frame, AnnotationScene* scene) {
  constexpr absl::string_view kSides = "LRPASI";
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t side = kSides.find(frame.name()[axis]);
    scene->axis_names[axis] = std::string(1, kSides[side]);
    scene->opposite_names[axis] = std::string(1, kSides[side ^ 1U]);
  }
}

std::string TickLabel(double value, double step) {
  if (std::abs(value) < 1e-9 * step) {
    return "0";
  }
  // Enough digits to tell neighbouring ticks apart, also where both have a large offset.
  for (int digits = 9;; ++digits) {
    const std::string text = absl::StrFormat("%.*g", digits, value);
    double read = 0;
    if (digits == 17 || (absl::SimpleAtod(text, &read) && std::abs(read - value) < 1e-3 * step)) {
      return text;
    }
  }
}

std::vector<double> LegendTicks(const frame::ColorRange& range, int max_count) {
  const double length = range.max - range.min;
  // A multiple of the step that rounding has moved past an end still counts.
  const double slack = 1e-9 * length;
  for (double power = std::max(std::pow(10, std::floor(std::log10(length / max_count))),
                               std::numeric_limits<double>::min());
       ; power *= 10) {
    for (const double factor : {1.0, 2.0, 5.0}) {
      const double step = factor * power;
      const double first = std::ceil((range.min - slack) / step);
      const double last = std::floor((range.max + slack) / step);
      if (last - first + 1 > max_count) {
        continue;
      }
      std::vector<double> ticks;
      for (int i = 0; i <= last - first; ++i) {
        ticks.push_back(std::clamp((first + i) * step, range.min, range.max));
      }
      return ticks;
    }
  }
}

std::array<math::Vec3d, 3> AxisDirections(const view::Camera& camera) {
  const math::Vec3d forward = math::Normalized(camera.target - camera.eye);
  const math::Vec3d right = math::Normalized(math::Cross(forward, camera.up));
  const math::Vec3d up = math::Cross(right, forward);
  return {math::Vec3d{right.x, up.x, forward.x}, math::Vec3d{right.y, up.y, forward.y},
          math::Vec3d{right.z, up.z, forward.z}};
}

absl::StatusOr<Annotated> Annotate(const Annotations& annotations, const AnnotationScene& scene,
                                   image::RgbaImage picture) {
  Annotated annotated{.picture = std::move(picture), .boxes = {}};
  ISOSCOPE_RETURN_IF_ERROR(CheckFont());
  if (annotations.has_axes) {
    ISOSCOPE_RETURN_IF_ERROR(DrawAxes(scene, &annotated));
  }
  if (annotations.has_scale_bar) {
    ISOSCOPE_RETURN_IF_ERROR(DrawScaleBar(scene, &annotated));
  }
  if (annotations.has_legend) {
    ISOSCOPE_RETURN_IF_ERROR(DrawLegend(scene, &annotated));
  }
  if (annotations.caption) {
    ISOSCOPE_RETURN_IF_ERROR(DrawCaption(*annotations.caption, scene, &annotated));
  }
  return annotated;
}

}  // namespace isoscope::client
