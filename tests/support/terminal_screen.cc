#include "tests/support/terminal_screen.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"

namespace isoscope::testing {
namespace {

using image::Rgba8;

int ToInt(absl::string_view text) {
  int value = 0;
  return absl::SimpleAtoi(text, &value) ? value : -1;
}

std::vector<int> Numbers(absl::string_view text) {
  std::vector<int> numbers;
  for (const absl::string_view part : absl::StrSplit(text, ';')) {
    numbers.push_back(ToInt(part));
  }
  return numbers;
}

// A picture that grows to the right and downwards.
class Canvas {
 public:
  void Set(int x, int y, Rgba8 color) { pixels_[{y, x}] = color; }
  void Cover(int width, int height) {
    width_ = std::max(width_, width);
    height_ = std::max(height_, height);
  }
  [[nodiscard]] image::RgbaImage Image() const {
    image::RgbaImage image{.width = width_, .height = height_, .pixels = {}};
    image.pixels.resize(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
    for (const auto& [position, color] : pixels_) {
      if (position.first < height_ && position.second < width_) {
        image.pixels[static_cast<std::size_t>(position.first) * static_cast<std::size_t>(width_) +
                     static_cast<std::size_t>(position.second)] = color;
      }
    }
    return image;
  }

 private:
  std::map<std::pair<int, int>, Rgba8> pixels_;
  int width_ = 0;
  int height_ = 0;
};

// The data of a sixel picture, behind "q".
image::RgbaImage ReadSixels(absl::string_view data) {
  Canvas canvas;
  std::map<int, Rgba8> palette;
  Rgba8 color{};
  int x = 0;
  int top = 0;
  int repeat = 1;
  std::size_t i = 0;
  const auto parameters = [&] {
    const std::size_t end = std::min(data.find_first_not_of("0123456789;", i), data.size());
    const std::vector<int> numbers = Numbers(data.substr(i, end - i));
    i = end;
    return numbers;
  };
  const auto byte_of_percent = [](int percent) {
    return static_cast<std::uint8_t>((percent * 255 + 50) / 100);
  };
  while (i < data.size()) {
    const char c = data[i++];
    if (c == '"') {
      const std::vector<int> size = parameters();
      if (size.size() == 4) {
        canvas.Cover(size[2], size[3]);
      }
    } else if (c == '#') {
      const std::vector<int> entry = parameters();
      if (entry.size() == 5 && entry[1] == 2) {
        palette[entry[0]] = {byte_of_percent(entry[2]), byte_of_percent(entry[3]),
                             byte_of_percent(entry[4]), 255};
      }
      color = palette[entry[0]];
    } else if (c == '!') {
      repeat = parameters()[0];
    } else if (c == '$') {
      x = 0;
    } else if (c == '-') {
      x = 0;
      top += 6;
    } else if (c >= '?' && c <= '~') {
      for (; repeat > 0; --repeat, ++x) {
        for (int bit = 0; bit < 6; ++bit) {
          if (((c - '?') >> bit & 1) != 0) {
            canvas.Set(x, top + bit, color);
          }
        }
      }
      repeat = 1;
    }
  }
  return canvas.Image();
}

class Reader {
 public:
  explicit Reader(absl::string_view bytes) : bytes_(bytes) {}

  TerminalScreen Read() {
    while (!bytes_.empty()) {
      if (Take("\x1B_G")) {
        ReadKitty(Until("\x1B\\"));
      } else if (Take("\x1B]1337;File=")) {
        ReadITerm2(Until("\x07"));
      } else if (Take("\x1BP")) {
        ReadSixel(Until("\x1B\\"));
      } else if (Take("\x1B[")) {
        ReadControl();
      } else if (Take("\xE2\x96\x80")) {
        Block(foreground_, background_);
      } else if (Take("\xE2\x96\x84")) {
        Block(background_, foreground_);
      } else if (Take("\n")) {
        column_ = 0;
        ++line_;
        screen_.text += '\n';
      } else {
        Block(background_, background_);
        screen_.text += bytes_[0];
        bytes_.remove_prefix(1);
      }
    }
    screen_.blocks = blocks_.Image();
    return std::move(screen_);
  }

 private:
  bool Take(absl::string_view prefix) {
    if (!absl::StartsWith(bytes_, prefix)) {
      return false;
    }
    bytes_.remove_prefix(prefix.size());
    return true;
  }
  absl::string_view Until(absl::string_view end) {
    const std::size_t length = std::min(bytes_.find(end), bytes_.size());
    const absl::string_view text = bytes_.substr(0, length);
    bytes_.remove_prefix(std::min(bytes_.size(), length + end.size()));
    return text;
  }

  void ReadKitty(absl::string_view message) {
    const std::pair<absl::string_view, absl::string_view> parts =
        absl::StrSplit(message, absl::MaxSplits(';', 1));
    if (absl::StrContains(parts.first, "a=T")) {
      screen_.pictures.push_back({.file = "",
                                  .keys = std::string(parts.first),
                                  .longest_chunk = 0,
                                  .sixels = {},
                                  .keeps_background = false});
      data_.clear();
    } else if (absl::StrContains(parts.first, "a=")) {
      return;  // a removal or a question
    }
    data_ += std::string(parts.second);
    ShownPicture& picture = screen_.pictures.back();
    picture.longest_chunk = std::max(picture.longest_chunk, parts.second.size());
    if (absl::StrContains(parts.first, "m=0")) {
      absl::Base64Unescape(data_, &picture.file);
    }
  }

