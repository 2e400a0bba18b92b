#include "core/visibility/occlusion_map.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/compression.h"
#include "core/base/crc32c.h"
#include "core/base/status_macros.h"

namespace isoscope::visibility {
namespace {

constexpr char kMagic[] = "ISOM";
constexpr std::size_t kMagicSize = 4;
constexpr std::size_t kChecksummedOffset = 8;
constexpr std::size_t kHeaderSize = 20;
constexpr std::uint8_t kVersion = 1;
constexpr std::uint8_t kDepthCode = 0;
constexpr std::uint8_t kMaskCode = 1;
constexpr std::uint8_t kNothingCode = 2;

constexpr std::uint16_t kFarthestCovered = DepthQuantizer::kUncovered - 1;
// Farther than every depth: a pixel that nothing is drawn on.
constexpr float kBeyondDepth = 2.0F;

// A rectangle is first looked at where it is at most this many texels wide and high.
constexpr int kStartTexels = 4;

int TexelCount(int size_px, int level) { return ((size_px - 1) >> level) + 1; }

constexpr std::uint16_t ZigZag(int difference) {
  const auto d = static_cast<std::uint16_t>(difference);
  return static_cast<std::uint16_t>(d << 1 ^ (0 - (d >> 15)));
}
constexpr std::uint16_t UnZigZag(std::uint16_t code) {
  return static_cast<std::uint16_t>(code >> 1 ^ (0 - (code & 1)));
}

// The farthest depth of each texel in a row of texels, kBeyondDepth if it has an uncovered pixel.
void FarthestOfRow(const image::FrameImage& image, int texel_y, int level,
                   std::vector<float>* farthest) {
  std::fill(farthest->begin(), farthest->end(), 0.0F);
  const int end_y = std::min((texel_y + 1) << level, image.height);
  for (int y = texel_y << level; y < end_y; ++y) {
    const std::size_t row = static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width);
    const float* depth = image.depth.data() + row;
    const std::uint32_t* id = image.block_id.data() + row;
    for (int x = 0; x < image.width; ++x) {
      const float drawn = id[x] == image::kNoBlock ? kBeyondDepth : depth[x];
      float& texel = (*farthest)[static_cast<std::size_t>(x >> level)];
      texel = drawn > texel ? drawn : texel;
    }
  }
}

}  // namespace

DepthQuantizer::DepthQuantizer(const view::View& view) {
  if (view.camera().projection == view::Projection::kPerspective) {
    // With distances n and f: d = f (z - n) / (z (f - n)), so (z - n) / (f - n) = (n/f) d /
    // (1 - (1 - n/f) d).
    scale_ = view.near_distance() / view.far_distance();
    bend_ = 1 - scale_;
  }
}

std::uint16_t DepthQuantizer::Quantize(float window_depth) const {
  // Monotone although rounded: a correctly rounded operation is monotone in each operand, and with
  // growing depth the numerator never falls and the positive denominator never rises.
  const double depth = window_depth;
  const double distance = scale_ * depth / (1 - bend_ * depth);
  const double steps = distance * kFarthestCovered;
  return static_cast<std::uint16_t>(std::min(steps, static_cast<double>(kFarthestCovered)));
}

OcclusionMap OcclusionMap::FromImage(const image::FrameImage& image,
                                     const DepthQuantizer& quantizer, MapKind kind, int level) {
  ISOSCOPE_CHECK_GE(image.width, 1);
  ISOSCOPE_CHECK_GE(image.height, 1);
  ISOSCOPE_CHECK_GE(level, 0);
  ISOSCOPE_CHECK_LE(level, kMaxLevel);
  OcclusionMap map;
  map.kind_ = kind;
  map.level_ = level;
  map.width_px_ = image.width;
  map.height_px_ = image.height;
  Level base;
  base.width = TexelCount(image.width, level);
  base.height = TexelCount(image.height, level);
  base.texels.resize(static_cast<std::size_t>(base.width) * static_cast<std::size_t>(base.height));
  std::vector<float> farthest(static_cast<std::size_t>(base.width));
  std::uint16_t* texel = base.texels.data();
  for (int y = 0; y < base.height; ++y) {
    FarthestOfRow(image, y, level, &farthest);
    // Quantized after the maximum: the same by monotonicity, and fewer divisions.
    for (const float depth : farthest) {
      if (depth == kBeyondDepth) {
        *texel++ = DepthQuantizer::kUncovered;
      } else {
        *texel++ = kind == MapKind::kMask ? std::uint16_t{0} : quantizer.Quantize(depth);
      }
    }
  }
  map.pyramid_.push_back(std::move(base));
  map.BuildPyramid();
  return map;
}

