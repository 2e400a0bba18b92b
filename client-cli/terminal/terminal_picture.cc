// Sources of the formats:
//
// * kitty: https://sw.kovidgoyal.net/kitty/graphics-protocol/
// * iTerm2: https://iterm2.com/documentation-images.html
// * sixel: DEC's VT330/VT340 manual, chapter 14; bytes by libsixel
// * half blocks: U+2580, its foreground is the upper pixel, its background the lower one

#include "client-cli/terminal/terminal_picture.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <optional>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include <sixel/sixel.h>

namespace isoscope::cli {
namespace {

// The most characters of a message of kitty's protocol.
constexpr std::size_t kKittyChunk = 4096;
// Pixels with less alpha do not show.
constexpr int kMinAlpha = 128;
// Entries of sixel's palette; one may stand for "no pixel".
constexpr int kSixelColors = 256;

bool IsShown(image::Rgba8 pixel) { return pixel.a >= kMinAlpha; }

int SquaredDistance(image::Rgba8 a, image::Rgba8 b) {
  const int red = a.r - b.r;
  const int green = a.g - b.g;
  const int blue = a.b - b.b;
  return red * red + green * green + blue * blue;
}

// --- sixel ---------------------------------------------------------------------------------------

struct DitherDeleter {
  void operator()(sixel_dither_t* dither) const { sixel_dither_unref(dither); }
};
struct OutputDeleter {
  void operator()(sixel_output_t* output) const { sixel_output_unref(output); }
};
using Dither = std::unique_ptr<sixel_dither_t, DitherDeleter>;
using Output = std::unique_ptr<sixel_output_t, OutputDeleter>;

absl::Status SixelError(SIXELSTATUS status) {
  return absl::InternalError(absl::StrCat("libsixel: ", sixel_helper_format_error(status)));
}

int AppendToString(char* data, int size, void* text) {
  static_cast<std::string*>(text)->append(data, static_cast<std::size_t>(size));
  return size;
}

absl::StatusOr<Dither> NewDither(int color_count) {
  sixel_dither_t* dither = nullptr;
  if (const SIXELSTATUS status = sixel_dither_new(&dither, color_count, nullptr);
      SIXEL_FAILED(status)) {
    return SixelError(status);
  }
  return Dither(dither);
}

// `pixels`: in the dither's pixel format; not const in the library.
absl::StatusOr<std::string> EncodeSixel(std::vector<unsigned char>* pixels,
                                        const image::RgbaImage& picture, sixel_dither_t* dither) {
  std::string text;
  sixel_output_t* created = nullptr;
  if (const SIXELSTATUS status = sixel_output_new(&created, AppendToString, &text, nullptr);
      SIXEL_FAILED(status)) {
    return SixelError(status);
  }
  const Output output(created);
  constexpr int kDepth = 3;  // is not read
  if (const SIXELSTATUS status =
          sixel_encode(pixels->data(), picture.width, picture.height, kDepth, dither, output.get());
      SIXEL_FAILED(status)) {
    return SixelError(status);
  }
  return text;
}

// Returns the palette that libsixel chooses for the shown pixels: three bytes a colour.
absl::StatusOr<std::vector<unsigned char>> ChoosePalette(const image::RgbaImage& picture,
                                                         int color_count) {
  std::vector<unsigned char> shown;
  for (const image::Rgba8& pixel : picture.pixels) {
    if (IsShown(pixel)) {
      shown.insert(shown.end(), {pixel.r, pixel.g, pixel.b});
    }
  }
  if (shown.empty()) {
    return std::vector<unsigned char>(3, 0);
  }
  absl::StatusOr<Dither> dither = NewDither(color_count);
  if (!dither.ok()) {
    return dither.status();
  }
  if (const SIXELSTATUS status = sixel_dither_initialize(
          dither->get(), shown.data(), static_cast<int>(shown.size() / 3), 1,
          SIXEL_PIXELFORMAT_RGB888, SIXEL_LARGE_AUTO, SIXEL_REP_AUTO, SIXEL_QUALITY_AUTO);
      SIXEL_FAILED(status)) {
    return SixelError(status);
  }
  const unsigned char* const palette = sixel_dither_get_palette(dither->get());
  return std::vector<unsigned char>(
      palette, palette + 3 * sixel_dither_get_num_of_palette_colors(dither->get()));
}

// Returns the colours of the shown pixels, three bytes each, if they are at most `max_count`. The
// library samples only every sixth pixel.
std::optional<std::vector<unsigned char>> FewColors(const image::RgbaImage& picture,
                                                    std::size_t max_count) {
  std::unordered_set<std::uint32_t> known;
  std::vector<unsigned char> palette;
  for (const image::Rgba8& pixel : picture.pixels) {
    if (IsShown(pixel) &&
        known.insert(image::PackedColor({pixel.r, pixel.g, pixel.b, 255})).second) {
      if (known.size() > max_count) {
        return std::nullopt;
      }
      palette.insert(palette.end(), {pixel.r, pixel.g, pixel.b});
    }
  }
  if (palette.empty()) {
    palette.resize(3);
  }
  return palette;
}

// Transparent pixels get the index after the palette, which the library does not draw. Its own
// transparent colour loses a column: version 1.10.3 compares its index with the column, too.
absl::StatusOr<std::string> IndexedSixel(const image::RgbaImage& picture,
                                         absl::StatusOr<std::vector<unsigned char>> palette) {
  if (!palette.ok()) {
    return palette.status();
  }
  const auto color_count = static_cast<int>(palette->size() / 3);
  std::unordered_map<std::uint32_t, unsigned char> known;
  const auto nearest = [&](image::Rgba8 pixel) {
    pixel.a = 255;
    const auto [entry, is_new] = known.try_emplace(image::PackedColor(pixel), 0);
    if (is_new) {
      int best = SquaredDistance({0, 0, 0, 0}, {255, 255, 255, 0}) + 1;
      for (int i = 0; i < color_count; ++i) {
        const unsigned char* const color = palette->data() + 3 * i;
        const int distance = SquaredDistance(pixel, {color[0], color[1], color[2], 255});
        if (distance < best) {
          best = distance;
          entry->second = static_cast<unsigned char>(i);
        }
      }
    }
    return entry->second;
  };
  std::vector<unsigned char> indices;
  indices.reserve(picture.pixels.size());
  for (const image::Rgba8& pixel : picture.pixels) {
    indices.push_back(IsShown(pixel) ? nearest(pixel) : static_cast<unsigned char>(color_count));
  }
  absl::StatusOr<Dither> dither = NewDither(color_count);
  if (!dither.ok()) {
    return dither.status();
  }
  sixel_dither_set_palette(dither->get(), palette->data());
  sixel_dither_set_pixelformat(dither->get(), SIXEL_PIXELFORMAT_PAL8);
  absl::StatusOr<std::string> text = EncodeSixel(&indices, picture, dither->get());
  if (text.ok()) {
    // The second parameter keeps undrawn pixels unchanged; the library does not set it.
    text->replace(0, text->find('q'), "\x1BP0;1");
  }
  return text;
}

// --- half blocks ---------------------------------------------------------------------------------

// "38;2;r;g;b" or "38;5;n"; a background begins with 48.
std::string ColorCode(const char* layer, image::Rgba8 color, BlockColors colors) {
  return colors == BlockColors::k24Bit
             ? absl::StrCat(layer, ";2;", color.r, ";", color.g, ";", color.b)
             : absl::StrCat(layer, ";5;", NearestXtermColor(color));
}

// The colours in effect, so that each is set once: "" for the terminal's own.
struct CellColors {
  std::string foreground;
  std::string background;
};

// Appends a cell of two pixels.
void AppendCell(image::Rgba8 upper, image::Rgba8 lower, BlockColors colors, CellColors* set,
                std::string* text) {
  constexpr char kUpperHalf[] = "\xE2\x96\x80";
  constexpr char kLowerHalf[] = "\xE2\x96\x84";
  const bool swaps = !IsShown(upper) && IsShown(lower);
  const image::Rgba8 front = swaps ? lower : upper;
  const bool has_front = IsShown(front);
  const bool has_back = IsShown(upper) && IsShown(lower);
  const std::string background = has_back ? ColorCode("48", lower, colors) : "";
  if (background != set->background) {
    absl::StrAppend(text, "\x1B[", background.empty() ? "49" : background, "m");
    set->background = background;
  }
  if (!has_front) {
    absl::StrAppend(text, " ");
    return;
  }
  const std::string foreground = ColorCode("38", front, colors);
  if (has_back && foreground.substr(2) == background.substr(2)) {
    absl::StrAppend(text, " ");  // both pixels are the background
    return;
  }
  if (foreground != set->foreground) {
    absl::StrAppend(text, "\x1B[", foreground, "m");
    set->foreground = foreground;
  }
  absl::StrAppend(text, swaps ? kLowerHalf : kUpperHalf);
}

}  // namespace

std::string KittyPicture(absl::string_view png, const KittyOptions& options) {
  std::string keys = "a=T,f=100,q=2";
  if (options.box.columns > 0) {
    absl::StrAppend(&keys, ",c=", options.box.columns, ",r=", options.box.rows);
  }
  if (options.image_number > 0) {
    absl::StrAppend(&keys, ",i=", options.image_number, ",p=1,C=1");
  }
  const std::string data = absl::Base64Escape(png);
  std::string text;
  text.reserve(data.size() + data.size() / 256 + 64);
  for (std::size_t begin = 0; begin == 0 || begin < data.size(); begin += kKittyChunk) {
    const bool is_last = begin + kKittyChunk >= data.size();
    absl::StrAppend(&text, "\x1B_G", begin == 0 ? absl::StrCat(keys, ",") : std::string(),
                    "m=", is_last ? 0 : 1, ";", data.substr(begin, kKittyChunk), "\x1B\\");
  }
  return text;
}

std::string KittyRemoval(int image_number) {
  return absl::StrCat("\x1B_Ga=d,d=I,i=", image_number, ",q=2\x1B\\");
}

std::string ITerm2Picture(absl::string_view file, const view::Viewport& size, const CellBox& box) {
  const std::string extent =
      box.columns > 0 ? absl::StrCat("width=", box.columns, ";height=", box.rows)
                      : absl::StrCat("width=", size.width_px, "px;height=", size.height_px, "px");
  return absl::StrCat("\x1B]1337;File=inline=1;size=", file.size(), ";", extent,
                      ";preserveAspectRatio=1:", absl::Base64Escape(file), "\x07");
}

absl::StatusOr<std::string> SixelPicture(const image::RgbaImage& picture, SixelQuality quality) {
  constexpr int kMaxShown = kSixelColors - 1;
  if (std::optional<std::vector<unsigned char>> palette = FewColors(picture, kMaxShown)) {
    return IndexedSixel(picture, *std::move(palette));
  }
  if (!std::all_of(picture.pixels.begin(), picture.pixels.end(), IsShown)) {
    return IndexedSixel(picture, ChoosePalette(picture, kMaxShown));
  }
  std::vector<unsigned char> rgb;
  rgb.reserve(picture.pixels.size() * 3);
  for (const image::Rgba8& pixel : picture.pixels) {
    rgb.insert(rgb.end(), {pixel.r, pixel.g, pixel.b});
  }
  absl::StatusOr<Dither> dither = NewDither(kSixelColors);
  if (!dither.ok()) {
    return dither.status();
  }
  const bool is_fast = quality == SixelQuality::kFast;
  if (const SIXELSTATUS status = sixel_dither_initialize(
          dither->get(), rgb.data(), picture.width, picture.height, SIXEL_PIXELFORMAT_RGB888,
          SIXEL_LARGE_AUTO, SIXEL_REP_AUTO, is_fast ? SIXEL_QUALITY_LOW : SIXEL_QUALITY_HIGH);
      SIXEL_FAILED(status)) {
    return SixelError(status);
  }
  sixel_dither_set_diffusion_type(dither->get(), is_fast ? SIXEL_DIFFUSE_NONE : SIXEL_DIFFUSE_FS);
  return EncodeSixel(&rgb, picture, dither->get());
}

int NearestXtermColor(image::Rgba8 color) {
  // 16 to 231: a cube of six levels; 232 to 255: greys.
  constexpr std::array<int, 6> kLevels = {0, 95, 135, 175, 215, 255};
  const auto nearest_level = [&](int value) {
    int best = 0;
    for (int i = 1; i < 6; ++i) {
      if (std::abs(kLevels[static_cast<std::size_t>(i)] - value) <
          std::abs(kLevels[static_cast<std::size_t>(best)] - value)) {
        best = i;
      }
    }
    return best;
  };
  const auto gray_of = [](int value) {
    const auto byte = static_cast<std::uint8_t>(value);
    return image::Rgba8{byte, byte, byte, 255};
  };
  const int red = nearest_level(color.r);
  const int green = nearest_level(color.g);
  const int blue = nearest_level(color.b);
  const auto level = [&](int i) {
    return static_cast<std::uint8_t>(kLevels[static_cast<std::size_t>(i)]);
  };
  const image::Rgba8 cube{level(red), level(green), level(blue), 255};
  const int gray = std::clamp(((color.r + color.g + color.b) / 3 - 3) / 10, 0, 23);
  return SquaredDistance(gray_of(8 + 10 * gray), color) < SquaredDistance(cube, color)
             ? 232 + gray
             : 16 + 36 * red + 6 * green + blue;
}

std::string BlockPicture(const image::RgbaImage& picture, BlockColors colors,
                         absl::string_view line_end) {
  std::string text;
  for (int y = 0; y < picture.height; y += 2) {
    CellColors set;
    const auto row = [&](int index) {
      return &picture.pixels[static_cast<std::size_t>(index) *
                             static_cast<std::size_t>(picture.width)];
    };
    const image::Rgba8* const upper = row(y);
    const image::Rgba8* const lower = y + 1 < picture.height ? row(y + 1) : nullptr;
    absl::StrAppend(&text, y > 0 ? line_end : "");
    for (int x = 0; x < picture.width; ++x) {
      AppendCell(upper[x], lower != nullptr ? lower[x] : image::Rgba8{}, colors, &set, &text);
    }
    absl::StrAppend(&text, "\x1B[0m");
  }
  return text;
}

}  // namespace isoscope::cli
