// Sources of the formats:
//
// * kitty: https://sw.kovidgoyal.net/kitty/graphics-protocol/
// * iTerm2: https://iterm2.com/documentation-images.html
// * sixel: DEC's VT330/VT340 manual, chapter 14; bytes by libsixel
// * half blocks: U+2580, its foreground is the upper pixel, its background the lower one
// * ordered dither: Bayer 1973, a matrix of 4 x 4 thresholds, the same for red, green and blue, so
//   that grey gets no hue

#include "client-cli/terminal/terminal_picture.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
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

constexpr int kMatrixSide = 4;
constexpr int kThresholds = kMatrixSide * kMatrixSide;
// Ranks of thresholds: those of neighbours are far apart.
constexpr std::array<std::array<int, kMatrixSide>, kMatrixSide> kMatrix = {
    {{0, 8, 2, 10}, {12, 4, 14, 6}, {3, 11, 1, 9}, {15, 7, 13, 5}}};

// Of two neighbouring levels the one that stands for `value` where the threshold has this rank.
// `levels`: ascending, from 0 to 255. Returns its index.
template <std::size_t Count>
int DitheredLevel(const std::array<int, Count>& levels, int value, int rank) {
  const auto above = std::upper_bound(levels.begin(), levels.end(), value);
  const auto below = above - 1;
  const auto index = static_cast<int>(below - levels.begin());
  if (above == levels.end()) {
    return index;
  }
  // The threshold is in the middle of its rank.
  const bool is_above = 2 * kThresholds * (value - *below) > (2 * rank + 1) * (*above - *below);
  return is_above ? index + 1 : index;
}

// xterm's colours 16 to 231 are a cube of six levels.
constexpr std::array<int, 6> kCubeLevels = {0, 95, 135, 175, 215, 255};
constexpr int kFirstOfCube = 16;
constexpr int kGraysOfRamp = 24;
constexpr int kFirstGray = 232;

struct Gray {
  int level;
  int color;  // of xterm
};
constexpr std::size_t kGrayCount = kCubeLevels.size() + kGraysOfRamp;

// All greys, by their levels: those of the cube, and 8, 18, ..., 238.
std::array<Gray, kGrayCount> XtermGrays() {
  std::array<Gray, kGrayCount> grays{};
  std::size_t count = 0;
  for (int i = 0; i < static_cast<int>(kCubeLevels.size()); ++i) {
    grays[count++] = {kCubeLevels[static_cast<std::size_t>(i)], kFirstOfCube + i * (36 + 6 + 1)};
  }
  for (int i = 0; i < kGraysOfRamp; ++i) {
    grays[count++] = {8 + 10 * i, kFirstGray + i};
  }
  std::sort(grays.begin(), grays.end(), [](Gray a, Gray b) { return a.level < b.level; });
  return grays;
}

int DitheredXtermColor(image::Rgba8 color, int rank) {
  if (color.r == color.g && color.g == color.b) {
    static const std::array<Gray, kGrayCount> grays = XtermGrays();
    static const std::array<int, kGrayCount> levels = [] {
      std::array<int, kGrayCount> all{};
      std::transform(grays.begin(), grays.end(), all.begin(), [](Gray gray) { return gray.level; });
      return all;
    }();
    return grays[static_cast<std::size_t>(DitheredLevel(levels, color.r, rank))].color;
  }
  return kFirstOfCube + 36 * DitheredLevel(kCubeLevels, color.r, rank) +
         6 * DitheredLevel(kCubeLevels, color.g, rank) + DitheredLevel(kCubeLevels, color.b, rank);
}

// Red, green and blue as bits, as ANSI has them.
int DitheredAnsiColor(image::Rgba8 color, int rank) {
  constexpr std::array<int, 2> kLevels = {0, 255};
  return DitheredLevel(kLevels, color.r, rank) + 2 * DitheredLevel(kLevels, color.g, rank) +
         4 * DitheredLevel(kLevels, color.b, rank);
}

// The code of a foreground: "38;2;r;g;b", "38;5;n", or of ANSI's colours "31", bright "91". Empty
// if the pixel does not show.
std::string ColorCode(image::Rgba8 pixel, int x, int y, BlockColors colors) {
  if (!IsShown(pixel)) {
    return "";
  }
  const int rank =
      kMatrix[static_cast<std::size_t>(y % kMatrixSide)][static_cast<std::size_t>(x % kMatrixSide)];
  if (colors == BlockColors::k24Bit) {
    return absl::StrCat("38;2;", pixel.r, ";", pixel.g, ";", pixel.b);
  }
  if (colors == BlockColors::k256) {
    return absl::StrCat("38;5;", DitheredXtermColor(pixel, rank));
  }
  const int color = DitheredAnsiColor(pixel, rank);
  const bool is_bright = colors == BlockColors::k16 && color > 0;
  return absl::StrCat(is_bright ? "9" : "3", color);
}

// The code that has the colour of `foreground` behind a character.
std::string BackgroundCode(absl::string_view foreground) {
  return absl::StrCat(foreground[0] == '9' ? "10" : "4", foreground.substr(1));
}

// The codes in effect, so that each is set once: "" for the terminal's own.
struct CellColors {
  std::string foreground;
  std::string background;
};

// Appends a cell of two pixels, by their codes as ColorCode has them.
void AppendCell(const std::string& upper, const std::string& lower, CellColors* set,
                std::string* text) {
  constexpr char kUpperHalf[] = "\xE2\x96\x80";
  constexpr char kLowerHalf[] = "\xE2\x96\x84";
  const bool swaps = upper.empty() && !lower.empty();
  const std::string& front = swaps ? lower : upper;
  const bool has_back = !upper.empty() && !lower.empty();
  const std::string background = has_back ? BackgroundCode(lower) : "";
  if (background != set->background) {
    absl::StrAppend(text, "\x1B[", background.empty() ? "49" : background, "m");
    set->background = background;
  }
  if (front.empty() || (has_back && upper == lower)) {
    absl::StrAppend(text, " ");  // nothing, or both pixels are the background
    return;
  }
  if (front != set->foreground) {
    absl::StrAppend(text, "\x1B[", front, "m");
    set->foreground = front;
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

std::string BlockPicture(const image::RgbaImage& picture, BlockColors colors,
                         absl::string_view line_end) {
  std::string text;
  for (int y = 0; y < picture.height; y += 2) {
    CellColors set;
    const auto code = [&](int x, int row) {
      return row < picture.height
                 ? ColorCode(picture.pixels[static_cast<std::size_t>(row) *
                                                static_cast<std::size_t>(picture.width) +
                                            static_cast<std::size_t>(x)],
                             x, row, colors)
                 : "";
    };
    absl::StrAppend(&text, y > 0 ? line_end : "");
    for (int x = 0; x < picture.width; ++x) {
      AppendCell(code(x, y), code(x, y + 1), &set, &text);
    }
    absl::StrAppend(&text, "\x1B[0m");
  }
  return text;
}

}  // namespace isoscope::cli