void OcclusionMap::BuildPyramid() {
  while (pyramid_.back().width > 1 || pyramid_.back().height > 1) {
    const Level& fine = pyramid_.back();
    Level coarse;
    coarse.width = (fine.width + 1) / 2;
    coarse.height = (fine.height + 1) / 2;
    coarse.texels.resize(static_cast<std::size_t>(coarse.width) *
                         static_cast<std::size_t>(coarse.height));
    for (int y = 0; y < fine.height; ++y) {
      const std::uint16_t* from =
          fine.texels.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(fine.width);
      std::uint16_t* to = coarse.texels.data() +
                          static_cast<std::size_t>(y / 2) * static_cast<std::size_t>(coarse.width);
      for (int x = 0; x < fine.width; ++x) {
        to[x / 2] = std::max(to[x / 2], from[x]);
      }
    }
    pyramid_.push_back(std::move(coarse));
  }
}

bool OcclusionMap::IsBelow(int step, int x, int y, const view::PixelRect& texels,
                           std::uint16_t limit) const {
  const Level& level = pyramid_[static_cast<std::size_t>(step)];
  const std::uint16_t farthest =
      level.texels[static_cast<std::size_t>(y) * static_cast<std::size_t>(level.width) +
                   static_cast<std::size_t>(x)];
  if (farthest < limit) {
    return true;
  }
  // What of the base this texel stands for, and is in the rectangle.
  const Level& base = pyramid_.front();
  const view::PixelRect whole{x << step, y << step, std::min((x + 1) << step, base.width),
                              std::min((y + 1) << step, base.height)};
  const view::PixelRect part{
      std::max(whole.begin_x, texels.begin_x), std::max(whole.begin_y, texels.begin_y),
      std::min(whole.end_x, texels.end_x), std::min(whole.end_y, texels.end_y)};
  if (part == whole) {
    return false;  // the farthest texel is in the rectangle
  }
  const int finer = step - 1;
  for (int child_y = part.begin_y >> finer; child_y <= (part.end_y - 1) >> finer; ++child_y) {
    for (int child_x = part.begin_x >> finer; child_x <= (part.end_x - 1) >> finer; ++child_x) {
      if (!IsBelow(finer, child_x, child_y, part, limit)) {
        return false;
      }
    }
  }
  return true;
}

bool OcclusionMap::Hides(const view::Footprint& footprint, const DepthQuantizer& quantizer) const {
  if (pyramid_.empty()) {
    return false;
  }
  if (footprint.rect.empty()) {
    return true;
  }
  const Level& base = pyramid_.front();
  const view::PixelRect texels{std::max(footprint.rect.begin_x, 0) >> level_,
                               std::max(footprint.rect.begin_y, 0) >> level_,
                               std::min(((footprint.rect.end_x - 1) >> level_) + 1, base.width),
                               std::min(((footprint.rect.end_y - 1) >> level_) + 1, base.height)};
  if (texels.empty()) {
    return true;
  }
  const std::uint16_t limit = kind_ == MapKind::kMask ? DepthQuantizer::kUncovered
                                                      : quantizer.Quantize(footprint.nearest_depth);
  const int extent = std::max(texels.end_x - texels.begin_x, texels.end_y - texels.begin_y);
  int step = 0;
  while (extent >> step > kStartTexels && step + 1 < static_cast<int>(pyramid_.size())) {
    ++step;
  }
  for (int y = texels.begin_y >> step; y <= (texels.end_y - 1) >> step; ++y) {
    for (int x = texels.begin_x >> step; x <= (texels.end_x - 1) >> step; ++x) {
      if (!IsBelow(step, x, y, texels, limit)) {
        return false;
      }
    }
  }
  return true;
}

bool OcclusionMap::HidesFragment(int x, int y, float window_depth,
                                 const DepthQuantizer& quantizer) const {
  if (pyramid_.empty() || kind_ == MapKind::kMask) {
    return false;
  }
  const Level& base = pyramid_.front();
  const std::uint16_t farthest =
      base.texels[static_cast<std::size_t>(y >> level_) * static_cast<std::size_t>(base.width) +
                  static_cast<std::size_t>(x >> level_)];
  return farthest != DepthQuantizer::kUncovered && farthest < quantizer.Quantize(window_depth);
}

