#include "client-cli/terminal/show_picture.h"

#include <unistd.h>

#include <algorithm>
#include <limits>

#include "absl/strings/str_cat.h"

#include "clients/cpp/picture_file/picture_scaling.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"

namespace isoscope::cli {
namespace {

// Rows for the text after the picture, and the prompt.
constexpr int kRowsLeft = 4;
constexpr int kFileColumns = 80;
// Height over width of a character, if it is unknown.
constexpr double kCellAspect = 2;
constexpr int kCellWidth = 8;

absl::StatusOr<ShowMode> ParseShowMode(absl::string_view text) {
  return client::ParseChoice<ShowMode>(text, {{"auto", ShowMode::kAuto},
                                              {"never", ShowMode::kNever},
                                              {"kitty", ShowMode::kKitty},
                                              {"iterm2", ShowMode::kITerm2},
                                              {"sixel", ShowMode::kSixel},
                                              {"blocks", ShowMode::kBlocks}});
}

int PictureRows(const TerminalSize& terminal) { return std::max(1, terminal.rows - kRowsLeft); }

}  // namespace

void AddShowFlag(FlagSet* set, std::optional<ShowMode>* mode, const std::string& help) {
  AddFlag(set, "--show", "auto|never|kitty|iterm2|sixel|blocks", mode, ParseShowMode, help);
}

bool IsFormat(ShowMode mode) { return mode != ShowMode::kAuto && mode != ShowMode::kNever; }

bool IsBlocks(PictureFormat format) {
  return format == PictureFormat::kBlocks24Bit || format == PictureFormat::kBlocks256 ||
         format == PictureFormat::kBlocks16 || format == PictureFormat::kBlocks8;
}

BlockColors ColorsOfBlocks(PictureFormat format) {
  return format == PictureFormat::kBlocks24Bit ? BlockColors::k24Bit
         : format == PictureFormat::kBlocks256 ? BlockColors::k256
         : format == PictureFormat::kBlocks16  ? BlockColors::k16
                                               : BlockColors::k8;
}

std::optional<PictureFormat> FormatOf(ShowMode mode, const Environment& environment) {
  switch (mode) {
    case ShowMode::kAuto:
    case ShowMode::kNever:
      return std::nullopt;
    case ShowMode::kKitty:
      return PictureFormat::kKitty;
    case ShowMode::kITerm2:
      return PictureFormat::kITerm2;
    case ShowMode::kSixel:
      return PictureFormat::kSixel;
    case ShowMode::kBlocks: {
      const PictureFormat blocks = BlocksOfEnvironment(environment);
      return blocks == PictureFormat::kNone ? PictureFormat::kBlocks256 : blocks;
    }
  }
  return std::nullopt;
}

PictureDisplay::PictureDisplay(PictureFormat format, const std::optional<TerminalSize>& terminal)
    : format_(format), terminal_(terminal) {}

PictureDisplay PictureDisplay::ForStandardOutput(ShowMode mode, const Context& context) {
  const bool is_terminal = context.out_columns > 0;
  if (mode == ShowMode::kNever || (mode == ShowMode::kAuto && !is_terminal)) {
    return {PictureFormat::kNone, std::nullopt};
  }
  const std::optional<PictureFormat> wanted = FormatOf(mode, ProcessEnvironment);
  const std::optional<PictureTerminal> terminal =
      is_terminal ? FindPictureTerminal(STDOUT_FILENO, ProcessEnvironment, wanted) : std::nullopt;
  if (terminal) {
    return {terminal->format, terminal->size};
  }
  return {wanted.value_or(PictureFormat::kNone), std::nullopt};
}

view::Viewport PictureDisplay::SizeOf(const view::Viewport& size) const {
  constexpr int kNoLimit = std::numeric_limits<int>::max();
  if (IsBlocks(format_)) {
    const TerminalSize terminal = terminal_.value_or(
        TerminalSize{.columns = kFileColumns, .rows = kNoLimit / 4, .pixels = {}});
    const bool knows_cells = terminal.pixels.width_px > 0;
    const double cell_aspect =
        knows_cells ? static_cast<double>(terminal.pixels.height_px) / terminal.rows /
                          (static_cast<double>(terminal.pixels.width_px) / terminal.columns)
                    : kCellAspect;
    return client::FitInside(size,
                             {.width_px = terminal.columns, .height_px = 2 * PictureRows(terminal)},
                             cell_aspect / 2);
  }
  if (!terminal_) {
    return size;
  }
  const view::Viewport window =
      terminal_->pixels.width_px > 0
          ? terminal_->pixels
          : view::Viewport{
                .width_px = terminal_->columns * kCellWidth,
                .height_px = static_cast<int>(terminal_->rows * kCellWidth * kCellAspect)};
  const int rows_high = static_cast<int>(static_cast<double>(window.height_px) / terminal_->rows *
                                         PictureRows(*terminal_));
  return client::FitInside(size, {.width_px = window.width_px, .height_px = rows_high}, 1);
}

CellBox PictureDisplay::BoxOf(const image::RgbaImage& picture) const {
  if (!terminal_ || terminal_->pixels.width_px > 0) {
    return {};
  }
  const view::Viewport cells = client::FitInside(
      {.width_px = picture.width, .height_px = picture.height},
      {.width_px = terminal_->columns, .height_px = PictureRows(*terminal_)}, kCellAspect);
  return {.columns = cells.width_px, .rows = cells.height_px};
}

absl::StatusOr<std::string> PictureDisplay::Encode(const image::RgbaImage& picture) const {
  const auto png = [&picture] {
    return image::EncodePng(picture.width, picture.height, picture.pixels);
  };
  std::string text;
  switch (format_) {
    case PictureFormat::kNone:
      return absl::FailedPreconditionError("no picture is shown here");
    case PictureFormat::kKitty:
      text = KittyPicture(png(), {.box = BoxOf(picture)});
      break;
    case PictureFormat::kITerm2:
      text = ITerm2Picture(png(), {.width_px = picture.width, .height_px = picture.height},
                           BoxOf(picture));
      break;
    case PictureFormat::kSixel: {
      ISOSCOPE_ASSIGN_OR_RETURN(text, SixelPicture(picture, SixelQuality::kBest));
      break;
    }
    case PictureFormat::kBlocks24Bit:
    case PictureFormat::kBlocks256:
    case PictureFormat::kBlocks16:
    case PictureFormat::kBlocks8:
      text = BlockPicture(picture, ColorsOfBlocks(format_), "\n");
      break;
  }
  return text + "\n";
}

}  // namespace isoscope::cli
