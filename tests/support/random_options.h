// Options of frames at random: regions, surfaces, clipping, opacities, lights, colour maps. And the
// picture that the coordinator makes of such a frame.

#ifndef ISOSCOPE_TESTS_SUPPORT_RANDOM_OPTIONS_H_
#define ISOSCOPE_TESTS_SUPPORT_RANDOM_OPTIONS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/math/box.h"
#include "core/picture/picture_contents.h"
#include "core/view/clip_region.h"
#include "core/volume/block_layout.h"
#include "server/frame/frame_coordinator.h"

namespace isoscope::testing {

// Returns the part of `whole` that `region` shows.
image::FrameImage Crop(const image::FrameImage& whole, const view::Region& region);

view::Region RandomRegion(std::uint64_t seed, const view::Viewport& viewport);

// Three surfaces, two of them the same level in different colours: all of their fragments tie.
std::vector<frame::Surface> ThreeSurfaces(double isovalue, double step);

// Half-spaces through random points of the volume, and now and then a box.
view::ClipRegion RandomClip(std::uint64_t seed, const math::Box3d& bounds);

// Fills the cuts of two of three clipped requests, every other time with samples.
void AddRandomCaps(std::uint64_t seed, frame::FrameSpec* spec);

// Makes some of the surfaces translucent; in one of four requests all of them.
void MakeRandomlyTranslucent(std::uint64_t seed, frame::FrameSpec* spec);

// Up to four lights, and surfaces that are coloured by a random quantity.
void AddRandomLook(std::uint64_t seed, frame::FrameSpec* spec);

// Colours some of the surfaces by one of the fields; at least one. REQUIRES: as AddRandomLook.
void ShowRandomFields(std::uint64_t seed, const std::vector<std::string>& fields,
                      frame::FrameSpec* spec);

struct Picture {
  image::FrameImage image;  // shaded, with the layers blended
  std::int64_t truncated_pixel_count = 0;
  std::int64_t layer_pixel_count = 0;
  picture::PictureContents contents;
};

// Shades and blends a frame, as the coordinator does. INVALID_ARGUMENT for a bad view.
absl::StatusOr<Picture> PictureOf(server::FrameResult result, const frame::FrameSpec& spec,
                                  const volume::BlockLayout& layout,
                                  const volume::GridGeometry& geometry);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_RANDOM_OPTIONS_H_
