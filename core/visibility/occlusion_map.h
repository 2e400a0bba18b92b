// Steps 2 and 3 of a frame: the occlusion map, made by the coordinator from the composited depth of
// the occluders, and the test that culls a block by it.
//
// Conservative by construction: a texel holds the FARTHEST quantized depth of its pixels, and a
// block is hidden only if its nearest depth, quantized by the same monotone function, is strictly
// larger than every texel of its footprint. So no hidden block could have won a pixel
// (docs/numerics.md has the proof).

#ifndef ISOSCOPE_CORE_VISIBILITY_OCCLUSION_MAP_H_
#define ISOSCOPE_CORE_VISIBILITY_OCCLUSION_MAP_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/image/frame_image.h"
#include "core/view/view.h"

namespace isoscope::visibility {

// A monotone map of window depth [0, 1] to 16 bits, linear in eye distance, so that the bits are
// spread evenly over the volume. Monotone: a <= b implies Quantize(a) <= Quantize(b).
class DepthQuantizer {
 public:
  explicit DepthQuantizer(const view::View& view);
  // 0 .. 65534; background has kUncovered. REQUIRES: 0 <= window_depth <= 1.
  [[nodiscard]] std::uint16_t Quantize(float window_depth) const;

  static constexpr std::uint16_t kUncovered = 65535;

 private:
  // t(d) = scale d / (1 - bend d) is 0 at the near plane, 1 at the far plane, linear in distance.
  double scale_ = 1;
  double bend_ = 0;
};

enum class MapKind {
  kDepth,  // farthest quantized depth: exact culling
  kMask,   // 0 = covered, kUncovered = not: the paper's 1-bit mask, approximate
};

// Row 0 is the top. Immutable after construction; thread-safe.
class OcclusionMap {
 public:
  static constexpr int kMaxLevel = 14;  // one texel for the largest viewport

  // Covers nothing: hides no block (an occlusion map for CULLING_NONE).
  OcclusionMap() = default;

  // Builds the map of a composited image: texels of 2^level x 2^level pixels.
  // REQUIRES: the image is not empty; 0 <= level <= kMaxLevel. O(pixels).
  static OcclusionMap FromImage(const image::FrameImage& image, const DepthQuantizer& quantizer,
                                MapKind kind, int level);

  // True if no fragment of a block with this footprint can win a pixel over what the map was built
  // from (kDepth), or if all its pixels are covered (kMask). The answer is that of all texels the
  // rectangle touches; a pyramid of farthest depths finds it by looking at few. An empty rectangle
  // is hidden by every map but the default one.
  [[nodiscard]] bool Hides(const view::Footprint& footprint, const DepthQuantizer& quantizer) const;

  // True if a fragment of this depth at this pixel has certainly lost: step 3 need not send it.
  // A mask is never certain.
  [[nodiscard]] bool HidesFragment(int x, int y, float window_depth,
                                   const DepthQuantizer& quantizer) const;

  // Bytes for the wire (docs/format/wire.md): header, delta-coded texels, Zstandard.
  [[nodiscard]] std::string Encode() const;
  // DATA_LOSS if the bytes are damaged, INVALID_ARGUMENT if they are a map of another viewport.
  static absl::StatusOr<OcclusionMap> Decode(absl::string_view bytes,
                                             const view::Viewport& viewport);

 private:
  struct Level {
    int width = 0;
    int height = 0;
    std::vector<std::uint16_t> texels;
  };
  void BuildPyramid();
  // True if all texels of the half-open rectangle `texels` of pyramid_[0] that lie in texel
  // (x, y) of pyramid_[step] are below `limit`.
  [[nodiscard]] bool IsBelow(int step, int x, int y, const view::PixelRect& texels,
                             std::uint16_t limit) const;

  MapKind kind_ = MapKind::kDepth;
  int width_px_ = 0;
  int height_px_ = 0;
  int level_ = 0;
  std::vector<Level> pyramid_;  // [0] is what is sent; each next one halves both sides
};

}  // namespace isoscope::visibility

#endif  // ISOSCOPE_CORE_VISIBILITY_OCCLUSION_MAP_H_