  void ReadITerm2(absl::string_view message) {
    const std::pair<absl::string_view, absl::string_view> parts =
        absl::StrSplit(message, absl::MaxSplits(':', 1));
    ShownPicture picture;
    picture.keys = std::string(parts.first);
    absl::Base64Unescape(parts.second, &picture.file);
    screen_.pictures.push_back(picture);
  }

  void ReadSixel(absl::string_view message) {
    const std::size_t begin = message.find('q');
    ShownPicture picture;
    const std::vector<int> parameters = Numbers(message.substr(0, begin));
    picture.keeps_background = parameters.size() > 1 && parameters[1] == 1;
    picture.sixels = ReadSixels(message.substr(begin + 1));
    screen_.pictures.push_back(picture);
  }

  void ReadControl() {
    const std::size_t length = std::min(bytes_.find_first_not_of("0123456789;?<>"), bytes_.size());
    const absl::string_view parameters = bytes_.substr(0, length);
    const char final_byte = length < bytes_.size() ? bytes_[length] : ' ';
    bytes_.remove_prefix(std::min(bytes_.size(), length + 1));
    if (final_byte == 'm') {
      SetColors(Numbers(parameters));
    } else if (final_byte == 'H') {
      const std::vector<int> position = Numbers(parameters);
      line_ = std::max(0, position[0] - 1);
      column_ = position.size() > 1 ? position[1] - 1 : 0;
    }
  }

  void SetColors(const std::vector<int>& codes) {
    for (std::size_t i = 0; i < codes.size(); ++i) {
      if (codes[i] == 0 || codes[i] == -1) {
        foreground_ = background_ = {};
      } else if (codes[i] == 49) {
        background_ = {};
      } else if (SetAnsiColor(codes[i])) {
        continue;
      } else if (codes[i] == 38 || codes[i] == 48) {
        Rgba8& color = codes[i] == 38 ? foreground_ : background_;
        if (i + 4 < codes.size() && codes[i + 1] == 2) {
          color = {static_cast<std::uint8_t>(codes[i + 2]), static_cast<std::uint8_t>(codes[i + 3]),
                   static_cast<std::uint8_t>(codes[i + 4]), 255};
          i += 4;
        } else if (i + 2 < codes.size() && codes[i + 1] == 5) {
          color = XtermColor(codes[i + 2]);
          i += 2;
        }
      }
    }
  }

  // "31", "41", bright "91" and "101". Returns false for other codes.
  bool SetAnsiColor(int code) {
    constexpr int kColors = 8;
    const int tens = code / 10;
    const bool is_foreground = tens == 3 || tens == 9;
    if (code % 10 >= kColors || (!is_foreground && tens != 4 && tens != 10)) {
      return false;
    }
    (is_foreground ? foreground_ : background_) = AnsiColor(code % 10 + (tens >= 9 ? kColors : 0));
    return true;
  }

  void Block(Rgba8 upper, Rgba8 lower) {
    if (upper.a != 0) {
      blocks_.Set(column_, 2 * line_, upper);
    }
    if (lower.a != 0) {
      blocks_.Set(column_, 2 * line_ + 1, lower);
    }
    ++column_;
    if (upper.a != 0 || lower.a != 0) {
      blocks_.Cover(column_, 2 * line_ + 2);
    }
  }

  absl::string_view bytes_;
  TerminalScreen screen_;
  std::string data_;  // of a picture of kitty that is not whole
  Canvas blocks_;
  Rgba8 foreground_{};
  Rgba8 background_{};
  int line_ = 0;
  int column_ = 0;
};

}  // namespace

TerminalScreen ReadTerminalBytes(absl::string_view bytes) { return Reader(bytes).Read(); }

Rgba8 AnsiColor(int index) {
  constexpr std::array<Rgba8, 16> kColors = {{{0, 0, 0, 255},
                                              {205, 0, 0, 255},
                                              {0, 205, 0, 255},
                                              {205, 205, 0, 255},
                                              {0, 0, 238, 255},
                                              {205, 0, 205, 255},
                                              {0, 205, 205, 255},
                                              {229, 229, 229, 255},
                                              {127, 127, 127, 255},
                                              {255, 0, 0, 255},
                                              {0, 255, 0, 255},
                                              {255, 255, 0, 255},
                                              {92, 92, 255, 255},
                                              {255, 0, 255, 255},
                                              {0, 255, 255, 255},
                                              {255, 255, 255, 255}}};
  return kColors[static_cast<std::size_t>(index & 15)];
}

Rgba8 XtermColor(int index) {
  if (index >= 232) {
    const auto gray = static_cast<std::uint8_t>(8 + 10 * (index - 232));
    return {gray, gray, gray, 255};
  }
  constexpr std::array<std::uint8_t, 6> kLevels = {0, 95, 135, 175, 215, 255};
  const int cube = std::clamp(index - 16, 0, 215);
  const auto level = [&](int digit) { return kLevels[static_cast<std::size_t>(digit % 6)]; };
  return {level(cube / 36), level(cube / 6), level(cube), 255};
}

}  // namespace isoscope::testing
