#include "client-cli/terminal/viewer_layout.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

#include "client-cli/terminal/show_picture.h"
#include "clients/cpp/picture_file/picture_scaling.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/image/jpeg_codec.h"
#include "core/image/png_codec.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

// The longest side of a picture that a terminal draws several times a second.
constexpr int kMaxSide = 1600;
constexpr int kMaxSixelSide = 1024;
constexpr int kMaxBlockSide = 800;
constexpr int kMaxSamplesOfBlock = 4;
// Size of a character, if it is unknown.
constexpr view::Viewport kUsualCell{.width_px = 8, .height_px = 16};

view::Viewport ScaledToSide(const view::Viewport& size, int max_side) {
  const double scale =
      std::min(1.0, static_cast<double>(max_side) / std::max(size.width_px, size.height_px));
  return {.width_px = std::max(1, static_cast<int>(size.width_px * scale)),
          .height_px = std::max(1, static_cast<int>(size.height_px * scale))};
}

constexpr absl::string_view kKeys = "  ? help  q quit ";
constexpr absl::string_view kGap = "   ";
// Narrower windows say no keys.
constexpr std::size_t kLeastRoom = 40;

bool BeginsCharacter(char byte) { return (static_cast<unsigned char>(byte) & 0xc0U) != 0x80; }

std::size_t CharactersOf(absl::string_view utf8) {
  return static_cast<std::size_t>(std::count_if(utf8.begin(), utf8.end(), BeginsCharacter));
}

// The first `count` characters.
absl::string_view Front(absl::string_view utf8, std::size_t count) {
  std::size_t end = 0;
  for (; end < utf8.size(); ++end) {
    if (BeginsCharacter(utf8[end]) && count-- == 0) {
      break;
    }
  }
  return utf8.substr(0, end);
}

// `text` in exactly `room` characters.
std::string Filled(absl::string_view text, std::size_t room) {
  constexpr absl::string_view kCut = "...";
  const std::size_t count = CharactersOf(text);
  if (count <= room) {
    return absl::StrCat(text, std::string(room - count, ' '));
  }
  return room <= kCut.size() ? std::string(kCut.substr(0, room))
                             : absl::StrCat(Front(text, room - kCut.size()), kCut);
}

absl::StatusOr<image::RgbaImage> Decode(const v1::RenderIsosurfaceResponse& frame) {
  return frame.png().empty() ? image::DecodeJpeg(frame.jpeg()) : image::DecodePng(frame.png());
}

}  // namespace

std::string StatusText(absl::string_view shown, absl::string_view message,
                       absl::string_view figures, int columns) {
  const auto width = static_cast<std::size_t>(std::max(0, columns));
  const absl::string_view keys = width >= kLeastRoom + kKeys.size() ? kKeys : "";
  const std::size_t room = width - keys.size();
  absl::string_view rest = message.empty() ? figures : message;
  const auto join = [&] {
    // Names and messages come from outside.
    return base::Printable(absl::StrCat(" ", shown, rest.empty() ? "" : kGap, rest));
  };
  std::string text = join();
  if (!message.empty() && CharactersOf(text) > room) {
    text = base::Printable(absl::StrCat(" ", message));
  }
  // The last figures are the least ones.
  while (message.empty() && CharactersOf(text) > room && absl::StrContains(rest, kGap)) {
    rest = rest.substr(0, rest.rfind(kGap));
    text = join();
  }
  return absl::StrCat(Filled(text, room), keys);
}

view::Viewport CellOf(const TerminalSize& terminal) {
  if (terminal.pixels.width_px == 0) {
    return kUsualCell;
  }
  return {.width_px = std::max(1, terminal.pixels.width_px / terminal.columns),
          .height_px = std::max(1, terminal.pixels.height_px / terminal.rows)};
}

ViewerLayout LayoutOf(PictureFormat format, const TerminalSize& terminal) {
  ViewerLayout layout{.format = format, .terminal = terminal, .box = {}, .viewport = {}};
  layout.box = {.columns = terminal.columns, .rows = std::max(1, terminal.rows - 1)};
  const view::Viewport cell = CellOf(terminal);
  const view::Viewport window{.width_px = layout.box.columns * cell.width_px,
                              .height_px = layout.box.rows * cell.height_px};
  if (IsBlocks(format)) {
    const int samples = std::clamp(kMaxBlockSide / terminal.columns, 1, kMaxSamplesOfBlock);
    layout.viewport = {
        .width_px = layout.box.columns * samples,
        .height_px = std::max(1, layout.box.rows * samples * cell.height_px / cell.width_px)};
    layout.viewport = ScaledToSide(layout.viewport, kMaxSide);
  } else {
    layout.viewport =
        ScaledToSide(window, format == PictureFormat::kSixel ? kMaxSixelSide : kMaxSide);
  }
  return layout;
}

absl::StatusOr<std::string> DrawFrame(const ViewerLayout& layout,
                                      const v1::InteractResponse& response, int image_number) {
  const v1::RenderIsosurfaceResponse& frame = response.frame();
  if (layout.format == PictureFormat::kITerm2) {
    return ITerm2Picture(frame.png().empty() ? frame.jpeg() : frame.png(), layout.viewport,
                         layout.box);
  }
  if (layout.format == PictureFormat::kKitty && !frame.png().empty()) {
    return KittyPicture(frame.png(), {.box = layout.box, .image_number = image_number});
  }
  ISOSCOPE_ASSIGN_OR_RETURN(image::RgbaImage picture, Decode(frame));
  switch (layout.format) {
    case PictureFormat::kKitty:
      return KittyPicture(image::EncodePng(picture.width, picture.height, picture.pixels),
                          {.box = layout.box, .image_number = image_number});
    case PictureFormat::kSixel:
      return SixelPicture(client::ScalePicture(std::move(picture), layout.viewport),
                          response.is_exact() ? SixelQuality::kBest : SixelQuality::kFast);
    default:
      return BlockPicture(
          client::ScalePicture(std::move(picture),
                               {.width_px = layout.box.columns, .height_px = 2 * layout.box.rows}),
          ColorsOfBlocks(layout.format), "\r\n");
  }
}

}  // namespace isoscope::cli
