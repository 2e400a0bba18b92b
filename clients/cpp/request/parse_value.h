// Parses the text of a flag into its value. Every error is INVALID_ARGUMENT, quotes the text and
// gives the allowed form.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_PARSE_VALUE_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_PARSE_VALUE_H_

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/base/printable.h"
#include "core/frame/color.h"
#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/view/camera.h"

namespace isoscope::client {

// A decimal whole number in [min, max].
absl::StatusOr<std::int64_t> ParseInteger(absl::string_view text, std::int64_t min,
                                          std::int64_t max);
// Any 64-bit unsigned whole number.
absl::StatusOr<std::uint64_t> ParseUnsigned(absl::string_view text);
// A finite number.
absl::StatusOr<double> ParseNumber(absl::string_view text);
// A finite number > 0.
absl::StatusOr<double> ParsePositiveNumber(absl::string_view text);
// "X,Y,Z": three finite numbers.
absl::StatusOr<math::Vec3d> ParseVector(absl::string_view text);
// "X,Y,Z", all > 0.
absl::StatusOr<math::Vec3d> ParsePositiveVector(absl::string_view text);
// "X,Y,Z": three whole numbers >= 2, the samples of a volume.
absl::StatusOr<math::Index3> ParseDims(absl::string_view text);
// "N" or "NXxNYxNZ", each in [1, BlockLayout::kMaxBlockCells].
absl::StatusOr<math::Index3> ParseBlockCells(absl::string_view text);
// A whole or decimal number of bytes, optionally with K, M, G, T or KiB, MiB, GiB, TiB (all powers
// of 1024): "512MiB", "1.5G". >= 1.
absl::StatusOr<std::int64_t> ParseByteSize(absl::string_view text);
// A number of seconds > 0, optionally with s, ms, m or h: "30", "1.5s", "2m".
absl::StatusOr<absl::Duration> ParseSeconds(absl::string_view text);

// A name of CSS (NamedColor), "#RGB", "#RRGGBB", or "R,G,B", each from 0 to 1: opaque.
absl::StatusOr<frame::Color> ParseColor(absl::string_view text);
// The same, or with an alpha: "#RGBA", "#RRGGBBAA", "R,G,B,A".
absl::StatusOr<frame::Color> ParseColorWithAlpha(absl::string_view text);

// "V", "V:COLOR" or "V:COLOR:OPACITY": a level in field units, and optionally its colour; the
// opacity, in (0, 1], is the colour's alpha.
struct SurfaceValue {
  double isovalue = 0;
  std::optional<frame::Color> color;

  friend bool operator==(const SurfaceValue&, const SurfaceValue&) = default;
};
absl::StatusOr<SurfaceValue> ParseSurface(absl::string_view text);

// "NX,NY,NZ,D": keeps the points p with N . p >= D.
struct PlaneValue {
  math::Vec3d normal;  // not (0, 0, 0)
  double offset = 0;

  friend bool operator==(const PlaneValue&, const PlaneValue&) = default;
};
absl::StatusOr<PlaneValue> ParsePlane(absl::string_view text);
// "X0,X1,Y0,Y1,Z0,Z1", each X0 <= X1.
absl::StatusOr<math::Box3d> ParseBox(absl::string_view text);

// "X,Y,W,H": a window in pixels; X and Y >= 0, W and H >= 1, at most
// view::kMaxWholeViewportPx each.
absl::StatusOr<view::Region> ParseRegion(absl::string_view text);

// One of a few words, each with its value.
template <typename T>
absl::StatusOr<T> ParseChoice(absl::string_view text,
                              const std::vector<std::pair<std::string, T>>& choices) {
  std::string allowed;
  for (const auto& [name, value] : choices) {
    if (text == name) {
      return value;
    }
    allowed += (allowed.empty() ? "" : ", ") + name;
  }
  return absl::InvalidArgumentError(
      absl::StrCat(base::Quoted(text, '\''), " is none of: ", allowed));
}

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_PARSE_VALUE_H_