std::string OcclusionMap::Encode() const {
  std::uint8_t kind_code = kNothingCode;
  std::string planes;
  if (!pyramid_.empty()) {
    kind_code = kind_ == MapKind::kMask ? kMaskCode : kDepthCode;
    const Level& base = pyramid_.front();
    const std::size_t count = base.texels.size();
    const auto width = static_cast<std::size_t>(base.width);
    planes.resize(2 * count);
    for (std::size_t i = 0; i < count; ++i) {
      const int before = i % width != 0 ? base.texels[i - 1]
                         : i >= width   ? base.texels[i - width]
                                        : 0;
      const std::uint16_t code = ZigZag(base.texels[i] - before);
      planes[i] = static_cast<char>(code & 0xff);
      planes[count + i] = static_cast<char>(code >> 8);
    }
  }
  std::string bytes(kMagic, kMagicSize);
  base::AppendLittleEndian(std::uint32_t{0}, &bytes);
  base::AppendLittleEndian(kVersion, &bytes);
  base::AppendLittleEndian(kind_code, &bytes);
  base::AppendLittleEndian(static_cast<std::uint8_t>(level_), &bytes);
  base::AppendLittleEndian(std::uint8_t{0}, &bytes);
  base::AppendLittleEndian(static_cast<std::uint32_t>(width_px_), &bytes);
  base::AppendLittleEndian(static_cast<std::uint32_t>(height_px_), &bytes);
  bytes += base::Compress(planes);
  base::StoreLittleEndian(
      base::ExtendCrc32c(0, bytes.data() + kChecksummedOffset, bytes.size() - kChecksummedOffset),
      bytes.data() + kMagicSize);
  return bytes;
}

absl::StatusOr<OcclusionMap> OcclusionMap::Decode(absl::string_view bytes,
                                                  const view::Viewport& viewport) {
  if (bytes.size() < kHeaderSize || bytes.substr(0, kMagicSize) != kMagic) {
    return absl::DataLossError(
        absl::StrFormat("occlusion map of %d bytes: no header of %d bytes with the magic %s",
                        bytes.size(), kHeaderSize, kMagic));
  }
  const auto stated_crc = base::LoadLittleEndian<std::uint32_t>(bytes.data() + kMagicSize);
  const std::uint32_t actual_crc = base::Crc32c(bytes.substr(kChecksummedOffset));
  if (stated_crc != actual_crc) {
    return absl::DataLossError(
        absl::StrFormat("occlusion map of %d bytes: CRC-32C is %08x, the header states %08x",
                        bytes.size(), actual_crc, stated_crc));
  }
  base::Decoder decoder(bytes.substr(kChecksummedOffset));
  std::uint8_t version = 0;
  std::uint8_t kind_code = 0;
  std::uint8_t level = 0;
  std::uint8_t flags = 0;
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  const bool complete = decoder.Read(&version) && decoder.Read(&kind_code) &&
                        decoder.Read(&level) && decoder.Read(&flags) && decoder.Read(&width) &&
                        decoder.Read(&height);
  if (!complete || version != kVersion || flags != 0 || kind_code > kNothingCode ||
      level > kMaxLevel) {
    return absl::DataLossError(absl::StrFormat(
        "occlusion map: version %d, kind %d, level %d, flags %d; expected %d, 0 to 2, 0 to %d, 0",
        version, kind_code, level, flags, kVersion, kMaxLevel));
  }
  if (kind_code == kNothingCode) {
    return OcclusionMap();
  }
  ISOSCOPE_RETURN_IF_ERROR(view::Validate(viewport));
  if (width != static_cast<std::uint32_t>(viewport.width_px) ||
      height != static_cast<std::uint32_t>(viewport.height_px)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("occlusion map of a viewport of %d x %d pixels; expected %d x %d", width,
                        height, viewport.width_px, viewport.height_px));
  }
  OcclusionMap map;
  map.kind_ = kind_code == kMaskCode ? MapKind::kMask : MapKind::kDepth;
  map.level_ = level;
  map.width_px_ = viewport.width_px;
  map.height_px_ = viewport.height_px;
  Level base;
  base.width = TexelCount(viewport.width_px, level);
  base.height = TexelCount(viewport.height_px, level);
  const auto row_size = static_cast<std::size_t>(base.width);
  const std::size_t count = row_size * static_cast<std::size_t>(base.height);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string planes,
                            base::Decompress(bytes.substr(kHeaderSize), 2 * count));
  if (planes.size() != 2 * count) {
    return absl::DataLossError(
        absl::StrFormat("occlusion map of %d texels holds %d bytes", count, planes.size()));
  }
  base.texels.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const int before = i % row_size != 0 ? base.texels[i - 1]
                       : i >= row_size   ? base.texels[i - row_size]
                                         : 0;
    const auto code = static_cast<std::uint16_t>(static_cast<std::uint8_t>(planes[i]) |
                                                 static_cast<std::uint8_t>(planes[count + i]) << 8);
    base.texels[i] = static_cast<std::uint16_t>(before + UnZigZag(code));
  }
  map.pyramid_.push_back(std::move(base));
  map.BuildPyramid();
  return map;
}

}  // namespace isoscope::visibility
